#!/bin/sh
# SPDX-License-Identifier: Apache-2.0
# setup_godot.sh [SUITE]: unpacks the Godot 4 of a newer Debian (default sid), with the packages that it depends on, in a folder, PAGS_GODOT_ROOT,
# for make check-tools, and writes a program that runs it with these libraries. Prints the path of the program. Requires apt, dpkg-deb and
# 0.7 GB, no root.
set -eu
suite=${1:-sid}
root=${PAGS_GODOT_ROOT:-$HOME/.cache/pags-godot-$suite}
mirror=${PAGS_DEBIAN_MIRROR:-http://deb.debian.org/debian}
for tool in apt-get dpkg-deb; do
  command -v $tool >/dev/null || { echo "setup-godot: there is no $tool here; name a Godot 4 by GODOT=PROGRAM" >&2; exit 1; }
done

if [ ! -x "$root/usr/bin/godot" ]; then
  apt=$root.apt
  mkdir -p "$root" "$apt/lists/partial" "$apt/cache/archives/partial"
  echo "deb [signed-by=/usr/share/keyrings/debian-archive-keyring.gpg] $mirror $suite main" >"$apt/sources.list"
  : >"$apt/status"
  for command in "update" "-y --download-only install godot libgl1 libglx-mesa0 libgl1-mesa-dri"; do
    # shellcheck disable=SC2086 # the words of the command
    apt-get -o Dir::Etc::SourceList="$apt/sources.list" -o Dir::Etc::SourceParts=/nonexistent -o Dir::State::Lists="$apt/lists" \
      -o Dir::Cache="$apt/cache" -o Dir::State::Status="$apt/status" -o APT::Install-Recommends=false -o APT::Sandbox::User= $command >"$apt/log" 2>&1 ||
      { tail -n 5 "$apt/log" >&2; exit 1; }
  done
  for package in "$apt"/cache/archives/*.deb; do dpkg-deb -x "$package" "$root"; done
  rm -r "$apt"
fi

cat >"$root-godot" <<END
#!/bin/sh
libraries=$root/usr/lib/x86_64-linux-gnu
export LIBGL_DRIVERS_PATH=\$libraries/dri
exec "\$libraries/ld-linux-x86-64.so.2" --library-path "\$libraries:\$libraries/pulseaudio" "$root/usr/bin/godot" "\$@"
END
chmod +x "$root-godot"
echo "$root-godot"
