#!/usr/bin/env bash
# What the library costs a compiler: seconds as ratios to <Eigen/Geometry> alone in the same run, the least of three, and
# the most memory. Two minutes.
#   bash bench/compile_cost.sh [COMPILER ...]     the C++ compilers that are there, if none is named
set -euo pipefail
root=$(cd "$(dirname "${BASH_SOURCE[0]}")/.." && pwd)
scratch=$(mktemp -d)
trap 'rm -rf "$scratch"' EXIT
for tool in /usr/bin/time pkg-config; do
  command -v "$tool" >/dev/null || { echo "compile_cost: needs $tool: apt install time pkg-config" >&2; exit 1; }
done
read -ra folders <<<"$(pkg-config --cflags eigen3 opencv4)"

[ $# -gt 0 ] || set -- $(command -v g++ clang++ clang++-14 | head -n 2)

echo '#include <Eigen/Geometry>' >"$scratch/eigen.cpp"
echo '#include <evmarker/evmarker.hpp>' >"$scratch/evmarker.cpp"
cp "$root/examples/quickstart.cpp" "$scratch/quickstart.cpp"

# Prints the user seconds and the kilobytes that a compilation takes.
compile() {
  /usr/bin/time -f "%U %M" "$compiler" -std=c++20 -I"$root/include" "${folders[@]/#-I/-isystem}" "${@:2}" -c \
    "$scratch/$1.cpp" -o "$scratch/$1.o" 2>&1 | tail -n 1
}

for compiler in "$@"; do
  "$compiler" --version | head -n 1
  for round in 1 2 3; do
    for job in "eigen" "evmarker" "quickstart -O2"; do
      # shellcheck disable=SC2086  # options are words
      echo "$job: $(compile $job)"
    done
  done | awk -F ': ' '
    { split($2, cost, " ")
      if (!($1 in seconds)) { order[++jobs] = $1; seconds[$1] = cost[1]; memory[$1] = cost[2] }
      if (cost[1] < seconds[$1]) seconds[$1] = cost[1]
      if (cost[2] > memory[$1]) memory[$1] = cost[2] }
    END { for (i = 1; i <= jobs; ++i)
      printf "  %-15s %6.2f s  %5.1f times eigen  %5.0f MB\n", order[i], seconds[order[i]],
        seconds[order[i]] / seconds["eigen"], memory[order[i]] / 1024 }'
done
