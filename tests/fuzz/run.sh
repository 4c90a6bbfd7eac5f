#!/usr/bin/env bash
# Fuzzes the parsers under ASan and UBSan and prints the executions of each target.
#
#   tests/fuzz/run.sh [--executions N] [--targets "NAME ..."] [--build DIR] [--corpus DIR]
#   tests/fuzz/run.sh --smoke       a few hundred executions a target, on the seeds alone
#
# N is per target (default 2000000: some 50 million in all). What is learnt stays in the corpus folder
# (default: DIR/corpus), findings in DIR/findings; a finding that is mended belongs into
# tests/fuzz/findings/TARGET/. Ends with 1 if there is a finding, 77 without clang and libFuzzer.
set -euo pipefail
root=$(cd "$(dirname "${BASH_SOURCE[0]}")/../.." && pwd)
executions=2000000 smoke='' build=$root/build-fuzz targets='' corpus=''
while (($# > 0)); do
  case $1 in
    --smoke) smoke=1 && executions=300 && shift && continue ;;
    --executions) executions=$2 ;;
    --targets) targets=$2 ;;
    --build) build=$2 ;;
    --corpus) corpus=$2 ;;
    *) echo "run.sh: $1: unknown" >&2 && exit 2 ;;
  esac
  shift 2
done
corpus=${corpus:-$build/corpus}

if ! command -v clang++ > /dev/null ||
  ! echo 'extern "C" int LLVMFuzzerTestOneInput(const char*, unsigned long) { return 0; }' |
  clang++ -fsanitize=fuzzer,address,undefined -x c++ - -o /dev/null 2> /dev/null; then
  echo "run.sh: no clang++ with libFuzzer (Debian: clang, libclang-rt-14-dev): skipped" >&2
  exit 77
fi
launcher=()
if command -v ccache > /dev/null; then launcher=(-DCMAKE_CXX_COMPILER_LAUNCHER=ccache); fi
cmake -S "$root" -B "$build" -G Ninja -DS3LAM_FUZZ=ON -DCMAKE_CXX_COMPILER=clang++ \
  -DCMAKE_BUILD_TYPE=Release -DS3LAM_PRECOMPILE_HEADERS=OFF "${launcher[@]}" > /dev/null
cmake --build "$build" -j "${S3LAM_FUZZ_JOBS:-2}" --target s3lam_fuzz > /dev/null
seeds=$build/tests/fuzz/seeds
if [[ -z $targets ]]; then targets=$(cd "$seeds" && echo */ | tr -d /); fi

scratch=$(mktemp -d "$(test -w /dev/shm && echo /dev/shm || echo /tmp)/s3lam_fuzz_XXXXXX")
trap 'rm -rf "$scratch"' EXIT
# OpenCV's own decoders are not built with the sanitizers; what they leak or log is not ours.
export TMPDIR=$scratch OPENCV_LOG_LEVEL=SILENT ASAN_OPTIONS=detect_leaks=0:allocator_may_return_null=0
total=0 failed=0
for target in $targets; do
  mkdir -p "$build/findings/$target"
  folders=("$seeds/$target")
  if [[ -d $root/tests/fuzz/findings/$target ]]; then
    folders+=("$root/tests/fuzz/findings/$target")
  fi
  if [[ -z $smoke ]]; then mkdir -p "$corpus/$target" && folders=("$corpus/$target" "${folders[@]}"); fi
  status=0
  if [[ -n $smoke ]]; then
    mkdir -p "$scratch/corpus" && folders=("$scratch/corpus" "${folders[@]}")
  fi
  S3LAM_FUZZ_TARGET=$target "$build/bin/s3lam_fuzz" -runs="$executions" -max_len=4096 \
    -timeout=20 -rss_limit_mb=2048 -malloc_limit_mb=512 -seed=1 -print_final_stats=1 -close_fd_mask=1 \
    -artifact_prefix="$build/findings/$target/" "${folders[@]}" > "$scratch/log" 2>&1 || status=$?
  rm -rf "$scratch/corpus"
  done=$(sed -n 's/^stat::number_of_executed_units: *//p' "$scratch/log")
  printf '%-18s %12s executions %s\n' "$target" "${done:-0}" "$( ((status == 0)) || echo FAILED)"
  total=$((total + ${done:-0}))
  if ((status != 0)); then
    failed=1
    cp "$scratch/log" "$build/findings/$target/log"
    grep -aE 'ERROR|SUMMARY|fuzz:|what\(\)|Test unit written' "$scratch/log" | head -8
  fi
done
printf '%-18s %12s executions\n' total "$total"
exit "$failed"
