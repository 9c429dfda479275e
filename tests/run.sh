#!/usr/bin/env bash
# Builds and runs every test: those of the package, its consumers, the Python module and a few rooms, optimised; all
# others under the address and undefined behaviour sanitizers; those of threads under the thread sanitizer, too. Stops
# at the first failure.
# Arguments name other presets to run instead: tests/run.sh release runs all that needs no sanitizer, optimised.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."

# What is needed may be there without being a package: CMake says what it does not find.
bash cmake/install_dependencies.sh || echo "run.sh: going on without" >&2

cores=$(nproc)
export CMAKE_BUILD_PARALLEL_LEVEL=${CMAKE_BUILD_PARALLEL_LEVEL:-$cores}
export CTEST_PARALLEL_LEVEL=${CTEST_PARALLEL_LEVEL:-$cores}
if [ $# -eq 0 ]; then
  set -- package asan tsan
fi
for preset in "$@"; do
  printf '\n=== %s ===\n' "$preset"
  cmake --workflow --preset "$preset"
done
