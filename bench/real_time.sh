#!/usr/bin/env bash
# The paper's real-time figure by one command: builds, simulates, tracks with n = 1 to 100, plots. A minute.
#   bash bench/real_time.sh [OUTPUT_DIRECTORY]     leaves real_time.png and real_time.csv there
set -euo pipefail
root=$(cd "$(dirname "${BASH_SOURCE[0]}")/.." && pwd)
output=${1:-$root/build/real_time}
command -v gnuplot > /dev/null || { echo "real_time.sh: gnuplot is missing (apt-get install gnuplot-nox)" >&2; exit 1; }
cmake -S "$root" -B "$root/build/bench-programs" -G Ninja -D CMAKE_BUILD_TYPE=Release -D EVMARKER_BUILD_TESTS=OFF \
  -D EVMARKER_BUILD_EXAMPLES=OFF > /dev/null
cmake --build "$root/build/bench-programs" --target real_time
mkdir -p "$output"
"$root/build/bench-programs/bench/real_time" "$output/real_time.csv"
gnuplot -e "directory='$output'" "$root/bench/real_time.gnuplot"
echo "$output/real_time.png"
