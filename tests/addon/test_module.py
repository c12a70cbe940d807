"""The module `pags` in plain Python: what it draws against the program, buffers, jobs, picking, errors."""

import gc
import json
import os
import re
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
from fixtures import Case, ply_bytes, read_png, some_splats  # noqa: E402
from test_drive import ORIGIN, camera, make_drive  # noqa: E402

SANITIZED = "PAGS_SANITIZED" in os.environ
IDENTITY = [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0]


def pose_of(record):
    """world_from_camera of a camera file's record that looks along the world's x."""
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
            offset = [pose[0] * 1.0, pose[4] * 1.0, pose[8] * 1.0]  # a metre forward
            for k in range(3):
                pose[4 * k + 3] += offset[k]
            other = 1 - number
            placements = [(-1, IDENTITY), (number, pose), (other, self.scene.pose(other, 100.0))]
            png = self.program_draws(camera(0.0, time=100.0), "--move", name, "1,0,0,0")
            self.assert_same(png, pags.render(self.scene, make_camera(time=100.0), placements=sorted(placements)))

    def test_hidden_and_twice(self):
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

    def test_a_cut_leaves_what_is_critical(self):
        """Two cars, and a wall (Gaussian 0) that covers less than a thousand pixels, as they do."""
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
        lit = [pags.render(self.scene, make_camera(time=100.0), linear=True, window=(30, 45, 27, 11), outputs=o) for o in (("rgba",), ("rgba", "depth"))]
        for part in lit:
            wanted = [pixel(linear.rgba, 30 + x, 100 - 45 - y) for y in range(11) for x in range(27)]
            self.assertGreater(len(set(wanted)), 10)  # not one colour
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
        """Depth is along the camera's axis, not the ray; what is placed before another hides it."""
        view = make_camera(time=101.0)
        beside = pags.pick(self.scene, view, 35, 50)
        self.assertEqual(beside["object"], 0)
        self.assertAlmostEqual(beside["depth"], 10, delta=0.05)  # 10.11 along the ray
        pose = list(self.scene.pose(0, 101.0))
        pose[3], pose[7] = ORIGIN[0] + 5, ORIGIN[1] - 0.5  # its Gaussian lies half a metre to the left of its box's middle
        found = pags.pick(self.scene, view, 50, 50, placements=[(1, self.scene.pose(1, 101.0)), (0, pose)])
        self.assertEqual(found["object"], 0)
        self.assertAlmostEqual(found["depth"], 5, delta=0.1)
        self.assertIsNone(pags.pick(self.scene, view, 50, 50, placements=[]))


class Contents(ModuleCase):
    def test_what_it_holds(self):
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
        with self.assertRaises(IndexError):
            self.scene.pose(2, 100.0)

    def test_points(self):
        points, colors = self.scene.points(-1, 100)
        self.assertEqual((points.shape, colors.shape), ((1, 3), (1, 4)))
        self.assertEqual(tuple(floats(points)), (10, 0, 3))
        points, colors = self.scene.points(0, 100)  # in its box's frame
        self.assertAlmostEqual(floats(points)[1], 1.5 - (self.scene.pose(0, 100.0)[7] - ORIGIN[1]), places=4)
        self.assertGreater(floats(colors)[1], 0.9)

    def test_a_bare_file_and_a_budget(self):
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
        del picture  # the memory stays as long as somebody looks at it
        gc.collect()
        self.assertEqual(view[0, 0, 2], before)
        try:
            import numpy
        except ImportError:
            return
        array = numpy.asarray(view)
        self.assertEqual((array.shape, array.dtype, array.flags.owndata), ((101, 101, 4), numpy.float32, False))


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
        del first  # joins
        self.assertEqual(third.take().width, 101)
        fourth = renderer.submit(self.scene, large)
        del renderer, fourth
        gc.collect()

    def test_the_lock_is_released(self):
        """Another Python thread runs while this one waits for a picture."""
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
            with self.assertRaises((ValueError, pags.Error), msg=str(change)):
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
        def resident():
            with open("/proc/self/statm") as file:
                return int(file.read().split()[1]) * 4096

        def work():
            for _ in range(20):
                scene = pags.load(self.path("scene"))
                pags.render(scene, {**make_camera(), "width": 400, "height": 400}, threads=1)
                scene.objects, scene.views, scene.info, scene.points(-1, 10)

        work()
        gc.collect()
        before = resident()
        for _ in range(5):
            work()
        gc.collect()
        self.assertLess(resident() - before, 8 << 20)


class Linking(Case):
    @unittest.skipIf(SANITIZED, "sanitizers are libraries")
    def test_depends_on_libc_alone(self):
        listed = subprocess.run(["ldd", pags.__file__], capture_output=True, text=True).stdout
        names = {line.split()[0].split("/")[-1] for line in listed.splitlines()}
        allowed = re.compile(r"linux-vdso|libc\.so|libm\.so|libpthread\.so|ld-linux")
        self.assertEqual([name for name in names if not allowed.match(name)], [])

    def test_shows_its_init_alone(self):
        listed = subprocess.run(["nm", "-D", "--defined-only", pags.__file__], capture_output=True, text=True).stdout
        self.assertEqual([line.split()[-1] for line in listed.splitlines()], ["PyInit_pags"])


if __name__ == "__main__":
    fixtures.main()
