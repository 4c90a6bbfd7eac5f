#!/usr/bin/env python3
"""Whole stages beside COLMAP's programs on the same input, in alternating pairs.

  map     s3-slam over a sequence; colmap feature_extractor, sequential_matcher and mapper over the same
          images, with the camera fixed to the same parameters
  adjust  s3-refine without planes; colmap bundle_adjuster, from one model as they come (for equal
          conditions see bundle_adjustment.py)
  read    s3-perturb, which reads a model and measures its reprojection error; colmap model_analyzer

One of the pair runs right after the other, so that the ratio means something on a busy machine. Prints a
Markdown table of median wall times, of the median of the pairs' ratios (COLMAP's time over ours) with its
range, and of peak memory. Needs Python's standard library, colmap, and the build with
-DS3LAM_BENCHMARKS=ON.

  stages.py --bin build/bin --sequence DIR --frames 0:100 --repeat 3
  stages.py --bin build/bin --model DIR
"""

import argparse
import os
import pathlib
import statistics
import subprocess
import sys
import tempfile
import time


class Measured:
    def __init__(self, commands):
        start, self.peak_mib = time.monotonic(), 0.0
        for command in commands:
            with tempfile.TemporaryFile() as output:
                process = subprocess.Popen([str(w) for w in command], stdout=output,
                                           stderr=subprocess.STDOUT,
                                           env={**os.environ, "QT_QPA_PLATFORM": "offscreen"})
                _, status, usage = os.wait4(process.pid, 0)
                process.returncode = os.waitstatus_to_exitcode(status)
                if process.returncode != 0:
                    output.seek(0)
                    text = output.read().decode(errors="replace")[-2000:]
                    sys.exit(f"{' '.join(map(str, command))}\n{text}")
            self.peak_mib = max(self.peak_mib, usage.ru_maxrss / 1024)
        self.wall_s = time.monotonic() - start


def read_camera(folder):
    """Model and parameters from cameras.txt."""
    for line in (folder / "cameras.txt").read_text().splitlines():
        if line and not line.startswith("#"):
            _, model, _, _, *params = line.split()
            return model, ",".join(params)
    sys.exit(f"{folder}/cameras.txt: no camera")


def image_names(folder):
    """Of a binary or text model, through COLMAP."""
    lines = [line for line in (folder / "images.txt").read_text().splitlines()
             if not line.startswith("#")]
    return [line.split(maxsplit=9)[9] for line in lines[::2]]


def map_stage(arguments, work):
    """COLMAP maps s3-slam's keyframes: the images it would be given by someone in the same place."""
    ours = [arguments.bin / "s3-slam", "--sequence", arguments.sequence, "--output", work / "slam",
            "--overwrite", "--quiet", "--threads", arguments.threads]
    if arguments.frames:
        ours += ["--frames", arguments.frames]
    Measured([ours])
    text = work / "text"
    text.mkdir()
    subprocess.run(["colmap", "model_converter", "--input_path", work / "slam", "--output_path",
                    text, "--output_type", "TXT"], check=True, stdout=subprocess.DEVNULL)
    root = dict(line.split("=", 1) for line in
                (work / "slam" / "project.ini").read_text().splitlines() if "=" in line)
    root = pathlib.Path(root["image_path"])
    names = image_names(text)
    (work / "images").mkdir()
    for name in names:
        link = work / "images" / name
        link.parent.mkdir(parents=True, exist_ok=True)
        link.symlink_to((root / name).resolve())
    model, params = read_camera(text)
    database, sparse = work / "database.db", work / "sparse"
    sparse.mkdir()
    fixed = [f"--Mapper.ba_refine_{what}" for what in ("focal_length", "extra_params")]
    theirs = [
        ["rm", "-f", database],
        ["colmap", "feature_extractor", "--database_path", database, "--image_path",
         work / "images", "--ImageReader.single_camera", 1, "--ImageReader.camera_model", model,
         "--ImageReader.camera_params", params, "--SiftExtraction.use_gpu", 0,
         "--SiftExtraction.num_threads", arguments.threads],
        ["colmap", "sequential_matcher", "--database_path", database, "--SiftMatching.use_gpu", 0,
         "--SiftMatching.num_threads", arguments.threads],
        ["colmap", "mapper", "--database_path", database, "--image_path", work / "images",
         "--output_path", sparse, "--Mapper.num_threads", arguments.threads,
         *(word for option in fixed for word in (option, 0))],
    ]
    return [ours], theirs, f"map, {len(names)} keyframes"


def adjust_stage(arguments, work):
    (work / "colmap").mkdir()
    ours = [arguments.bin / "s3-refine", "--model", arguments.model, "--output", work / "ours",
            "--overwrite", "--quiet", "--threads", arguments.threads, "--set", "planes.mode=off"]
    theirs = ["colmap", "bundle_adjuster", "--input_path", arguments.model, "--output_path",
              work / "colmap", "--BundleAdjustment.refine_focal_length", 0,
              "--BundleAdjustment.refine_extra_params", 0]
    return [ours], [theirs], "adjust"


def read_stage(arguments, work):
    del work
    return ([[arguments.bin / "s3-perturb", "--model", arguments.model]],
            [["colmap", "model_analyzer", "--path", arguments.model]], "read")


def main():
    parser = argparse.ArgumentParser(description=__doc__,
                                     formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--bin", type=pathlib.Path, required=True, help="folder of the programs")
    parser.add_argument("--sequence", type=pathlib.Path, help="for map")
    parser.add_argument("--frames", metavar="A:B:STEP", help="of the sequence")
    parser.add_argument("--model", type=pathlib.Path, help="for adjust and read")
    parser.add_argument("--threads", type=int, default=os.cpu_count())
    parser.add_argument("--repeat", type=int, default=3, help="pairs")
    arguments = parser.parse_args()
    stages = ([map_stage] if arguments.sequence else []) + (
        [adjust_stage, read_stage] if arguments.model else [])
    if not stages:
        parser.error("--sequence or --model is required")
    print("| stage | pairs | ours [s] | colmap [s] | colmap / ours | ours [MiB] | colmap [MiB] |")
    print("|---|---|---|---|---|---|---|")
    for stage in stages:
        with tempfile.TemporaryDirectory() as folder:
            ours, theirs, name = stage(arguments, pathlib.Path(folder))
            pairs = [(Measured(ours), Measured(theirs)) for _ in range(arguments.repeat)]
        ratios = [b.wall_s / a.wall_s for a, b in pairs]
        walls = [statistics.median(p.wall_s for p in side) for side in zip(*pairs)]
        peaks = [max(p.peak_mib for p in side) for side in zip(*pairs)]
        print(f"| {name} | {len(pairs)} | {walls[0]:.2f} | {walls[1]:.2f} | "
              f"{statistics.median(ratios):.2f} ({min(ratios):.2f} - {max(ratios):.2f}) | "
              f"{peaks[0]:.0f} | {peaks[1]:.0f} |", flush=True)


if __name__ == "__main__":
    main()
