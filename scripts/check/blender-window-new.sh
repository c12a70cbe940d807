#!/bin/sh
# SPDX-License-Identifier: Apache-2.0
# The window tests in a newer Blender (BLENDER_NEW=PROGRAM), and its validation of the add-on's zip.
. "${0%/*}/common.sh"
if [ -z "${BLENDER_NEW:-}" ]; then
  echo "check-blender-window-new: set BLENDER_NEW=PROGRAM; scripts/setup_blender_new.sh makes a Blender from Debian's packages" >&2
  exit 1
fi
build_addon
build_scene
export PAGS_GUIDE_SCENE="$scene"
"$BLENDER_NEW" --command extension validate "$addon"
for script in viewport files jobs labels obey inspect look guide; do
  echo "gui_$script.py"
  python3 tests/addon/run_blender.py gui_$script.py "$PWD/build/addon/pags_blender/bin/pags" "$addon" "$BLENDER_NEW"
done
exec python3 -B tests/addon/test_guide.py "$pags" "$addon" "$BLENDER_NEW"
