#!/usr/bin/env python3
"""Plain bundle adjustment: s3-refine against `colmap bundle_adjuster`.

Both start from the same perturbed model, minimise the same squared reprojection errors with the
intrinsics fixed (--focal-lengths: the focal lengths refined), and are timed in alternating pairs,
whole programs with reading and writing. COLMAP runs twice: as it comes (100 iterations) and with the
function tolerance at which s3-refine stops. Models are folders (--models) and synthetic drives of so
many keyframes (--keyframes). Prints a Markdown table of medians and of the reprojection errors
reached, CSV with --csv FILE; needs Python's standard library only. On a machine that others use
compare the CPU times. Both programs obey OPENBLAS_NUM_THREADS.

  cmake -S . -B build -DS3LAM_BENCHMARKS=ON && cmake --build build
  benchmarks/runtime/bundle_adjustment.py --bin build/bin --models DIR... --keyframes 200 1000 5000
"""

import argparse
import csv
import json
import os
import pathlib
import resource
import statistics
import subprocess
import tempfile
import time

FUNCTION_TOLERANCE = 1e-6
COLMAP = ["colmap", "bundle_adjuster", "--BundleAdjustment.refine_extra_params", "0"]
# Squared errors of all observations, solved once: what COLMAP's program minimises.
OURS = ["--set", "planes.mode=off", "--set", "keypoint_sigma_px=1",
        "--set", "solver.huber_reprojection=1000000",
        "--set", "outliers.max_reprojection_sigma=1000000000", "--set", "outer.max_iterations=1",
        "--set", f"solver.function_tolerance={FUNCTION_TOLERANCE}"]


def timed(command):
    """Wall and CPU seconds of one run."""
    def cpu():
        usage = resource.getrusage(resource.RUSAGE_CHILDREN)
        return usage.ru_utime + usage.ru_stime

    cpu_start = cpu()
    start = time.monotonic()
    subprocess.run(command, check=True, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    return time.monotonic() - start, cpu() - cpu_start


def make_start(programs, model, folder):
    """Writes the perturbed model; `model` is a folder or a number of keyframes."""
    if isinstance(model, int):
        command = [programs / "s3-drive", "--keyframes", str(model)]
    else:
        command = [programs / "s3-perturb", "--model", model]
    subprocess.run([*command, "--output", folder, "--overwrite"], check=True,
                   stdout=subprocess.DEVNULL)


def measure_model(programs, model, work, arguments):
    perturbed = work / "start"
    make_start(programs, model, perturbed)

    def rms(folder):
        text = subprocess.run([programs / "s3-perturb", "--model", folder], check=True,
                              stdout=subprocess.PIPE, text=True).stdout
        return json.loads(text)

    (work / "colmap").mkdir(exist_ok=True)
    focal = arguments.focal_lengths
    paths = ["--input_path", perturbed, "--output_path", work / "colmap",
             "--BundleAdjustment.refine_focal_length", str(int(focal)),
             "--BundleAdjustment.max_num_iterations", str(arguments.colmap_iterations)]
    arms = {
        "s3-refine": ([programs / "s3-refine", "--model", perturbed, "--output", work / "ours",
                       "--overwrite", "--quiet", *OURS,
                       "--set", f"intrinsics.focal_length={str(focal).lower()}"], work / "ours"),
        "colmap": (COLMAP + paths, work / "colmap"),
        "colmap, same tolerance": (
            COLMAP + paths + ["--BundleAdjustment.function_tolerance", str(FUNCTION_TOLERANCE)],
            work / "colmap"),
    }
    if arguments.same_tolerance_only:
        del arms["colmap"]
    times = {name: [] for name in arms}
    reached = {}
    for _ in range(arguments.repeat):
        for name, (command, folder) in arms.items():
            times[name].append(timed(command))
            reached[name] = rms(folder)["rms_px"]
    start = rms(perturbed)
    name = f"drive {model}" if isinstance(model, int) else f"{model.parent.name}/{model.name}"
    return [{"model": name, "images": start["images"], "observations": start["observations"],
             "program": program, "wall_s": statistics.median(wall for wall, _ in runs),
             "cpu_s": statistics.median(cpu for _, cpu in runs), "rms_px": reached[program]}
            for program, runs in times.items()]


def main():
    parser = argparse.ArgumentParser(description=__doc__,
                                     formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--bin", type=pathlib.Path, required=True, help="folder of the programs")
    parser.add_argument("--models", type=pathlib.Path, nargs="*", default=[])
    parser.add_argument("--keyframes", type=int, nargs="*", default=[], help="synthetic drives")
    parser.add_argument("--focal-lengths", action="store_true", help="refine them")
    parser.add_argument("--repeat", type=int, default=5)
    parser.add_argument("--same-tolerance-only", action="store_true",
                        help="leave out COLMAP with its own tolerance")
    parser.add_argument("--colmap-iterations", type=int, default=100,
                        help="most iterations of COLMAP; its default is 100")
    parser.add_argument("--csv", type=pathlib.Path)
    arguments = parser.parse_args()
    print(f"OPENBLAS_NUM_THREADS: {os.environ.get('OPENBLAS_NUM_THREADS', 'not set')}\n")
    print("| model | images | observations | program | wall [s] | times s3-refine | CPU [s] "
          "| times s3-refine | RMS [px] |")
    print("|---|---|---|---|---|---|---|---|---|", flush=True)
    rows = []
    for model in [*arguments.models, *arguments.keyframes]:
        with tempfile.TemporaryDirectory() as work:
            measured = measure_model(arguments.bin, model, pathlib.Path(work), arguments)
        ours = measured[0]
        for row in measured:
            print(f"| {row['model']} | {row['images']} | {row['observations']} | {row['program']} "
                  f"| {row['wall_s']:.2f} | {row['wall_s'] / ours['wall_s']:.1f} "
                  f"| {row['cpu_s']:.2f} | {row['cpu_s'] / ours['cpu_s']:.1f} "
                  f"| {row['rms_px']:.7f} |", flush=True)
        rows += measured
    if arguments.csv:
        with arguments.csv.open("w", newline="") as file:
            writer = csv.DictWriter(file, list(rows[0]))
            writer.writeheader()
            writer.writerows(rows)


if __name__ == "__main__":
    main()
