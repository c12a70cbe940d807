#!/bin/sh
# SPDX-License-Identifier: Apache-2.0
# Exports of SCENE=FOLDER (the demo's) in Babylon.js, Godot 4 and OpenUSD, with pictures in build/tools.
# GODOT=PROGRAM, else scripts/setup_godot.sh downloads one (0.7 GB).
. "${0%/*}/common.sh"
build
build_scene
mkdir -p build/tools
GODOT=${GODOT:-$(sh scripts/setup_godot.sh)}
export GODOT
exec python3 -B tests/outside/test_tools.py "$pags" "$scene" "$PWD/build/tools"
