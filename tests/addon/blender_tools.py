# SPDX-License-Identifier: Apache-2.0
"""Tests the add-on in Blender without a window: retimed scenes, tools of Blender that can't change splats, and a hidden
background."""

import os
import struct
import sys

import bpy

HERE = os.path.dirname(os.path.abspath(__file__))
sys.path[:0] = [HERE, os.path.join(HERE, "..", "cli")]
import fixtures  # noqa: E402
from blender_case import BlenderCase, addon, main, pixel  # noqa: E402
from fixtures import ply_bytes, some_splats, splat  # noqa: E402
from test_drive import make_drive  # noqa: E402

guard, timing, curves = (sys.modules[f"{addon.__name__}.{name}"] for name in ("guard", "timing", "curves"))


class Tools(BlenderCase):
    def test_retimed_scene(self):
        """First frame and frame rate move cameras, tracks, visibility and markers together with the scene's time, which
        sets the changing colour of the car, too."""
        car, terms = self.path("scene", "objects", "car.ply"), [f"f_dc_t{k}_{c}" for k in range(1, 5) for c in range(3)]
        head, row = fixtures.read(car).split(b"end_header\n", 1)
        head += b"".join(f"property float {term}\n".encode() for term in terms) + b"end_header\n"
        fixtures.write(car, head + row + struct.pack("<12f", *[0.0, 1.5, 0.8] * 4))
        root = self.bring_in()
        root.pags.fps = 25.0
        bpy.ops.pags.mark_held_out()
        self.assertEqual([m.frame for m in self.scene.timeline_markers], [26])
        root.pags.fps = 10.0
        root.pags.frame_start += 100
        self.assertEqual([m.frame for m in self.scene.timeline_markers], [111])
        for frame, x in ((101, 0), (111, 1), (116, 1.5)):
            self.scene.frame_set(frame)
            self.assertAlmostEqual(self.scene.camera.matrix_world.translation.x, x, places=4)
            self.assert_close(self.f12(), self.program())
        self.assertGreater(pixel(self.f12(), 74, 50)[0], 200)  # the car is 2 m to the right, 8.5 m ahead

    def test_keyframes_stretched_by_hand(self):
        """If all keyframes are stretched in an editor, the scene's time follows. Those of one track are an edit."""
        root = self.bring_in()
        for block in root.children_recursive:
            for curve in curves.all_of(block):
                curves.set_frames(curve, 7 + 4 * curves.frames_of(curve))
            if curves.all_of(block):
                block.animation_data.action.update_tag()
        bpy.data.objects["ego"].update_tag()
        bpy.context.view_layer.update()
        self.assertAlmostEqual(root.pags.fps, 4, places=4)
        self.assertAlmostEqual(root.pags.frame_start, 11, places=3)
        self.scene.frame_set(13)
        self.assert_close(self.f12(), self.program())
        track = self.track(1)
        for curve in curves.all_of(track):
            curves.set_frames(curve, 2 * curves.frames_of(curve))
        track.animation_data.action.update_tag()
        bpy.context.view_layer.update()
        self.assertAlmostEqual(root.pags.fps, 4, places=4)

    def splats(self):
        self.write("some.ply", ply_bytes(some_splats()))
        bpy.ops.object.camera_add(location=(0.5, -4, 0), rotation=(1.5707963, 0, 0))
        self.scene.camera = bpy.context.object
        self.bring_in("some.ply")
        part = self.part(-1)
        part.location, part.rotation_euler, part.scale = (0.2, 0.1, 0.3), (0.1, 0.2, 0.3), (1.1, 1.1, 1.1)
        bpy.ops.object.select_all(action="DESELECT")
        part.select_set(True)
        bpy.context.view_layer.objects.active = part
        bpy.context.view_layer.update()
        return part

    def test_apply_and_set_origin(self):
        part = self.splats()
        before, first = self.f12(), part.data.vertices[0].co.copy()
        for apply in (
            lambda: bpy.ops.object.transform_apply(),
            lambda: bpy.ops.object.transform_apply(location=False, scale=False),
            lambda: bpy.ops.object.origin_set(type="ORIGIN_GEOMETRY"),
        ):
            self.assertEqual(apply(), {"FINISHED"})
            bpy.context.view_layer.update()
            self.assertLess((part.data.vertices[0].co - first).length, 1e-4)
            self.assertLessEqual(self.difference(before, self.f12()), 2)
            self.assertIn("nothing was applied", guard._waiting[-1][1])
            guard._waiting.clear()

    def test_edit_mode_modifiers_and_join(self):
        part = self.splats()
        part.modifiers.new("any", "SUBSURF")
        bpy.context.view_layer.update()
        self.assertEqual(len(part.modifiers), 0)
        bpy.ops.object.mode_set(mode="EDIT")
        bpy.context.view_layer.update()
        guard.tick()
        self.assertEqual(part.mode, "OBJECT")
        bpy.ops.mesh.primitive_cube_add(size=0.1)
        bpy.context.view_layer.update()
        part.select_set(True)
        bpy.ops.ed.undo_push(message="before")
        bpy.ops.object.join()
        bpy.ops.ed.undo_push(message="joined")
        bpy.context.view_layer.update()
        if len(bpy.context.window_manager.operators):  # Blender registers no operators of scripts without a window
            guard.tick()
            self.assertEqual(sum(o.pags.kind == "BACKGROUND" for o in self.scene.objects), 1)

    def test_stand_on_road(self):
        """Meshes, groups of them and splats stand on the road of splats, from above and from below it."""
        rows = []
        for x in range(30):
            for y in range(-10, 11):
                flat = splat(3 + 0.4 * x, 0.4 * y, -1.6, (0.3, 0.3, 0.3), sigma=0.3, opacity=12.0)
                flat[12] = -5.0  # the third scale is a few millimetres
                rows.append(flat)
        make_drive(self.path("scene"), rows)
        self.bring_in()
        self.scene.frame_set(2)
        for z in (3, -1.8):
            bpy.ops.mesh.primitive_cube_add(size=1, location=(8, -1, z))
            cube = bpy.context.object
            cube.rotation_euler.z = 0.5
            bpy.context.view_layer.update()
            self.assertEqual(bpy.ops.pags.stand_on_road(), {"FINISHED"})
            bpy.context.view_layer.update()
            self.assertAlmostEqual(cube.matrix_world.translation.z, -1.1, delta=0.05)
        car = self.part(1)
        bpy.ops.object.select_all(action="DESELECT")
        car.select_set(True)
        car.location.z += 2
        bpy.context.view_layer.update()
        self.assertEqual(bpy.ops.pags.stand_on_road(), {"FINISHED"})
        bpy.context.view_layer.update()
        self.assertAlmostEqual(car.matrix_world.translation.z, -1.6 + 0.75, delta=0.05)
        cube.location = (100, 100, 0)
        cube.select_set(True)
        car.select_set(False)
        bpy.context.view_layer.update()
        self.assertEqual(bpy.ops.pags.stand_on_road(), {"CANCELLED"})

    def test_hidden_background_has_no_sky(self):
        """The sky is black, or transparent, where the background isn't drawn; another scene's sky doesn't change."""
        root = self.bring_in()
        self.assertIn(pixel(self.f12(), 90, 90)[2], (127, 128))
        background = self.part(-1)
        background.hide_render = True
        picture = self.f12()
        self.assertEqual(pixel(picture, 90, 90), (0, 0, 0))
        self.assertGreater(pixel(picture, 35, 50)[1], 200)
        self.scene.pags.use_background, self.scene.pags.background = True, (0.2, 0.4, 0.8)
        self.assertEqual(pixel(self.f12(), 90, 90), (51, 102, 204))
        self.scene.pags.use_background = False
        twin = self.bring_in()
        twin.location.z = 50
        self.assertIn(pixel(self.f12(), 90, 90)[2], (127, 128))
        bpy.data.objects.remove(background)
        for block in (*twin.children_recursive, twin):
            bpy.data.objects.remove(block)
        self.assertEqual(pixel(self.f12(), 90, 90), (0, 0, 0))
        self.assertEqual(root.pags.kind, "ROOT")


if __name__ == "__main__":
    main()
