#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""package_cross.py BUILD FOLDER: packs what `make cross` built in BUILD (build-cross/TARGET) into FOLDER: a wheel for Python with the module
and the program, an archive with the program alone, and the add-on's zip. The same bytes each time: entries are sorted, and their times are
those of SOURCE_DATE_EPOCH, else of the commit."""

import base64
import gzip
import hashlib
import io
import os
import re
import subprocess
import sys
import tarfile
import time
import zipfile

ROOT = os.path.dirname(os.path.dirname(os.path.abspath(__file__)))

# target: tag of the wheel's platform, name of the program, of the module
TARGETS = {
    "linux-x64-glibc2.17": ("manylinux_2_17_x86_64.manylinux2014_x86_64", "pags", "pags.abi3.so"),
    "linux-arm64": ("manylinux_2_17_aarch64.manylinux2014_aarch64", "pags", "pags.abi3.so"),
    "macos-arm64": ("macosx_11_0_arm64", "pags", "pags.abi3.so"),
    "macos-x64": ("macosx_11_0_x86_64", "pags", "pags.abi3.so"),
    "windows-x64": ("win_amd64", "pags.exe", "pags.pyd"),
}


def read(*path):
    with open(os.path.join(*path), "rb") as file:
        return file.read()


def version():
    header = read(ROOT, "engine/include/pags/base.h").decode()
    return ".".join(re.search(rf"#define PAGS_VERSION_{part} (\d+)", header)[1] for part in ("MAJOR", "MINOR", "PATCH"))


def epoch():
    given = os.environ.get("SOURCE_DATE_EPOCH")
    return int(given or subprocess.run(["git", "-C", ROOT, "log", "-1", "--format=%ct"], capture_output=True, text=True, check=True).stdout)


def zip_bytes(files):
    """A zip of {name: (bytes, mode)}; a zip begins in 1980."""
    date = time.gmtime(max(epoch(), 315532800))[:6]
    data = io.BytesIO()
    with zipfile.ZipFile(data, "w", zipfile.ZIP_DEFLATED, compresslevel=9) as archive:
        for name, (content, mode) in sorted(files.items()):
            info = zipfile.ZipInfo(name, date)
            info.create_system, info.external_attr, info.compress_type = 3, (0o100000 | mode) << 16, zipfile.ZIP_DEFLATED
            archive.writestr(info, content)
    return data.getvalue()


def tar_bytes(files):
    data = io.BytesIO()
    with gzip.GzipFile("", "wb", 9, data, mtime=0) as packed, tarfile.open(fileobj=packed, mode="w", format=tarfile.USTAR_FORMAT) as archive:
        for name, (content, mode) in sorted(files.items()):
            info = tarfile.TarInfo(name)
            info.size, info.mode, info.mtime = len(content), mode, epoch()
            archive.addfile(info, io.BytesIO(content))
    return data.getvalue()


def metadata():
    readme = """PAGS turns recordings of a driving car and photographs of static scenes into 3D Gaussians, draws them, and exports meshes and splat
files, on ordinary processors. This package has the module `pags` (docs/python-api.md) and the program `pags` (`pags --help`).
"""
    return (f"Metadata-Version: 2.1\nName: pags\nVersion: {version()}\nSummary: Gaussian splatting of driving scenes on processors\n"
            "License: Apache-2.0\nLicense-File: LICENSE\nLicense-File: THIRD_PARTY.md\nRequires-Python: >=3.10\nProvides-Extra: numpy\n"
            'Requires-Dist: numpy; extra == "numpy"\nClassifier: Programming Language :: Python :: 3\n'
            f"Classifier: Topic :: Multimedia :: Graphics :: 3D Modeling\nDescription-Content-Type: text/markdown\n\n{readme}")


def wheel(build, platform, program, module):
    """The wheel's name and bytes. The program lies among the scripts, so that it is started without a Python."""
    base = f"pags-{version()}"
    info = f"{base}.dist-info"
    files = {
        module: (read(build, "python", module), 0o755),
        "pags-stubs/__init__.pyi": (read(build, "python", "pags.pyi"), 0o644),
        f"{base}.data/scripts/{program}": (read(build, program), 0o755),
        f"{info}/METADATA": (metadata().encode(), 0o644),
        f"{info}/WHEEL": (("Wheel-Version: 1.0\nGenerator: pags\nRoot-Is-Purelib: false\n"
                           + "".join(f"Tag: cp310-abi3-{tag}\n" for tag in platform.split("."))).encode(), 0o644),
        f"{info}/licenses/LICENSE": (read(ROOT, "LICENSE"), 0o644),
        f"{info}/licenses/THIRD_PARTY.md": (read(ROOT, "THIRD_PARTY.md"), 0o644),
    }
    record = "".join(f"{name},sha256={base64.urlsafe_b64encode(hashlib.sha256(content).digest()).rstrip(b'=').decode()},{len(content)}\n"
                     for name, (content, _) in sorted(files.items()))
    files[f"{info}/RECORD"] = ((record + f"{info}/RECORD,,\n").encode(), 0o644)
    return f"{base}-cp310-abi3-{platform}.whl", zip_bytes(files)


def main():
    if len(sys.argv) != 3:
        sys.exit(__doc__)
    build, folder = sys.argv[1:]
    target = os.path.basename(os.path.normpath(build))
    if target not in TARGETS:
        sys.exit(f"package_cross: {build}: expected the folder of one of {', '.join(TARGETS)}")
    platform, program, module = TARGETS[target]
    name = f"pags-{version()}-{target.split('-glibc')[0]}"
    packages = dict([wheel(build, platform, program, module)])
    alone = {f"{name}/{program}": (read(build, program), 0o755), **{f"{name}/{text}": (read(ROOT, text), 0o644) for text in
                                                                   ("LICENSE", "THIRD_PARTY.md", "README.md", "CHANGELOG.md")}}
    if program.endswith(".exe"):
        packages[name + ".zip"] = zip_bytes(alone)
    elif target.startswith("linux"):
        packages[name + ".tar.gz"] = tar_bytes(alone)
    addon = f"pags-blender-{version()}-{target.split('-glibc')[0]}.zip"
    with zipfile.ZipFile(os.path.join(build, addon)) as built:
        packages[addon] = zip_bytes({entry.filename: (built.read(entry), 0o755 if entry.external_attr >> 16 & 0o100 else 0o644)
                                     for entry in built.infolist() if not entry.is_dir()})
    os.makedirs(folder, exist_ok=True)
    for file, content in packages.items():
        with open(os.path.join(folder, file), "wb") as out:
            out.write(content)
        print(f"{file} {len(content)} bytes, SHA-256 {hashlib.sha256(content).hexdigest()}")


if __name__ == "__main__":
    main()
