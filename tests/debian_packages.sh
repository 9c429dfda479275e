#!/usr/bin/env bash
# Makes the Debian packages, unpacks them and uses what is in them as a user would.
#   bash tests/debian_packages.sh BUILD SCRATCH     BUILD is a finished build; SCRATCH is removed first
set -euo pipefail
consumers=$(cd "$(dirname "${BASH_SOURCE[0]}")/consumer" && pwd)
build=$(cd "$1" && pwd)
scratch=$(realpath -m "$2")
for program in dpkg-deb dpkg-shlibdeps pkg-config; do
  command -v $program >/dev/null || { echo "skipped: there is no $program"; exit 77; }
done

fail() {
  echo "debian_packages: $*" >&2
  exit 1
}

expect() { # TEXT PART MESSAGE
  grep -qF -e "$2" <<<"$1" || fail "$3: $1"
}

rm -rf "$scratch"
mkdir -p "$scratch"
cd "$scratch"
cpack --config "$build/CPackConfig.cmake" -B "$scratch/packages" >cpack.txt 2>&1 || fail "$(cat cpack.txt)"
dev=$(echo packages/libevmarker-dev_*_all.deb)
tools=$(echo packages/evmarker-tools_*_"$(dpkg --print-architecture)".deb)
for package in "$dev" "$tools"; do
  dpkg-deb -x "$package" root || fail "no package $package"
done

expect "$(dpkg-deb -f "$dev" Depends)" "libeigen3-dev" "what libevmarker-dev depends on"
for library in libc6 libstdc++6 libopencv-calib3d libhdf5; do
  expect "$(dpkg-deb -f "$tools" Depends)" "$library" "what evmarker-tools depends on"
done

# Without the prefix they would take the place of other packages' programs. (grep -q would end while they still write.)
for path in root/usr/bin/*; do
  name=$(basename "$path")
  [[ $name == evmarker_* ]] || fail "$name is in /usr/bin"
  [ -x "$path" ] || fail "$path leads nowhere"
  "$path" --help | grep "^Usage: $name " >/dev/null || fail "$name calls itself by another name"
  if command -v help2man >/dev/null; then
    zcat "root/usr/share/man/man1/$name.1.gz" | grep -xF ".B $name" >/dev/null || fail "$name has no page of the manual"
  fi
done
expect "$(zcat root/usr/share/man/man1/evmarker_track_file.1.gz)" 'marker\-length' "its page of the manual"

# Nothing of the source tree or of this machine's folders is meant.
! grep -rlF -e "$build" -e "$(dirname "$consumers")" root/usr/share || fail "a path of the build is in it"

export PATH=$PWD/root/usr/bin:$PATH
evmarker_simulate hand.raw --duration 0.1 --truth truth.csv --quiet
evmarker_track_file hand.raw --camera hand.yml --marker-length 0.1 --output poses.csv --quiet
evmarker_evaluate poses.csv --truth truth.csv >evaluation.txt
[ "$(grep -c ,tracking, poses.csv)" -gt 300 ] || fail "hardly any poses: $(head poses.csv)"

cmake -S "$consumers/find_package_core" -B find_package -D CMAKE_PREFIX_PATH="$PWD/root/usr" >consumer.txt &&
  cmake --build find_package >>consumer.txt || fail "find_package: $(cat consumer.txt)"
find_package/consumer

export PKG_CONFIG_PATH=$PWD/root/usr/share/pkgconfig
[ "$(pkg-config --modversion evmarker)" = "$(dpkg-deb -f "$dev" Version)" ] || fail "pkg-config has another version"
read -ra flags < <(pkg-config --cflags evmarker)
"${CXX:-c++}" -std=c++20 "${flags[@]}" "$consumers/core.cpp" -o with_pkg_config
./with_pkg_config

if command -v lintian >/dev/null; then
  lintian --fail-on error "$dev" "$tools"
fi
echo "debian_packages: $dev and $tools can be used"
