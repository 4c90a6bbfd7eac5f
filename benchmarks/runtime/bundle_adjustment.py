#!/usr/bin/env python3
"""Plain bundle adjustment: s3-refine against `colmap bundle_adjuster`.

Both start from the same perturbed model, minimise the same squared reprojection errors with the
intrinsics fixed, and are timed in alternating pairs. COLMAP runs twice: as it comes (100 iterations)
and with the function tolerance at which s3-refine stops. Prints a Markdown table of median wall
times and of the reprojection errors reached; needs Python's standard library only.

  cmake -S . -B build -DS3LAM_BENCHMARKS=ON && cmake --build build
  benchmarks/runtime/bundle_adjustment.py --bin build/bin --models DIR...
"""

import argparse
import json
import pathlib
import statistics
import subprocess
import tempfile
import time

FUNCTION_TOLERANCE = 1e-6
COLMAP = ["colmap", "bundle_adjuster", "--BundleAdjustment.refine_focal_length", "0",
          "--BundleAdjustment.refine_extra_params", "0"]
# Squared errors of all observations, solved once: what COLMAP's program minimises.
OURS = ["--set", "planes.mode=off", "--set", "solver.huber_reprojection=1000000",
        "--set", "outliers.max_reprojection_sigma=1000000000", "--set", "outer.max_iterations=1",
        "--set", f"solver.function_tolerance={FUNCTION_TOLERANCE}"]


def timed(command):
    start = time.monotonic()
    subprocess.run(command, check=True, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    return time.monotonic() - start


def measure_model(programs, model, work, repeat):
    perturbed = work / "start"
    subprocess.run([programs / "s3-perturb", "--model", model, "--output", perturbed,
                    "--overwrite"], check=True, stdout=subprocess.DEVNULL)

    def rms(folder):
        text = subprocess.run([programs / "s3-perturb", "--model", folder], check=True,
                              stdout=subprocess.PIPE, text=True).stdout
        return json.loads(text)

    (work / "colmap").mkdir(exist_ok=True)
    paths = ["--input_path", perturbed, "--output_path", work / "colmap"]
    arms = {
        "s3-refine": ([programs / "s3-refine", "--model", perturbed, "--output", work / "ours",
                       "--overwrite", "--quiet", *OURS], work / "ours"),
        "colmap": (COLMAP + paths, work / "colmap"),
        "colmap, same tolerance": (
            COLMAP + paths + ["--BundleAdjustment.function_tolerance", str(FUNCTION_TOLERANCE)],
            work / "colmap"),
    }
    seconds = {name: [] for name in arms}
    reached = {}
    for _ in range(repeat):
        for name, (command, folder) in arms.items():
            seconds[name].append(timed(command))
            reached[name] = rms(folder)["rms_px"]
    return rms(perturbed), {name: statistics.median(times) for name, times in seconds.items()}, reached


def main():
    parser = argparse.ArgumentParser(description=__doc__,
                                     formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--bin", type=pathlib.Path, required=True, help="folder of the programs")
    parser.add_argument("--models", type=pathlib.Path, nargs="+", required=True)
    parser.add_argument("--repeat", type=int, default=5)
    arguments = parser.parse_args()
    print("| model | images | observations | program | wall [s] | times s3-refine | RMS [px] |")
    print("|---|---|---|---|---|---|---|")
    for model in arguments.models:
        with tempfile.TemporaryDirectory() as work:
            start, seconds, reached = measure_model(arguments.bin, model, pathlib.Path(work),
                                                    arguments.repeat)
        for name, wall in seconds.items():
            print(f"| {model} | {start['images']} | {start['observations']} | {name} | {wall:.2f} "
                  f"| {wall / seconds['s3-refine']:.2f} | {reached[name]:.6f} |", flush=True)


if __name__ == "__main__":
    main()
