#!/usr/bin/env python3
"""s3-report on large maps: time, memory and size of the page, and how a browser gets on with it.

Synthetic drives (s3-drive) with the same made-up mask for every image go through s3-lift, s3-refine
and s3-report; a headless Chromium, which draws in software, opens the page. Prints a Markdown table;
"turn", "switch" and "point" are the times from turning the view, switching a class off and moving the
pointer until the browser has drawn. Needs Python's standard library and chromium.

  cmake -S . -B build -DS3LAM_BENCHMARKS=ON && cmake --build build
  benchmarks/runtime/report.py --bin build/bin --points-per-keyframe 200 2000
"""

import argparse
import base64
import os
import pathlib
import statistics
import struct
import subprocess
import sys
import tempfile
import time
import zlib

ROOT = pathlib.Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT / "tests" / "report_browser"))

import devtools  # noqa: E402

WIDTH, HEIGHT = 1200, 700  # Of s3-drive's camera.
ROAD, BUILDING = 0, 2      # Cityscapes.


def write_mask(path):
    """KITTI-STEP: the road below, buildings above it."""
    def rows(label, count):
        return (b"\0" + bytes((label, 0, 0)) * WIDTH) * count

    def chunk(kind, data):
        return (struct.pack(">I", len(data)) + kind + data +
                struct.pack(">I", zlib.crc32(kind + data)))

    pixels = rows(BUILDING, HEIGHT // 2) + rows(ROAD, HEIGHT - HEIGHT // 2)
    header = struct.pack(">IIBBBBB", WIDTH, HEIGHT, 8, 2, 0, 0, 0)
    path.write_bytes(b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", header) +
                     chunk(b"IDAT", zlib.compress(pixels)) + chunk(b"IEND", b""))


def run(*command):
    """Wall time [s] and peak memory [MiB]."""
    start = time.monotonic()
    process = subprocess.Popen([str(word) for word in command], stdout=subprocess.DEVNULL)
    _, status, usage = os.wait4(process.pid, 0)
    process.returncode = os.waitstatus_to_exitcode(status)
    if process.returncode != 0:
        sys.exit(f"{' '.join(map(str, command))}: exit code {process.returncode}")
    return time.monotonic() - start, usage.ru_maxrss / 1024


def make_run(programs, keyframes, points_per_keyframe, folder):
    common = ["--overwrite", "--quiet"]
    run(programs / "s3-drive", "--keyframes", keyframes, "--points-per-keyframe",
        points_per_keyframe, "--output", folder / "1_slam", *common)
    masks = folder / "masks"
    masks.mkdir()
    write_mask(masks / "1.png")
    for i in range(2, keyframes + 1):
        (masks / f"{i}.png").symlink_to("1.png")
    run(programs / "s3-lift", "--model", folder / "1_slam", "--masks", masks, "--classes",
        ROOT / "configs" / "classes" / "cityscapes.json", "--output", folder / "2_lift", *common)
    run(programs / "s3-refine", "--model", folder / "1_slam", "--semantics", folder / "2_lift",
        "--output", folder / "3_refine", "--set", "outer.max_iterations=1",
        "--set", "solver.max_iterations=3", *common)


def browse(page_file, screenshot):
    """Seconds until the page is there, and the median ones until actions are drawn."""
    with devtools.Page(devtools.find_browser(), timeout_s=600) as page:
        start = time.monotonic()
        page.open(page_file.as_uri())
        result = {"load": time.monotonic() - start}

        def timed(*scripts):
            seconds = []
            for script in scripts:
                start = time.monotonic()
                page.evaluate(script)
                page.frames()
                seconds.append(time.monotonic() - start)
            return statistics.median(seconds)

        page.evaluate("document.getElementById('view-row').scrollIntoView()")
        result["points"] = page.evaluate("s3lamViewer.visiblePoints()")
        result["turn"] = timed(*(f"document.getElementById('look-{view}').click()"
                                 for view in ("top", "side", "oblique")))
        result["switch"] = timed(*["document.getElementById('classes-0').click()"] * 4)
        result["point"] = timed(*(f"s3lamViewer.hover({x}, 300)" for x in (300, 400, 500)))
        if screenshot:
            screenshot.write_bytes(base64.b64decode(page.screenshot("view-row")))
        if page.problems:
            sys.exit("\n".join(page.problems))
    return result


def main():
    parser = argparse.ArgumentParser(description=__doc__,
                                     formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--bin", type=pathlib.Path, required=True, help="folder of the programs")
    parser.add_argument("--keyframes", type=int, default=550)
    parser.add_argument("--points-per-keyframe", type=int, nargs="+", default=[200, 2000])
    parser.add_argument("--screenshot", type=pathlib.Path, help="of the last map's 3D view")
    arguments = parser.parse_args()
    if devtools.find_browser() is None:
        sys.exit("no Chromium is installed")
    print("| points | s3-report [s] | peak [MiB] | page [MiB] | load [s] | turn [s] | switch [s] "
          "| point [s] |")
    print("|---|---|---|---|---|---|---|---|", flush=True)
    for points_per_keyframe in arguments.points_per_keyframe:
        with tempfile.TemporaryDirectory() as name:
            folder = pathlib.Path(name)
            make_run(arguments.bin, arguments.keyframes, points_per_keyframe, folder)
            page = folder / "report.html"
            seconds, peak = run(arguments.bin / "s3-report", "--run", folder, "--output", page,
                                "--quiet")
            found = browse(page, arguments.screenshot)
            print(f"| {found['points']} | {seconds:.1f} | {peak:.0f} "
                  f"| {page.stat().st_size / 2**20:.1f} | {found['load']:.1f} "
                  f"| {found['turn']:.2f} | {found['switch']:.2f} | {found['point']:.2f} |",
                  flush=True)


if __name__ == "__main__":
    main()
