#!/usr/bin/env python3
"""tools/run.sh with programs that only pretend: what is in the folder that the report is made of."""

import json
import pathlib
import shutil
import stat
import subprocess
import sys
import tempfile
import unittest

RUN = pathlib.Path(__file__).resolve().parents[2] / "tools" / "run.sh"

# The stages leave a report that names them, s3-report what it finds.
PRETENDER = """#!{python}
import json, pathlib, sys
name, words = pathlib.Path(sys.argv[0]).name, sys.argv[1:]
value = lambda key: words[words.index(key) + 1]
if name == "s3-report":
    folders = sorted(p.name for p in pathlib.Path(value("--run")).iterdir() if p.is_dir())
    pathlib.Path(value("--output")).write_text(" ".join(folders))
elif "broken" in words:
    sys.exit(3)
else:
    folder = pathlib.Path(value("--output")); folder.mkdir(parents=True, exist_ok=True)
    (folder / "report.json").write_text(json.dumps(dict(program=name, words=words), indent=2))
"""


class Run(unittest.TestCase):
    def setUp(self):
        folder = tempfile.TemporaryDirectory()
        self.addCleanup(folder.cleanup)
        self.folder = pathlib.Path(folder.name)
        self.output = self.folder / "output"
        for name in ("s3-slam", "s3-lift", "s3-refine", "s3-eval", "s3-report"):
            self.write(f"build/bin/{name}", PRETENDER.format(python=sys.executable))
        self.write("tools/build.sh", "#!/bin/sh\n")
        self.write("tools/summary.py", "")
        shutil.copy(RUN, self.folder / "tools" / "run.sh")
        (self.folder / "truth.txt").write_text("")
        (self.folder / "model").mkdir()

    def write(self, name, text):
        path = self.folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text)
        path.chmod(path.stat().st_mode | stat.S_IXUSR)

    def run_on(self, *what, code=0):
        run = subprocess.run(
            [self.folder / "tools" / "run.sh", *map(str, what), "--masks", "masks", "--classes",
             "classes.json", "--output", self.output], cwd=self.folder, capture_output=True, text=True)
        self.assertEqual(run.returncode, code, run.stderr)
        return run.stderr

    def run_with_truth(self):
        self.run_on("--sequence", "sequence", "--ground-truth", "truth.txt")
        self.assert_shown("1_slam 2_lift 3_refine 3_refine_plain")

    def assert_shown(self, folders):
        self.assertEqual((self.output / "report.html").read_text(), folders)

    def test_overwriting_leaves_no_arms_of_an_earlier_run(self):
        self.run_with_truth()
        self.run_on("--sequence", "sequence", "--overwrite")
        self.assert_shown("1_slam 2_lift 3_refine")
        self.run_on("--model", "model", "--overwrite")
        self.assert_shown("2_lift 3_refine")

    def test_what_cannot_be_used_is_left_out_of_images_and_masks(self):
        self.run_on("--sequence", "sequence", "--lenient", "--ignore-masks", "time.png")
        words = {name: json.loads((self.output / name / "report.json").read_text())["words"]
                 for name in ("1_slam", "2_lift", "3_refine")}
        self.assertEqual([name for name in words if "--lenient" in words[name]], ["1_slam", "2_lift"])
        self.assertEqual([name for name in words if "time.png" in words[name]], ["1_slam"])

    def test_other_files_stay(self):
        self.run_with_truth()
        (self.output / "notes").mkdir()
        self.run_on("--model", "model", "--overwrite")
        self.assert_shown("2_lift 3_refine notes")

    def test_what_is_no_result_of_a_stage_is_refused_and_stays(self):
        for content in (None, {}, {"program": "s3-lift"}):
            folder = self.output / "3_refine_plain"
            folder.mkdir(parents=True)
            if content is not None:
                (folder / "report.json").write_text(json.dumps(content))
            errors = self.run_on("--sequence", "sequence", "--overwrite", code=3)
            self.assertIn("3_refine_plain is not of this run", errors)
            self.assertTrue(folder.is_dir())
            shutil.rmtree(self.output)

    def test_a_link_is_refused_and_stays(self):
        self.run_with_truth()
        (self.output / "3_refine_plain").rename(self.folder / "mine")
        (self.output / "3_refine_plain").symlink_to(self.folder / "mine")
        self.run_on("--sequence", "sequence", "--overwrite", code=3)
        self.assertTrue((self.folder / "mine" / "report.json").is_file())

    def test_without_overwriting_nothing_is_removed(self):
        self.run_with_truth()
        for name in ("2_lift", "3_refine"):
            shutil.rmtree(self.output / name)
        errors = self.run_on("--model", "model", code=3)
        self.assertIn("1_slam is not of this run", errors)
        self.assertTrue((self.output / "1_slam").is_dir())

    def test_the_map_that_is_lifted_anew_stays(self):
        self.run_with_truth()
        self.run_on("--model", self.output / "1_slam", "--overwrite")
        self.assert_shown("1_slam 2_lift 3_refine")

    def test_an_input_is_never_removed(self):
        self.run_with_truth()
        for model in ("1_slam/1", "3_refine_plain"):
            (self.output / model).mkdir(exist_ok=True)
            self.run_on("--model", f"output/{model}", "--overwrite", code=3)
            self.assertTrue((self.output / model).is_dir())

    def test_a_stage_that_fails_leaves_the_earlier_run(self):
        self.run_with_truth()
        self.run_on("--sequence", "broken", "--overwrite", code=3)
        self.assertTrue((self.output / "3_refine_plain").is_dir())


if __name__ == "__main__":
    unittest.main()
