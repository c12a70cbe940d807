# SPDX-License-Identifier: Apache-2.0
"""The add-on in Blender without a window, from a zip that holds it for other systems alone: it can be switched on and off, and what needs the module
names the systems that the zip is for."""

import os
import sys

import bpy

sys.path.insert(0, os.path.dirname(os.path.abspath(__file__)))
from blender_case import BlenderCase, addon, main  # noqa: E402


class Foreign(BlenderCase):
    def test_it_says_so(self):
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
