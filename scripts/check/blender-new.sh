#!/bin/sh
# SPDX-License-Identifier: Apache-2.0
# The add-on in a newer Blender: BLENDER_NEW=PROGRAM, a Blender or a Python with the module bpy.
. "${0%/*}/common.sh"
build_addon
cmake -S . -B build -DPAGS_BLENDER_NEW="${BLENDER_NEW:-}"
exec ctest --preset release -R '^blender_new\.'
