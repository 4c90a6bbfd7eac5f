#!/usr/bin/env bash
# Writes configs/{slam,lift,refine}.json anew: every option of each stage with its default.
#
#   tools/update_configs.sh [BIN_DIR]     default: build/bin
set -euo pipefail
root=$(cd "$(dirname "${BASH_SOURCE[0]}")/.." && pwd)
bin=${1:-$root/build/bin}

for stage in slam lift refine; do
  config=$("$bin/s3-$stage" --print-config)  # First whole, so that a failure leaves the old file.
  printf '%s\n' "$config" > "$root/configs/$stage.json"
done
