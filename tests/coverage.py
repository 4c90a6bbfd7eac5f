#!/usr/bin/env python3
"""Builds with gcc's coverage, runs tests, and prints which lines they reach.

    tests/coverage.py [--build DIR] [--tests REGEX] [--targets "NAME ..."]

Prints the share of lines reached by module, in all, and every error that no test provokes: the lines of
src/ and tools/ that throw and were not reached. Without --targets and --tests, everything is built, and
all tests run but those on real sequences. Needs gcov and Python's standard library.
"""
import argparse
import collections
import gzip
import json
import os
import subprocess
import sys
import tempfile
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
THROWS = ("ThrowInputError(", "throw ")


def build(folder, targets):
    subprocess.run(["cmake", "-S", ROOT, "-B", folder, "-G", "Ninja", "-DCMAKE_BUILD_TYPE=Debug",
                    "-DCMAKE_CXX_FLAGS=--coverage -O1", "-DS3LAM_PRECOMPILE_HEADERS=OFF"],
                   check=True, stdout=subprocess.DEVNULL)
    for old in folder.rglob("*.gcda"):
        old.unlink()
    subprocess.run(["ninja", "-C", folder, *targets], check=True, stdout=subprocess.DEVNULL)


def read_counts(folder):
    """Executions by file and line, summed over everything that the file was compiled into."""
    counts = collections.defaultdict(collections.Counter)
    with tempfile.TemporaryDirectory() as scratch:
        for data in sorted(folder.rglob("*.gcda")):
            subprocess.run(["gcov", "--json-format", data.resolve()], cwd=scratch, check=True,
                           stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
            for result in Path(scratch).glob("*.gcov.json.gz"):
                document = json.loads(gzip.decompress(result.read_bytes()))
                here = Path(document["current_working_directory"])
                for file in document["files"]:
                    path = Path(os.path.normpath(here / file["file"]))
                    if not path.is_relative_to(ROOT):
                        continue
                    for line in file["lines"]:
                        counts[path.relative_to(ROOT)][line["line_number"]] += line["count"]
                result.unlink()
    return counts


def module_of(path):
    parts = path.parts
    return "/".join(parts[:2]) if parts[0] == "src" else parts[0]


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--build", type=Path, default=ROOT / "build-coverage")
    parser.add_argument("--tests", default="")
    parser.add_argument("--targets", default="")
    arguments = parser.parse_args()
    build(arguments.build, arguments.targets.split())
    tests = subprocess.run(["ctest", "--test-dir", arguments.build, "-LE", "real", "-R",
                            arguments.tests], check=False, stdout=subprocess.PIPE, text=True)
    if tests.returncode != 0:
        print(tests.stdout, file=sys.stderr)
    counts = read_counts(arguments.build.resolve())
    modules = collections.defaultdict(lambda: [0, 0])
    unreached = []
    for path, lines in sorted(counts.items()):
        if path.parts[0] not in ("src", "tools"):
            continue
        text = (ROOT / path).read_text().splitlines()
        for number, count in sorted(lines.items()):
            for total in (modules[module_of(path)], modules["total"]):
                total[0] += count > 0
                total[1] += 1
            if count == 0 and any(word in text[number - 1] for word in THROWS):
                unreached.append(f"{path}:{number}: {text[number - 1].strip()}")
    print("errors that no test provokes:")
    print("\n".join(f"  {line}" for line in unreached))
    for module, (reached, lines) in sorted(modules.items(), key=lambda item: item[0] == "total"):
        print(f"{module:16} {reached:6} of {lines:6} lines reached, {100 * reached / lines:5.1f} %")
    sys.exit(tests.returncode)


if __name__ == "__main__":
    main()
