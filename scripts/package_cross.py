#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""package_cross.py BUILD FOLDER: packs what `make cross` built in BUILD (build-cross/TARGET) into FOLDER: a wheel for Python with the module
and the program, an archive with the program alone, the add-on's zip; and the wheel of tools/recordings. Each brings the licences of what is
linked, from the sources in PAGS_CROSS. The same bytes each time: entries are sorted, and their times are those of SOURCE_DATE_EPOCH, else of
the commit; a program that names a folder of this machine is refused."""

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
CROSS = os.path.realpath(os.environ.get("PAGS_CROSS") or os.path.expanduser("~/.cache/pags-cross"))

# target: tag of the wheel's platform, the oldest Python, name of the program, of the module.
TARGETS = {
    "linux-x64-glibc2.17": ("manylinux_2_17_x86_64.manylinux2014_x86_64", 10, "pags", "pags.abi3.so"),
    "linux-arm64": ("manylinux_2_17_aarch64.manylinux2014_aarch64", 10, "pags", "pags.abi3.so"),
    "macos-arm64": ("macosx_11_0_arm64", 10, "pags", "pags.abi3.so"),
    "macos-x64": ("macosx_11_0_x86_64", 10, "pags", "pags.abi3.so"),
    "windows-x64": ("win_amd64", 10, "pags.exe", "pags.pyd"),
}

# Functions and data that the limited API has from Python 3.11 on (its Misc/stable_abi.toml). Python 3.10 shows those that it has, but on Windows,
# where a module is loaded against python3.dll, whose list they aren't in.
NEW_IN_PYTHON_3_11 = """PyType_GetName PyType_GetQualName PyObject_CheckBuffer PyObject_GetBuffer PyBuffer_GetPointer PyBuffer_SizeFromFormat PyBuffer_ToContiguous
PyBuffer_FromContiguous PyObject_CopyData PyBuffer_IsContiguous PyBuffer_FillContiguousStrides PyBuffer_FillInfo PyBuffer_Release PyMemoryView_FromBuffer
PyErr_GetHandledException PyErr_SetHandledException PyExc_BaseExceptionGroup PyStructSequence_UnnamedField Py_Version""".split()

# Rows of scripts/cross_sources.txt of which nothing is in the products, and those that are where proxies are.
NOT_SHIPPED = ("cmocka", "python3.11")
FOR_PROXIES = ("embree", "meshoptimizer", "nlohmann-json3", "opensubdiv", "qhull", "tinygltf")


def read(*path):
    with open(os.path.join(*path), "rb") as file:
        return file.read()


def version():
    header = read(ROOT, "engine/include/pags/base.h").decode()
    return ".".join(re.search(rf"#define PAGS_VERSION_{part} (\d+)", header)[1] for part in ("MAJOR", "MINOR", "PATCH"))


def epoch():
    given = os.environ.get("SOURCE_DATE_EPOCH")
    return int(
        given
        or subprocess.run(
            ["git", "-C", ROOT, "log", "-1", "--format=%ct"], capture_output=True, text=True, check=True
        ).stdout
    )


def zip_bytes(files):
    """A zip of {name: (bytes, mode)}; a zip begins in 1980."""
    date = time.gmtime(max(epoch(), 315532800))[:6]
    data = io.BytesIO()
    with zipfile.ZipFile(data, "w", zipfile.ZIP_DEFLATED, compresslevel=9) as archive:
        for name, (content, mode) in sorted(files.items()):
            info = zipfile.ZipInfo(name, date)
            info.create_system, info.external_attr, info.compress_type = (
                3,
                (0o100000 | mode) << 16,
                zipfile.ZIP_DEFLATED,
            )
            archive.writestr(info, content)
    return data.getvalue()


def tar_bytes(files):
    data = io.BytesIO()
    with (
        gzip.GzipFile("", "wb", 9, data, mtime=0) as packed,
        tarfile.open(fileobj=packed, mode="w", format=tarfile.USTAR_FORMAT) as archive,
    ):
        for name, (content, mode) in sorted(files.items()):
            info = tarfile.TarInfo(name)
            info.size, info.mode, info.mtime = len(content), mode, epoch()
            archive.addfile(info, io.BytesIO(content))
    return data.getvalue()


def wheel(name, tags, lines, text, files):
    """A wheel of {name: (bytes, mode)}, its file name and bytes. `lines` are further ones of its metadata, `text` describes it."""
    info = f"{name.replace('-', '_')}-{version()}.dist-info"
    metadata = [
        f"Metadata-Version: 2.1\nName: {name}\nVersion: {version()}\nLicense: Apache-2.0\nLicense-File: LICENSE",
        *lines,
        "Description-Content-Type: text/markdown",
        "",
        text,
        "",
    ]
    files = {
        **files,
        f"{info}/METADATA": ("\n".join(metadata).encode(), 0o644),
        f"{info}/WHEEL": (
            "\n".join(
                [
                    "Wheel-Version: 1.0",
                    "Generator: pags",
                    f"Root-Is-Purelib: {str('none-any' in tags).lower()}",
                    *(
                        f"Tag: {'-'.join(tags.split('-')[:-1])}-{platform}"
                        for platform in tags.split("-")[-1].split(".")
                    ),
                    "",
                ]
            ).encode(),
            0o644,
        ),
        f"{info}/licenses/LICENSE": (read(ROOT, "LICENSE"), 0o644),
    }
    record = "".join(
        f"{path},sha256={base64.urlsafe_b64encode(hashlib.sha256(content).digest()).rstrip(b'=').decode()},{len(content)}\n"
        for path, (content, _) in sorted(files.items())
    )
    files[f"{info}/RECORD"] = ((record + f"{info}/RECORD,,\n").encode(), 0o644)
    return f"{name.replace('-', '_')}-{version()}-{tags}.whl", zip_bytes(files)


def licences(target):
    """The licences of all code of others that is linked: {name: (bytes, mode)}."""
    zig = os.path.join(os.path.dirname(os.path.realpath(os.path.join(CROSS, "zig"))), "lib")
    found = {
        "musl": os.path.join(ROOT, "engine/maths/musl/COPYRIGHT"),
        "llvm-libcxx": os.path.join(zig, "libcxx/LICENSE.TXT"),
    }
    if target.startswith("windows"):
        found["mingw-w64"] = os.path.join(zig, "libc/mingw/COPYING")
    for line in read(ROOT, "scripts/cross_sources.txt").decode().splitlines():
        name, kind = line.split()[:2] if line.strip() and line[0] != "#" else ("", "wheel")
        if kind == "wheel" or name in NOT_SHIPPED:
            continue
        if name not in FOR_PROXIES or os.path.isdir(os.path.join(CROSS, target, "lib/cmake/TinyGLTF")):
            found[name] = os.path.join(
                CROSS, "sources", name, "debian/copyright" if kind == "debian" else "LICENSE.txt"
            )
    for path in found.values():
        if not os.path.exists(path):
            sys.exit(
                f"package_cross: {path}, a licence, isn't there: make setup-cross fetches it into PAGS_CROSS, {CROSS}"
            )
    texts = {f"{name}.txt": (read(path), 0o644) for name, path in found.items()}
    if "embree" in found and target.endswith(
        "arm64"
    ):  # the header by which Embree's code for SSE2 becomes NEON's has its licence in its head
        header = read(CROSS, "sources/embree/common/simd/arm/sse2neon.h")
        texts["sse2neon.txt"] = (header[header.index(b"// This header") : header.index(b"*/") + 3], 0o644)
    return texts


def refuse_folders(files):
    """Ends where a file of {name: (bytes, mode)} names a folder of this machine."""
    folders = {ROOT, CROSS, *(os.path.realpath(os.path.join(CROSS, part)) for part in ("sources", "venv"))}
    for name, (content, _) in sorted(files.items()):
        for folder in sorted(folders):
            at = content.find(folder.encode() + b"/")
            if at >= 0:
                text = content[at : at + 120].split(b"\0")[0].decode(errors="replace")
                sys.exit(
                    f"package_cross: {name} has this machine's path {text} at byte {at}; packages name no folder of the machine that built them"
                )


def refuse_new_names(name, content):
    """Ends where a module asks for what Python 3.10 hasn't."""
    for new in NEW_IN_PYTHON_3_11:
        if b"\0" + new.encode() + b"\0" in content:
            sys.exit(
                f"package_cross: {name} asks for {new}, which Python has from 3.11 on; the packages are for Python 3.10 and later"
            )


def engine_wheel(build, target, others):
    """The module and the program, which lies among the scripts, so that it is started without a Python."""
    platform, python, program, module = TARGETS[target]
    base = f"pags-{version()}"
    return wheel(
        "pags",
        f"cp3{python}-abi3-{platform}",
        [
            "Summary: Gaussian splatting of driving scenes on processors",
            "License-File: THIRD_PARTY.md",
            *(f"License-File: third_party/{name}" for name in sorted(others)),
            f"Requires-Python: >=3.{python}",
            "Provides-Extra: recordings",
            f'Requires-Dist: pags-recordings == {version()}; extra == "recordings"',
        ],
        "Turns recordings of a driving car and photographs of static scenes into 3D Gaussians, draws them, and exports meshes and splat files, on ordinary\n"
        "processors: the module `pags` (`help(pags)`) and the program `pags` (`pags --help`).",
        {
            module: (read(build, "python", module), 0o755),
            "pags-stubs/__init__.pyi": (read(build, "python", "pags.pyi"), 0o644),
            f"{base}.data/scripts/{program}": (read(build, program), 0o755),
            f"{base}.dist-info/licenses/THIRD_PARTY.md": (read(ROOT, "THIRD_PARTY.md"), 0o644),
            **{f"{base}.dist-info/licenses/third_party/{name}": file for name, file in others.items()},
        },
    )


def recordings_wheel():
    """The wheel of tools/recordings, which is pure Python."""
    folder = os.path.join(ROOT, "tools/recordings")
    needed = [
        line for line in read(folder, "requirements.txt").decode().splitlines() if line and not line.startswith("#")
    ]
    return wheel(
        "pags-recordings",
        "py3-none-any",
        [
            "Summary: writes and imports recordings of driving for pags",
            "Requires-Python: >=3.9",
            *(f"Requires-Dist: {line}" for line in needed),
        ],
        "Writes recordings of driving in the layout that `pags train` reads, and imports those of other sources.",
        {
            f"pags_recordings/{name}": (read(folder, "pags_recordings", name), 0o644)
            for name in os.listdir(os.path.join(folder, "pags_recordings"))
            if name.endswith(".py")
        },
    )


def main():
    if len(sys.argv) != 3:
        sys.exit(__doc__)
    build, folder = sys.argv[1:]
    target = os.path.basename(os.path.normpath(build))
    if target not in TARGETS:
        sys.exit(f"package_cross: {build}: expected the folder of one of {', '.join(TARGETS)}")
    _, _, program, module = TARGETS[target]
    addon = f"pags-blender-{version()}-{target.split('-glibc')[0]}.zip"
    for name in (program, "python/" + module, "python/pags.pyi", addon):
        if not os.path.exists(os.path.join(build, name)):
            sys.exit(f"package_cross: {os.path.join(build, name)} isn't there: make cross TARGET={target} makes it")
    name = f"pags-{version()}-{target.split('-glibc')[0]}"
    others = licences(target)
    refuse_folders({path: (read(build, path), 0) for path in (program, "python/" + module)})
    refuse_new_names(module, read(build, "python", module))
    packages = dict([engine_wheel(build, target, others), recordings_wheel()])
    alone = {
        f"{name}/{program}": (read(build, program), 0o755),
        **{
            f"{name}/{text}": (read(ROOT, text), 0o644)
            for text in ("LICENSE", "THIRD_PARTY.md", "README.md", "CHANGELOG.md")
        },
        **{f"{name}/third_party/{text}": file for text, file in others.items()},
    }
    if program.endswith(".exe"):
        packages[name + ".zip"] = zip_bytes(alone)
    else:
        packages[name + ".tar.gz"] = tar_bytes(alone)
    with zipfile.ZipFile(os.path.join(build, addon)) as built:
        inside = {
            entry.filename: (built.read(entry), 0o755 if entry.external_attr >> 16 & 0o100 else 0o644)
            for entry in built.infolist()
            if not entry.is_dir()
        }
    packages[addon] = zip_bytes(
        {**inside, **{f"pags_blender/third_party/{text}": file for text, file in others.items()}}
    )
    os.makedirs(folder, exist_ok=True)
    for file, content in packages.items():
        with open(os.path.join(folder, file), "wb") as out:
            out.write(content)
        print(f"{file} {len(content)} bytes, SHA-256 {hashlib.sha256(content).hexdigest()}")


if __name__ == "__main__":
    main()
