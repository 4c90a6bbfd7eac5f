#!/usr/bin/env bash
# Installs missing packages, builds the programs, renders a synthetic scene (nothing is downloaded),
# runs all stages on it and prints a small table.
#
#   tools/demo.sh [OUTPUT_DIR]     default: demo-output/
#
# May be run again at any time: the build and the rendered scene are kept, the stages run anew.
set -euo pipefail
root=$(cd "$(dirname "${BASH_SOURCE[0]}")/.." && pwd)
bin=$root/build/bin
output=${1:-$root/demo-output}

"$root/tools/build.sh" --programs
mkdir -p "$output"
output=$(cd "$output" && pwd)

scene=$output/scene
if [[ ! -d $scene || $bin/s3-synth -nt $scene/report.json ]]; then
  echo "Rendering the scene ..." >&2
  "$bin/s3-synth" --scene desk --seed 1 --output "$scene" --overwrite > /dev/null
fi
"$root/tools/run.sh" --sequence "$scene" --masks "$scene/panoptic_noisy" \
  --classes "$root/configs/classes/coco.json" --ground-truth "$scene/groundtruth.txt" \
  --output "$output" --overwrite

cat << EOF

Everything in one page, for any browser: $output/report.html

The refined model is in $output/3_refine, the map coloured by class in
$output/2_lift/model_by_class. To look at them:

  colmap gui --import_path $output/3_refine --database_path $output/empty.db --image_path $scene/rgb
  colmap gui --import_path $output/2_lift/model_by_class --database_path $output/empty.db --image_path $scene/rgb
EOF
