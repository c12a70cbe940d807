# SPDX-License-Identifier: Apache-2.0
"""Tests the panel "Inspect" in Blender without a window: comparison with photographs and their list, LiDAR sweeps
and boxes, held-out steps, counts of Gaussians, distances, the ground, a wipe between two scenes, and a scene that is
written again."""

import os
import struct
import sys
import time
import types

import bpy
import numpy as np
from mathutils import Matrix

HERE = os.path.dirname(os.path.abspath(__file__))
sys.path[:0] = [HERE, os.path.join(HERE, "..", "cli")]
import fixtures  # noqa: E402
from blender_case import BlenderCase, addon, json, main, pixel  # noqa: E402
from drive_set import make_set, make_sweeps  # noqa: E402
from fixtures import splat  # noqa: E402
from test_drive import ORIGIN, make_drive  # noqa: E402

part = lambda name: sys.modules[f"{addon.__name__}.{name}"]
comparison, sweeps, measure, watch, gather = (
    part("comparison"),
    part("sweeps"),
    part("measure"),
    part("watch"),
    part("gather"),
)
inspector, jobs, lens, native, viewport = (
    part("inspector"),
    part("jobs"),
    part("lens"),
    part("native"),
    part("viewport"),
)


class InspectCase(BlenderCase):
    def record(self, change):
        """Changes scene.json with the function `change`."""
        record = json.loads(fixtures.read(self.path("scene", "scene.json")))
        change(record)
        self.write("scene/scene.json", json.dumps(record))

    def photographed(self):
        """Imports the scene. Its photographs are rendered without exposure; the front camera's exposure gains are 1,
        1.1 and 1.2."""
        make_set(self.path("scene"), self.path("set"))
        return self.bring_in()

    def entry(self):
        return native.load(self.path("scene"))

    def view(self, name):
        return next(v for v in self.entry().scene.views if v["name"] == name)


class Compare(InspectCase):
    def test_list_worst_first(self):
        """The list has the order and values of pags eval. A click on an entry selects its photograph."""
        self.photographed()
        bpy.ops.pags.rank()
        manager = bpy.context.scene
        found = [item for item in manager.pags_photographs if item.kind == "PHOTOGRAPH"]
        names = [item.name for item in found]
        self.assertEqual((len(names), names[:2]), (6, ["002_0.png", "001_0.png"]))
        values = [item.psnr for item in found]
        self.assertEqual(values, sorted(values))
        self.assertEqual([item.test for item in manager.pags_photographs][:2], [False, True])
        self.succeeds("eval", self.path("scene"), "--json", self.path("eval.json"))
        figures = json.loads(fixtures.read(self.path("eval.json")))
        self.assertAlmostEqual(values[1], figures["test"]["per_view"][0]["psnr"], places=3)
        self.scene.frame_set(1)
        manager.pags_photograph = 0
        self.assertEqual((self.scene.frame_current, self.scene.camera.data.pags.sensor), (3, 0))
        manager.pags_photograph = next(i for i, name in enumerate(names) if name == "001_1.png")
        self.assertEqual((self.scene.frame_current, self.scene.camera.data.pags.sensor), (2, 1))
        self.assertEqual(manager.pags_photographs_said, "")
        for camera in [o for o in self.scene.objects if o.type == "CAMERA"]:
            bpy.data.objects.remove(camera)
        manager.pags_photograph = 0
        self.assertIn("without its cameras", manager.pags_photographs_said)

    def test_list_of_cameras_objects_and_gaps(self):
        """A click on a camera or an object goes to its worst photograph; the object is selected. A file stores the
        list."""
        self.photographed()
        bpy.ops.pags.rank()
        rows = [(i, item) for i, item in enumerate(self.scene.pags_photographs)]
        cameras = [(i, item) for i, item in rows if item.kind == "CAMERA"]
        self.assertEqual([item.name for _, item in cameras], ["camera 0", "camera 1"])  # the side camera has no gains
        self.assertEqual(cameras[0][1].view, "002_0.png")
        at, car = next((i, item) for i, item in rows if item.kind == "OBJECT" and item.object == "c=2")
        self.scene.frame_set(1)
        self.scene.pags_photograph = at
        self.assertEqual(bpy.context.view_layer.objects.active, self.part(1))
        self.assertEqual(self.view(car.view)["time"], 100 + self.scene.frame_current - 1)
        self.assertEqual([item for _, item in rows if item.kind == "GAP"], [])
        self.record(lambda record: record["objects"][1]["knots"].pop(1))
        native.forget()
        (gap,) = comparison.gaps_of(self.entry())
        self.assertEqual((gap["object"], gap["view"], gap["psnr"]), ("c=2", "001_0.png", 2.0))
        bpy.ops.wm.save_as_mainfile(filepath=self.path("list.blend"))
        bpy.ops.wm.open_mainfile(filepath=self.path("list.blend"))
        self.assertEqual(len(self.scene.pags_photographs), len(rows))
        self.assertEqual(self.scene.pags_photographs[0].root, "scene")

    def test_figures_equal_those_of_eval(self):
        """PSNR agrees with pags eval within 0.01 dB and SSIM within 1e-4. The add-on sums in float, pags eval in
        double."""
        root = self.photographed()
        self.succeeds("eval", self.path("scene"), "--json", self.path("eval.json"))
        figures = json.loads(fixtures.read(self.path("eval.json")))
        for name, split in (("002_0.png", "train"), ("001_0.png", "test")):
            wanted = next(v for v in figures[split]["per_view"] if v["name"] == name)
            pair = jobs.at_once("pair", lambda job: comparison.make(job, root, self.entry(), self.view(name), 0)).notice
            self.assertAlmostEqual(pair.psnr, wanted["psnr"], delta=0.01)
            self.assertNotIn("SSIM", pair.line())
            jobs.at_once("ssim", lambda job: comparison.add_ssim(job, pair))
            self.assertAlmostEqual(float(pair.ssim.mean()), wanted["ssim"], delta=1e-4)
            self.assertLess(wanted["ssim"], 0.9999)
            self.assertEqual("(held out)" in pair.line(), split == "test")

    def test_ssim_equals_its_definition(self):
        """Compares SSIM with its definition at a pixel in the middle and at one near the border."""
        generator = np.random.default_rng(3)
        a, b = generator.random((2, 20, 24, 3), dtype=np.float32)
        got = comparison.ssim_map(a, b)
        weights = np.exp(-0.5 * (np.arange(-5, 6) / 1.5) ** 2)
        weights = np.outer(weights, weights) / weights.sum() ** 2
        for y, x in ((10, 12), (1, 22)):
            sums = np.zeros((5, 3))
            for v in range(-5, 6):
                for u in range(-5, 6):
                    if 0 <= y + v < 20 and 0 <= x + u < 24:
                        p, q = a[y + v, x + u].astype(float), b[y + v, x + u].astype(float)
                        sums += weights[v + 5, u + 5] * np.array([p, q, p * p, q * q, p * q])
            p, q, pp, qq, pq = sums
            above = (2 * p * q + 1e-4) * (2 * (pq - p * q) + 9e-4)
            below = (p * p + q * q + 1e-4) * (pp - p * p + qq - q * q + 9e-4)
            self.assertAlmostEqual(float(got[y, x]), float((above / below).mean()), places=4)

    def test_photograph_of_a_view(self):
        root = self.photographed()
        context = types.SimpleNamespace(scene=self.scene, region_data=types.SimpleNamespace(view_perspective="CAMERA"))
        for frame in (1, 2, 3):
            self.scene.frame_set(frame)
            self.assertEqual(comparison.current(context)[2]["name"], f"00{frame - 1}_0.png")
        self.scene.frame_set(9)
        self.assertIn("no photograph at this frame", comparison.current(context))
        context.region_data.view_perspective = "PERSP"
        self.assertIn("look through a camera", comparison.current(context))
        self.assertEqual(root.pags.kind, "ROOT")

    def test_progress_of_the_list(self):
        """Reads the progress that pags eval prints without a terminal."""
        if os.name == "nt":
            self.skipTest("there is no shell to say it")
        job = jobs.Job("list", lambda job: iter(()))
        part("program").run(job, "/bin/sh", "-c", "echo 'view 3 of 12'")
        self.assertEqual((job.fraction, job.what), (0.25, "view 3 of 12"))

    def test_without_photographs(self):
        self.bring_in()
        self.raises(["000_0.jpg", "Data set folder"], bpy.ops.pags.rank)
        self.assertEqual(len(bpy.context.scene.pags_photographs), 0)


class Recording(InspectCase):
    def lidar(self, **dataset):
        """Makes LiDAR sweeps: sweep t has t + 1 points, 5 m ahead of the car, which has moved t metres."""
        self.photographed()
        make_sweeps(self.path("set"), lambda t: [[5.0, 0.5 * k, 0.25, 9.0] for k in range(t + 1)], lambda t: (t, 0, 0))
        self.write("set/dataset.json", json.dumps({"kind": "kitti", **dataset}))

    def points(self):
        block = next(o for o in self.scene.objects if "pags_lidar" in o)
        bpy.context.view_layer.update()
        return [tuple(round(c, 3) for c in block.matrix_world @ v.co) for v in block.data.vertices]

    def test_sweeps_follow_the_timeline(self):
        self.lidar()
        self.scene.frame_set(2)
        bpy.ops.pags.lidar()
        self.assertEqual(self.points(), [(6, 0, 0.25), (6, 0.5, 0.25)])
        self.scene.frame_set(3)
        self.assertEqual(self.points(), [(7, 0, 0.25), (7, 0.5, 0.25), (7, 1, 0.25)])
        self.scene.frame_set(1)
        self.assertEqual(self.points(), [(5, 0, 0.25)])
        self.scene.frame_set(8)
        self.assertEqual(self.points(), [])
        bpy.ops.pags.lidar()  # a second call uses the same object
        self.assertEqual(len([o for o in self.scene.objects if "pags_lidar" in o]), 1)
        bpy.context.view_layer.objects.active.matrix_world = Matrix.Scale(2, 4)
        self.scene.frame_set(1)
        self.assertEqual(self.points(), [(10, 0, 0.5)])
        block = next(o for o in self.scene.objects if "pags_lidar" in o)
        self.assertTrue(block.hide_render)

    def test_colours_of_points(self):
        """Points are coloured by height, intensity or distance to the road of splats, blue low and yellow high."""
        rows = []
        for x in range(30):
            for y in range(-15, 16):
                flat = splat(25 + 0.1 * x, 0.1 * y, -1.6, (0.3, 0.3, 0.3), sigma=0.08, opacity=12.0)
                flat[12] = -5.0  # the third scale is a few millimetres
                rows.append(flat)
        make_drive(self.path("scene"), rows)
        self.photographed()
        points = [[26 + 0.1 * k, 0.3, -1.6 + (0.25 if k % 2 else 0.0), float(k)] for k in range(10)]
        make_sweeps(self.path("set"), lambda t: points, lambda t: (0, 0, 0))
        self.write("set/dataset.json", json.dumps({"kind": "kitti"}))
        bpy.ops.pags.lidar()
        block = next(o for o in self.scene.objects if "pags_lidar" in o)
        colors = lambda: sweeps._shown[block.data.name_full][1]
        self.assertGreater(colors()[1, 0], colors()[0, 0])  # by height: the odd points are higher
        self.scene.pags.lidar_color = "INTENSITY"
        self.assertTrue((np.diff(colors()[:, 1]) >= 0).all())
        self.assertGreater(colors()[9, 0], 0.9)
        root = block.parent
        found = sweeps.sweeps_of(root, self.entry())
        away = found.distances(found.read(0)[0], 100.0, 0)
        apart = np.abs(away - np.tile([0.0, 0.25], 5))
        self.assertLess(apart[:5].max(), 0.01)  # straight below
        self.assertLess(apart.max(), 0.15)  # at a slant a Gaussian's depth is nearer by its extent
        self.scene.pags.lidar_color = "DISTANCE"
        self.assertGreater(colors()[1, 1] - colors()[0, 1], 0.2)

    def test_columns_and_frames(self):
        self.lidar(lidar_columns=["y", "x", "z", "intensity"], lidar_frame="world")
        self.scene.frame_set(2)
        bpy.ops.pags.lidar()
        found = next(o for o in self.scene.objects if "pags_lidar" in o).data.vertices
        wanted = np.array([[0, 5, 0.25], [0.5, 5, 0.25]]) - ORIGIN
        self.assertLess(
            np.abs(np.array([v.co[:] for v in found]) - wanted).max(), 0.05
        )  # floats are coarse at half a million metres

    def test_unreadable_sweeps(self):
        self.bring_in()
        self.raises(["no folder lidar", "Data set folder"], bpy.ops.pags.lidar)
        bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
        self.lidar(kind="unheard-of")
        self.raises(["dataset.json", "unheard-of"], bpy.ops.pags.lidar)
        self.write("set/dataset.json", json.dumps({"kind": "waymo"}))
        self.raises(["000.bin", "16 bytes", "multiple of 56"], bpy.ops.pags.lidar)
        self.assertEqual([o for o in self.scene.objects if "pags_lidar" in o], [])

    def test_boxes_are_the_labels(self):
        self.bring_in()
        bpy.ops.pags.boxes()
        boxes = {o["pags_box"]: o for o in self.scene.objects if "pags_box" in o}
        self.assertEqual(sorted(boxes), ["c=2", "p,1"])
        self.track(1).location.z += 3  # moves the track; the label stays
        for frame, y in ((1, 4), (2, 0), (3, -4)):
            self.scene.frame_set(frame)
            matrix = boxes["c=2"].matrix_world
            self.assertLess((matrix.translation - Matrix.Translation((10, y, 0)).translation).length, 1e-3)
            self.assertLess(
                abs((matrix.to_3x3() @ boxes["c=2"].data.vertices[9].co).y + 2), 1e-3
            )  # the car's front, 2 m to the right
        self.assertEqual([round(d, 3) for d in boxes["p,1"].dimensions], [4, 2, 1.5])
        self.scene.frame_set(9)
        self.assertTrue(boxes["c=2"].hide_viewport)
        self.assertFalse(boxes["p,1"].hide_viewport)
        self.assertTrue(all(o.hide_render and o.display_type == "WIRE" for o in boxes.values()))
        bpy.ops.pags.boxes()
        self.assertEqual(len([o for o in self.scene.objects if "pags_box" in o]), 2)

    def test_held_out_steps(self):
        self.bring_in()
        self.scene.timeline_markers.new("mine", frame=7)
        bpy.ops.pags.mark_held_out()
        self.assertEqual(
            sorted((m.frame, m.name) for m in self.scene.timeline_markers), [(2, "held out: camera 0"), (7, "mine")]
        )
        bpy.ops.pags.mark_held_out()
        self.assertEqual([m.name for m in self.scene.timeline_markers], ["mine"])
        self.record(lambda record: [view.update(test=False) for view in record["cameras"]])
        bpy.ops.pags.reload()
        self.raises(["held out"], bpy.ops.pags.mark_held_out)


class Measuring(InspectCase):
    def test_points_of_the_world(self):
        """A pick finds the moving car 10 m ahead in perspective and orthographic views, also for a scaled scene."""
        root = self.bring_in()
        for scale in (1, 0.5):
            root.scale = [scale] * 3
            self.scene.frame_set(2)
            camera = self.scene.camera
            values, pose = lens.of_camera(camera.data, camera.matrix_world, 101, 101)
            found = inspector.pick(bpy.context, values, pose, 50, 50)
            self.assertLess(np.linalg.norm(found["place"] - np.array([10 * scale, 0, 0])), 0.02)
            self.assertAlmostEqual(found["depth"], 9 * scale, delta=0.02)
            camera.data.type, camera.data.ortho_scale = "ORTHO", 6 * scale
            bpy.context.view_layer.update()
            values, pose = lens.of_camera(camera.data, camera.matrix_world, 101, 101)
            found = inspector.pick(bpy.context, values, pose, 50, 50)
            self.assertLess(np.linalg.norm(found["place"] - np.array([10 * scale, 0, 0])), 0.05)
            self.assertAlmostEqual(found["depth"], 9 * scale, delta=0.05)
            camera.data.type = "PERSP"

    def test_ground(self):
        rows = []
        for x in range(40):
            for y in range(-10, 11):
                flat = splat(3 + 0.2 * x, 0.2 * y, -1.6, (0.1, 0.1, 0.5), sigma=0.15, opacity=12.0)
                flat[12] = -5.0  # the third scale is a few millimetres
                rows.append(flat)
        make_drive(self.path("scene"), rows)
        root = self.bring_in()
        self.assertAlmostEqual(measure.ground_below(bpy.context, np.array([6.0, 0.1, 4.0])), -1.6, delta=0.05)
        self.assertIsNone(measure.ground_below(bpy.context, np.array([6.0, 0.1, -4.0])))
        root.location.z, root.scale = 1, (2, 2, 2)
        bpy.context.view_layer.update()
        self.assertAlmostEqual(measure.ground_below(bpy.context, np.array([12.0, 0.2, 9.0])), 1 - 3.2, delta=0.1)


class Counts(InspectCase):
    def test_modes_are_the_module_s_planes(self):
        """F12 in these modes shows the logarithm of the counts in the colours of the priority's heat map."""
        rows = [splat(9 + 0.01 * i, 0, 0, (0.5, 0.5, 0.5), sigma=0.5, opacity=-3.0) for i in range(40)]
        make_drive(self.path("scene"), rows)
        self.bring_in()
        camera = {**self.view("000_0.jpg"), "time": 100.0}
        picture = native.module.render(self.entry().scene, camera, outputs=("count", "overdraw"))
        count, overdraw = np.asarray(picture.count), np.asarray(picture.overdraw)
        self.assertEqual(count.shape, (101, 101))
        self.assertTrue((count <= overdraw).all())
        self.assertGreaterEqual(count[50, 50], 40)
        self.assertEqual(count[100, 0], 0)
        self.assertIn("count", repr(picture))
        for mode, plane in (("count", count), ("overdraw", overdraw)):
            self.scene.pags.mode = mode
            got = self.f12(mode)
            shades = {}
            for y in range(101):
                for x in range(101):
                    shades.setdefault(float(plane[y, x]), []).append(pixel(got, x, y))
            self.assertGreater(len(shades), 3)
            common = {value: np.median(colours, axis=0) for value, colours in shades.items()}
            astray = sum((np.abs(np.array(shades[value]) - common[value]).max(axis=1) > 1).sum() for value in shades)
            self.assertLess(astray, 101, f"{mode}: one per cent, since Blender's camera is rounded to floats")
            brightness = [common[value].sum() for value in sorted(shades)]
            self.assertLess(brightness[0] + 50, brightness[-1])
        with self.assertRaises(ValueError):
            native.module.render(self.entry().scene, camera, mode="counts")


class TwoScenes(InspectCase):
    def test_both_sides_of_the_wipe(self):
        first = self.bring_in()
        make_drive(self.path("other"))
        second = self.bring_in("other")
        depsgraph = bpy.context.evaluated_depsgraph_get()
        self.assertEqual(viewport.wiped_scene(depsgraph), "")
        self.scene.pags.wipe_root = second
        depsgraph = bpy.context.evaluated_depsgraph_get()
        self.assertEqual(viewport.wiped_scene(depsgraph), second.name)
        names = lambda state: [scene.root_name for scene in state.scenes]
        self.assertEqual(names(gather.gather(depsgraph, without=second.name)), [first.name])
        self.assertEqual(names(gather.gather(depsgraph, only=second.name)), [second.name])
        self.assertEqual(len(names(gather.gather(depsgraph))), 2)
        bpy.data.objects.remove(second)
        self.assertEqual(viewport.wiped_scene(bpy.context.evaluated_depsgraph_get()), "")


class Watch(InspectCase):
    def read_anew(self):
        return jobs.at_once("scene", lambda job: watch.read_anew(job, self.path("scene")))

    def change(self, swap=True, without_car=False):
        """Changes the scene as further training does: the objects' order differs, the moving car is blue and its
        track is 1 m further ahead."""

        def change(record):
            for knot in record["objects"][1]["knots"]:
                knot["world_from_object"][3] += 1
            if swap:
                record["objects"].reverse()
            if without_car:
                record["objects"] = [o for o in record["objects"] if o["id"] != "c=2"]

        fixtures.write(
            self.path("scene", "objects", "car.ply"),
            fixtures.ply_bytes([splat(0, 0, 0, (0, 0, 1), sigma=0.1, opacity=12.0)]),
        )
        background = fixtures.read(self.path("scene", "background.ply"))
        if swap:  # the parked car is now object 1
            head, body = background.split(b"end_header\n", 1)
            body = body[:-4] + struct.pack("<i", 1)
            self.write("scene/background.ply", head + b"end_header\n" + body)
        self.record(change)

    def test_edits_stay(self):
        self.bring_in()
        self.scene.frame_set(2)
        self.assertGreater(pixel(self.f12(), 50, 50)[0], 240)
        parked = next(o for o in self.scene.objects if o.get("pags_id") == "p,1")
        parked.hide_render = True
        self.change()
        job = self.read_anew()
        self.assertIn("was reloaded", job.notice)
        self.assertEqual(parked.pags.index, 1)
        self.assertTrue(parked.hide_render)
        car = next(o for o in self.scene.objects if o.get("pags_id") == "c=2")
        self.assertEqual((car.pags.index, car.parent.pags.index), (0, 0))
        self.scene.frame_set(2)
        self.assertAlmostEqual(car.parent.matrix_world.translation.x, 11, delta=1e-3)  # the user hadn't moved its track
        picture = self.f12()
        self.assertGreater(pixel(picture, 50, 50)[2], 240)
        self.assertLess(pixel(picture, 34, 50)[1], 50)  # the parked car is still hidden

    def test_a_changed_track_stays(self):
        self.bring_in()
        track = self.track(1)
        curve = part("curves").fcurve_owner(track).find("location", index=2)
        curve.keyframe_points[1].co[1] += 2
        self.change(swap=False)
        self.read_anew()
        self.scene.frame_set(2)
        self.assertAlmostEqual(track.matrix_world.translation.x, 10, delta=1e-3)
        self.assertAlmostEqual(track.matrix_world.translation.z, 2, delta=1e-3)

    def test_removed_objects_are_reported(self):
        self.bring_in()
        self.change(swap=False, without_car=True)
        self.assertIn("objects removed from it: 1", self.read_anew().notice)
        self.scene.frame_set(2)
        self.assertLess(pixel(self.f12(), 50, 50)[2], 140)  # only the sky is visible

    def test_unreadable_files_change_nothing(self):
        self.bring_in()
        before = native.entry(self.path("scene"), True)
        self.write("scene/scene.json", "{")
        job = self.read_anew()
        self.assertIn("can't be read", job.notes[0])
        self.assertIs(native.entry(self.path("scene"), True), before)
        self.assertGreater(max(self.f12()[4]), 100)

    def test_files_are_read_only_after_writing_ends(self):
        self.bring_in()
        path, entry = self.path("scene"), self.entry()
        self.assertFalse(watch.due(path, entry))
        self.record(lambda record: record.update(fps=1.0))
        os.utime(self.path("scene", "scene.json"), (time.time() + 5, time.time() + 5))
        self.assertFalse(watch.due(path, entry))  # the change is seen for the first time
        os.utime(self.path("scene", "scene.json"), (time.time() + 9, time.time() + 9))
        self.assertFalse(watch.due(path, entry))  # the file was written again
        self.assertTrue(watch.due(path, entry))
        self.read_anew()
        self.assertFalse(watch.due(path, self.entry()))


main()
