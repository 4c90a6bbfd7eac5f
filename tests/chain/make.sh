#!/usr/bin/env bash
# Renders a short scene and runs all stages on it; the tests labelled integration and colmap look at
# the result.
#
#   make.sh BIN_DIR CLASS_TABLE OUTPUT_DIR
set -euo pipefail
bin=$1 classes=$2 out=$3

rm -rf "$out"
common=(--quiet --threads 2)
set -x
"$bin/s3-synth" --scene desk --seed 1 --set scene.speed=2 --output "$out/scene" "${common[@]}"
"$bin/s3-slam" --sequence "$out/scene" --output "$out/1_slam" --database "${common[@]}"
for masks in clean noisy; do
  "$bin/s3-lift" --model "$out/1_slam" --masks "$out/scene/panoptic_$masks" --classes "$classes" \
    --output "$out/2_lift_$masks" "${common[@]}"
  "$bin/s3-refine" --model "$out/1_slam" --semantics "$out/2_lift_$masks" \
    --output "$out/3_refine_$masks" "${common[@]}"
done
"$bin/s3-refine" --model "$out/1_slam" --output "$out/3_refine_plain" --set planes.mode=off \
  "${common[@]}"
