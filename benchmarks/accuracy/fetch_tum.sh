#!/usr/bin/env bash
# Sequences of tum from their original site, or with --from DIR from what is there; see --help.
exec python3 "$(dirname "${BASH_SOURCE[0]}")/fetch.py" tum "$@"
