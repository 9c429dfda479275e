#!/usr/bin/env bash
# The latency of live poses by one command: builds, simulates, and replays five times each, left alone and beside a program
# that keeps a processor busy. Five minutes on a machine that does nothing else.
#   bash bench/live_latency.sh [REPLAY_OPTION...]     such as --priority normal
set -euo pipefail
root=$(cd "$(dirname "${BASH_SOURCE[0]}")/.." && pwd)
build=$root/build/bench-programs
cmake -S "$root" -B "$build" -G Ninja -D CMAKE_BUILD_TYPE=Release -D EVMARKER_BUILD_TESTS=OFF -D EVMARKER_BUILD_EXAMPLES=ON > /dev/null
cmake --build "$build" --target simulate replay
folder=$(mktemp -d)
busy=
trap 'rm -rf "$folder"; [ -z "$busy" ] || kill "$busy"' EXIT
"$build/examples/simulate" "$folder/marker.raw" --frequency 2 --duration 5 --quiet > /dev/null

# Sorts five last lines of replay by their p99; a run without poses has none.
summary() {
  sed -E 's/.*p50=([0-9]+) p99=([0-9]+).*dropped=([0-9]+).*poses=([0-9]+)/\2 \1 \3 \4/' | sort -n | awk '
    $4 == 0 { none++; next } { half[++n] = $2; most[n] = $1; lost += $3 }
    END { printf "p50 %d us, p99 %d us (%d to %d), %d dropped, %d without poses\n",
                 half[int((n + 1) / 2)], most[int((n + 1) / 2)], most[1], most[n], lost, none }'
}
in_turn() { # WHERE REPLAY_OPTION...
  for speed in 0.88 1.13 1.51 2.02; do # 2.1, 2.7, 3.6 and 4.8 M events/s
    for detection in "" "--detect-for 1"; do
      printf '%s, speed %s %s (load %s): ' "$1" $speed "$detection" "$(cut -d ' ' -f 1 /proc/loadavg)"
      for _ in 1 2 3 4 5; do
        # shellcheck disable=SC2086
        "$build/examples/replay" "$folder/marker.raw" --camera "$folder/marker.yml" --quiet --marker-length 0.10 \
          --speed $speed $detection "${@:2}" | tail -n 1
      done | summary
    done
  done
}

in_turn "left alone" "$@"
while :; do :; done &
busy=$!
in_turn "beside a busy program" "$@"
