#!/bin/sh
# SPDX-License-Identifier: Apache-2.0
# setup.sh [min|demo]: installs missing Debian packages: all that make check uses, or only those of the core, the program and make quick (min),
# or these and Embree (demo). Requires no root where nothing is missing.
set -u

min="gcc libc6-dev make cmake ninja-build pkg-config zlib1g-dev libzstd-dev libpng-dev libjpeg62-turbo-dev libopenexr-dev libcmocka-dev python3"
case ${1:-all} in
  min) needed="$min python3-venv" wanted="" ;;
  demo) needed="$min libembree-dev" wanted="" ;;
  all)
    # Parts of the program: pictures, synthetic scenes, import, proxies, SOG, pags view.
    needed="$min build-essential python3-venv libwebp-dev libopenimageio-dev openimageio-tools libembree-dev libprotobuf-c-dev protobuf-c-compiler"
    needed="$needed libexpat1-dev libtinygltf-dev nlohmann-json3-dev libmeshoptimizer-dev libqhull-dev libosd-dev libwebsockets-dev"
    # The Python module, ranks (docs/cluster.md), and tests: NEON kernels, Blender, fuzzing (clang), videos, valgrind, exports in a browser.
    wanted="python3-dev libopenmpi-dev openmpi-bin gcc-aarch64-linux-gnu libc6-dev-arm64-cross qemu-user"
    wanted="$wanted blender python3-numpy xvfb xauth imagemagick libgl1-mesa-dri clang libclang-rt-dev ffmpeg valgrind chromium"
    command -v npm >/dev/null || wanted="$wanted nodejs npm"
    ;;
  *)
    echo "usage: setup.sh [min|demo]" >&2
    exit 2
    ;;
esac

if ! command -v dpkg-query >/dev/null || ! command -v apt-get >/dev/null; then
  echo "setup: not a Debian system. Please install:"
  echo "  for make, make quick: a C17 compiler (gcc 12 or clang 14 or later), CMake 3.24, make (ninja if wanted), pkg-config, zlib and zstd with their"
  echo "    static libraries, libpng 1.6, libjpeg-turbo 2, OpenEXR 3.1 or later, cmocka, Python 3"
  [ "${1:-all}" = min ] || echo "  for make demo: Embree 3 or 4"
  [ "${1:-all}" != all ] || cat <<'END'
  for the other parts of the program, which are left out where a library is missing: a C++17 compiler; OpenImageIO 2.4 to 3; libwebp with its
    static library (SOG); protobuf-c with protoc-c, expat (pags import); tinygltf, meshoptimizer, qhull, OpenSubdiv (proxies);
    libwebsockets 4 (pags view); Open MPI 4 or another MPI; the headers of Python 3.11 or later (Python module, Blender add-on)
  for the tests: Blender, Xvfb, ImageMagick; aarch64-linux-gnu-gcc and qemu-aarch64 (NEON kernels); node, npm and Chromium (exporters);
    clang, valgrind, ffmpeg
END
  exit 0
fi

missing_of() {
  for package; do
    case $(dpkg-query -W -f '${Status}' "$package" 2>/dev/null) in
      *" installed") ;;
      *) printf '%s ' "$package" ;;
    esac
  done
}

# shellcheck disable=SC2086 # lists of words
missing_needed=$(missing_of $needed)
# shellcheck disable=SC2086
missing_wanted=$(missing_of $wanted)
if [ -z "$missing_needed$missing_wanted" ]; then
  exit 0
fi

if [ "$(id -u)" -eq 0 ]; then
  as_root=""
elif command -v sudo >/dev/null; then
  as_root="sudo"
else
  echo "setup: missing: $missing_needed$missing_wanted"
  echo "setup: neither root nor sudo here; as root, run"
  echo "  apt-get install --no-install-recommends $missing_needed$missing_wanted"
  [ -z "$missing_needed" ]
  exit
fi

install() {
  # shellcheck disable=SC2086
  $as_root env DEBIAN_FRONTEND=noninteractive apt-get install -y -q --no-install-recommends "$@"
}

echo "setup: installing $missing_needed$missing_wanted"
$as_root apt-get update -q || echo "setup: apt-get update failed; trying with the present lists"
# shellcheck disable=SC2086
if [ -n "$missing_needed" ] && ! install $missing_needed; then
  echo "setup: could not install $missing_needed" >&2
  exit 1
fi
# shellcheck disable=SC2086
if [ -n "$missing_wanted" ] && ! install $missing_wanted; then
  echo "setup: could not install $missing_wanted; continuing without the parts and tests that use them"
fi
