#!/usr/bin/env python3
"""Prints the small table of one run of the stages, from the reports they wrote.

Needs nothing but Python's standard library. Every figure comes from a report.json or from s3-eval.
"""

import argparse
import json
import pathlib
import statistics
import subprocess


def read_report(folder):
    return json.loads((folder / "report.json").read_text())


def trajectory_error(program, estimate, ground_truth):
    """RMSE of the positions after Sim(3) alignment, in the ground truth's unit."""
    run = subprocess.run([program, "--estimate", estimate, "--ground-truth", ground_truth, "--json",
                          "--quiet"], check=True, stdout=subprocess.PIPE)
    return json.loads(run.stdout)["trajectory"]["ate"]["translation"]["rmse"]


def pair_angles(report, relation):
    """Median deviation [deg] of the plane pairs said to be parallel (orthogonal), one per arm."""
    deviations = [pair["deviation_deg"] for pair in report["plane_pairs"]
                  if pair["relation"] == relation]
    return [statistics.median(column) for column in zip(*deviations)]


def rows(arguments):
    """(label, values) per line; several values are the arms: input, plain BA, planar BA."""
    lift, refine = read_report(arguments.lift), read_report(arguments.refine)
    if arguments.slam:
        slam = read_report(arguments.slam)
        yield "frames localised", [f"{slam['frames_localized']} of {slam['frames']}"]
        yield "keyframes", [str(slam["keyframes"])]
    else:
        yield "images", [str(refine["images"])]
    yield "points", [str(lift["points"])]
    yield "clusters", [str(sum(c["clusters"] for c in lift["classes"]))]
    yield "planes", [str(sum(c["planes"] for c in lift["classes"]))]
    yield "", ["before", "BA, no planes", "planar BA"]
    if arguments.ground_truth:
        folders = [arguments.slam, arguments.plain, arguments.refine]
        errors = [trajectory_error(arguments.eval, folder / "frames.txt", arguments.ground_truth)
                  for folder in folders]
        yield "ATE, Sim(3)", [f"{error:.5g}" for error in errors]
    arms = refine["arms"]
    yield "reprojection RMS [px]", [f"{arm['reprojection_rms_px']:.3f}" for arm in arms]
    if all("plane_rms" in arm for arm in arms):
        yield "off the planes, RMS", [f"{arm['plane_rms']:.5f}" for arm in arms]
    for relation in ("parallel", "orthogonal"):
        if angles := pair_angles(refine, relation):
            yield f"{relation} planes off [deg]", [f"{angle:.2f}" for angle in angles]


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--slam", type=pathlib.Path, help="output of s3-slam")
    parser.add_argument("--lift", type=pathlib.Path, required=True, help="output of s3-lift")
    parser.add_argument("--refine", type=pathlib.Path, required=True, help="output of s3-refine")
    parser.add_argument("--plain", type=pathlib.Path, help="output of s3-refine without planes")
    parser.add_argument("--ground-truth", type=pathlib.Path, help="true trajectory")
    parser.add_argument("--eval", type=pathlib.Path, help="the program s3-eval")
    arguments = parser.parse_args()
    if arguments.ground_truth and not (arguments.slam and arguments.plain and arguments.eval):
        parser.error("--ground-truth needs --slam, --plain and --eval")
    for label, values in rows(arguments):
        print(f"{label:<28}" + "".join(f"{value:>16}" for value in values))


if __name__ == "__main__":
    main()
