# SPDX-License-Identifier: Apache-2.0
"""Tests the packages of a cross build: wheels, archives and the add-on's zip. The builds here are files of a few
words."""

import base64
import csv
import fnmatch
import hashlib
import io
import os
import re
import subprocess
import sys
import tarfile
import unittest
import zipfile

import fixtures
from fixtures import Case

ROOT = os.path.join(os.path.dirname(os.path.abspath(__file__)), "..", "..")
SCRIPT = os.path.join(ROOT, "scripts", "package_cross.py")
HEADER = fixtures.read(os.path.join(ROOT, "engine/include/pags/base.h")).decode()
VERSION = ".".join(
    re.search(rf"#define PAGS_VERSION_{part} (\d+)\n", HEADER)[1] for part in ["MAJOR", "MINOR", "PATCH"]
)


class Packages(Case):
    def build(self, target, program="pags", module="pags.abi3.so"):
        folder = f"{target}-{len(os.listdir(self.path('.')))}/{target}"
        self.write(f"{folder}/{program}", "#!/bin/sh\necho program\n")
        self.write(f"{folder}/python/{module}", "module")
        self.write(f"{folder}/python/pags.pyi", "types")
        with zipfile.ZipFile(
            self.path(f"{folder}/pags-blender-{VERSION}-{target.split('-glibc')[0]}.zip"), "w"
        ) as addon:
            addon.writestr("pags_blender/__init__.py", "text")
            addon.writestr("pags_blender/bin/", "")
            info = zipfile.ZipInfo("pags_blender/bin/" + program)
            info.external_attr = 0o100755 << 16
            addon.writestr(info, "program")
        return self.path(folder)

    def cross(self):
        """Makes a folder with the compiler and the sources. Each of them has a licence file of one word."""
        folder = self.path("cross")
        if not os.path.exists(folder):
            for name in ["libcxx/LICENSE.TXT", "libc/mingw/COPYING"]:
                self.write("cross/zig-of-python/lib/" + name, name)
            self.write("cross/zig-of-python/zig", "")
            os.symlink("zig-of-python/zig", os.path.join(folder, "zig"))
            for line in fixtures.read(os.path.join(ROOT, "scripts/cross_sources.txt")).decode().splitlines():
                if not line.startswith("#"):
                    name, kind = line.split()[:2]
                    self.write(
                        f"cross/sources/{name}/" + ("debian/copyright" if kind == "debian" else "LICENSE.txt"),
                        "licence of " + name,
                    )
            self.write(
                "cross/sources/embree/common/simd/arm/sse2neon.h",
                "#pragma once\n// This header\n/*\n * MIT\n */\n/* Code */\n",
            )
        return folder

    def run_script(self, build, umask=0o22, **environment):
        return subprocess.run(
            [sys.executable, "-B", SCRIPT, build, build + "-out"],
            capture_output=True,
            text=True,
            umask=umask,
            env={**os.environ, "SOURCE_DATE_EPOCH": "1700000000", "PAGS_CROSS": self.cross(), **environment},
        )

    def pack(self, build, **options):
        out = build + "-out"
        done = self.run_script(build, **options)
        self.assertEqual(done.returncode, 0, done.stderr)
        return {name: fixtures.read(os.path.join(out, name)) for name in sorted(os.listdir(out))}

    def test_the_same_bytes_each_time(self):
        first = self.build("linux-x64-glibc2.17")
        second = self.build("linux-x64-glibc2.17")
        for folder, _, names in os.walk(second):
            for name in names:
                os.utime(os.path.join(folder, name), (1e9, 1e9))
                os.chmod(os.path.join(folder, name), 0o777)
        packed = self.pack(first)
        self.assertEqual(
            list(packed),
            [
                f"pags-{VERSION}-cp310-abi3-manylinux_2_17_x86_64.manylinux2014_x86_64.whl",
                f"pags-{VERSION}-linux-x64.tar.gz",
                f"pags-blender-{VERSION}-linux-x64.zip",
                f"pags_recordings-{VERSION}-py3-none-any.whl",
            ],
        )
        self.assertEqual(packed, self.pack(second, umask=0o77, TZ="Asia/Tokyo", LC_ALL="tr_TR.UTF-8"))
        self.assertNotEqual(packed, self.pack(second, SOURCE_DATE_EPOCH="1700086400"))

    def test_wheels(self):
        for target, program, module, tags in [
            (
                "linux-arm64",
                "pags",
                "pags.abi3.so",
                ["cp310-abi3-manylinux_2_17_aarch64", "cp310-abi3-manylinux2014_aarch64"],
            ),
            ("macos-arm64", "pags", "pags.abi3.so", ["cp310-abi3-macosx_11_0_arm64"]),
            ("windows-x64", "pags.exe", "pags.pyd", ["cp310-abi3-win_amd64"]),
        ]:
            packed = self.pack(self.build(target, program, module))
            name = next(name for name in packed if name.startswith("pags-") and name.endswith(".whl"))
            with zipfile.ZipFile(io.BytesIO(packed[name])) as wheel:
                info = f"pags-{VERSION}.dist-info"
                self.assertEqual(re.findall(r"^Tag: (.*)$", wheel.read(f"{info}/WHEEL").decode(), re.M), tags)
                self.assertIn(f"\nVersion: {VERSION}\n", wheel.read(f"{info}/METADATA").decode())
                rows = {row[0]: row[1:] for row in csv.reader(io.StringIO(wheel.read(f"{info}/RECORD").decode()))}
                self.assertEqual(set(rows), set(wheel.namelist()))
                for entry, (digest, size) in rows.items():
                    if digest:
                        content = wheel.read(entry)
                        made = base64.urlsafe_b64encode(hashlib.sha256(content).digest()).rstrip(b"=").decode()
                        self.assertEqual((digest, size), ("sha256=" + made, str(len(content))))
                self.assertEqual(wheel.read(module), b"module")
                self.assertEqual(wheel.getinfo(f"pags-{VERSION}.data/scripts/{program}").external_attr >> 16, 0o100755)
            with zipfile.ZipFile(
                io.BytesIO(packed[next(name for name in packed if name.startswith("pags-blender"))])
            ) as addon:
                self.assertEqual(addon.getinfo("pags_blender/bin/" + program).external_attr >> 16, 0o100755)
                self.assertEqual(addon.getinfo("pags_blender/__init__.py").external_attr >> 16, 0o100644)

    def test_licences(self):
        """Each package has the licences of all that its target links. Embree's is only in packages with proxies, and
        sse2neon's is only in those for ARM. MinGW's is only in packages for Windows."""
        for target in ["linux-x64-glibc2.17", "macos-arm64"]:
            os.makedirs(f"{self.cross()}/{target}/lib/cmake/TinyGLTF")
        for target, program, module, some, others in [
            (
                "linux-x64-glibc2.17",
                "pags",
                "pags.abi3.so",
                ["embree", "zlib", "musl", "llvm-libcxx"],
                ["mingw-w64", "cmocka", "ziglang", "python3.11", "sse2neon"],
            ),
            ("macos-arm64", "pags", "pags.abi3.so", ["embree", "sse2neon", "zlib"], ["mingw-w64"]),
            ("windows-x64", "pags.exe", "pags.pyd", ["mingw-w64", "zlib"], ["embree", "qhull"]),
        ]:
            packed = self.pack(self.build(target, program, module))
            for file, folder in [
                (f"pags-{VERSION}-cp3", f"pags-{VERSION}.dist-info/licenses/third_party/"),
                ("pags-blender", "pags_blender/third_party/"),
                (f"pags-{VERSION}-{target[:5]}", "third_party/"),
            ]:
                data = packed[next(name for name in packed if name.startswith(file))]
                if data[:2] == b"PK":
                    archive = zipfile.ZipFile(io.BytesIO(data))
                    names = archive.namelist()
                    for name in names:
                        if name.endswith("/sse2neon.txt"):
                            self.assertEqual(archive.read(name), b"// This header\n/*\n * MIT\n */\n")
                else:
                    names = tarfile.open(fileobj=io.BytesIO(data)).getnames()
                found = {os.path.basename(name)[:-4] for name in names if folder in name}
                self.assertEqual(found & set(some + others), set(some), file)
                for name in [
                    "zlib",
                    "libzstd",
                    "libwebp",
                    "libpng1.6",
                    "libjpeg-turbo",
                    "imath",
                    "openexr",
                    "expat",
                    "protobuf-c",
                ]:
                    self.assertIn(name, found)
        os.remove(self.cross() + "/sources/zlib/debian/copyright")
        done = self.run_script(self.build("linux-arm64"))
        self.assertEqual(done.returncode, 1)
        self.assertRegex(done.stderr, "sources/zlib/debian/copyright, a licence, isn't there: make setup-cross")

    def test_path_of_the_build_machine_is_refused(self):
        build = self.build("linux-arm64")
        self.write(
            os.path.relpath(build, self.path(".")) + "/python/pags.abi3.so",
            "module" + 20 * "\0" + self.cross() + "/zig-cache/x.c\0more",
        )
        done = self.run_script(build)
        self.assertEqual(done.returncode, 1)
        self.assertEqual(
            done.stderr,
            f"package_cross: python/pags.abi3.so has this machine's path {self.cross()}/zig-cache/x.c at byte 26; packages name no "
            "folder of the machine that built them\n",
        )

    def test_functions_that_python_3_10_lacks(self):
        build = self.build("windows-x64", "pags.exe", "pags.pyd")
        self.write(os.path.relpath(build, self.path(".")) + "/python/pags.pyd", "module\0PyObject_GetBuffer\0more")
        done = self.run_script(build)
        self.assertEqual(done.returncode, 1)
        self.assertRegex(done.stderr, r"^package_cross: pags\.pyd asks for PyObject_GetBuffer, .* 3\.11 on")

    @unittest.skipUnless(
        os.uname().machine == "x86_64"
        and subprocess.run([sys.executable, "-m", "pip", "--version"], capture_output=True).returncode == 0,
        "no pip",
    )
    def test_pip_installs_the_wheels(self):
        build = self.build("linux-x64-glibc2.17")
        wheel, recordings = (name for name in self.pack(build) if name.endswith(".whl"))
        done = subprocess.run(
            [
                sys.executable,
                "-m",
                "pip",
                "install",
                "-q",
                "--no-index",
                "--no-deps",
                "--disable-pip-version-check",
                "--ignore-installed",
                "--prefix",
                self.path("usr"),
                *(os.path.join(build + "-out", name) for name in (wheel, recordings)),
            ],
            capture_output=True,
            text=True,
        )
        self.assertEqual(done.returncode, 0, done.stderr)
        self.assertEqual(
            subprocess.run([self.path("usr/bin/pags")], capture_output=True, text=True).stdout, "program\n"
        )
        installed = [os.path.join(folder, name) for folder, _, names in os.walk(self.path("usr")) for name in names]
        for name in ["pags.abi3.so", "pags-stubs/__init__.pyi", "pags_recordings/writer.py"]:
            self.assertEqual(len([path for path in installed if path.endswith("-packages/" + name)]), 1, name)

    def test_install_lines_of_the_readme(self):
        """Each line of the README matches exactly one of the files that are packed for all systems."""
        packed = []
        for target in ["linux-x64-glibc2.17", "linux-arm64", "macos-arm64", "macos-x64", "windows-x64"]:
            windows = target == "windows-x64"
            packed += self.pack(
                self.build(target, "pags.exe" if windows else "pags", "pags.pyd" if windows else "pags.abi3.so")
            )
        patterns = re.findall(r"^pip install dist/(\S+)", fixtures.read(os.path.join(ROOT, "README.md")).decode(), re.M)
        self.assertGreaterEqual(len(patterns), 4)
        for pattern in patterns:
            self.assertEqual(len(fnmatch.filter(packed, pattern)), 1, pattern)

    def test_slurm_job(self):
        """Stand-ins replace Slurm's commands. The job runs pags, and runs it in an image if one is named. Only an
        interrupted job is queued again."""
        job = os.path.join(ROOT, "examples/slurm/train.sbatch")
        for name, text in [("srun", 'echo "$@" >>said; exit $PAGS_CODE'), ("scontrol", 'echo "scontrol $@" >>said')]:
            os.chmod(self.write("bin/" + name, "#!/bin/sh\n" + text + "\n"), 0o755)
        trained = "pags train /data/drive -o /scenes/a --resume --threads 8 -n 300\n"
        for code, image, said in [
            (0, None, trained),
            (1, None, trained),
            (3, None, trained + "scontrol requeue 17\n"),
            (0, "p.sif", "apptainer exec --bind /data,/scenes p.sif " + trained),
        ]:
            environment = {
                "PATH": self.path("bin") + ":/usr/bin:/bin",
                "PAGS_CODE": str(code),
                "SLURM_JOB_ID": "17",
                "SLURM_CPUS_PER_TASK": "8",
            }
            if image:
                environment["PAGS_IMAGE"] = image
            done = subprocess.run(
                ["sh", job, "/data/drive", "/scenes/a", "-n", "300"], cwd=self.path("."), env=environment
            )
            self.assertEqual(done.returncode, code)
            self.assertEqual(fixtures.read(self.path("said")).decode(), said)
            os.remove(self.path("said"))

    def test_folders_that_are_no_build(self):
        done = subprocess.run(
            [sys.executable, "-B", SCRIPT, self.path("amiga"), self.path("out")], capture_output=True, text=True
        )
        self.assertEqual(done.returncode, 1)
        self.assertIn("amiga: expected the folder of one of linux-x64-glibc2.17", done.stderr)
        build = self.build("linux-arm64")
        os.remove(os.path.join(build, "python/pags.abi3.so"))
        done = self.run_script(build)
        self.assertEqual(done.returncode, 1)
        self.assertIn("python/pags.abi3.so isn't there: make cross TARGET=linux-arm64", done.stderr)


if __name__ == "__main__":
    fixtures.main()
