# SPDX-License-Identifier: Apache-2.0
"""What is packed of a cross build: wheels, archives and the add-on's zip. The builds are files of a few words here."""

import base64
import csv
import hashlib
import io
import os
import re
import subprocess
import sys
import unittest
import zipfile

import fixtures
from fixtures import Case

ROOT = os.path.join(os.path.dirname(os.path.abspath(__file__)), "..", "..")
SCRIPT = os.path.join(ROOT, "scripts", "package_cross.py")
HEADER = fixtures.read(os.path.join(ROOT, "engine/include/pags/base.h")).decode()
VERSION = ".".join(re.search(rf"#define PAGS_VERSION_{part} (\d+)\n", HEADER)[1] for part in ["MAJOR", "MINOR", "PATCH"])


class Packages(Case):
    def build(self, target, program="pags", module="pags.abi3.so"):
        folder = f"{target}-{len(os.listdir(self.path('.')))}/{target}"
        self.write(f"{folder}/{program}", "#!/bin/sh\necho program\n")
        self.write(f"{folder}/python/{module}", "module")
        self.write(f"{folder}/python/pags.pyi", "types")
        with zipfile.ZipFile(self.path(f"{folder}/pags-blender-{VERSION}-{target.split('-glibc')[0]}.zip"), "w") as addon:
            addon.writestr("pags/__init__.py", "text")
            addon.writestr("pags/bin/", "")
            info = zipfile.ZipInfo("pags/bin/" + program)
            info.external_attr = 0o100755 << 16
            addon.writestr(info, "program")
        return self.path(folder)

    def pack(self, build, umask=0o22, **environment):
        out = build + "-out"
        done = subprocess.run([sys.executable, "-B", SCRIPT, build, out], capture_output=True, text=True, umask=umask,
                              env={**os.environ, "SOURCE_DATE_EPOCH": "1700000000", **environment})
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
        self.assertEqual(list(packed), [f"pags-{VERSION}-cp310-abi3-manylinux_2_17_x86_64.manylinux2014_x86_64.whl", f"pags-{VERSION}-linux-x64.tar.gz",
                                        f"pags-blender-{VERSION}-linux-x64.zip", f"pags_recordings-{VERSION}-py3-none-any.whl"])
        self.assertEqual(packed, self.pack(second, umask=0o77, TZ="Asia/Tokyo", LC_ALL="tr_TR.UTF-8"))
        self.assertNotEqual(packed, self.pack(second, SOURCE_DATE_EPOCH="1700086400"))

    def test_wheels(self):
        for target, program, module, tags in [
            ("linux-arm64", "pags", "pags.abi3.so", ["cp310-abi3-manylinux_2_17_aarch64", "cp310-abi3-manylinux2014_aarch64"]),
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
            with zipfile.ZipFile(io.BytesIO(packed[next(name for name in packed if name.startswith("pags-blender"))])) as addon:
                self.assertEqual(addon.getinfo("pags/bin/" + program).external_attr >> 16, 0o100755)
                self.assertEqual(addon.getinfo("pags/__init__.py").external_attr >> 16, 0o100644)

    @unittest.skipUnless(os.uname().machine == "x86_64" and subprocess.run([sys.executable, "-m", "pip", "--version"], capture_output=True).returncode == 0,
                         "no pip")
    def test_pip_takes_it(self):
        build = self.build("linux-x64-glibc2.17")
        wheel, recordings = (name for name in self.pack(build) if name.endswith(".whl"))
        done = subprocess.run([sys.executable, "-m", "pip", "install", "-q", "--no-index", "--no-deps", "--disable-pip-version-check", "--ignore-installed",
                               "--prefix", self.path("usr"), *(os.path.join(build + "-out", name) for name in (wheel, recordings))], capture_output=True, text=True)
        self.assertEqual(done.returncode, 0, done.stderr)
        self.assertEqual(subprocess.run([self.path("usr/bin/pags")], capture_output=True, text=True).stdout, "program\n")
        installed = [os.path.join(folder, name) for folder, _, names in os.walk(self.path("usr")) for name in names]
        for name in ["pags.abi3.so", "pags-stubs/__init__.pyi", "pags_recordings/writer.py"]:
            self.assertEqual(len([path for path in installed if path.endswith("-packages/" + name)]), 1, name)

    def test_what_is_no_build(self):
        done = subprocess.run([sys.executable, "-B", SCRIPT, self.path("amiga"), self.path("out")], capture_output=True, text=True)
        self.assertEqual(done.returncode, 1)
        self.assertIn("amiga: expected the folder of one of linux-x64-glibc2.17", done.stderr)
        build = self.build("linux-arm64")
        os.remove(os.path.join(build, "python/pags.abi3.so"))
        done = subprocess.run([sys.executable, "-B", SCRIPT, build, self.path("out")], capture_output=True, text=True)
        self.assertEqual(done.returncode, 1)
        self.assertIn("python/pags.abi3.so isn't there: make cross TARGET=linux-arm64", done.stderr)


if __name__ == "__main__":
    fixtures.main()
