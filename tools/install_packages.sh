#!/usr/bin/env bash
# Installs the packages the project needs (Debian 12, Ubuntu 24.04), and only those that are missing:
# with nothing missing it needs neither root nor network.
#
#   tools/install_packages.sh          install what is missing
#   tools/install_packages.sh --list   print the one apt line and exit
#
# S3LAM_NO_INSTALL=1 skips the check, for libraries that were built from source.
set -euo pipefail

packages=(
  g++ cmake ninja-build python3
  python3-numpy          # the second opinion on trajectory errors, in a test
  libceres-dev           # bundle adjustment
  libopenblas-dev        # makes Ceres' dense solver several times faster than the reference BLAS
  libopencv-dev          # features, images; its CMake files exist only in this whole package
  libeigen3-dev libboost-program-options-dev nlohmann-json3-dev libspdlog-dev libfmt-dev
  libdeflate-dev         # PNG masks, in half the time of zlib; .npz files
  libsqlite3-dev         # databases for colmap
  libgtest-dev libgmock-dev
  colmap                 # the outside judge of our models, and their viewer
)
install=(apt-get install -y --no-install-recommends)

if [[ "${1:-}" == --list ]]; then
  echo "${install[*]} ${packages[*]}"
  exit 0
fi
if [[ -n "${S3LAM_NO_INSTALL:-}" ]]; then exit 0; fi
if ! command -v dpkg-query > /dev/null; then
  echo "install_packages.sh: not a Debian or Ubuntu system; these packages are needed:" \
    "${packages[*]}" >&2
  exit 0
fi

missing=()
for package in "${packages[@]}"; do
  # The status query matters: a removed package still has its configuration known to dpkg.
  status=$(dpkg-query -W -f '${db:Status-Status}\n' "$package" 2> /dev/null || true)
  grep -qx installed <<< "$status" || missing+=("$package")
done
if ((${#missing[@]} == 0)); then exit 0; fi

line="${install[*]} ${missing[*]}"
as_root=()
if ((EUID != 0)); then
  # Without a terminal nobody can type a password, so sudo has to work without one.
  if command -v sudo > /dev/null && { [[ -t 0 ]] || sudo -n true 2> /dev/null; }; then
    as_root=(sudo)
  else
    echo "install_packages.sh: root is needed once, to run: $line" >&2
    exit 1
  fi
fi
echo "Installing: ${as_root[*]:+${as_root[*]} }$line" >&2
quiet=(-qq -o Acquire::Retries=3 -o DPkg::Lock::Timeout=300)
# An unreachable third-party repository must not stop us: the installation decides.
"${as_root[@]}" apt-get "${quiet[@]}" update >&2 ||
  echo "install_packages.sh: warning: apt-get update was not complete" >&2
if ! "${as_root[@]}" env DEBIAN_FRONTEND=noninteractive "${install[@]}" "${quiet[@]}" \
  -o Dpkg::Use-Pty=0 "${missing[@]}" > /dev/null; then
  echo "install_packages.sh: installation failed; the line was: $line" >&2
  exit 1
fi
