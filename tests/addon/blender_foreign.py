# SPDX-License-Identifier: Apache-2.0
"""Tests the add-on from a zip for other systems only, in Blender without a window. The add-on can be switched on and
off. Features that need the module name the systems of the zip."""

import os
import sys

import bpy

sys.path.insert(0, os.path.dirname(os.path.abspath(__file__)))
from blender_case import BlenderCase, addon, main  # noqa: E402


class Foreign(BlenderCase):
    def test_systems_of_the_zip_are_named(self):
        self.assertIn(addon.__name__, bpy.context.preferences.addons)
        self.raises(
            ["zip of the add-on is for windows-x64, but this Blender needs linux-x64"],
            bpy.ops.import_scene.pags,
            filepath=self.path("scene"),
        )
        reason = sys.modules[addon.__name__ + ".program"].absent(bpy.context)
        self.assertTrue(reason == "" or "windows-x64" in reason or "PATH" in reason, reason)


if __name__ == "__main__":
    main()
