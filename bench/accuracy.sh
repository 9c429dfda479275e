#!/usr/bin/env bash
# The accuracy table and its plot by one command: builds, simulates, tracks, compares. A quarter of an hour on two cores;
# --quick takes two minutes.
#   bash bench/accuracy.sh [OUTPUT_DIRECTORY [OPTION...]]     options are those of evmarker_accuracy
set -euo pipefail
root=$(cd "$(dirname "${BASH_SOURCE[0]}")/.." && pwd)
output=${1:-$root/build/accuracy}
shift || true
command -v gnuplot > /dev/null || { echo "accuracy.sh: gnuplot is missing (apt-get install gnuplot-nox)" >&2; exit 1; }
cmake -S "$root" -B "$root/build/bench-programs" -G Ninja -D CMAKE_BUILD_TYPE=Release -D EVMARKER_BUILD_TESTS=OFF \
  -D EVMARKER_BUILD_EXAMPLES=OFF > /dev/null
cmake --build "$root/build/bench-programs" --target evmarker_accuracy
"$root/build/bench-programs/bench/evmarker_accuracy" --out "$output" "$@"
gnuplot -e "directory='$output'" "$root/bench/accuracy.gnuplot"
echo "$output/accuracy.md, $output/accuracy.png"
