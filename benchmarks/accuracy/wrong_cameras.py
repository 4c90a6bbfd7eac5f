#!/usr/bin/env python3
"""The real sequences with a calibration that is wrong: is it told, and can it be mended?

Runs s3-slam with the right camera, with the principal point off by 1.5 % of the image's width, to the
right or down, and with focal lengths 3 % too long, and prints, per sequence, a Markdown table of the
trajectory error (RMSE after Sim(3) alignment), of the share of the reprojection cost that other focal
lengths and another principal point would remove, of these where s3-slam tells them, and of the error
after s3-refine, without planes and with the whole camera free.

  wrong_cameras.py --bin ../../build/bin --data DIR [--sequences kitti07]
"""

import pathlib
import sys
import tempfile

import sequences
import stages
import tables

FREE_CAMERA = ["planes.mode=off", "intrinsics.focal_length=true", "intrinsics.principal_point=true",
               "intrinsics.distortion=true"]
SHIFT = 0.015
FACTOR = 1.03


def shifted(axis):
    def apply(camera):
        camera["params"][sequences.num_focals(camera) + axis] += SHIFT * camera["width"]
    return apply


def lengthened(camera):
    for i in range(sequences.num_focals(camera)):
        camera["params"][i] *= FACTOR


CAMERAS = {
    "as given": lambda camera: None,
    "principal point right by 1.5 %": shifted(0),
    "principal point down by 1.5 %": shifted(1),
    "focal lengths 3 % too long": lengthened,
}


def measure(programs, sequence, label, work):
    """One line of the table."""
    camera = sequences.right_camera(sequence)
    CAMERAS[label](camera)
    camera_file = work / "camera.json"
    stages.write_json(camera_file, camera)
    report, _ = programs.run(*stages.slam_command(sequence.folder, work / "slam",
                                                  arguments=["--camera", camera_file]))
    programs.refine(work / "slam", None, work / "refined", FREE_CAMERA)
    errors = [programs.trajectory_error(work / result / "frames.txt", sequence.references[0])
              for result in ("slam", "refined")]
    by_slam, refined = [tables.metres(e["ate"]["translation"]["rmse"]) for e in errors]
    better = ", ".join(f"{value:.1f}" for value in report["better_pinhole"]) or "-"
    return [label, by_slam, f"{100 * report['pinhole_cost_share']:.1f} %", better, refined]


def main():
    arguments = sequences.real_sequences_parser(__doc__).parse_args()
    programs = stages.Programs(arguments.bin, arguments.threads, seed=0)
    header = ["camera", "ATE SLAM", "cost that others would remove", "told: fx, fy, cx, cy [px]",
              "ATE, camera refined"]
    try:
        for name in arguments.sequences:
            sequence = sequences.real_sequence(name, arguments.data)
            rows = []
            for label in CAMERAS:
                stages.say(f"{name}, {label} ...")
                with tempfile.TemporaryDirectory() as work:
                    rows.append(measure(programs, sequence, label, pathlib.Path(work)))
            print(f"\n{name}:\n\n{tables.markdown(header, rows)}", flush=True)
    except (stages.StageFailed, OSError) as error:
        sys.exit(str(error))


if __name__ == "__main__":
    main()
