#!/usr/bin/env python3
"""Short clips of the real sequences, and sparse ones: can s3-slam start anywhere?

Cuts each sequence into clips of a few lengths, end to end, and takes every 2nd, 3rd, ... frame of the
whole; prints, per kind of clip, how many there are, how many were not mapped or not for 95 % of their
frames, and the trajectory error (RMSE after Sim(3) alignment) as a share of the path: median and worst,
with the clip that is the worst. Python's standard library only.

  clips.py --bin ../../build/bin --data DIR [--sequences kitti07] [--lengths 25 50 100]
"""

import argparse
import pathlib
import statistics
import sys
import tempfile

import sequences
import stages
import tables

NUM_FRAMES = {"kitti07": 160, "redkitchen": 1000, "mh05": 585}
MIN_LOCALISED = 0.95
HEADER = ["sequence", "frames of a clip", "every", "clips", "not mapped", "ATE / path [%]: median",
          "worst", "which"]


def number_from(least):
    """Reads a whole number that is at least that, for argparse."""
    def read(text):
        if int(text) < least:
            raise argparse.ArgumentTypeError(f"{text} is less than {least}")
        return int(text)
    return read


def clips_of(num_frames, length, stride):
    """Clips A:B:STEP that begin where the one before ends."""
    span = length * stride
    return [f"{first}:{first + span}:{stride}" for first in range(0, num_frames - span + 1, span)]


def error_of(programs, sequence, clip, output):
    """Of the clip [share of the path]; None where it was not mapped."""
    try:
        report, _ = programs.run("s3-slam", "--sequence", sequence.folder, "--frames", clip,
                                 "--output", output, "--overwrite")
    except stages.StageFailed:
        return None
    if report["frames_localized"] < MIN_LOCALISED * report["frames"]:
        return None
    found = programs.trajectory_error(output / "frames.txt", sequence.references[0])
    return found["ate"]["translation"]["rmse"] / found["path_length"]


def measure(programs, sequence, name, length, stride, work):
    """One line of the table."""
    clips = clips_of(NUM_FRAMES[name], length, stride)
    errors = {clip: error_of(programs, sequence, clip, work / "slam") for clip in clips}
    mapped = {clip: error for clip, error in errors.items() if error is not None}
    line = [name, length, stride, len(clips), len(clips) - len(mapped)]
    if not mapped:
        return line + ["-", "-", "-"]
    worst = max(mapped, key=mapped.get)
    return line + [f"{100 * statistics.median(mapped.values()):.2f}", f"{100 * mapped[worst]:.2f}",
                   worst]


def main():
    parser = sequences.real_sequences_parser(__doc__)
    parser.add_argument("--lengths", nargs="+", type=number_from(4), default=[25, 50, 100],
                        help="frames of a clip")
    parser.add_argument("--strides", nargs="+", type=number_from(1), default=[2, 3, 5],
                        help="of the whole sequence")
    arguments = parser.parse_args()
    programs = stages.Programs(arguments.bin, arguments.threads, seed=0)
    rows = []
    try:
        for name in arguments.sequences:
            sequence = sequences.real_sequence(name, arguments.data)
            kinds = [(length, 1) for length in arguments.lengths if length <= NUM_FRAMES[name]]
            kinds += [(NUM_FRAMES[name] // stride, stride) for stride in arguments.strides]
            for length, stride in kinds:
                stages.say(f"{name}, {length} frames, every {stride} ...")
                with tempfile.TemporaryDirectory() as work:
                    rows.append(measure(programs, sequence, name, length, stride,
                                        pathlib.Path(work)))
    except (stages.StageFailed, OSError) as error:
        sys.exit(str(error))
    print(tables.markdown(HEADER, rows))


if __name__ == "__main__":
    main()
