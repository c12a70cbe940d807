#!/bin/sh
# SPDX-License-Identifier: Apache-2.0
# Installs the missing packages of those that the build, the demo and the tests need. Needs no root where none is missing.
set -u

needed="build-essential cmake pkg-config zlib1g-dev libzstd-dev libwebp-dev libpng-dev libjpeg62-turbo-dev libopenexr-dev libopenimageio-dev openimageio-tools libembree-dev libprotobuf-c-dev protobuf-c-compiler libexpat1-dev libtinygltf-dev nlohmann-json3-dev libmeshoptimizer-dev libqhull-dev libosd-dev libwebsockets-dev libcmocka-dev python3 python3-venv"
# For the tests of the NEON kernels, the Python module and the tests in Blender; the rest works without these.
wanted="gcc-aarch64-linux-gnu libc6-dev-arm64-cross qemu-user python3-dev blender python3-numpy xvfb xauth imagemagick libgl1-mesa-dri"
# For several processes that share work out (docs/cluster.md) and their tests.
wanted="$wanted libopenmpi-dev openmpi-bin"
# For make fuzz: libFuzzer and the sanitizers of Debian 12's clang.
wanted="$wanted clang libclang-rt-dev"
# For the tests of pictures taken out of videos.
wanted="$wanted ffmpeg"
# For make valgrind.
wanted="$wanted valgrind"
# For the tests in which other programs read exported files, one of them in a browser. An npm that is there already is used.
wanted="$wanted chromium"
command -v npm >/dev/null || wanted="$wanted nodejs npm"

if ! command -v dpkg-query >/dev/null || ! command -v apt-get >/dev/null; then
  echo "setup: this is no Debian; please see to these yourself:"
  echo "  a C17 and C++17 compiler (gcc 12 or clang 14 or later), CMake 3.24, make, pkg-config,"
  echo "  zlib and zstd with their static libraries, libpng 1.6, libjpeg-turbo 2, OpenEXR 3.1 or later, OpenImageIO 2.4 to 3,"
  echo "  Embree 3 or 4, libwebp with its static library (for SOG),"
  echo "  protobuf-c with protoc-c, expat, tinygltf, meshoptimizer, qhull, OpenSubdiv, libwebsockets 4, cmocka, Python 3;"
  echo "  for several processes at one piece of work: Open MPI 4 or another MPI;"
  echo "  for the NEON kernels' tests: aarch64-linux-gnu-gcc and qemu-aarch64;"
  echo "  for the Python module and the Blender add-on: the headers of Python 3.11 or later; for their tests Blender, Xvfb, ImageMagick;"
  echo "  for the exporters' tests: node, npm and Chromium"
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
$as_root apt-get update -q || echo "setup: apt-get update failed; trying with the lists that are here"
# shellcheck disable=SC2086
if [ -n "$missing_needed" ] && ! install $missing_needed; then
  echo "setup: could not install $missing_needed" >&2
  exit 1
fi
# shellcheck disable=SC2086
if [ -n "$missing_wanted" ] && ! install $missing_wanted; then
  echo "setup: could not install $missing_wanted; going on without the NEON kernels' tests, the Python module, Blender's tests or other programs' readers in the exporters'"
fi
