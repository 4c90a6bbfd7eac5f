#!/usr/bin/env bash
# Builds everything with sanitizers and runs the tests, but for those on real sequences.
#
#   tests/sanitize.sh asan|tsan [CTEST_ARGUMENTS...]
#
# asan: addresses, leaks and undefined behaviour; tsan: data races. The builds stay in build-asan and
# build-tsan.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."
preset=${1:?asan or tsan}
shift
launcher=()
if command -v ccache > /dev/null; then launcher=(-DCMAKE_CXX_COMPILER_LAUNCHER=ccache); fi
cmake --preset "$preset" "${launcher[@]}"
cmake --build --preset "$preset"
ctest --preset "$preset" "$@"
