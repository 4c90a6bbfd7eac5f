#!/usr/bin/env python3
"""Writes a program's man page and bash completion from what it says of itself (--help,
--print-config).

usage: make_manual.py PROGRAM MAN_PAGE COMPLETION
"""

import json
import pathlib
import re
import subprocess
import sys

OPTION = re.compile(r"^  (?:-(?P<short>\w) \[ )?--(?P<name>[\w-]+)(?: \])?"
                    r"(?: (?P<value>\S+(?: \(=\S*\))?))?(?:  +(?P<text>.*))?$")
CONTINUED = re.compile(r"^ {10,}(\S.*)$")
FILES = ("DIR", "FILE", "VIDEO")


def ask(program, option):
    return subprocess.run([program, option], check=True, capture_output=True, text=True).stdout


def read_options(help_text):
    """[{short, name, value, text}] of the lines that describe options."""
    options = []
    for line in help_text.splitlines():
        if match := OPTION.match(line):
            options.append({k: v or "" for k, v in match.groupdict().items()})
        elif options and (match := CONTINUED.match(line)):
            options[-1]["text"] = f"{options[-1]['text'].strip()} {match.group(1)}".strip()
        elif line.startswith("Configuration ("):
            break
    return options


def split_help(text):
    """Title line, description, the configuration's part, and what the exit codes mean."""
    title, _, rest = text.partition("\n")
    before, _, configuration = rest.partition("\nConfiguration (")
    lines = before.splitlines()
    first = next((i for i, line in enumerate(lines) if OPTION.match(line)), len(lines))
    while first > 0 and (not lines[first - 1].strip() or lines[first - 1].endswith(":")):
        first -= 1  # The heading of the options.
    _, _, configuration = configuration.partition("\n")
    configuration, _, _ = configuration.partition("\nExit codes: ")
    _, _, exit_status = text.partition("\nExit codes: ")
    return title, "\n".join(lines[:first]).strip(), configuration.rstrip(), exit_status.rstrip()


def roff(text):
    escaped = text.replace("\\", "\\e").replace("-", "\\-")
    return "\n".join("\\&" + line if line[:1] in (".", "'") else line
                     for line in escaped.splitlines())


def man_page(name, help_text):
    title, description, configuration, exit_status = split_help(help_text)
    summary = re.split(r"[.:]\s|\n\n", description.replace("\n", " "))[0].rstrip(".")
    # Without a date, so that the same source gives the same bytes.
    lines = [f'.TH {name.upper()} 1 "" "{roff(title)}" "s3lam"', ".SH NAME",
             f"{roff(name)} \\- {roff(summary)}", ".SH SYNOPSIS", f".B {roff(name)}",
             "[\\fIOPTIONS\\fR]", ".SH DESCRIPTION", ".nf", roff(description), ".fi",
             ".SH OPTIONS"]
    for option in read_options(help_text):
        short = f"\\fB\\-{option['short']}\\fR, " if option["short"] else ""
        lines += [".TP", f"{short}\\fB\\-\\-{roff(option['name'])}\\fR \\fI{roff(option['value'])}\\fR",
                  roff(option["text"])]
    if configuration:
        lines += [".SH CONFIGURATION", "Set by \\-\\-config and \\-\\-set; with defaults:", ".nf",
                  roff(configuration), ".fi"]
    lines += [".SH EXIT STATUS", roff(exit_status)]
    return "\n".join(lines) + "\n"


def config_keys(value, path=""):
    if isinstance(value, dict):
        return [key for k, v in value.items() for key in config_keys(v, f"{path}.{k}".lstrip("."))]
    return [path]


def completion(name, help_text, config):
    options = read_options(help_text)
    words = " ".join("--" + option["name"] for option in options)
    cases = []
    for option in options:
        value, text = option["value"], option["text"]
        flag = "--" + option["name"]
        choices = re.search(r"(?:^|[ :])((?:[\w-]+, )*[\w-]+ or [\w-]+)(?:$| \()", text)
        if option["name"] == "set" and config:
            keys = " ".join(key + "=" for key in config_keys(config))
            cases.append(f"    {flag}) compopt -o nospace; "
                         f"COMPREPLY=($(compgen -W '{keys}' -- \"$cur\")); return ;;")
        elif "|" in value and not any(kind in value for kind in FILES):
            cases.append(f"    {flag}) COMPREPLY=($(compgen -W '{value.replace('|', ' ')}' -- "
                         "\"$cur\")); return ;;")
        elif any(kind in value for kind in FILES):
            cases.append(f"    {flag}) compopt -o filenames; "
                         "COMPREPLY=($(compgen -f -- \"$cur\")); return ;;")
        elif value.startswith("arg") and choices:
            known = re.sub(r", | or ", " ", choices.group(1))
            cases.append(f"    {flag}) COMPREPLY=($(compgen -W '{known}' -- \"$cur\")); return ;;")
        elif value:
            cases.append(f"    {flag}) return ;;")
    function = "_" + name.replace("-", "_")
    return "\n".join([f"# bash completion of {name}", f"{function}() {{",
                      '  local cur="${COMP_WORDS[COMP_CWORD]}" before="${COMP_WORDS[COMP_CWORD-1]}"',
                      "  COMPREPLY=()", '  case "$before" in', *cases, "  esac",
                      f"  COMPREPLY=($(compgen -W '{words}' -- \"$cur\"))", "}",
                      f"complete -F {function} {name}"]) + "\n"


def main():
    program, page, script = map(pathlib.Path, sys.argv[1:4])
    help_text = ask(program, "--help")
    config = json.loads(ask(program, "--print-config") or "null")
    page.parent.mkdir(parents=True, exist_ok=True)
    script.parent.mkdir(parents=True, exist_ok=True)
    page.write_text(man_page(program.name, help_text))
    script.write_text(completion(program.name, help_text, config))


if __name__ == "__main__":
    main()
