#!/bin/sh
# SPDX-License-Identifier: Apache-2.0
# container.sh [ARCHIVE [IMAGE]]: puts the program of ARCHIVE (default dist/pags-VERSION-linux-x64.tar.gz) into a container image, an OCI archive
# (default dist/pags-VERSION-container.tar). The image also has Debian's C library and a shell, and nothing that needs updates or listens.
# Requires mmdebstrap and buildah, and root or a user who may run both.
set -eu
archive=${1:+$(realpath "$1")}
image=${2:+$(realpath "$2")}
cd "$(dirname "$0")/.."
for tool in mmdebstrap buildah; do
  command -v $tool >/dev/null || { echo "container: no $tool (Debian: apt-get install mmdebstrap buildah)" >&2; exit 1; }
done
version=$(sed -n 's/^#define PAGS_VERSION_\(MAJOR\|MINOR\|PATCH\) //p' engine/include/pags/base.h | paste -sd .)
archive=${archive:-$PWD/dist/pags-$version-linux-x64.tar.gz}
image=${image:-$PWD/dist/pags-$version-container.tar}
[ -e "$archive" ] || { echo "container: $archive isn't there: make packages TARGETS=linux-x64-glibc2.17 makes it" >&2; exit 1; }
SOURCE_DATE_EPOCH=${SOURCE_DATE_EPOCH:-$(git log -1 --format=%ct)}
export SOURCE_DATE_EPOCH

work=$(mktemp -d)
storage="--root $work/storage --runroot $work/run --storage-driver vfs" # of its own: no image of this machine's is touched
trap 'rm -rf "$work"' EXIT
trap 'exit 130' HUP INT TERM
# Packages are unpacked only: none of their scripts runs, and the tools that configure them are not installed.
mmdebstrap --variant=extract --include=libc6,busybox-static,base-files bookworm "$work/root" http://deb.debian.org/debian >"$work/log" 2>&1 ||
  { tail "$work/log" >&2; exit 1; }
rm -rf "$work/root/var/cache" "$work/root/var/lib/apt" "$work/root/usr/share/locale"
mkdir -p "$work/root/usr/share/doc/pags" "$work/root/bin" "$work/root/tmp" "$work/root/work"
chmod 1777 "$work/root/tmp" "$work/root/work"
tar -xzf "$archive" -C "$work/root/usr/share/doc/pags" --strip-components=1
mv "$work/root/usr/share/doc/pags/pags" "$work/root/usr/bin/pags"
ln -sf busybox "$work/root/bin/sh"

# shellcheck disable=SC2086 # words
{
  container=$(buildah $storage from scratch)
  buildah $storage copy -q "$container" "$work/root" / >/dev/null
  buildah $storage config --entrypoint '["/usr/bin/pags"]' --cmd --help --workingdir /work --label "org.opencontainers.image.version=$version" \
    --label org.opencontainers.image.licenses=Apache-2.0 "$container"
  buildah $storage commit -q --timestamp "$SOURCE_DATE_EPOCH" "$container" "pags:$version" >/dev/null
  again=$(buildah $storage from "pags:$version")
  buildah $storage run --isolation chroot "$again" -- /usr/bin/pags --version # it starts in there
  rm -f "$image"
  buildah $storage push -q "pags:$version" "oci-archive:$image:pags:$version"
}
ls -l "$image" | awk '{ print $9, $5, "bytes" }'
