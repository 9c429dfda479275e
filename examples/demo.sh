#!/usr/bin/env bash
# From nothing to tracked poses: installs what is needed, builds the examples, simulates a hand-held recording, tracks it and
# leaves recording, calibration, poses and two pictures in build/demo.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."
bash cmake/install_dependencies.sh

step() { printf '\n== %s\n' "$*"; }
out=build/demo
bin=build/release/examples
mkdir -p "$out"

step "Building the examples"
cmake --preset release -D EVMARKER_BUILD_TESTS=OFF -D EVMARKER_BUILD_BENCH=OFF -D EVMARKER_BUILD_PYTHON=OFF >"$out/build.log"
cmake --build build/release --parallel "$(nproc)" --target simulate track_file evaluate >>"$out/build.log" ||
  { tail -n 30 "$out/build.log" >&2; exit 1; }

step "Simulating marker 7 in a swaying hand"
"$bin/simulate" "$out/recording.raw" --calibration "$out/camera.yml" --truth "$out/truth.csv" --ids 7 --duration 3

step "Tracking it"
"$bin/track_file" "$out/recording.raw" --camera "$out/camera.yml" --dictionary DICT_4X4_50 --marker-length 0.10 \
  --output "$out/poses.csv" --overlay "$out/overlay.png"

step "Comparing with the truth"
"$bin/evaluate" "$out/poses.csv" --truth "$out/truth.csv" --errors "$out/errors.csv"
gnuplot -c examples/demo.gnuplot "$out/errors.csv" "$out/error.png"

step "Look at"
printf '%s\n' "$out/poses.csv" "$out/overlay.png" "$out/error.png"
