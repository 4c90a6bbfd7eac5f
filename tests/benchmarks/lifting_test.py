#!/usr/bin/env python3
"""When lifting.py takes a map that is there for the one it would make."""

import importlib.util
import os
import pathlib
import stat
import sys
import tempfile
import unittest

SKIPPED = 77  # What ctest takes for skipped.
SYSTEM_PYTHON = "/usr/bin/python3"
if any(importlib.util.find_spec(name) is None for name in ("numpy", "PIL")):
    if sys.executable != SYSTEM_PYTHON and os.path.exists(SYSTEM_PYTHON):
        os.execv(SYSTEM_PYTHON, [SYSTEM_PYTHON, *sys.argv])
    print("skipped: python3 has no numpy or no Pillow")
    sys.exit(SKIPPED)

ACCURACY = pathlib.Path(__file__).resolve().parents[2] / "benchmarks" / "accuracy"
sys.path.insert(0, str(ACCURACY))

import lifting  # noqa: E402

PRETENDER = """#!/bin/sh
echo "$@" >> "{log}"
while [ "$1" != --output ]; do shift; done
mkdir -p "$2"
"""


class MapOfScene(unittest.TestCase):
    def setUp(self):
        folder = tempfile.TemporaryDirectory()
        self.addCleanup(folder.cleanup)
        self.folder = pathlib.Path(folder.name)
        self.log = self.folder / "log"
        self.log.write_text("")
        for name in ("s3-synth", "s3-slam"):
            self.build(name, "")

    def build(self, name, code):
        program = self.folder / name
        program.write_text(PRETENDER.format(log=self.log) + code)
        program.chmod(program.stat().st_mode | stat.S_IXUSR)

    def num_runs(self, seed=1):
        before = len(self.log.read_text().splitlines())
        lifting.map_scene(self.folder, "desk", seed, self.folder / "desk", self.folder / "desk_slam")
        return len(self.log.read_text().splitlines()) - before

    def test_is_made_once(self):
        self.assertEqual([self.num_runs(), self.num_runs()], [1, 0])

    def test_is_made_anew_by_other_programs_and_of_other_scenes(self):
        self.num_runs()
        for name in ("s3-synth", "s3-slam"):
            self.build(name, "# Built anew.\n")
            self.assertEqual([self.num_runs(), self.num_runs()], [1, 0], name)
        self.assertEqual(self.num_runs(seed=2), 1)

    def test_is_made_anew_where_it_is_not_known_by_what_it_was_made(self):
        (self.folder / "desk_slam").mkdir()
        self.assertEqual(self.num_runs(), 1)

    def test_is_not_taken_for_done_after_a_failure(self):
        self.num_runs()
        self.build("s3-slam", "exit 1\n")
        with self.assertRaises(lifting.subprocess.CalledProcessError):
            self.num_runs()
        self.build("s3-slam", "")
        self.assertEqual(self.num_runs(), 1)


if __name__ == "__main__":
    unittest.main()
