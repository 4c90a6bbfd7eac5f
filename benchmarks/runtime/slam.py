#!/usr/bin/env python3
"""Stage 1 against a loop of OpenCV's ORB, and what each of its steps costs.

Runs, in alternation, `s3-orb-loop` (cv::ORB, 1000 features, 8 levels, one thread, images in memory:
its time is the unit T) and s3-slam with accuracy=fast and accuracy=high, over growing parts of a
sequence. Only ratios within a round are compared, and their median is printed: other work on the
machine slows both. Needs Python's standard library only.

  cmake -S . -B build -DS3LAM_BENCHMARKS=ON && cmake --build build
  benchmarks/runtime/slam.py --bin build/bin --sequence DIR
"""

import argparse
import json
import pathlib
import statistics
import subprocess
import tempfile
import time

ARMS = ["fast", "high"]
SHARES = [0.25, 0.5, 1.0]


def run_json(command):
    start = time.monotonic()
    text = subprocess.run(command, check=True, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL,
                          text=True).stdout
    return json.loads(text), time.monotonic() - start


def count_frames(arguments):
    loop, _ = run_json([arguments.bin / "s3-orb-loop", "--sequence", arguments.sequence])
    return loop["images"]


def one_round(arguments, frames, work):
    """Seconds of the ORB loop, and of each arm its wall time and report."""
    part = ["--sequence", arguments.sequence, "--frames", f"0:{frames}"]
    unit = run_json([arguments.bin / "s3-orb-loop", *part])[0]["seconds"]
    result = {}
    for arm in ARMS:
        report, wall = run_json([arguments.bin / "s3-slam", *part, "--output", work / arm,
                                 "--overwrite", "--quiet", "--progress", "none", "--json",
                                 "--threads", str(arguments.threads), "--set", f"accuracy={arm}"])
        result[arm] = {"ratio": wall / unit, "wall": wall, "report": report}
    return unit, result


def median_of(rounds, arm, value):
    return statistics.median(value(result[arm]) for _, result in rounds)


def print_totals(rounds_of_length):
    print("| frames | arm | T [s] | wall [s] | times T | ms per frame | peak [MiB] |")
    print("|---|---|---|---|---|---|---|")
    for frames, rounds in rounds_of_length.items():
        unit = statistics.median(u for u, _ in rounds)
        for arm in ARMS:
            wall = median_of(rounds, arm, lambda r: r["wall"])
            ratio = median_of(rounds, arm, lambda r: r["ratio"])
            peak = median_of(rounds, arm, lambda r: r["report"]["peak_memory_mib"])
            print(f"| {frames} | {arm} | {unit:.2f} | {wall:.2f} | {ratio:.2f} "
                  f"| {1e3 * wall / frames:.1f} | {peak:.0f} |")


def print_steps(rounds_of_length):
    """Milliseconds per frame of each step, the lengths side by side."""
    lengths = list(rounds_of_length)
    for arm in ARMS:
        print(f"\nSteps of {arm} [ms per frame]:\n")
        print("| step | " + " | ".join(f"{n} frames" for n in lengths) + " |")
        print("|---" * (len(lengths) + 1) + "|")
        for step in rounds_of_length[lengths[-1]][0][1][arm]["report"]["seconds"]:
            cells = [1e3 / n * median_of(rounds_of_length[n], arm,
                                         lambda r: r["report"]["seconds"].get(step, 0.0))
                     for n in lengths]
            print(f"| {step} | " + " | ".join(f"{c:.2f}" for c in cells) + " |")


def main():
    parser = argparse.ArgumentParser(description=__doc__,
                                     formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--bin", type=pathlib.Path, required=True, help="folder of the programs")
    parser.add_argument("--sequence", type=pathlib.Path, required=True)
    parser.add_argument("--repeat", type=int, default=3)
    parser.add_argument("--threads", type=int, default=2)
    arguments = parser.parse_args()
    total = count_frames(arguments)
    lengths = [round(share * total) for share in SHARES]
    rounds = {n: [] for n in lengths}
    with tempfile.TemporaryDirectory() as work:
        for _ in range(arguments.repeat):
            for n in lengths:
                rounds[n].append(one_round(arguments, n, pathlib.Path(work)))
    print_totals(rounds)
    print_steps(rounds)


if __name__ == "__main__":
    main()
