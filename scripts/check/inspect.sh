#!/bin/sh
# SPDX-License-Identifier: Apache-2.0
# The panels Inspect, Recording and Measure, the sidebar and the legends in a window of Blender.
. "${0%/*}/common.sh"
build_addon
for script in inspect labels look; do
  python3 tests/addon/run_blender.py gui_$script.py "$pags" "$addon"
done
