#!/bin/sh
# SPDX-License-Identifier: Apache-2.0
# setup_windows.sh: makes a Python for Windows with Blender as its module bpy, PAGS_CROSS/windows-python/python.exe, from the files listed in
# scripts/windows_sources.txt. Each is checked by its hash and kept in PAGS_CROSS/files.
set -eu
cd "$(dirname "$0")/.."
table=scripts/windows_sources.txt
sh scripts/setup_cross.sh # the compiler and Python's sources
cross=$(cd "${PAGS_CROSS:-$HOME/.cache/pags-cross}" && pwd)
python=$cross/venv/bin/python
home=$cross/windows-python
recipe=$(cat $table scripts/setup_windows.sh | sha256sum | cut -d' ' -f1)
[ "$(cat "$home/recipe" 2>/dev/null)" != "$recipe" ] || exit 0

has_hash() { # PATH SHA256
  [ -f "$1" ] && echo "$2  $1" | sha256sum --status -c -
}

fetch() { # FILE SHA256 COMMAND..., which writes the file into PAGS_CROSS/files
  wanted=$cross/files/$1
  hash=$2
  shift 2
  if ! has_hash "$wanted" "$hash"; then
    echo "setup-windows: ${wanted##*/}"
    rm -f "$wanted"
    "$@" >"$cross/files/log" 2>&1 || tail -n 5 "$cross/files/log" >&2
  fi
  if ! has_hash "$wanted" "$hash"; then
    echo "setup-windows: no $wanted with SHA-256 $hash; put it there, or renew its row in $table" >&2
    exit 1
  fi
}

rm -rf "$home"
mkdir -p "$home"
while read -r name kind version hash; do
  case $kind in
    wheel)
      file=$name-$version-cp311-cp311-win_amd64.whl
      fetch "$file" "$hash" "$python" -m pip download -q --disable-pip-version-check --no-deps --only-binary :all: --platform win_amd64 \
        --python-version 3.11 -d "$cross/files" "$name==$version"
      "$python" -m zipfile -e "$cross/files/$file" "$home/lib/site-packages"
      ;;
    maven)
      file=$(echo "$version" | awk -F: '{print $2 "-" $3 "-" $5 "." $4}')
      fetch "$file" "$hash" mvn -q -B dependency:copy "-Dartifact=$version" "-DoutputDirectory=$cross/files"
      "$python" -m zipfile -e "$cross/files/$file" "$home/jar"
      cp -r "$home/jar/$(echo "$version" | awk -F: '{gsub("[.]", "/", $1); print $1 "/" $2 "/" $5}')/." "$home"
      rm -r "$home/jar"
      ;;
  esac
done <<END
$(grep -v '^#' $table)
END

# That Python lacks python3.dll, which has the functions of python311.dll under another library's name.
{
  printf 'LIBRARY python3.dll\nEXPORTS\n'
  sed -n 's/^EXPORT_FUNC(\([A-Za-z0-9_]*\)).*/\1 = python311.\1/p; s/^EXPORT_DATA(\([A-Za-z0-9_]*\)).*/\1 = python311.\1 DATA/p' \
    "$cross/sources/python3.11/PC/python3dll.c"
} >"$home/python3.def"
echo "extern int nothing;" >"$home/python3.c"
ZIG_GLOBAL_CACHE_DIR="$cross/zig-cache" ZIG_LOCAL_CACHE_DIR="$cross/zig-cache" "$cross/zig" cc -target x86_64-windows-gnu -shared \
  -o "$home/python3.dll" "$home/python3.c" "$home/python3.def"
chmod +x "$home/python.exe"
echo "$recipe" >"$home/recipe"
echo "setup-windows: $home/python.exe has the module bpy"
