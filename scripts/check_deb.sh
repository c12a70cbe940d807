#!/bin/sh
# SPDX-License-Identifier: Apache-2.0
# check_deb.sh [FOLDER [ROOT]]: installs the Debian packages of FOLDER, by default dist/, into a fresh Debian 12 in a folder of its own
# (mmdebstrap; as root), makes a street there, trains, exports and draws it, and removes them again. Fails where a command fails or a file is
# left. ROOT: a Debian 12 that is there already is taken, and stays.
set -eu
cd "$(dirname "$0")/.."
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
rm -f "$root/packages/"blender-pags* # Blender brings 1.5 GB; its package is unpacked below
# What the README says, but for the build, which is over, and sudo.
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
run apt-get purge -y -q pags libpags0.2 libpags-dev python3-pags >"$work/log" 2>&1 || { tail "$work/log" >&2; exit 1; }
left=$(files)
[ -z "$left" ] || { echo "check-deb: left behind:"; echo "$left"; exit 1; }
# The add-on, from its package, finds module and program where its links say.
dpkg-deb -x "$packages/"blender-pags_*_all.deb "$work/addon"
addon=$work/addon/usr/share/blender/scripts/addons/pags
for link in bin/pags:usr/bin/pags pags.abi3.so:usr/lib/python3/dist-packages/pags.abi3.so; do
  found=$(readlink -m "$addon/${link%%:*}")
  [ "$found" = "$(readlink -m "$work/addon/${link#*:}")" ] || { echo "check-deb: the add-on's ${link%%:*} points to $found"; exit 1; }
done
echo "check-deb: installed, used and removed; nothing is left"
