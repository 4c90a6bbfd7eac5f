#!/usr/bin/env bash
# Makes the pictures of s3-report in this folder from a finished tools/demo.sh.
# Needs, beside the usual packages: chromium.
#
#   docs/images/make_report_pictures.sh [DEMO_OUTPUT]
set -euo pipefail
here=$(cd "$(dirname "${BASH_SOURCE[0]}")" && pwd)
root=$here/../..
demo=${1:-$root/demo-output}
scratch=$(mktemp -d)
trap 'rm -rf "$scratch"' EXIT

"$root/build/bin/s3-report" --run "$demo" --ground-truth "$demo/scene/groundtruth.txt" \
  --output "$scratch/report.html" --png "$scratch/png" \
  --set gallery_width=320 --set view_width=320 --quiet > /dev/null

python3 - "$root/tests/report_browser" "$scratch/report.html" "$scratch/page.png" << 'EOF'
import base64, pathlib, sys
sys.path.insert(0, sys.argv[1])
import devtools
with devtools.Page(devtools.find_browser()) as page:
    page.open(pathlib.Path(sys.argv[2]).resolve().as_uri())
    # The pointer rests on the plane with the most points, so that it tells of itself.
    page.evaluate("""document.getElementById('view-row').scrollIntoView();
      s3lamViewer.hover(...%s)""" % page.evaluate("""JSON.stringify((() => {
        const box = document.getElementById('viewer').getBoundingClientRect();
        let best = [0, 0, 0];
        for (let y = 40; y < box.height - 120; y += 15)
          for (let x = 40; x < box.width - 300; x += 15) {
            s3lamViewer.hover(x, y);
            const tip = document.getElementById('tip');
            const found = tip.hidden ? null : tip.innerText.match(/^point.*plane .*\\n(\\d+) points/s);
            if (found && Number(found[1]) > best[2]) best = [x, y, Number(found[1])];
          }
        return best.slice(0, 2); })())"""))
    page.frames()
    pathlib.Path(sys.argv[3]).write_bytes(base64.b64decode(page.screenshot("view-row")))
EOF
mv "$scratch/page.png" "$here/report_page.png"
keyframes=("$scratch"/png/keyframe_*.png)
cp "${keyframes[${#keyframes[@]} / 3]}" "$here/report_keyframe.png"
cp "$scratch/png/map_planar_oblique.png" "$here/report_map.png"
cp "$scratch/png/plane_distance.png" "$here/report_planes.png"
