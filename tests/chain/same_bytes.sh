#!/usr/bin/env bash
# Runs all stages, the first also with a camera that is not known, with 1, 2 and 8 threads, and twice
# with 8, and compares the bytes of what they write; with a second folder of programs, e.g. of another
# build folder, also those of its stages.
#
#   same_bytes.sh BIN_DIR CLASS_TABLE SCENE_DIR [OTHER_BIN_DIR]
#
# SCENE_DIR is a sequence that s3-synth rendered. One that comes back to its beginning closes loops:
# s3-synth --scene floor.
set -euo pipefail
bin=$1 classes=$2 scene=$3 other=${4:-}
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT

run() { # run NAME BIN_DIR THREADS: all stages into $work/NAME.
  local out=$work/$1 programs=$2 common=(--quiet --progress none --threads "$3")
  "$programs/s3-slam" --sequence "$scene" --output "$out/1_slam" --database "${common[@]}"
  "$programs/s3-slam" --sequence "$scene" --frames :40 --camera auto --output "$out/1_slam_auto" \
    "${common[@]}"
  "$programs/s3-lift" --model "$out/1_slam" --masks "$scene/panoptic_noisy" --classes "$classes" \
    --output "$out/2_lift" "${common[@]}"
  "$programs/s3-refine" --model "$out/1_slam" --semantics "$out/2_lift" --output "$out/3_refine" \
    "${common[@]}"
}

digests() { # Of every file but the reports, which have times.
  (cd "$work/$1" && find . -type f ! -name 'report.*' -print0 | sort -z | xargs -0 sha256sum)
}

runs=("1 $bin 1" "2 $bin 2" "8 $bin 8" "again $bin 8")
if [[ -n $other ]]; then runs+=("other $other 2"); fi
failed=0
for words in "${runs[@]}"; do
  read -r name programs threads <<< "$words"
  run "$name" "$programs" "$threads" > /dev/null
  digests "$name" > "$work/$name.sha256"
  if diff "$work/1.sha256" "$work/$name.sha256" > "$work/differences"; then
    same="the same bytes in $(wc -l < "$work/$name.sha256") files"
  else
    same="DIFFERENT: $(sed -n 's/^> [0-9a-f]*  //p' "$work/differences" | tr '\n' ' ')"
    failed=1
  fi
  printf '%-6s %d threads, %s: %s\n' "$name" "$threads" "$programs" "$same"
done
exit "$failed"
