# SPDX-License-Identifier: Apache-2.0
"""Tests the module `pags` with arrays: Gaussians to and from arrays, cameras from matrices, lists of cameras, 8-bit
pictures, signatures and stubs. Gradients are compared with differences and bit by bit with `pags train`. Needs only
Python; tests with numpy run if it is installed."""

import array
import ast
import gc
import inspect
import json
import math
import os
import random
import struct
import subprocess
import sys
import unittest
import warnings

HERE = os.path.dirname(os.path.abspath(__file__))
sys.path.insert(0, os.path.join(HERE, "..", "cli"))
MODULE = sys.argv.pop(2) if len(sys.argv) > 2 else os.environ.get("PAGS_MODULE", "build/python")
sys.path.insert(0, MODULE)

import fixtures  # noqa: E402
import pags  # noqa: E402
from fixtures import Case, ply_bytes, read_png, some_splats  # noqa: E402
from test_drive import make_drive  # noqa: E402
from test_module import SANITIZED, floats, make_camera, resident  # noqa: E402

IDENTITY4 = [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]
NAMES = ("means", "quats", "scales", "opacities", "sh")


def buffer(values, *shape, kind="f"):
    """Returns an array of numbers with a shape, without numpy."""
    return memoryview(array.array(kind, values)).cast("B").cast(kind, shape)


def bits(value):
    return memoryview(value).cast("B").tobytes()


def random_gaussians(count, harmonics=4, seed=1, kind="f"):
    """Returns Gaussians in front of a camera at the origin that looks along z. Their opacity stays below the cap of
    alpha."""
    rng = random.Random(seed)
    normal = lambda n, mean, sigma: [rng.gauss(mean, sigma) for _ in range(n)]  # noqa: E731
    means = [v for _ in range(count) for v in (rng.uniform(-1.2, 1.2), rng.uniform(-0.9, 0.9), rng.uniform(3, 5))]
    return {
        "means": buffer(means, count, 3, kind=kind),
        "quats": buffer(normal(4 * count, 0, 1), count, 4, kind=kind),
        "scales": buffer(normal(3 * count, -1.2, 0.3), count, 3, kind=kind),
        "opacities": buffer(normal(count, 0, 1), count, kind=kind),
        "sh": buffer(normal(3 * harmonics * count, 0, 0.4), count, harmonics, 3, kind=kind),
    }


def front(width=32, height=24):
    return pags.camera(width, height, [[width, 0, width / 2], [0, width, height / 2], [0, 0, 1]], IDENTITY4)


class Arrays(Case):
    def test_round_trip_to_the_bit(self):
        for harmonics in (1, 4, 9, 16):
            given = random_gaussians(257, harmonics)
            given["means"][0, 0], given["sh"][0, 0, 0], given["opacities"][3] = -0.0, 1e-42, -87.5
            given["priorities"] = buffer([i / 256 for i in range(257)], 257)
            scene = pags.Scene(**given)
            taken = scene.arrays()
            self.assertEqual(set(taken), {*NAMES, "priorities"})
            for name, value in given.items():
                self.assertEqual(taken[name].shape, value.shape)
                self.assertEqual(bits(taken[name]), bits(value), name)
            again = pags.Scene(**taken)
            for name in given:
                self.assertEqual(bits(again.arrays()[name]), bits(given[name]), name)
            self.assertEqual(set(memoryview(scene.object_of).tolist()), {-1})
        self.assertEqual(set(pags.Scene(**random_gaussians(3)).arrays()), set(NAMES))

    def test_settings(self):
        scene = pags.Scene(
            **random_gaussians(5), antialiased=True, alpha_min=0.02, background=(0.5, 0.25, 1), origin=(7, 8, 9), up="z"
        )
        info = scene.info
        self.assertEqual(
            (info["antialiased"], info["origin"], info["up"], info["gaussians"]), (True, (7, 8, 9), "z", 5)
        )
        self.assertAlmostEqual(info["alpha_min"], 0.02)
        nothing = pags.render(pags.Scene([], [], [], [], [], background=(0.5, 0.25, 1)), front())
        self.assertEqual(floats(nothing.rgba)[:4].tolist(), [0.5, 0.25, 1, 1])

    def test_other_ways_to_give_numbers(self):
        given = random_gaussians(6)
        wanted = {name: bits(value) for name, value in given.items()}
        doubles = {
            name: buffer(memoryview(value).cast("B").cast("f").tolist(), *value.shape, kind="d")
            for name, value in given.items()
        }
        lists = {name: value.tolist() for name, value in given.items()}
        spread = [v for pair in zip(given["opacities"], given["opacities"]) for v in pair]
        strided = {**given, "opacities": memoryview(array.array("f", spread))[::2]}
        for other in (doubles, lists, strided):
            taken = pags.Scene(**other).arrays()
            self.assertEqual({name: bits(taken[name]) for name in NAMES}, wanted)
        whole = pags.Scene([[0, 0, 5]], [[1, 0, 0, 0]], [[-2, -2, -2]], [3], [[[1, 0, -1]]])
        self.assertEqual(floats(whole.arrays()["sh"]).tolist(), [1, 0, -1])

    def test_files(self):
        given = random_gaussians(200, 9)
        scene = pags.Scene(**given, antialiased=True, origin=(100, 200, 300), up="z")
        scene.save(self.path("a.ply"))
        loaded = pags.load(self.path("a.ply"))
        self.assertEqual({n: bits(v) for n, v in loaded.arrays().items()}, {n: bits(v) for n, v in given.items()})
        self.assertEqual([loaded.info[k] for k in ("antialiased", "origin", "up")], [True, (100, 200, 300), "z"])
        loaded.save(self.path("b.PLY"))
        self.assertEqual(fixtures.read(self.path("a.ply")), fixtures.read(self.path("b.PLY")))
        scene.save(self.path("a.pagsz"))
        packed = pags.load(self.path("a.pagsz"))
        mine, wanted = (sorted(floats(s.arrays()["opacities"])) for s in (packed, scene))
        self.assertLess(max(abs(a - b) for a, b in zip(mine, wanted)), 3e-4)  # pags/packed.h allows an error of 2.5e-4
        for name, words in (("a.spz", "pags export"), ("a", "pags export")):
            with self.assertRaisesRegex(ValueError, words):
                scene.save(self.path(name))
        with self.assertRaisesRegex(pags.Error, "a.ply"):
            scene.save(self.path("no", "a.ply"))
        pags.Scene(**random_gaussians(3), alpha_min=0.0196).save(self.path("least.ply"))
        self.assertAlmostEqual(pags.load(self.path("least.ply")).info["alpha_min"], 0.0196)

    def test_doubles_far_away(self):
        """Means far from the origin keep their digits as doubles, in arrays and files and with a scene of another
        origin."""
        place = (512345.0, -4612345.0, 100.0)
        near, far = random_gaussians(150, kind="d"), random_gaussians(150, kind="d")
        for i in range(150):
            for k in range(3):
                far["means"][i, k] += place[k]
        far["means"][7, 0] = 1e15  # one distant outlier changes nothing
        near["means"][7, 0] = 1e15 - place[0]
        scene = pags.Scene(**far)
        origin = scene.info["origin"]
        self.assertEqual(origin[2], 0)
        self.assertLess(max(abs(a - b) for a, b in zip(origin, place)), 101)
        there = pags.camera(
            32,
            24,
            [[32, 0, 16], [0, 32, 12], [0, 0, 1]],
            [[int(i == k) if k < 3 else place[i] for k in range(4)] for i in range(3)],
        )
        wanted = floats(pags.render(pags.Scene(**near), front()).rgba)
        close = lambda picture: self.assertLess(max(abs(a - b) for a, b in zip(floats(picture.rgba), wanted)), 1e-3)  # noqa: E731
        close(pags.render(scene, there))
        scene.save(self.path("far.ply"))
        close(pags.render(pags.load(self.path("far.ply")), there))
        head = "".join(
            f"property {'double' if n in 'xyz' else 'float'} {n}\n"
            for n in ["x", "y", "z", *(f"f_dc_{k}" for k in range(3))]
        )
        head += "".join(
            f"property float {n}\n"
            for n in ["opacity", *(f"scale_{k}" for k in range(3)), *(f"rot_{k}" for k in range(4))]
        )
        rows = [
            struct.pack(
                "<3d11f",
                *far["means"].tolist()[i],
                *far["sh"].tolist()[i][0],
                far["opacities"][i],
                *far["scales"].tolist()[i],
                *far["quats"].tolist()[i],
            )
            for i in range(150)
        ]
        self.write(
            "double.ply",
            f"ply\nformat binary_little_endian 1.0\nelement vertex 150\n{head}end_header\n".encode() + b"".join(rows),
        )
        double = pags.load(self.path("double.ply"))
        self.assertEqual(double.info["origin"], origin)
        flat = {**near, "sh": buffer([v for row in near["sh"].tolist() for v in row[0]], 150, 1, 3)}
        wanted = floats(pags.render(pags.Scene(**flat), front()).rgba)
        close(pags.render(double, there))
        # this Gaussian is behind the camera
        elsewhere = [[0.0, 0.0, -1000.0]], [[1, 0, 0, 0]], [[-3, -3, -3]], [1], [[[0, 0, 0]]]
        pose = [1, 0, 0, -place[0], 0, 1, 0, -place[1], 0, 0, 1, -place[2]]
        close(pags.render(pags.Scene(*elsewhere), front(), others=[{"scene": double, "world_from_scene": pose}]))
        self.assertEqual(
            pags.Scene([[5e6, 0, 0]], *elsewhere[1:]).info["origin"], (0, 0, 0)
        )  # a float stores 5e6 exactly
        self.assertEqual(pags.Scene([[5e6 + 0.1, 0, 0]], *elsewhere[1:], origin=(1, 2, 3)).info["origin"], (1, 2, 3))

    def test_quaternions_of_any_length(self):
        given = random_gaussians(40)
        wanted = bits(pags.render(pags.Scene(**given), front()).rgba)
        for power in (-110, -60, 60, 110):
            quats = buffer([math.ldexp(v, power) for v in memoryview(given["quats"]).cast("B").cast("f")], 40, 4)
            self.assertEqual(bits(pags.render(pags.Scene(**{**given, "quats": quats}), front()).rgba), wanted, power)

    def test_arrays_of_a_scene_folder(self):
        """Rows are numbered by id, as in pictures and picks. Rows of a tracked object are in the object's frame."""
        make_drive(self.path("scene"))
        scene = pags.load(self.path("scene"))
        arrays = scene.arrays()
        self.assertEqual(memoryview(scene.object_of).tolist(), [-1, 0, 1])
        self.assertEqual(memoryview(arrays["means"]).tolist()[0], [10, 0, 3])
        self.assertEqual(memoryview(arrays["means"]).tolist()[2], [0, 0, 0])
        with self.assertRaisesRegex(ValueError, "pags export"):
            scene.save(self.path("scene.ply"))

    def test_arrays_draw_the_same_as_the_file(self):
        self.write("some.ply", ply_bytes(some_splats()))
        scene, view = (
            pags.load(self.path("some.ply")),
            {**front(), "world_from_camera": [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, -4]},
        )
        self.assertEqual(
            bits(pags.render(scene, view).rgba), bits(pags.render(pags.Scene(**scene.arrays()), view).rgba)
        )
        self.assertGreater(max(floats(pags.render(scene, view).rgba)[0::4]), 0.5)

    def test_normals(self):
        half = math.sqrt(0.5)
        scene = pags.Scene(
            [[0, 0, 5]] * 3,
            [[1, 0, 0, 0], [2 * half, 0, 2 * half, 0], [half, half, 0, 0]],
            [[0, 0, -1], [-3, 0, 0], [0, -1, 0]],
            [0] * 3,
            [[[0] * 3]] * 3,
        )
        for found, wanted in zip(memoryview(scene.normals()).tolist(), ([0, 0, 1], [0, 0, -1], [0, 0, 1])):
            for a, b in zip(found, wanted):
                self.assertAlmostEqual(a, b, delta=1e-6)

    def test_wrong_arrays(self):
        good = {**random_gaussians(3), "priorities": [0, 0.5, 1]}
        nan, infinite = float("nan"), float("inf")
        bad = [
            (dict(means=[[1, 2]] * 3), r"means.*\[n\]\[3\].*\[3\]\[2\]"),
            (dict(means=5), "means.*no array"),
            (dict(means="abc"), "means"),
            (dict(means=[[1, 2, 3], [1, 2], [1, 2, 3]]), "same length"),
            (dict(means=[[1, 2, 3], [1, nan, 2], [1, 2, 3]]), "means: row 1"),
            (dict(means=[[1, 2, 3], [1, 1e300, 2], [1, 2, 3]]), "means: row 1"),
            (dict(quats=[[1, 0, 0, 0]] * 2), r"quats.*\[3\]\[4\].*\[2\]\[4\]"),
            (dict(quats=[[1, 0, 0, 0], [1, 0, 0, 0], [0, 0, 0, 0]]), "quats: row 2"),
            (dict(scales=buffer([0] * 9, 9)), r"scales.*\[3\]\[3\].*\[9\]"),
            (dict(scales=[[infinite] * 3] * 3), "scales: row 0"),
            (dict(opacities=[[1], [1], [1]]), r"opacities.*\[3\].*\[3\]\[1\]"),
            (dict(sh=[[[0] * 3] * 5] * 3), "k = 5"),
            (dict(sh=[[[0] * 3] * 17] * 3), "k = 17"),
            (dict(sh=[[[]]] * 3), "sh"),
            (dict(sh=[[[0, 0, nan]]] * 3), "sh: row 0"),
            (dict(priorities=[0, 0.5, 1.5]), "priorities: row 2"),
            (dict(priorities=[0]), r"priorities.*\[3\].*\[1\]"),
            (dict(alpha_min=0.001), "alpha_min"),
            (dict(alpha_min=1), "alpha_min"),
            (dict(up="x"), "up.*found x"),
            (dict(background=(0, 0)), "background"),
            (dict(origin=(0, 0, nan)), "origin"),
        ]
        for change, words in bad:
            with self.assertRaisesRegex((ValueError, TypeError), words, msg=str(change)):
                pags.Scene(**{**good, **change})
        for change in (dict(means=[["a", "b", "c"]] * 3), dict(nothing=1)):
            with self.assertRaises(TypeError):
                pags.Scene(**{**good, **change})
        with self.assertRaises(TypeError):
            pags.Scene()


class Cameras(Case):
    K = [[60, 0, 30], [0, 61, 20], [0, 0, 1]]

    def test_forms_of_one_camera(self):
        turn = [[0.6, -0.8, 0, 1], [0.8, 0.6, 0, 2], [0, 0, 1, 3]]
        plain = pags.camera(64, 48, self.K, turn)
        self.assertEqual(plain["world_from_camera"], tuple(v for row in turn for v in row))
        self.assertEqual([plain[k] for k in ("width", "height", "fx", "fy", "cx", "cy")], [64, 48, 60, 61, 30, 20])
        self.assertNotIn("time", plain)
        inverse = [[0.6, 0.8, 0, -2.2], [-0.8, 0.6, 0, -0.4], [0, 0, 1, -3], [0, 0, 0, 1]]
        upright = [[row[0], -row[1], -row[2], row[3]] for row in turn]
        forms = [
            dict(world_from_camera=[*turn, [0, 0, 0, 1]]),
            dict(world_from_camera=sum(turn, [])),
            dict(world_from_camera=buffer(sum(turn, []), 3, 4, kind="d")),
            dict(camera_from_world=inverse),
            dict(world_from_camera=upright, axes="opengl"),
            dict(camera_from_world=[inverse[0], [-v for v in inverse[1]], [-v for v in inverse[2]]], axes="opengl"),
        ]
        for form in forms:
            camera = pags.camera(64, 48, buffer(sum(self.K, []), 3, 3, kind="d"), **form)
            for a, b in zip(camera["world_from_camera"], plain["world_from_camera"]):
                self.assertAlmostEqual(a, b, delta=1e-12, msg=str(form))
        self.assertEqual(pags.camera(64, 48, self.K, turn, time=2.5)["time"], 2.5)

    def test_camera_dictionary_with_a_matrix(self):
        scene, flat = pags.Scene(**random_gaussians(50)), front()
        wanted = bits(pags.render(scene, flat).rgba)
        for matrix in (IDENTITY4, IDENTITY4[:3], buffer(sum(IDENTITY4, []), 4, 4)):
            self.assertEqual(bits(pags.render(scene, {**flat, "world_from_camera": matrix}).rgba), wanted)
        self.assertEqual(bits(pags.render(scene, flat, placements=[(-1, IDENTITY4)]).rgba), wanted)

    def test_hundred_cameras_in_one_call(self):
        """One call for a hundred cameras of different sizes draws the same pictures as a hundred calls."""
        scene = pags.Scene(**random_gaussians(60))
        poses = [[*IDENTITY4[:2], [0, 0, 1, -0.02 * i]] for i in range(100)]
        cameras = [
            pags.camera(20 + i % 7, 16, [[20, 0, 10], [0, 20, 8], [0, 0, 1]], pose) for i, pose in enumerate(poses)
        ]
        pictures = pags.render(scene, cameras, outputs=("rgba", "depth"), threads=2)
        self.assertEqual(len({bits(p.rgba) for p in pictures}), 100)
        for camera, picture in zip(cameras, pictures):
            self.assertEqual(picture.width, camera["width"])
            self.assertEqual(bits(picture.rgba), bits(pags.render(scene, camera, threads=1).rgba))
        self.assertEqual(pags.render(scene, []), [])
        self.assertEqual(len(pags.render(scene, tuple(cameras[:3]))), 3)
        with self.assertRaises((ValueError, pags.Error)) as caught:
            pags.render(scene, [*cameras[:5], {**cameras[5], "fx": -1}])
        self.assertIn("camera 5", " ".join(caught.exception.__notes__))

    def test_wrong_cameras(self):
        bad = [
            (dict(K=[[1, 0], [0, 1]]), r"K.*\[3\]\[3\].*\[2\]\[2\]"),
            (dict(K=[[60, 1, 30], [0, 60, 20], [0, 0, 1]]), "skew"),
            (dict(K=[[0, 0, 30], [0, 60, 20], [0, 0, 1]]), "focal|fx"),
            (dict(width=0), "width|size|pixels"),
            (dict(world_from_camera=None), "one of"),
            (dict(camera_from_world=IDENTITY4), "one of"),
            (dict(world_from_camera=[[1, 0, 0, 0]] * 2), "3 x 4"),
            (dict(world_from_camera=[*IDENTITY4[:3], [0, 0, 1, 1]]), "last row"),
            (dict(world_from_camera=[[2, 0, 0, 0], *IDENTITY4[1:3]]), "world_from_camera"),
            (dict(axes="blender"), "axes"),
        ]
        for change, words in bad:
            with self.assertRaisesRegex(ValueError, words, msg=str(change)):
                pags.camera(**{"width": 64, "height": 48, "K": self.K, "world_from_camera": IDENTITY4, **change})


class Pictures(Case):
    def test_bytes_equal_those_of_the_program(self):
        make_drive(self.path("scene"))
        scene = pags.load(self.path("scene"))
        view = make_camera(time=101.0)
        self.write("camera.json", json.dumps(fixtures_camera()))
        self.succeeds("render", self.path("scene"), "--camera", self.path("camera.json"), "-o", self.path("out"))
        wanted = read_png(self.path("out", "00000.png"))[4]
        for more in ({}, {"linear": True}, {"outputs": ("rgb8", "rgba")}, {"outputs": ("rgb8", "depth")}):
            picture = pags.render(scene, view, **{"outputs": ("rgb8",), **more})
            self.assertEqual(picture.rgb8.shape, (101, 101, 3))
            self.assertEqual(memoryview(picture.rgb8).format, "B")
            self.assertEqual(bits(picture.rgb8), wanted, str(more))
        flipped = bits(pags.render(scene, view, outputs=("rgb8",), flip=True).rgb8)
        self.assertEqual(flipped, b"".join(wanted[303 * y : 303 * y + 303] for y in range(100, -1, -1)))
        shown = pags.render(scene, view, outputs=("rgb8", "rgba"), mode="priority")
        values = floats(shown.rgba)
        self.assertEqual(
            list(bits(shown.rgb8)), [int(values[4 * i + c] * 255 + 0.5) for i in range(101 * 101) for c in range(3)]
        )


def fixtures_camera():
    from test_drive import camera

    return camera(0.0, time=101.0)


class Gradients(Case):
    def loss_gradient(self, camera, channels, seed):
        """Returns waves over the picture, with another wavelength in each channel."""
        width, height = camera["width"], camera["height"]
        waves = [
            math.sin(seed + 0.3 * c * x + 0.2 * y) for y in range(height) for x in range(width) for c in range(channels)
        ]
        return buffer(waves, height, width, channels)

    def check_differences(self, weights, loss, names=NAMES, **options):
        """Compares all gradients of 8 Gaussians of the first degree with central differences (step 0.002). A minimum
        alpha avoids jumps of pixels. Rounding to floats and kinks at the Gaussians' edges remain: 2 % of the
        differences' length is allowed, 0.1 % was measured. A wrong factor, sign or place exceeds this."""
        camera, given = front(), random_gaussians(8, 4, seed=5)
        gradients = pags.gradients(pags.Scene(**given, alpha_min=0.02), camera, weights, **options)
        lists = {name: memoryview(value).cast("B").cast("f").tolist() for name, value in given.items()}

        def value(name, at, step):
            moved = list(lists[name])
            moved[at] += step
            return loss(pags.Scene(**{**given, name: buffer(moved, *given[name].shape)}, alpha_min=0.02), camera)

        for name in names:
            found, step = floats(gradients[name]).tolist(), 0.002
            wanted = [(value(name, i, step) - value(name, i, -step)) / (2 * step) for i in range(len(found))]
            self.assertEqual(gradients[name].shape, given[name].shape)
            error, length = math.dist(found, wanted), math.hypot(*wanted)
            self.assertLess(error, 0.02 * length, name)
            self.assertGreater(length, 0)

    def test_differences_of_colour(self):
        weights = self.loss_gradient(front(), 3, 1)
        flat = memoryview(weights).cast("B").cast("f").tolist()

        def loss(scene, camera):
            rgba = floats(pags.render(scene, camera, background=(0.2, 0.4, 0.6)).rgba)
            return sum(w * rgba[4 * (i // 3) + i % 3] for i, w in enumerate(flat))

        self.check_differences(weights, loss, background=(0.2, 0.4, 0.6))

    def test_differences_of_alpha(self):
        weights = self.loss_gradient(front(), 4, 2)
        flat = memoryview(weights).cast("B").cast("f").tolist()

        def loss(scene, camera):
            return sum(w * v for w, v in zip(flat, floats(pags.render(scene, camera, transparent=True).rgba)))

        self.check_differences(weights, loss, transparent=True)

    def test_differences_of_depth(self):
        """Compares gradients of depth. Pixels with little alpha are left out, since their depth, a quotient, changes
        fast."""
        camera = front()
        scene = pags.Scene(**random_gaussians(8, 4, seed=5), alpha_min=0.02)
        covered = floats(pags.render(scene, camera, transparent=True).rgba)[3::4]
        flat = [math.sin(i / 20) if alpha > 0.3 else 0.0 for i, alpha in enumerate(covered)]
        nothing = buffer([0] * (3 * len(flat)), camera["height"], camera["width"], 3)

        def loss(other, lens):
            return sum(w * v for w, v in zip(flat, floats(pags.render(other, lens, outputs=("depth",)).depth)))

        self.assertEqual(max(map(abs, floats(pags.gradients(scene, camera, nothing)["means"]))), 0)
        depth = buffer(flat, camera["height"], camera["width"])
        self.check_differences(nothing, loss, ("means", "quats", "scales", "opacities"), depth=depth)

    def test_alpha_of_an_opaque_picture_has_none(self):
        camera, scene = front(), pags.Scene(**random_gaussians(20))
        rgba = self.loss_gradient(camera, 4, 3)
        flat = memoryview(rgba).cast("B").cast("f").tolist()
        rgb = buffer([v for i, v in enumerate(flat) if i % 4 < 3], camera["height"], camera["width"], 3)
        a, b = pags.gradients(scene, camera, rgba), pags.gradients(scene, camera, rgb)
        self.assertEqual([floats(a[n]).tolist() for n in NAMES], [floats(b[n]).tolist() for n in NAMES])

    def test_threads_and_order_change_no_bit(self):
        camera, given = front(64, 48), random_gaussians(500, 9)
        weights = self.loss_gradient(camera, 3, 4)
        scene = pags.Scene(**given)
        found = [pags.gradients(scene, camera, weights, threads=n) for n in (1, 2, 5)]
        for other in found[1:]:
            self.assertEqual([bits(other[n]) for n in NAMES], [bits(found[0][n]) for n in NAMES])
        back = pags.gradients(pags.Scene(**{n: v.tolist()[::-1] for n, v in given.items()}), camera, weights)
        for name in NAMES:
            self.assertEqual(memoryview(back[name]).tolist()[::-1], memoryview(found[0][name]).tolist(), name)

    def test_objects_and_what_is_out_of_view(self):
        make_drive(self.path("scene"))
        scene, view = pags.load(self.path("scene")), make_camera(time=101.0)
        ones = buffer([1] * (3 * 101 * 101), 101, 101, 3)
        dc = memoryview(pags.gradients(scene, view, ones)["sh"]).tolist()
        self.assertTrue(all(max(dc[row][0]) > 1 for row in range(3)), dc)  # each Gaussian covers pixels
        alone = memoryview(pags.gradients(scene, view, ones, placements=[(1, scene.pose(1, 101.0))])["sh"]).tolist()
        self.assertEqual([max(row[0]) > 1 for row in alone], [False, False, True])
        self.assertEqual(alone[0][0], [0, 0, 0])
        pose = list(scene.pose(1, 101.0))
        pose[11] += 2
        with self.assertRaisesRegex(pags.Error, "twice"):
            pags.gradients(scene, view, ones, placements=[(1, scene.pose(1, 101.0)), (1, pose)])

    def test_wrong_gradients(self):
        camera, scene = front(), pags.Scene(**random_gaussians(5))
        good = self.loss_gradient(camera, 3, 1)
        spoiled = buffer(memoryview(good).cast("B").cast("f").tolist(), 24, 32, 3)
        spoiled[3, 2, 1] = float("nan")
        bad = [
            ((scene, camera, spoiled), {}, ValueError, r"rgb: pixel \(2, 3\)"),
            ((scene, camera, self.loss_gradient(front(33, 24), 3, 1)), {}, ValueError, r"\[24\]\[32\]"),
            ((scene, camera, self.loss_gradient(camera, 2, 1)), {}, ValueError, "3 or 4 channels"),
            ((scene, camera, good), dict(depth=good), ValueError, r"depth.*\[24\]\[32\]"),
            ((scene, camera, good), dict(threads=-1), ValueError, "threads"),
            ((scene, camera, good), dict(sh_degree=4), ValueError, "sh_degree"),
            ((scene, camera), {}, TypeError, "rgb"),
            ((5, camera, good), {}, TypeError, "scene"),
        ]
        for arguments, more, kind, words in bad:
            with self.assertRaisesRegex(kind, words):
                pags.gradients(*arguments, **more)
        scene.save(self.path("a.pagsz"))
        with self.assertRaisesRegex(pags.Error, "packed"):
            pags.gradients(pags.load(self.path("a.pagsz")), camera, good)

    def test_infinite_gradients_are_reported(self):
        """Gradients that overflow cause a warning and stay finite."""
        camera, scene = front(), pags.Scene(**random_gaussians(5))
        huge = buffer([3e38] * (24 * 32 * 3), 24, 32, 3)
        with warnings.catch_warnings(record=True) as caught:
            warnings.simplefilter("always")
            gradients = pags.gradients(scene, camera, huge)
        self.assertRegex(str(caught[0].message), r"gradients of [1-5] Gaussians")
        self.assertTrue(all(math.isfinite(v) for v in floats(gradients["means"])))
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            with self.assertRaises(RuntimeWarning):
                pags.gradients(scene, camera, huge)


def sections(checkpoint):
    """Returns the payloads of a checkpoint (engine/train/checkpoint.h) by tag."""
    at, found = 8, {}
    while at < len(checkpoint):
        (size,) = struct.unpack("<Q", checkpoint[at + 4 : at + 12])
        found[checkpoint[at : at + 4]] = checkpoint[at + 12 : at + 12 + size]
        at += 16 + size
    return found


def planes(arrays):
    """Returns the planes of pags/gaussians.h as lists: means, scales, quats, opacity, harmonics."""
    return [
        floats(arrays[name])[k::width].tolist()
        for name in ("means", "scales", "quats", "opacities", "sh")
        for width in [math.prod(arrays[name].shape[1:])]
        for k in range(width)
    ]


class Trainer(Case):
    """Compares gradients with training. With beta1 = 0, the checkpoint of `pags train` stores the last step's
    gradient as Adam's first moment. A run with one step less and the same schedule ends with the parameters before
    that step."""

    WIDTH, HEIGHT, STEPS = 48, 40, 20

    def train(self, steps):
        out = self.path(f"scene{steps}")
        fields = "ssim_weight=0 beta1=0 schedule_iterations=30000 sh_interval=0 scale_rate=0.05 rotation_rate=0.05 sh_rest_rate=0.01"
        settings = [word for field in f"{fields} quarter_until=0 half_until=0".split() for word in ("--set", field)]
        self.succeeds(
            "train",
            self.path("data"),
            "-o",
            out,
            "-n",
            steps,
            "--reconstruction",
            "--no-exposure",
            "--random-points",
            300,
            *settings,
        )
        return out

    def test_gradients_equal_those_of_training(self):
        rng = random.Random(3)
        pixels = bytes(rng.randrange(256) for _ in range(3 * self.WIDTH * self.HEIGHT))
        self.write("data/view.png", fixtures.png_bytes(self.WIDTH, self.HEIGHT, pixels))
        view = {"file_path": "view.png", "transform_matrix": IDENTITY4}
        lens = {"w": self.WIDTH, "h": self.HEIGHT, "fl_x": 50, "fl_y": 50, "cx": self.WIDTH / 2, "cy": self.HEIGHT / 2}
        self.write("data/transforms.json", json.dumps({**lens, "frames": [view]}))
        moment = memoryview(
            sections(fixtures.read(os.path.join(self.train(self.STEPS), "checkpoint.pags")))[b"MOM1"]
        ).cast("f")
        scene = pags.load(self.train(self.STEPS - 1))
        K = [[50, 0, lens["cx"]], [0, 50, lens["cy"]], [0, 0, 1]]
        camera = pags.camera(self.WIDTH, self.HEIGHT, K, IDENTITY4, axes="opengl")
        copy = pags.Scene(**scene.arrays(), alpha_min=scene.info["alpha_min"])
        for other in (scene, copy):
            rgba, single = floats(pags.render(other, camera).rgba), lambda v: struct.unpack("f", struct.pack("f", v))[0]
            scale = single(1 / (3 * self.WIDTH * self.HEIGHT))  # the L1 loss is a mean over pixels and channels
            signs = [
                (rgba[4 * (i // 3) + i % 3] > single(p / 255)) - (rgba[4 * (i // 3) + i % 3] < single(p / 255))
                for i, p in enumerate(pixels)
            ]
            gradients = pags.gradients(other, camera, buffer([scale * s for s in signs], self.HEIGHT, self.WIDTH, 3))
            count, mine = scene.info["gaussians"], planes(gradients)
            self.assertEqual(len(mine), 59)
            for plane, values in enumerate(mine):
                self.assertEqual(values, moment[plane * count : (plane + 1) * count].tolist(), plane)
            self.assertTrue(all(any(values) for values in mine))


class Surface(Case):
    """Compares the stub with the module, for editors and type checkers."""

    def test_stub_is_the_module(self):
        with open(os.path.join(HERE, "..", "..", "blender_addon", "native", "pags.pyi"), encoding="utf-8") as file:
            tree = ast.parse(file.read())
        checked = set()

        def compare(function, real):
            """Compares names, kinds and defaults of the parameters, except for self and cls."""
            a = function.args
            kinds = [
                (inspect.Parameter.POSITIONAL_ONLY, a.posonlyargs),
                (inspect.Parameter.POSITIONAL_OR_KEYWORD, a.args),
                (inspect.Parameter.KEYWORD_ONLY, a.kwonlyargs),
            ]
            plain = [*a.posonlyargs, *a.args]
            defaults = dict(zip([p.arg for p in plain[len(plain) - len(a.defaults) :]], a.defaults))
            defaults.update({p.arg: d for p, d in zip(a.kwonlyargs, a.kw_defaults) if d is not None})
            wanted = [(p.arg, kind) for kind, group in kinds for p in group if p.arg not in ("self", "cls")]
            found = [p for p in inspect.signature(real).parameters.values() if p.name != "self"]
            self.assertEqual([(p.name, p.kind) for p in found], wanted, real)
            values = {name: ast.literal_eval(value) for name, value in defaults.items()}
            self.assertEqual({p.name: p.default for p in found if p.default is not p.empty}, values, real)
            checked.add(function.name)

        for node in tree.body:
            if isinstance(node, ast.FunctionDef):
                compare(node, getattr(pags, node.name))
            if isinstance(node, ast.ClassDef) and hasattr(pags, node.name):
                members = {n for n in dir(getattr(pags, node.name)) if not n.startswith("_")}
                listed = {n.name for n in node.body if isinstance(n, ast.FunctionDef) and not n.name.startswith("__")}
                if not issubclass(getattr(pags, node.name), Exception):
                    self.assertEqual(members, listed, node.name)
                for method in (n for n in node.body if isinstance(n, ast.FunctionDef) and not n.decorator_list):
                    if method.name == "__new__":
                        compare(method, getattr(pags, node.name))
                    elif not method.name.startswith("__"):
                        compare(method, getattr(getattr(pags, node.name), method.name))
        self.assertLessEqual(
            {"load", "render", "gradients", "camera", "pick", "submit", "arrays", "save", "__new__"}, checked
        )
        public = {n for n in dir(pags) if not n.startswith("_")}
        declared = {
            n.name for n in tree.body if isinstance(n, (ast.FunctionDef, ast.ClassDef)) and not n.name.startswith("_")
        }
        self.assertEqual(public - declared, set())
        self.assertTrue(os.path.exists(os.path.join(MODULE, "pags.pyi")))

    def test_version_and_reprs(self):
        self.assertRegex(pags.__version__, r"^\d+\.\d+\.\d+$")
        scene, renderer = pags.Scene(**random_gaussians(7)), pags.Renderer(threads=2)
        job = renderer.submit(scene, front(), outputs=("rgba", "depth"))
        job.wait()
        texts = [repr(job)]
        picture = job.take()
        texts += [repr(job), repr(scene), repr(renderer), repr(picture), repr(picture.rgba), repr(scene.object_of)]
        wanted = [
            "<pags.Job 32 x 24, done>",
            "<pags.Job 32 x 24, taken>",
            "<pags.Scene of 7 Gaussians, 0 objects, 0 views>",
        ]
        wanted += ["<pags.Renderer of 2 threads>", "<pags.Picture 32 x 24 of rgba, depth>"]
        wanted += ["<pags.Buffer [24][32][4] of float32>", "<pags.Buffer [7] of int32>"]
        self.assertEqual(texts, wanted)


class Memory(Case):
    def test_buffers_are_released(self):
        """Buffers are released after success and after errors. An array can't grow while a buffer of it is held."""
        opacities = array.array("f", [0, 0, 0])
        given = {**random_gaussians(3), "opacities": opacities}
        pags.Scene(**given)
        opacities.append(1)
        for _ in range(2):
            with self.assertRaises(ValueError):
                pags.Scene(**given)
            opacities.append(1)
        K = array.array("d", [1] * 9)
        with self.assertRaises(ValueError):
            pags.camera(4, 4, K, IDENTITY4)
        K.append(1)

    @unittest.skipIf(SANITIZED, "sanitizers keep what is freed")
    def test_leaks_nothing(self):
        given, camera = random_gaussians(5000, 16), front(480, 360)  # each plane has 0.7 MB
        weights, depth = buffer([1] * (3 * 480 * 360), 360, 480, 3), buffer([0] * (480 * 360), 360, 480)
        spoiled = {**given, "opacities": buffer([float("inf")] * 5000, 5000)}
        nested = [[1.0, 2.0, 3.0]] * 4999 + [[1.0, 2.0]]
        watched = [None, IDENTITY4, IDENTITY4[0], camera, camera["world_from_camera"], weights, *given.values()]

        def work():
            scene = pags.Scene(**given)
            pags.gradients(scene, camera, weights, depth=depth, threads=1)
            pags.render(scene, [camera] * 3, outputs=("rgb8", "rgba"), threads=1)
            scene.arrays(), scene.normals(), scene.object_of, scene.info, repr(scene)
            scene.save(self.path("a.ply"))
            for bad in (spoiled, {**given, "means": nested}, {**given, "quats": given["means"]}):
                with self.assertRaises(ValueError):
                    pags.Scene(**bad)
            for bad in (
                lambda: scene.save("a.xyz"),
                lambda: pags.render(scene, [camera, {}]),
                lambda: pags.gradients(scene, camera, [1]),
            ):
                with self.assertRaises(ValueError):
                    bad()

        work()
        gc.collect()
        counts = [sys.getrefcount(o) for o in watched[1:]]
        grown = []
        for _ in range(
            3
            # A leak grows in each round. A system that moves a waiting process's pages out and back causes growth only
            # once.
        ):
            before = resident()
            for _ in range(20):
                work()
            gc.collect()
            grown.append(resident() - before)
            if grown[-1] < 8 << 20:
                break
        self.assertLess(min(grown), 8 << 20)
        self.assertEqual([sys.getrefcount(o) for o in watched[1:]], counts)


WITH_NUMPY = """
import numpy as np, pags
random = np.random.default_rng(1)
shapes = dict(means=(50, 3), quats=(50, 4), scales=(50, 3), opacities=(50,), sh=(50, 9, 3))
given = {name: random.normal(0, 1, shape).astype(np.float32) for name, shape in shapes.items()}
given["means"] += (0, 0, 5)
scene = pags.Scene(**given)
for name, value in scene.arrays().items():
    assert np.array_equal(np.asarray(value).view(np.uint32), given[name].view(np.uint32)), name
transposed = {**given, "means": np.asfortranarray(given["means"]), "sh": given["sh"].astype(np.float64)[::-1][::-1]}
halves = {name: value.astype(np.float16) for name, value in given.items()}
assert pags.Scene(**transposed).arrays()["means"].shape == (50, 3)
assert np.array_equal(np.asarray(pags.Scene(**halves).arrays()["sh"]), halves["sh"].astype(np.float32))
camera = pags.camera(40, 30, np.array([[40, 0, 20], [0, 40, 15], [0, 0, 1]]), camera_from_world=np.eye(4, dtype=np.float32))
pictures = np.stack([p.rgb8 for p in pags.render(scene, [camera] * 4, outputs=("rgb8",))])
assert pictures.shape == (4, 30, 40, 3) and pictures.dtype == np.uint8
error = np.asarray(pags.render(scene, camera).rgba)[..., :3] - 0.5
for gradient in (error, error.astype(np.float64), np.asfortranarray(error)):
    found = pags.gradients(scene, camera, gradient)
    assert {name: np.asarray(v).shape for name, v in found.items()} == shapes
    assert np.abs(found["sh"]).max() > 0
print("good")
"""


@unittest.skipIf(SANITIZED, "numpy isn't")
@unittest.skipUnless(os.name == "posix" and fixtures.numpy_python(), "there is no numpy")
class Numpy(Case):
    def test_numpy_arrays(self):
        done = subprocess.run(
            [fixtures.numpy_python(), "-B", "-c", WITH_NUMPY],
            env={**os.environ, "PYTHONPATH": MODULE},
            capture_output=True,
            text=True,
        )
        self.assertEqual(done.stdout, "good\n", done.stderr)


if __name__ == "__main__":
    fixtures.main()
