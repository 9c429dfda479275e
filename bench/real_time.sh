#!/usr/bin/env bash
# The paper's real-time figure by one command: builds, simulates, tracks with n = 1 to 100, plots. A minute.
#   bash bench/real_time.sh [OUTPUT_DIRECTORY]     leaves real_time.png and real_time.csv there
set -euo pipefail
source "$(dirname "${BASH_SOURCE[0]}")/build_program.sh" real_time
output=${1:-$root/build/real_time}
mkdir -p "$output"
"$program" "$output/real_time.csv"
gnuplot -e "directory='$output'" "$root/bench/real_time.gnuplot"
echo "$output/real_time.png"
