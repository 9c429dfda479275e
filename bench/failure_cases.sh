#!/usr/bin/env bash
# The paper's backtracking figure by one command: builds, simulates, plots.
#   bash bench/failure_cases.sh [OUTPUT_DIRECTORY]     leaves failure_cases.png and its CSV files there
set -euo pipefail
root=$(cd "$(dirname "${BASH_SOURCE[0]}")/.." && pwd)
output=${1:-$root/build/failure_cases}
command -v gnuplot > /dev/null || { echo "failure_cases.sh: gnuplot is missing (apt-get install gnuplot-nox)" >&2; exit 1; }
cmake -S "$root" -B "$root/build/bench-programs" -G Ninja -D CMAKE_BUILD_TYPE=Release -D EVMARKER_BUILD_TESTS=OFF \
  -D EVMARKER_BUILD_EXAMPLES=OFF > /dev/null
cmake --build "$root/build/bench-programs" --target failure_cases
"$root/build/bench-programs/bench/failure_cases" "$output"
gnuplot -e "directory='$output'" "$root/bench/failure_cases.gnuplot"
echo "$output/failure_cases.png"
