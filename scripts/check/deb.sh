#!/bin/sh
# SPDX-License-Identifier: Apache-2.0
# Debian packages of dist/ in a fresh Debian 12: installed, used, in Blender too, removed (root, mmdebstrap; 15 minutes).
# deb.sh [FOLDER [ROOT]]: packages of FOLDER (default dist/). The Debian takes 2.5 GB, mostly for Blender. A street is made there, trained,
# exported and drawn by the program, in Python and in Blender. Fails where a command fails or a file is left over. ROOT: an existing Debian
# 12, which is used and kept.
. "${0%/*}/common.sh"
[ $# -gt 0 ] || ls dist/pags_*.deb >/dev/null 2>&1 || make --no-print-directory deb JOBS="$jobs"
packages=$(cd "${1:-dist}" && pwd)
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
root=${2:-$work/root}
if [ ! -e "$root/etc/debian_version" ]; then
  mmdebstrap --variant=minbase bookworm "$root" http://deb.debian.org/debian >"$work/log" 2>&1 || { tail "$work/log" >&2; exit 1; }
fi
rm -rf "$root/packages" "$root/dist"
mkdir "$root/packages" "$root/dist"
cp "$packages/"*pags*_*.deb "$root/packages/"
cp "$packages/"pags_*.deb "$root/dist/"
# The installation line of the README, without the build and sudo.
line=$(sed -n 's/^make deb && sudo \(apt install [^#]*[^# ]\) *#.*/\1/p' README.md)
[ -n "$line" ] || { echo "check-deb: README.md has no line 'make deb && sudo apt install ...'" >&2; exit 1; }

run() {
  echo "\$ $*"
  chroot "$root" env LC_ALL=C.UTF-8 DEBIAN_FRONTEND=noninteractive PATH=/usr/sbin:/usr/bin:/sbin:/bin "$@"
}
files() {
  (cd "$root" && find . -xdev \( -path ./proc -o -path ./sys -o -path ./dev -o -path ./packages -o -path ./dist -o -path ./tmp -o -path ./var -o -path ./root \) -prune -o -print | grep -i pags || true)
}

cp /etc/resolv.conf "$root/etc/resolv.conf" 2>/dev/null || true
run apt-get update -q >"$work/log" 2>&1 || { tail "$work/log" >&2; exit 1; }
run sh -c "cd / && $line -y -q -o Dpkg::Options::=--force-unsafe-io" >"$work/log" 2>&1 || { tail -n 30 "$work/log" >&2; exit 1; }
run pags --version
run sh -c 'apt-get install -y -q -o Dpkg::Options::=--force-unsafe-io --no-install-recommends /packages/*.deb python3' >"$work/log" 2>&1 || { tail -n 30 "$work/log" >&2; exit 1; }
run sh -ec 'cd /tmp; rm -rf street scene proxies.glb
  pags synth street -o street --frames 4 --size 96x64 -q
  pags train street -o scene -n 20 -q
  pags export scene proxies.glb -q
  pags export scene scene.spz -q
  python3 -c "import pags; scene = pags.load(\"scene\"); picture = pags.render(scene, scene.views[0]); print(\"drawn in Python:\", memoryview(picture.rgba).shape)"
  ls -l proxies.glb scene.spz'
# The add-on together with the Python module: it can be switched on and draws, and a script imports the module of the package. Blender also
# starts without the add-on.
run env PYTHONDONTWRITEBYTECODE=1 sh -ec 'cd /tmp; rm -f frame.png
  blender -b --factory-startup -noaudio --python-exit-code 3 --python-expr "import pags; assert pags.load and pags.__file__.startswith(\"/usr/lib/python3/dist-packages/\")" >log 2>&1 || { cat log; exit 1; }
  blender -b --factory-startup -noaudio --python-exit-code 3 --addons pags_blender --python-expr "
import bpy, pags
bpy.ops.import_scene.pags(filepath=\"scene\")
bpy.context.scene.render.filepath = \"/tmp/frame.png\"
bpy.ops.render.render(write_still=True)
print(\"drawn in Blender:\", bpy.app.version_string, pags.load(\"scene\").info[\"gaussians\"], \"Gaussians\")" >log 2>&1 || { cat log; exit 1; }
  ! grep Traceback log
  grep "drawn in Blender" log; ls -l frame.png'
find "$root/usr/share/blender" -name __pycache__ -path "*pags*" -prune -exec rm -r {} +
run apt-get purge -y -q blender-pags pags libpags0.2 libpags-dev python3-pags >"$work/log" 2>&1 || { tail "$work/log" >&2; exit 1; }
left=$(files)
[ -z "$left" ] || { echo "check-deb: left behind:"; echo "$left"; exit 1; }
echo "check-deb: installed, used and removed; nothing is left"
