#!/usr/bin/env bash
# Proves that check_commands.sh finds each fault that it is there for, on pages written here.
#   bash tests/check_commands_faults.sh BUILD SCRATCH
set -euo pipefail
check=$(dirname "${BASH_SOURCE[0]}")/check_commands.sh
build=$1
mkdir -p "$2"
scratch=$(cd "$2" && pwd)
page=$scratch/page.md

# Sets code and output.
run_check() {
  code=0
  output=$(bash "$check" "$build" "$scratch/checked" "$page" 2>&1) || code=$?
}

expect() { # CODE TEXT...
  local text
  for text in "${@:2}"; do
    if [ $code -ne "$1" ] || ! grep -qF -e "$text" <<<"$output"; then
      printf '%s\nshould end with code %s and say "%s", ended with code %s and said\n%s\n' "$(cat "$page")" "$1" "$text" \
        $code "$output" >&2
      exit 1
    fi
  done
}

cat >"$page" <<'PAGE'
With `track_file --board board.yml`, `--blur` and `--update decoupled`; no commands are `--` and `T_camera_marker`.

```sh
# a comment, and a continued line
build/release/examples/simulate new.raw --duration 0.02 --ids 3 \
  --calibration new.yml   # its calibration
cmake --preset release && cmake --build build/release --target evmarker_bench && build/release/bench/evmarker_bench
bash bench/accuracy.sh
ctest --preset release -L tracking
```
PAGE
run_check
if [ $code -eq 77 ] || grep "^not run" <<<"$output"; then
  echo "skipped: not everything is built"
  exit 77
fi
expect 0 "check_commands: 7 commands are right" "--ids 3 --calibration new.yml"

cat >"$page" <<'PAGE'
With `track_file --boards board.yml` and `--no-such-option 3`, by `bash bench/no_such_script.sh`.

```sh
build/release/examples/trackfile recording.raw
build/release/examples/track_file recording.raw --camera camera.yml --marker-length 0.1 --no-such-output poses.csv
build/release/examples/track_file no_such.raw --camera camera.yml --marker-length 0.1 && echo
build/release/examples/track_camera --camera camera.yml --no-such-screen
build/release/bench/overload --no-such-rate 3
build/release/bench/pose_digests bench/no_such_digests.txt
build/release/bench/evmarker_bench --benchmark_filter='filter|no_such_benchmark'
cmake --preset no_such_preset && cmake --build build/release
cmake --preset release && cmake --build build/no_such_build
cmake --preset release && cmake --build build/release --target no_such_target && echo
cmake -S . -B build/install -D EVMARKER_BUILD_TESTS=OFF -D EVMARKER_BUILD_EXAMPLES=OFF -D EVMARKER_BUILD_BENCH=OFF -D NO_SUCH_SETTING=1
ctest --preset no_such_tests -L tracking
ctest --preset release -L no_such_room
build/release/tests/tracking_test --source-file='*no_such_header*'
```
PAGE
run_check
expect 1 "check_commands: 17 of 17 commands are wrong" "track_file has no option --boards" "no program has the option --no-such-option" \
  "no_such_script.sh: No such file" "trackfile: No such file" "not expected: poses.csv --no-such-output" "no_such.raw: cannot open" \
  "--no-such-screen" "overload has no option --no-such-rate" "there is no bench/no_such_digests.txt" \
  "no benchmark matches no_such_benchmark" "no configure preset no_such_preset" "no build preset no_such_build" \
  "no target no_such_target" "NO_SUCH_SETTING" "no test preset no_such_tests" "no test matches -L no_such_room" \
  "no test of tracking matches"

echo "Nothing to run." >"$page"
run_check
expect 1 "no commands in"
echo "check_commands_faults: every fault is found"
