#!/bin/sh
# SPDX-License-Identifier: Apache-2.0
# cross.sh TARGET [CMAKE OPTION...]: builds the program, the library and the Python module for another system into build-cross/TARGET. The
# libraries that they link are built once, into PAGS_CROSS/TARGET, from sources that scripts/setup_cross.sh downloads. Ends with a line per
# product: the system libraries and the oldest system that it requires.
set -eu
cd "$(dirname "$0")/.."
targets="windows-x64 macos-arm64 macos-x64 linux-x64-glibc2.17 linux-arm64"
target=${1:-}
[ $# -eq 0 ] || shift
case " $targets " in
  *" $target "*) [ -n "$target" ] || target="" ;;
  *) target=${target:+?$target} ;;
esac
case $target in
  "" | "?"*)
    echo "cross: ${target:+no target is named '${target#?}'; }expected make cross TARGET=NAME, where NAME is one of $targets" >&2
    exit 2
    ;;
esac

cross=${PAGS_CROSS:-$HOME/.cache/pags-cross}
sh scripts/setup_cross.sh
cross=$(cd "$cross" && pwd)
export PAGS_CROSS="$cross" ZIG_GLOBAL_CACHE_DIR="$cross/zig-cache" ZIG_LOCAL_CACHE_DIR="$cross/zig-cache"
jobs=${JOBS:-$(nproc)}

# The libraries, anew if a row of the table or their build has changed.
recipe=$(cat scripts/cross_sources.txt cmake/zig.cmake cmake/cross_libraries/* | sha256sum | cut -d' ' -f1)
if [ "$(cat "$cross/$target/recipe" 2>/dev/null)" != "$recipe" ]; then
  echo "cross: libraries for $target"
  rm -rf "${cross:?}/$target" "$cross/build/$target"
  mkdir -p "$cross/build"
  if ! { cmake -S cmake/cross_libraries -B "$cross/build/$target" -DCMAKE_BUILD_TYPE=Release -DCMAKE_TOOLCHAIN_FILE="$PWD/cmake/zig.cmake" \
    -DPAGS_TARGET="$target" -DPAGS_CROSS="$cross" -DPAGS_SOURCES="$cross/sources" -DCMAKE_INSTALL_PREFIX="$cross/$target" &&
    cmake --build "$cross/build/$target" --parallel "$jobs" --target install; } >"$cross/build/$target.log" 2>&1; then
    tail -n 30 "$cross/build/$target.log" >&2
    echo "cross: the libraries didn't build; $cross/build/$target.log has the whole log" >&2
    exit 1
  fi
  echo "$recipe" >"$cross/$target/recipe"
fi

# The engine. What needs a library that isn't among those is left out: pictures other than PNG, JPEG and EXR, and where Embree isn't built
# synth and proxies.
proxies=OFF
[ ! -e "$cross/$target/lib/cmake/TinyGLTF" ] || proxies=ON
build=${PAGS_BUILD:-build-cross/$target}
cmake -S . -B "$build" -DCMAKE_BUILD_TYPE=Release -DCMAKE_TOOLCHAIN_FILE="$PWD/cmake/zig.cmake" -DPAGS_TARGET="$target" -DPAGS_CROSS="$cross" \
  -DPAGS_COMPLETE=ON -DPAGS_IMAGES=OFF -DPAGS_VIEW=OFF -DPAGS_EMBREE=$proxies -DPAGS_EXPORT=$proxies -DPAGS_TESTS=OFF "$@"
cmake --build "$build" --parallel "$jobs"
python3 scripts/cross_report.py "$build"
