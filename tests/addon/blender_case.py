# SPDX-License-Identifier: Apache-2.0
"""Shared code of the tests that run inside Blender: installs the add-on from its zip and renders by F12 or by the
program."""

import json
import os
import sys
import time
import unittest

import bpy

HERE = os.path.dirname(os.path.abspath(__file__))
sys.path[:0] = [HERE, os.path.join(HERE, "..", "cli")]
sys.dont_write_bytecode = True
sys.stdout.reconfigure(line_buffering=True)

import fixtures  # noqa: E402
from fixtures import Case, read_png  # noqa: E402
from test_drive import make_drive  # noqa: E402

PROGRAM, PACKAGE = sys.argv[sys.argv.index("--") + 1 :][:2]
fixtures.PAGS = PROGRAM


def install():
    """Installs the zip as a user does; returns the add-on's package."""
    if bpy.app.version >= (4, 2, 0):
        bpy.ops.extensions.package_install_files(
            filepath=PACKAGE, repo="user_default", enable_on_install=True, overwrite=True
        )
        name = "bl_ext.user_default.pags"
        if name not in bpy.context.preferences.addons:
            bpy.ops.preferences.addon_enable(module=name)
    else:
        bpy.ops.preferences.addon_install(filepath=PACKAGE, overwrite=True)
        bpy.ops.preferences.addon_enable(module="pags_blender")
        name = "pags_blender"
    __import__(name)
    return sys.modules[name]


addon = install()


class BlenderCase(Case):
    def setUp(self):
        super().setUp()
        # Windows can't remove a .pagsz file while it is in use
        self.addCleanup(sys.modules[addon.__name__ + ".native"].forget)
        bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
        if addon.__name__ not in bpy.context.preferences.addons:
            bpy.ops.preferences.addon_enable(module=addon.__name__)
        make_drive(self.path("scene"))
        begin = time.monotonic()
        self.addCleanup(lambda: print(f"[{self.id()}: {time.monotonic() - begin:.1f} s]"))

    @property
    def scene(self):
        return bpy.context.scene

    def bring_in(self, name="scene", **keywords):
        answer = bpy.ops.import_scene.pags(filepath=self.path(name), **keywords)
        self.assertEqual(answer, {"FINISHED"})
        scene = self.scene
        # Blender 5: an earlier test may have left the multilayer type
        if hasattr(scene.render.image_settings, "media_type"):
            scene.render.image_settings.media_type = "IMAGE"
        scene.render.image_settings.file_format = "PNG"
        scene.render.image_settings.color_mode = "RGB"
        scene.render.dither_intensity = 0  # without this, Blender adds noise of half a grey level
        return bpy.context.view_layer.objects.active

    def part(self, index):
        return next(o for o in self.scene.objects if o.pags.kind in {"OBJECT", "BACKGROUND"} and o.pags.index == index)

    def track(self, index):
        return next(o for o in self.scene.objects if o.pags.kind == "TRACK" and o.pags.index == index)

    def f12(self, name="f12"):
        """Renders by F12; returns (width, height, channels, bits, samples) of the picture."""
        path = self.path(name + ".png")
        self.scene.render.filepath = path
        bpy.ops.render.render(write_still=True)
        return read_png(path)

    def program(self, *more, scene="scene"):
        """Returns the program's picture for the scene's camera, which the add-on exports as a camera file."""
        bpy.ops.export_scene.pags_path(filepath=self.path("camera.json"), single=True)
        self.succeeds("render", self.path(scene), "--camera", self.path("camera.json"), "-o", self.path("out"), *more)
        return read_png(self.path("out", "00000.png"))

    def assert_close(self, a, b, levels=1, mostly=0):
        """Checks that no sample differs by more than `levels` grey levels and that the picture isn't black."""
        self.assertEqual(a[:4], b[:4])
        apart = max(abs(x - y) for x, y in zip(a[4], b[4]))
        self.assertLessEqual(apart, levels)
        self.assertGreater(max(a[4]), 100)

    def difference(self, a, b):
        return max(abs(x - y) for x, y in zip(a[4], b[4]))

    def links_can_be_made(self):
        """Returns whether symbolic links can be made. Windows needs a privilege; wine reports success but makes no
        link."""
        try:
            os.symlink(self.path("scene"), self.path("a link"))
        except OSError:
            return False
        made = os.path.islink(self.path("a link"))
        if made:
            os.remove(self.path("a link"))
        return made

    def needs_proxies(self):
        said = fixtures.run("export", self.path("scene"), self.path("proxies.glb")).stderr
        if "this build writes" in said:
            self.skipTest("this build of the program writes no glTF")

    def raises(self, words, operator, **keywords):
        """Checks that the operator fails with a RuntimeError that contains these words and no traceback."""
        with self.assertRaises(RuntimeError) as caught:
            operator(**keywords)
        for word in words:
            self.assertIn(str(word), str(caught.exception))
        self.assertNotIn("Traceback", str(caught.exception))


def pixel(picture, x, y):
    at = (y * picture[0] + x) * picture[2]
    return tuple(picture[4][at : at + 3])


def main():
    chosen = os.environ.get("PAGS_TESTS", "").split()
    if unittest.main(module="__main__", argv=["test", *chosen], verbosity=2, exit=False).result.wasSuccessful():
        bpy.ops.preferences.addon_disable(module=addon.__name__)
        assert not hasattr(bpy.types.Scene, "pags"), "the add-on has left its properties behind"
        print("all tests passed")
        sys.stdout.flush()
        if not bpy.app.binary_path:
            os._exit(0)  # the module bpy 4.2.23 crashes when Python exits after a script has registered a panel
    else:
        os._exit(3)


__all__ = ["BlenderCase", "addon", "json", "main", "pixel", "PROGRAM"]
