# SPDX-License-Identifier: Apache-2.0
"""Tests the add-on in Blender without a window: files saved and opened again, and missing scenes."""

import os
import sys

import bpy

HERE = os.path.dirname(os.path.abspath(__file__))
sys.path[:0] = [HERE, os.path.join(HERE, "..", "cli")]
import fixtures  # noqa: E402
from blender_case import BlenderCase, json, main  # noqa: E402
from test_drive import make_drive  # noqa: E402


class Files(BlenderCase):
    def test_saved_and_opened_again(self):
        self.bring_in()
        self.part(1).location.x += 1
        before = self.f12()
        bpy.ops.wm.save_as_mainfile(filepath=self.path("work.blend"))
        bpy.ops.wm.save_mainfile()
        bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
        bpy.ops.wm.open_mainfile(filepath=self.path("work.blend"))
        root = next(o for o in self.scene.objects if o.pags.kind == "ROOT")
        self.assertEqual(root.pags.path, "//scene")
        self.assertEqual(self.f12("again")[4], before[4])

    def test_saved_elsewhere(self):
        """Relative paths are adapted to the saved .blend, also in the open file. Saving a copy doesn't change the
        open file."""
        paths = lambda root: tuple(path.replace(os.sep, "/") for path in (root.pags.path, root.pags.dataset))  # noqa: E731
        root = self.bring_in()
        os.makedirs(self.path("deep", "er"))
        bpy.ops.wm.save_as_mainfile(filepath=self.path("work.blend"))
        root.pags.dataset = "//data"
        bpy.ops.wm.save_as_mainfile(filepath=self.path("deep", "er", "copy.blend"), copy=True)
        self.assertEqual(paths(root), ("//scene", "//data"))
        bpy.ops.wm.save_as_mainfile(filepath=self.path("deep", "work.blend"))
        self.assertEqual(paths(root), ("//../scene", "//../data"))
        if bpy.app.version < (4, 2, 0):  # Blender before 4.2 doesn't announce the new path before saving.
            bpy.ops.wm.save_mainfile()
        for place, wanted in ((("deep", "work.blend"), "//../scene"), (("deep", "er", "copy.blend"), "//../../scene")):
            bpy.ops.wm.open_mainfile(filepath=self.path(*place))
            root = next(o for o in self.scene.objects if o.pags.kind == "ROOT")
            if "er" not in place or bpy.app.version >= (4, 2, 0):
                self.assertEqual(paths(root)[0], wanted)
            self.assertGreater(max(self.f12()[4]), 100)

    def test_missing_scene_is_reported(self):
        self.bring_in()
        bpy.ops.wm.save_as_mainfile(filepath=self.path("work.blend"))
        os.rename(self.path("scene"), self.path("elsewhere"))
        bpy.ops.wm.open_mainfile(filepath=self.path("work.blend"))
        self.raises([self.path("scene")], bpy.ops.render.render)
        os.rename(self.path("elsewhere"), self.path("scene"))
        self.assertGreater(max(self.f12()[4]), 100)

    def test_a_scene_of_a_newer_version_is_refused(self):
        record = json.loads(fixtures.read(self.path("scene", "scene.json")))
        self.write("scene/scene.json", json.dumps({**record, "version": 7}))
        self.raises(["scene.json", "version is 7", "up to 2"], bpy.ops.import_scene.pags, filepath=self.path("scene"))
        self.assertEqual(len(self.scene.objects), 0)

    def test_characters_beyond_ascii(self):
        """Characters beyond ASCII work in paths, in scene.json and in the program's messages."""
        folder, name = "日本語 Ümläüte", "車=2"
        make_drive(self.path(folder))
        record = json.loads(fixtures.read(self.path(folder, "scene.json")))
        record["objects"][1]["id"] = name
        self.write(os.path.join(folder, "scene.json"), json.dumps(record, ensure_ascii=False).encode())
        self.bring_in(folder)
        self.assertEqual(self.part(1)["pags_id"], name)
        self.part(1).location.x += 0.7
        bpy.ops.pags.save_edited(directory=self.path(folder, "Änderung"))
        saved = os.path.join(folder, "Änderung")
        self.assertEqual(json.loads(fixtures.read(self.path(saved, "scene.json")))["objects"][1]["id"], name)
        self.assert_close(self.f12("Blick ü"), self.program(scene=saved))
        bpy.ops.export_scene.pags_path(filepath=self.path(folder, "Weg ü.json"))
        bpy.ops.import_scene.pags_path(filepath=self.path(folder, "Weg ü.json"))
        self.raises([folder], bpy.ops.export_scene.pags, filepath=self.path(folder, "none", "x.ply"))
        bpy.ops.export_scene.pags(filepath=self.path(folder, "Ausgabe ü.ply"))
        self.assertTrue(os.path.exists(self.path(folder, "Ausgabe ü.ply")))

    def test_undo(self):
        self.bring_in()
        bpy.ops.ed.undo_push(message="imported")
        before = self.f12()
        self.part(1).location.x += 1
        bpy.ops.ed.undo_push(message="moved")
        moved = self.f12()
        bpy.ops.ed.undo()
        self.assertEqual(self.f12()[4], before[4])
        bpy.ops.ed.redo()
        self.assertEqual(self.f12()[4], moved[4])


if __name__ == "__main__":
    main()
