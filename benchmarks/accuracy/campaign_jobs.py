"""The jobs of a campaign: sequences x seeds x masks x arms, each from files to one JSON file.

campaign.py runs them on one machine, the Snakefile on one machine or a cluster. A job's file is
written last and whole, and says what it was made by: a job is done if that is what would make it now.
"""

import dataclasses
import json
import pathlib
import re

import identity
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
            return campaign.output / "scenes" / self.sequence / "job.json"
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


# ---- what a job runs -------------------------------------------------------------------------------


def folder_of(campaign, job, kind):
    names = {"slam": "1_slam", "lift": f"2_lift_{job.masks}",
             "arm": f"3_{job.masks}_{job.arm}"}
    return campaign.job(job.sequence, job.seed, names[kind])


def scene_commands(campaign, job):
    return [stages.synth_command(job.sequence, job.output(campaign).parent)]


def slam_commands(campaign, job):
    sequence = campaign.find(job.sequence)
    arguments = ["--camera", sequence.camera] if sequence.camera else []
    if campaign.frames:
        arguments += ["--frames", campaign.frames]
    return [stages.slam_command(sequence.folder, folder_of(campaign, job, "slam"), sequence.slam,
                                arguments)]


def lift_commands(campaign, job):
    sequence = campaign.find(job.sequence)
    return [stages.lift_command(folder_of(campaign, job, "slam"), sequence.masks[job.masks],
                                sequence.classes, folder_of(campaign, job, "lift"))]


def arm_commands(campaign, job):
    """s3-refine, but for the arm `slam`, then what measures its result."""
    sequence, settings = campaign.find(job.sequence), ARMS[job.arm]
    slam, lifted, refined = (folder_of(campaign, job, kind) for kind in ("slam", "lift", "arm"))
    if settings is None:
        return eval_commands(sequence, slam, None)
    semantics = lifted if job.masks != NO_MASKS else None
    return [stages.refine_command(slam, semantics, refined, settings),
            *eval_commands(sequence, refined, semantics)]


def eval_commands(sequence, folder, semantics):
    """Two per reference: all frames and the keyframes; planes with the first, where there are any."""
    commands = []
    for reference in sequence.references:
        arguments = ["--ground-truth", reference]
        if semantics is not None and reference == sequence.references[0]:
            arguments += ["--planes", folder / "planes.json", "--model", folder,
                          "--semantics", semantics, *truth_of_planes(sequence)]
        commands += [["s3-eval", "--estimate", folder / "frames.txt", *arguments],
                     ["s3-eval", "--estimate", folder / "keyframes.txt", "--ground-truth", reference]]
    return commands


def truth_of_planes(sequence):
    if sequence.known_planes:
        return ["--known-planes", sequence.known_planes, "--classes", sequence.classes,
                "--set", f"planes.frame={sequence.frame}"]
    return ["--plane-class", sequence.parallel_class] if sequence.parallel_class else []


def commands_of(campaign, job):
    kinds = {"scene": scene_commands, "slam": slam_commands, "lift": lift_commands,
             "arm": arm_commands}
    return kinds[job.kind](campaign, job)


def programs_of(campaign, job):
    # The scenes are the same for all seeds.
    seed = 1 if job.kind == "scene" else job.seed
    return stages.Programs(campaign.bin, campaign.threads, seed)


def identity_of(campaign, job):
    return programs_of(campaign, job).identity(
        commands_of(campaign, job), [identity_of(campaign, needed) for needed in job.needs()])


# ---- which are done --------------------------------------------------------------------------------


def is_done(campaign, job):
    """What a job needs comes first: without it, it may not be known what the job would run."""
    return (all(is_done(campaign, needed) for needed in job.needs()) and
            job.output(campaign).is_file() and
            identity.is_done(job.output(campaign), identity_of(campaign, job)))


def read_result(campaign, job):
    """None if the job is not done."""
    return json.loads(job.output(campaign).read_text()) if is_done(campaign, job) else None


def remove_others(campaign):
    """Removes what the jobs of other settings or programs left in the place of these."""
    others = [job for job in all_jobs(campaign) if not is_done(campaign, job)]
    for job in others:
        job.output(campaign).unlink(missing_ok=True)


# ---- running one job -------------------------------------------------------------------------------


def run_job(campaign, job):
    output = job.output(campaign)
    output.parent.mkdir(parents=True, exist_ok=True)
    output.unlink(missing_ok=True)  # It speaks of what is replaced now.
    made_by = identity_of(campaign, job)
    result = (run_arm if job.kind == "arm" else run_stage)(campaign, job)
    stages.write_json(output, {**dataclasses.asdict(job), "made_by": made_by, **result})


def run_stage(campaign, job):
    [command] = commands_of(campaign, job)
    report, cost = programs_of(campaign, job).run(*command)
    return {"report": report, "cost": dataclasses.asdict(cost)}


def knows_mode(programs, settings):
    """False if this build's s3-refine does not have the planes.mode that is asked for."""
    mode = next((s.partition("=")[2] for s in settings if s.startswith("planes.mode=")), None)
    known = re.search(r"planes\.mode = \w+ \(([\w|]+)\)", programs.help("s3-refine"))
    return mode is None or known is None or mode in known.group(1).split("|")


def run_arm(campaign, job):
    programs, settings = programs_of(campaign, job), ARMS[job.arm]
    if settings and not knows_mode(programs, settings):
        return {"skipped": "this build of s3-refine does not have the mode"}
    results = [programs.run(*command) for command in commands_of(campaign, job)]
    refined = {}
    if settings is not None:
        report, cost = results.pop(0)
        refined = {"report": report, "cost": dataclasses.asdict(cost)}
    return {**refined, "errors": errors_of(campaign.find(job.sequence), results)}


def errors_of(sequence, results):
    """By reference, from what eval_commands gave."""
    reports = [report for report, _ in results]
    errors = {}
    for reference, frames, keyframes in zip(sequence.references, reports[::2], reports[1::2]):
        frames.get("planes", {}).pop("pairs", None)
        errors[reference.name] = {"frames": frames, "keyframes": keyframes["trajectory"]}
    return errors
