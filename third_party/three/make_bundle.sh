#!/usr/bin/env bash
# Makes three.bundle.min.js anew: the part of three.js that the report's 3D view uses, as one script.
# Needs node, npm and the network; the build does not, it takes the bundle that is here.
set -euo pipefail
here=$(cd "$(dirname "${BASH_SOURCE[0]}")" && pwd)
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT

cd "$work"
npm init -y > /dev/null
npm install --no-audit --no-fund three@0.170.0 esbuild@0.28.2
cp "$here/entry.js" .
node_modules/.bin/esbuild entry.js --bundle --minify --format=iife --global-name=THREE \
  --legal-comments=inline "--outfile=$here/three.bundle.min.js"
cp node_modules/three/LICENSE "$here/LICENSE"
