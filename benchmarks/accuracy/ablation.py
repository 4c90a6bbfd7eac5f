#!/usr/bin/env python3
"""What each step of s3-slam gains: the same sequences with one step switched off at a time.

Prints, per sequence, a Markdown table of the frames localised, the trajectory error (RMSE after
Sim(3) alignment), its change against the defaults and the CPU time. A step whose line is no worse
than the first one gained nothing on that sequence. Needs only Python's standard library.

  ablation.py --bin ../../build/bin --data DIR [--sequences redkitchen mh05]
  ablation.py --bin ../../build/bin --synthetic --scenes desk street --seeds 1 2
"""

import argparse
import os
import pathlib
import statistics
import sys
import tempfile

import sequences
import stages
import tables

# What is switched off, and how.
ARMS = {
    "nothing (the defaults)": [],
    "parallax and points in the choice of the initial pair": ["initializer.good_points=10",
                                                              "initializer.good_parallax_deg=0.1"],
    "loop closing": ["loops.enabled=false"],
    "matching again (guided matching, new tracks, merging)": ["second_pass.rounds=0"],
    "sub-pixel refinement and longer tracks by patches": ["second_pass.patches.enabled=false"],
    "longer tracks by patches": ["second_pass.extend_tracks=false"],
    "aligning once more when tracks are extended": ["second_pass.align_again=false"],
    "adjusting with the noise that aligned keypoints have": ["second_pass.noise.measured=false"],
    "sub-pixel refinement of frames that are no keyframes": ["second_pass.align_frames=false"],
    "repeated adjustment and outlier removal": ["global_rounds=1"],
    "other starts where two views refute the map": ["remapping.max_attempts=0"],
    "check against keyframes matched without the map": ["two_view_check.enabled=false"],
    "refinement of the distortion": ["self_calibration.enabled=false"],
    "the whole second pass": ["second_pass.rounds=0", "second_pass.patches.enabled=false",
                              "self_calibration.enabled=false"],
}


def measure(programs, sequence, settings, output):
    report, cost = programs.slam(sequence.folder, output, settings)
    error = programs.trajectory_error(output / "frames.txt", sequence.references[0])
    return {"frames": f"{report['frames_localized']}/{report['frames']}",
            "ate": error["ate"]["translation"]["rmse"], "cpu_s": cost.cpu_s}


def rows_of(results):
    """The lines of one table; results[arm] has a measurement per seed."""
    median = {arm: statistics.median(m["ate"] for m in runs) for arm, runs in results.items()}
    default = median[next(iter(ARMS))]
    for arm, runs in results.items():
        frames = ", ".join(dict.fromkeys(m["frames"] for m in runs))
        cpu_s = statistics.median(m["cpu_s"] for m in runs)
        yield [arm, frames, tables.metres(median[arm]),
               f"{100.0 * (median[arm] / default - 1.0):+.0f} %", tables.number(cpu_s, 1)]


def print_table(name, reference, results):
    print(f"\n{name}, against {reference}:\n")
    print(tables.markdown(["switched off", "frames", "ATE", "change", "CPU [s]"], rows_of(results)),
          flush=True)


def run(programs, name, chosen, work):
    """One table: the medians over these sequences, the same scene with several seeds."""
    results = {}
    for arm, settings in ARMS.items():
        stages.say(f"{name}, switched off: {arm} ...")
        results[arm] = [measure(programs, sequence, settings, work / "slam") for sequence in chosen]
    print_table(name, chosen[0].references[0].name, results)


def scenes(arguments, programs, work):
    for scene in arguments.scenes:
        chosen = []
        for seed in arguments.seeds:
            folder = work / f"{scene}_{seed}"
            programs.with_seed(seed).synthesise(scene, folder)
            chosen.append(sequences.synthetic_sequence(f"{scene} {seed}", folder))
        run(programs, scene, chosen, work)


def main():
    parser = argparse.ArgumentParser(description=__doc__,
                                     formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--bin", type=pathlib.Path, required=True, help="folder of the programs")
    sequences.add_arguments(parser, seeds=[1])
    parser.add_argument("--threads", type=int, default=os.cpu_count())
    arguments = parser.parse_args()
    programs = stages.Programs(arguments.bin, arguments.threads, seed=0)
    try:
        with tempfile.TemporaryDirectory() as work:
            if arguments.synthetic:
                scenes(arguments, programs, pathlib.Path(work))
                return
            for name in arguments.sequences:
                sequence = sequences.real_sequence(name, arguments.data)
                run(programs, name, [sequence], pathlib.Path(work))
    except stages.StageFailed as error:
        sys.exit(str(error))


if __name__ == "__main__":
    main()
