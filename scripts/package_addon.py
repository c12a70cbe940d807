#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""package_addon.py FOLDER: makes one zip of the add-on for Blender 3.4 to 4.1 of those for single systems in FOLDER (package_cross.py), whichever
are there: FOLDER/pags-blender-VERSION-3.4-to-4.1.zip. Module and program of a system lie in a folder of its name, where blender_addon/pags_blender/system.py
looks; Python, licences and texts are there once, and have to be the same in all. The manifest, which only extensions have, is left out."""

import hashlib
import os
import re
import sys
import zipfile

from package_cross import TARGETS, version, zip_bytes

PARTS = re.compile(r"pags_blender/(?:pags\.abi3\.so|pags\.pyd|bin/.*)")  # of one system
LEFT_OUT = "pags_blender/blender_manifest.toml"


def merge(zips):
    """{name: (bytes, mode)} of {system: path of its zip}."""
    files, first = {}, {}
    for system, path in sorted(zips.items()):
        with zipfile.ZipFile(path) as archive:
            for entry in archive.infolist():
                name = entry.filename
                if entry.is_dir() or name == LEFT_OUT:
                    continue
                if PARTS.fullmatch(name):
                    name = name.replace("pags_blender/", f"pags_blender/{system}/", 1)
                file = archive.read(entry), entry.external_attr >> 16 & 0o777
                if files.setdefault(name, file)[0] != file[0]:
                    sys.exit(
                        f"package_addon: {path}: its {name} isn't that of {first[name]}; expected zips of one commit: make packages builds them all"
                    )
                first.setdefault(name, path)
        if not any(name.startswith(f"pags_blender/{system}/pags.") for name in files):
            sys.exit(f"package_addon: {path}: has no module; expected one that scripts/package_cross.py has made")
    return files


def main():
    if len(sys.argv) != 2:
        sys.exit(__doc__)
    folder = sys.argv[1]
    systems = [
        target.split("-glibc")[0] for target in TARGETS if target != "linux-arm64"
    ]  # there is no Blender up to 4.1 for Linux on ARM
    there = {system: os.path.join(folder, f"pags-blender-{version()}-{system}.zip") for system in systems}
    zips = {system: path for system, path in there.items() if os.path.exists(path)}
    if not zips and os.path.exists(os.path.join(folder, f"pags-blender-{version()}-linux-arm64.zip")):
        print("package_addon: no zip for Blender 3.4 to 4.1, which there isn't for Linux on 64-bit ARM")
        return
    if not zips:
        sys.exit(f"package_addon: {folder} has no pags-blender-{version()}-SYSTEM.zip: make packages makes them")
    file, content = f"pags-blender-{version()}-3.4-to-4.1.zip", zip_bytes(merge(zips))
    with open(os.path.join(folder, file), "wb") as out:
        out.write(content)
    lacking = "".join(f"; without {system}, whose zip isn't there" for system in systems if system not in zips)
    print(
        f"{file} {len(content)} bytes, SHA-256 {hashlib.sha256(content).hexdigest()}, for {', '.join(sorted(zips))}{lacking}"
    )


if __name__ == "__main__":
    main()
