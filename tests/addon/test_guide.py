# SPDX-License-Identifier: Apache-2.0
"""Runs the commands of docs/blender-guide.md as written: those that install the add-on, and those that work without
a window. gui_guide.py tests the page's numbered steps."""

import os
import re
import shutil
import subprocess
import sys
import tempfile
import unittest

HERE = os.path.dirname(os.path.abspath(__file__))
sys.path[:0] = [HERE, os.path.join(HERE, "..", "cli")]

import guide_page  # noqa: E402
from fixtures import read_png  # noqa: E402
from run_blender import environment, skip  # noqa: E402
from test_drive import make_drive  # noqa: E402

PAGS, PACKAGE, BLENDER = sys.argv[1:4]
OF_EXTENSIONS, OF_ADDONS = "--command extension", "preferences.addon_install"


class Commands(unittest.TestCase):
    def setUp(self):
        self.folder = tempfile.mkdtemp(prefix="pags-guide-")
        self.addCleanup(shutil.rmtree, self.folder, True)
        for name in ("bin", "build", "user", "user/config", "user/scripts", "user/datafiles"):
            os.mkdir(self.path(name))
        os.mkdir(self.path("user", "scripts", "addons"))
        self.environment = environment(self.path("user"))
        for name, program in (("blender", shutil.which(BLENDER)), ("pags", PAGS)):
            with open(
                self.path("bin", name), "w"
            ) as file:  # The program's PATH must not contain this folder, since the program may search for its name.
                file.write(f'#!/bin/sh\nPATH="{self.environment["PATH"]}" exec "{os.path.abspath(program)}" "$@"\n')
            os.chmod(self.path("bin", name), 0o755)
        shutil.copy(PACKAGE, self.path("build"))
        make_drive(self.path("scene"))
        self.environment["PATH"] = self.path("bin") + os.pathsep + self.environment["PATH"]

    def path(self, *names):
        return os.path.join(self.folder, *names)

    def type(self, command):
        print("$", command, flush=True)
        done = subprocess.run(
            command,
            shell=True,
            cwd=self.folder,
            env=self.environment,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            encoding="utf-8",
        )
        self.assertEqual(done.returncode, 0, done.stdout)
        self.assertNotIn("Traceback", done.stdout)
        return done.stdout

    def test_commands_of_the_guide(self):
        version = re.search(r"Blender (\d+)\.(\d+)", self.type("blender --version"))
        other = OF_ADDONS if tuple(map(int, version.groups())) >= (4, 2) else OF_EXTENSIONS
        commands = guide_page.commands()
        self.assertTrue(
            all(sum(kind in command for command in commands) == 1 for kind in (OF_EXTENSIONS, OF_ADDONS)), commands
        )
        for command in commands:
            if other not in command:
                self.type(command)
        for name in ("pictures/street.png", "pictures/00000.png"):
            picture = read_png(self.path(name))
            self.assertGreater(max(picture[4]), 100, f"{name} is black")
        self.assertTrue(os.path.exists(self.path("edited", "scene.json")))


if shutil.which(BLENDER) is None:
    skip("there is no Blender here (Debian: apt-get install blender)")
if os.path.basename(BLENDER).startswith("python"):
    skip("the module bpy is no program")
unittest.main(argv=["test"], verbosity=2)
