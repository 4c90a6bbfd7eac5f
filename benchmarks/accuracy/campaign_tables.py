"""The tables of a campaign: Markdown, CSV and JSON, from the files its jobs left."""

import csv
import io
import json
import pathlib
import statistics

import campaign_jobs as jobs
import stages
from tables import markdown, number

HERE = pathlib.Path(__file__).resolve().parent
FIGURES = ("ate", "ate_keyframes", "ate_rotation_deg", "rpe", "rpe_rotation_deg", "rpe_per_length",
           "segments_percent", "segments_deg_per_length", "normal_deg", "parallel_deg",
           "orthogonal_deg", "planes_found", "flatness", "wall_s", "peak_mib")


# ---- figures ---------------------------------------------------------------------------------------


def arm_figures(errors):
    """The figures of one reference; those that were not measured are missing."""
    trajectory = errors["frames"]["trajectory"]
    figures = {"frames": trajectory["num_estimate"], "ate": trajectory["ate"]["translation"]["rmse"],
               "ate_keyframes": errors["keyframes"]["ate"]["translation"]["rmse"],
               "ate_rotation_deg": trajectory["ate"]["rotation_deg"]["rmse"],
               "rpe": trajectory["rpe"]["translation"]["rmse"],
               "rpe_rotation_deg": trajectory["rpe"]["rotation_deg"]["rmse"]}
    if trajectory["rpe_per_length"]["translation"]["count"]:
        figures["rpe_per_length"] = trajectory["rpe_per_length"]["translation"]["rmse"]
    segments = trajectory["segments"]["all"]
    if segments["count"]:
        figures["segments_percent"] = segments["translation_percent"]
        figures["segments_deg_per_length"] = segments["rotation_deg_per_length"]
    known = errors["frames"].get("known_planes")
    if known and known["found"]:
        figures["planes_found"] = known["found"]
        figures["planes_known"] = known["known"]
        figures["normal_deg"] = known["normal_deg"]["median"]
        for relation in ("parallel_deg", "orthogonal_deg"):
            if known[relation]["count"]:
                figures[relation] = known[relation]["median"]
                figures[relation + "_range"] = [known[relation]["max"], known[relation]["min"]]
    elif errors["frames"].get("planes", {}).get("from_parallel", {}).get("count"):
        angles = errors["frames"]["planes"]["from_parallel"]
        figures["parallel_deg"] = angles["median_deg"]
        figures["parallel_deg_range"] = [angles["max_deg"], angles["min_deg"]]
    cloud = errors["frames"].get("cloud")
    if cloud:
        figures["flatness"] = cloud["rms"]["median"]
    return figures


def why_not_done(campaign, job):
    if job.output(campaign).is_file():
        return "what is there was made by other settings or programs"
    return "the job has not been done"


def collect(campaign):
    """One row per sequence, reference, seed, masks and arm; and what is missing, with the reason."""
    rows, missing = [], []
    for name in campaign.sequences:
        if not jobs.available(campaign, name):
            missing.append({"sequence": name, "reason": f"not in {campaign.find(name).folder}"})
    for job in jobs.arm_jobs(campaign):
        result = jobs.read_result(campaign, job)
        if result is None or "skipped" in result:
            reason = result["skipped"] if result else why_not_done(campaign, job)
            missing.append({"sequence": job.sequence, "seed": job.seed, "masks": job.masks,
                            "arm": job.arm, "reason": reason})
            continue
        cost = result.get("cost") or jobs.read_result(
            campaign, jobs.Job("slam", job.sequence, job.seed))["cost"]
        for reference, errors in result["errors"].items():
            rows.append({"sequence": job.sequence, "reference": reference, "masks": job.masks,
                         "arm": job.arm, "seed": job.seed, **arm_figures(errors),
                         "wall_s": cost["wall_s"], "peak_mib": cost["peak_mib"]})
    return rows, missing


def grouped(rows):
    """Rows by (sequence, reference, masks, arm), over the seeds."""
    groups = {}
    for row in rows:
        key = tuple(row[k] for k in ("sequence", "reference", "masks", "arm"))
        groups.setdefault(key, []).append(row)
    return groups


def middle(group, figure):
    values = [row[figure] for row in group if row.get(figure) is not None]
    return statistics.median(values) if values else None


def summarise(rows):
    """Median over the seeds and, of the ATE, the range."""
    summary = []
    for key, group in grouped(rows).items():
        entry = dict(zip(("sequence", "reference", "masks", "arm"), key), seeds=len(group))
        for figure in FIGURES:
            entry[figure] = middle(group, figure)
        ate = [row["ate"] for row in group]
        entry["ate_range"] = [min(ate), max(ate)]
        summary.append(entry)
    return summary


# ---- tables ----------------------------------------------------------------------------------------


def columns(campaign, summary):
    present = {entry["arm"] for entry in summary}
    return [arm for arm in campaign.arms if arm in present]


def lines_of(summary):
    """(sequence, reference, masks) of the table's lines. Arms without masks stand in every line of
    their sequence, so that the columns compare."""
    with_masks = {(e["sequence"], e["reference"]) for e in summary if e["masks"] != jobs.NO_MASKS}
    lines = {}
    for e in summary:
        if e["masks"] != jobs.NO_MASKS or (e["sequence"], e["reference"]) not in with_masks:
            lines.setdefault((e["sequence"], e["reference"], e["masks"]))
    return list(lines)


def at(summary, line, arm):
    sequence, reference, masks = line
    wanted = jobs.NO_MASKS if arm in jobs.WITHOUT_MASKS else masks
    return next((e for e in summary if (e["sequence"], e["reference"], e["masks"], e["arm"]) ==
                 (sequence, reference, wanted, arm)), None)


def cell(entry, figure, digits, with_range=False):
    if entry is None or entry[figure] is None:
        return "-"
    text = number(entry[figure], digits)
    if with_range and entry["seeds"] > 1:
        low, high = entry[figure + "_range"]
        text += f" ({number(low, digits)} - {number(high, digits)})"
    return text


def arm_table(campaign, summary, figure, digits, with_range=False, extra=(), extra_cells=None):
    arms = columns(campaign, summary)
    rows = []
    for line in lines_of(summary):
        entries = [at(summary, line, arm) for arm in arms]
        if all(e is None or e[figure] is None for e in entries):
            continue
        sequence, reference, masks = line
        rows.append([sequence, reference, "-" if masks == jobs.NO_MASKS else masks,
                     *(cell(e, figure, digits, with_range) for e in entries),
                     *(extra_cells(sequence) if extra_cells else ())])
    header = ["sequence", "reference", "masks", *arms, *extra]
    return markdown(header, rows) if rows else ""


def published_columns(campaign, published):
    """Systems with a published figure for any of the sequences; and what stands in a sequence's line."""
    figures = {name: published["ate"].get(name, {}) for name in campaign.sequences}
    systems = [s for s in published["systems"] if any(s in f for f in figures.values())]
    return systems, lambda sequence: [number(figures[sequence].get(s), 4) for s in systems]


def angles_table(campaign, rows, published):
    """Normals of planes that are parallel in reality: largest, smallest, median, as the paper has
    it; the run of the first seed."""
    arms = [arm for arm in campaign.arms if arm not in jobs.WITHOUT_MASKS]
    first = {}
    for row in rows:
        if row["seed"] == campaign.seeds[0] and "parallel_deg_range" in row:
            first.setdefault((row["sequence"], row["masks"]), {})[row["arm"]] = (
                *row["parallel_deg_range"], row["parallel_deg"])
    paper = {name: angles for name, angles in published["plane_angles_deg"].items()
             if name in published["systems"] and set(campaign.sequences) & angles.keys()}
    lines = []
    for (sequence, masks), by_arm in first.items():
        lines.append([sequence, masks, *(triple(by_arm.get(arm)) for arm in arms),
                      *(triple(angles.get(sequence)) for angles in paper.values())])
    return markdown(["sequence", "masks", *arms, *paper], lines) if lines else ""


def triple(values):
    return " / ".join(number(v, 2) for v in values) if values else "-"


def costs_of(campaign, name):
    """What the programs took of one sequence, a list over seeds (and masks) per stage or arm."""
    costs = {}
    for job in jobs.all_jobs(campaign):
        result = jobs.read_result(campaign, job) if job.sequence == name else None
        if result and "cost" in result:
            costs.setdefault((job.kind, job.arm), []).append(result["cost"])
    return costs


def frames_of(campaign, name):
    for seed in campaign.seeds:
        if result := jobs.read_result(campaign, jobs.Job("slam", name, seed)):
            return result["report"]["frames"]
    return None


def cost_table(campaign):
    """Medians over seeds and masks, of s3-refine by arm: they take different times."""
    arms = [arm for arm in campaign.arms if jobs.ARMS[arm] is not None]
    timed = [("slam", ""), ("lift", ""), *(("arm", arm) for arm in arms)]
    rows = []
    for name in campaign.sequences:
        costs, frames = costs_of(campaign, name), frames_of(campaign, name)
        if not frames:
            continue
        seconds = [statistics.median(c["wall_s"] for c in costs[key]) if key in costs else None
                   for key in timed]
        peaks = [max((c["peak_mib"] for (kind, _), found in costs.items() if kind == stage
                      for c in found), default=None) for stage in ("slam", "lift", "arm")]
        cells = [number(value, 1) for value in (seconds[0], frames / seconds[0], *seconds[1:])]
        rows.append([name, frames, *cells, *(number(p, 0) for p in peaks)])
    refine = [("s3-refine [s]: " if arm == arms[0] else "") + arm for arm in arms]
    header = ["sequence", "frames", "s3-slam [s]", "frames/s", "s3-lift [s]", *refine,
              "peak [MiB]: s3-slam", "s3-lift", "s3-refine"]
    return markdown(header, rows) if rows else ""


def baseline_table(baselines):
    rows = [[b["sequence"], b["reference"], b["system"], len(b["ate"]),
             statistics.median_low(b["frames"]), number(statistics.median(b["ate"]), 4) +
             (f" ({min(b['ate']):.4f} - {max(b['ate']):.4f})" if len(b["ate"]) > 1 else "")]
            for b in baselines]
    return markdown(["sequence", "reference", "system", "runs", "frames", "ATE"], rows)


def document(campaign, rows, missing, baselines, published, version):
    summary = summarise(rows)
    parts = [f"{version}; seeds {', '.join(map(str, campaign.seeds))}; {campaign.threads} threads."]

    def add(title, table):
        if table:
            parts.append(title + "\n\n" + table.rstrip())

    systems, published_cells = published_columns(campaign, published)
    sources = "; ".join(f"{name}: {published['systems'][name]}" for name in systems)
    add("Trajectory error of the keyframes (RMSE after Sim(3), unit of the reference), median of the "
        "seeds." + (f" Published figures for the keyframes in the last columns ({sources})."
                    if systems else ""),
        arm_table(campaign, summary, "ate_keyframes", 4, extra=systems,
                  extra_cells=published_cells))
    add("Trajectory error of all localised frames, median of the seeds (range).",
        arm_table(campaign, summary, "ate", 4, with_range=True))
    add("Relative error per length of way (RMSE).",
        arm_table(campaign, summary, "rpe_per_length", 4))
    add("KITTI's segments of 100 to 800 m: translation [%].",
        arm_table(campaign, summary, "segments_percent", 3))
    add("Normals of known planes, median error [deg].",
        arm_table(campaign, summary, "normal_deg", 2))
    add("Normals of planes that are parallel in reality (where that is not known: of all pairs less "
        "than 45 deg apart): largest / smallest / median angle [deg].",
        angles_table(campaign, rows, published))
    add("Flatness: RMS distance of the points of a plane from the plane that fits them best, median "
        "of the planes.", arm_table(campaign, summary, "flatness", 5))
    add("Cost: wall time of each program, of s3-refine by arm, median of seeds and masks; frames per "
        "second of s3-slam; the largest peak of memory.", cost_table(campaign))
    if baselines:
        add("Other systems' trajectories on the same images, all frames they tracked.",
            baseline_table(baselines))
    if missing:
        add("Missing.", markdown(["sequence", "masks", "arm", "seed", "why"],
                                 [[m["sequence"], m.get("masks", "-"), m.get("arm", "-"),
                                   m.get("seed", "-"), m["reason"]] for m in missing]))
    return "\n\n".join(parts) + "\n", summary


def to_csv(rows):
    fields = ["sequence", "reference", "masks", "arm", "seed", "frames", *FIGURES]
    stream = io.StringIO()
    writer = csv.DictWriter(stream, fields, extrasaction="ignore", lineterminator="\n")
    writer.writeheader()
    writer.writerows(rows)
    return stream.getvalue()


def write(campaign, baselines):
    """tables.md, tables.csv and tables.json in the output folder; returns the Markdown."""
    published = json.loads((HERE / "published.json").read_text())
    rows, missing = collect(campaign)
    version = stages.Programs(campaign.bin, 1, 0).version()
    text, summary = document(campaign, rows, missing, baselines, published, version)
    (campaign.output / "tables.csv").write_text(to_csv(rows))
    stages.write_json(campaign.output / "tables.json",
                      {"version": version, "summary": summary, "runs": rows, "missing": missing,
                       "baselines": baselines, "published": published})
    (campaign.output / "tables.md").write_text(text)
    return text
