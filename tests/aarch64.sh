#!/usr/bin/env bash
# Builds tests for aarch64 and runs them under QEMU, on Debian or Ubuntu on another processor: each of the rooms that are
# named, by default those that meet files, threads and vectors.
#   tests/aarch64.sh [--install] [ROOM...]
# Tests take 15 to 30 times as long there: of the other rooms, search, update and simulation less than ten minutes each,
# tracking and model more than an hour.
# Needs a cross compiler, QEMU, mmdebstrap, CMake and Ninja; --install installs those that are missing, as root. The
# libraries for aarch64 are fetched once, into build/aarch64-sysroot: installed, Debian's OpenCV for aarch64 would take
# the place of the native one.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."

programs=(aarch64-linux-gnu-g++ qemu-aarch64 mmdebstrap cmake ninja)
packages=(g++-aarch64-linux-gnu qemu-user mmdebstrap cmake ninja-build)
libraries=(
  libeigen3-dev libopencv-dev libopencv-contrib-dev libreaderwriterqueue-dev
  liblz4-dev libzstd-dev libbz2-dev libhdf5-dev libsqlite3-dev
  doctest-dev libbenchmark-dev libcli11-dev
)

fail() {
  echo "aarch64.sh: $*" >&2
  exit 1
}

if [ "${1:-}" = --install ]; then
  shift
  apt-get update -qq || fail "apt-get update failed; as root?"
  DEBIAN_FRONTEND=noninteractive apt-get install -y -qq --no-install-recommends --no-remove "${packages[@]}" ||
    fail "apt-get install failed"
fi
[ $# -gt 0 ] || set -- base simd events matching io live
for room in "$@"; do
  ls "tests/$room"/*_test.cpp >/dev/null 2>&1 || fail "there is no room '$room' (ls tests)"
done
for program in "${programs[@]}"; do
  command -v "$program" >/dev/null || fail "$program is missing: tests/aarch64.sh --install, or apt-get install ${packages[*]}"
done

sysroot=build/aarch64-sysroot
if [ ! -d "$sysroot" ]; then
  . /etc/os-release
  rm -rf "$sysroot.part"
  mkdir -p build
  mmdebstrap --quiet --variant=extract --architectures=arm64 --include="$(IFS=, && echo "${libraries[*]}")" \
    "${VERSION_CODENAME:?}" "$sysroot.part" || fail "the libraries for aarch64 could not be fetched"
  # Nothing of a package is run, so that links which would be made then are missing.
  ln -s blas/libblas.so.3 lapack/liblapack.so.3 "$sysroot.part/usr/lib/aarch64-linux-gnu/"
  mv "$sysroot.part" "$sysroot"
fi

cmake --preset aarch64
cmake --build --preset aarch64 --target "${@/%/_test}"
ctest --preset aarch64 --label-regex "^($(IFS='|' && echo "$*"))\$"
