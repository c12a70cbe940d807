# SPDX-License-Identifier: Apache-2.0
"""Tests the add-on where Blender also finds the Python module `pags` on sys.path before the add-ons, as with
Debian's packages."""

import os
import sys
import zipfile
from types import SimpleNamespace
from unittest import mock

import bpy

sys.path.insert(0, os.path.dirname(os.path.abspath(__file__)))
PROGRAM, PACKAGE = sys.argv[sys.argv.index("--") + 1 :][:2]
sys.path.insert(0, os.path.join(os.path.dirname(PROGRAM), "python"))  # takes the place of dist-packages
from blender_case import BlenderCase, addon, main  # noqa: E402


class Together(BlenderCase):
    def test_addon_and_module_together(self):
        """The add-on draws, and `import pags` gives the Python API without the add-on's functions."""
        import pags

        self.bring_in()
        self.assertGreater(max(self.f12()[4]), 100)
        scene = pags.load(self.path("scene"))
        self.assertEqual(len(memoryview(pags.render(scene, scene.views[0]).rgba).shape), 3)
        self.assertFalse(hasattr(pags, "register"))
        self.assertFalse(
            hasattr(pags, "__file__") and addon.__name__.startswith("bl_ext.")
        )  # Blender reports this as a violation of its policy.

    def test_a_second_copy(self):
        """A second copy of the add-on is refused with the name of the active copy."""
        known = type("PAGS_OT_job", (), {"__module__": "bl_ext.other.pags.jobs"})
        types = SimpleNamespace(Operator=SimpleNamespace(bl_rna_get_subclass_py=lambda name: known))
        with (
            mock.patch.object(addon, "bpy", SimpleNamespace(types=types, context=bpy.context)),
            self.assertRaisesRegex(RuntimeError, r"bl_ext\.other\.pags"),
        ):
            addon.register()
        self.bring_in()

    def test_unpacked_into_a_folder(self):
        """The whole zip works as an add-on folder, also under its former name, and still gives the Python API."""
        if addon.__name__.startswith("bl_ext."):
            self.skipTest("extensions are installed by Blender alone")
        import pags

        bpy.ops.preferences.addon_disable(module=addon.__name__)
        known = {
            name: sys.modules.pop(name) for name in list(sys.modules) if name.split(".")[0] in {"pags", addon.__name__}
        }
        folder = self.path("pags")
        with zipfile.ZipFile(PACKAGE) as package:
            package.extractall(folder)
        with mock.patch.object(sys, "path", [self.path(""), *sys.path]):
            bpy.ops.preferences.addon_enable(module="pags")
            self.assertTrue(sys.modules["pags"].__file__.startswith(folder))
            self.bring_in()
            self.assertGreater(max(self.f12()[4]), 100)
            bpy.context.preferences.addons["pags"].preferences.budget = 7
            self.assertEqual(sys.modules["pags"].pags_blender.properties.preview_budget(bpy.context), 7)
            self.assertEqual(sys.modules["pags"].load(self.path("scene")).info, pags.load(self.path("scene")).info)
            from pags import importer

            self.assertEqual(importer.__name__, "pags.pags_blender.importer")
            self.assertFalse(hasattr(sys.modules["pags"], "nothing"))
        bpy.ops.preferences.addon_disable(module="pags")
        for name in [name for name in sys.modules if name.split(".")[0] == "pags"]:
            del sys.modules[name]
        sys.modules.update(known)
        bpy.ops.preferences.addon_enable(module=addon.__name__)

    def test_the_former_name(self):
        """An active copy under the add-on's former name is switched off and its settings are taken over."""
        if addon.__name__.startswith("bl_ext."):
            self.skipTest("an extension has kept its name")
        former = bpy.context.preferences.addons.new()
        former.module = "pags"
        settings = type(
            "PagsFormer",
            (bpy.types.AddonPreferences,),
            {"bl_idname": "pags", "__annotations__": {"budget": bpy.props.IntProperty()}},
        )
        bpy.utils.register_class(settings)
        former.preferences.budget = 123
        bpy.ops.preferences.addon_disable(module=addon.__name__)
        bpy.ops.preferences.addon_enable(module=addon.__name__)
        bpy.utils.unregister_class(settings)
        self.assertEqual([a.module for a in bpy.context.preferences.addons if "pags" in a.module], [addon.__name__])
        self.assertEqual(bpy.context.preferences.addons[addon.__name__].preferences.budget, 123)
        self.bring_in()


if __name__ == "__main__":
    main()
