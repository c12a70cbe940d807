#!/bin/sh
# SPDX-License-Identifier: Apache-2.0
# validate_addon.sh [BLENDER]: validates the folder and the zip of the add-on by BLENDER (default the `blender` on the PATH): Blender 4.2 or
# later, or a Python with the module bpy. Prints a line where there is none.
set -u
cd "$(dirname "$0")/.." || exit 1
zip=$(ls build/pags-blender-*.zip) || exit 1
blender=${1:-blender}

case $(basename "$blender") in
  python*)
    tool=$("$blender" -c 'import bpy, os, sys; sys.stdout.write(next((os.path.join(d, "blender_ext.py")
      for d, _, files in os.walk(bpy.utils.system_resource("SCRIPTS")) if "blender_ext.py" in files), ""))' | tail -1)
    [ -n "$tool" ] || { echo "addon: the bpy of $blender brings no blender_ext.py"; exit 1; }
    "$blender" "$tool" validate "$zip"
    exit
    ;;
esac
version=$("$blender" --version 2>/dev/null | sed -n '1s/^Blender \([0-9]*\)\.\([0-9]*\).*/\1 \2/p')
# shellcheck disable=SC2086 # two words
set -- ${version:-0 0}
if [ "$1" -gt 4 ] || { [ "$1" -eq 4 ] && [ "$2" -ge 2 ]; }; then
  "$blender" --command extension validate "$zip"
else
  echo "addon: $zip is built; not validated as an extension, for want of a Blender of 4.2 or newer (BLENDER_NEW=PROGRAM names one)"
fi
