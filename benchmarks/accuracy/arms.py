#!/usr/bin/env python3
"""Every arm of s3-refine side by side, on what run.py wrote: without planes, the paper's, the defaults.

Prints Markdown tables of the trajectory error (RMSE after Sim(3) alignment) per sequence and kind of
masks and, of scenes, of the means over their seeds and of what the defaults change of the error without
planes: in the mean, and in the worst of the seeds. Needs only Python's standard library.

  run.py --bin ../../build/bin --synthetic --seeds 1 2 3 4 5 --output RUNS
  arms.py --bin ../../build/bin --synthetic --seeds 1 2 3 4 5 --runs RUNS
  run.py --bin ../../build/bin --data DIR --output RUNS
  arms.py --bin ../../build/bin --data DIR --runs RUNS
"""

import argparse
import os
import pathlib
import statistics
import sys
import tempfile

import campaign_jobs
import sequences
import stages
import tables

ARMS = campaign_jobs.ARMS
PLAIN, DEFAULTS = "off", "full"


def error_of(programs, sequence, frames):
    report = programs.trajectory_error(frames, sequence.references[0])
    return report["ate"]["translation"]["rmse"]


def errors_of(programs, sequence, run, masks, arms, work):
    """By arm; none for arms that the sequence has no use for. Without masks: None."""
    errors = {}
    for arm in arms:
        if ARMS[arm] is None:
            errors[arm] = error_of(programs, sequence, run / "1_slam" / "frames.txt")
            continue
        if arm in campaign_jobs.ROADS_ONLY and not sequence.road:
            continue
        if masks is None and arm not in campaign_jobs.WITHOUT_MASKS:
            continue
        programs.refine(run / "1_slam", masks and run / f"2_lift_{masks}", work, ARMS[arm])
        errors[arm] = error_of(programs, sequence, work / "frames.txt")
    return errors


def percent(change):
    return f"{100 * change:+.1f} %"


def cells(errors, arms):
    return [tables.metres(errors[arm]) if arm in errors else "-" for arm in arms]


def row(name, masks, errors, arms):
    change = percent(errors[DEFAULTS] / errors[PLAIN] - 1) if DEFAULTS in errors else "-"
    return [name, masks or "-", *cells(errors, arms), change]


def mean_rows(by_sequence, arms):
    """A line per scene and kind of masks, over its seeds; `by_sequence`: of (name, masks)."""
    groups = {}
    for (name, masks), errors in by_sequence.items():
        groups.setdefault((name.split()[0], masks), []).append(errors)
    for (scene, masks), seeds in groups.items():
        means = {arm: statistics.fmean(errors[arm] for errors in seeds)
                 for arm in arms if arm in seeds[0]}
        changes = [errors[DEFAULTS] / errors[PLAIN] - 1 for errors in seeds]
        yield [*row(scene, masks, means, arms), percent(max(changes))]


def main():
    parser = argparse.ArgumentParser(description=__doc__,
                                     formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--bin", type=pathlib.Path, required=True, help="folder of the programs")
    parser.add_argument("--runs", type=pathlib.Path, required=True, help="what run.py wrote")
    sequences.add_arguments(parser, seeds=[1, 2, 3, 4, 5])
    parser.add_argument("--arms", nargs="+", choices=ARMS, default=list(ARMS),
                        help=f"beside {PLAIN} and {DEFAULTS}")
    parser.add_argument("--threads", type=int, default=os.cpu_count())
    arguments = parser.parse_args()
    arms = [arm for arm in ARMS if arm in {*arguments.arms, PLAIN, DEFAULTS}]
    programs = stages.Programs(arguments.bin, arguments.threads, seed=0)
    by_sequence = {}
    try:
        with tempfile.TemporaryDirectory() as work:
            for sequence, run in sequences.of_runs(arguments):
                stages.say(f"{sequence.name} ...")
                for masks in sequence.masks or [None]:
                    by_sequence[sequence.name, masks] = errors_of(
                        programs, sequence, run, masks, arms, pathlib.Path(work) / "refined")
    except (OSError, stages.StageFailed) as error:
        sys.exit(str(error))
    change = f"{DEFAULTS} against {PLAIN}"
    print(tables.markdown(["sequence", "masks", *arms, change],
                          [row(*key, errors, arms) for key, errors in by_sequence.items()]))
    if arguments.synthetic:
        print("Means over the seeds:\n")
        print(tables.markdown(["scene", "masks", *arms, change, "worst of the seeds"],
                              list(mean_rows(by_sequence, arms))))


if __name__ == "__main__":
    main()
