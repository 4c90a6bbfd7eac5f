#!/usr/bin/env python3
"""Runs sequences x arms x seeds, and prints the paper's tables with these figures in them.

Each job goes from files to one file, so an interrupted campaign goes on where it stopped; what was made
by other settings or programs is made anew. Jobs that do not need one another run side by side
(--cores). The same jobs run on a cluster by Snakemake:

  campaign.py --bin build/bin --data DIR --output OUT --sequences fr1_xyz fr1_desk --seeds 0 1 2
  snakemake -s Snakefile --configfile OUT/campaign.json --profile profiles/slurm

DIR holds the data sets as fetch_*.sh lays them out, or the folders of run.sh. Sequences that are not
there are named in the tables. Needs Python's standard library only.
"""

import argparse
import concurrent.futures
import json
import os
import pathlib
import sys

import baselines
import campaign_jobs as jobs
import campaign_tables
import sequences
import stages


def run_jobs(campaign, cores):
    """All jobs that are not done, each once what it needs is. Returns the failures."""
    waiting = [job for job in jobs.all_jobs(campaign) if not jobs.is_done(campaign, job)]
    total, failed, running = len(waiting), {}, {}
    with concurrent.futures.ThreadPoolExecutor(cores) as pool:
        while waiting or running:
            for job in list(waiting):
                needs = job.needs()
                if any(needed in failed for needed in needs):
                    failed[job] = "needs a job that failed"
                    waiting.remove(job)
                elif (len(running) < cores and
                      not any(needed in (*waiting, *running.values()) for needed in needs)):
                    waiting.remove(job)
                    running[pool.submit(jobs.run_job, campaign, job)] = job
            done, _ = concurrent.futures.wait(running, return_when="FIRST_COMPLETED")
            for future in done:
                job = running.pop(future)
                if future.exception() is not None:
                    failed[job] = str(future.exception())
                    stages.say(f"failed: {job}\n{failed[job]}")
                else:
                    stages.say(f"[{total - len(waiting) - len(running)}/{total}] {job.kind} "
                               f"{job.sequence} seed {job.seed} {job.masks} {job.arm}")
    return failed


def measure_baselines(campaign, folder):
    """As ours are, the trajectories of other systems of sequences that have a reference."""
    programs = stages.Programs(campaign.bin, 1, 0)
    measured = []
    for (name, system), paths in baselines.find(folder, campaign.sequences).items():
        references = campaign.find(name).references
        if not references:
            continue
        reports = [programs.trajectory_error(path, references[0]) for path in paths]
        measured.append({"sequence": name, "reference": references[0].name, "system": system,
                         "ate": [report["ate"]["translation"]["rmse"] for report in reports],
                         "frames": [report["num_estimate"] for report in reports]})
    return measured


def parse_arguments():
    parser = argparse.ArgumentParser(description=__doc__,
                                     formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--bin", help="folder of the programs")
    parser.add_argument("--data", help="folder of the data sets")
    parser.add_argument("--output", help="folder for everything that is made")
    parser.add_argument("--sequences", nargs="+", help="see --list")
    parser.add_argument("--arms", nargs="+", choices=list(jobs.ARMS), default=list(jobs.ARMS))
    parser.add_argument("--seeds", nargs="+", type=int, default=[0],
                        help="of the samples that the stages draw")
    parser.add_argument("--threads", type=int, default=1, help="of each program")
    parser.add_argument("--frames", metavar="A:B:STEP", help="only these, for a quick look")
    parser.add_argument("--cores", type=int, default=os.cpu_count(), help="jobs at a time")
    parser.add_argument("--baselines", type=pathlib.Path, metavar="DIR",
                        help="trajectories of other systems, measured beside ours")
    parser.add_argument("--config", type=pathlib.Path, help="campaign.json instead of the above")
    parser.add_argument("--job", metavar="KIND/SEQUENCE/SEED/MASKS/ARM",
                        help="run this one job only (for Snakemake)")
    parser.add_argument("--prepare", action="store_true",
                        help="write OUTPUT/campaign.json, remove results of other settings or "
                             "programs and end")
    parser.add_argument("--tables", action="store_true", help="only write the tables")
    parser.add_argument("--list", action="store_true", help="print the sequences and end")
    return parser, parser.parse_args()


def campaign_values(parser, arguments):
    if arguments.config:
        return json.loads(arguments.config.read_text())
    for name in ("bin", "data", "output", "sequences"):
        if not getattr(arguments, name):
            parser.error(f"--{name} is required")
    return {name: getattr(arguments, name)
            for name in ("bin", "data", "output", "sequences", "arms", "seeds", "threads", "frames")}


def main():
    parser, arguments = parse_arguments()
    if arguments.list:
        print("\n".join(sequences.all_names()))
        return 0
    values = campaign_values(parser, arguments)
    try:
        campaign = jobs.read_campaign(values)
    except KeyError as error:
        parser.error(str(error.args[0]))
    campaign.output.mkdir(parents=True, exist_ok=True)
    if arguments.job:
        kind, sequence, seed, masks, arm = arguments.job.split("/")
        try:
            jobs.run_job(campaign, jobs.Job(kind, sequence, int(seed), masks, arm))
        except stages.StageFailed as error:
            sys.exit(str(error))
        return 0
    resolved = {**values, **{k: str(getattr(campaign, k)) for k in ("bin", "data", "output")}}
    stages.write_json(campaign.output / "campaign.json", resolved)
    if arguments.prepare:
        jobs.remove_others(campaign)
        return 0
    failed = {} if arguments.tables else run_jobs(campaign, arguments.cores)
    others = measure_baselines(campaign, arguments.baselines) if arguments.baselines else []
    print(campaign_tables.write(campaign, others))
    stages.say(f"Written to {campaign.output}/tables.md, .csv, .json")
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
