#!/usr/bin/env bash
# How right `calibrate` is, by one command: simulates a grid of 6 x 6 AprilTags that a hand moves before two sensors, with two
# lenses, in bright light and in dim, and compares. A line for each recording; some four minutes each.
#   bash bench/calibration.sh [SEED...]
set -euo pipefail
root=$(cd "$(dirname "${BASH_SOURCE[0]}")/.." && pwd)
build=$root/build/bench-programs
cmake -S "$root" -B "$build" -G Ninja -D CMAKE_BUILD_TYPE=Release -D EVMARKER_BUILD_TESTS=OFF -D EVMARKER_BUILD_EXAMPLES=ON > /dev/null
cmake --build "$build" --target simulate calibrate > /dev/null
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
printf 'target_type: aprilgrid\ntagCols: 6\ntagRows: 6\ntagSize: 0.03\ntagSpacing: 0.3\nborder: 1\n' > "$folder/grid.yml"
[ $# -gt 0 ] || set -- 1 2 3
for seed in "$@"; do
  for sensor in davis346 gen3; do
    for lens in radtan:-0.25,0.09,0.0007,-0.0005 fisheye:-0.02,0.01,-0.005,0.001; do
      for light_lag_us in 200 2000; do
        "$build/examples/simulate" "$folder/hand.raw" --board "$folder/grid.yml" --sensor $sensor --lens $lens --light-lag-us $light_lag_us \
          --distance 0.32 --sway 0.1 --turn 35,35,25 --frequency 0.4 --duration ${DURATION_S:-20} --seed "$seed" --quiet > /dev/null
        printf '%s, %s, light lag %s us, seed %s: ' $sensor ${lens%%:*} $light_lag_us "$seed"
        "$build/examples/calibrate" "$folder/hand.raw" --board "$folder/grid.yml" --output "$folder/camera.yml" --model ${lens%%:*} \
          --truth "$folder/hand.yml" --quiet 2>&1 | awk '/^[fc][xy] |^off/ { line = line $0 "; " } END { print line }' || true
      done
    done
  done
done
