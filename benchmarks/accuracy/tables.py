"""The result as Markdown."""

import statistics


def number(value, digits):
    return "-" if value is None else f"{value:.{digits}f}"


def metres(value):
    """To a tenth of a millimetre, or to a hundredth where that is less than a millimetre."""
    return number(value, 5 if value is not None and value < 0.001 else 4)


def arrows(values):
    """The three arms in one cell."""
    texts = [number(value, 2) for value in values]
    return "-" if set(texts) == {"-"} else " → ".join(texts)


def markdown(header, rows):
    lines = ["| " + " | ".join(header) + " |", "|" + "---|" * len(header)]
    lines += ["| " + " | ".join(map(str, row)) + " |" for row in rows]
    return "\n".join(lines) + "\n"


def accuracy_table(results):
    """One line per sequence, kind of masks and reference; ATE in the reference's unit [m]."""
    header = ["sequence", "masks", "frames", "keyframes", "points", "planes", "reference",
              "ATE SLAM", "ATE BA without planes", "ATE planar BA"]
    rows = []
    for result in results:
        for reference in result["slam"]["ate"]:
            ate = [result[arm]["ate"][reference] if result.get(arm) else None
                   for arm in ("slam", "plain", "planar")]
            rows.append([result["sequence"], result["masks"] or "-",
                         f"{result['frames_localized']}/{result['frames']}", result["keyframes"],
                         result["points"], result.get("planes", "-"), reference,
                         *(metres(value) for value in ate)])
    return markdown(header, rows)


def plane_table(results):
    header = ["sequence", "masks", "true planes found", "normals off [deg]",
              "parallel planes off [deg]", "points off their planes, RMS [sigma]"]
    rows = []
    for result in results:
        if not result.get("planar"):
            continue
        arms = [result[arm]["plane_summary"] for arm in ("slam", "plain", "planar")]
        found = (f"{arms[2]['found']}/{arms[2]['due']}" if arms[2].get("due") else "-")
        rows.append([result["sequence"], result["masks"], found,
                     arrows(a["normal_error_deg"] for a in arms),
                     arrows(a["parallel_off_deg"] for a in arms),
                     arrows(result["plane_rms_sigma"])])
    return markdown(header, rows)


def cost_table(results):
    header = ["sequence", "masks", "s3-slam [s]", "s3-lift [s]", "s3-refine [s]", "peak [MiB]: s3-slam",
              "s3-lift", "s3-refine"]
    rows = []
    for result in results:
        costs = [result["costs"].get(stage) for stage in ("s3-slam", "s3-lift", "s3-refine")]
        rows.append([result["sequence"], result["masks"] or "-",
                     *(number(c and c["wall_s"], 1) for c in costs),
                     *(number(c and c["peak_mib"], 0) for c in costs)])
    return markdown(header, rows)


def scene_table(results):
    """One line per synthetic scene, over its seeds: s3-slam alone, errors relative to the path."""
    scenes = {}
    for result in results:
        scenes.setdefault(result["scene"], {})[result["sequence"]] = result
    header = ["scene", "seeds", "frames localised", "ATE / path [%]: median", "worst",
              "runs that closed a loop"]
    rows = []
    for scene, by_sequence in scenes.items():
        runs = by_sequence.values()
        errors = [100.0 * run["slam"]["ate"]["groundtruth.txt"] / run["slam"]["path_length"]
                  for run in runs]
        rows.append([scene, len(runs),
                     f"{sum(run['frames_localized'] for run in runs)}/"
                     f"{sum(run['frames'] for run in runs)}",
                     f"{statistics.median(errors):.4f}", f"{max(errors):.4f}",
                     f"{sum(run['loops_closed'] > 0 for run in runs)}/{len(runs)}"])
    return markdown(header, rows)


def baseline_table(baselines):
    """Median over the runs of each system (range in brackets), all frames it tracked."""
    header = ["sequence", "reference", "system", "runs", "frames", "ATE"]
    rows = []
    for entry in baselines:
        ate = [run["ate"] for run in entry["runs"]]
        spread = f" ({min(ate):.4f} - {max(ate):.4f})" if len(ate) > 1 else ""
        frames = statistics.median_low(run["frames"] for run in entry["runs"])
        rows.append([entry["sequence"], entry["reference"], entry["system"], len(ate), frames,
                     f"{statistics.median(ate):.4f}{spread}"])
    return markdown(header, rows)


def offset_cell(offsets):
    """Medians of the offsets and their standard errors [ms]."""
    if not offsets:
        return "-"
    seconds, sigma = (statistics.median(offset[key] for offset in offsets)
                      for key in ("seconds", "sigma_s"))
    return f"{1000.0 * seconds:.1f} ± {1000.0 * sigma:.1f}"


def offset_row(sequence, system, offsets):
    """Medians over the runs that tell an offset."""
    told = [offset for offset in offsets if offset["seconds"] is not None]
    by_rotations = offset_cell([offset["of_rotations"] for offset in offsets
                                if offset["of_rotations"]])
    errors = [f"{statistics.median(offset[key] for offset in told):.4f}" if told else "-"
              for key in ("ate_without", "ate_of_exact", "ate")]
    return [sequence, system, f"{len(told)}/{len(offsets)}", by_rotations, offset_cell(told), *errors]


def offset_table(results, baselines):
    """How far the clock of the reference is ahead, by each system, and the ATE without it."""
    header = ["sequence", "system", "runs", "reference late by [ms]: rotations", "positions", "ATE",
              "ATE of exact poses", "ATE with the offset of positions"]
    ours = {result["sequence"]: result["slam"]["time_offset"] for result in results}
    rows = []
    for sequence, offset in ours.items():
        rows.append(offset_row(sequence, "s3-slam", [offset]))
        rows += [offset_row(sequence, entry["system"],
                            [run["time_offset"] for run in entry["runs"]])
                 for entry in baselines if entry["sequence"] == sequence]
    return markdown(header, rows)


def report(results, baselines):
    text = "Trajectory error: RMSE of the positions after Sim(3) alignment, all localised frames.\n\n"
    text += accuracy_table(results)
    if any(result.get("planar") for result in results):
        text += "\nPlanes: each arm fits its own map; medians over the true planes that all arms found.\nArms: SLAM → BA without planes → planar BA.\n\n" + plane_table(results)
    if all("scene" in result for result in results):
        text += "\nScenes, s3-slam alone, over the seeds.\n\n" + scene_table(results)
    text += "\nCost: wall time and peak memory of each program.\n\n" + cost_table(results)
    if baselines:
        text += "\nOther systems on the same images.\n\n" + baseline_table(baselines)
        text += ("\nWith the clocks' offset estimated (`s3-eval --time-offset auto`): by rotations from "
                 "frame to frame; by positions, together\nwith the alignment. \"Exact poses\" are the "
                 "reference's own, that offset later.\n\n" + offset_table(results, baselines))
    return text


def replace_marked(path, mark, text):
    """Replaces what stands between <!-- mark: begin --> and <!-- mark: end -->."""
    begin, end = f"<!-- {mark}: begin -->\n", f"<!-- {mark}: end -->"
    before, found, rest = path.read_text().partition(begin)
    _, closed, after = rest.partition(end)
    if not found or not closed:
        raise ValueError(f"{path}: no marks {begin.strip()} ... {end}")
    path.write_text(before + begin + text + end + after)
