#!/usr/bin/env python3
"""Holds every #include of the source tree against the layers declared in src/CMakeLists.txt.

All modules share one include folder, so the compiler alone would let a module include one it does
not list. Checked as well: the three stages do not reach one another, the algorithms open no files, and
no two public headers define a type of the same name, since a program may include both.

usage: layering_test.py SOURCE_DIR MODULE_LAYERS_FILE
"""

import pathlib
import re
import sys

STAGES = ("slam", "semantics", "refine")
# Modules whose business is files.
FILE_MODULES = ("base", "io", "report", "synthetic")
FILE_ACCESS = re.compile(r"#include <(fstream|filesystem|cstdio|opencv2/(imgcodecs|videoio)\.hpp)>"
                         r"|\bcv::(imread|imwrite)\b|\bfopen\b")
NAMESPACE = re.compile(r"^namespace (s3lam[\w:]*) \{", re.MULTILINE)
PUBLIC_TYPE = re.compile(r"^(?:struct|class|enum class) (\w+)[^;{]*\{", re.MULTILINE)
OUR_INCLUDE = re.compile(r'^\s*#include\s+["<]s3lam/(\w+)/', re.MULTILINE)


def read_layers(path):
    layers = {}
    for line in path.read_text().splitlines():
        module, _, below = line.partition(":")
        layers[module] = set(below.split())
    return layers


def reachable(layers, module):
    """The modules that `module` may include: itself and, transitively, those it lists."""
    seen, todo = set(), [module]
    while todo:
        current = todo.pop()
        if current not in seen:
            seen.add(current)
            todo.extend(layers.get(current, ()))
    return seen


def source_files(root, module):
    for folder in (root / "include" / "s3lam" / module, root / "src" / module):
        yield from sorted(path for path in folder.rglob("*") if path.suffix in (".h", ".cc"))


def layer_errors(layers):
    for module, below in layers.items():
        for name in sorted(below - layers.keys()):
            yield f"module {module} lists {name}, which is not a module"
    for stage in STAGES:
        for other in sorted((reachable(layers, stage) & set(STAGES)) - {stage}):
            yield f"stage {stage} reaches stage {other}"


def include_errors(root, layers):
    folders = {path.name for top in ("include/s3lam", "src") for path in (root / top).iterdir()}
    for module in sorted(folders):
        if not any(source_files(root, module)):
            continue
        if module not in layers:
            yield f"module {module} has files but is not listed in src/CMakeLists.txt"
            continue
        allowed = reachable(layers, module)
        for path in source_files(root, module):
            text = path.read_text()
            for included in sorted(set(OUR_INCLUDE.findall(text)) - allowed):
                yield f"{path.relative_to(root)}: {module} must not include {included}"
            if module not in FILE_MODULES and (found := FILE_ACCESS.search(text)):
                yield f"{path.relative_to(root)}: opens files itself ({found.group(0)})"


def name_errors(root):
    """Types outside of any class that two public headers define in the same namespace."""
    header_of = {}
    for path in sorted((root / "include" / "s3lam").rglob("*.h")):
        text = path.read_text()
        namespace = (NAMESPACE.findall(text) or ["s3lam"])[-1]
        for name in PUBLIC_TYPE.findall(text):
            full = f"{namespace}::{name}"
            if full in header_of:
                yield f"{path.relative_to(root)}: {full} is in {header_of[full]} as well"
            header_of[full] = path.relative_to(root)


def main():
    root, layers = pathlib.Path(sys.argv[1]), read_layers(pathlib.Path(sys.argv[2]))
    if not layers:
        sys.exit(f"{sys.argv[2]}: no modules listed")
    errors = [*layer_errors(layers), *include_errors(root, layers), *name_errors(root)]
    for error in errors:
        print(error, file=sys.stderr)
    sys.exit(1 if errors else 0)


if __name__ == "__main__":
    main()
