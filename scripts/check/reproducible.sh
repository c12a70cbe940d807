#!/bin/sh
# SPDX-License-Identifier: Apache-2.0
# Builds the packages of TARGETS="NAME ..." again, in another folder at another time: the same bytes (an hour per target).
# The second build is of a clone of the commit, with compiler and libraries built again, another umask, locale and time zone, one job and the
# clock a day later (faketime). The packages of the first lie in dist/. Downloads come from PAGS_CROSS, by their hashes.
. "${0%/*}/common.sh"
# shellcheck disable=SC2086 # a list of names
set -- ${TARGETS:-linux-x64-glibc2.17}
cross=$(realpath "${PAGS_CROSS:-$HOME/.cache/pags-cross}")
dist=$PWD/dist
command -v faketime >/dev/null || { echo "check-reproducible: no faketime (Debian: faketime)" >&2; exit 1; }
[ -z "$(git status --porcelain --untracked-files=no)" ] || { echo "check-reproducible: files differ from the commit, of which the clone is made" >&2; exit 1; }

work=$(mktemp -d)
trap 'chmod -R u+w "$work"; rm -rf "$work"' EXIT
trap 'exit 130' HUP INT TERM
clone="$work/another folder/pags"
unset SOURCE_DATE_EPOCH
umask 077
mkdir -p "$work/another folder" "$work/home" "$work/cross/files"
cp "$cross/files/"*.dsc "$cross/files/"*.tar.* "$work/cross/files/"
git clone -q . "$clone"
cd "$clone"
other=$(locale -a | grep -v '^C\|^POSIX\|^en' | head -n 1) # C where no other locale is installed
export HOME="$work/home" PAGS_CROSS="$work/cross" LC_ALL="${other:-C}" TZ=Asia/Tokyo JOBS=1 CCACHE_DISABLE=1
sh scripts/setup_cross.sh >"$work/log" 2>&1 || { tail -n 30 "$work/log" >&2; exit 1; } # by the true clock: dpkg-source sets times
failed=0
for target; do
  faketime -f +1d sh scripts/cross.sh "$target" >"$work/log" 2>&1 || { tail -n 30 "$work/log" >&2; exit 1; }
  faketime -f +1d python3 -B scripts/package_cross.py "build-cross/$target" "$work/dist/$target" >/dev/null
  for file in "$work/dist/$target/"*; do
    if cmp -- "$file" "$dist/${file##*/}"; then
      echo "same bytes: $(sha256sum <"$file" | cut -c1-16)... ${file##*/}"
    else
      failed=1
      [ -z "${PAGS_KEEP:-}" ] || cp "$file" "$PAGS_KEEP/"
    fi
  done
done
[ $failed = 0 ] && echo "check-reproducible: all the same" || echo "check-reproducible: there are differences" >&2
exit $failed
