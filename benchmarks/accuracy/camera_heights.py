#!/usr/bin/env python3
"""Drives with a lens that is known a little wrong: what does the camera's constant height mend?

Renders drives along a street, whose camera has no distortion, and runs s3-slam on each with the radial
distortion k1 given as it is and wrong, s3-slam's own calibration being switched off: such is a map of a
program that holds its cameras. Prints a Markdown table of the trajectory error (RMSE after Sim(3)
alignment) of that map and after s3-refine: without planes, with the camera's height and the lens as
given, and with both refined, and of the k1 that is then found.

  camera_heights.py --bin ../../build/bin [--seeds 1 2] [--distortion 0 0.01 -0.01]
"""

import argparse
import os
import pathlib
import struct
import sys
import tempfile

import stages
import tables

ARMS = {
    "without planes": ["planes.mode=off"],
    "height, lens as given": ["camera_height.refine_distortion=false"],
    "height and lens": [],
}
PINHOLE = 1
NO_CALIBRATION = ["self_calibration.enabled=false"]


def pinhole_camera(model):
    """Of a binary COLMAP model with one camera: camera.json without distortion."""
    data = (model / "cameras.bin").read_bytes()
    count, _, kind, width, height = struct.unpack_from("<QIiQQ", data)
    assert (count, kind) == (1, PINHOLE), f"{model}: not one pinhole camera"
    params = struct.unpack_from("<4d", data, struct.calcsize("<QIiQQ"))
    return {"model": "PINHOLE", "width": width, "height": height, "params": list(params)}


def with_distortion(camera, k1):
    return dict(camera, model="OPENCV", params=[*camera["params"], k1, 0.0, 0.0, 0.0])


def measure(programs, drive, camera, k1, work):
    """The cells of a line of the table from the error of the map on."""
    stages.write_json(work / "camera.json", with_distortion(camera, k1))
    programs.run(*stages.slam_command(drive, work / "slam", NO_CALIBRATION,
                                      ["--camera", work / "camera.json"]))
    programs.lift(work / "slam", drive / "panoptic", "cityscapes", work / "lift")

    def error_of(model):
        report = programs.trajectory_error(work / model / "frames.txt", drive / "groundtruth.txt")
        return tables.metres(report["ate"]["translation"]["rmse"])

    cells = [error_of("slam")]
    for settings in ARMS.values():
        report, _ = programs.refine(work / "slam", work / "lift", work / "refined", settings)
        cells.append(error_of("refined"))
    refined = [camera for camera in report["cameras"] if camera["refined"]]
    return [*cells, f"{refined[0]['params_after'][4]:.4f}" if refined else "kept"]


def measure_drive(programs, distortions, work):
    """The table's lines of one drive, without its seed."""
    programs.synthesise("street", work / "drive")
    programs.run(*stages.slam_command(work / "drive", work / "pinhole", NO_CALIBRATION))
    camera = pinhole_camera(work / "pinhole")
    for k1 in distortions:
        stages.say(f"k1 = {k1:g} ...")
        yield [f"{k1:g}", *measure(programs, work / "drive", camera, k1, work)]


def main():
    parser = argparse.ArgumentParser(description=__doc__,
                                     formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--bin", type=pathlib.Path, required=True, help="folder of the programs")
    parser.add_argument("--seeds", nargs="+", type=int, default=[1, 2])
    parser.add_argument("--distortion", nargs="+", type=float, default=[0.0, 0.01, -0.01],
                        help="k1 that s3-slam is given")
    parser.add_argument("--threads", type=int, default=os.cpu_count())
    arguments = parser.parse_args()
    header = ["street", "k1 given, 0 in truth", "ATE of the map",
              *(f"ATE {arm}" for arm in ARMS), "k1 found"]
    rows = []
    try:
        for seed in arguments.seeds:
            programs = stages.Programs(arguments.bin, arguments.threads, seed)
            with tempfile.TemporaryDirectory() as work:
                rows += [[str(seed), *row] for row in
                         measure_drive(programs, arguments.distortion, pathlib.Path(work))]
    except (stages.StageFailed, OSError) as error:
        sys.exit(str(error))
    print(tables.markdown(header, rows), flush=True)


if __name__ == "__main__":
    main()
