# SPDX-License-Identifier: Apache-2.0
"""Tests the add-on in Blender without a window: F12 pictures and passes against the program, and refused settings."""

import math
import os
import struct
import sys

import bpy

HERE = os.path.dirname(os.path.abspath(__file__))
sys.path[:0] = [HERE, os.path.join(HERE, "..", "cli")]
import fixtures  # noqa: E402
from blender_case import BlenderCase, main, pixel  # noqa: E402
from fixtures import ply_bytes, splat  # noqa: E402


def exr_header(data, at):
    """Returns the attributes of the OpenEXR header that starts at `at`, and the offset of its end."""
    found = {}
    while data[at]:
        end = data.index(b"\0", at)
        kind = data.index(b"\0", end + 1)
        (size,) = struct.unpack_from("<i", data, kind + 1)
        found[data[at:end].decode()] = data[kind + 5 : kind + 5 + size]
        at = kind + 5 + size
    return found, at + 1


def exr_channels(block):
    """Returns (name, bytes per sample) of all channels in the file's order."""
    at, out = 0, []
    while block[at]:
        end = block.index(b"\0", at)
        (kind,) = struct.unpack_from("<i", block, end + 1)
        out.append((block[at:end].decode(), 2 if kind == 1 else 4))
        at = end + 17
    return out


def exr_values(data, x, y):
    """Returns the values of all float channels of an uncompressed OpenEXR file at a pixel, by part.channel. Blender
    5 writes one part per pass."""
    (version,) = struct.unpack_from("<i", data, 4)
    several, parts, at = bool(version & 0x1000), [], 8
    while not parts or (several and data[at]):
        header, at = exr_header(data, at)
        parts.append(header)
    at += 1 if several else 0
    out = {}
    for header in parts:
        x0, y0, x1, y1 = struct.unpack("<4i", header["dataWindow"])
        (offset,) = struct.unpack_from("<Q", data, at + 8 * (y - y0))
        at += 8 * (y1 - y0 + 1)  # each part has a table of offsets, with one chunk per row
        if header["compression"] != b"\0":
            raise ValueError("expected an uncompressed file")
        place = offset + (12 if several else 8)
        for name, size in exr_channels(header["channels"]):
            if size == 4:
                whole = f"{header.get('name', b'').decode()}.{name}"
                (out[whole],) = struct.unpack_from("<f", data, place + 4 * (x - x0))
            place += size * (x1 - x0 + 1)
    return out


class Final(BlenderCase):
    def test_same_as_the_program(self):
        self.bring_in()
        pictures = []
        for frame in (1, 2):
            self.scene.frame_set(frame)
            pictures.append(self.f12())
            self.assert_close(pictures[-1], self.program())
        self.scene.frame_set(1, subframe=0.5)
        self.assert_close(self.f12(), self.program())
        self.assertGreater(self.difference(*pictures), 100)

    def test_moving_an_object_moves_it(self):
        self.bring_in()
        for index, name in ((1, "c=2"), (0, "p,1")):
            before = self.f12()
            self.part(index).location.x += 1  # moves the object forward by 1 m
            after = self.f12()
            self.assert_close(after, self.program("--move", name, "1,0,0,0"))
            self.assertGreater(self.difference(before, after), 50)
            self.part(index).location.x -= 1

    def test_hiding_and_duplicating(self):
        self.bring_in()
        car = self.part(1)
        car.hide_render = True
        self.assert_close(self.f12(), self.program("--without", "c=2"))
        car.hide_render = False
        twin = car.copy()
        car.users_collection[0].objects.link(twin)
        twin.location.x += 1
        self.assert_close(self.f12(), self.program("--add", "c=2", "1,0,0,0"))
        bpy.data.objects.remove(twin)
        self.scene.pags.hide_noncritical = True
        critical = self.f12()
        self.assertGreater(pixel(critical, 35, 50)[1], 200)
        self.assertLess(max(pixel(critical, 50, 20)), 140)  # the wall is hidden and the sky is visible

    def test_the_whole_scene_moved(self):
        """A scene that is moved together with its camera looks the same."""
        root = self.bring_in()
        before = self.f12()
        root.location = (5, -3, 2)
        root.rotation_euler = (0.2, 0.1, 1.0)
        self.assertLessEqual(self.difference(before, self.f12()), 1)

    def test_border_shift_and_size(self):
        self.bring_in()
        whole = self.f12()
        render = self.scene.render
        render.use_border, render.use_crop_to_border = True, True
        render.border_min_x, render.border_max_x, render.border_min_y, render.border_max_y = 0.25, 0.75, 0.4, 0.9
        part = self.f12()
        x0, y1 = int(0.25 * 101), int(0.9 * 101)
        for x, y in ((3, 5), (10, 20), (25, 25)):
            self.assertEqual(pixel(part, x, y), pixel(whole, x0 + x, 101 - y1 + y))
        render.use_crop_to_border = False
        pasted = self.f12()
        self.assertEqual(pasted[:2], (101, 101))
        self.assertEqual(pixel(pasted, 40, 40), pixel(whole, 40, 40))
        render.use_border = False
        self.scene.camera.data.shift_x += 0.1
        self.assert_close(self.f12(), self.program())
        render.resolution_x, render.resolution_y = 60, 90  # the sensor is wider than the picture
        self.scene.camera.data.sensor_fit = "AUTO"
        self.assert_close(self.f12(), self.program())

    def test_passes(self):
        self.bring_in()
        self.scene.frame_set(2)
        layer = bpy.context.view_layer
        layer.use_pass_z = layer.use_pass_object_index = True
        self.scene.pags.use_pass_heat = True
        self.part(1).pass_index = 42
        values = exr_values(self.render_exr("passes.exr"), 50, 50)
        short = {".".join(name.split(".")[-2:]): value for name, value in values.items()}
        for name in ("Combined.R", "Depth.Z", "IndexOB.X", "PriorityHeat.R"):
            self.assertIn(name, short)
        self.assertAlmostEqual(short["Depth.Z"], 10 - 1, delta=0.2)
        self.assertEqual(short["IndexOB.X"], 42)
        self.assertGreater(short["Combined.R"], 0.9)
        self.assertGreater(short["PriorityHeat.R"], 0.5)  # the heat colour of a critical object is pale yellow

    def render_exr(self, name):
        """Renders F12 into an uncompressed EXR file of all passes; returns its bytes."""
        settings = self.scene.render.image_settings
        if hasattr(settings, "media_type"):
            settings.media_type = "MULTI_LAYER_IMAGE"
        settings.file_format = "OPEN_EXR_MULTILAYER"
        settings.color_depth = "32"
        if hasattr(settings, "exr_codec"):
            settings.exr_codec = "NONE"
        self.scene.render.filepath = self.path(name)
        bpy.ops.render.render(write_still=True)
        return fixtures.read(self.path(name))

    def short_names(self, data, x, y):
        return {".".join(name.split(".")[-2:]): value for name, value in exr_values(data, x, y).items()}

    def test_passes_for_compositing(self):
        """Vector, Normal and Cryptomatte passes follow Blender's conventions. Blender's Cryptomatte node knows their
        names."""
        from test_passes import value

        root = self.bring_in()
        root.rotation_euler = (0, 0, 0.5)
        self.scene.frame_set(2)
        layer = bpy.context.view_layer
        layer.use_pass_vector = layer.use_pass_normal = True
        layer.use_pass_cryptomatte_object = layer.use_pass_cryptomatte_asset = True
        self.scene.camera.animation_data_clear()  # the camera stays at its place of this frame
        data = self.render_exr("passes.exr")
        short = self.short_names(data, 50, 50)
        sensor = self.scene.camera
        ahead = [-sensor.matrix_world[row][2] for row in range(3)]
        self.assertEqual(self.scene.frame_current, 2)
        car = self.part(1)
        self.assertEqual(short["CryptoObject00.R"], value(car.name))
        self.assertAlmostEqual(short["CryptoObject00.G"], 0.99, delta=1e-3)
        self.assertEqual(short["CryptoAsset00.R"], value("Car"))
        self.assertNotIn("CryptoObject03.R", short)
        towards = sum(a * short[f"Normal.{c}"] for a, c in zip(ahead, "XYZ"))
        self.assertLess(towards, 1e-6)  # the normal faces the camera
        self.assertAlmostEqual(sum(short[f"Normal.{c}"] ** 2 for c in "XYZ"), 1, delta=1e-3)
        for text in (
            car.name,
            f"{layer.name}.CryptoObject",
            f"{layer.name}.CryptoAsset",
            "MurmurHash3_32",
            "uint32_to_float32",
        ):
            self.assertTrue(text.encode() in data, text)
        layer.pass_cryptomatte_depth = 2
        self.assertNotIn("CryptoObject01.R", self.short_names(self.render_exr("two.exr"), 50, 50))

    def test_cryptomatte_node(self):
        """Blender's Cryptomatte node makes the matte of a named object from the render. The camera stands 1 m ahead,
        and row 17 shows the wall."""
        if bpy.app.version >= (5, 0, 0):
            self.skipTest("the compositor's tree isn't the scene's from Blender 5.0 on")
        self.bring_in()
        self.scene.frame_set(2)
        bpy.context.view_layer.use_pass_cryptomatte_object = True
        self.scene.use_nodes = True
        tree = self.scene.node_tree
        tree.nodes.clear()
        matte, out = tree.nodes.new("CompositorNodeCryptomatteV2"), tree.nodes.new("CompositorNodeComposite")
        tree.links.new(tree.nodes.new("CompositorNodeRLayers").outputs["Image"], matte.inputs["Image"])
        tree.links.new(matte.outputs["Matte"], out.inputs["Image"])
        for name, shown, other in ((self.part(1).name, (50, 50), (50, 17)), ("background", (50, 17), (50, 50))):
            matte.matte_id = name
            picture = self.f12("matte")
            self.assertGreater(pixel(picture, *shown)[0], 230)
            self.assertEqual(pixel(picture, *other)[0], 0)

    def test_vector_pass(self):
        """The vectors of the car match its track in pixels, and a moved Blender object has vectors, too. Resting
        objects have zero vectors."""
        self.bring_in(cameras="NONE")
        camera = bpy.data.cameras.new("still")
        still = bpy.data.objects.new("still", camera)
        self.scene.collection.objects.link(still)
        self.scene.camera = still
        still.rotation_euler = (math.pi / 2, 0, -math.pi / 2)  # the camera looks along x
        camera.lens, camera.sensor_width = 36, 36
        render = self.scene.render
        render.resolution_x = render.resolution_y = 101
        bpy.context.view_layer.use_pass_vector = True
        parked = self.track(0)
        for frame, y in ((1, 0.0), (2, 0.1), (3, 0.3)):
            parked.location.y = 1 + y
            parked.keyframe_insert("location", frame=frame)
        if parked.animation_data and hasattr(parked.animation_data.action, "fcurves"):
            for curve in parked.animation_data.action.fcurves:
                for key in curve.keyframe_points:
                    key.interpolation = "LINEAR"
        self.scene.frame_set(2)
        data = self.render_exr("vector.exr")
        car, rest = self.short_names(data, 50, 50), self.short_names(data, 35, 40)
        for channel, wanted in (
            ("X", -40 * 0.99),
            ("Y", 0),
            ("Z", -40 * 0.99),
            ("W", 0),
        ):  # The car moves 4 m per frame at a distance of 10 m; the focal length is 101 pixels.
            self.assertAlmostEqual(car[f"Vector.{channel}"], 1.01 * wanted, delta=0.5)
        # the parked car moves 0.1 m to the left before this frame and 0.2 m after it
        moved = self.short_names(data, 34, 50)
        self.assertAlmostEqual(moved["Vector.Z"] / moved["Vector.X"], 2, delta=0.1)
        self.assertGreater(moved["Vector.X"], 0.5)
        self.assertEqual(rest["Vector.X"], 0)

    def test_passes_of_several_scenes(self):
        """Adds a ball of half size from another scene to a stretched street. The passes give each its name and its
        motion relative to the camera."""
        from test_passes import value

        street = self.bring_in()
        self.scene.frame_set(2)
        plain = self.pass_values()
        self.write("ball.ply", ply_bytes([splat(0, 0, 0, (1, 1, 0), sigma=0.2, opacity=12.0)]))
        root = self.bring_in("ball.ply")
        root.scale = (0.5, 0.5, 0.5)
        for frame, y in ((1, -1.4), (2, -1.5), (3, -1.6)):
            root.location = (10, y, 0)
            root.keyframe_insert("location", frame=frame)
        self.scene.frame_set(2)
        for stretched in (False, True):
            if stretched:
                street.scale.z = 1.2  # in this case the street contributes only its sky
            picture = self.pass_values()
            # the camera stands at 1 m; the ball is 9 m ahead and 1.5 m to the right
            ball, car = picture(67, 50), picture(50, 50)
            self.assertEqual(
                (ball["CryptoObject00.R"], ball["CryptoAsset00.R"]), (value("background.001"), value("background"))
            )
            self.assertEqual((car["CryptoObject00.R"], car["CryptoAsset00.R"]), (value("c=2"), value("Car")))
            # The ball moves 0.1 m per frame to the right, the camera 1 m ahead.
            for channel, wanted in (("X", 1.4 / 10 - 1.5 / 9), ("Z", 1.5 / 9 - 1.6 / 8)):
                self.assertAlmostEqual(ball[f"Vector.{channel}"], 100 * wanted, delta=0.3)
            for channel in "XZ":
                self.assertAlmostEqual(car[f"Vector.{channel}"], plain(50, 50)[f"Vector.{channel}"], delta=0.2)

    def pass_values(self):
        """Renders F12 with passes; returns a function that gives the passes' values at a pixel."""
        layer = bpy.context.view_layer
        layer.use_pass_vector = layer.use_pass_cryptomatte_object = layer.use_pass_cryptomatte_asset = True
        data = self.render_exr("several.exr")
        return lambda x, y: self.short_names(data, x, y)

    def test_transparent_sky_and_modes(self):
        self.bring_in()
        self.scene.frame_set(2)
        self.scene.render.film_transparent = True
        self.scene.render.image_settings.color_mode = "RGBA"
        picture = self.f12()
        self.assertEqual(picture[2], 4)
        self.assertEqual(picture[4][(90 * 101 + 90) * 4 + 3], 0)
        self.assertGreater(picture[4][(50 * 101 + 50) * 4 + 3], 250)
        self.scene.render.film_transparent = False
        self.scene.render.image_settings.color_mode = "RGB"
        pictures = []
        for mode in ("rgb", "priority", "critical", "depth", "size"):
            self.scene.pags.mode = mode
            pictures.append(self.f12())
        for i, one in enumerate(pictures):
            for other in pictures[i + 1 :]:
                self.assertGreater(self.difference(one, other), 20)

    def test_refusals(self):
        self.bring_in()
        good = self.f12()
        self.scene.camera.data.type = "PANO"
        self.raises(["panoram"], bpy.ops.render.render)
        self.scene.camera.data.type = "PERSP"
        self.assertEqual(self.f12()[4], good[4])
        for part in [o for o in self.scene.objects if o.pags.kind in {"OBJECT", "BACKGROUND"}]:
            part.hide_render = True
        self.assertEqual(set(self.f12()[4]), {0})  # the layer is empty
        for part in [o for o in bpy.data.objects if o.pags.kind in {"OBJECT", "BACKGROUND"}]:
            bpy.data.objects.remove(part)
        self.raises(["import"], bpy.ops.render.render)

    def test_own_background(self):
        self.bring_in()
        sky = pixel(self.f12(), 90, 90)
        self.scene.pags.background = (0.2, 0.4, 0.8)
        self.assertEqual(pixel(self.f12(), 90, 90), sky)
        self.scene.pags.use_background = True
        self.assertEqual(pixel(self.f12(), 90, 90), (51, 102, 204))
        self.scene.render.film_transparent = True
        self.scene.render.image_settings.color_mode = "RGBA"
        self.assertEqual(self.f12()[4][(90 * 101 + 90) * 4 + 3], 0)

    def test_orthographic(self):
        self.bring_in()
        self.scene.frame_set(2)
        self.scene.camera.data.type = "ORTHO"
        self.scene.camera.data.ortho_scale = 10.1  # the picture has 10 pixels per metre
        self.scene.camera.data.shift_x = self.scene.camera.data.shift_y = 0
        picture = self.f12()
        self.assertGreater(pixel(picture, 50, 50)[0], 200)  # the pixel shows the car in front of the camera
        # the pixel shows the parked car 1.5 m to the left; its distance doesn't matter
        self.assertGreater(pixel(picture, 35, 50)[1], 200)


if __name__ == "__main__":
    main()
