#!/usr/bin/env bash
# Installs missing packages, then configures and builds Release into build/.
#
#   tools/build.sh                 everything, tests included
#   tools/build.sh --programs      only the programs
#   tools/build.sh ... -- OPTIONS  further options for cmake's configuration, e.g. -DS3LAM_DATA_DIR=...
set -euo pipefail
root=$(cd "$(dirname "${BASH_SOURCE[0]}")/.." && pwd)

targets=(all)
if [[ "${1:-}" == --programs ]]; then
  targets=(s3-slam s3-lift s3-refine s3-eval s3-report s3-synth)
  shift
fi
if [[ "${1:-}" == -- ]]; then shift; fi

"$root/tools/install_packages.sh"

generator=()
if [[ ! -f "$root/build/CMakeCache.txt" ]]; then generator=(-G Ninja); fi
cmake -S "$root" -B "$root/build" "${generator[@]}" -DCMAKE_BUILD_TYPE=Release "$@" >&2

# One compilation takes up to 1.5 GB (Eigen and Ceres templates): fewer jobs where memory is short.
jobs=$(nproc)
available_mb=$(awk '/^MemAvailable:/ {print int($2 / 1024)}' /proc/meminfo)
((available_mb / 1500 < jobs)) && jobs=$((available_mb / 1500))
((jobs < 1)) && jobs=1
cmake --build "$root/build" -j "$jobs" --target "${targets[@]}" >&2
