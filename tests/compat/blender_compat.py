# SPDX-License-Identifier: Apache-2.0
"""Opens and renders a .blend file that was saved by Blender 3.4 and the add-on of commit ec025b61."""

import os
import shutil
import sys

sys.path.insert(0, os.path.join(os.path.dirname(os.path.abspath(__file__)), "..", "addon"))
CORPUS = os.environ["PAGS_COMPAT_CORPUS"]
import bpy  # noqa: E402
from blender_case import BlenderCase, addon, main  # noqa: E402


class Compat(BlenderCase):
    def test_blend_file(self):
        shutil.rmtree(self.path("scene"))
        shutil.copytree(os.path.join(CORPUS, "scene"), self.path("scene"))
        shutil.copyfile(os.path.join(CORPUS, "scene.blend"), self.path("scene.blend"))
        bpy.ops.wm.open_mainfile(filepath=self.path("scene.blend"))
        self.assertIn(addon.__name__, bpy.context.preferences.addons)
        self.assertEqual(self.scene.render.engine, "PAGS")
        kinds = {item.pags.kind for item in self.scene.objects}
        self.assertLessEqual({"ROOT", "OBJECT", "BACKGROUND", "TRACK"}, kinds)
        self.scene.render.image_settings.file_format = "PNG"
        self.scene.render.image_settings.color_mode = "RGB"
        self.scene.render.dither_intensity = 0
        picture = self.f12()
        self.assertEqual(picture[:2], (64, 36))
        self.assert_close(picture, self.program())


main()
