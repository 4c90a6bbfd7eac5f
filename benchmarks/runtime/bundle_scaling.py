#!/usr/bin/env python3
"""Time and memory of the bundle adjustment by the size of the map, without and with planes.

Synthetic drives (s3-drive), each arm in a process of its own, arms alternating; medians. Prints a
Markdown table; CSV with --csv FILE, curves with --plot FILE.svg, over the keyframes or, with one
number of keyframes, over the points. "times plain" is the median of the rounds' ratios of the CPU time
per iteration. Needs Python's standard library only.

With --instructions, valgrind counts the instructions of an iteration on one thread instead, which other
work on the machine does not change: for small drives, since that takes fifty times as long.

  cmake -S . -B build -DS3LAM_BENCHMARKS=ON && cmake --build build
  benchmarks/runtime/bundle_scaling.py --bin build/bin --repeat 3 --plot keyframes.svg
  benchmarks/runtime/bundle_scaling.py --bin build/bin --repeat 3 --plot points.svg \\
    --keyframes 300 --points-per-keyframe 50 100 200 500 1000 2000
  benchmarks/runtime/bundle_scaling.py --bin build/bin --instructions --keyframes 60 200

The limits between the linear solvers in src/refine/schur_bundle.cc were found with
--solvers dense sparse iterative, which runs the plain arm with each of them.
"""

import argparse
import csv
import itertools
import json
import pathlib
import re
import statistics
import subprocess

import svg_plot

COLUMNS = ["keyframes", "points", "observations", "arm", "backend", "linear_solver", "iterations",
           "seconds", "cpu_seconds", "cpu_seconds_per_iteration", "times_plain", "start_memory_mib",
           "peak_memory_mib", "initial_cost", "final_cost", "converged"]


def drive(program, size, arm, threads, iterations):
    """The command; with `iterations` it makes so many instead of stopping by the tolerance."""
    keyframes, points_per_keyframe = size
    command = [program, "--keyframes", str(keyframes), "--points-per-keyframe",
               str(points_per_keyframe), "--arm", arm, "--json", "--quiet", "--threads", str(threads)]
    if iterations:
        command += ["--set", f"max_iterations={iterations}", "--set", "function_tolerance=0"]
    return command


def measure(program, size, arm, backend, solver, arguments):
    command = drive(program, size, arm, arguments.threads, arguments.iterations)
    command += ["--set", f"linear_solver={solver}", "--set", f"backend={backend}"]
    run = subprocess.run(command, check=True, stdout=subprocess.PIPE, text=True)
    row = json.loads(run.stdout) | {"backend": backend}
    row["cpu_seconds_per_iteration"] = row["cpu_seconds"] / max(1, row["iterations"])
    return row


def measure_size(size, arguments):
    """A row per arm: medians over the rounds."""
    arms = [(arm, backend, solver) for solver in arguments.solvers
            for backend in arguments.backends for arm in arguments.arms]
    once = arguments.once_from is not None and size[0] >= arguments.once_from
    rounds = [[measure(arguments.bin / "s3-drive", size, *arm, arguments) for arm in arms]
              for _ in range(1 if once else arguments.repeat)]
    rows = []
    for runs in zip(*rounds):
        row = dict(runs[0])
        for name in ("seconds", "cpu_seconds", "cpu_seconds_per_iteration", "peak_memory_mib"):
            row[name] = statistics.median(run[name] for run in runs)
        row["times_plain"] = statistics.median(
            run["cpu_seconds_per_iteration"] / first[0]["cpu_seconds_per_iteration"]
            for run, first in zip(runs, rounds))
        rows.append(row)
    return rows


def instructions(program, size, arm):
    """Millions of instructions in one iteration: the difference between few and many."""
    counts = []
    for iterations in (2, 12):
        command = ["valgrind", "--tool=callgrind", "--callgrind-out-file=/dev/null",
                   *drive(program, size, arm, 1, iterations)]
        text = subprocess.run(command, check=True, stdout=subprocess.DEVNULL,
                              stderr=subprocess.PIPE, text=True).stderr
        counts.append(int(re.search(r"Collected : (\d+)", text).group(1)))
    return (counts[1] - counts[0]) / 10e6


def print_instructions(arguments, sizes):
    print("| keyframes | points per keyframe | arm | instructions per iteration [10^6] "
          "| times plain |\n|---|---|---|---|---|", flush=True)
    for size in sizes:
        plain = None
        for arm in arguments.arms:
            count = instructions(arguments.bin / "s3-drive", size, arm)
            plain = plain or count
            print(f"| {size[0]} | {size[1]} | {arm} | {count:.1f} | {count / plain:.2f} |", flush=True)


def plot(path, rows, over):
    """Time and memory over the column `over`."""
    def curves(column):
        found = {}
        for row in rows:
            found.setdefault(row["arm"], []).append((row[over], row[column]))
        return found

    svg_plot.write(path, over, {
        "bundle adjustment to convergence: CPU time [s]": curves("cpu_seconds"),
        "peak memory [MiB]": curves("peak_memory_mib")})


def main():
    parser = argparse.ArgumentParser(description=__doc__,
                                     formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--bin", type=pathlib.Path, required=True, help="folder of the programs")
    parser.add_argument("--keyframes", type=int, nargs="+",
                        default=[100, 200, 500, 1000, 2000, 5000, 10000])
    parser.add_argument("--points-per-keyframe", type=int, nargs="+", default=[200])
    parser.add_argument("--arms", nargs="+", default=["plain", "planes"])
    parser.add_argument("--solvers", nargs="+", default=["auto"])
    parser.add_argument("--backends", nargs="+", default=["schur"])
    parser.add_argument("--iterations", type=int, default=0,
                        help="make so many instead of stopping by the tolerance")
    parser.add_argument("--threads", type=int, default=0)
    parser.add_argument("--repeat", type=int, default=1)
    parser.add_argument("--once-from", type=int, metavar="KEYFRAMES",
                        help="measure drives of so many and more once only")
    parser.add_argument("--csv", type=pathlib.Path)
    parser.add_argument("--plot", type=pathlib.Path, metavar="SVG")
    parser.add_argument("--instructions", action="store_true")
    arguments = parser.parse_args()
    sizes = list(itertools.product(arguments.keyframes, arguments.points_per_keyframe))
    if arguments.instructions:
        print_instructions(arguments, sizes)
        return
    rows = []
    print("| keyframes | points | observations | arm | solver | iterations | wall [s] | CPU [s] "
          "| CPU per iteration [s] | times plain | memory [MiB] |")
    print("|---|---|---|---|---|---|---|---|---|---|---|", flush=True)
    for size in sizes:
        for row in measure_size(size, arguments):
            rows.append(row)
            print(f"| {row['keyframes']} | {row['points']} | {row['observations']} | {row['arm']} "
                  f"| {row['linear_solver']} | {row['iterations']} | {row['seconds']:.2f} "
                  f"| {row['cpu_seconds']:.2f} | {row['cpu_seconds_per_iteration']:.4f} "
                  f"| {row['times_plain']:.2f} | {row['peak_memory_mib']:.0f} |", flush=True)
    if arguments.plot:
        plot(arguments.plot, rows, "keyframes" if len(arguments.keyframes) > 1 else "points")
    if arguments.csv:
        with arguments.csv.open("w", newline="") as file:
            writer = csv.DictWriter(file, COLUMNS, extrasaction="ignore")
            writer.writeheader()
            writer.writerows(rows)


if __name__ == "__main__":
    main()
