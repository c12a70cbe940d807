# SPDX-License-Identifier: Apache-2.0
"""Tests the panel "Clean up and look" in Blender without a window. F12, exported files and saved scenes agree. Also
tests crops, looks of parts and undo."""

import math
import os
import sys

import bpy
from mathutils import Vector

HERE = os.path.dirname(os.path.abspath(__file__))
sys.path[:0] = [HERE, os.path.join(HERE, "..", "cli")]
from blender_case import BlenderCase, addon, json, main  # noqa: E402
from fixtures import read  # noqa: E402

part = lambda name: sys.modules[f"{addon.__name__}.{name}"]
cleanup, gather = part("cleanup"), part("gather")


def psnr(a, b):
    error = sum((x - y) ** 2 for x, y in zip(a[4], b[4])) / len(a[4])
    return 99.0 if error == 0 else 10 * math.log10(255**2 / error)


class CleanUp(BlenderCase):
    def seen(self, picture):
        """Returns whether the picture has bright red (the driving car), green (the parked car) and white (the wall)."""
        pixels = list(zip(*[iter(picture[4])] * 3))
        red = any(r > 150 and g < 100 and b < 100 for r, g, b in pixels)
        green = any(g > 150 and r < 100 and b < 100 for r, g, b in pixels)
        return red, green, any(min(p) > 150 for p in pixels)

    def rules(self, root):
        return cleanup.edits_of(root, bpy.context.evaluated_depsgraph_get())

    def crop(self, owner, at, shape="SPHERE", mode="REMOVE", size=1.0):
        bpy.context.view_layer.objects.active = owner
        self.assertEqual(bpy.ops.pags.add_crop(shape=shape, mode=mode), {"FINISHED"})
        volume = owner.pags_look.crops[-1].volume
        volume.location, volume.scale = at, (size,) * 3
        bpy.context.view_layer.update()
        return volume

    def test_all_outputs_agree(self):
        """F12, `pags render --edits`, the saved scene and the exported file agree with a PSNR of at least 45 dB."""
        root = self.bring_in()
        before = self.f12()
        look = root.pags_look
        look.exposure, look.tint, look.saturation, look.contrast = 0.5, (1.0, 0.8, 0.6), 0.7, 1.2
        look.sh = 0.5
        self.part(1).pags_look.opacity = 0.3
        self.part(-1).pags_look.exposure = -1
        picture = self.f12()
        self.assertGreater(self.difference(before, picture), 30)
        self.write("rules.json", self.rules(root))
        self.assert_close(picture, self.program("--edits", self.path("rules.json")))
        bpy.ops.pags.save_edited(directory=self.path("edited"))
        saved = self.program(scene="edited")
        print(f"saved scene: {psnr(picture, saved):.1f} dB")
        self.assertGreater(psnr(picture, saved), 45)
        for name in os.listdir(self.path("edited")):
            self.assertFalse(os.path.islink(self.path("edited", name)))  # a link would point into a temporary folder
        for name in ("a.ply", "a.pagsz"):
            bpy.ops.export_scene.pags(filepath=self.path(name))
            self.succeeds("export", self.path("scene"), self.path("wanted" + name), "--edits", self.path("rules.json"))
            self.assertEqual(read(self.path(name)), read(self.path("wanted" + name)), name)
        bpy.ops.export_scene.pags(filepath=self.path("plain.ply"), edits=False)
        self.succeeds("export", self.path("scene"), self.path("wanted.ply"))
        self.assertEqual(read(self.path("plain.ply")), read(self.path("wanted.ply")))
        bpy.context.view_layer.objects.active = root
        for owner in (root, self.part(1), self.part(-1)):
            bpy.context.view_layer.objects.active = owner
            bpy.ops.pags.reset_look()
        self.assertEqual(self.rules(root), "")
        self.assertEqual(self.difference(before, self.f12()), 0)

    def test_sky(self):
        """The colour of the sky, (0, 0, 0.5), changes by the panel's formula."""
        root = self.bring_in()
        root.pags_look.exposure = 1
        self.assertAlmostEqual(self.f12()[4][2], 255 * 0.5 * 2 ** (1 / 2.2), delta=1)
        root.pags_look.exposure = 0
        root.pags_look.saturation = 0
        self.assertAlmostEqual(self.f12()[4][0], 255 * 0.5 * 0.0722, delta=1)

    def test_crops(self):
        """Crop volumes are in Blender's world, also where the scene and the object are turned, moved and scaled."""
        root = self.bring_in()
        self.assertEqual(self.seen(self.f12()), (True, True, True))
        root.location, root.rotation_euler, root.scale = (3, -2, 1), (0.1, 0.2, 0.5), (2, 2, 2)
        bpy.context.view_layer.update()
        volume = self.crop(root, root.matrix_world @ Vector((10, 0, 3)), size=2)  # the volume removes the wall
        self.assertEqual(self.seen(self.f12()), (True, True, False))
        volume.location.z += 50
        self.assertEqual(self.seen(self.f12()), (True, True, True))
        volume.location.z -= 50
        root.pags_look.crops[0].mode = "KEEP"  # objects that follow a track have separate crops
        self.assertEqual(self.seen(self.f12()), (True, False, True))
        volume.empty_display_type = "PLAIN_AXES"  # this empty isn't a volume
        self.assertEqual(self.rules(root), "")
        bpy.context.view_layer.objects.active = root
        bpy.ops.pags.remove_crop(number=0)
        self.assertEqual(len(root.pags_look.crops), 0)
        self.assertEqual(self.seen(self.f12()), (True, True, True))
        car = self.part(1)
        bpy.context.view_layer.update()
        self.crop(car, car.matrix_world.translation, shape="CUBE")
        self.assertEqual(self.seen(self.f12()), (False, True, True))

    def test_limits(self):
        root = self.bring_in()
        self.part(0).pags_look.least_size = 1
        self.assertEqual(self.seen(self.f12()), (True, False, True))
        self.part(0).pags_look.least_size = 0
        root.pags_look.least_views = 100
        self.assertEqual(self.seen(self.f12()), (True, False, False))  # objects that follow a track ignore this limit
        root.pags_look.least_views = 0
        root.pags_look.least_opacity = 1
        empty = self.f12()  # without the background there is no sky, and a note names the scene
        self.assertEqual({*empty[4]}, {0})
        state = gather.gather(bpy.context.evaluated_depsgraph_get())
        self.assertIn(f"hide all of {root.name}", state.load(True).remarks(self.scene.pags))
        with self.assertRaises(RuntimeError) as caught:  # an empty file isn't written
            bpy.ops.export_scene.pags(filepath=self.path("empty.ply"))
        self.assertIn("none of the", str(caught.exception))
        root.pags_look.least_opacity = 0
        self.assertEqual(
            self.seen(self.f12()), (True, False, False) if root.pags_look.least_views else (True, True, True)
        )

    def test_two_objects_of_one_part(self):
        """If two objects show the same part, F12 and exports use the settings of the first one (by name) with
        changes. The other object's panel says this."""
        root, car = self.bring_in(), self.part(1)
        twin = car.copy()
        twin.name = car.name + " twin"
        twin.location.y += 1.5
        car.users_collection[0].objects.link(twin)
        bpy.context.view_layer.update()
        plain = self.f12()
        self.assertIsNone(cleanup.preferred(twin))
        for owner, exposure in ((twin, -2.0), (car, -1.0)):
            owner.pags_look.exposure = exposure
            bpy.context.view_layer.update()
            (rule,) = json.loads(self.rules(root))
            self.assertAlmostEqual(rule["matrix"][0], 2 ** (exposure / 2.2), places=5)
            self.assertEqual(gather.gather(bpy.context.evaluated_depsgraph_get()).scenes[0].edits, self.rules(root))
        self.assertGreater(self.difference(plain, self.f12()), 30)
        self.assertEqual((cleanup.preferred(twin), cleanup.preferred(car)), (car, None))

    def test_views_never_wait_for_a_change(self):
        """While a changed scene is prepared, a view shows the previous state. At the end, the newest state appears
        without those between."""
        root = self.bring_in()
        state = lambda: gather.gather(bpy.context.evaluated_depsgraph_get())
        plain = state().load(True).entry
        for value in (0.5, 1.0, 1.5):
            root.pags_look.exposure = value
            bpy.context.view_layer.update()
            shown = state().load(False)
            self.assertIsNotNone(shown)
        visible = state()
        newest = visible.load(True).entry
        self.assertIsNot(newest, plain)
        self.assertEqual(newest.edits, self.rules(root))
        self.assertFalse(visible.making())
        self.assertIs(visible.load(False).entry, newest)
        root.pags_look.exposure = 0
        bpy.context.view_layer.update()
        self.assertIs(state().load(False).entry, plain)


if __name__ == "__main__":
    main()
