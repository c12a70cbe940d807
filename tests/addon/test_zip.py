# SPDX-License-Identifier: Apache-2.0
"""test_zip.py PAGS ADDON.zip BLENDER: tests the add-on's zip for several systems (scripts/package_addon.py). The zip
combines ADDON.zip of this system with stand-ins for other systems. Checks its contents and the selected part. In
Blender up to 4.1, also checks that it works, or names its systems on any other system."""

import importlib.util
import os
import re
import subprocess
import sys
import zipfile
from pathlib import Path
from unittest import mock

HERE = Path(__file__).resolve().parent
ROOT = HERE.parent.parent
sys.path[:0] = [str(HERE.parent / "cli"), str(ROOT / "scripts")]
ADDON, BLENDER = Path(sys.argv.pop(2)), sys.argv.pop(2)

import fixtures  # noqa: E402
import package_addon  # noqa: E402
from fixtures import Case, main  # noqa: E402

OWN = "linux-x64"
# System: sys.platform, platform.machine() and sysconfig.get_platform() there.
ANSWERS = {
    "linux-x64": ("linux", "x86_64", "linux-x86_64"),
    "macos-arm64": ("darwin", "arm64", "macosx-11.0-arm64"),
    # also on Apple's processors, where this Python is emulated
    "macos-x64": ("darwin", "x86_64", "macosx-10.15-x86_64"),
    "windows-x64": ("win32", "ARM64", "win-amd64"),  # on a machine with another processor, which emulates this Python
}


class Zip(Case):
    def stand_in(self, system, change=None):
        """Writes a copy of ADDON.zip with a stand-in module and program; `change` names one changed file."""
        path = self.path(f"pags-blender-{package_addon.version()}-{system}.zip")
        module, program = ("pags.pyd", "pags.exe") if system.startswith("windows") else ("pags.abi3.so", "pags")
        with zipfile.ZipFile(ADDON) as own, zipfile.ZipFile(path, "w") as made:
            for entry in own.infolist():
                if not entry.is_dir() and not package_addon.PARTS.fullmatch(entry.filename):
                    made.writestr(entry, own.read(entry) + (b"\n" if entry.filename == change else b""))
            made.writestr("pags_blender/" + module, f"a module for {system}")
            made.writestr("pags_blender/bin/" + program, f"a program for {system}")
        return path

    def own(self):
        path = self.path(f"pags-blender-{package_addon.version()}-{OWN}.zip")
        os.symlink(ADDON, path)
        return path

    def merge(self, expected=0):
        made = subprocess.run(
            [sys.executable, "-B", str(ROOT / "scripts/package_addon.py"), str(self.folder)],
            capture_output=True,
            text=True,
        )
        self.assertEqual(made.returncode, expected, made.stderr)
        name = re.match(r"\S+\.zip|", made.stdout)[0]
        return made.stderr if expected else (self.path(name) if name else None, made.stdout)

    def test_contents(self):
        self.own()
        for system in ANSWERS.keys() - {OWN}:
            self.stand_in(system)
        path, said = self.merge()
        self.assertIn("for linux-x64, macos-arm64, macos-x64, windows-x64\n", said)
        with zipfile.ZipFile(path) as merged, zipfile.ZipFile(ADDON) as own:
            names = merged.namelist()
            self.assertEqual(len(names), len(set(names)))
            for entry in own.namelist():
                part = package_addon.PARTS.fullmatch(entry)
                if not entry.endswith("/") and entry != "pags_blender/blender_manifest.toml":
                    self.assertEqual(
                        merged.read(entry.replace("pags_blender/", f"pags_blender/{OWN}/", 1) if part else entry),
                        own.read(entry),
                    )
            self.assertNotIn("pags_blender/blender_manifest.toml", names)
            self.assertEqual(merged.read("pags_blender/windows-x64/bin/pags.exe"), b"a program for windows-x64")
            self.assertEqual(merged.read("pags_blender/macos-arm64/pags.abi3.so"), b"a module for macos-arm64")

    def test_systems_of_the_zip(self):
        """Missing systems are named. Zips from different sources are refused with the file's name."""
        self.assertIn("make packages", self.merge(1))
        self.stand_in("linux-arm64")  # Blender isn't available for this system
        self.assertIsNone(self.merge()[0])
        self.own()
        self.assertIn("without macos-arm64", self.merge()[1])
        self.stand_in("windows-x64", "pags_blender/importer.py")
        said = self.merge(1)
        self.assertIn("pags_blender/importer.py", said)
        self.assertIn("windows-x64.zip", said)

    def test_choice_of_the_system(self):
        """Selects the part by Python's description of the process, in zips for one or several systems. A zip for
        other systems names them."""
        spec = importlib.util.spec_from_file_location("system", ROOT / "blender_addon/pags_blender/system.py")
        system = importlib.util.module_from_spec(spec)
        spec.loader.exec_module(system)

        def asked(kind, machine, build):
            with (
                mock.patch.object(sys, "platform", kind),
                mock.patch.object(system.platform, "machine", lambda: machine),
                mock.patch.object(system.sysconfig, "get_platform", lambda: build),
                mock.patch.object(system, "HERE", str(self.folder)),
            ):
                try:
                    return system.module(), os.path.relpath(system.folder(), self.folder)
                except ImportError as error:
                    return str(error)

        for answers in ANSWERS.values():
            self.assertEqual(asked(*answers), (".pags", "."))
        for name in ANSWERS:
            self.write(f"{name}/{'pags.pyd' if name.startswith('windows') else 'pags.abi3.so'}", b"")
        self.write("bin/pags", b"")
        for name, answers in ANSWERS.items():
            self.assertEqual(asked(*answers), (f".{name}.pags", name))
        said = asked("linux", "aarch64", "linux-aarch64")
        for word in [*ANSWERS, "needs linux-arm64"]:
            self.assertIn(word, said)

    def in_blender(self, package, script, chosen=""):
        try:
            version = re.search(
                r"Blender (\d+)\.(\d+)", subprocess.run([BLENDER, "--version"], capture_output=True, text=True).stdout
            )
        except OSError:
            self.skipTest("there is no Blender")
        if (int(version[1]), int(version[2])) >= (4, 2):
            self.skipTest("Blender 4.2 and later take extensions, which are for one system each")
        ran = subprocess.run(
            [sys.executable, "-B", str(HERE / "run_blender.py"), script, fixtures.PAGS, package, BLENDER],
            capture_output=True,
            text=True,
            env={**os.environ, "PAGS_TESTS": chosen},
        )
        self.assertEqual(ran.returncode, 0, ran.stdout[-3000:])
        self.assertRegex(ran.stdout, r"Ran [1-9]\d* test")

    def test_in_blender(self):
        self.own()
        self.stand_in("windows-x64")
        self.in_blender(self.merge()[0], "test_blender.py", "Program Cameras")

    def test_in_a_blender_of_another_system(self):
        self.stand_in("windows-x64")
        self.in_blender(self.merge()[0], "blender_foreign.py")


if __name__ == "__main__":
    main()
