#!/usr/bin/env bash
# Installs missing packages, builds, and runs all tests. Arguments go to ctest, e.g. -L unit.
#
# Tests labelled `real` run on the sequences in ../shared/data (or S3LAM_DATA_DIR) and are skipped,
# visibly, without them.
set -euo pipefail
root=$(cd "$(dirname "${BASH_SOURCE[0]}")/.." && pwd)

data=${S3LAM_DATA_DIR:-$root/../shared/data}
if [[ -d "$data" ]]; then
  data=$(cd "$data" && pwd)
else
  echo "No sequences in $data: the tests labelled 'real' will be skipped." >&2
  data=
fi
"$root/tools/build.sh" -- -DS3LAM_TESTS=ON "-DS3LAM_DATA_DIR=$data"
cd "$root/build"
exec ctest -j "$(nproc)" --output-on-failure --no-tests=error "$@"
