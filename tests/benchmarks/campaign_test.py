#!/usr/bin/env python3
"""campaign.py with programs that only pretend: which jobs run, what the tables say."""

import json
import pathlib
import stat
import subprocess
import sys
import tempfile
import unittest

ACCURACY = pathlib.Path(__file__).resolve().parents[2] / "benchmarks" / "accuracy"
sys.path.insert(0, str(ACCURACY))

import baselines  # noqa: E402
import campaign_jobs as jobs  # noqa: E402

# Notes each call; the "error" of an estimate is what its producer wrote into it.
PRETENDER = """#!{python}
import json, pathlib, sys
name, words = pathlib.Path(sys.argv[0]).name, sys.argv[1:]
value = lambda key: words[words.index(key) + 1] if key in words else None
if words == ["--version"]:
    print("s3-slam test"); sys.exit()
if words == ["--help"]:
    print("  planes.mode = joint (off|fixed|joint)"); sys.exit()
with open("{log}", "a") as log:
    log.write(name + " " + " ".join(words) + "\\n")
if name == "s3-eval":
    error = float(pathlib.Path(value("--estimate")).read_text())
    stats = dict(count=3, rmse=error, median=error, mean=error, min=error, max=error)
    segments = dict(count=0, translation_percent=0, rotation_deg_per_length=0)
    trajectory = dict(num_estimate=9, truth_from_estimate={{}},
                      ate=dict(translation=stats, rotation_deg=stats),
                      rpe=dict(translation=stats, rotation_deg=stats),
                      rpe_per_length=dict(translation=stats), segments=dict(all=segments))
    report = dict(trajectory=trajectory)
    if "--planes" in words:
        report["planes"] = dict(pairs=[1], from_parallel=dict(count=2, min_deg=0.5, median_deg=1.0,
                                                              max_deg=2.0))
    print(json.dumps(report))
else:
    if "broken" in (value("--sequence") or ""):
        print("cannot read it", file=sys.stderr); sys.exit(3)
    error = 0.5 if name == "s3-refine" else 1.0
    error += 0.1 * int(value("--seed"))
    folder = pathlib.Path(value("--output")); folder.mkdir(parents=True, exist_ok=True)
    for file in ("frames.txt", "keyframes.txt"):
        (folder / file).write_text(str(error))
    (folder / "planes.json").write_text("{{}}")
    print(json.dumps(dict(frames=10)))
"""


class Campaign(unittest.TestCase):
    def setUp(self):
        folder = tempfile.TemporaryDirectory()
        self.addCleanup(folder.cleanup)
        self.folder = pathlib.Path(folder.name)
        self.log = self.folder / "log"
        (self.folder / "bin").mkdir()
        for name in ("s3-slam", "s3-lift", "s3-refine", "s3-eval", "s3-synth"):
            program = self.folder / "bin" / name
            program.write_text(PRETENDER.format(python=sys.executable, log=self.log))
            program.chmod(program.stat().st_mode | stat.S_IXUSR)

    def make(self, sequence, masks=("panoptic",)):
        folder = self.folder / "data" / sequence
        for name in masks:
            (folder / name).mkdir(parents=True)
        (folder / "groundtruth.txt").parent.mkdir(parents=True, exist_ok=True)
        (folder / "groundtruth.txt").write_text("")

    def run_campaign(self, *arguments, code=0):
        self.log.write_text("")
        run = subprocess.run(
            [sys.executable, ACCURACY / "campaign.py", "--bin", self.folder / "bin", "--data",
             self.folder / "data", "--output", self.folder / "out", "--cores", "2",
             *map(str, arguments)], capture_output=True, text=True)
        self.assertEqual(run.returncode, code, run.stderr)
        return run.stdout

    def calls(self, program):
        return [line for line in self.log.read_text().splitlines() if line.startswith(program + " ")]

    def test_median_of_the_seeds_with_published_figures_beside(self):
        self.make("tum/rgbd_dataset_freiburg1_xyz")
        text = self.run_campaign("--sequences", "fr1_xyz", "fr2_desk", "--arms", "slam", "off",
                                 "fixed", "full", "--seeds", 0, 1, 4)
        self.assertIn("| fr1_xyz | groundtruth.txt | given | 1.1000 | 0.6000 | 0.6000 | 0.6000 | "
                      "0.0088 | 0.0092 | 0.0090 |", text)
        self.assertIn("1.1000 (1.0000 - 1.4000)", text)
        self.assertIn("| fr1_xyz | given | 2.00 / 0.50 / 1.00 |", text)
        self.assertIn("| fr2_desk | - | - | - | not in ", text)
        self.assertEqual(len(self.calls("s3-slam")), 3)
        for call in self.calls("s3-slam"):
            self.assertIn("cameras/tum_fr1.json", call)
        self.assertEqual(len(self.calls("s3-refine")), 9)
        tables = json.loads((self.folder / "out" / "tables.json").read_text())
        self.assertEqual(len(tables["runs"]), 12)
        self.assertEqual(tables["missing"][0]["sequence"], "fr2_desk")
        lines = (self.folder / "out" / "tables.csv").read_text().splitlines()
        self.assertEqual(len(lines), 13)

    def test_paper_runs_one_sequence_with_and_without_loops(self):
        self.make("tum/rgbd_dataset_freiburg3_nostructure_texture_near_withloop")
        text = self.run_campaign("--sequences", "fr3_nstr_tex_near", "fr3_nstr_tex_near_no_loop",
                                 "--arms", "full")
        self.assertIn("| sequence | reference | masks | full | S3LAM | S3LAM, planes merged | "
                      "ORB-SLAM2 (paper) | ORB-SLAM |", text)
        self.assertIn("| fr3_nstr_tex_near_no_loop | groundtruth.txt | given | 0.5000 | 0.0153 | "
                      "0.0135 | 0.0203 | - |", text)
        self.assertEqual(["loops.enabled=false" in call for call in self.calls("s3-slam")],
                         ["_no_loop" in call for call in self.calls("s3-slam")])

    def test_interrupted_campaign_goes_on(self):
        self.make("tum/rgbd_dataset_freiburg1_xyz")
        arguments = ("--sequences", "fr1_xyz", "--arms", "slam", "off", "fixed")
        first = self.run_campaign(*arguments)
        self.run_campaign(*arguments)
        self.assertEqual(self.calls("s3-slam") + self.calls("s3-refine"), [])
        done = self.folder / "out" / "jobs" / "fr1_xyz" / "0" / "arm.given.fixed.json"
        done.unlink()
        again = self.run_campaign(*arguments)
        self.assertEqual(len(self.calls("s3-refine")), 1)
        self.assertIn("planes.mode=fixed", self.calls("s3-refine")[0])
        self.assertEqual(self.calls("s3-slam"), [])
        self.assertEqual(first.partition("Cost")[0], again.partition("Cost")[0])

    def num_calls(self):
        return [len(self.calls(name)) for name in ("s3-slam", "s3-lift", "s3-refine")]

    def rebuild(self, name):
        program = self.folder / "bin" / name
        program.write_text(program.read_text() + "# Built anew.\n")

    def test_results_of_other_settings_or_programs_are_made_anew(self):
        self.make("tum/rgbd_dataset_freiburg1_xyz")
        arguments = ("--sequences", "fr1_xyz", "--arms", "slam", "off", "fixed")
        self.run_campaign(*arguments)
        self.assertEqual(self.num_calls(), [1, 1, 2])
        self.run_campaign(*arguments, "--frames", ":5")
        self.assertEqual(self.num_calls(), [1, 1, 2])
        self.assertIn("--frames :5", self.calls("s3-slam")[0])
        self.run_campaign(*arguments, "--frames", ":5", "--threads", "2")
        self.assertEqual(self.num_calls(), [1, 1, 2])
        self.rebuild("s3-lift")  # On which neither s3-slam nor the adjustment without planes depends.
        self.run_campaign(*arguments, "--frames", ":5", "--threads", "2")
        self.assertEqual(self.num_calls(), [0, 1, 1])
        self.run_campaign(*arguments, "--frames", ":5", "--threads", "2")
        self.assertEqual(self.num_calls(), [0, 0, 0])

    def test_tables_hold_nothing_of_other_programs(self):
        self.make("tum/rgbd_dataset_freiburg1_xyz")
        arguments = ("--sequences", "fr1_xyz", "--arms", "slam", "fixed")
        self.run_campaign(*arguments)
        self.rebuild("s3-refine")
        text = self.run_campaign(*arguments, "--tables")
        self.assertIn("| fr1_xyz | groundtruth.txt | - | 1.0000 |", text)
        self.assertIn("| fr1_xyz | given | fixed | 0 | what is there was made by other settings", text)

    def test_scene_of_another_program_is_another_one(self):
        for rebuilt, expected in ((), 1), ((), 0), (("s3-synth",), 1):
            for name in rebuilt:
                self.rebuild(name)
            self.run_campaign("--sequences", "desk", "--arms", "off")
            self.assertEqual(len(self.calls("s3-synth")), expected)
            self.assertEqual(self.num_calls(), [expected, 0, expected])

    def test_snakemake_finds_only_what_is_done(self):
        self.make("tum/rgbd_dataset_freiburg1_xyz")
        arguments = ("--sequences", "fr1_xyz", "--arms", "off", "fixed")
        self.run_campaign(*arguments)
        self.rebuild("s3-lift")
        self.run_campaign(*arguments, "--prepare")
        left = sorted(p.name for p in (self.folder / "out" / "jobs" / "fr1_xyz" / "0").glob("*.json"))
        self.assertEqual(left, ["arm.none.off.json", "slam.json"])

    def test_failure_is_told_and_the_rest_is_done(self):
        self.make("tum/rgbd_dataset_freiburg1_xyz")
        self.make("kitti07", ("panoptic", "panoptic_noisy"))
        broken = self.folder / "data" / "tum" / "rgbd_dataset_freiburg1_xyz"
        broken.rename(broken.with_name("broken"))
        broken.symlink_to("broken")
        slam = self.folder / "bin" / "s3-slam"
        slam.write_text(slam.read_text().replace('"broken" in', '"freiburg1" in'))
        text = self.run_campaign("--sequences", "fr1_xyz", "kitti07", "--arms", "off", code=1)
        self.assertIn("| fr1_xyz | none | off | 0 | the job has not been done |", text)
        self.assertIn("| kitti07 | groundtruth.txt | - | 0.5000 |", text)

    def test_sequence_without_masks_has_the_arms_without_planes(self):
        self.make("euroc/MH_05_difficult", ())
        text = self.run_campaign("--sequences", "MH_05_difficult")
        self.assertIn("| MH_05_difficult | groundtruth.txt | - | 1.0000 | 0.5000 |", text)
        self.assertEqual(self.calls("s3-lift"), [])

    def test_arms_of_roads_and_modes_that_are_not_there(self):
        self.make("kitti07", ("panoptic", "panoptic_noisy"))
        text = self.run_campaign("--sequences", "kitti07", "--arms", "height", "hard")
        self.assertEqual(len(self.calls("s3-refine")), 2)  # Clean and noisy masks.
        self.assertIn("camera_height.mode=auto", self.calls("s3-refine")[0])
        self.assertIn("| kitti07 | clean | hard | 0 | this build", text)

    def test_cost_of_refinement_is_told_by_arm(self):
        self.make("kitti07", ("panoptic", "panoptic_noisy"))
        arguments = ("--sequences", "kitti07", "--arms", "slam", "off", "height", "full")
        self.run_campaign(*arguments)
        jobs_folder = self.folder / "out" / "jobs" / "kitti07" / "0"
        for name, wall_s in (("slam", 4), ("lift.clean", 1), ("lift.noisy", 2), ("arm.none.off", 5),
                             ("arm.clean.full", 6), ("arm.noisy.full", 7)):
            path = jobs_folder / f"{name}.json"
            result = json.loads(path.read_text())
            result["cost"] = {"wall_s": wall_s, "cpu_s": 0, "peak_mib": 100 + wall_s}
            path.write_text(json.dumps(result))
        for name in ("arm.clean.height", "arm.noisy.height"):
            (jobs_folder / f"{name}.json").unlink()
        text = self.run_campaign(*arguments, "--tables")
        self.assertIn("| sequence | frames | s3-slam [s] | frames/s | s3-lift [s] | "
                      "s3-refine [s]: off | height | full | peak [MiB]: s3-slam | s3-lift | "
                      "s3-refine |", text)
        self.assertIn("| kitti07 | 10 | 4.0 | 2.5 | 1.5 | 5.0 | - | 6.5 | 104 | 102 | 107 |", text)

    def test_baselines_of_sequences_whose_names_contain_each_other(self):
        names = ["near", "near_no_loop", "desk", "fr1_desk"]
        for file_name, expected in (("orb_near_frames.txt", ("orb", "near")),
                                    ("orb_near_2_frames.txt", ("orb", "near")),
                                    ("orb_near_no_loop_1_frames.txt", ("orb", "near_no_loop")),
                                    ("orb_fr1_desk_frames.txt", ("orb", "fr1_desk")),
                                    ("orb_desk_frames.txt", ("orb", "desk")),
                                    ("orb_far_frames.txt", None)):
            self.assertEqual(baselines.system_and_sequence(file_name, names), expected)

    def test_baselines_of_a_sequence_are_not_those_of_one_that_was_not_chosen(self):
        for name in ("orb_fr1_desk", "orb_desk_1", "orb_desk_2", "dso_desk", "orb_far"):
            (self.folder / f"{name}_frames.txt").write_text("")
        found = {key: [path.name for path in paths]
                 for key, paths in baselines.find(self.folder, ["desk"]).items()}
        self.assertEqual(found, {("desk", "dso"): ["dso_desk_frames.txt"],
                                 ("desk", "orb"): ["orb_desk_1_frames.txt", "orb_desk_2_frames.txt"]})

    def test_baselines_are_measured(self):
        self.make("tum/rgbd_dataset_freiburg1_xyz")
        (self.folder / "others").mkdir()
        (self.folder / "others" / "orb_fr1_xyz_1_frames.txt").write_text("0.25")
        text = self.run_campaign("--sequences", "fr1_xyz", "--arms", "slam", "--baselines",
                                 self.folder / "others")
        self.assertRegex(text, r"fr1_xyz.*orb.*0\.2500")

    def test_wrong_names_are_refused(self):
        for arguments in (("--sequences", "nowhere"), ("--sequences", "kitti07", "--arms", "no")):
            self.run_campaign(*arguments, code=2)

    def test_every_job_follows_what_it_needs(self):
        campaign = jobs.read_campaign({"bin": "b", "data": str(self.folder), "output": "o",
                                       "sequences": ["desk", "street"], "seeds": [0, 1]})
        seen = set()
        for job in jobs.all_jobs(campaign):
            self.assertLessEqual(set(job.needs()), seen)
            seen.add(job)
        outputs = [job.output(campaign) for job in seen]
        self.assertEqual(len(set(outputs)), len(outputs))


if __name__ == "__main__":
    unittest.main()
