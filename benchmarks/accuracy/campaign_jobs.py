"""The jobs of a campaign: sequences x seeds x masks x arms, each from files to one JSON file.

campaign.py runs them on one machine, the Snakefile on one machine or a cluster. A job's file is
written last and whole, so a file that is there is a job that is done.
"""

import dataclasses
import json
import pathlib
import re

import sequences
import stages

# Settings of s3-refine. `slam` is what s3-slam leaves, `off` a bundle adjustment without planes,
# `fixed` the paper's (planes held fixed, nothing else), `full` the defaults.
_BARE = ("relations.enabled=false", "camera_height.mode=off")
ARMS = {
    "slam": None,
    "off": ("planes.mode=off",),
    "fixed": ("planes.mode=fixed", *_BARE),
    "joint": ("planes.mode=joint", *_BARE),
    "relations": ("planes.mode=joint", "relations.enabled=true", "camera_height.mode=off"),
    "height": ("planes.mode=joint", "relations.enabled=false", "camera_height.mode=auto"),
    "hard": ("planes.mode=hard", *_BARE),
    "full": (),
}
WITHOUT_MASKS = ("slam", "off")
ROADS_ONLY = ("height",)
NO_MASKS = "none"


@dataclasses.dataclass(frozen=True)
class Campaign:
    """What campaign.json says."""

    bin: pathlib.Path
    data: pathlib.Path
    output: pathlib.Path
    sequences: tuple
    arms: tuple = tuple(ARMS)
    seeds: tuple = (0,)
    threads: int = 1
    frames: str | None = None  # A:B:STEP, for a quick look.

    def find(self, name):
        return sequences.find(name, self.data, self.output / "scenes")

    def job(self, *parts):
        return self.output / "jobs" / pathlib.Path(*map(str, parts))


def read_campaign(values):
    fields = {f.name for f in dataclasses.fields(Campaign)}
    unknown = values.keys() - fields
    if unknown:
        raise KeyError(f"campaign: unknown {', '.join(sorted(unknown))}; there are "
                       f"{', '.join(sorted(fields))}")
    values = {key: tuple(value) if isinstance(value, list) else value
              for key, value in values.items()}
    for key in ("bin", "data", "output"):
        values[key] = pathlib.Path(values[key]).resolve()
    campaign = Campaign(**values)
    for arm in campaign.arms:
        if arm not in ARMS:
            raise KeyError(f"campaign: no arm {arm}; there are {', '.join(ARMS)}")
    for name in campaign.sequences:
        campaign.find(name)
    return campaign


@dataclasses.dataclass(frozen=True)
class Job:
    kind: str       # scene, slam, lift, arm
    sequence: str
    seed: int = 0
    masks: str = NO_MASKS
    arm: str = ""

    def output(self, campaign):
        if self.kind == "scene":
            return campaign.output / "scenes" / self.sequence / "report.json"
        name = {"slam": "slam.json", "lift": f"lift.{self.masks}.json",
                "arm": f"arm.{self.masks}.{self.arm}.json"}[self.kind]
        return campaign.job(self.sequence, self.seed, name)

    def needs(self):
        if self.kind == "slam":
            rendered = self.sequence in sequences.SCENES
            return [Job("scene", self.sequence)] if rendered else []
        if self.kind == "lift":
            return [Job("slam", self.sequence, self.seed)]
        if self.kind == "arm" and self.masks != NO_MASKS:
            return [Job("lift", self.sequence, self.seed, self.masks)]
        return [Job("slam", self.sequence, self.seed)] if self.kind == "arm" else []


def masks_of(campaign, name):
    """Before a scene is rendered its masks are known already."""
    if name in sequences.SCENES:
        return ["clean", "noisy"]
    return list(campaign.find(name).masks)


def available(campaign, name):
    return name in sequences.SCENES or campaign.find(name).folder.is_dir()


def arm_jobs(campaign):
    """The last jobs; what comes before follows from what they need."""
    jobs = []
    for name in campaign.sequences:
        if not available(campaign, name):
            continue
        road = name == "street" or campaign.find(name).road
        for seed in campaign.seeds:
            for arm in campaign.arms:
                if arm in ROADS_ONLY and not road:
                    continue
                kinds = [NO_MASKS] if arm in WITHOUT_MASKS else masks_of(campaign, name)
                jobs += [Job("arm", name, seed, masks, arm) for masks in kinds]
    return jobs


def all_jobs(campaign):
    """Every job, each after those that it needs."""
    ordered = {}

    def add(job):
        for needed in job.needs():
            add(needed)
        ordered.setdefault(job)

    for job in arm_jobs(campaign):
        add(job)
    return list(ordered)


# ---- running one job -------------------------------------------------------------------------------


def run_job(campaign, job):
    programs = stages.Programs(campaign.bin, campaign.threads, job.seed)
    output = job.output(campaign)
    output.parent.mkdir(parents=True, exist_ok=True)
    if job.kind == "scene":
        # The scenes are the same for all seeds.
        programs.with_seed(1).synthesise(job.sequence, output.parent)
        return
    result = {"slam": run_slam, "lift": run_lift, "arm": run_arm}[job.kind](campaign, programs, job)
    stages.write_json(output, {**dataclasses.asdict(job), **result})


def folder_of(campaign, job, kind):
    names = {"slam": "1_slam", "lift": f"2_lift_{job.masks}",
             "arm": f"3_{job.masks}_{job.arm}"}
    return campaign.job(job.sequence, job.seed, names[kind])


def run_slam(campaign, programs, job):
    sequence = campaign.find(job.sequence)
    arguments = ["--camera", sequence.camera] if sequence.camera else []
    if campaign.frames:
        arguments += ["--frames", campaign.frames]
    for setting in sequence.slam:
        arguments += ["--set", setting]
    report, cost = programs.run("s3-slam", "--sequence", sequence.folder, "--output",
                                folder_of(campaign, job, "slam"), "--overwrite", *arguments)
    return {"report": report, "cost": dataclasses.asdict(cost)}


def run_lift(campaign, programs, job):
    sequence = campaign.find(job.sequence)
    report, cost = programs.lift(folder_of(campaign, job, "slam"), sequence.masks[job.masks],
                                 sequence.classes, folder_of(campaign, job, "lift"))
    return {"report": report, "cost": dataclasses.asdict(cost)}


def knows_mode(programs, settings):
    """False if this build's s3-refine does not have the planes.mode that is asked for."""
    mode = next((s.partition("=")[2] for s in settings if s.startswith("planes.mode=")), None)
    known = re.search(r"planes\.mode = \w+ \(([\w|]+)\)", programs.help("s3-refine"))
    return mode is None or known is None or mode in known.group(1).split("|")


def run_arm(campaign, programs, job):
    sequence = campaign.find(job.sequence)
    slam, lifted = (folder_of(campaign, job, kind) for kind in ("slam", "lift"))
    settings = ARMS[job.arm]
    if settings is None:
        return {"errors": measure(programs, sequence, job, slam, None, None)}
    if not knows_mode(programs, settings):
        return {"skipped": "this build of s3-refine does not have the mode"}
    semantics = lifted if job.masks != NO_MASKS else None
    refined = folder_of(campaign, job, "arm")
    report, cost = programs.refine(slam, semantics, refined, settings)
    return {"report": report, "cost": dataclasses.asdict(cost),
            "errors": measure(programs, sequence, job, refined, refined / "planes.json", semantics)}


def measure(programs, sequence, job, folder, planes, semantics):
    """Errors against every reference, of all frames and of the keyframes; planes with the first."""
    errors = {}
    for i, reference in enumerate(sequence.references):
        arguments = ["--ground-truth", reference]
        with_planes = planes is not None and semantics is not None and i == 0
        if with_planes:
            arguments += ["--planes", planes, "--model", folder, "--semantics", semantics]
        if with_planes and sequence.known_planes:
            arguments += ["--known-planes", sequence.known_planes, "--classes", sequence.classes,
                          "--set", f"planes.frame={sequence.frame}"]
        elif with_planes and sequence.parallel_class:
            arguments += ["--plane-class", sequence.parallel_class]
        frames, _ = programs.run("s3-eval", "--estimate", folder / "frames.txt", *arguments)
        keyframes, _ = programs.run("s3-eval", "--estimate", folder / "keyframes.txt",
                                    "--ground-truth", reference)
        frames.get("planes", {}).pop("pairs", None)
        errors[reference.name] = {"frames": frames, "keyframes": keyframes["trajectory"]}
    return errors
