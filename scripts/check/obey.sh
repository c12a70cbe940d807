#!/bin/sh
# SPDX-License-Identifier: Apache-2.0
# Local view, borders, clipping and the selection tool in a window of Blender.
. "${0%/*}/common.sh"
build_addon
exec python3 tests/addon/run_blender.py gui_obey.py "$pags" "$addon"
