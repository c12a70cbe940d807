# SPDX-License-Identifier: Apache-2.0
"""Tests the effect of Blender's settings in Blender without a window: depth of field, motion blur, view layers,
clipping, paths, linking."""

import contextlib
import math
import os
import random
import sys
import time
from unittest import mock

import bpy
import numpy as np

HERE = os.path.dirname(os.path.abspath(__file__))
sys.path[:0] = [HERE, os.path.join(HERE, "..", "cli")]
from blender_case import BlenderCase, addon, main, pixel  # noqa: E402
from fixtures import ply_bytes, read_png, splat  # noqa: E402
from test_drive import make_drive  # noqa: E402

blur, engine, lens, native = (sys.modules[f"{addon.__name__}.{name}"] for name in ("blur", "engine", "lens", "native"))
SIZE = 101  # width and height of the drive's picture, in pixels
FOCAL = 100.0  # focal length in pixels
APERTURE = 0.12  # radius of the aperture of the drive's camera, in metres


def decoded(display):
    """Converts display-referred sRGB into linear light."""
    return np.where(display <= 0.04045, display / 12.92, ((display + 0.055) / 1.055) ** 2.4)


def encoded(linear):
    return np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * np.maximum(linear, 0) ** (1 / 2.4) - 0.055)


def psnr(a, b):
    return -10 * math.log10(max(float(np.mean((a - b) ** 2)), 1e-12))


def spread(values):
    """Returns centre and variance of the light in a plane: (x, y, variance of x, variance of y)."""
    rows, columns = np.mgrid[: values.shape[0], : values.shape[1]]
    total = values.sum()
    x, y = (values * columns).sum() / total, (values * rows).sum() / total
    return x, y, (values * (columns - x) ** 2).sum() / total, (values * (rows - y) ** 2).sum() / total


def confetti(count=500):
    """Returns rows of Gaussians of all colours around the drive's path, 3 to 30 m ahead."""
    dice = random.Random(11)
    rows = []
    for _ in range(count):
        ahead = 3 * 10 ** dice.random()
        colour = [dice.random() for _ in range(3)]
        rows.append(
            splat(
                ahead,
                dice.uniform(-0.6, 0.6) * ahead,
                dice.uniform(-0.6, 0.6) * ahead,
                colour,
                sigma=0.035 * ahead,
                opacity=dice.uniform(0, 4),
            )
        )
    return rows


class ObeyCase(BlenderCase):
    @contextlib.contextmanager
    def reports(self):
        """Collects the texts that F12 reports in this context."""
        said = []
        with mock.patch.object(engine.PagsRenderEngine, "warn", lambda self, text: said.append(text)):
            yield said

    @contextlib.contextmanager
    def jobs(self):
        """Collects the cameras of the pictures drawn in this context."""
        seen, real = [], native.renderer

        def renderer(kind, threads):
            made = real(kind, threads)

            def submit(scene, view, **arguments):
                seen.append(view)
                return made.submit(scene, view, **arguments)

            return mock.Mock(submit=submit)

        with mock.patch.object(native, "renderer", renderer):
            yield seen

    def display(self, name="f12"):
        """Renders F12 in 16 bits; returns display-referred samples from 0 to 1, with the top row first."""
        image = self.scene.render.image_settings
        image.file_format, image.color_depth = "PNG", "16"
        width, height, channels, _, samples = self.f12(name)
        return np.frombuffer(samples, dtype=">u2").reshape(height, width, channels) / 65535

    def linear(self, name="f12"):
        return decoded(self.display(name))


class Blur(ObeyCase):
    def ball(self, ahead=10.0, more=()):
        """Makes a white ball of Gaussians on black, `ahead` metres from a camera at the origin that looks along x."""
        self.write("ball.ply", ply_bytes([splat(ahead, 0, 0, (1, 1, 1), sigma=0.02 * ahead, opacity=12.0), *more]))
        bpy.ops.object.camera_add(rotation=(math.pi / 2, 0, -math.pi / 2))
        self.scene.camera = camera = bpy.context.object
        camera.name = "mine"
        root = self.bring_in("ball.ply", up="Z")
        self.scene.render.resolution_x = self.scene.render.resolution_y = SIZE
        camera.data.sensor_width, camera.data.lens = 36.0, 36.0 * FOCAL / SIZE
        return root, camera

    def focus(self, camera, distance, radius):
        dof = camera.data.dof
        dof.use_dof, dof.focus_distance = True, distance
        dof.aperture_fstop = (1e-3 * camera.data.lens if camera.data.type == "PERSP" else 1.0) / (2 * radius)

    def test_circle_of_confusion(self):
        """The ball's blur is a disk of the thin lens's size: its variance grows by a quarter of the squared radius.
        In focus, there is no blur."""
        _, camera = self.ball()
        sharp = spread(self.linear()[:, :, 0])
        self.scene.pags.blur_samples = 64
        for focus in (4.0, 10.0, 25.0):
            self.focus(camera, focus, 0.4)
            got = spread(self.linear()[:, :, 0])
            radius = FOCAL * 0.4 * abs(1 / focus - 1 / 10)
            for k in (2, 3):
                self.assertAlmostEqual(got[k] - sharp[k], radius**2 / 4, delta=0.05 * radius**2 / 4 + 0.02)
            for k in (0, 1):
                self.assertAlmostEqual(got[k], sharp[k], delta=0.3)

    def test_orthographic(self):
        _, camera = self.ball()
        camera.data.type, camera.data.ortho_scale = "ORTHO", 10.1  # the picture has 10 pixels per metre
        sharp = spread(self.linear()[:, :, 0])
        self.scene.pags.blur_samples = 64
        for focus in (5.0, 10.0):
            self.focus(camera, focus, 0.8)
            got = spread(self.linear()[:, :, 0])
            radius = 10 * 0.8 * abs(10 / focus - 1)
            self.assertAlmostEqual(got[2] - sharp[2], radius**2 / 4, delta=0.05 * radius**2 / 4 + 0.03)

    def test_shape_and_side_of_the_aperture(self):
        """A stretched aperture blurs less across. A triangular aperture appears upside down on one side of the focus
        and upright on the other."""
        _, camera = self.ball()
        sharp = spread(self.linear()[:, :, 0])
        self.scene.pags.blur_samples = 64
        self.focus(camera, 4.0, 0.4)
        camera.data.dof.aperture_ratio = 2.0
        got = spread(self.linear()[:, :, 0])
        self.assertAlmostEqual((got[3] - sharp[3]) / (got[2] - sharp[2]), 4.0, delta=0.4)
        camera.data.dof.aperture_ratio, camera.data.dof.aperture_blades = 1.0, 3
        for focus, side in ((4.0, 1), (1000.0, -1)):
            self.focus(camera, focus, 0.4)
            light = self.linear()[:, :, 0]
            x = spread(light)[0]
            # positive: the tail is on the right
            third = float((light * (np.arange(SIZE) - x) ** 3).sum() / light.sum())
            self.assertGreater(side * third, 1.0)
        camera.data.dof.aperture_rotation = math.pi / 2  # the corner points up
        self.focus(camera, 4.0, 0.4)
        light = self.linear()[:, :, 0]
        rows = np.arange(SIZE)[:, None]
        self.assertLess(float((light * (rows - spread(light)[1]) ** 3).sum() / light.sum()), -1.0)

    def test_apertures(self):
        """Random points of polygonal and round apertures lie inside them and are uniformly distributed."""
        dof = bpy.data.cameras.new("any").dof
        for blades in (0, 3, 5, 6):
            dof.aperture_blades, dof.aperture_rotation = blades, 0.3
            points = np.array(
                [blur.aperture_point(dof, blur.radical_inverse(k, 2), blur.radical_inverse(k, 3)) for k in range(2048)]
            )
            self.assertLessEqual(np.hypot(*points.T).max(), 1 + 1e-9)
            np.testing.assert_allclose(points.mean(axis=0), 0, atol=0.01)
            wanted = (
                0.25 if blades == 0 else (2 + math.cos(2 * math.pi / blades)) / 12
            )  # for a polygon: (2 + cos(2 pi / n)) / 12
            np.testing.assert_allclose((points**2).mean(axis=0), wanted, atol=0.01)

    def test_focus_object(self):
        _, camera = self.ball()
        self.focus(camera, 4.0, 0.4)
        by_distance = self.display()
        bpy.ops.object.empty_add(location=(4.0, 1.0, -0.5))
        camera.data.dof.focus_object, camera.data.dof.focus_distance = bpy.context.object, 10.0
        np.testing.assert_allclose(self.display(), by_distance, atol=1e-3)

    def test_shutter(self):
        """The ball moves 20 pixels while the shutter is open: its variance grows by 20² / 12. The shutter's position
        sets the centre of the blur."""
        root, _ = self.ball()
        for frame, y in ((1, 0.0), (3, -4.0)):  # 2 m per frame to the right, 20 pixels
            root.location.y = y
            root.keyframe_insert("location", frame=frame)
        for curve in (
            root.animation_data.action.fcurves
            if hasattr(root.animation_data.action, "fcurves")
            else blender_5_curves(root)
        ):
            for key in curve.keyframe_points:
                key.interpolation = "LINEAR"
        self.scene.frame_set(2)
        sharp = spread(self.linear()[:, :, 0])
        render = self.scene.render
        render.use_motion_blur, render.motion_blur_shutter = True, 1.0
        for position, shift in (("START", 10), ("CENTER", 0), ("END", -10)):
            blur.position_holder(self.scene).motion_blur_position = position
            got = spread(self.linear()[:, :, 0])
            self.assertAlmostEqual(got[0] - sharp[0], shift, delta=0.2)
            self.assertAlmostEqual(got[2] - sharp[2], 20**2 / 12, delta=0.6)
            self.assertAlmostEqual(got[3], sharp[3], delta=0.05)
        self.assertEqual((self.scene.frame_current, self.scene.frame_subframe), (2, 0))
        np.testing.assert_allclose(root.matrix_world.translation.y, -2.0, atol=1e-6)

    def test_shutter_curve(self):
        """A curve that opens late moves the light towards the end of the shutter's time."""
        curve = self.scene.render.motion_blur_shutter_curve
        shares = (np.arange(64) + 0.5) / 64
        # by default, the shutter is open all the time
        np.testing.assert_allclose(blur.by_curve(curve, shares), shares, atol=1e-6)
        points = curve.curves[0].points
        points[0].location, points[-1].location = (0, 0), (1, 1)
        for point in points:
            point.handle_type = "VECTOR"
        curve.update()
        np.testing.assert_allclose(blur.by_curve(curve, shares), np.sqrt(shares), atol=0.1)

    def test_a_still_picture_is_drawn_once(self):
        """Motion blur without motion draws one sharp picture. With depth of field, it draws several."""
        _, camera = self.ball()
        sharp = self.f12()
        self.scene.render.use_motion_blur = True
        with self.jobs() as seen:
            still = self.f12()
        self.assertEqual(len(seen), 1)
        self.assert_close(still, sharp)
        self.focus(camera, 4.0, 0.1)
        self.scene.pags.blur_samples = 5
        with self.jobs() as seen:
            self.f12()
        self.assertEqual(len(seen), 5)

    def test_other_passes_are_the_sharp_picture_s(self):
        self.bring_in()
        self.scene.frame_set(2)
        bpy.context.view_layer.use_pass_z = True
        found = []

        def keep(render_pass, buffer):
            if render_pass.name == "Depth":
                found.append(np.asarray(buffer).copy())

        for on in (False, True):
            self.scene.render.use_motion_blur = on
            with mock.patch.object(engine, "fill_pass", keep):
                bpy.ops.render.render()
        np.testing.assert_array_equal(*found)

    def test_threads_give_the_same_bits(self):
        self.drive()
        pictures = []
        for threads in (1, 2):
            self.scene.pags.threads = threads
            pictures.append(self.f12()[4])
        self.assertEqual(*pictures)

    def test_cancelled(self):
        """Cancelling during the first of 32 pictures starts no further ones and restores the frame."""
        self.drive()
        with mock.patch.object(engine.PagsRenderEngine, "finish", lambda self, job: job.cancel()), self.jobs() as seen:
            bpy.ops.render.render()
        self.assertEqual(len(seen), 1)
        self.assertEqual((self.scene.frame_current, self.scene.frame_subframe), (2, 0))

    # ---- Comparison with the mean of 256 pictures ----

    def drive(self):
        """Imports a colourful street with a crossing car (4 m/s) and a moving camera (1 m/s). The shutter is open
        for half a second and the lens is 24 cm wide."""
        make_drive(self.path("scene"), confetti())
        self.bring_in()
        self.scene.frame_set(2)
        self.scene.render.use_motion_blur = True
        self.focus(self.scene.camera, 8.0, APERTURE)

    def of_many(self, count):
        """Returns the mean of `count` pictures by the module, at random times and random points of the aperture. The
        test computes their cameras without the add-on."""
        scene, camera, dice = self.scene, self.scene.camera, random.Random(3)
        entry = native.load(self.path("scene"))
        origin, total, slots = np.array(entry.info["origin"]), 0, list(range(count))
        dice.shuffle(slots)
        renderer = native.module.Renderer(threads=0)
        for k in range(count):
            time = 2 - 0.25 + 0.5 * (k + dice.random()) / count
            scene.frame_set(math.floor(time), subframe=time - math.floor(time))
            eye = np.array(camera.matrix_world)
            right, up, back, place = (eye[:3, i] for i in range(4))
            radius, angle = APERTURE * math.sqrt((slots[k] + dice.random()) / count), 2 * math.pi * dice.random()
            x, y = radius * math.cos(angle), radius * math.sin(angle)
            view = {
                "width": SIZE,
                "height": SIZE,
                "fx": FOCAL,
                "fy": FOCAL,
                "time": entry.info["time_begin"] + time - 1,
            }
            view["cx"], view["cy"] = SIZE / 2 + FOCAL * x / 8.0, SIZE / 2 - FOCAL * y / 8.0
            place = place + x * right + y * up + origin
            view["world_from_camera"] = [v for i in range(3) for v in (right[i], -up[i], -back[i], place[i])]
            total = total + np.asarray(renderer.submit(entry.scene, view, linear=True).take().rgba)[..., :3].astype(
                np.float64
            )
        scene.frame_set(2)
        return encoded(np.clip(total / count, 0, 1))

    def test_against_256_pictures(self):
        """Blurred pictures reach a PSNR of 38 dB with 32 samples, and more with more samples. The rest is the error
        of 256 random pictures and 16 bits."""
        self.drive()
        wanted, found = self.of_many(256), {}
        for samples in (8, 32, 128):
            self.scene.pags.blur_samples = samples
            begin = time.monotonic()
            found[samples] = psnr(self.display(f"blur{samples}"), wanted)
            print(f"figures: {samples} samples: {found[samples]:.2f} dB, {time.monotonic() - begin:.2f} s")
        self.scene.camera.data.dof.use_dof = self.scene.render.use_motion_blur = False
        sharp = psnr(self.display("sharp"), wanted)
        print(f"figures: without: {sharp:.2f} dB")
        self.assertGreaterEqual(found[32], 38)
        self.assertLess(sharp + 3, found[8])
        self.assertLess(found[8], found[32])
        self.assertLess(found[32], found[128])


def blender_5_curves(block):
    return [
        c
        for layer in block.animation_data.action.layers
        for strip in layer.strips
        for bag in strip.channelbags
        for c in bag.fcurves
    ]


class Layers(ObeyCase):
    def layer(self, name, transparent=True):
        """Renders one view layer; returns its RGBA picture."""
        self.scene.render.film_transparent = transparent
        self.scene.render.image_settings.color_mode = "RGBA"
        path = self.path("layer.png")
        self.scene.render.filepath = path
        bpy.ops.render.render(layer=name, write_still=True)
        return read_png(path)

    def test_a_layer_without_splats_is_empty(self):
        self.bring_in()
        self.scene.frame_set(2)
        first = bpy.context.view_layer.name
        whole = self.layer(first)
        empty = self.scene.view_layers.new("empty")
        empty.layer_collection.children["scene"].exclude = True
        with self.reports() as said:
            nothing = self.layer("empty", transparent=False)
        self.assertEqual(set(nothing[4]), {0})
        self.assertTrue(any("view layer empty" in text and "layer is empty" in text for text in said), said)
        self.assertEqual(self.layer(first)[4], whole[4])
        with self.reports() as said:
            bpy.ops.render.render()  # renders all layers
        self.assertEqual(len(said), 1)

    def test_exclusion(self):
        """A view layer doesn't show classes that it excludes."""
        self.bring_in()
        self.scene.frame_set(2)
        self.assertGreater(pixel(self.f12(), 50, 50)[0], 200)
        cars = bpy.context.view_layer.layer_collection.children["scene"].children["Car"]
        cars.exclude = True
        picture = self.f12()
        self.assertLess(pixel(picture, 50, 50)[0], 50)
        self.assertGreater(pixel(picture, 50, 17)[0], 100)  # the wall is still visible

    def test_ignored_settings_are_reported(self):
        self.bring_in()
        with self.reports() as said:
            self.f12()
        self.assertEqual(said, [])
        for name in ("One", "Two", "Three", "Four"):
            bpy.ops.mesh.primitive_cube_add()
            bpy.context.object.name = name
        bpy.context.view_layer.layer_collection.children["scene"].holdout = True
        self.scene.render.use_multiview = True
        with self.reports() as said:
            bpy.ops.render.render()
        text = "; ".join(said)
        for words in ("not drawn by PAGS: Four, One, Three and 1 more", "holdout of splats", "stereoscopy"):
            self.assertIn(words, text)


class Clipping(ObeyCase):
    def test_camera_s_clip(self):
        """Gaussians outside the camera's clip range aren't drawn; the sky is."""
        self.bring_in()
        self.scene.frame_set(2)
        camera = self.scene.camera.data
        whole = self.f12()
        for start, end, drawn in (
            (0.1, 9.5, True),
            (0.1, 8.5, False),
            (8.5, 100, True),
            (9.5, 100, False),
        ):  # the car is 9 m in front of the camera
            camera.clip_start, camera.clip_end = start, end
            found = self.f12()
            self.assertEqual(pixel(found, 50, 50)[0] > 200, drawn, (start, end))
            self.assertEqual(pixel(found, 90, 90), pixel(whole, 90, 90))

    def test_moved_and_scaled_scenes(self):
        """Clipping planes are in Blender's world, also for moved and scaled scenes."""
        root = self.bring_in()
        self.scene.frame_set(2)
        root.scale, root.location, root.rotation_euler = (2, 2, 2), (3, 4, 5), (0.1, 0.2, 0.3)
        camera = self.scene.camera.data
        for end, drawn in ((19, True), (17, False)):
            camera.clip_end = end
            self.assertEqual(pixel(self.f12(), 50, 50)[0] > 200, drawn, end)

    def test_picks(self):
        """A pick ignores Gaussians that clipping planes remove."""
        scene = native.load(self.path("scene")).scene
        # the camera is 1 m ahead of the origin and looks along x
        view, origin = {**scene.views[2], "time": 101.0}, scene.info["origin"]
        before = lambda x: [[1, 0, 0, -(origin[0] + x)]]  # noqa: E731
        self.assertEqual(native.module.pick(scene, view, 50, 50)["object"], 1)
        self.assertEqual(native.module.pick(scene, view, 50, 50, clips=before(9.5))["object"], 1)
        self.assertIsNone(native.module.pick(scene, view, 50, 50, clips=before(10.5)))
        for clips, words in (([[1, 2, 3]], "clips"), ([[1, 0, 0, 0]] * 9, "at most 8")):
            with self.assertRaisesRegex(ValueError, words):
                native.module.pick(scene, view, 50, 50, clips=clips)


class Paths(ObeyCase):
    def test_an_absolute_path_stays(self):
        root = self.bring_in(relative=False)
        for _ in range(2):
            bpy.ops.wm.save_as_mainfile(filepath=self.path("work.blend"))
        self.assertEqual(root.pags.path, self.path("scene"))

    def test_path_becomes_relative_only_once(self):
        root = self.bring_in()
        for _ in range(2):
            bpy.ops.wm.save_as_mainfile(filepath=self.path("work.blend"))
        self.assertEqual(root.pags.path, "//scene")
        root.pags.path = self.path("scene")  # the user sets an absolute path
        root.pags.dataset = self.path("photographs")
        bpy.ops.wm.save_as_mainfile(filepath=self.path("work.blend"))
        self.assertEqual((root.pags.path, root.pags.dataset), (self.path("scene"), self.path("photographs")))


class Linked(ObeyCase):
    def library(self):
        """Saves a .blend with a scene in a separate folder and links the scene's collection; returns the collection
        and its picture."""
        os.mkdir(self.path("lib"))
        make_drive(self.path("lib", "data", "street"))
        self.bring_in(os.path.join("lib", "data", "street"))
        for _ in range(2):
            bpy.ops.wm.save_as_mainfile(filepath=self.path("lib", "lib.blend"))
        self.assertEqual(
            next(o for o in self.scene.objects if o.pags.kind == "ROOT").pags.path.replace("\\", "/"), "//data/street"
        )
        self.scene.frame_set(2)
        picture = self.f12()
        place = self.scene.camera.matrix_world.copy()
        bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
        os.mkdir(self.path("work"))
        bpy.ops.wm.save_as_mainfile(filepath=self.path("work", "work.blend"))
        with bpy.data.libraries.load(self.path("lib", "lib.blend"), link=True, relative=True) as (there, here):
            here.collections = ["street"]
        data = bpy.data.cameras.new("mine")
        data.sensor_width, data.lens = 36.0, 36.0 * FOCAL / SIZE
        camera = bpy.data.objects.new("mine", data)
        self.scene.collection.objects.link(camera)
        camera.matrix_world = place
        scene = self.scene
        scene.camera, scene.render.engine, scene.view_settings.view_transform = camera, "PAGS", "Standard"
        scene.render.resolution_x = scene.render.resolution_y = SIZE
        scene.render.fps, scene.render.image_settings.file_format, scene.render.dither_intensity = 1, "PNG", 0
        scene.render.image_settings.color_mode = "RGB"
        scene.frame_set(2)
        return here.collections[0], picture

    def test_an_instanced_collection(self):
        """The scene's path is relative to the library's .blend. The instance can be moved."""
        collection, wanted = self.library()
        empty = bpy.data.objects.new("street", None)
        empty.instance_type, empty.instance_collection = "COLLECTION", collection
        self.scene.collection.objects.link(empty)
        self.assert_close(self.f12(), wanted)
        empty.location.y = 1.0  # to the left, by 1 m / 9 m * 100 pixels
        moved = self.f12()
        self.assertGreater(pixel(moved, 50 - 11, 50)[0], 200)
        self.assertLess(pixel(moved, 50, 50)[0], 100)

    def test_two_scenes_of_the_same_name(self):
        collection, _ = self.library()
        self.scene.collection.children.link(collection)
        os.rename(self.path("scene"), self.path("street"))
        local = self.bring_in("street")
        self.assertEqual(local.name, next(o for o in bpy.data.objects if o.library and o.pags.kind == "ROOT").name)
        local.location.y = 1.0
        self.scene.frame_set(2)
        both = self.f12()
        for x in (50, 50 - 11):
            self.assertGreater(pixel(both, x, 50)[0], 200)

    def test_overrides(self):
        """An override's parts and settings can be changed; the file stores both."""
        collection, wanted = self.library()
        self.scene.collection.children.link(collection)  # links the collection as a user does before the override
        made = collection.override_hierarchy_create(self.scene, bpy.context.view_layer)
        self.assertIn(made, self.scene.collection.children_recursive)
        if collection in list(self.scene.collection.children):
            self.scene.collection.children.unlink(collection)
        root = next(o for o in self.scene.objects if o.override_library and o.pags.kind == "ROOT")
        car = next(
            o for o in self.scene.objects if o.override_library and o.pags.kind == "OBJECT" and o.pags.index == 1
        )
        self.assertEqual(car.pags.root, root)
        self.assert_close(self.f12(), wanted)
        car.location.x += 1.0  # forward, which is to the right in the picture
        root.pags.frame_start = 1.5
        self.assertEqual(root.pags.frame_start, 1.0)  # its keyframes are linked, so they can't follow
        moved = self.f12()
        self.assertLess(pixel(moved, 50, 50)[0], 100)
        bpy.ops.wm.save_mainfile()
        bpy.ops.wm.open_mainfile(filepath=self.path("work", "work.blend"))
        root = next(o for o in self.scene.objects if o.override_library and o.pags.kind == "ROOT")
        self.assertEqual(
            next(o for o in self.scene.objects if o.pags.kind == "OBJECT" and o.pags.index == 1).pags.root, root
        )
        self.assertEqual(self.f12("again")[4], moved[4])
        os.rename(self.path("lib", "data", "street"), self.path("elsewhere"))
        root.pags.path = "//../elsewhere"  # the override's path is relative to the open file
        native.forget()
        self.assertEqual(self.f12("own")[4], moved[4])


main()
