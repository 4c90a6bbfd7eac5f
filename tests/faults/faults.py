"""Lets the disk fail under each stage, and looks at what is left.

    faults.py BIN_DIR INJECT.so CHAIN_DIR CLASS_TABLE [N]

For every kind of system call on files (write, fsync, rename, open, mkdir) the N (default: all) calls
that lie evenly between a stage's first and its last fail, one in each run. The stage has to end with
exit code 1 or 3 and one line on standard error that names a path and the reason, and to leave the old
output or the complete new one, and nothing else. Short writes are no failure: the output has to be
complete. Where file systems can be mounted, the same with one that fills up and one that is read-only.

CHAIN_DIR is what tests/chain/make.sh made. Needs Python's standard library only.
"""
import hashlib
import os
import subprocess
import sys
import tempfile
from pathlib import Path

COMMON = ["--quiet", "--progress", "none", "--threads", "1", "--overwrite"]
KINDS = {"write": ["ENOSPC", "EIO"], "fsync": ["EIO"], "rename": ["EIO"], "open": ["ENOSPC"],
         "mkdir": ["ENOSPC"]}
REASONS = ["No space left on device", "Input/output error", "Read-only file system",
           "readonly database"]  # The last by SQLite, which falls back to reading.


class Stage:
    def __init__(self, name, arguments, inject):
        self.name, self.arguments, self.inject = name, arguments, inject

    def run(self, output, fault="", counts=""):
        environment = dict(os.environ, LD_PRELOAD=self.inject, S3LAM_FAULT=fault,
                           S3LAM_FAULT_COUNTS=counts, OPENBLAS_NUM_THREADS="1")
        return subprocess.run(self.arguments + COMMON + ["--output", output], text=True,
                              env=environment, capture_output=True, check=False)


def digest(folder):
    """Of all files but the reports, which have times."""
    total = hashlib.sha256()
    for path in sorted(folder.rglob("*")):
        if path.is_file() and path.stem != "report":
            total.update(f"{path.relative_to(folder)}\n".encode() + path.read_bytes())
    return total.hexdigest()


def make_old(place):
    subprocess.run(["rm", "-rf", place / "out"], check=True)
    (place / "out").mkdir(parents=True)
    (place / "out" / "old").write_text("old\n")
    return digest(place / "out")


def complaint(result, place, old, complete):
    """What is wrong with how a failing run ended; empty if nothing is."""
    lines = result.stderr.splitlines()
    if result.returncode not in (1, 3):
        return f"exit code {result.returncode}: {result.stderr}"
    if len(lines) != 1 or "/" not in lines[0] or not any(r in lines[0] for r in REASONS):
        return f"not one line that says where and why: {result.stderr!r}"
    left = sorted(os.listdir(place))
    if left != ["out"]:
        return f"left {left}"
    if digest(place / "out") not in (old, complete):
        return "neither the old nor the complete output"
    return ""


def chosen(total, most):
    if most is None or total <= most:
        return range(1, total + 1)
    return sorted({1 + round(i * (total - 1) / max(1, most - 1)) for i in range(most)})


def inject_faults(stage, place, most):
    """Returns complaints."""
    counts = place.parent / "counts"
    make_old(place)
    result = stage.run(place / "out", counts=str(counts))
    if result.returncode != 0:
        return [f"s3-{stage.name} fails by itself: {result.stderr}"]
    complete = digest(place / "out")
    total = {kind: int(n) for kind, n in (l.split() for l in counts.read_text().splitlines())}
    wrong, runs = [], 0
    for kind, errors in KINDS.items():
        for index in chosen(total[kind], most):
            fault = f"{kind}:{index}:{errors[index % len(errors)]}"
            old = make_old(place)
            what = complaint(stage.run(place / "out", fault), place, old, complete)
            runs += 1
            if what:
                wrong.append(f"s3-{stage.name}, {fault}: {what}")
    for index in [0, *chosen(total["write"], most)]:
        make_old(place)
        result = stage.run(place / "out", f"write:{index}:short")
        runs += 1
        if result.returncode != 0 or digest(place / "out") != complete:
            wrong.append(f"s3-{stage.name}, short write {index}: {result.returncode} {result.stderr}")
    calls = ", ".join(f"{n} {kind}" for kind, n in total.items())
    print(f"s3-{stage.name}: {runs} runs with a fault ({calls} calls), {len(wrong)} wrong", flush=True)
    return wrong


def mounted(place, options):
    return subprocess.run(["mount", "-t", "tmpfs", "-o", options, "none", place],
                          capture_output=True, check=False).returncode == 0


def small_disks(stage, root):
    """A file system that is full, at sizes from nothing on, and a read-only one."""
    wrong, runs = [], 0
    for options in ["size=4k", "size=32k", "size=128k", "size=512k", "read-only"]:
        place = root / "disk"
        place.mkdir(exist_ok=True)
        if not mounted(place, "size=16m" if options == "read-only" else options):
            print("faults.py: cannot mount here: no small or read-only disks", flush=True)
            return wrong
        try:
            old = make_old(place)
            if options == "read-only":
                subprocess.run(["mount", "-o", "remount,ro", place], check=True)
            result = stage.run(place / "out")
            runs += 1
            what = complaint(result, place, old, None) if result.returncode != 0 else ""
            if what or (result.returncode == 0 and options in ("size=4k", "read-only")):
                wrong.append(f"s3-{stage.name}, disk of {options}: {what or 'no error'}")
        finally:
            subprocess.run(["umount", place], check=True)
    print(f"s3-{stage.name}: {runs} runs on small and read-only disks", flush=True)
    return wrong


def main():
    bin_dir, inject, chain, classes = sys.argv[1:5]
    most = int(sys.argv[5]) if len(sys.argv) > 5 else None
    scene, model, semantics = (f"{chain}/{name}" for name in ("scene", "1_slam", "2_lift_clean"))
    stages = [
        Stage("slam", [f"{bin_dir}/s3-slam", "--sequence", scene, "--frames", "0:50",
                       "--set", "accuracy=fast", "--database"], inject),
        Stage("lift", [f"{bin_dir}/s3-lift", "--model", model, "--masks", f"{scene}/panoptic_clean",
                       "--classes", classes], inject),
        Stage("refine", [f"{bin_dir}/s3-refine", "--model", model, "--semantics", semantics,
                         "--set", "outer.max_iterations=1"], inject),
    ]
    wrong = []
    for stage in stages:
        with tempfile.TemporaryDirectory() as root:
            place = Path(root) / "place"
            place.mkdir()
            wrong += inject_faults(stage, place, most)
            wrong += small_disks(stage, Path(root))
    for line in wrong:
        print(f"faults.py: {line}", file=sys.stderr)
    sys.exit(1 if wrong else 0)


if __name__ == "__main__":
    main()
