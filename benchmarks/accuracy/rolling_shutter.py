#!/usr/bin/env python3
"""Synthetic scenes taken by a rolling shutter: is it seen, and is it corrected?

Renders scenes with several readout times, runs s3-slam on each as it is and with
rolling_shutter.mode=compensate, and prints a Markdown table of what of the reprojection cost a readout
time would remove, whether the shutter is told, the readout time that is found, and the trajectory error
(RMSE after Sim(3) alignment) of both. A global shutter has a readout time of zero.

  rolling_shutter.py --bin ../../build/bin [--scenes desk floor] [--readout 0 0.01 0.03]
"""

import argparse
import os
import pathlib
import sys
import tempfile

import stages
import tables


def measure(programs, scene, readout_s, work):
    """One line of the table."""
    programs.synthesise(scene, work / "sequence", [f"scene.readout_s={readout_s}"])
    reports, errors = {}, {}
    for mode in ("check", "compensate"):
        report, _ = programs.slam(work / "sequence", work / mode, [f"rolling_shutter.mode={mode}"])
        reports[mode] = report["rolling_shutter"]
        error = programs.trajectory_error(work / mode / "frames.txt",
                                          work / "sequence" / "groundtruth.txt")
        errors[mode] = error["ate"]["translation"]["rmse"]
    found = reports["compensate"]
    told = (f"{1e3 * found['readout_s']:.1f} ± {1e3 * found['sigma_s']:.1f}"
            if found["compensated"] else "-")
    return [scene, f"{1e3 * readout_s:g}", f"{100 * reports['check']['cost_share']:.2f} %",
            "yes" if reports["check"]["seen"] else "no", told,
            *(tables.metres(errors[mode]) for mode in ("check", "compensate"))]


def main():
    parser = argparse.ArgumentParser(description=__doc__,
                                     formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--bin", type=pathlib.Path, required=True, help="folder of the programs")
    parser.add_argument("--scenes", nargs="+", default=["desk", "floor", "posters"])
    parser.add_argument("--readout", nargs="+", type=float, default=[0.0, 0.01, 0.03], help="[s]")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--threads", type=int, default=os.cpu_count())
    arguments = parser.parse_args()
    programs = stages.Programs(arguments.bin, arguments.threads, arguments.seed)
    header = ["scene", "readout [ms]", "cost that one would remove", "told", "found [ms]",
              "ATE as it is", "ATE corrected"]
    rows = []
    try:
        for name in arguments.scenes:
            for readout_s in arguments.readout:
                stages.say(f"{name}, {readout_s} s ...")
                with tempfile.TemporaryDirectory() as work:
                    rows.append(measure(programs, name, readout_s, pathlib.Path(work)))
        print(tables.markdown(header, rows), flush=True)
    except (stages.StageFailed, OSError) as error:
        sys.exit(str(error))


if __name__ == "__main__":
    main()
