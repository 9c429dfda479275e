#!/usr/bin/env bash
# The paper's backtracking figure by one command: builds, simulates, plots.
#   bash bench/failure_cases.sh [OUTPUT_DIRECTORY]     leaves failure_cases.png and its CSV files there
set -euo pipefail
source "$(dirname "${BASH_SOURCE[0]}")/build_program.sh" failure_cases
output=${1:-$root/build/failure_cases}
"$program" "$output"
gnuplot -e "directory='$output'" "$root/bench/failure_cases.gnuplot"
echo "$output/failure_cases.png"
