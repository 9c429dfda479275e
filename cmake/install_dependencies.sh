#!/usr/bin/env bash
# Installs what building, testing and plotting evmarker need on Debian and Ubuntu. Says nothing when all of it is there.
set -euo pipefail

packages=(
  g++ cmake ninja-build
  libeigen3-dev                         # the core
  libopencv-dev libopencv-contrib-dev   # evmarker::opencv
  libreaderwriterqueue-dev              # evmarker::live
  liblz4-dev libzstd-dev libbz2-dev     # evmarker::lz4, evmarker::zstd, evmarker::bz2: compressed recordings
  libhdf5-dev libsqlite3-dev            # evmarker::hdf5, evmarker::sqlite3: recordings
  libcli11-dev                          # examples
  libopencv-highgui-dev libopencv-videoio-dev # examples: windows, videos
  libcairo2-dev pkg-config              # examples: print_board
  libceres-dev                          # examples: calibrate
  pybind11-dev python3-dev python3-numpy # examples: the Python module
  python3-venv python3-matplotlib       # examples: where it is installed, its plot
  help2man dpkg-dev                     # Debian packages: pages of the manual, dependencies
  doctest-dev libbenchmark-dev          # tests, benchmarks
  python3-pytest                        # tests of the Python module
  clang                                 # tests: it compiles all that is public, too
  libapriltag-dev                       # one of the methods that evmarker_accuracy compares
  gnuplot-nox                           # plots
)

fail() {
  echo "install_dependencies: $1" >&2
  echo "install_dependencies: please install: ${missing[*]}" >&2
  exit 1
}

missing=("${packages[@]}")
command -v apt-get >/dev/null && command -v dpkg-query >/dev/null ||
  fail "no apt here, so it is not known what is missing (see also cmake/install_dependencies.sh)"

missing=()
for package in "${packages[@]}"; do
  status=$(dpkg-query --show --showformat='${db:Status-Status}' "$package" 2>/dev/null || true)
  [ "$status" = installed ] || missing+=("$package")
done
[ ${#missing[@]} -gt 0 ] || exit 0

as_root=()
if [ "$(id -u)" -ne 0 ]; then
  command -v sudo >/dev/null && sudo --non-interactive true 2>/dev/null || fail "not root, and no sudo without a password"
  as_root=(sudo --non-interactive)
fi

echo "install_dependencies: installing ${missing[*]}"
export DEBIAN_FRONTEND=noninteractive
"${as_root[@]}" apt-get update -qq || fail "apt-get update failed"
"${as_root[@]}" apt-get install -y -qq --no-install-recommends "${missing[@]}" || fail "apt-get install failed"
