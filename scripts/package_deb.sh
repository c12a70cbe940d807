#!/bin/sh
# SPDX-License-Identifier: Apache-2.0
# package_deb.sh [FOLDER]: builds the Debian packages of the checked-out commit in FOLDER (default dist/) and checks them with lintian. Files
# have the time of the commit, or SOURCE_DATE_EPOCH.
set -eu
cd "$(dirname "$0")/.."
mkdir -p "${1:-dist}"
out=$(cd "${1:-dist}" && pwd)
for tool in dpkg-buildpackage dh lintian; do
  command -v $tool >/dev/null || { echo "package-deb: no $tool; Debian has it: apt-get install dpkg-dev debhelper dh-python lintian" >&2; exit 1; }
done
[ -z "$(git status --porcelain --untracked-files=no)" ] || echo "package-deb: builds the commit; uncommitted changes are left out" >&2
version=$(sed -n 's/^#define PAGS_VERSION_\(MAJOR\|MINOR\|PATCH\) //p' engine/include/pags/base.h | paste -sd .)
PAGS_COMMIT=$(git rev-parse --short=12 HEAD)
SOURCE_DATE_EPOCH=${SOURCE_DATE_EPOCH:-$(git log -1 --format=%ct)}
export PAGS_COMMIT SOURCE_DATE_EPOCH
umask 022

work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
source=$work/pags-$version
mkdir "$source"
git archive HEAD | tar -x -C "$source"
cp -r packaging/debian "$source/debian"
{
  echo "pags ($version) stable; urgency=medium"
  echo
  echo "  * See CHANGELOG.md for the changes."
  echo
  echo " -- The PAGS authors <maintainers@pags.invalid>  $(LC_ALL=C date -u -R -d "@$SOURCE_DATE_EPOCH")"
} >"$source/debian/changelog"
if ! (cd "$source" && DEB_BUILD_OPTIONS="parallel=${JOBS:-$(nproc)} noautodbgsym" dpkg-buildpackage -us -uc -b) >"$work/log" 2>&1; then
  tail -n 30 "$work/log" >&2
  cp "$work/log" "$out/package-deb.log"
  echo "package-deb: not built; $out/package-deb.log has the whole log" >&2
  exit 1
fi
lintian --fail-on error,warning --profile debian "$work/pags_${version}_"*.changes && echo "package-deb: lintian finds no error and no warning" || failed=yes
for package in "$work/"*.deb; do
  if dpkg-deb --fsys-tarfile "$package" | grep -qaF "$work/"; then
    echo "package-deb: ${package##*/} names $work, the folder in which it was built" >&2
    failed=yes
  fi
done
cp "$work/"*.deb "$out/"
cd "$out"
ls -l -- *"_${version}_"*.deb | awk '{ print $9, $5, "bytes" }'
[ -z "${failed:-}" ]
