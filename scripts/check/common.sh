# SPDX-License-Identifier: Apache-2.0
# shellcheck shell=sh disable=SC2034
# Read by the scripts of this folder, each of which is `make check-NAME`. The second comment line of a script is its line of `make help`.
set -eu
cd "$(dirname "$0")/../.."
jobs=${JOBS:-$(nproc)}
pags=$PWD/build/pags
scene=$(realpath -m "${SCENE:-build/demo/scene}")

build() { # build [TARGET...]: the release build
  cmake --preset release >/dev/null
  cmake --build --preset release --parallel "$jobs" --target "${@:-all}"
}

build_addon() { # sets $addon, the zip of the add-on
  make --no-print-directory addon JOBS="$jobs"
  addon=$(ls "$PWD"/build/pags-blender-*.zip)
}

build_scene() { # trains the scene of the demo unless SCENE names another
  [ -e "$scene/scene.json" ] || make --no-print-directory demo JOBS="$jobs"
}
