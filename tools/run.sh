#!/usr/bin/env bash
# Runs the stages on one's own data: images (or a COLMAP model) and panoptic masks.
set -euo pipefail
root=$(cd "$(dirname "${BASH_SOURCE[0]}")/.." && pwd)
bin=$root/build/bin

usage() {
  cat << 'EOF'
usage: tools/run.sh (--sequence DIR|VIDEO | --model DIR) --masks DIR --classes FILE --output DIR [...]

  --sequence DIR|VIDEO   images; runs s3-slam, s3-lift, s3-refine
  --model DIR            a COLMAP model instead; runs s3-lift, s3-refine
  --masks DIR            panoptic masks, named as the images
  --classes FILE         class table, e.g. configs/classes/coco.json
  --output DIR           receives 1_slam/, 2_lift/, 3_refine/, report.html
  --overwrite            replace what an earlier run left in these folders, and remove those of its
                         folders that this run does not make (1_slam/, 3_refine_plain/)

  --ground-truth FILE    TUM or KITTI trajectory: adds the trajectory error to the final table,
                         and a bundle adjustment without planes (3_refine_plain/) to compare with;
                         needs --sequence
  --images DIR           with --model: its images, for the keyframes in report.html
  --camera FILE          camera.json, in place of what the sequence brings; auto: not known
  --format NAME          of the sequence (default: auto)
  --frames A:B:STEP      use only these frames
  --ignore-masks DIR|FILE
                         what s3-slam is to keep its features off, see there
  --lenient              leave out images and masks that cannot be used, and count them
  --mask-format NAME     of the masks (default: auto)
  --mask-json FILE       COCO panoptic JSON, where it is not beside the masks
  --label-map FILE       what the labels in the masks are in the class table
  --slam-config FILE, --lift-config FILE, --refine-config FILE
                         configuration of a stage (defaults: configs/*.json)
  --threads N, --seed N, --progress bar|json|none, --quiet
EOF
}

fail_usage() {
  echo "run.sh: $1 (see --help)" >&2
  exit 2
}

fail_input() {
  echo "run.sh: $1" >&2
  exit 3
}

# holds_input FOLDER: is it, or what lies in it, named on the command line?
holds_input() {
  local word
  for word in "${words[@]}"; do
    if [[ $(realpath -m -- "$word")/ == "$(realpath -m -- "$1")"/* ]]; then return 0; fi
  done
  return 1
}

# check_leftover FOLDER PROGRAM: notes a result of an earlier run that this one does not make, but that
# s3-report would show as of this one. What is something else is the user's.
check_leftover() {
  [[ -e $1 ]] || return 0
  if [[ ! $overwrite || -L $1 ]] || holds_input "$1" ||
    ! grep -qs "\"program\": \"$2\"" "$1/report.json"; then
    fail_input "$1 is not of this run, but the report would show it: move it away (--overwrite \
removes it if an earlier run made it and no input lies in it)"
  fi
  leftovers+=("$1")
}

words=("$@") overwrite='' lenient=() leftovers=()
sequence='' model='' masks='' classes='' output='' ground_truth=''
slam=() lift=() refine=() report=() common=()
while (($# > 0)); do
  case $1 in
    --help | -h) usage && exit 0 ;;
    --lenient) lenient=("$1") && shift && continue ;;
    --overwrite) overwrite=1 ;;&
    --overwrite | --quiet) common+=("$1") && shift && continue ;;
  esac
  (($# >= 2)) || fail_usage "$1: unknown, or without its value"
  case $1 in
    --sequence) sequence=$2 ;;
    --model) model=$2 ;;
    --masks) masks=$2 ;;
    --classes) classes=$2 ;;
    --output) output=$2 ;;
    --ground-truth) ground_truth=$2 ;;
    --images) report+=("$1" "$2") ;;
    --camera | --format | --frames | --ignore-masks) slam+=("$1" "$2") ;;
    --mask-format | --mask-json | --label-map) lift+=("$1" "$2") ;;
    --slam-config) slam+=(--config "$2") ;;
    --lift-config) lift+=(--config "$2") ;;
    --refine-config) refine+=(--config "$2") ;;
    --threads | --seed | --progress) common+=("$1" "$2") ;;
    *) fail_usage "$1: unknown" ;;
  esac
  shift 2
done
[[ -n $sequence || -n $model ]] || fail_usage "--sequence or --model is required"
[[ -z $sequence || -z $model ]] || fail_usage "--sequence and --model exclude one another"
[[ -z $model || ${#slam[@]} -eq 0 ]] || fail_usage "${slam[0]} goes with --sequence only"
[[ -n $masks ]] || fail_usage "--masks is required"
[[ -n $classes ]] || fail_usage "--classes is required"
[[ -n $output ]] || fail_usage "--output is required"
[[ -z $ground_truth || -n $sequence ]] || fail_usage "--ground-truth needs --sequence"
[[ -z $ground_truth || -f $ground_truth ]] || fail_input "$ground_truth: no such file"
[[ -n $sequence || $model -ef $output/1_slam ]] || check_leftover "$output/1_slam" s3-slam
[[ -n $ground_truth ]] || check_leftover "$output/3_refine_plain" s3-refine

"$root/tools/build.sh" --programs
mkdir -p "$output"
trap 'rmdir --ignore-fail-on-non-empty "$output"' EXIT  # When the first stage refused its input.

summary=()
if [[ -n $sequence ]]; then
  model=$output/1_slam
  "$bin/s3-slam" --sequence "$sequence" --output "$model" "${slam[@]}" "${lenient[@]}" \
    "${common[@]}" > /dev/null
  summary+=(--slam "$model")
fi
"$bin/s3-lift" --model "$model" --masks "$masks" --classes "$classes" --output "$output/2_lift" \
  "${lift[@]}" "${lenient[@]}" "${common[@]}" > /dev/null
"$bin/s3-refine" --model "$model" --semantics "$output/2_lift" --output "$output/3_refine" \
  "${refine[@]}" "${common[@]}" > /dev/null
if [[ -n $ground_truth ]]; then
  "$bin/s3-refine" --model "$model" --semantics "$output/2_lift" \
    --output "$output/3_refine_plain" "${refine[@]}" "${common[@]}" --set planes.mode=off > /dev/null
  report+=(--ground-truth "$ground_truth")
  summary+=(--plain "$output/3_refine_plain" --ground-truth "$ground_truth" --eval "$bin/s3-eval")
fi
rm -rf -- "${leftovers[@]}"
python3 "$root/tools/summary.py" "${summary[@]}" --lift "$output/2_lift" \
  --refine "$output/3_refine"
"$bin/s3-report" --run "$output" --output "$output/report.html" "${report[@]}" "${common[@]}" \
  > /dev/null
