# SPDX-License-Identifier: Apache-2.0
"""The add-on in a Blender that has the Python module `pags`, too, where Debian's packages put it: before the add-ons on sys.path."""

import importlib.util
import os
import sys
from types import SimpleNamespace
from unittest import mock

import bpy

sys.path.insert(0, os.path.dirname(os.path.abspath(__file__)))
PROGRAM, PACKAGE = sys.argv[sys.argv.index("--") + 1 :][:2]
sys.path.insert(0, os.path.join(os.path.dirname(PROGRAM), "python"))  # as dist-packages
from blender_case import BlenderCase, addon, main  # noqa: E402


class Together(BlenderCase):
    def test_both_are_there(self):
        """The add-on draws, and `import pags` is the Python API, of which nothing is a part of the add-on."""
        import pags

        self.bring_in()
        self.assertGreater(max(self.f12()[4]), 100)
        scene = pags.load(self.path("scene"))
        self.assertEqual(len(memoryview(pags.render(scene, scene.views[0]).rgba).shape), 3)
        self.assertFalse(hasattr(pags, "register"))
        self.assertFalse(hasattr(pags, "__file__") and addon.__name__.startswith("bl_ext."))  # Blender would call it a violation of its policy

    def test_a_second_copy(self):
        """It is refused, and the copy that is on is named."""
        known = type("PAGS_OT_job", (), {"__module__": "bl_ext.other.pags.jobs"})
        types = SimpleNamespace(Operator=SimpleNamespace(bl_rna_get_subclass_py=lambda name: known))
        with mock.patch.object(addon, "bpy", SimpleNamespace(types=types, context=bpy.context)), self.assertRaisesRegex(RuntimeError, r"bl_ext\.other\.pags"):
            addon.register()
        self.bring_in()

    def test_the_former_name(self):
        """Up to Blender 4.1 the zip has a package `pags`, which is the Python API and, where a script or a farm switches that on, the add-on."""
        if addon.__name__.startswith("bl_ext."):
            self.skipTest("an extension has no other name")
        former = os.path.join(os.path.dirname(os.path.dirname(addon.__file__)), "pags", "__init__.py")
        spec = importlib.util.spec_from_file_location("pags", former)
        module = importlib.util.module_from_spec(spec)
        spec.loader.exec_module(module)
        self.assertEqual(module.load(self.path("scene")).info["gaussians"], sys.modules["pags"].load(self.path("scene")).info["gaussians"])
        self.assertIs(module.importer, sys.modules[addon.__name__ + ".importer"])
        with self.assertRaises(AttributeError):
            module.nothing
        bpy.ops.preferences.addon_disable(module=addon.__name__)
        bpy.context.preferences.addons.new().module = "pags"  # chosen once
        module.register()
        self.assertEqual([a.module for a in bpy.context.preferences.addons if "pags" in a.module], [addon.__name__])
        self.bring_in()


if __name__ == "__main__":
    main()
