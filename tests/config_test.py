#!/usr/bin/env python3
"""Checks that a file in configs/ states every option of its program with its default.

usage: config_test.py PROGRAM CONFIG_FILE
"""

import json
import pathlib
import subprocess
import sys


def flatten(value, path=""):
    if isinstance(value, dict):
        for key, inner in value.items():
            yield from flatten(inner, f"{path}.{key}" if path else key)
    else:
        yield path, value


def main():
    program, config = pathlib.Path(sys.argv[1]), pathlib.Path(sys.argv[2])
    printed = subprocess.run([program, "--print-config"], check=True, capture_output=True).stdout
    expected, actual = dict(flatten(json.loads(printed))), dict(flatten(json.loads(config.read_text())))
    if not expected:
        sys.exit(f"{program.name} --print-config printed no options")
    wrong = [f"{key}: {actual.get(key, 'missing')} in the file, {expected.get(key, 'no option')} in the program"
             for key in sorted(expected.keys() | actual.keys())
             if key not in expected or key not in actual or expected[key] != actual[key]]
    if wrong:
        sys.exit(f"{config} is out of date (tools/update_configs.sh writes it anew):\n  " +
                 "\n  ".join(wrong))


if __name__ == "__main__":
    main()
