#!/usr/bin/env python3
"""What wrong labels do to the poses: planar points given to wrong clusters before s3-refine.

Takes the folders that run.py wrote. Of the points in clusters of planar classes a share is moved to
another such cluster each, at random: a point keeps its place and says it is of another object. Prints,
per sequence and kind of masks, a Markdown table of the trajectory error (RMSE after Sim(3) alignment)
without planes and with them by that share: the median over the draws, and the worst against the
adjustment without planes. Needs only Python's standard library.

  run.py --bin ../../build/bin --data DIR --output RUNS
  wrong_labels.py --bin ../../build/bin --data DIR --runs RUNS [--shares 0 0.1 0.3 0.5]
  run.py --bin ../../build/bin --synthetic --seeds 1 --output RUNS
  wrong_labels.py --bin ../../build/bin --synthetic --seeds 1 --runs RUNS
"""

import argparse
import json
import os
import pathlib
import random
import shutil
import statistics
import sys
import tempfile

import sequences
import stages
import tables


def mislabel(semantics, share, seed):
    """Moves points between the planar clusters of a semantic map; returns how many."""
    classes = {c["id"]: c for c in semantics["class_table"]["classes"]}
    planar = [c for c in semantics["clusters"] if classes[c["class_id"]]["planar"]]
    if len(planar) < 2:
        return 0
    draw = random.Random(seed)
    moves = {}
    for cluster in planar:
        others = [c["id"] for c in planar if c is not cluster]
        for point in draw.sample(cluster["points"], round(share * len(cluster["points"]))):
            moves[point] = draw.choice(others)
    points_of = {c["id"]: [p for p in c["points"] if p not in moves] for c in planar}
    for point, cluster in moves.items():
        points_of[cluster].append(point)
    for cluster in planar:
        cluster["points"] = sorted(points_of[cluster["id"]])
    for i, point in enumerate(semantics["points"]):
        if point in moves:
            semantics["cluster_of_point"][i] = moves[point]
    return len(moves)


def error_with(programs, run, reference, masks, share, seed, work):
    wrong = work / "semantics"
    shutil.rmtree(wrong, ignore_errors=True)
    shutil.copytree(run / f"2_lift_{masks}", wrong)
    semantics = json.loads((wrong / "semantics.json").read_text())
    moved = mislabel(semantics, share, seed)
    stages.write_json(wrong / "semantics.json", semantics)
    programs.refine(run / "1_slam", wrong, work / "refined")
    error = programs.trajectory_error(work / "refined" / "frames.txt", reference)
    return moved, error["ate"]["translation"]["rmse"]


def rows_of(programs, run, sequence, masks, arguments, work):
    reference = sequence.references[0]
    plain = programs.trajectory_error(run / "3_refine_plain" / "frames.txt", reference)
    plain = plain["ate"]["translation"]["rmse"]
    for share in arguments.shares:
        draws = range(arguments.draws if share > 0.0 else 1)
        found = [error_with(programs, run, reference, masks, share, d, work) for d in draws]
        errors = [error for _, error in found]
        yield [sequence.name, masks, f"{100 * share:.0f}", str(found[0][0]), tables.metres(plain),
               tables.metres(statistics.median(errors)), f"{100 * (max(errors) / plain - 1):+.1f} %"]


def main():
    parser = argparse.ArgumentParser(description=__doc__,
                                     formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--bin", type=pathlib.Path, required=True, help="folder of the programs")
    parser.add_argument("--runs", type=pathlib.Path, required=True, help="what run.py wrote")
    sequences.add_arguments(parser, seeds=[1])
    parser.add_argument("--shares", type=float, nargs="+", default=[0.0, 0.1, 0.3, 0.5])
    parser.add_argument("--draws", type=int, default=3)
    parser.add_argument("--threads", type=int, default=os.cpu_count())
    arguments = parser.parse_args()
    programs = stages.Programs(arguments.bin, arguments.threads, seed=0)
    rows = []
    try:
        with tempfile.TemporaryDirectory() as work:
            for sequence, run in sequences.of_runs(arguments):
                stages.say(f"{sequence.name} ...")
                for masks in sequence.masks:
                    rows += rows_of(programs, run, sequence, masks, arguments, pathlib.Path(work))
    except (OSError, stages.StageFailed) as error:
        sys.exit(str(error))
    print(tables.markdown(["sequence", "masks", "labels wrong [%]", "points moved", "plain BA",
                           "planes", "worst of the draws"], rows))


if __name__ == "__main__":
    main()
