# SPDX-License-Identifier: Apache-2.0
"""Tests the files of `make install`: a C program builds with pkg-config, Python imports the module, the program
reads pictures."""

import json
import os
import re
import subprocess
import sys
import zipfile

HERE = os.path.dirname(os.path.abspath(__file__))
sys.path.insert(0, os.path.join(HERE, "..", "cli"))
BUILD = sys.argv.pop(2)
COMPILER = sys.argv.pop(2)

import fixtures  # noqa: E402
from fixtures import Case, ply_bytes, run, some_splats  # noqa: E402

SOURCE = os.path.join(HERE, "..", "..", "examples", "first.c")


class Install(Case):
    def test_all_installed_files(self):
        prefix = self.path("usr")
        subprocess.run(["cmake", "--install", BUILD, "--prefix", prefix], check=True, capture_output=True)
        splats = self.write("some.ply", ply_bytes(some_splats()))
        self.c_program(prefix, splats)
        self.library(prefix)
        self.python(prefix, splats)
        self.versions(prefix)
        fixtures.PAGS, program = os.path.join(prefix, "bin", "pags"), fixtures.PAGS
        done = run("render", splats, "-o", self.path("out"), "--frames", 1)
        fixtures.PAGS = program
        self.assertEqual(done.returncode, 0, done.stderr)

    def c_program(self, prefix, splats):
        environment = {**os.environ, "PKG_CONFIG_PATH": os.path.join(prefix, "lib", "pkgconfig")}
        answer = subprocess.run(
            ["pkg-config", "--cflags", "--libs", "pags"], env=environment, capture_output=True, text=True
        )
        self.assertEqual(answer.returncode, 0, answer.stderr)
        command = [COMPILER, "-std=c17", SOURCE, "-o", self.path("first"), *answer.stdout.split()]
        built = subprocess.run(command, capture_output=True, text=True)
        self.assertEqual(built.returncode, 0, built.stderr)
        environment["LD_LIBRARY_PATH"] = os.path.join(prefix, "lib")
        camera, picture = self.write("front.json", json.dumps(fixtures.FRONT)), self.path("picture.ppm")
        ran = subprocess.run(
            [self.path("first"), splats, camera, picture], env=environment, capture_output=True, text=True
        )
        self.assertEqual(ran.returncode, 0, ran.stderr)
        self.assertTrue(fixtures.read(picture).startswith(b"P6 65 49 255\n"))
        ran = subprocess.run(
            [self.path("first"), self.path("none"), camera, picture], env=environment, capture_output=True, text=True
        )
        self.assertIn("none", ran.stderr)

    def library(self, prefix):
        """Checks that the library has a version and a soname and exports only names that begin with pags_."""
        folder = os.path.join(prefix, "lib")
        real = os.path.realpath(os.path.join(folder, "libpags.so"))
        self.assertRegex(os.path.basename(real), r"^libpags\.so\.\d+\.\d+\.\d+$")
        dynamic = subprocess.run(["readelf", "-d", real], capture_output=True, text=True).stdout
        self.assertRegex(dynamic, r"soname: \[libpags\.so\.\d+\.\d+\]")
        listed = subprocess.run(["nm", "-D", "--defined-only", real], capture_output=True, text=True).stdout
        names = [line.split()[-1] for line in listed.splitlines()]
        self.assertIn("pags_compose_placed", names)
        self.assertEqual([name for name in names if not name.startswith("pags_")], [])

    def versions(self, prefix):
        """Checks that the header's version is used everywhere and that the program's manual and shell completions
        are installed."""
        header = fixtures.read(os.path.join(prefix, "include/pags/base.h")).decode()
        parts = [re.search(rf"#define PAGS_VERSION_{part} (\d+)\n", header)[1] for part in ["MAJOR", "MINOR", "PATCH"]]
        version = ".".join(parts)
        self.assertIn(f"\nVersion: {version}\n", fixtures.read(os.path.join(prefix, "lib/pkgconfig/pags.pc")).decode())
        self.assertTrue(os.path.exists(os.path.join(prefix, f"lib/libpags.so.{version}")))
        self.assertIn(
            f'\n__version__ = "{version}"',
            fixtures.read(os.path.join(prefix, "share/pags/recordings/pags_recordings/__init__.py")).decode(),
        )
        with zipfile.ZipFile(os.path.join(BUILD, f"pags-blender-{version}-linux-x64.zip")) as addon:
            self.assertIn(f'\nversion = "{version}"\n', addon.read("pags_blender/blender_manifest.toml").decode())
            self.assertIn(f'"version": ({", ".join(parts)}),', addon.read("pags_blender/__init__.py").decode())
        for name in [
            "man/man1/pags.1",
            "man/man1/pags-train.1",
            "bash-completion/completions/pags",
            "zsh/site-functions/_pags",
            "fish/vendor_completions.d/pags.fish",
        ]:
            self.assertIn("pags", fixtures.read(os.path.join(prefix, "share", name)).decode(), name)

    def python(self, prefix, splats):
        module = [
            os.path.dirname(os.path.join(w, f))
            for w, _, fs in os.walk(prefix)
            for f in fs
            if re.match(r"pags\.abi3", f)
        ]
        code = f"import sys; sys.path.insert(0, {module[0]!r}); import pags; print(pags.load({splats!r}).info['gaussians'])"
        ran = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
        self.assertEqual(ran.stdout.strip(), "40", ran.stderr)
        self.assertTrue(os.path.exists(os.path.join(module[0], "pags-stubs", "__init__.pyi")))


if __name__ == "__main__":
    fixtures.main()
