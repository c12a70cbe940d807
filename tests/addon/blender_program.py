# SPDX-License-Identifier: Apache-2.0
"""Tests the add-on in Blender without a window: the `pags` program that the add-on starts."""

import os
import re
import subprocess
import sys
from unittest import mock

import bpy

sys.path.insert(0, os.path.dirname(os.path.abspath(__file__)))
from blender_case import PROGRAM, BlenderCase, addon, main  # noqa: E402


class Program(BlenderCase):
    """Tests the program that the zip contains."""

    def setUp(self):
        super().setUp()
        self.module = sys.modules[addon.__name__ + ".program"]

    def prefer(self, path):
        preferences = bpy.context.preferences.addons[addon.__name__].preferences
        preferences.program = path
        self.addCleanup(setattr, preferences, "program", "")

    def test_program_of_the_zip(self):
        """The zip's program runs without a setting, without PATH and without the executable bit."""
        own = self.module.command(bpy.context)
        self.assertTrue(own.startswith(os.path.dirname(addon.__file__) + os.sep), own)
        self.bring_in()
        if os.name != "nt":
            os.chmod(own, 0o644)  # Blender unpacks files without the executable bit
        with mock.patch.dict(os.environ, {"PATH": ""}):
            bpy.ops.export_scene.pags(filepath=self.path("own.ply"))
        self.assertGreater(os.path.getsize(self.path("own.ply")), 3 * 56)

    def test_program_needs_no_other_libraries(self):
        """All libraries that the program loads lie next to it, except for the system's C library."""
        if sys.platform != "linux":
            self.skipTest("the libraries of other systems' programs are linked into them")
        own = self.module.command(bpy.context)
        folder = os.path.join(os.path.dirname(own), "lib")
        beside = os.listdir(folder) if os.path.isdir(folder) else []
        listed = subprocess.run(["ldd", own], capture_output=True, text=True, check=True).stdout
        for name, path in re.findall(r"^\s*(\S+) => (\S+)", listed, re.MULTILINE):
            if not re.match(r"lib(c|m|dl|rt|pthread)\.so", name):
                self.assertEqual(os.path.realpath(path), os.path.realpath(os.path.join(folder, name)), listed)
                self.assertIn(name, beside)

    def test_program_chosen_by_the_user(self):
        self.bring_in()
        self.prefer(self.path("none"))
        self.raises([self.path("none"), "preferences"], bpy.ops.export_scene.pags, filepath=self.path("x.ply"))
        self.prefer(PROGRAM)
        self.assertEqual(self.module.command(bpy.context), os.path.abspath(PROGRAM))
        self.prefer("")
        with (
            mock.patch.object(self.module, "own", return_value=self.path("none")),
            mock.patch.dict(os.environ, {"PATH": ""}),
        ):
            self.raises(["without the pags program"], bpy.ops.export_scene.pags, filepath=self.path("x.ply"))

    def test_missing_proxies_are_reported(self):
        """If the program's help says that proxies are missing, the add-on shows this reason and refuses proxies.
        Splat files still work."""
        shown = "  export   write splat files of a scene; this build lacks proxies, glTF and USD (CMake option X)\n"
        known = self.succeeds("--help").stdout
        self.assertRegex(known, r"(?m)^  export ")
        self.bring_in()
        said = subprocess.CompletedProcess([], 0, shown, "")
        with (
            mock.patch.object(self.module.subprocess, "run", return_value=said),
            mock.patch.dict(self.module._lacking, clear=True),
        ):
            self.assertIn("lacks proxies, glTF and USD (CMake option X)", self.module.lacking(bpy.context))
            for name in ("x.glb", "x.gltf", "x.usda"):
                self.raises(["lacks proxies"], bpy.ops.export_scene.pags, filepath=self.path(name))
            self.raises(["lacks proxies"], bpy.ops.pags.import_proxies)
            bpy.ops.export_scene.pags(filepath=self.path("x.ply"))
            root = self.bring_in(proxies=True)  # the import only warns
            self.assertEqual(root.pags.kind, "ROOT")
        self.assertEqual(bool(self.module.lacking(bpy.context)), "lacks proxies" in known)

    def test_no_console_and_utf8(self):
        started = []

        def popen(words, **keywords):
            started.append((words, keywords))
            raise OSError("enough")

        jobs = sys.modules[addon.__name__ + ".jobs"]
        hidden = mock.patch.object(subprocess, "CREATE_NO_WINDOW", 0x08000000, create=True)
        with hidden, mock.patch.object(self.module.subprocess, "Popen", popen), self.assertRaises(OSError):
            jobs.at_once(
                "x", lambda job: (jobs.in_thread(*call) for call in [(self.module.run, job, "pags", "日本語")])
            )
        ((words, keywords),) = started
        self.assertEqual(keywords["creationflags"], 0x08000000)
        self.assertEqual(words[1], "日本語" if os.name == "nt" else "日本語".encode())

    def test_an_export_that_is_cancelled(self):
        """Cancelling an export ends the program and removes the unfinished file."""
        self.needs_proxies()
        self.bring_in()
        jobs, exporter = (sys.modules[f"{addon.__name__}.{n}"] for n in ("jobs", "exporter"))
        root, path = next(o for o in self.scene.objects if o.pags.kind == "ROOT"), self.path("x.glb")
        work = exporter.export(
            root, self.module.command(bpy.context), path, ["--proxy", "mesh", "--voxel", "0.01"], False
        )
        job = jobs.Job("Export", work)
        self.assertFalse(job.step(True))
        self.assertFalse(job.step(True))  # the program runs
        self.write("x.glb.part", b"half")
        job.cancel()
        with self.assertRaises(jobs.Cancelled):
            while True:
                job.step(True)
        self.assertEqual([n for n in os.listdir(self.folder) if n.startswith("x.")], [])


if __name__ == "__main__":
    main()
