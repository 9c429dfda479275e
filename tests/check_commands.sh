#!/usr/bin/env bash
# Runs the commands of the pages: each line of a ```sh block, and commands and options between single backquotes.
#   bash tests/check_commands.sh BUILD SCRATCH [PAGE...]     BUILD is a finished build; SCRATCH is removed first; all pages
#                                                            by default
# Commands run unchanged in SCRATCH, where links make the sources and the programs look like a checkout. Commands that
# build, take minutes or need root are not run: their presets, targets, scripts, benchmarks and options must exist.
set -euo pipefail
root=$(cd "$(dirname "${BASH_SOURCE[0]}")/.." && pwd)
build=$(cd "$1" && pwd)
scratch=$(realpath -m "$2")
mapfile -t pages < <(realpath "${@:3}" 2>/dev/null || true)
[ $# -gt 2 ] || mapfile -t pages < <(find "$root"/{README.md,.github,bench,examples,include,tests} -name '*.md' | sort)
export root build scratch

for program in simulate track_file; do
  [ -x "$build/examples/$program" ] || { echo "skipped: $program is not built"; exit 77; }
done

rm -rf "$scratch"
mkdir -p "$scratch"/{home,help,build/release/{examples,bench,tests}}
export HOME=$scratch/home # what ~ stands for
for file in "$root"/*; do
  [ "$(basename "$file")" = build ] || ln -s "$file" "$scratch/"
done

touch "$scratch/help/evmarker_python" # a target beside the programs
python=""
if compgen -G "$build/examples/python/_evmarker*" >/dev/null; then
  python=$(sed -n 's/^Python_EXECUTABLE:[^=]*=//p' "$build/CMakeCache.txt")
fi
export python

# --- What stands in for what takes too long --------------------------------------------------------------------------

fault() {
  echo "$*" >&2
  return 1
}

# The first argument is the program. What it answers to --help was written down before.
check_options() {
  local program=$1 argument option
  for argument in "${@:2}"; do
    case $argument in
      --*)
        option=${argument%%=*}
        grep -qE -e "(^|[^a-z-])$option([^a-z0-9-]|$)" "$scratch/help/$program" || fault "$program has no option $option" || return
        ;;
      */*) [ -e "$argument" ] || fault "there is no $argument" || return ;;
    esac
  done
}

check_benchmarks() {
  local argument part
  for argument in "$@"; do
    [[ $argument == --benchmark_filter=* ]] || continue
    while read -r part; do
      [ -n "$("$build/bench/evmarker_bench" --benchmark_list_tests --benchmark_filter="$part" 2>/dev/null)" ] ||
        fault "no benchmark matches $part" || return
    done < <(tr '|' '\n' <<<"${argument#*=}")
  done
}

check_preset() { # configure|build|test PRESET
  (cd "$root" && command cmake --list-presets="$1") | grep -q "^ *\"$2\"" || fault "there is no $1 preset $2"
}

# Configures and installs, from BUILD where that is what is installed; presets and builds are only checked.
cmake() {
  case $1 in
    --preset) check_preset configure "$2" ;;
    --build)
      check_preset build "${2#build/}" || return
      while [ $# -gt 0 ]; do
        [ "$1" != --target ] || [ -e "$scratch/help/$2" ] || fault "there is no target $2" || return
        shift
      done
      ;;
    *)
      [ "$1 $2" != "--install build/release" ] || set -- --install "$build" "${@:3}"
      command cmake "$@" >"$scratch/cmake.txt" 2>&1 || fault "$(tail "$scratch/cmake.txt")" || return
      ! grep -A 3 "not used by the project" "$scratch/cmake.txt" >&2
      ;;
  esac
}

# Lists the tests instead of running them.
ctest() {
  [ "$1" = --preset ] || fault "ctest without a preset" || return
  check_preset test "$2" || return
  local tests
  echo "subdirs($build)" >"$scratch/CTestTestfile.cmake" # in BUILD it would overwrite the log of the last run
  tests=$(command ctest --test-dir "$scratch" -N "${@:3}") || return
  grep -q "^Total Tests: 0$" <<<"$tests" || return 0
  [ -d "$root/tests/$4" ] || fault "no test matches ${*:3}" || return
  echo "not run, not built: the tests that match ${*:3}"
}

# Runs the demo. Other scripts build, install or take minutes: they are there and can be parsed.
bash() {
  command bash -n "$1" || return
  [ "$1" != examples/demo.sh ] || command bash "$@"
}

gnuplot() {
  if type -P gnuplot >/dev/null && [ -x "$build/examples/replay" ]; then # which writes the table of delays
    command gnuplot "$@"
  else
    echo "not run, there is no gnuplot or no replay: gnuplot $*"
  fi
}

# tests/debian_packages.sh runs it.
cpack() { # --config build/release/CPackConfig.cmake ...
  [ -e "$build/${2#build/release/}" ] || fault "there is no $2"
}

# That for which the Python module is built; without the module, an environment whose Python says so.
python3() {
  if [ -n "$python" ]; then
    "$python" "$@"
  else
    mkdir -p "${!#}/bin"
    printf '#!/usr/bin/env bash\necho "not run, the Python module is not built: $*"\n' >"${!#}/bin/python"
    chmod +x "${!#}/bin/python"
  fi
}

# Lists the tests of a room instead of running them.
check_tests() { # ROOM [FILTER...]
  local program=$build/tests/$1_test
  [ -x "$program" ] || { echo "not run, not built: the tests of $1"; return; }
  ! "$program" --list-test-cases "${@:2}" | grep -q "filters: 0$" || fault "no test of $1 matches ${*:2}"
}

export -f fault check_options check_benchmarks check_preset cmake ctest bash gnuplot cpack python3 check_tests

# --- The programs: those of examples/ run, of the others the arguments are checked -----------------------------------

programs=(evmarker_bench)
for source in "$root"/{examples,bench}/*.cpp; do
  [[ $source == *_bench.cpp ]] || programs+=("$(basename "$source" .cpp)")
done
for program in "${programs[@]}"; do
  folder=bench
  [ ! -e "$root/examples/$program.cpp" ] || folder=examples
  here=$scratch/build/release/$folder/$program
  if [ ! -x "$build/$folder/$program" ]; then
    cat "$root/$folder"/*.[ch]pp >"$scratch/help/$program" # its options stand there in quotation marks
    echo "--benchmark_filter" >>"$scratch/help/$program"     # but for those of Google Benchmark
    printf '#!/usr/bin/env bash\necho "not run, %s is not built: its options are in the sources"\n' "$program" >"$here"
    echo "check_options $program \"\$@\"" >>"$here"
  elif [ $folder = examples ]; then
    case $program in
      quickstart | paper) touch "$scratch/help/$program" ;; # they take no options
      *) "$build/$folder/$program" --help >"$scratch/help/$program" ;;
    esac
    if [ $program = replay ]; then # slowly, so that it keeps up on a busy machine, too
      printf '#!/usr/bin/env bash\nexec "%s" "$@" --speed 0.1\n' "$build/$folder/$program" >"$here"
      chmod +x "$here"
    else
      ln -s "$build/$folder/$program" "$here"
    fi
    continue
  else
    "$build/$folder/$program" --help >"$scratch/help/$program"
    printf '#!/usr/bin/env bash\ncheck_options %s "$@" && check_benchmarks "$@"\n' "$program" >"$here"
  fi
  chmod +x "$here"
done

for folder in "$root"/tests/*/; do
  room=$(basename "$folder")
  printf '#!/usr/bin/env bash\ncheck_tests %s "$@"\n' "$room" >"$scratch/build/release/tests/${room}_test"
done
chmod +x "$scratch"/build/release/tests/*

# --- The pages -------------------------------------------------------------------------------------------------------

cd "$scratch"
count=0
left_out=0
faults=0

report() { # PAGE COMMAND MESSAGE
  faults=$((faults + 1))
  printf '%s: %s\n  %s\n' "${1#"$root/"}" "$2" "$3" | tee -a faults.txt
}

not_run() { # PAGE COMMAND REASON
  left_out=$((left_out + 1))
  printf '%s: %s\n%s\n' "${1#"$root/"}" "$2" "$3"
}

run_command() { # PAGE COMMAND
  count=$((count + 1))
  if [[ $2 =~ \ (recording\.(dat|aedat|aedat4|bag|mcap|db3))( |$) && ! -e ${BASH_REMATCH[1]} ]]; then
    not_run "$1" "$2" "not run, there are no real recordings"
    return
  fi
  local start=$SECONDS
  if ! command bash -c "$2" >output.txt 2>&1 </dev/null; then
    report "$1" "$2" "$(grep . output.txt | tail -n 3)"
  elif grep -q "^not run" output.txt; then
    not_run "$1" "$2" "$(grep "^not run" output.txt)"
  else
    printf '%s: %s (%d s)\n' "${1#"$root/"}" "$2" $((SECONDS - start))
  fi
}

# A span may name only an option, or begin with a program's name without its folder.
check_span() { # PAGE SPAN
  local words
  read -ra words <<<"$2"
  case ${words[0]} in
    bash | cmake | ctest | build/release/*) run_command "$1" "$2" ;;
    --[a-z]*)
      count=$((count + 1))
      grep -qhE -e "(^|[^a-z-])${words[0]}([^a-z0-9-]|$)" help/* || report "$1" "$2" "no program has the option ${words[0]}"
      ;;
    *)
      [ "${#words[@]}" -gt 1 ] && [ -e "help/${words[0]}" ] || return 0
      count=$((count + 1))
      local message
      message=$(check_options "${words[@]}" 2>&1) || report "$1" "$2" "$message"
      ;;
  esac
}

# What a reader has: a recording of a marker, and its calibration. Long enough for a busy machine to find it live.
build/release/examples/simulate recording.raw --calibration camera.yml --ids 7 --duration 1 >/dev/null

# Formats that the library does not write: real recordings, where they are.
real=$(realpath -m "$root/../shared/data/formats")
for recording in ncars.dat translating_square.aedat davis_lz4.aedat4 events_1.bag tags.mcap libcaer_rollover.db3; do
  [ ! -e "$real/$recording" ] || ln -s "$real/$recording" "recording.${recording##*.}"
done

for page in "${pages[@]}"; do
  while IFS= read -r line; do
    [ -z "$line" ] || run_command "$page" "$line"
  done < <(sed -n '/^```sh$/,/^```$/{/^```/d;p}' "$page" | # without comments, continued lines as one
    sed -E -e ':more' -e '/\\$/{N;s/ *\\\n */ /;b more' -e '}' -e 's/(^| +)#.*//')
  while IFS= read -r span; do
    check_span "$page" "$span"
  done < <(sed '/^```/,/^```$/d' "$page" | tr -s '\n' ' ' | grep -o '`[^`]*`' | tr -d '`')
done

[ $count -gt 0 ] || { echo "check_commands: no commands in ${pages[*]}" >&2; exit 1; }
if [ $faults -gt 0 ]; then
  printf '\ncheck_commands: %d of %d commands are wrong:\n' $faults $count >&2
  cat faults.txt >&2
  exit 1
fi
echo "check_commands: $((count - left_out)) commands are right, $left_out were not run"
