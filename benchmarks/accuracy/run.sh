#!/usr/bin/env bash
# Accuracy of the stages on real sequences and on synthetic scenes: one Markdown table and a JSON file.
#
#   benchmarks/accuracy/run.sh --data DIR [--sequences NAME...] [--slam-only] [--output DIR] \
#     [--baselines DIR]
#   benchmarks/accuracy/run.sh --synthetic [--scenes NAME...] [--seeds N...] [--slam-only] [--output DIR]
#
# Trajectories of other systems, <system>_<sequence>[_<run>]_frames.txt in --baselines (without it:
# beside the data, in DIR/../baselines), are measured beside ours, by the same program.
set -euo pipefail
root=$(cd "$(dirname "${BASH_SOURCE[0]}")/../.." && pwd)

"$root/tools/build.sh" --programs
exec python3 "$root/benchmarks/accuracy/run.py" --bin "$root/build/bin" "$@"
