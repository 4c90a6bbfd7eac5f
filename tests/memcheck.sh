#!/usr/bin/env bash
# Runs all stages on some frames under valgrind's memcheck; ends with 1 if one reads what was never
# written, touches what is not its own, or loses memory.
#
#   tests/memcheck.sh BIN_DIR CLASS_TABLE SCENE_DIR [FRAMES]
#
# SCENE_DIR is a sequence that s3-synth rendered, FRAMES a range (default :24). Ends with 77 without
# valgrind.
set -euo pipefail
bin=$1 classes=$2 scene=$3 frames=${4:-:24}
if ! command -v valgrind > /dev/null; then
  echo "memcheck.sh: no valgrind: skipped" >&2
  exit 77
fi
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
export OPENBLAS_NUM_THREADS=1
failed=0

check() { # check PROGRAM ARGUMENT...
  local program=$1 status=0
  shift
  valgrind --quiet --error-exitcode=99 --leak-check=full --errors-for-leak-kinds=definite \
    --show-leak-kinds=definite \
    "$bin/$program" --quiet --progress none --threads 1 "$@" \
    > "$work/output" 2> "$work/errors" || status=$?
  echo "$program: $( ((status == 0)) && echo clean || echo "ended with $status")"
  if ((status != 0)); then
    cat "$work/errors"
    failed=1
  fi
}

check s3-slam --sequence "$scene" --frames "$frames" --output "$work/1_slam"
check s3-lift --model "$work/1_slam" --masks "$scene/panoptic_noisy" --classes "$classes" \
  --output "$work/2_lift"
check s3-refine --model "$work/1_slam" --semantics "$work/2_lift" --output "$work/3_refine"
check s3-eval --estimate "$work/3_refine/frames.txt" --ground-truth "$scene/groundtruth.txt"
exit "$failed"
