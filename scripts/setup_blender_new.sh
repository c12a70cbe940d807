#!/bin/sh
# SPDX-License-Identifier: Apache-2.0
# setup_blender_new.sh [SUITE]: installs the Blender of a newer Debian (default sid) in a folder, PAGS_BLENDER_ROOT, with a program that runs it
# there with windows on this system. Prints the path of the program, for BLENDER_NEW. Requires root, Debian and 2.5 GB.
set -eu
suite=${1:-sid}
root=${PAGS_BLENDER_ROOT:-$HOME/.cache/pags-blender-$suite}
mirror=${PAGS_DEBIAN_MIRROR:-http://deb.debian.org/debian}
[ "$(id -u)" -eq 0 ] || { echo "setup-blender-new: only root can run programs within another folder (chroot)" >&2; exit 1; }
for tool in debootstrap unshare chroot; do
  command -v $tool >/dev/null || { echo "setup-blender-new: there is no $tool here (Debian: apt-get install debootstrap util-linux)" >&2; exit 1; }
done
mkdir -p "$(dirname "$root")"

# Mounts inside the folder exist for this command only.
within() { # COMMAND...
  unshare -m sh -c 'root=$1; shift
    for folder in proc sys dev; do mount --rbind /$folder "$root/$folder"; done
    exec chroot "$root" "$@"' sh "$root" "$@"
}

if [ ! -x "$root/usr/bin/blender" ]; then
  [ -x "$root/usr/bin/apt-get" ] || debootstrap --variant=minbase "$suite" "$root" "$mirror" >"$root.log" 2>&1 || { tail -n 5 "$root.log" >&2; exit 1; }
  cp /etc/resolv.conf "$root/etc/resolv.conf"
  within apt-get -o Acquire::Check-Valid-Until=false update >>"$root.log" 2>&1 # a mirror may lag behind by weeks
  within env DEBIAN_FRONTEND=noninteractive apt-get install -y --no-install-recommends blender imagemagick python3-numpy libgl1-mesa-dri \
    python3-cattr python3-requests python3-zstandard >>"$root.log" 2>&1 || { tail -n 5 "$root.log" >&2; exit 1; }
fi

# The folders that tests and their files are in are seen under the same paths. The cache of shaders is one of its own: Mesa maps its files, and those of
# this system's programs change under it, which ends Blender by SIGBUS.
cat >"$root-blender" <<END
#!/bin/sh
exec unshare -m sh -c 'for folder in /proc /sys /dev /tmp /home /root "/\$(pwd | cut -d/ -f2)"; do
    [ -d "\$folder" ] && mkdir -p "$root\$folder" && mount --rbind "\$folder" "$root\$folder"
  done
  export MESA_SHADER_CACHE_DIR=/var/cache/mesa
  exec chroot "$root" sh -c "cd \\"\\\$0\\" && exec blender \\"\\\$@\\"" "\$(pwd)" "\$@"' sh "\$@"
END
chmod +x "$root-blender"
"$root-blender" --version | grep -m 1 '^Blender' >&2 || { echo "setup-blender-new: $root-blender doesn't start" >&2; exit 1; }
echo "$root-blender"
