# SPDX-License-Identifier: Apache-2.0
"""Tests the add-on in Blender without a window: exports."""

import os
import sys

import bpy

HERE = os.path.dirname(os.path.abspath(__file__))
sys.path[:0] = [HERE, os.path.join(HERE, "..", "cli")]
import fixtures  # noqa: E402
from blender_case import BlenderCase, json, main  # noqa: E402
from fixtures import ply_bytes, some_splats, splat  # noqa: E402
from test_drive import make_drive  # noqa: E402


class Export(BlenderCase):
    def test_gaussians_with_edits(self):
        """Edits change the exported file but not the number of its Gaussians."""
        self.bring_in()
        self.part(1).location.x += 0.7
        bpy.ops.export_scene.pags(filepath=self.path("edited.ply"))
        bpy.ops.export_scene.pags(filepath=self.path("plain.ply"), edits=False)
        info = [
            json.loads(self.succeeds("info", self.path(n), "--json", "-").stdout) for n in ("edited.ply", "plain.ply")
        ]
        self.assertEqual([i["gaussians"] for i in info], [3, 3])
        self.assertNotEqual(fixtures.read(self.path("edited.ply")), fixtures.read(self.path("plain.ply")))
        self.starts_with("edited.pagsz", b"PAGSPK01")

    def starts_with(self, name, start, **keywords):
        bpy.ops.export_scene.pags(filepath=self.path(name), **keywords)
        self.assertEqual(fixtures.read(self.path(name))[: len(start)], start)

    def test_proxies(self):
        self.needs_proxies()
        self.bring_in()
        self.starts_with("boxes.glb", b"glTF", content="box")
        self.starts_with("edited.usda", b"#usda")

    def test_errors(self):
        self.bring_in()
        self.raises(["boxes.xyz"], bpy.ops.export_scene.pags, filepath=self.path("boxes.xyz"))

    def test_splat_file(self):
        """A splat file without edits is exported unchanged."""
        self.write("some.ply", ply_bytes(some_splats()))
        self.bring_in("some.ply")
        self.starts_with("some.pagsz", b"PAGSPK01")
        bpy.ops.export_scene.pags(filepath=self.path("again.ply"))
        self.assertEqual(
            json.loads(self.succeeds("info", self.path("again.ply"), "--json", "-").stdout)["gaussians"], 40
        )

    def test_the_background_with_parked_objects(self):
        """Parked objects are left out of the background or moved with it, by the engine; the other rows stay."""
        make_drive(self.path("scene"), [splat(20 + 0.1 * i, 3, 0, (0, 0, 1), opacity=12.0) for i in range(50)])
        self.bring_in()
        self.track(0).location.x -= 0.5
        bpy.ops.pags.save_edited(directory=self.path("moved"))
        bpy.data.objects.remove(self.part(0))
        bpy.ops.pags.save_edited(directory=self.path("fewer"))
        counts = [
            json.loads(fixtures.read(self.path(n, "scene.json")))["models"][0]["gaussians"] for n in ("moved", "fewer")
        ]
        self.assertEqual(counts, [52, 51])
        self.succeeds("info", self.path("moved"))
        self.succeeds("info", self.path("fewer"))


if __name__ == "__main__":
    main()
