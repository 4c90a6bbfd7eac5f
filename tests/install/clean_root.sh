#!/usr/bin/env bash
# Builds the Debian package, installs it on a bare Debian made by debootstrap, where nothing of this
# project has ever been, and runs all stages there. Needs root, debootstrap and the network.
#
#   tests/install/clean_root.sh BUILD_DIR [SUITE]     default: this machine's suite
#
# Ends with 77 without debootstrap or without root.
set -euo pipefail
build=$(cd "$1" && pwd)
suite=${2:-$(. /etc/os-release && echo "$VERSION_CODENAME")}
if ! command -v debootstrap > /dev/null || ((EUID != 0)); then
  echo "clean_root.sh: needs debootstrap and root: skipped" >&2
  exit 77
fi
work=$(mktemp -d)
root=$work/root
finish() {
  if mountpoint -q "$root/proc"; then umount "$root/proc"; fi
  rm -rf "$work"
}
trap finish EXIT

(cd "$build" && cpack -G DEB -B "$work/packages" > "$work/cpack.log") || {
  cat "$work/cpack.log"
  exit 1
}
debootstrap --variant=minbase "$suite" "$root" > "$work/debootstrap.log" || {
  tail "$work/debootstrap.log"
  exit 1
}
mount -t proc proc "$root/proc"
cp "$work"/packages/s3lam_*.deb "$root/tmp"
inside() {
  chroot "$root" env -i PATH=/usr/sbin:/usr/bin:/sbin:/bin LC_ALL=C DEBIAN_FRONTEND=noninteractive "$@"
}
inside sh -c 'apt-get install -y --no-install-recommends /tmp/s3lam_*.deb' > "$work/apt.log" || {
  tail -20 "$work/apt.log"
  exit 1
}
inside dpkg -s s3lam | grep -E '^(Status|Version|Depends)'

inside sh -e -c '
  cd /tmp
  common="--quiet --progress none --overwrite"
  s3-synth --scene desk --seed 1 --output scene $common > log
  s3-slam --sequence scene --output run/1_slam $common > log
  s3-lift --model run/1_slam --masks scene/panoptic_noisy --classes coco --output run/2_lift $common > log
  s3-refine --model run/1_slam --semantics run/2_lift --output run/3_refine $common > log
  s3-report --run run --ground-truth scene/groundtruth.txt --output report.html --png pictures \
    --quiet --progress none > log
  ls -l report.html
  ls pictures
  s3-eval --estimate run/3_refine/frames.txt --ground-truth scene/groundtruth.txt
  zcat -f /usr/share/man/man1/s3-slam.1* | head -3
  ls /usr/share/bash-completion/completions/s3-* /usr/share/s3lam/configs/classes'
inside dpkg --remove s3lam > /dev/null
if inside sh -c 'ls /usr/bin/s3-*' 2> /dev/null; then
  echo "clean_root.sh: programs are left after removing the package" >&2
  exit 1
fi
echo "clean_root.sh: installed, run and removed"
