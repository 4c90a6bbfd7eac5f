#!/usr/bin/env python3
"""Time and memory of the bundle adjustment by the size of the map, without and with planes.

Synthetic drives (s3-drive), each arm in a process of its own, arms alternating; medians. Prints a
Markdown table, and CSV with --csv FILE. Needs Python's standard library only.

  cmake -S . -B build -DS3LAM_BENCHMARKS=ON && cmake --build build
  benchmarks/runtime/bundle_scaling.py --bin build/bin --csv scaling.csv

The limits between the linear solvers in src/refine/schur_bundle.cc were found with
--solvers dense sparse iterative, which runs the plain arm with each of them.
"""

import argparse
import csv
import json
import pathlib
import statistics
import subprocess

COLUMNS = ["keyframes", "points", "observations", "arm", "backend", "linear_solver", "iterations",
           "seconds", "cpu_seconds", "cpu_seconds_per_iteration", "start_memory_mib",
           "peak_memory_mib", "initial_cost", "final_cost", "converged"]


def measure(program, keyframes, arm, backend, solver, arguments):
    command = [program, "--keyframes", str(keyframes), "--arm", arm, "--json", "--quiet",
               "--threads", str(arguments.threads), "--set", f"linear_solver={solver}",
               "--set", f"backend={backend}"]
    if arguments.iterations:
        command += ["--set", f"max_iterations={arguments.iterations}",
                    "--set", "function_tolerance=0"]
    run = subprocess.run(command, check=True, stdout=subprocess.PIPE, text=True)
    return json.loads(run.stdout) | {"backend": backend}


def main():
    parser = argparse.ArgumentParser(description=__doc__,
                                     formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--bin", type=pathlib.Path, required=True, help="folder of the programs")
    parser.add_argument("--keyframes", type=int, nargs="+",
                        default=[100, 200, 500, 1000, 2000, 5000, 10000])
    parser.add_argument("--arms", nargs="+", default=["plain", "planes"])
    parser.add_argument("--solvers", nargs="+", default=["auto"])
    parser.add_argument("--backends", nargs="+", default=["schur"])
    parser.add_argument("--iterations", type=int, default=0,
                        help="make so many instead of stopping by the tolerance")
    parser.add_argument("--threads", type=int, default=0)
    parser.add_argument("--repeat", type=int, default=1)
    parser.add_argument("--csv", type=pathlib.Path)
    arguments = parser.parse_args()
    rows = []
    print("| keyframes | points | observations | arm | solver | iterations | wall [s] | CPU [s] "
          "| CPU per iteration [s] | memory [MiB] |")
    print("|---|---|---|---|---|---|---|---|---|---|", flush=True)
    for keyframes in arguments.keyframes:
        arms = [(arm, backend, solver) for solver in arguments.solvers
                for backend in arguments.backends for arm in arguments.arms]
        results = {arm: [] for arm in arms}
        for _ in range(arguments.repeat):
            for arm in arms:
                results[arm].append(measure(arguments.bin / "s3-drive", keyframes, *arm, arguments))
        for runs in results.values():
            row = runs[0]
            for name in ("seconds", "cpu_seconds"):
                row[name] = statistics.median(run[name] for run in runs)
            row["cpu_seconds_per_iteration"] = row["cpu_seconds"] / max(1, row["iterations"])
            rows.append(row)
            print(f"| {row['keyframes']} | {row['points']} | {row['observations']} | {row['arm']} "
                  f"| {row['linear_solver']} | {row['iterations']} | {row['seconds']:.2f} "
                  f"| {row['cpu_seconds']:.2f} | {row['cpu_seconds_per_iteration']:.4f} "
                  f"| {row['peak_memory_mib']:.0f} |", flush=True)
    if arguments.csv:
        with arguments.csv.open("w", newline="") as file:
            writer = csv.DictWriter(file, COLUMNS, extrasaction="ignore")
            writer.writeheader()
            writer.writerows(rows)


if __name__ == "__main__":
    main()
