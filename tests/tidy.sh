#!/usr/bin/env bash
# Runs clang-tidy, with the checks of .clang-tidy, on all of src and tools or on the files given; ends with
# 1 if it finds something.
#
#   tests/tidy.sh [FILE...]
#
# JOBS in the environment: how many at once (default 2). Its build folder, which is only configured, is
# build-tidy: clang-tidy cannot read the headers that gcc precompiles.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."
if ! command -v clang-tidy > /dev/null; then
  echo "tidy.sh: no clang-tidy (Debian's package clang-tidy)" >&2
  exit 1
fi
cmake -S . -B build-tidy -G Ninja -DCMAKE_BUILD_TYPE=Release -DS3LAM_PRECOMPILE_HEADERS=OFF > /dev/null
if (($# == 0)); then
  mapfile -t files < <(find src tools -name '*.cc' ! -name precompiled.cc | sort)
  set -- "${files[@]}"
fi
printf '%s\0' "$@" |
  xargs -0 -n 1 -P "${JOBS:-2}" clang-tidy --quiet --warnings-as-errors='*' -p build-tidy
