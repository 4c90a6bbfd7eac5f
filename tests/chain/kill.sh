#!/usr/bin/env bash
# Kills each stage with SIGKILL at random moments, every second time once it has begun to write, and
# looks at what is left: the output folder has to be the old one or the complete new one, and the next
# run has to succeed and to leave nothing else.
#
#   tests/chain/kill.sh BIN_DIR CLASS_TABLE SCENE_DIR [N [STAGE...]]
#
# N (default 200) is per stage; SCENE_DIR is a sequence that s3-synth rendered; STAGE is slam, lift or
# refine (default: all of them).
set -euo pipefail
bin=$1 classes=$2 scene=$3 count=${4:-200}
stages=("${@:5}")
if ((${#stages[@]} == 0)); then stages=(slam lift refine); fi
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
RANDOM=1  # The same moments again, as far as the machine allows.
common=(--quiet --progress none --threads 1)

"$bin/s3-slam" --sequence "$scene" --output "$work/model" "${common[@]}" > /dev/null
"$bin/s3-lift" --model "$work/model" --masks "$scene/panoptic_clean" --classes "$classes" \
  --output "$work/semantics" "${common[@]}" > /dev/null

stage() {  # The command line of a stage, but for its output.
  case $1 in
    slam) command=("$bin/s3-slam" --sequence "$scene") ;;
    lift) command=("$bin/s3-lift" --model "$work/model" --masks "$scene/panoptic_clean"
      --classes "$classes") ;;
    refine) command=("$bin/s3-refine" --model "$work/model" --semantics "$work/semantics") ;;
    *) echo "kill.sh: $1: no stage" >&2 && exit 2 ;;
  esac
  command+=("${common[@]}" --overwrite --output "$2")
}

digest() {  # Of all files but the reports, which have times.
  (cd "$1" && find . -type f ! -name "report.*" -print0 | sort -z | xargs -0 sha256sum | sha256sum)
}

failed=0
for name in "${stages[@]}"; do
  place=$work/$name
  mkdir "$place"
  stage "$name" "$place/out"
  begin=$(date +%s%N)
  "${command[@]}" > /dev/null
  took_ms=$((($(date +%s%N) - begin) / 1000000))
  complete=$(digest "$place/out")
  old=0 new=0
  for ((i = 0; i < count; ++i)); do
    rm -rf "$place/out" && mkdir "$place/out" && echo old > "$place/out/old"
    was=$(digest "$place/out")
    "${command[@]}" > /dev/null 2>&1 &
    pid=$!
    moment_ms=$((RANDOM % (took_ms + 20)))
    if ((i % 2 == 1)); then
      while kill -0 "$pid" 2> /dev/null && ! compgen -G "$place/.out.tmp-*/*" > /dev/null; do sleep 0.002; done
      moment_ms=$((RANDOM % 40))
    fi
    sleep "$(printf '%d.%03d' $((moment_ms / 1000)) $((moment_ms % 1000)))"
    kill -KILL "$pid" 2> /dev/null || true
    wait "$pid" 2> /dev/null || true
    is=$(digest "$place/out")
    if [[ $is == "$was" ]]; then
      old=$((old + 1))
    elif [[ $is == "$complete" ]]; then
      new=$((new + 1))
    else
      echo "kill.sh: s3-$name: neither the old nor the complete new output after kill $i" >&2
      failed=1
    fi
  done
  if ! "${command[@]}" > /dev/null || [[ $(digest "$place/out") != "$complete" ]] ||
    [[ $(ls -A "$place") != out ]]; then
    echo "kill.sh: s3-$name: the run after the kills failed or left something" >&2
    failed=1
  fi
  echo "s3-$name: $count kills, old output $old times, complete new one $new times"
done
exit "$failed"
