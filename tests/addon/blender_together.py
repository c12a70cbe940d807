# SPDX-License-Identifier: Apache-2.0
"""The add-on in a Blender that has the Python module `pags`, too, where Debian's packages put it: before the add-ons on sys.path."""

import os
import sys
import zipfile
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
        self.assertFalse(
            hasattr(pags, "__file__") and addon.__name__.startswith("bl_ext.")
        )  # Blender would call it a violation of its policy

    def test_a_second_copy(self):
        """It is refused, and the copy that is on is named."""
        known = type("PAGS_OT_job", (), {"__module__": "bl_ext.other.pags.jobs"})
        types = SimpleNamespace(Operator=SimpleNamespace(bl_rna_get_subclass_py=lambda name: known))
        with (
            mock.patch.object(addon, "bpy", SimpleNamespace(types=types, context=bpy.context)),
            self.assertRaisesRegex(RuntimeError, r"bl_ext\.other\.pags"),
        ):
            addon.register()
        self.bring_in()

    def test_unpacked_into_a_folder(self):
        """Installed as an add-on, also under its former name, the whole zip works and is the Python API, too."""
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
        """A copy that is on under the name that the add-on had makes way, and leaves its settings."""
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
