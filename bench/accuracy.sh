#!/usr/bin/env bash
# The accuracy table and its plot by one command: builds, simulates, tracks, compares. Three quarters of an hour on two
# cores; --quick takes some minutes.
#   bash bench/accuracy.sh [OUTPUT_DIRECTORY [OPTION...]]     options are those of evmarker_accuracy
set -euo pipefail
source "$(dirname "${BASH_SOURCE[0]}")/build_program.sh" evmarker_accuracy
output=${1:-$root/build/accuracy}
shift || true
"$program" --out "$output" "$@"
gnuplot -e "directory='$output'" "$root/bench/accuracy.gnuplot"
echo "$output/accuracy.md, $output/accuracy.png"
