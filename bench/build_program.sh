# Sourced by the scripts beside it: builds one of the bench programs, optimised.
#   source build_program.sh PROGRAM    sets root, program; ends the script where gnuplot is missing, which plots its results
root=$(cd "$(dirname "${BASH_SOURCE[0]}")/.." && pwd)
command -v gnuplot > /dev/null || { echo "$(basename "$0"): gnuplot is missing (apt-get install gnuplot-nox)" >&2; exit 1; }
cmake -S "$root" -B "$root/build/bench-programs" -G Ninja -D CMAKE_BUILD_TYPE=Release -D EVMARKER_BUILD_TESTS=OFF \
  -D EVMARKER_BUILD_EXAMPLES=OFF > /dev/null
cmake --build "$root/build/bench-programs" --target "$1"
program=$root/build/bench-programs/bench/$1
