#!/usr/bin/env bash
# Fuzzes the parsers under ASan and UBSan and prints the executions of each target and their sum.
#
#   tests/fuzz/run.sh [--total N] [--seconds S] [--slice S] [--targets "NAME ..."] [--build DIR]
#   tests/fuzz/run.sh --smoke       a few hundred executions a target, on the seeds alone
#
# The targets take turns, a slice of time each (default 60 s), until N executions (default 50000000)
# are done in all or S seconds have passed. A later run with the same DIR (default: build-fuzz) goes on
# where the last one ended, and counts on: what was learnt is in DIR/corpus, the counts are in
# DIR/executions, findings in DIR/findings. A finding ends the slice of its target, not the run; once
# mended it belongs into tests/fuzz/findings/TARGET/. Ends with 1 if there is a finding in DIR, 77
# without clang and libFuzzer.
set -euo pipefail
root=$(cd "$(dirname "${BASH_SOURCE[0]}")/../.." && pwd)
total=50000000 seconds='' slice=60 smoke='' build=$root/build-fuzz targets=''
while (($# > 0)); do
  case $1 in
    --smoke) smoke=1 && shift && continue ;;
    --total) total=$2 ;;
    --seconds) seconds=$2 ;;
    --slice) slice=$2 ;;
    --targets) targets=$2 ;;
    --build) build=$2 ;;
    *) echo "run.sh: $1: unknown" >&2 && exit 2 ;;
  esac
  shift 2
done

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
# OpenCV's own decoders are not built with the sanitizers; what they leak or log is not ours.
export TMPDIR=$scratch OPENCV_LOG_LEVEL=SILENT ASAN_OPTIONS=detect_leaks=0:allocator_may_return_null=0
counts=$build/executions findings=$build/findings
if [[ -n $smoke ]]; then counts=$scratch/executions findings=$scratch/findings; fi
mkdir -p "$counts" "$findings"
fuzzer='' stop='' failed=''
trap 'rm -rf "$scratch"' EXIT
trap 'stop=1; [[ -z $fuzzer ]] || kill -INT "$fuzzer" 2> /dev/null' INT TERM

# count TARGET: its executions of all runs so far.
count() { cat "$counts/$1" 2> /dev/null || echo 0; }
sum() { # Of the executions of all targets.
  local target all=0
  for target in $targets; do all=$((all + $(count "$target"))); done
  echo "$all"
}

# fuzz TARGET OPTION...: lets libFuzzer work on it and adds what it did to the counts.
fuzz() {
  local target=$1 folders=("$seeds/$1") corpus=$build/corpus/$1 status=0 did
  shift
  if [[ -n $smoke ]]; then corpus=$scratch/corpus/$target; fi
  mkdir -p "$corpus" "$findings/$target"
  if [[ -d $root/tests/fuzz/findings/$target ]]; then
    folders+=("$root/tests/fuzz/findings/$target")
  fi
  S3LAM_FUZZ_TARGET=$target "$build/bin/s3lam_fuzz" -max_len=4096 -timeout=20 -rss_limit_mb=2048 \
    -malloc_limit_mb=512 -print_final_stats=1 -close_fd_mask=1 \
    -artifact_prefix="$findings/$target/" "$@" "$corpus" "${folders[@]}" > "$scratch/log" 2>&1 &
  fuzzer=$!
  while kill -0 "$fuzzer" 2> /dev/null; do # A signal ends the waiting, not the fuzzer at once.
    status=0
    wait "$fuzzer" || status=$?
  done
  fuzzer=''
  did=$(sed -n 's/^stat::number_of_executed_units: *//p' "$scratch/log")
  echo $(($(count "$target") + ${did:-0})) > "$scratch/count" && mv "$scratch/count" "$counts/$target"
  if ((status == 0)) || [[ -n $stop ]]; then return 0; fi
  failed=1
  cp "$scratch/log" "$findings/$target/log"
  echo "$target: a finding, in $findings/$target"
  grep -aE 'ERROR|SUMMARY|fuzz:|what\(\)|Test unit written' "$scratch/log" | head -8 || true
}

SECONDS=0
round=0
while [[ -z $stop ]] && (($(sum) < total)); do
  round=$((round + 1))
  for target in $targets; do
    left=$((total - $(sum)))
    if [[ -n $stop ]] || ((left <= 0)); then break; fi
    if [[ -n $smoke ]]; then
      fuzz "$target" -runs=300 -seed=1
      continue
    fi
    time=$slice
    if [[ -n $seconds ]]; then
      if ((SECONDS >= seconds)); then stop=1 && break; fi
      time=$((time < seconds - SECONDS ? time : seconds - SECONDS))
    fi
    fuzz "$target" -max_total_time="$time" -runs="$left" -seed="$((1 + $(count "$target") % 1000000007))"
  done
  if [[ -n $smoke ]]; then break; fi
  printf 'round %d: %d executions, %d s\n' "$round" "$(sum)" "$SECONDS"
done

for target in $targets; do
  found=$(find "$findings/$target" -type f ! -name log | wc -l)
  if ((found > 0)); then failed=1; fi
  printf '%-18s %12d executions %s\n' "$target" "$(count "$target")" \
    "$( ((found == 0)) || echo "$found findings")"
done
printf '%-18s %12d executions\n' total "$(sum)"
exit "${failed:-0}"
