# SPDX-License-Identifier: Apache-2.0
"""Tests the add-on in Blender without a window: the interface."""

import fnmatch
import os
import sys

import bpy

sys.path.insert(0, os.path.dirname(os.path.abspath(__file__)))
from blender_case import BlenderCase, addon, main  # noqa: E402


class Interface(BlenderCase):
    def test_everything_has_a_tooltip(self):
        """All operators and properties have tooltips."""
        silent = []
        for part in addon.PARTS:
            for cls in addon.registry.classes_of(part):
                if issubclass(cls, bpy.types.Operator) and not cls.__doc__:
                    silent.append(cls.__name__)
                for name, kind in cls.__dict__.get("__annotations__", {}).items():
                    keywords = getattr(kind, "keywords", {})
                    if not keywords.get("description") and "HIDDEN" not in keywords.get("options", ()):
                        silent.append(f"{cls.__name__}.{name}")
        self.assertEqual(silent, [])

    def test_file_filters_show_supported_formats(self):
        """File filters accept all readable or writable formats. Blender matches each pattern with the whole path and
        ignores case."""
        splats = [f"/home/me/a.{kind}" for kind in ("ply", "compressed.ply", "spz", "splat", "pagsz", "PLY")]
        importer = bpy.ops.import_scene.pags  # bpy.ops returns a new object each time; keep this one as the key
        shown = {
            importer: ["/home/me/street/scene.json", *splats],
            bpy.ops.export_scene.pags: [*splats, *(f"/home/me/a.{kind}" for kind in ("glb", "gltf", "usda"))],
            bpy.ops.import_scene.pags_path: ["/home/me/path.json"],
            bpy.ops.export_scene.pags_path: ["/home/me/path.json"],
        }
        for operator, paths in shown.items():
            patterns = operator.get_rna_type().properties["filter_glob"].default.split(";")
            for path in paths:
                self.assertTrue(
                    any(fnmatch.fnmatchcase(path.lower(), p) for p in patterns), f"{operator.idname()}: {path}"
                )
            self.assertFalse(
                any(fnmatch.fnmatchcase("/home/me/street/sky.npy", p) for p in patterns), operator.idname()
            )
        if hasattr(bpy.types, "FileHandler"):
            handled = bpy.types.PAGS_FH_import.bl_file_extensions.split(";")
            self.assertEqual({os.path.splitext(p.lower())[1] for p in shown[importer]}, set(handled))

    def test_presets(self):
        """A preset is saved, loaded and removed."""
        settings = self.scene.pags
        settings.sh_degree, settings.early_z, settings.deadline = 1, "lossless", 120
        bpy.ops.pags.add_preset(name="fast")
        folder = bpy.utils.preset_paths("pags/render")
        path = os.path.join(folder[0], "fast.py")
        self.assertTrue(os.path.exists(path))
        settings.sh_degree, settings.early_z, settings.deadline = 3, "off", 70
        bpy.ops.script.execute_preset(filepath=path, menu_idname="PAGS_MT_presets")
        self.assertEqual((settings.sh_degree, settings.early_z, settings.deadline), (1, "lossless", 120))
        bpy.ops.pags.add_preset(name="fast", remove_name=True)
        self.assertFalse(os.path.exists(path))


if __name__ == "__main__":
    main()
