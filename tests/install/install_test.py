#!/usr/bin/env python3
"""Installs the build into a scratch folder, moves it, and uses it: programs, configurations, man
pages, completion, and the CMake package from a project of its own.

usage: install_test.py CMAKE BUILD_DIR SOURCE_DIR
"""

import pathlib
import subprocess
import sys
import tempfile

TRAJECTORY = "".join(f"{i} {i} {i * i} {i % 2} 0 0 0 1\n" for i in range(6))


def run(*command, **kwargs):
    result = subprocess.run([str(word) for word in command], capture_output=True, text=True,
                            **kwargs)
    if result.returncode != 0:
        sys.exit(f"{' '.join(map(str, command))}\n{result.stdout}{result.stderr}")
    return result.stdout


def check(condition, text):
    if not condition:
        sys.exit(text)


def check_programs(prefix, work):
    programs = sorted(path.name for path in (prefix / "bin").iterdir())
    check({"s3-slam", "s3-lift", "s3-refine", "s3-eval", "s3-synth"} <= set(programs),
          f"installed: {programs}")
    for name in programs:
        check("--help" in run(prefix / "bin" / name, "--help"), name)
        page = (prefix / "share" / "man" / "man1" / f"{name}.1").read_text()
        check(page.startswith(f".TH {name.upper()} 1") and "\\-\\-help" in page, f"{name}.1")
        _, _, exit_status = page.partition(".SH EXIT STATUS\n")
        check(exit_status.startswith("0 done") and "143" in exit_status, f"{name}.1: {exit_status}")
        completion = prefix / "share" / "bash-completion" / "completions" / name
        check(completion.is_file(), f"no {completion}")
    # Class tables are found by name beside the installed program, from any folder.
    refused = subprocess.run([prefix / "bin" / "s3-lift", "--model", "nowhere", "--masks", "nowhere",
                              "--classes", "coco", "--output", work / "out"], cwd=work,
                             capture_output=True, text=True)
    check(refused.returncode == 3 and "nowhere" in refused.stderr and "coco" not in refused.stderr,
          refused.stderr)


def complete(prefix, line):
    """What bash offers after these words."""
    words = line.split(" ")
    script = f"""source {prefix}/share/bash-completion/completions/{words[0]}
compopt() {{ :; }}
COMP_WORDS=({' '.join(repr(word) for word in words)}); COMP_CWORD={len(words) - 1}
_{words[0].replace('-', '_')}; printf '%s\\n' "${{COMPREPLY[@]}}" """
    return run("bash", "-c", script).split()


def check_completion(prefix):
    check(complete(prefix, "s3-refine --sem") == ["--semantics"], "completion of an option")
    check("planes.mode=" in complete(prefix, "s3-refine --set planes.m"), "completion of a key")
    check(complete(prefix, "s3-eval --align s") == ["sim3", "se3"], "completion of a choice")
    check("euroc" in complete(prefix, "s3-slam --format eu"), "completion of a format")


def check_consumer(cmake, source, prefix, work):
    trajectory = work / "trajectory.txt"
    trajectory.write_text(TRAJECTORY)
    run(cmake, "-S", source / "tests" / "install" / "consumer", "-B", work / "consumer",
        f"-DCMAKE_PREFIX_PATH={prefix}")
    run(cmake, "--build", work / "consumer")
    check(run(work / "consumer" / "consumer", trajectory) == "6 poses\n", "the consumer")


def main():
    cmake, build, source = sys.argv[1], pathlib.Path(sys.argv[2]), pathlib.Path(sys.argv[3])
    with tempfile.TemporaryDirectory() as folder:
        work = pathlib.Path(folder)
        run(cmake, "--install", build, "--prefix", work / "first")
        prefix = work / "moved"
        (work / "first").rename(prefix)
        check_programs(prefix, work)
        check_completion(prefix)
        check_consumer(cmake, source, prefix, work)


if __name__ == "__main__":
    main()
