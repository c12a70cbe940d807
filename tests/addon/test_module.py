# SPDX-License-Identifier: Apache-2.0
"""Tests the module `pags` in plain Python: pictures compared with the program, buffers, jobs, picks, errors."""

import gc
import json
import math
import os
import re
import shutil
import struct
import subprocess
import sys
import threading
import time
import unittest

HERE = os.path.dirname(os.path.abspath(__file__))
sys.path.insert(0, os.path.join(HERE, "..", "cli"))
MODULE = sys.argv.pop(2) if len(sys.argv) > 2 else os.environ.get("PAGS_MODULE", "build/python")
sys.path.insert(0, MODULE)

import fixtures  # noqa: E402
import pags  # noqa: E402
from fixtures import Case, ply_bytes, read, read_png, some_splats, splat, write  # noqa: E402
from test_drive import ORIGIN, camera, make_drive  # noqa: E402

SANITIZED = "PAGS_SANITIZED" in os.environ
IDENTITY = [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0]


def pose_of(record):
    """Returns world_from_camera for a camera file's record that looks along the world's x axis."""
    y, z, x = record["camera_from_world_translation"]
    return [0, 0, 1, -x, -1, 0, 0, y, 0, -1, 0, z]


def make_camera(x=0.0, **more):
    record = camera(x)
    lens = {key: record[key] for key in ("width", "height", "fx", "fy", "cx", "cy")}
    return {**lens, "world_from_camera": pose_of(record), **more}


def floats(buffer):
    return memoryview(buffer).cast("B").cast("f")


def pixel(buffer, x, y, channels=4):
    width = buffer.shape[1]
    values = floats(buffer)
    at = (y * width + x) * channels
    return tuple(values[at + c] for c in range(channels))


class ModuleCase(Case):
    def setUp(self):
        super().setUp()
        make_drive(self.path("scene"))
        self.scene = pags.load(self.path("scene"))

    def program_draws(self, record, *more):
        self.write("camera.json", json.dumps(record))
        self.succeeds("render", self.path("scene"), "--camera", self.path("camera.json"), "-o", self.path("out"), *more)
        return read_png(self.path("out", "00000.png"))

    def assert_same(self, png, picture):
        width, height, channels, bits, samples = png
        self.assertEqual((width, height, channels, bits), (picture.width, picture.height, 3, 8))
        values = floats(picture.rgba)
        for i in range(width * height):
            for c in range(3):
                mine = int(min(max(values[4 * i + c], 0), 1) * 255 + 0.5)
                if mine != samples[3 * i + c]:
                    self.fail(f"pixel {i % width},{i // width}: {mine}, the program's {samples[3 * i + c]}")


class Drawing(ModuleCase):
    def test_same_as_the_program(self):
        for t in (100.0, 100.5, 102.0):
            png = self.program_draws(camera(0.0, time=t))
            self.assert_same(png, pags.render(self.scene, make_camera(time=t), threads=2))

    def test_placements_of_the_tracks_change_nothing(self):
        for t in (100.0, 101.25):
            placements = [(-1, IDENTITY), (0, self.scene.pose(0, t)), (1, self.scene.pose(1, t))]
            png = self.program_draws(camera(0.0, time=t))
            self.assert_same(png, pags.render(self.scene, make_camera(time=t), placements=placements))

    def test_a_placement_moves(self):
        for number, name in ((0, "p,1"), (1, "c=2")):
            pose = list(self.scene.pose(number, 100.0))
            offset = [pose[0] * 1.0, pose[4] * 1.0, pose[8] * 1.0]  # moves the object a metre forward
            for k in range(3):
                pose[4 * k + 3] += offset[k]
            other = 1 - number
            placements = [(-1, IDENTITY), (number, pose), (other, self.scene.pose(other, 100.0))]
            png = self.program_draws(camera(0.0, time=100.0), "--move", name, "1,0,0,0")
            self.assert_same(png, pags.render(self.scene, make_camera(time=100.0), placements=sorted(placements)))

    def test_hidden_and_repeated_objects(self):
        alone = pags.render(
            self.scene, make_camera(), placements=[(1, self.scene.pose(1, 101.0))], background=[0, 0, 0]
        )
        reds = sum(v > 0.5 for v in floats(alone.rgba)[0::4])
        pose = list(self.scene.pose(1, 101.0))
        pose[11] += 1
        both = [(1, self.scene.pose(1, 101.0)), (1, pose)]
        twice = pags.render(self.scene, make_camera(), placements=both, background=[0, 0, 0])
        self.assertGreater(reds, 0)
        self.assertEqual(sum(v > 0.5 for v in floats(twice.rgba)[0::4]), 2 * reds)
        nothing = pags.render(self.scene, make_camera(), placements=[], background=[0, 0, 0])
        self.assertEqual(max(floats(nothing.rgba)[0::4]), 0)

    def test_cut_keeps_critical_objects(self):
        """A cut of 1,000 pixels removes the wall (Gaussian 0), which is smaller. The two cars are critical and stay."""
        whole, cut, uncut = (
            memoryview(pags.render(self.scene, make_camera(), outputs=("id",), cut=c).id).cast("B").cast("i").tolist()
            for c in (0, 1000, 1e-6)
        )
        self.assertEqual(set(whole), {-1, 0, 1, 2})
        self.assertEqual(cut, [-1 if i == 0 else i for i in whole])
        self.assertEqual(uncut, whole)

    def test_linear_light_rows_and_window(self):
        plain = pags.render(self.scene, make_camera(time=100.0))
        linear = pags.render(self.scene, make_camera(time=100.0), linear=True, flip=True)
        for y in range(0, 101, 5):
            for x in range(0, 101, 5):
                for shown, light in zip(pixel(plain.rgba, x, y), pixel(linear.rgba, x, 100 - y)):
                    shown = max(shown, 0)
                    wanted = shown / 12.92 if shown <= 0.04045 else ((shown + 0.055) / 1.055) ** 2.4
                    self.assertAlmostEqual(light, wanted, delta=2e-6)
        more = pags.render(self.scene, make_camera(time=100.0), linear=True, flip=True, outputs=("rgba", "depth"))
        self.assertEqual(bytes(more.rgba), bytes(linear.rgba))
        lit = [
            pags.render(self.scene, make_camera(time=100.0), linear=True, window=(30, 45, 27, 11), outputs=o)
            for o in (("rgba",), ("rgba", "depth"))
        ]
        for part in lit:
            wanted = [pixel(linear.rgba, 30 + x, 100 - 45 - y) for y in range(11) for x in range(27)]
            self.assertGreater(len(set(wanted)), 10)  # the window shows several colours
            self.assertEqual([pixel(part.rgba, x, y) for y in range(11) for x in range(27)], wanted)
        part = pags.render(self.scene, make_camera(time=100.0), window=(30, 20, 17, 11))
        self.assertEqual(part.rgba.shape, (11, 17, 4))
        self.assertEqual(pixel(part.rgba, 3, 4), pixel(plain.rgba, 33, 24))

    def test_transparent(self):
        picture = pags.render(self.scene, make_camera(time=101.0), transparent=True)
        self.assertEqual(pixel(picture.rgba, 90, 90), (0, 0, 0, 0))
        red, green, blue, alpha = pixel(picture.rgba, 50, 50)
        self.assertGreater(alpha, 0.98)
        self.assertGreater(red, 0.9)
        self.assertLess(green + blue, 0.05)

    def test_other_planes(self):
        picture = pags.render(
            self.scene,
            make_camera(time=101.0),
            outputs=("depth", "object", "id", "priority", "heat"),
            depth_empty=1e10,
            object_values=[7, 11],
        )
        self.assertIsNone(picture.rgba)
        self.assertAlmostEqual(pixel(picture.depth, 50, 50, 1)[0], 10, places=1)
        self.assertEqual(pixel(picture.depth, 90, 90, 1)[0], memoryview(picture.depth)[0, 0])
        self.assertGreater(pixel(picture.depth, 90, 90, 1)[0], 9e9)
        near = pags.render(self.scene, make_camera(time=101.0), outputs=("depth",), depth_empty=1e10, depth_alpha=0.5)
        count = lambda picture: sum(v < 1e9 for row in memoryview(picture.depth).tolist() for v in row)
        self.assertLess(0, count(near))
        self.assertLess(count(near), count(picture))  # without the faint edges of Gaussians
        self.assertEqual(pixel(near.depth, 50, 50, 1), pixel(picture.depth, 50, 50, 1))
        self.assertEqual(pixel(picture.object, 50, 50, 1)[0], 11)
        self.assertEqual(pixel(picture.object, 35, 50, 1)[0], 7)
        self.assertEqual(pixel(picture.object, 90, 90, 1)[0], 0)
        self.assertEqual(memoryview(picture.id)[50, 50], 2)
        self.assertEqual(memoryview(picture.id)[90, 90], -1)
        self.assertGreater(picture.stats["gaussians"], 0)

    def test_modes(self):
        for mode in ("priority", "critical", "depth", "size"):
            picture = pags.render(self.scene, make_camera(time=101.0), mode=mode)
            self.assertEqual(pixel(picture.rgba, 90, 90), (0, 0, 0, 1))
            self.assertGreater(max(pixel(picture.rgba, 50, 50)[:3]), 0.1, mode)

    def test_exposure_and_early_z(self):
        gain = self.scene.exposure(0, 102.0)
        self.assertAlmostEqual(gain[0], 1.2)
        plain = pags.render(self.scene, make_camera(time=100.0))
        brighter = pags.render(self.scene, make_camera(time=100.0), exposure=gain)
        self.assertAlmostEqual(pixel(brighter.rgba, 90, 90)[2], 1.2 * pixel(plain.rgba, 90, 90)[2], places=5)
        early = pags.render(self.scene, make_camera(time=100.0), early_z="lossless")
        self.assertEqual(bytes(memoryview(early.rgba)), bytes(memoryview(plain.rgba)))
        pags.render(self.scene, make_camera(), early_z="bounded=0.01")
        with self.assertRaises(ValueError):
            pags.render(self.scene, make_camera(), early_z="sometimes")

    def test_pick(self):
        found = pags.pick(self.scene, make_camera(time=101.0), 50, 50)
        self.assertEqual((found["id"], found["object"]), (2, 1))
        for value, wanted in zip(found["point"], (ORIGIN[0] + 10, ORIGIN[1], ORIGIN[2])):
            self.assertAlmostEqual(value, wanted, delta=0.2)
        self.assertEqual(found["priority"], 1)
        self.assertIsNone(pags.pick(self.scene, make_camera(time=101.0), 90, 90))
        with self.assertRaises(ValueError):
            pags.pick(self.scene, make_camera(), 101, 0)

    def test_pick_depth_and_placements(self):
        """Picked depth is along the camera's axis, not along the ray. A placement in front of another hides it."""
        view = make_camera(time=101.0)
        beside = pags.pick(self.scene, view, 35, 50)
        self.assertEqual(beside["object"], 0)
        self.assertAlmostEqual(beside["depth"], 10, delta=0.05)  # the distance along the ray is 10.11 m
        pose = list(self.scene.pose(0, 101.0))
        pose[3], pose[7] = (
            ORIGIN[0] + 5,
            ORIGIN[1] - 0.5,
        )  # the Gaussian lies half a metre to the left of the middle of its box
        found = pags.pick(self.scene, view, 50, 50, placements=[(1, self.scene.pose(1, 101.0)), (0, pose)])
        self.assertEqual(found["object"], 0)
        self.assertAlmostEqual(found["depth"], 5, delta=0.1)
        self.assertIsNone(pags.pick(self.scene, view, 50, 50, placements=[]))


class Contents(ModuleCase):
    def test_contents(self):
        info = self.scene.info
        self.assertEqual((info["gaussians"], info["up"], info["fps"], info["sky"]), (3, "z", 1, True))
        self.assertEqual(info["origin"], tuple(ORIGIN))
        parked, car = self.scene.objects
        self.assertEqual((parked["id"], parked["tracked"], parked["gaussians"]), ("p,1", False, 1))
        self.assertEqual((car["id"], car["tracked"], car["category"], car["gaussians"]), ("c=2", True, "vehicle", 1))
        self.assertEqual(len(self.scene.views), 6)
        self.assertEqual(self.scene.views[0]["sensor"], 0)
        self.assertIsNone(self.scene.pose(1, 110.0))
        self.assertEqual(self.scene.track(1).shape, (3, 13))

    def test_lens(self):
        facts = json.loads(read(self.path("scene", "scene.json")))
        facts["cameras"][1]["lens"] = {"kind": "fisheye", "field": 190}
        shutil.copytree(self.path("scene"), self.path("wide"))
        write(self.path("wide", "scene.json"), json.dumps(facts))
        self.assertEqual(
            [view.get("lens") for view in pags.load(self.path("wide")).views[:3]],
            [None, {"kind": "fisheye", "field": 190}, None],
        )
        with self.assertRaises(IndexError):
            self.scene.pose(2, 100.0)

    def test_points(self):
        points, colors = self.scene.points(-1, 100)
        self.assertEqual((points.shape, colors.shape), ((1, 3), (1, 4)))
        self.assertEqual(tuple(floats(points)), (10, 0, 3))
        points, colors = self.scene.points(0, 100)  # the points are in the frame of the object's box
        self.assertAlmostEqual(floats(points)[1], 1.5 - (self.scene.pose(0, 100.0)[7] - ORIGIN[1]), places=4)
        self.assertGreater(floats(colors)[1], 0.9)

    def test_splat_file_and_budget(self):
        self.write("some.ply", ply_bytes(some_splats()))
        scene = pags.load(self.path("some.ply"))
        self.assertEqual((scene.info["gaussians"], scene.objects, scene.views), (40, [], []))
        for budget in (1, 7, 40, 1000):
            self.assertEqual(scene.points(-1, budget)[0].shape[0], min(budget, 40))

    def test_buffers_are_not_copies(self):
        picture = pags.render(self.scene, make_camera())
        view = memoryview(picture.rgba)
        self.assertTrue(view.readonly)
        self.assertEqual((view.format, view.shape, view.ndim), ("f", (101, 101, 4), 3))
        before = view[0, 0, 2]
        del picture  # the memory stays while a view of it exists
        gc.collect()
        self.assertEqual(view[0, 0, 2], before)
        try:
            import numpy
        except ImportError:
            return
        array = numpy.asarray(view)
        self.assertEqual((array.shape, array.dtype, array.flags.owndata), ((101, 101, 4), numpy.float32, False))


def bright_splats():
    """Returns 150 rows of bright balls in front of a camera that looks along x, enough for a packed file with a
    partial cluster. Every fifth ball is too faint for a sample of points. Colours change with the direction by the
    first degree."""
    rows = []
    for i in range(150):
        faint = i % 5 == 0
        at = (10 + (i % 3), 0.4 * (i % 15) - 2.8, 0.4 * (i // 15) - 1.8)
        rgb = [0.15 + 0.7 * ((i * k) % 11) / 10 for k in (1, 3, 7)]
        rows.append(splat(*at, rgb, sigma=0.1 + 0.01 * (i % 4), opacity=-3.0 if faint else 6.0))
    return rows


def first_degree(rows):
    """Returns ply_bytes with the nine coefficients of the first degree."""
    head, body = ply_bytes(rows).split(b"end_header\n", 1)
    names = "".join(f"property float f_rest_{k}\n" for k in range(9)).encode()
    rest = struct.pack("<9f", *(0.02 * k for k in range(-4, 5)))
    return head + names + b"end_header\n" + b"".join(body[68 * i : 68 * i + 68] + rest for i in range(len(rows)))


def compressed_ply(rows):
    """Returns PlayCanvas's compressed PLY: 256 rows per chunk, with values relative to the chunk's bounds."""
    head = ["ply", "format binary_little_endian 1.0", f"element chunk {(len(rows) + 255) // 256}"]
    head += [
        f"property float {end}_{stem}{axis}" for stem in ("", "scale_") for end in ("min", "max") for axis in "xyz"
    ]
    head += [f"element vertex {len(rows)}"]
    head += [f"property uint packed_{name}" for name in ("position", "rotation", "scale", "color")] + ["end_header", ""]
    chunks, vertices = b"", b""

    def packed(values, low, high):
        """Packs three values into 11, 10 and 11 bits."""
        word = 0
        for v, a, b, bits in zip(values, low, high, (11, 10, 11)):
            word = word << bits | round((v - a) / ((b - a) or 1) * ((1 << bits) - 1))
        return word

    for begin in range(0, len(rows), 256):
        group = rows[begin : begin + 256]
        ends = [[[f(r[at + k] for r in group) for k in range(3)] for f in (min, max)] for at in (0, 10)]
        chunks += struct.pack("<12f", *(v for pair in ends for end in pair for v in end))
        for r in group:
            color = 0
            for v in [*(0.5 + 0.28209479 * c for c in r[6:9]), 1 / (1 + math.exp(-r[9]))]:
                color = color << 8 | round(min(max(v, 0), 1) * 255)
            turn = 512 << 20 | 512 << 10 | 512  # w is the largest component; the others are 0
            vertices += struct.pack("<4I", packed(r[:3], *ends[0]), turn, packed(r[10:13], *ends[1]), color)
    return "\n".join(head).encode() + chunks + vertices


def scaled_rows(rows, scale, turn, place):
    """Maps rows of round Gaussians of degree 0 by scale * turn * p + place; turn is a 3 x 3 rotation."""
    out = []
    for r in rows:
        at = [scale * sum(turn[i][k] * r[k] for k in range(3)) + place[i] for i in range(3)]
        out.append([*at, *r[3:10], *(v + math.log(scale) for v in r[10:13]), *r[13:]])
    return out


class SeveralScenes(Case):
    """Compares scenes drawn in one frame with one file that contains them all."""

    TURN = [[0, -1, 0], [0.8, 0, -0.6], [0.6, 0, 0.8]]

    def setUp(self):
        super().setUp()
        make_drive(self.path("drive"))
        self.drive = pags.load(self.path("drive"))
        self.rows = bright_splats()
        self.write("splats.ply", ply_bytes(self.rows))
        self.splats = pags.load(self.path("splats.ply"))
        self.view = {**make_camera(), "world_from_camera": [0, 0, 1, 0, -1, 0, 0, 0, 0, -1, 0, 0]}
        self.place = [6.0, -4.0, -3.1]
        self.pose = [v for i in range(3) for v in (*(0.5 * t for t in self.TURN[i]), self.place[i])]

    def merged(self, *more):
        """Writes the splats and their halved, turned and moved copies into one file. Turning doesn't change round
        Gaussians."""
        self.write("merged.ply", ply_bytes([*self.rows, *scaled_rows(self.rows, 0.5, self.TURN, self.place), *more]))
        return pags.load(self.path("merged.ply"))

    def others(self, **more):
        return [{"scene": self.splats, "world_from_scene": self.pose, **more}]

    def apart(self, a, b):
        return max(abs(x - y) for x, y in zip(floats(a), floats(b)))

    def test_one_frame_by_depth(self):
        whole, wanted = self.merged(), {}
        for outputs in (("rgba",), ("rgba", "depth", "id")):
            wanted = pags.render(whole, self.view, outputs=outputs)
            found = pags.render(self.splats, self.view, outputs=outputs, others=self.others())
            # the file's means are rounded to float once more
            self.assertLess(self.apart(found.rgba, wanted.rgba), 2e-5)
            alone = pags.render(self.splats, self.view, outputs=outputs)
            self.assertGreater(self.apart(alone.rgba, wanted.rgba), 0.3)
        self.assertLess(self.apart(found.depth, wanted.depth), 1e-4)
        ids = [memoryview(p.id).cast("B").cast("i").tolist() for p in (found, wanted)]
        self.assertEqual(*ids)  # the second scene's ids follow those of the first
        self.assertTrue({i for i in ids[0] if i >= len(self.rows)} and {i for i in ids[0] if 0 <= i < len(self.rows)})

    def test_any_number_of_threads_gives_the_same_bits(self):
        one, three = (pags.render(self.splats, self.view, threads=n, others=2 * self.others()) for n in (1, 3))
        self.assertEqual(bytes(one.rgba), bytes(three.rgba))

    def test_far_origin_and_separate_time(self):
        """Draws a street 500 km from zero together with splats at zero, through a pose and with a separate time."""
        drive = {
            "scene": self.drive,
            "world_from_scene": [1, 0, 0, -ORIGIN[0], 0, 1, 0, -ORIGIN[1], 0, 0, 1, -ORIGIN[2]],
        }
        wanted = pags.render(self.drive, make_camera(time=102.0), background=[0, 0, 0])
        self.write("empty.ply", ply_bytes([splat(-50, 0, 0, (1, 1, 1))]))
        found = pags.render(
            pags.load(self.path("empty.ply")), self.view, others=[{**drive, "time": 102.0}], background=[0, 0, 0]
        )
        self.assertLess(self.apart(found.rgba, wanted.rgba), 1e-5)
        early = pags.render(self.drive, make_camera(time=100.0), background=[0, 0, 0])
        self.assertGreater(self.apart(early.rgba, wanted.rgba), 0.5)

    def test_first_scene_provides_the_sky(self):
        moved = [1, 0, 0, ORIGIN[0], 0, 1, 0, ORIGIN[1] - 100, 0, 0, 1, ORIGIN[2]]
        found = pags.render(
            self.drive, make_camera(time=100.0), others=[{"scene": self.splats, "world_from_scene": moved}]
        )
        self.assertEqual(bytes(found.rgba), bytes(pags.render(self.drive, make_camera(time=100.0)).rgba))

    def test_colours_of_two_times(self):
        """Draws one scene twice, at two times. Its car changes colour with time, so each copy has another colour."""
        names = [f"f_dc_t{k}_{c}" for k in range(1, 5) for c in range(3)]
        head, body = ply_bytes([splat(0, 0, 0, (0.5, 0.5, 0.5), sigma=0.1, opacity=12.0)]).split(b"end_header\n", 1)
        values = struct.pack(f"<{len(names)}f", *(1.5 if name.endswith("_0") else 0 for name in names))
        made = head + "".join(f"property float {n}\n" for n in names).encode() + b"end_header\n" + body + values
        self.write(os.path.join("drive", "objects", "car.ply"), made)
        scene = pags.load(self.path("drive"))

        def shown(time, *more):
            return pags.render(
                scene, make_camera(time=time), placements=[(1, scene.pose(1, 101.0))], background=[0, 0, 0], others=more
            )

        beside = list(scene.pose(1, 101.0))
        beside[7] += 2
        early, late = (pixel(shown(t).rgba, 50, 50) for t in (100.0, 101.5))
        self.assertGreater(max(abs(a - b) for a, b in zip(early, late)), 0.1)
        both = shown(100.0, {"scene": scene, "time": 101.5, "placements": [(1, beside)]})
        for value, wanted in zip(pixel(both.rgba, 50, 50) + pixel(both.rgba, 30, 50), early + late):
            self.assertAlmostEqual(value, wanted, delta=1e-5)

    def test_picks_and_values_name_the_scene(self):
        moved = [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0]
        near = [
            0.3,
            0,
            0,
            ORIGIN[0] - 1,
            0,
            0.3,
            0,
            ORIGIN[1] + 0.7,
            0,
            0,
            0.3,
            ORIGIN[2],
        ]  # a ball 2 m in front of the camera
        others = [
            {"scene": self.drive, "world_from_scene": moved, "placements": []},
            {"scene": self.splats, "world_from_scene": near},
        ]
        view = make_camera(time=101.0)
        car = pags.pick(self.drive, view, 50, 50, others=others[:1])
        self.assertEqual((car["scene"], car["id"], car["object"]), (0, 2, 1))
        found = pags.pick(self.drive, view, 20, 50, others=others)
        self.assertEqual((found["scene"], found["object"]), (2, None))
        self.assertLess(found["id"], len(self.rows))
        self.assertAlmostEqual(found["depth"], 0.3 * 10 - 1, delta=0.7)
        twice = [{"scene": self.drive, "object_values": [70, 80], "time": 101.0}]
        picture = pags.render(self.drive, view, outputs=("object",), placements=[], others=twice)
        self.assertEqual(pixel(picture.object, 50, 50, 1)[0], 80)

    def test_modes_of_each_scene(self):
        for mode in ("priority", "critical", "size", "depth"):
            picture = pags.render(
                self.drive,
                make_camera(time=101.0),
                mode=mode,
                outputs=("rgba", "heat", "priority"),
                others=[
                    {
                        "scene": self.splats,
                        "world_from_scene": [1, 0, 0, ORIGIN[0], 0, 1, 0, ORIGIN[1] + 3, 0, 0, 1, ORIGIN[2]],
                    }
                ],
            )
            self.assertEqual(pixel(picture.priority, 50, 50, 1)[0], 1)
            self.assertEqual(min(floats(picture.priority)), 0)
            self.assertGreater(max(pixel(picture.rgba, 50, 50)[:3]), 0.1, mode)

    def test_each_scene_keeps_its_antialiasing(self):
        """A distant ball smaller than a pixel is fainter if its scene uses antialiasing."""
        record = json.loads(fixtures.read(self.path("drive", "scene.json")))
        make_drive(self.path("mip"))
        self.write(os.path.join("mip", "scene.json"), json.dumps({**record, "antialiased": True}))
        mip = pags.load(self.path("mip"))
        self.assertTrue(mip.info["antialiased"])
        far = [1, 0, 0, 300, 0, 1, 0, 0, 0, 0, 1, 0]
        lit = []
        for first, other in ((self.drive, self.drive), (self.drive, mip), (mip, mip)):
            picture = pags.render(
                first,
                make_camera(time=101.0),
                placements=[],
                background=[0, 0, 0],
                others=[{"scene": other, "world_from_scene": far, "time": 101.0}],
            )
            lit.append(max(floats(picture.rgba)[0::4]))
        self.assertLess(lit[1], 0.7 * lit[0])
        self.assertAlmostEqual(lit[1], lit[2], places=6)

    def test_two_renderers_never_wait_for_each_other(self):
        renderers = [pags.Renderer(threads=1), pags.Renderer(threads=1)]
        jobs = []
        for _ in range(40):
            jobs.append(
                renderers[0].submit(self.splats, self.view, others=[{"scene": self.drive}, {"scene": self.splats}])
            )
            jobs.append(renderers[1].submit(self.drive, make_camera(), others=[{"scene": self.splats}]))
        for job in jobs:
            self.assertTrue(job.wait(60))
            job.take()

    def test_wrong_arguments(self):
        for wrong, words in (
            ([{"scene": self.splats, "pose": self.pose}], "nothing else"),
            ([{"world_from_scene": self.pose}], "pags.load"),
            ([{"scene": "splats.ply"}], "pags.load"),
            ([self.splats], "dictionaries"),
            (self.others(time="now"), "number"),
            ([{"scene": self.splats, "world_from_scene": [1, 0, 0, 0] * 3}], "flattens"),
            ([{"scene": self.splats, "world_from_scene": [1, 2, 3]}], "12 numbers"),
            (self.others(placements=[(7, IDENTITY)]), "expected one of the scene's 0 objects"),
            (5, "sequence|len"),
        ):
            with self.assertRaisesRegex((TypeError, ValueError, pags.Error), words):
                pags.render(self.splats, self.view, others=wrong)


class EveryKind(Case):
    """Calls every function of the module on every kind of scene: each gives a correct value or a Python error."""

    @classmethod
    def setUpClass(cls):
        cls.place = cls.shared_folder()
        at = lambda name: os.path.join(cls.place, name)  # noqa: E731
        rows = bright_splats()
        fixtures.write(at("splats.ply"), first_degree(rows))
        fixtures.write(at("flat.ply"), ply_bytes(rows))
        fixtures.write(at("compressed.ply"), compressed_ply(rows))
        fixtures.write(at("empty.ply"), ply_bytes([]))
        make_drive(at("drive"))
        made = [("splats.ply", f"splats.{kind}") for kind in ("spz", "splat", "pagsz")]
        made += [("flat.ply", "flat.pagsz"), ("empty.ply", "empty.pagsz")]
        made += [("drive", f"drive.{kind}") for kind in ("ply", "spz", "splat", "pagsz")]
        for source, target in made:
            done = fixtures.run("export", at(source), at(target))
            if done.returncode != 0 and not source.startswith("empty"):
                raise AssertionError(done.stderr)
        cls.bare = [
            "splats.ply",
            "flat.ply",
            "compressed.ply",
            "splats.spz",
            "splats.splat",
            "splats.pagsz",
            "flat.pagsz",
        ]
        cls.exported = [f"drive.{kind}" for kind in ("ply", "spz", "splat", "pagsz")]
        cls.kinds = [*cls.bare, *cls.exported, "drive"]
        cls.kinds += [n for n in ("empty.ply", "empty.pagsz") if os.path.exists(at(n))]

    def loaded(self, name):
        return pags.load(os.path.join(self.place, name))

    def camera_for(self, name, **more):
        """Returns a camera in front of the splat files or at the drive's place. Files without an origin lie around
        zero."""
        view = make_camera(**more)
        pose, origin = list(view["world_from_camera"]), self.loaded(name).info["origin"]
        for k in range(3):
            pose[4 * k + 3] += origin[k] - ORIGIN[k]
        return {**view, "world_from_camera": pose}

    def test_contents(self):
        for name in self.kinds:
            scene = self.loaded(name)
            folder = name == "drive"
            count = 3 if name.startswith("drive") else 0 if name.startswith("empty") else 150
            self.assertEqual(scene.info["gaussians"], count, name)
            self.assertGreaterEqual(
                scene.info["bytes"], 56 * count if name.endswith((".ply", ".splat")) else 27 * count, name
            )
            self.assertEqual(
                (len(scene.objects), len(scene.views), scene.info["sky"]),
                (2, 6, True) if folder else (0, 0, False),
                name,
            )
            self.assertEqual(sum(o["gaussians"] for o in scene.objects), 2 if folder else 0)
            self.assertEqual(
                scene.info["origin"],
                tuple(ORIGIN) if name.startswith("drive") and name != "drive.splat" else (0, 0, 0),
                name,
            )

    def test_up_axes(self):
        for comment, up in [("Vertical axis: z", "z"), ("Vertical axis: 0 1 0", "y"), ("nothing", "-y")]:
            data = fixtures.ply_bytes(fixtures.some_splats()).replace(
                b"element", b"comment " + comment.encode() + b"\nelement", 1
            )
            path = os.path.join(self.place, "up.ply")
            fixtures.write(path, data)
            self.assertEqual(pags.load(path).info["up"], up)

    def test_objects_and_exposure(self):
        for name in self.kinds:
            scene = self.loaded(name)
            objects = len(scene.objects)
            for call in (scene.pose, lambda i, _: scene.track(i), lambda i, _: scene.points(i, 10)):
                for index in (objects, 1 << 40, -2, 1 << 80):
                    with self.assertRaises(IndexError, msg=name):
                        call(index, 100.0)
                with self.assertRaisesRegex(TypeError, "object"):
                    call("one", 100.0)
            for time_ in (100.0, 1e30, -1e30):
                for index in range(objects):
                    pose = scene.pose(index, time_)
                    self.assertTrue(pose is None or len(pose) == 12)
                self.assertEqual(len(scene.exposure(0, time_)), 6)
            for index in range(objects):
                self.assertEqual(scene.track(index).shape[1], 13)
            for sensor in (-1, 7, 1 << 30):
                self.assertEqual(scene.exposure(sensor, 100.0), (1, 1, 1, 0, 0, 0), name)

    def test_points(self):
        rows = [r for r in bright_splats() if r[9] > 0]
        light = [[((c * 0.28209479 + 0.5 + 0.055) / 1.055) ** 2.4 for c in r[6:9]] for r in rows]
        for name in self.bare:
            scene = self.loaded(name)
            points, colors = scene.points(-1, 1000)
            self.assertEqual((points.shape, colors.shape), ((120, 3), (120, 4)), name)
            points, colors, left = floats(points), floats(colors), set(range(120))
            for i in range(120):
                place, color = points[3 * i : 3 * i + 3].tolist(), colors[4 * i : 4 * i + 4].tolist()
                nearest = min(left, key=lambda k: math.dist(place, rows[k][:3]))
                left.remove(nearest)
                self.assertLess(math.dist(place, rows[nearest][:3]), 5e-3, name)
                self.assertLess(max(abs(a - b) for a, b in zip(color, [*light[nearest], 1])), 0.02, name)
            for most in (-5, 1, 7, 119, 1 << 40):
                self.assertEqual(scene.points(-1, most)[0].shape[0], min(max(most, 1), 120), name)
        for name in self.exported:
            points = floats(self.loaded(name).points(-1, 10)[0]).tolist()
            found = sorted(tuple(round(v, 2) + 0.0 for v in points[3 * i : 3 * i + 3]) for i in range(3))
            self.assertEqual(found, [(10, 0, 3), (10, 1.5, 0), (10, 4, 0)], name)
        for name in ("empty.ply", "empty.pagsz"):
            if name in self.kinds:
                self.assertEqual(self.loaded(name).points(-1, 10)[0].shape, (0, 3))

    def test_drawing(self):
        """Draws every mode and output, alone and combined. All splat files show the PLY's picture."""
        outputs = ("rgba", "depth", "object", "id", "priority", "heat")
        cases = [{"mode": m} for m in ("rgb", "priority", "critical", "depth", "size")]
        cases += [{"outputs": (o,)} for o in outputs] + [{"outputs": outputs, "mode": "size"}]
        cases += [{"early_z": e} for e in ("off", "lossless", "bounded=0.01")]
        cases += [
            {"transparent": True},
            {"linear": True, "flip": True},
            {"cut": 2},
            {"sh_degree": 0},
            {"exp_degree": 3},
            {"antialiased": 1},
        ]
        cases += [
            {"placements": []},
            {"placements": [(-1, IDENTITY)] * 2},
            {"exposure": [2, 2, 2, 0, 0, 0]},
            {"background": [1, 0, 0]},
        ]
        cases += [{"window": (3, 4, 50, 40), "outputs": outputs}, {"near_plane": 10.5}]
        for name in self.kinds:
            scene, view = self.loaded(name), self.camera_for(name)
            renderer = pags.Renderer(threads=2)
            reference, lens = self.loaded("splats.ply"), self.camera_for("splats.ply")
            for arguments in cases:
                job = renderer.submit(scene, view, **arguments)
                job.wait()
                self.assertTrue(job.done())
                picture = job.take()
                planes = [getattr(picture, o) for o in outputs]
                self.assertEqual(
                    [p is not None for p in planes], [o in arguments.get("outputs", ("rgba",)) for o in outputs], name
                )
                background = scene.info["gaussians"] - len(scene.objects)  # each object has one Gaussian
                drawn = (
                    background * len(arguments["placements"]) if "placements" in arguments else scene.info["gaussians"]
                )
                self.assertEqual(picture.stats["gaussians"], drawn, f"{name} {arguments}")
                if name not in ("splats.spz", "splats.splat", "splats.pagsz") or "rgba" not in arguments.get(
                    "outputs", ("rgba",)
                ):
                    continue
                if name == "splats.splat" and arguments.get("sh_degree") != 0:
                    continue  # .splat files have no first degree
                mine, wanted = floats(picture.rgba), floats(pags.render(reference, lens, **arguments).rgba)
                self.assertEqual(len(mine), len(wanted))
                off = sum(abs(a - b) for a, b in zip(mine, wanted)) / len(mine)
                self.assertLess(off, 0.01, f"{name} {arguments}")
            with self.assertRaises(pags.Error):
                pags.render(scene, view, placements=[(7, IDENTITY)])
            jobs = [renderer.submit(scene, {**view, "width": 3000, "height": 3000}), renderer.submit(scene, view)]
            for job in jobs:
                job.cancel()
            for job in jobs:
                try:
                    job.take()  # the picture may be finished before the cancellation
                except pags.Cancelled:
                    pass

    def test_sizes(self):
        """Mode size shows the largest sigma, with the same colours for a packed file and its source."""
        plain, packed = (
            pags.render(self.loaded(n), self.camera_for(n), mode="size", background=[0, 0, 0])
            for n in ("splats.ply", "splats.pagsz")
        )
        off = [abs(a - b) for a, b in zip(floats(plain.rgba), floats(packed.rgba))]
        self.assertLess(sum(off) / len(off), 1e-3)
        self.assertGreater(max(floats(packed.rgba)), 0.5)

    def test_picking(self):
        ball = bright_splats()[112]  # this ball is in the front row
        for name in self.bare:
            scene, view = self.loaded(name), self.camera_for(name)
            x, y = int(50.5 - 100 * ball[1] / ball[0]), int(50.5 - 100 * ball[2] / ball[0])
            found = pags.pick(scene, view, x, y)
            self.assertIsNone(found["object"], name)
            self.assertEqual(found["priority"], 0)
            self.assertAlmostEqual(found["depth"], ball[0], delta=0.05, msg=name)
            self.assertLess(math.dist(found["point"], ball[:3]), 0.15, name)
            self.assertIsNone(pags.pick(scene, view, 0, 0), name)
            self.assertIsNone(pags.pick(scene, view, x, y, placements=[]), name)
            with self.assertRaises(ValueError):
                pags.pick(scene, view, 101, 0)
        for name in [k for k in self.kinds if k not in self.bare]:
            found = pags.pick(self.loaded(name), self.camera_for(name, time=100.0), 35, 50)
            if name.startswith("empty"):
                self.assertIsNone(found)
            else:
                self.assertAlmostEqual(found["depth"], 10, delta=0.05, msg=name)
                self.assertEqual(found["object"], 0 if name == "drive" else None, name)

    def test_broken_packed_files(self):
        whole = fixtures.read(os.path.join(self.place, "splats.pagsz"))
        for size in (0, 7, 8, 127, 128, len(whole) // 2, len(whole) - 1):
            with self.assertRaises(pags.Error) as caught:
                pags.load(self.write("cut.pagsz", whole[:size]))
            self.assertIn("cut.pagsz", str(caught.exception))


class Jobs(ModuleCase):
    def test_submit_done_take(self):
        renderer = pags.Renderer(threads=1)
        jobs = [renderer.submit(self.scene, make_camera(time=100.0 + i / 4)) for i in range(5)]
        pictures = [job.take() for job in jobs]
        self.assertTrue(all(job.done() for job in jobs))
        self.assertEqual([p.width for p in pictures], [101] * 5)
        with self.assertRaises(ValueError):
            jobs[0].take()

    def test_cancelled_and_dropped(self):
        renderer = pags.Renderer(threads=1)
        large = {**make_camera(), "width": 3000, "height": 3000}
        first = renderer.submit(self.scene, large)
        second = renderer.submit(self.scene, make_camera())
        third = renderer.submit(self.scene, make_camera())
        second.cancel()
        self.assertTrue(second.wait(10))
        with self.assertRaises(pags.Cancelled):
            second.take()
        first.cancel()
        del first  # waits for the job's end
        self.assertEqual(third.take().width, 101)
        fourth = renderer.submit(self.scene, large)
        del renderer, fourth
        gc.collect()

    def test_the_lock_is_released(self):
        """Another Python thread runs while this thread waits for a picture."""
        ticks, stop = [], threading.Event()

        def tick():
            while not stop.is_set():
                ticks.append(time.monotonic())
                time.sleep(0.001)

        large = {**make_camera(), "width": 4000, "height": 4000}
        thread = threading.Thread(target=tick)
        thread.start()
        begin = time.monotonic()
        pags.render(self.scene, large, threads=1)
        end = time.monotonic()
        stop.set()
        thread.join()
        self.assertGreater(len([t for t in ticks if begin < t < end]), 3)

    def test_two_renderers_on_one_scene(self):
        renderers = [pags.Renderer(threads=1) for _ in range(3)]
        jobs = [r.submit(self.scene, make_camera(time=101.0)) for _ in range(4) for r in renderers]
        pictures = {bytes(memoryview(job.take().rgba).cast("B")) for job in jobs}
        self.assertEqual(len(pictures), 1)


def resident():
    """Returns the process's memory in use, in bytes."""
    if os.name == "nt":
        import ctypes

        counters = (
            ctypes.c_size_t * 9
        )()  # PROCESS_MEMORY_COUNTERS: two 32-bit numbers, peak and current memory, and others
        counters[0] = ctypes.sizeof(counters)
        kernel = ctypes.windll.kernel32
        kernel.GetCurrentProcess.restype = ctypes.c_void_p
        kernel.K32GetProcessMemoryInfo.argtypes = [ctypes.c_void_p, ctypes.c_void_p, ctypes.c_uint32]
        assert kernel.K32GetProcessMemoryInfo(kernel.GetCurrentProcess(), counters, ctypes.sizeof(counters))
        return counters[2]
    with open("/proc/self/statm") as file:
        return int(file.read().split()[1]) * 4096


class Errors(ModuleCase):
    def test_files(self):
        for path, words in ((self.path("nowhere"), "nowhere"), (self.write("bad.ply", "ply\nwhat\n"), "bad.ply")):
            with self.assertRaises(pags.Error) as caught:
                pags.load(path)
            self.assertIn(words, str(caught.exception))
            self.assertTrue(caught.exception.code)
        with self.assertRaises(TypeError):
            pags.load(3)

    def test_arguments(self):
        renderer = pags.Renderer()
        bad = [
            (dict(mode="what"), ValueError),
            (dict(outputs=("rgba", "what")), ValueError),
            (dict(window=(0, 0, 200, 2)), ValueError),
            (dict(sh_degree=4), ValueError),
            (dict(cut=-1), ValueError),
            (dict(cut=float("nan")), ValueError),
            (dict(object_values=[1]), ValueError),
            (dict(placements=[(0, [1, 2])]), ValueError),
            (dict(background="red"), (ValueError, TypeError)),
        ]
        for keywords, kind in bad:
            with self.assertRaises(kind, msg=str(keywords)):
                renderer.submit(self.scene, make_camera(), **keywords)
        for change in (dict(width=0), dict(fx="a"), dict(world_from_camera=[1] * 11), dict(world_from_camera=[2] * 12)):
            with self.assertRaises((ValueError, TypeError), msg=str(change)):
                renderer.submit(self.scene, {**make_camera(), **change})
        with self.assertRaises(TypeError):
            renderer.submit("scene", make_camera())
        with self.assertRaises(pags.Error) as caught:
            pags.render(self.scene, make_camera(), placements=[(9, IDENTITY)])
        self.assertIn("objects", str(caught.exception))
        with self.assertRaises(ValueError):
            pags.Renderer(threads=-1)
        with self.assertRaises(TypeError):
            pags.Job()

    @unittest.skipIf(SANITIZED, "sanitizers keep what is freed")
    def test_leaks_nothing(self):
        def work():
            for _ in range(20):
                scene = pags.load(self.path("scene"))
                view = {**make_camera(), "width": 400, "height": 400}
                pags.render(scene, view, threads=1, others=[{"scene": scene, "time": 101.0, "object_values": [1, 2]}])
                scene.objects, scene.views, scene.info, scene.points(-1, 10)

        work()
        gc.collect()
        before = resident()
        for _ in range(5):
            work()
        gc.collect()
        self.assertLess(resident() - before, 8 << 20)


@unittest.skipIf(os.name == "nt", "of a module for Windows, scripts/cross_report.py lists what it needs")
class Sweeps(Case):
    """Checks that the module uses the engine's rules for the driving layout."""

    def format(self, **stated):
        self.write("set/dataset.json", json.dumps(stated))
        return pags.sweep_format(self.path("set"))

    def test_kinds(self):
        self.assertEqual(self.format(kind="kitti"), (4, (0, 1, 2), "ego", 3))
        self.assertEqual(self.format(kind="waymo"), (14, (3, 4, 5), "ego", 11))
        self.assertEqual(self.format(kind="nuscenes"), (4, (0, 1, 2), "laser", 3))

    def test_stated_columns_and_frames(self):
        columns = ["y", "x", "z", "intensity"]
        self.assertEqual(self.format(kind="kitti", lidar_columns=columns), (4, (1, 0, 2), "ego", 3))
        self.assertEqual(self.format(kind="kitti", lidar_columns=["x", "y", "z"])[3], -1)
        self.assertEqual(self.format(kind="nuscenes", lidar_frame="world"), (4, (0, 1, 2), "world", 3))

    def test_kinds_by_files(self):
        self.write("set/extrinsics/000_1.txt", "")
        self.assertEqual(self.format()[0], 5)  # PandaSet has 5 columns
        self.write("other/extrinsics/0.txt", "")
        self.write("other/track/track_info.txt", "")
        with self.assertRaisesRegex(pags.Error, "lidar_columns"):
            pags.sweep_format(self.path("other"))

    def test_refusals(self):
        with self.assertRaisesRegex(pags.Error, "dataset.json.*unheard-of"):
            self.format(kind="unheard-of")
        with self.assertRaisesRegex(pags.Error, "dataset.json.*lidar_frame"):
            self.format(kind="kitti", lidar_frame="moon")
        with self.assertRaises(TypeError):
            pags.sweep_format(3)


class Linking(Case):
    @unittest.skipIf(SANITIZED, "sanitizers are libraries")
    def test_depends_only_on_libc(self):
        listed = subprocess.run(["ldd", pags.__file__], capture_output=True, text=True).stdout
        names = {line.split()[0].split("/")[-1] for line in listed.splitlines()}
        allowed = re.compile(r"linux-vdso|libc\.so|libm\.so|libpthread\.so|ld-linux")
        self.assertEqual([name for name in names if not allowed.match(name)], [])

    def test_exports_only_its_init_function(self):
        listed = subprocess.run(["nm", "-D", "--defined-only", pags.__file__], capture_output=True, text=True).stdout
        self.assertEqual([line.split()[-1] for line in listed.splitlines()], ["PyInit_pags"])


class Passes(ModuleCase):
    """Tests the passes (Cryptomatte, normals, motion) through the module, as the C tests do."""

    ALL = ("rgba", "crypto_object", "crypto_class", "normal", "motion")

    def value(self, name):
        return struct.unpack("<f", struct.pack("<I", pags.cryptomatte_hash(name)))[0]

    def test_planes(self):
        view, before = make_camera(time=101.0), make_camera(time=100.0)
        picture = pags.render(self.scene, view, outputs=self.ALL, before=before, after=make_camera(time=102.0))
        plain = pags.render(self.scene, view)
        self.assertEqual(bytes(picture.rgba), bytes(plain.rgba))
        self.assertIsNone(plain.motion)
        self.assertEqual([getattr(picture, o).shape for o in self.ALL[1:]], [(101, 101, n) for n in (12, 12, 3, 4)])
        self.assertEqual(pixel(picture.crypto_object, 50, 50, 12)[0], self.value("c=2"))
        self.assertEqual(pixel(picture.crypto_class, 50, 50, 12)[0], self.value("Car"))
        self.assertEqual(pixel(picture.crypto_object, 35, 50, 12)[0], self.value("p,1"))
        self.assertEqual(pixel(picture.crypto_object, 0, 100, 12), (0,) * 12)
        for got, wanted in zip(pixel(picture.motion, 50, 50), (-39.6, 0, -39.6, 0)):
            self.assertAlmostEqual(got, wanted, delta=0.05)
        self.assertAlmostEqual(sum(v * v for v in pixel(picture.normal, 50, 50, 3)), 1, delta=1e-4)
        self.assertEqual(pags.cryptomatte_hash("bunny"), 0x13851A76)

    def test_counts_of_pairs(self):
        """Counts are available as planes and as colours, independent of alpha. They don't change the picture drawn
        with them."""
        view = make_camera(time=101.0)
        picture = pags.render(self.scene, view, outputs=("rgba", "count", "overdraw"))
        self.assertEqual(
            [pixel(picture.count, x, y, 1)[0] for x, y in ((50, 50), (35, 50), (50, 20), (90, 90))], [1, 1, 1, 0]
        )
        self.assertEqual([pixel(picture.overdraw, x, y, 1)[0] for x, y in ((50, 50), (90, 90))], [1, 0])
        self.assertGreater(sum(floats(picture.overdraw)), sum(floats(picture.count)))
        self.assertEqual(bytes(picture.rgba), bytes(pags.render(self.scene, view).rgba))
        few = pags.render(self.scene, view, mode="count", linear=False)
        # counts of one and zero have the darkest colour
        self.assertEqual(pixel(few.rgba, 50, 50, 4), pixel(few.rgba, 90, 90, 4))
        self.assertIsNone(few.count)

    def test_window_and_flip(self):
        common = dict(outputs=self.ALL, before=make_camera(time=100.0))
        whole = pags.render(self.scene, make_camera(time=101.0), **common)
        part = pags.render(self.scene, make_camera(time=101.0), window=(30, 40, 31, 21), flip=True, **common)
        for name, channels in zip(self.ALL, (4, 12, 12, 3, 4)):
            for x, y in ((0, 0), (20, 10), (30, 20)):
                self.assertEqual(
                    pixel(getattr(part, name), x, 20 - y, channels),
                    pixel(getattr(whole, name), 30 + x, 40 + y, channels),
                )

    def test_names_of_placements(self):
        """Two instances of an object have the given names and separate motion."""
        turned = [0, 1, 0, 0, -1, 0, 0, 0, 0, 0, 1, 0]
        at = lambda y: [
            v + o for v, o in zip(turned, [0, 0, 0, ORIGIN[0] + 10, 0, 0, 0, ORIGIN[1] + y, 0, 0, 0, ORIGIN[2]])
        ]  # noqa: E731
        view = make_camera(time=101.0)
        now, then = [(1, at(0)), (-1, IDENTITY), (1, at(2))], [(1, at(0)), (-1, IDENTITY), (1, at(2.1))]
        picture = pags.render(
            self.scene, view, outputs=self.ALL, placements=now, before=(view, then), names=["a", "rest", "b"]
        )
        for x, name, moved in ((50, "a", 0), (30, "b", -0.99)):
            self.assertEqual(pixel(picture.crypto_object, x, 50, 12)[0], self.value(name))
            self.assertEqual(pixel(picture.crypto_class, x, 50, 12)[0], self.value("Car"))
            self.assertAlmostEqual(pixel(picture.motion, x, 50)[0], moved, delta=2e-3)
            self.assertEqual(pixel(picture.motion, x, 50)[2], 0)
        empty = pags.render(self.scene, view, outputs=("crypto_object", "normal"), placements=[], names=[])
        self.assertEqual(max(floats(empty.crypto_object)), 0)

    def test_several_scenes(self):
        """A disc of another scene, doubled and turned, has its name, class, unit normal and motion. The first
        scene's values stay."""
        disc = [*splat(0, 0, 0, (1, 1, 0), sigma=0.05, opacity=12.0)]
        disc[10] = math.log(1e-3)  # the disc is flat along its x axis
        self.write("disc.ply", ply_bytes([disc]))
        other = {"scene": pags.load(self.path("disc.ply")), "placements": [(-1, IDENTITY)], "names": ["disc"]}
        at = lambda y: [1.2, -1.6, 0, ORIGIN[0] + 10, 1.6, 1.2, 0, ORIGIN[1] + y, 0, 0, 2, ORIGIN[2]]  # noqa: E731
        view = make_camera(time=101.0)
        own = [(-1, IDENTITY), *((i, self.scene.pose(i, 101.0)) for i in range(2))]
        shown, earlier = ({**other, "world_from_scene": at(y)} for y in (-1.5, -1.4))
        plain = pags.render(
            self.scene, view, outputs=self.ALL, placements=own, before=(view, own), names=["rest", "p", "c"]
        )
        picture = pags.render(
            self.scene,
            view,
            outputs=self.ALL,
            placements=own,
            names=["rest", "p", "c"],
            others=[shown],
            before=(view, own, [earlier]),
        )
        for x, name, of_class in ((65, "disc", "background"), (50, "c", "Car"), (35, "p", "Car")):
            self.assertEqual(pixel(picture.crypto_object, x, 50, 12)[0], self.value(name))
            self.assertEqual(pixel(picture.crypto_class, x, 50, 12)[0], self.value(of_class))
        for got, wanted in zip(pixel(picture.normal, 65, 50, 3), (-0.6, -0.8, 0)):
            self.assertAlmostEqual(got, wanted, delta=1e-5)
        self.assertAlmostEqual(pixel(picture.motion, 65, 50)[0], -0.99, delta=3e-3)
        for name, channels in zip(self.ALL, (4, 12, 12, 3, 4)):
            self.assertEqual(
                pixel(getattr(picture, name), 50, 50, channels), pixel(getattr(plain, name), 50, 50, channels)
            )
        still = pags.render(self.scene, view, outputs=("motion",), placements=own, others=[shown], before=(view, own))
        self.assertEqual(max(map(abs, floats(still.motion))), 0)
        own_tracks = pags.render(
            self.scene, view, outputs=("crypto_object",), others=[{k: v for k, v in shown.items() if k[0] in "sw"}]
        )
        self.assertEqual(pixel(own_tracks.crypto_object, 50, 50, 12)[0], self.value("c=2"))
        self.assertEqual(pixel(own_tracks.crypto_object, 65, 50, 12)[0], self.value("background"))
        with self.assertRaisesRegex(ValueError, "isn't in the picture"):
            pags.render(self.scene, view, outputs=("motion",), placements=own, before=(view, own, [earlier]))

    def test_refusals(self):
        view = make_camera()
        for arguments, error, words in (
            (dict(outputs=("motion",)), ValueError, "before or after"),
            (dict(outputs=("motion",), before=(view,)), ValueError, "tuple"),
            (dict(outputs=("motion",), before={**view, "fx": 0}), ValueError, "before"),
            (dict(outputs=("motion",), before=(view, [(9, IDENTITY)])), pags.Error, "placement 0"),
            (dict(names=["a"]), ValueError, "placements"),
            (dict(placements=[(0, IDENTITY)], names=["a", "b"]), ValueError, "list of 1"),
            (dict(placements=[(0, IDENTITY)], names="a"), ValueError, "list of 1"),
        ):
            with self.assertRaisesRegex(error, words):
                pags.render(self.scene, view, **arguments)


if __name__ == "__main__":
    fixtures.main()
