"""Runs the programs and measures what they cost."""

import dataclasses
import json
import os
import pathlib
import subprocess
import sys
import tempfile
import time

import identity


class StageFailed(Exception):
    """A program ended with an error; the message is what it printed last."""


@dataclasses.dataclass
class Cost:
    wall_s: float
    cpu_s: float
    peak_mib: float


class Programs:
    """The built programs, all run with the same threads and seed."""

    def __init__(self, folder, threads, seed):
        self._folder, self._threads = folder, threads
        self._common = ["--quiet", "--progress", "none", "--threads", str(threads),
                        "--seed", str(seed)]

    def command(self, name, *arguments):
        return [name, *map(str, arguments), *self._common, "--json"]

    def identity(self, commands, inputs=()):
        """Of what `run` makes of these (name, arguments...), see identity.py."""
        return identity.of(self._folder, [self.command(*words) for words in commands], inputs)

    def run(self, name, *arguments):
        """Runs one program; returns its JSON report and its cost."""
        command = self.command(name, *arguments)
        command[0] = str(self._folder / name)
        start = time.monotonic()
        with tempfile.TemporaryFile() as messages:
            process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=messages)
            report = process.stdout.read()
            # Not getrusage: that has only the largest of all children so far.
            _, status, usage = os.wait4(process.pid, 0)
            process.returncode = os.waitstatus_to_exitcode(status)
            if process.returncode != 0:
                messages.seek(0)
                text = messages.read().decode(errors="replace").strip()
                raise StageFailed(f"{' '.join(command)}\n{text} (exit code {process.returncode})")
        cost = Cost(time.monotonic() - start, usage.ru_utime + usage.ru_stime,
                    usage.ru_maxrss / 1024)
        return json.loads(report) if report else {}, cost

    def with_seed(self, seed):
        return Programs(self._folder, self._threads, seed)

    def slam(self, sequence, output, settings=()):
        return self.run(*slam_command(sequence, output, settings))

    def lift(self, model, masks, classes, output):
        return self.run(*lift_command(model, masks, classes, output))

    def refine(self, model, semantics, output, settings=()):
        return self.run(*refine_command(model, semantics, output, settings))

    def synthesise(self, scene, output, settings=()):
        return self.run(*synth_command(scene, output, settings))

    def trajectory_error(self, estimate, ground_truth, *arguments):
        """The report of s3-eval after Sim(3) alignment."""
        report, _ = self.run("s3-eval", "--estimate", estimate, "--ground-truth", ground_truth,
                             *arguments)
        return report["trajectory"]

    def time_offset(self, estimate, ground_truth):
        """How far the clock of the ground truth is ahead, by positions and by rotations, and the ATE
        without and with the former, and that of exact poses without."""
        report = self.trajectory_error(estimate, ground_truth, "--time-offset", "auto")
        offset = report["time_offset"]
        return {"seconds": offset["seconds"], "sigma_s": offset["sigma_s"],
                "of_rotations": offset["of_rotations"],
                "ate_without": offset["without"]["ate_rmse"],
                "ate_of_exact": offset["exact_poses_without"]["ate_rmse"],
                "ate": report["ate"]["translation"]["rmse"]}

    def help(self, name):
        return subprocess.run([self._folder / name, "--help"], check=True, capture_output=True,
                              text=True).stdout

    def version(self):
        line = subprocess.run([self._folder / "s3-slam", "--version"], check=True,
                              capture_output=True, text=True).stdout
        return line.strip()


def slam_command(sequence, output, settings=(), arguments=()):
    return ["s3-slam", "--sequence", sequence, "--output", output, "--overwrite", *arguments,
            *set_options(settings)]


def lift_command(model, masks, classes, output):
    return ["s3-lift", "--model", model, "--masks", masks, "--classes", classes, "--output", output,
            "--overwrite"]


def refine_command(model, semantics, output, settings=()):
    arguments = ["--semantics", semantics] if semantics else []
    return ["s3-refine", "--model", model, *arguments, "--output", output, "--overwrite",
            *set_options(settings)]


def synth_command(scene, output, settings=()):
    return ["s3-synth", "--scene", scene, "--output", output, "--overwrite", *set_options(settings)]


def set_options(settings):
    return [word for setting in settings for word in ("--set", setting)]


def write_json(path, value):
    """Whole or not at all."""
    beside = pathlib.Path(f"{path}.tmp-{os.getpid()}")
    beside.write_text(json.dumps(value, indent=1) + "\n")
    beside.replace(path)


def say(text):
    print(text, file=sys.stderr, flush=True)
