#!/usr/bin/env python3
"""Drives with a camera that is known a little wrong: what does its constant height mend?

Renders drives along a street, whose camera has no distortion, and runs s3-slam on each with the camera as
it is and wrong (radial distortion, principal point by 1.5 % of the image's width, focal lengths by 3 %),
s3-slam's own calibration being switched off: such is a map of a program that holds its cameras. Prints a
Markdown table of the trajectory error (RMSE after Sim(3) alignment) of that map and after s3-refine:
without planes, with the camera's height and the camera as given, and with its distortion or all of it
refined with the height.

  camera_heights.py --bin ../../build/bin [--seeds 1 2] [--cameras "as it is"]
"""

import argparse
import os
import pathlib
import struct
import sys
import tempfile

import stages
import tables
import wrong_cameras

ARMS = {
    "without planes": ["planes.mode=off"],
    "height, camera as given": ["camera_height.refine_camera=none"],
    "height and distortion": ["camera_height.refine_camera=distortion"],
    "height and camera": [],
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


def with_distortion(k1):
    return lambda camera: camera["params"].__setitem__(4, k1)


# What is done to the parameters [fx, fy, cx, cy, k1, k2, p1, p2] that s3-slam is given.
CAMERAS = {
    "as it is": lambda camera: None,
    "k1 0.01": with_distortion(0.01),
    "k1 -0.01": with_distortion(-0.01),
    "principal point right by 1.5 %": wrong_cameras.shifted(0),
    "principal point down by 1.5 %": wrong_cameras.shifted(1),
    "focal lengths 3 % too long": wrong_cameras.lengthened,
}


def measure(programs, drive, camera, work):
    """The cells of a line of the table from the error of the map on."""
    stages.write_json(work / "camera.json", camera)
    programs.run(*stages.slam_command(drive, work / "slam", NO_CALIBRATION,
                                      ["--camera", work / "camera.json"]))
    programs.lift(work / "slam", drive / "panoptic", "cityscapes", work / "lift")

    def error_of(model):
        report = programs.trajectory_error(work / model / "frames.txt", drive / "groundtruth.txt")
        return tables.metres(report["ate"]["translation"]["rmse"])

    cells = [error_of("slam")]
    for settings in ARMS.values():
        programs.refine(work / "slam", work / "lift", work / "refined", settings)
        cells.append(error_of("refined"))
    return cells


def measure_drive(programs, labels, work):
    """The table's lines of one drive, without its seed."""
    programs.synthesise("street", work / "drive")
    programs.run(*stages.slam_command(work / "drive", work / "pinhole", NO_CALIBRATION))
    pinhole = pinhole_camera(work / "pinhole")
    for label in labels:
        stages.say(f"{label} ...")
        camera = dict(pinhole, model="OPENCV", params=[*pinhole["params"], 0.0, 0.0, 0.0, 0.0])
        CAMERAS[label](camera)
        yield [label, *measure(programs, work / "drive", camera, work)]


def main():
    parser = argparse.ArgumentParser(description=__doc__,
                                     formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--bin", type=pathlib.Path, required=True, help="folder of the programs")
    parser.add_argument("--seeds", nargs="+", type=int, default=[1, 2])
    parser.add_argument("--cameras", nargs="+", choices=CAMERAS, default=list(CAMERAS),
                        metavar="CAMERA", help="that s3-slam is given: " + ", ".join(CAMERAS)
                        .replace("%", "%%"))
    parser.add_argument("--threads", type=int, default=os.cpu_count())
    arguments = parser.parse_args()
    header = ["street", "camera given", "ATE of the map", *(f"ATE {arm}" for arm in ARMS)]
    rows = []
    try:
        for seed in arguments.seeds:
            programs = stages.Programs(arguments.bin, arguments.threads, seed)
            with tempfile.TemporaryDirectory() as work:
                rows += [[str(seed), *row] for row in
                         measure_drive(programs, arguments.cameras, pathlib.Path(work))]
    except (stages.StageFailed, OSError) as error:
        sys.exit(str(error))
    print(tables.markdown(header, rows), flush=True)


if __name__ == "__main__":
    main()
