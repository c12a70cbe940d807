# SPDX-License-Identifier: Apache-2.0
"""Tests the add-on in Blender without a window: imports of scenes and splat files."""

import math
import os
import sys
from unittest import mock

import bpy
from mathutils import Vector

HERE = os.path.dirname(os.path.abspath(__file__))
sys.path[:0] = [HERE, os.path.join(HERE, "..", "cli")]
import fixtures  # noqa: E402
from blender_case import BlenderCase, addon, json, main, pixel  # noqa: E402
from fixtures import ply_bytes, some_splats, splat  # noqa: E402
from test_drive import make_drive  # noqa: E402


def overlays():
    """Returns the overlays of the file's 3D views. In the background, Blender keeps the views from one file to the
    next."""
    return [a.spaces.active.overlay for s in bpy.data.screens for a in s.areas if a.type == "VIEW_3D"]


def show_floors():
    for overlay in overlays():
        overlay.show_floor = True


class Import(BlenderCase):
    def test_imported_objects(self):
        show_floors()
        root = self.bring_in()
        kinds = sorted(o.pags.kind for o in self.scene.objects)
        self.assertEqual(kinds, ["BACKGROUND", "CAMERA", "CAMERA", "EGO", "OBJECT", "OBJECT", "ROOT", "TRACK", "TRACK"])
        car = self.part(1)
        self.assertEqual(
            (car["pags_id"], car["pags_class"], car["pags_critical"], car["pags_gaussians"]), ("c=2", "Car", True, 1)
        )
        self.assertEqual(car.parent, self.track(1))
        self.assertEqual(self.track(1).parent, root)
        self.assertEqual(len(car.data.vertices), 1)
        self.assertEqual(sorted(c.name for c in bpy.data.collections), ["Car", "scene"])
        self.assertEqual(list(bpy.data.collections["scene"].children), [bpy.data.collections["Car"]])
        self.assertEqual({o.name for o in bpy.data.collections["Car"].objects}, {"Car c=2", "c=2", "Car p,1", "p,1"})
        self.assertLessEqual(max(o.empty_display_size for o in self.scene.objects if o.pags.kind == "TRACK"), 0.3)
        self.assertEqual(self.scene.render.engine, "PAGS")
        # an empty file takes the recording's frame rate
        self.assertEqual((self.scene.render.fps, self.scene.frame_end), (1, 3))
        self.assertEqual((self.scene.render.resolution_x, self.scene.render.resolution_y), (101, 101))
        self.assertEqual({o.show_floor for o in overlays()}, {False})
        for frame, y in ((1, 4), (2, 0), (3, -4)):
            self.scene.frame_set(frame)
            self.assertAlmostEqual(self.track(1).matrix_world.translation.y, y, places=4)
            self.assertAlmostEqual(self.scene.camera.matrix_world.translation.x, frame - 1, places=4)
        self.assertAlmostEqual(self.scene.camera.data.lens, 100 * 36 / 101, places=3)
        self.assertFalse(self.scene.camera.data.show_passepartout)

    def test_file_with_other_objects_keeps_its_frame_rate(self):
        bpy.ops.mesh.primitive_uv_sphere_add()
        show_floors()
        self.scene.render.fps = 24
        self.scene.frame_start = 10
        self.bring_in()
        self.assertEqual(self.scene.render.fps, 24)
        self.assertEqual({o.show_floor for o in overlays()}, {True})
        self.scene.frame_set(10 + 24)  # frame 34 is still one second after frame 10
        self.assertAlmostEqual(self.track(1).matrix_world.translation.y, 0, places=4)

    def test_splat_file(self):
        self.write("some.ply", ply_bytes(some_splats()))
        root = self.bring_in("some.ply")
        self.assertAlmostEqual(root.matrix_world.to_euler().x, -1.5707963, places=4)  # the file's -y axis points up
        self.assertEqual(len(self.part(-1).data.vertices), 40)

    def test_part_of_a_scene_imports_the_whole_scene(self):
        """A .ply that scene.json names imports the whole scene. Any other .ply next to it is a separate splat file."""
        for name in ("background.ply", os.path.join("objects", "car.ply")):
            root = self.bring_in(os.path.join("scene", name))
            self.assertEqual((os.path.normpath(root.pags.path), len(root.children)), (self.path("scene"), 4))
        part = self.bring_in(os.path.join("scene", "background.ply"), whole=False)
        self.assertTrue(part.pags.path.endswith("background.ply"))
        self.write(os.path.join("scene", "own.ply"), ply_bytes(some_splats()))
        self.assertTrue(self.bring_in(os.path.join("scene", "own.ply")).pags.path.endswith("own.ply"))
        self.write(os.path.join("other", "scene.json"), "[]")  # a scene.json of another program
        self.write(os.path.join("other", "own.ply"), ply_bytes(some_splats()))
        self.assertTrue(self.bring_in(os.path.join("other", "own.ply")).pags.path.endswith("own.ply"))

    def test_up_axis(self):
        """The chosen up axis points up in Blender, for all six axes: a ball far along it is high above the ground."""
        for k, axis in enumerate("XYZ"):
            for sign, name in ((1, axis), (-1, "-" + axis)):
                at = [0.1, 0.2, 0.3]
                at[k] = 5 * sign
                self.write("tall.ply", ply_bytes([splat(*at, (1, 1, 1)), *some_splats()]))
                root = self.bring_in("tall.ply", up=name)
                bpy.context.view_layer.update()
                self.assertAlmostEqual((root.matrix_world @ Vector(at)).z, 5, places=4)
                self.assertAlmostEqual(root.matrix_world.determinant(), 1, places=5)

    def test_new_camera_shows_a_whole_splat_file(self):
        """The new camera shows the whole splat file at any size, place and aspect ratio, despite a few strays. The
        file stays in view when moved."""
        for scale, place, size in ((1, (0, 0, 0), (96, 64)), (300, (5000, -80, 20), (64, 96))):
            bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
            rows = [
                [scale * r[k] + place[k] for k in range(3)] + r[3:10] + [v + math.log(scale) for v in r[10:13]] + r[13:]
                for r in some_splats()
            ]
            stray = [splat(9000 * scale, 0, 9000 * scale, (1, 1, 1), sigma=scale)]
            self.write("some.ply", ply_bytes(rows + stray))
            self.scene.render.resolution_x, self.scene.render.resolution_y = size
            root = self.bring_in("some.ply")
            self.assertEqual((self.scene.camera.pags.kind, self.scene.camera.pags.root), ("CAMERA", root))
            for moved in (False, True):
                if moved:
                    root.location, root.scale = (7 * scale, scale, 0), (2, 2, 2)
                picture = self.f12()
                lit = [(x, y) for y in range(size[1]) for x in range(size[0]) if max(pixel(picture, x, y)) > 40]
                for k in range(2):
                    low, high = min(p[k] for p in lit), max(p[k] for p in lit)
                    self.assertGreater(low, 1)
                    self.assertLess(high, size[k] - 2)
                self.assertGreater(
                    max(max(p[k] for p in lit) - min(p[k] for p in lit) for k in range(2)), 0.55 * min(size)
                )
        bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
        self.bring_in("some.ply", cameras="NONE")
        self.assertIsNone(self.scene.camera)

    def test_every_splat_format(self):
        """Every splat format that `pags export` writes has a preview and renders in all modes. Features that need a
        scene folder refuse it."""
        self.write("some.ply", ply_bytes(some_splats()))
        for kind in ("spz", "splat", "pagsz"):
            self.succeeds("export", self.path("some.ply"), self.path("some." + kind))
        for kind in ("ply", "spz", "splat", "pagsz"):
            bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
            bpy.ops.object.camera_add(location=(0.5, -4, 0), rotation=(1.5707963, 0, 0))
            self.scene.camera = bpy.context.object
            root = self.bring_in("some." + kind)
            mesh = self.part(-1).data
            self.assertEqual((root["pags_gaussians"], len(mesh.vertices)), (40, 40))
            for value, wanted in zip(sorted(v.co.x for v in mesh.vertices), sorted(r[0] for r in some_splats())):
                self.assertAlmostEqual(value, wanted, delta=2e-3)
            self.assertGreater(max(mesh.attributes["Col"].data[0].color[:3]), 0.5)
            self.scene.render.resolution_x, self.scene.render.resolution_y = 96, 64
            self.assert_close(self.f12(), self.program(scene="some." + kind))
            for mode in ("priority", "critical", "depth", "size"):
                self.scene.pags.mode = mode
                self.assertGreater(max(self.f12()[4]), 50, f"{kind} {mode}")
            self.raises(["this is a splat file"], bpy.ops.pags.save_edited, directory=self.path("edited"))

    def test_camera_of_the_start_up_file(self):
        """The start-up file's camera stays unchanged. It stays the scene's camera where the import makes no camera."""
        self.write("some.ply", ply_bytes(some_splats()))
        for kind in ("spz", "splat", "pagsz"):
            self.succeeds("export", self.path("some.ply"), self.path("some." + kind))
        record = json.loads(fixtures.read(self.path("scene", "scene.json")))
        make_drive(self.path("blind"))
        self.write(os.path.join("blind", "scene.json"), json.dumps({**record, "cameras": []}))
        for name in ("some.ply", "some.spz", "some.splat", "some.pagsz", "blind", "scene"):
            bpy.ops.wm.read_homefile(use_empty=False, use_factory_startup=True)
            camera = self.scene.camera
            self.assertEqual(camera.name, "Camera")
            before = [camera.matrix_world.copy(), camera.data.lens, camera.data.clip_start, camera.data.clip_end]
            size = self.scene.render.resolution_x, self.scene.render.resolution_y
            self.bring_in(name, **({"cameras": "NONE"} if name == "scene" else {}))
            self.assertEqual(self.scene.camera is camera, name == "scene", name)
            self.assertEqual(
                [camera.matrix_world, camera.data.lens, camera.data.clip_start, camera.data.clip_end], before
            )
            if name != "scene":
                self.assertEqual((self.scene.render.resolution_x, self.scene.render.resolution_y), size)
            self.scene.render.resolution_x, self.scene.render.resolution_y = 64, 48
            self.f12()
        for use_empty in (False, True):
            bpy.ops.wm.read_homefile(use_empty=use_empty, use_factory_startup=True)
            self.raises(["nowhere"], bpy.ops.import_scene.pags, filepath=self.path("nowhere"))
            self.assertEqual(self.scene.camera and self.scene.camera.name, None if use_empty else "Camera")
            self.bring_in("some.ply")
            self.assertEqual(self.scene.camera.name, "view of some.ply")
        bpy.ops.wm.read_homefile(use_empty=False, use_factory_startup=True)
        self.bring_in()  # recorded cameras replace the start-up file's camera, which is kept in the file
        self.assertEqual((self.scene.camera.pags.kind, "Camera" in bpy.data.objects), ("CAMERA", True))
        bpy.ops.wm.read_homefile(use_empty=False, use_factory_startup=True)
        bpy.ops.mesh.primitive_uv_sphere_add()
        self.bring_in()  # a file with other objects keeps its camera
        self.assertEqual(self.scene.camera.name, "Camera")

    def test_scene_json_as_the_chosen_file(self):
        bpy.ops.import_scene.pags(filepath=self.path("scene", "scene.json"))
        self.assertEqual(len([o for o in self.scene.objects if o.pags.kind == "ROOT"]), 1)

    def test_all_views(self):
        self.bring_in(cameras="ALL")
        self.assertEqual(len([o for o in self.scene.objects if o.type == "CAMERA"]), 8)

    def test_errors_are_reported_by_the_operator(self):
        self.raises(["nowhere"], bpy.ops.import_scene.pags, filepath=self.path("nowhere"))
        self.write("broken.ply", b"ply\nformat what\n")
        self.raises(["broken.ply"], bpy.ops.import_scene.pags, filepath=self.path("broken.ply"))
        with open(self.path("scene", "background.ply"), "r+b") as file:
            file.truncate(300)
        self.raises(["background.ply"], bpy.ops.import_scene.pags, filepath=self.path("scene"))
        self.raises(["choose"], bpy.ops.import_scene.pags)
        self.assertEqual(len(self.scene.objects), 0)

    def test_proxies_follow_their_tracks(self):
        """Places meshes at their objects, also after tracks are edited. They become passive rigid bodies."""
        self.needs_proxies()
        root = self.bring_in(proxies=True)
        proxies = [o for o in self.scene.objects if o.get("pags_proxy")]
        self.assertTrue(proxies)
        self.assertEqual({o.type for o in bpy.data.objects}, {"MESH", "EMPTY", "CAMERA"})
        by_parent = {o.parent: o for o in proxies}
        self.assertLessEqual({self.track(0), self.track(1)}, set(by_parent))
        self.assertLessEqual(set(by_parent), {self.track(0), self.track(1), root})
        car = by_parent[self.track(1)]
        self.assertEqual((car.hide_get(), car.hide_render, car.display_type), (False, True, "WIRE"))
        self.assertEqual(bpy.ops.pags.rigid_bodies(), {"FINISHED"})
        self.assertEqual({o.rigid_body.type for o in proxies}, {"PASSIVE"})
        self.assertTrue(car.rigid_body.kinematic)
        bpy.ops.pags.rigid_bodies()  # a second call changes nothing
        self.assertIsNotNone(self.scene.rigidbody_world)
        corners = [v.co for v in car.data.vertices]
        local = [car.matrix_local @ co for co in corners]
        for k, size in enumerate((4.0, 2.0, 1.5)):  # The mesh is the labelled box, since one Gaussian has no surface.
            self.assertAlmostEqual(max(c[k] for c in local), size / 2, delta=0.05)
            self.assertAlmostEqual(min(c[k] for c in local), -size / 2, delta=0.05)
        for frame, y in ((1, 4), (3, -4)):
            self.scene.frame_set(frame)
            middle = sum((car.matrix_world @ co for co in corners), corners[0] * 0) / len(corners)
            self.assertAlmostEqual(middle.y, y, delta=0.05)
        for mesh in (car.data, by_parent[root].data if root in by_parent else car.data):
            self.assertFalse(mesh.validate())  # the mesh needed no repair
            self.assertEqual(len(mesh.attributes["Col"].data), len(mesh.vertices))
        self.raises(["none.glb"], bpy.ops.pags.import_proxies, filepath=self.path("none.glb"))
        good = fixtures.read(self.path("proxies.glb"))
        for number, data in enumerate(
            (b"", b"glTF", b"x" * 100, good[:3000], good[:12] + b"\0" + good[13:], good[: len(good) // 2])
        ):
            self.write(f"bad{number}.glb", data)
            self.raises(
                [f"bad{number}.glb", "expected a .glb of proxies"],
                bpy.ops.pags.import_proxies,
                filepath=self.path(f"bad{number}.glb"),
            )
        before = len(self.scene.objects)
        bpy.data.objects.remove(self.part(1))
        bpy.data.objects.remove(self.track(1))
        bpy.ops.pags.import_proxies(filepath=self.path("proxies.glb"))
        self.assertEqual(len(self.scene.objects), before - 2 + len(proxies) - 1)  # a deleted object gets no mesh

    def test_scene_stays_where_proxies_fail(self):
        """If the program or the importer fails, the scene stays, with a warning and without proxies."""
        native, proxies = (sys.modules[f"{addon.__name__}.{name}"] for name in ("native", "proxies"))
        for error in (native.SceneError("pags export failed"), RuntimeError("Error: not a glTF file")):
            with mock.patch.object(proxies, "make", side_effect=error):
                root = self.bring_in(proxies=True)
            self.assertEqual(root.pags.kind, "ROOT")
            self.assertFalse([o for o in self.scene.objects if o.get("pags_proxy")])


if __name__ == "__main__":
    main()
