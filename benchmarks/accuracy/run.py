#!/usr/bin/env python3
"""Accuracy of the stages on real sequences and on synthetic scenes.

Every sequence goes through s3-slam, s3-lift and s3-refine, the last one without planes and with
them. Writes results.json and results.md to the output folder and prints the tables. Needs only
Python's standard library; every figure is measured.
"""

import argparse
import dataclasses
import os
import pathlib
import sys

import baselines
import planes
import sequences
import stages
import tables


def evaluate(programs, trajectory, references):
    """ATE against every reference; the whole report on the first one."""
    reports = [programs.trajectory_error(trajectory, reference) for reference in references]
    ate = {reference.name: report["ate"]["translation"]["rmse"]
           for reference, report in zip(references, reports)}
    return ate, reports[0]


def plane_angles(sequence, plane_file, alignment):
    fitted = planes.read_planes(plane_file, alignment)
    if sequence.true_planes:
        return planes.compare(fitted, sequence.true_planes)
    return planes.parallel_in_class(fitted, sequence.parallel_class)


def measure_arm(programs, sequence, model, plane_file):
    ate, report = evaluate(programs, model / "frames.txt", sequence.references)
    arm = {"ate": ate, "path_length": report["path_length"],
           "time_offset": programs.time_offset(model / "frames.txt", sequence.references[0])}
    if plane_file:
        arm["plane_angles"] = plane_angles(sequence, plane_file, report["truth_from_estimate"])
    return arm


def run_slam(programs, sequence, output):
    report, cost = programs.slam(sequence.folder, output / "1_slam")
    return {"sequence": sequence.name, "frames": report["frames"],
            "frames_localized": report["frames_localized"], "keyframes": report["keyframes"],
            "points": report["points"], "loops_closed": report["loops_closed"],
            "costs": {"s3-slam": dataclasses.asdict(cost)}}


def run_masks(programs, sequence, masks, shared, output, settings):
    """Lifts one kind of masks and refines with the planes found."""
    slam, plain = output / "1_slam", output / "3_refine_plain"
    folder = sequence.masks[masks]
    lifted, refined = output / f"2_lift_{masks}", output / f"3_refine_{masks}"
    lift_report, lift_cost = programs.lift(slam, folder, sequence.classes, lifted)
    # The planes of the map after the plain adjustment, fitted in the same way, to compare with.
    lifted_plain = output / f"2_lift_plain_{masks}"
    programs.lift(plain, folder, sequence.classes, lifted_plain)
    report, cost = programs.refine(slam, lifted, refined, settings)
    result = dict(shared, masks=masks)
    result["planes"] = sum(c["planes"] for c in lift_report["classes"])
    result["clusters"] = sum(c["clusters"] for c in lift_report["classes"])
    result["plane_rms_sigma"] = [arm.get("plane_rms_sigma") for arm in report["arms"]]
    result["plane_mode"] = report["plane_mode"]
    result["costs"] = dict(shared["costs"], **{"s3-lift": dataclasses.asdict(lift_cost),
                                               "s3-refine": dataclasses.asdict(cost)})
    result["slam"] = measure_arm(programs, sequence, slam, lifted / "semantics.json")
    result["plain"] = measure_arm(programs, sequence, plain, lifted_plain / "semantics.json")
    result["planar"] = measure_arm(programs, sequence, refined, refined / "planes.json")
    arms = [result[arm] for arm in ("slam", "plain", "planar")]
    for arm, summary in zip(arms, planes.summarise([arm["plane_angles"] for arm in arms])):
        arm["plane_summary"] = summary
    return result


def run_sequence(programs, sequence, output, arguments):
    stages.say(f"{sequence.name} ...")
    shared = run_slam(programs, sequence, output)
    if arguments.slam_only:
        return [dict(shared, masks=None,
                     slam=measure_arm(programs, sequence, output / "1_slam", None))]
    programs.refine(output / "1_slam", None, output / "3_refine_plain", ["planes.mode=off"])
    if sequence.masks:
        return [run_masks(programs, sequence, masks, shared, output, arguments.set)
                for masks in sequence.masks]
    return [dict(shared, masks=None,
                 slam=measure_arm(programs, sequence, output / "1_slam", None),
                 plain=measure_arm(programs, sequence, output / "3_refine_plain", None))]


def run_baselines(programs, folder, sequence_list):
    """Other systems' trajectories, measured as ours are."""
    by_name = {sequence.name: sequence for sequence in sequence_list}
    measured = []
    for (name, system), paths in baselines.find(folder, by_name).items():
        reference = by_name[name].references[0]
        reports = [programs.trajectory_error(path, reference) for path in paths]
        measured.append({"sequence": name, "reference": reference.name, "system": system,
                         "runs": [{"ate": report["ate"]["translation"]["rmse"],
                                   "frames": report["num_estimate"],
                                   "time_offset": programs.time_offset(path, reference)}
                                  for report, path in zip(reports, paths)]})
    return measured


def baseline_folder(arguments):
    """The one given, else the one beside the data; None if there is none."""
    folder = arguments.baselines or arguments.data.parent / "baselines"
    if not folder.is_dir():
        if arguments.baselines:
            sys.exit(f"{folder}: no such folder of trajectories of other systems")
        return None
    stages.say(f"trajectories of other systems are taken from {folder}")
    return folder


def real(arguments, programs):
    folder = baseline_folder(arguments)
    chosen = [sequences.real_sequence(name, arguments.data) for name in arguments.sequences]
    results = []
    for sequence in chosen:
        if not sequence.folder.is_dir():
            sys.exit(f"{sequence.folder}: no such sequence")
        results += run_sequence(programs, sequence, arguments.output / sequence.name, arguments)
    return results, run_baselines(programs, folder, chosen) if folder else []


def synthetic(arguments, programs):
    results = []
    for scene in arguments.scenes:
        for seed in arguments.seeds:
            output = arguments.output / f"{scene}_{seed}"
            output.mkdir(parents=True, exist_ok=True)
            programs.with_seed(seed).synthesise(scene, output / "scene")
            sequence = sequences.synthetic_sequence(f"{scene} {seed}", output / "scene")
            results += [dict(result, scene=scene)
                        for result in run_sequence(programs, sequence, output, arguments)]
    return results, []


def parse_arguments():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--bin", type=pathlib.Path, required=True, help="folder of the programs")
    parser.add_argument("--output", type=pathlib.Path,
                        default=sequences.ROOT / "benchmark-output" / "accuracy")
    sequences.add_arguments(parser, seeds=[1, 2, 3])
    parser.add_argument("--set", action="append", default=[], metavar="KEY=VALUE",
                        help="for s3-refine with planes, e.g. planes.mode=fixed; may be repeated")
    parser.add_argument("--slam-only", action="store_true",
                        help="s3-slam alone: no masks, no bundle adjustment after it")
    parser.add_argument("--baselines", type=pathlib.Path, metavar="DIR",
                        help="trajectories <system>_<sequence>[_<run>]_frames.txt of other systems, "
                             "measured beside ours (default: DATA/../baselines, if it is there)")
    parser.add_argument("--readme", action="store_true",
                        help="put the tables into README.md, between the marks made for them")
    parser.add_argument("--threads", type=int, default=os.cpu_count())
    arguments = parser.parse_args()
    if arguments.baselines and not arguments.data:
        parser.error("--baselines needs --data")
    return arguments


def main():
    arguments = parse_arguments()
    programs = stages.Programs(arguments.bin, arguments.threads, seed=0)
    arguments.output.mkdir(parents=True, exist_ok=True)
    try:
        results, others = (real if arguments.data else synthetic)(arguments, programs)
    except stages.StageFailed as error:
        sys.exit(str(error))
    text = tables.report(results, others)
    stages.write_json(arguments.output / "results.json",
                      {"version": programs.version(), "threads": arguments.threads,
                       "settings": arguments.set, "results": results, "baselines": others})
    (arguments.output / "results.md").write_text(text)
    if arguments.readme:
        tables.replace_marked(sequences.ROOT / "README.md",
                              "accuracy" if arguments.data else "synthetic", text)
    print(text)
    stages.say(f"Written to {arguments.output}")


if __name__ == "__main__":
    main()
