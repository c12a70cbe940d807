#!/bin/sh
# SPDX-License-Identifier: Apache-2.0
# make_corpus.sh SOURCE OUT.zip: makes the files of test_compat.py by the build of a commit in SOURCE/build. The committed
# files come from ec025b61 and never change, as users of that commit may have such files. Without Blender, scene.blend is
# left out.
set -eu
[ $# -eq 2 ] || { echo "usage: make_corpus.sh SOURCE OUT.zip" >&2; exit 2; }
here=$(cd "$(dirname "$0")" && pwd)
source=$(cd "$1" && pwd)
pags=$source/build/pags
out=$(realpath "$2")
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
cd "$work"
mkdir json help programs

"$pags" synth street -o street --size 64x36 --frames 6 --cameras 1 --samples 1 --objects 2 --lidar-points 200 --no-shifts -q
rm -r street/truth
"$pags" train street -o scene -n 20 --max-gaussians 150 --checkpoint-every 10 --preview-every 0 --split-every 2 -q --json json/train.json
"$pags" render scene --split test -o pictures -q --json json/render.json
"$pags" eval scene --json json/eval.json -q
"$pags" export scene scene.pagsz -q
"$pags" export scene scene.spz -q
"$pags" export scene scene.glb -q --json json/export.json
"$pags" info scene --json json/info.json >/dev/null
"$pags" info street --json json/info_dataset.json >/dev/null
"$pags" split street -o blocks --block 5 --json json/split.json -q || rm -f json/split.json
rm -rf pictures scene.glb blocks scene/report.html

"$pags" --version >version.txt
"$pags" --help >help/pags.txt
sed -n 's/^  \([a-z]*\)  .*/\1/p' help/pags.txt | while read -r verb; do
  "$pags" "$verb" --help >"help/$verb.txt"
done
"$pags" train --fields >fields.txt
cp "$source"/examples/*.c "$source"/examples/*.py programs/

if command -v blender >/dev/null; then
  BLENDER_USER_RESOURCES=$work/blender BLENDER_USER_SCRIPTS=$work/blender/scripts blender -b --factory-startup -noaudio --python-exit-code 3 \
    -P "$here/make_blend.py" -- "$source"/build/pags-blender-*.zip scene scene.blend
fi
rm -rf blender scene.blend1
rm -f "$out"
python3 - "$out" <<'END'
import pathlib, sys, zipfile
with zipfile.ZipFile(sys.argv[1], "w", zipfile.ZIP_LZMA) as corpus:
    for path in sorted(pathlib.Path(".").rglob("*")):
        if path.is_file():
            corpus.write(path)
END
ls -l "$out"
