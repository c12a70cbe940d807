#!/bin/sh
# SPDX-License-Identifier: Apache-2.0
# The wheels in dist/: installed, compared with build/pags bit by bit (OLD=FOLDER: in an older Debian, too).
# The wheel for 64-bit ARM runs under an emulator; of those for macOS the contents are checked.
. "${0%/*}/common.sh"
build
PAGS_OLD_ROOT="${OLD:-}" python3 -B tests/wheel.py dist/pags-*manylinux_2_17_x86_64*.whl "$pags"
set --
for wheel in dist/pags-*manylinux_2_17_aarch64*.whl dist/pags-*macosx*.whl; do
  [ ! -e "$wheel" ] || set -- "$@" "$wheel"
done
exec python3 -B tests/foreign_wheels.py "$pags" "$@"
