#!/usr/bin/env bash
# Takes the pictures of the COLMAP GUI in this folder from a finished tools/demo.sh.
# Needs, beside the usual packages: xvfb xdotool imagemagick.
#
#   docs/images/make_gui_pictures.sh [DEMO_OUTPUT]
set -euo pipefail
here=$(cd "$(dirname "${BASH_SOURCE[0]}")" && pwd)
demo=${1:-$here/../../demo-output}
scratch=$(mktemp -d)
display=:97
trap 'kill $(jobs -p) 2> /dev/null || true; rm -rf "$scratch"' EXIT

# The viewer has -y up and shows a world of a hundred units: where the cameras have to be in it.
python3 - "$demo/scene" > "$scratch/cameras.txt" << 'EOF'
import pathlib, sys
enlarge, look_at = 26.0, (-0.1, -0.35, 0.95)  # [1/m]; [m] in the scene's world
scene = pathlib.Path(sys.argv[1])
def rows(name):
    return [r.split() for r in (scene / name).read_text().splitlines() if r and r[0] != "#"]
positions = {round(float(row[0]), 4): [float(x) for x in row[1:4]] for row in rows("groundtruth.txt")}
for time, path in rows("rgb.txt"):
    x, y, z = (enlarge * (p - c) for p, c in zip(positions[round(float(time), 4)], look_at))
    print(pathlib.Path(path).name, x, -z, y)
EOF

Xvfb $display -screen 0 1024x600x24 > /dev/null 2>&1 &
sleep 2
picture() {  # picture MODEL NAME
  mkdir "$scratch/$2"
  QT_QPA_PLATFORM=offscreen colmap model_aligner --input_path "$1" --output_path "$scratch/$2" \
    --ref_images_path "$scratch/cameras.txt" --ref_is_gps 0 --alignment_type custom \
    --robust_alignment 0 > /dev/null
  DISPLAY=$display QT_QPA_PLATFORM=xcb LIBGL_ALWAYS_SOFTWARE=1 colmap gui \
    --import_path "$scratch/$2" --database_path "$scratch/$2.db" --image_path "$demo/scene/rgb" \
    --Render.min_track_len 2 > /dev/null 2>&1 &
  local gui=$!
  sleep 10
  DISPLAY=$display xdotool mousemove 1016 64 click 1  # closes the log
  sleep 2
  # Larger points and cameras: the mouse wheel with Ctrl and with Alt.
  for key_and_steps in "ctrl 12" "alt 14"; do
    read -r key steps <<< "$key_and_steps"
    DISPLAY=$display xdotool mousemove 500 350 keydown "$key" \
      click --repeat "$steps" --delay 100 4 keyup "$key"
  done
  sleep 4
  DISPLAY=$display import -window root "$scratch/$2.png"
  kill $gui
  wait $gui 2> /dev/null || true
  convert "$scratch/$2.png" -crop 1024x520+0+55 +repage -strip -colors 128 "$here/$2.png"
}
picture "$demo/3_refine" gui_refined
picture "$demo/2_lift/model_by_class" gui_by_class
picture "$demo/2_lift/model_by_cluster" gui_by_cluster
