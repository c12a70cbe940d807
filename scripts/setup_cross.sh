#!/bin/sh
# SPDX-License-Identifier: Apache-2.0
# setup_cross.sh: downloads the compiler zig and the sources of libraries for cross builds (scripts/cross_sources.txt) into PAGS_CROSS (default
# ~/.cache/pags-cross). Each file is checked by its hash. Files that exist are not downloaded again.
#   PAGS_CROSS/files    downloads; files with the right hash are used
#   PAGS_CROSS/sources  the unpacked sources, Debian's patches applied: a folder for each row
#   PAGS_CROSS/zig      the compiler
set -eu
table=$(cd "$(dirname "$0")" && pwd)/cross_sources.txt
cross=${PAGS_CROSS:-$HOME/.cache/pags-cross}
mkdir -p "$cross/files" "$cross/sources"
cross=$(cd "$cross" && pwd)
cd "$cross/files"

for tool in python3 sha256sum dpkg-source apt-get; do
  if ! command -v $tool >/dev/null; then
    echo "setup-cross: no $tool: cross builds are made on Debian 12, x86-64 (packages python3-venv, dpkg-dev)" >&2
    exit 1
  fi
done

# has_hash FILE SHA256
has_hash() {
  [ -f "$1" ] && echo "$2  $1" | sha256sum --status -c -
}

# apt-get with lists and caches of its own, and the source packages of the archives that this system takes its packages from. The archives
# of security updates are left out: they needn't hold the source packages that the release has as well.
apt() {
  apt-get -q -o Dir::Etc::sourceparts=/dev/null -o Dir::Etc::sourcelist="$cross/apt/sources.list" -o Dir::State::lists="$cross/apt/lists" \
    -o Dir::Cache="$cross/apt/cache" -o APT::Sandbox::User="$(id -un)" "$@"
}

listed=""
list_archives() {
  [ -z "$listed" ] || return 0
  mkdir -p "$cross/apt/lists/partial" "$cross/apt/cache/archives/partial"
  # shellcheck disable=SC2016 # the words with a dollar sign are apt-get's
  apt-get indextargets --format '$(ORIGIN) deb-src $(REPO_URI) $(RELEASE) $(COMPONENT)' "Created-By: Packages" | sed -n 's/^Debian //p' |
    grep -v security | sort -u >"$cross/apt/sources.list"
  apt update >/dev/null || true # missing files are reported below
  listed=yes
}

fetch_wheel() { # NAME VERSION SHA256
  [ -x "$cross/zig" ] && [ "$(cat "$cross/zig.hash" 2>/dev/null)" = "$3" ] && return 0
  echo "setup-cross: $1 $2"
  rm -rf "$cross/venv"
  python3 -m venv "$cross/venv"
  echo "$1==$2 --hash=sha256:$3" >"$cross/requirements.txt"
  "$cross/venv/bin/python" -m pip install -q --disable-pip-version-check --no-deps --only-binary :all: --require-hashes -r "$cross/requirements.txt"
  ln -sfn "$("$cross/venv/bin/python" -c 'import os, ziglang; print(os.path.join(os.path.dirname(ziglang.__file__), "zig"))')" "$cross/zig"
  echo "$3" >"$cross/zig.hash"
}

fetch_debian() { # NAME VERSION SHA256
  [ "$(cat "$cross/sources/$1/.dsc-hash" 2>/dev/null)" = "$3" ] && return 0
  dsc=$1_$(echo "$2" | sed 's/^[0-9]*://').dsc
  if ! has_hash "$dsc" "$3"; then
    echo "setup-cross: $1 $2"
    list_archives
    if ! apt source --download-only "$1=$2" >"$cross/apt/log" 2>&1; then
      cat "$cross/apt/log" >&2
      echo "setup-cross: no $1 $2 in the archives; put $dsc and the files that it names into $cross/files, or renew its row in $table" >&2
      exit 1
    fi
  fi
  if ! has_hash "$dsc" "$3"; then
    echo "setup-cross: $cross/files/$dsc: expected SHA-256 $3, found $(sha256sum "$dsc" | cut -d' ' -f1)" >&2
    exit 1
  fi
  rm -rf "$cross/sources/$1"
  dpkg-source -q --no-copy --require-strong-checksums -x "$dsc" "$cross/sources/$1" >"$cross/files/log" 2>&1 || { cat "$cross/files/log" >&2; exit 1; }
  echo "$3" >"$cross/sources/$1/.dsc-hash"
}

fetch_tarball() { # NAME VERSION SHA256
  [ "$(cat "$cross/sources/$1/.tar-hash" 2>/dev/null)" = "$3" ] && return 0
  tarball=$1_$(echo "$2" | sed 's/^[0-9]*://; s/-[^-]*$//').orig.tar.xz
  if ! has_hash "$tarball" "$3"; then
    echo "setup-cross: $1 $2"
    list_archives
    apt source --download-only "$1=$2" >"$cross/apt/log" 2>&1 || true # of the package's files one is needed
  fi
  if ! has_hash "$tarball" "$3"; then
    cat "$cross/apt/log" >&2
    echo "setup-cross: no $tarball with SHA-256 $3; put it into $cross/files, or renew its row in $table" >&2
    exit 1
  fi
  rm -rf "$cross/sources/$1"
  mkdir "$cross/sources/$1"
  tar -xf "$tarball" -C "$cross/sources/$1" --strip-components=1
  echo "$3" >"$cross/sources/$1/.tar-hash"
}

while read -r name kind version hash; do
  case $kind in
    wheel) fetch_wheel "$name" "$version" "$hash" ;;
    debian) fetch_debian "$name" "$version" "$hash" ;;
    tarball) fetch_tarball "$name" "$version" "$hash" ;;
  esac
done <<END
$(grep -v '^#' "$table")
END
echo "setup-cross: all is in $cross"
