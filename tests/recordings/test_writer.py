# SPDX-License-Identifier: Apache-2.0
"""Tests the recording writer of tools/recordings: pags reads what it writes, it refuses bad input, and its
conversions agree with independent formulas."""

import contextlib
import errno
import io
import json
import os
import pathlib
import subprocess
import sys
import unittest
from unittest import mock

HERE = os.path.dirname(os.path.abspath(__file__))
sys.path[:0] = [os.path.dirname(HERE), os.path.join(os.path.dirname(HERE), "cli")]

from tool_python import TOOLS, need  # noqa: E402

need("recordings", "numpy", "PIL")
sys.path[:0] = [os.path.join(TOOLS, "recordings")]

import fixtures  # noqa: E402
import numpy as np  # noqa: E402
import pags_recordings  # noqa: E402
from fixtures import Case, read, write  # noqa: E402
from pags_recordings import Recording, RecordingError, lock, poses  # noqa: E402
from PIL import Image  # noqa: E402
from street import about, half_angle, labels, load, make_street, matrix, parts, sweep  # noqa: E402

TEMPLATE = os.path.join(TOOLS, "recordings", "template.py")
SHARED = os.environ.get("PAGS_SHARED_DATA") or os.path.join(os.path.dirname(TOOLS), "..", "shared", "data")
DGP = os.path.join(os.path.normpath(SHARED), "found", "dgp-scene_01")


class Poses(unittest.TestCase):
    def test_quaternions(self):
        random = np.random.default_rng(3)
        for _ in range(200):
            axis, angle = random.normal(size=3), random.uniform(-np.pi, np.pi)
            rotation = about(axis, angle)
            x, y, z, w = half_angle(axis, angle)
            np.testing.assert_allclose(poses.rotation_of([x, y, z, w], "xyzw"), rotation, atol=1e-12)
            np.testing.assert_allclose(poses.rotation_of([-w, -x, -y, -z], "wxyz"), rotation, atol=1e-12)
            np.testing.assert_allclose(poses.rotation_of(poses.quaternion_of(rotation), "wxyz"), rotation, atol=1e-12)
        for axis in np.eye(3):  # half turns, where w is 0
            np.testing.assert_allclose(
                poses.rotation_of(poses.quaternion_of(about(axis, np.pi)), "wxyz"), about(axis, np.pi), atol=1e-12
            )

    def test_axes(self):
        """Converts the point 1 right, 2 down, 3 forward of a camera, and the point 1 forward, 2 left, 3 up of a box."""
        seen = np.array([1, 2, 3, 1])
        self.assertEqual((poses.axes_from_opencv("opengl") @ seen)[:3].tolist(), [1, -2, -3])
        self.assertEqual((poses.axes_from_opencv("waymo") @ seen)[:3].tolist(), [3, -1, -2])
        self.assertEqual((poses.front_from_box("+y") @ seen)[:3].tolist(), [-2, 1, 3])
        self.assertEqual((poses.front_from_box("-y") @ seen)[:3].tolist(), [2, -1, 3])
        self.assertEqual((poses.front_from_box("-x") @ seen)[:3].tolist(), [-1, -2, 3])
        self.assertEqual(poses.box_size([2, 5, 1.5], "+y").tolist(), [5, 2, 1.5])

    def test_between(self):
        a, b = poses.pose(about([0, 0, 1], 0.2), [0, 0, 0]), poses.pose(about([0, 0, 1], 1.0), [4, 8, 0])
        between = poses.interpolate([10, 12], [a, b], 10.5)
        np.testing.assert_allclose(between, poses.pose(about([0, 0, 1], 0.4), [1, 2, 0]), atol=1e-12)
        np.testing.assert_allclose(
            poses.interpolate([10, 12], [a, b], 13), poses.pose(about([0, 0, 1], 1.4), [6, 12, 0]), atol=1e-12
        )
        for at in (7.9, 14.1):
            with self.assertRaisesRegex(RecordingError, "no pose at"):
                poses.interpolate([10, 12], [a, b], at)

    def test_times(self):
        first = 1_700_000_000_123_456_789
        self.assertEqual(poses.seconds([first, first + 1, first + 2_000_000_000], "ns").tolist(), [0, 1e-9, 2])
        with self.assertRaisesRegex(RecordingError, "s, ms, us, ns"):
            poses.seconds([1], "minutes")


# ---- A recording written again ----


class Dgp(Case):
    def test_round_trip(self):
        if not os.path.isdir(DGP):
            self.skipTest(f"needs {DGP} (set PAGS_SHARED_DATA to the folder of the test data)")
        out, info, times = self.path("dgp"), load(DGP, "dataset.json"), load(DGP, "timestamps.json")
        boxes = load(DGP, "instances", "instances_info.json")
        with Recording(out) as recording:
            for n, name in info["cameras"].items():
                fx, fy, cx, cy, *lens = np.loadtxt(os.path.join(DGP, "intrinsics", f"{n}.txt"))
                with Image.open(os.path.join(DGP, "images", f"000_{n}.jpg")) as picture:
                    size = picture.size
                recording.add_camera(name, size, [[fx, 0, cx], [0, fy, cy], [0, 0, 1]], lens, pixel_centre=0.5)
            for t, time in enumerate(times["frames"]):
                ego = matrix(DGP, "ego_pose", f"{t:03d}.txt")
                step = recording.add_step(time, ego)
                for n, name in info["cameras"].items():
                    picture = os.path.join(DGP, "images", f"{t:03d}_{n}.jpg")
                    step.photograph(
                        name, picture, matrix(DGP, "extrinsics", f"{t:03d}_{n}.txt"), times["cameras"][n][t]
                    )
                step.lidar(
                    np.fromfile(os.path.join(DGP, "lidar", f"{t:03d}.bin"), "<f4").reshape(-1, 4), ego, ["intensity"]
                )
                for box in boxes.values():
                    marks = box["frame_annotations"]
                    for frame, pose, size in zip(marks["frame_idx"], marks["obj_to_world"], marks["box_size"]):
                        if frame == t:
                            step.box(box["id"], box["class_name"], pose, size)
        for t in range(3):
            self.assertEqual(
                read(os.path.join(out, "lidar", f"{t:06d}.bin")), read(os.path.join(DGP, "lidar", f"{t:03d}.bin"))
            )
            np.testing.assert_array_equal(
                matrix(out, "ego_pose", f"{t:06d}.txt"), matrix(DGP, "ego_pose", f"{t:03d}.txt")
            )
            for n in range(3):
                self.assertEqual(
                    read(os.path.join(out, "images", f"{t:06d}_{n}.jpg")),
                    read(os.path.join(DGP, "images", f"{t:03d}_{n}.jpg")),
                )
                np.testing.assert_array_equal(
                    matrix(out, "extrinsics", f"{t:06d}_{n}.txt"), matrix(DGP, "extrinsics", f"{t:03d}_{n}.txt")
                )
        again = load(out, "timestamps.json")
        self.assertEqual((again["frames"], again["cameras"]), (times["frames"], times["cameras"]))
        self.assertEqual(
            {load(out, "dataset.json")["cameras"][n] for n in info["cameras"]}, set(info["cameras"].values())
        )
        for n in info["cameras"]:
            mine, theirs = (np.loadtxt(os.path.join(folder, "intrinsics", f"{n}.txt")) for folder in (out, DGP))
            np.testing.assert_array_equal(mine, theirs[: len(mine)])
            self.assertFalse(theirs[len(mine) :].any())
        true, made = labels(DGP), labels(out)
        self.assertEqual(set(made), set(true))
        for key, (name, pose, size) in made.items():
            self.assertEqual(name, true[key][0])
            np.testing.assert_array_equal(pose, true[key][1])
            np.testing.assert_array_equal(size, true[key][2])
        facts = [json.loads(self.succeeds("info", folder, "--json", "-").stdout) for folder in (DGP, out)]
        rates = [
            fact.pop("fps") for fact in facts
        ]  # the original states a rate of 1; the writer computes it from the times
        self.assertAlmostEqual(rates[0], rates[1], 3)
        self.assertEqual(
            *(json.loads(json.dumps(fact).replace(folder, "D")) for fact, folder in zip(facts, (DGP, out)))
        )


# ---- The template, on the most awkward recording that the manual promises to accept ----


class Template(Case):
    @classmethod
    def setUpClass(cls):
        cls.shared = cls.shared_folder()
        cls.street, cls.raw, cls.out = (os.path.join(cls.shared, name) for name in ("street", "raw", "out"))
        make_street(cls.street)
        cls.make_awkward()
        done = cls.template(cls.raw, cls.out)
        assert done.returncode == 0, done.stderr

    @staticmethod
    def template(raw, out):
        environment = os.environ | {"PYTHONPATH": os.path.join(TOOLS, "recordings")}
        return subprocess.run(
            [sys.executable, "-B", TEMPLATE, raw, out], capture_output=True, text=True, env=environment
        )

    @staticmethod
    def part(pose):
        return dict(zip(("xyzw", "translation"), parts(pose)))

    @classmethod
    def make_awkward(cls):
        """Writes the street with times in nanoseconds, quaternions x y z w and world-to-camera poses. LiDAR points
        are in a rotated and lifted sensor; boxes in the sensor's axes face -y. The first pixel's middle is at 0 in
        camera matrices."""
        street, times = cls.street, load(cls.street, "timestamps.json")
        boxes = load(street, "instances", "instances_info.json")
        turned = about([0.1, -0.2, 1], 2.0)
        ego_from_lidar = np.block([[turned, np.array([[0.4], [0.1], [1.9]])], [np.zeros((1, 3)), np.ones((1, 1))]])
        index = {
            "front": "-y",
            "cameras": {},
            "frames": [],
            "lidar": {"xyzw": half_angle([0.1, -0.2, 1], 2.0), "translation": [0.4, 0.1, 1.9]},
        }
        for n, name in load(street, "dataset.json")["cameras"].items():
            fx, fy, cx, cy = np.loadtxt(os.path.join(street, "intrinsics", f"{n}.txt"))[:4]
            index["cameras"][name] = {
                "width": 160,
                "height": 96,
                "K": [[fx, 0, cx - 0.5], [0, fy, cy - 0.5], [0, 0, 1]],
                "distortion": [],
            }
        front_of_box = np.array([[0.0, 1, 0, 0], [-1, 0, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]])  # the box faces -y
        for t, time in enumerate(times["frames"]):
            ego = matrix(street, "ego_pose", f"{t:03d}.txt")
            frame = {
                "time": int(1_600_000_000_000_000_000 + round(time * 1e9)),
                "ego": cls.part(ego),
                "photographs": {},
                "boxes": [],
                "lidar": f"{t}.bin",
            }
            for n, name in load(street, "dataset.json")["cameras"].items():
                camera_from_world = np.linalg.inv(ego @ matrix(street, "extrinsics", f"{n}.txt"))
                frame["photographs"][name] = {"file": f"{t}_{n}.png", **cls.part(camera_from_world)}
                write(os.path.join(cls.raw, f"{t}_{n}.png"), read(os.path.join(street, "images", f"{t:03d}_{n}.png")))
            rows = sweep(street, f"{t:03d}.bin").astype(float)
            rows[:, :3] = (rows[:, :3] - ego_from_lidar[:3, 3]) @ turned
            write(os.path.join(cls.raw, f"{t}.bin"), rows.astype("<f4").tobytes())
            for box in boxes.values():
                marks = box["frame_annotations"]
                if t in marks["frame_idx"]:
                    i = marks["frame_idx"].index(t)
                    lidar_from_box = np.linalg.inv(ego @ ego_from_lidar) @ np.array(marks["obj_to_world"][i])
                    length, width, height = marks["box_size"][i]
                    where = cls.part(lidar_from_box @ np.linalg.inv(front_of_box))
                    frame["boxes"].append(
                        {
                            "track": box["id"],
                            "class": box["class_name"],
                            "centre": where["translation"],
                            "xyzw": where["xyzw"],
                            "extents": [width, length, height],
                        }
                    )
            index["frames"].append(frame)
        write(os.path.join(cls.raw, "index.json"), json.dumps(index))

    def test_the_import_matches_the_street(self):
        cameras = load(self.street, "dataset.json")["cameras"]
        times = np.array(load(self.street, "timestamps.json")["frames"])
        np.testing.assert_allclose(load(self.out, "timestamps.json")["frames"], times - times[0], atol=1e-9)
        for t in range(8):
            ego = matrix(self.street, "ego_pose", f"{t:03d}.txt")
            np.testing.assert_allclose(matrix(self.out, "ego_pose", f"{t:06d}.txt"), ego, atol=1e-9)
            for n in cameras:
                np.testing.assert_allclose(
                    matrix(self.out, "extrinsics", f"{t:06d}_{n}.txt"),
                    ego @ matrix(self.street, "extrinsics", f"{n}.txt"),
                    atol=1e-9,
                )
            np.testing.assert_allclose(
                sweep(self.out, f"{t:06d}.bin"), sweep(self.street, f"{t:03d}.bin"), atol=1e-4
            )  # metres: two roundings to float32 at 100 m
        for n in cameras:
            np.testing.assert_allclose(
                np.loadtxt(os.path.join(self.out, "intrinsics", f"{n}.txt"))[:4],
                np.loadtxt(os.path.join(self.street, "intrinsics", f"{n}.txt"))[:4],
                atol=1e-9,
            )
        true, made = labels(self.street), labels(self.out)
        self.assertEqual(set(made), set(true))
        for key, (name, pose, size) in made.items():
            self.assertEqual(name, true[key][0])
            np.testing.assert_allclose(pose, true[key][1], atol=1e-9)
            np.testing.assert_allclose(size, true[key][2], atol=1e-12)

    def test_the_overlay_agrees(self):
        shares = [
            json.loads(self.succeeds("info", f, "--overlay", self.path(f"look{i}"), "--json", "-").stdout)["overlay"]
            for i, f in enumerate((self.street, self.out))
        ]
        self.assertEqual(shares[1]["warnings"], [])
        self.assertGreater(shares[1]["lidar_in_boxes"], 0.99)
        self.assertAlmostEqual(shares[1]["lidar_in_boxes"], shares[0]["lidar_in_boxes"], 3)
        self.assertAlmostEqual(shares[1]["front_cosine"], 1, 3)

    def test_it_trains(self):
        self.succeeds(
            "train",
            self.out,
            "-o",
            self.path("scene"),
            "-n",
            "20",
            "--max-gaussians",
            "2000",
            "--set",
            "lidar_points=1000",
        )

    def test_a_wrong_file_is_named(self):
        done = self.template(self.raw, self.out)
        self.assertEqual((done.returncode, done.stderr.count("\n")), (1, 1))
        self.assertIn(f"{self.out}: not empty", done.stderr)


# ---- Lenses ----


class Lenses(Case):
    """Writes a fisheye camera into dataset.json; pags refuses impossible values with a message."""

    def record(self, folder, field=190):
        with Recording(self.path(folder)) as out:
            out.add_camera(
                "front",
                (160, 120),
                [[45, 0, 79.5], [0, 45, 59.5], [0, 0, 1]],
                lens={"kind": "fisheye", "k": [-0.02, 0.003], "field": field},
            )
            out.add_camera("side", (160, 120), [[90, 0, 79.5], [0, 90, 59.5], [0, 0, 1]], [-0.1, 0.01, 0, 0])
            for number in range(2):
                step = out.add_step(number / 10)
                for camera, name in enumerate(("front", "side")):
                    step.photograph(
                        name,
                        np.random.default_rng(2 * number + camera).integers(0, 256, (120, 160, 3), np.uint8),
                        poses.pose(about([1, 0, 0], -np.pi / 2), [number, 0, 1]),
                    )

    def spoil(self, key, value):
        """Changes a value of the lens and opens the set; returns the message of pags."""
        facts = load(self.path("D"), "dataset.json")
        facts["lenses"]["0"] = dict(self.lens, **{key: value})
        self.write("D/dataset.json", json.dumps(facts))
        done = fixtures.run("info", self.path("D"))
        self.assertEqual((done.returncode, done.stderr.count("\n")), (1, 1), done.stderr)
        return done.stderr

    def test_a_fisheye(self):
        self.record("D")
        facts = load(self.path("D"), "dataset.json")
        self.assertEqual(facts["lenses"], {"0": {"kind": "fisheye", "k": [-0.02, 0.003, 0, 0, 0, 0], "field": 190}})
        self.lens = facts["lenses"]["0"]
        done = fixtures.run("info", self.path("D"))
        self.assertEqual((done.returncode, done.stderr), (0, ""))
        for words, key, value in (
            ("found 'wide'", "kind", "wide"),
            ("expected 6 numbers for 'k', found 1", "k", [0.1]),
            ("an array for 'k', found a string", "k", "0.1"),
            ("field of 0 to 360 degrees, found 400", "field", 400),
            ("field of 0 to 360 degrees, found -1", "field", -1),
            ("up to a field of 14[0-9].* only; expected 190", "k", [-0.2, 0, 0, 0, 0, 0]),
        ):
            self.assertRegex(self.spoil(key, value), "dataset.json:[0-9]+: .*" + words)
        self.assertIn("dataset.json:1", self.spoil("k", [float("nan")] * 6))
        self.write("D/dataset.json", json.dumps(facts))
        self.write("D/intrinsics/0.txt", "45 45 80 60 0.1 0 0 0")
        self.assertIn("expected fx fy cx cy alone", fixtures.run("info", self.path("D")).stderr)


# ---- Refused input ----


class Refused(Case):
    K = [[50.0, 0, 8], [0, 50, 6], [0, 0, 1]]

    def begin(self):
        recording = Recording(self.path("D"))
        recording.add_camera("front", (16, 12), self.K)
        return recording

    def refused(self, words, call, *arguments, **more):
        with self.assertRaisesRegex(RecordingError, words):
            call(*arguments, **more)

    def test_cameras(self):
        r = self.begin()
        self.refused("a unique name", r.add_camera, "front", (16, 12), self.K)
        self.refused("not plausible in pixels", r.add_camera, "b", (16, 12), [[0.8, 0, 0.5], [0, 0.8, 0.5], [0, 0, 1]])
        self.refused("without skew", r.add_camera, "b", (16, 12), [[50, 3, 8], [0, 50, 6], [0, 0, 1]])
        self.refused("lenses require lens=", r.add_camera, "b", (16, 12), self.K, [1, 2, 3, 4, 5, 6, 7, 8])
        self.refused("at 0 or 0.5", r.add_camera, "b", (16, 12), self.K, pixel_centre=1)
        r.add_step(0)
        self.refused("before the first time step", r.add_camera, "b", (16, 12), self.K)

    def test_lenses(self):
        r = self.begin()
        for words, lens in (
            ("found \\{'kind': 'wide'", {"kind": "wide"}),
            ("found 'fisheye'", "fisheye"),
            ("not 'k1'", {"kind": "fisheye", "k1": 0.1}),
            ("6 finite numbers for 'k'", {"kind": "fisheye", "k": [0.1, np.nan]}),
            ("3 finite numbers for 'd'", {"kind": "rational", "d": [1, 2, 3, 4]}),
            ("0 to 360 degrees, found 400", {"kind": "fisheye", "field": 400}),
            ("0 to 360 degrees, found nan", {"kind": "fisheye", "field": np.nan}),
            ("up to a field of 14[0-9].. degrees, not 200", {"kind": "fisheye", "k": [-0.2], "field": 200}),
        ):
            self.refused(words, r.add_camera, "b", (16, 12), self.K, lens=lens)
        self.refused("found both", r.add_camera, "b", (16, 12), self.K, [0.1, 0, 0, 0], lens={"kind": "fisheye"})

    def test_steps(self):
        r = self.begin()
        r.add_step(3)
        self.refused("not later than the previous one", r.add_step, 3)
        self.refused("expected seconds", r.add_step, 103e3)
        self.refused("'side'.*'front'", r.steps[0].photograph, "side", np.zeros((12, 16, 3), np.uint8), np.eye(4))
        self.refused("no photograph of 'front'", r.finish)
        self.assertFalse(os.path.exists(self.path("D", "dataset.json")))

    def test_photographs(self):
        step = self.begin().add_step(0)
        picture = np.zeros((12, 16, 3), np.uint8)
        self.refused("12 x 16 pixels.*16 x 12", step.photograph, "front", picture.transpose(1, 0, 2), np.eye(4))
        self.refused("uint8", step.photograph, "front", picture / 255.0, np.eye(4))
        self.refused("is not rigid", step.photograph, "front", picture, np.diag([2.0, 2, 2, 1]))
        self.refused("is not rigid.*determinant -1", step.photograph, "front", picture, np.diag([1.0, 1, -1, 1]))
        self.refused("non-finite numbers", step.photograph, "front", picture, np.diag([1.0, 1, np.nan, 1]))
        self.write("cut.png", encoded(np.arange(576, dtype=np.uint8).reshape(12, 16, 3), "PNG")[:-60])
        for name in ("cut.png", "none.png"):
            self.refused(f"{name}: can't be read as a picture", step.photograph, "front", self.path(name), np.eye(4))
        self.write("a.bmp", encoded(picture, "BMP"))
        self.refused("a.bmp: expected JPEG or PNG, found BMP", step.photograph, "front", self.path("a.bmp"), np.eye(4))
        step.photograph("front", picture, np.eye(4))
        self.refused("already has a photograph", step.photograph, "front", picture, np.eye(4))
        self.refused("sky_masks: expected 12 rows of 16", step.masks, "front", sky=np.zeros((16, 12), bool))
        self.refused(
            "semantic: expected values of 0 to 255, found 0 to 300",
            step.masks,
            "front",
            semantic=np.full((12, 16), 300) * (np.arange(16) > 3),
        )

    def test_lidar_and_boxes(self):
        r = self.begin()
        step = r.add_step(0)
        self.refused("columns x, y, z, found shape", step.lidar, np.zeros((5, 4)), np.eye(4))
        self.refused("farther than 1000 m", step.lidar, np.full((5, 3), 4e5), np.eye(4))
        self.refused("length, width and height", step.box, 7, "Car", np.eye(4), [4, 0, 2])
        step.box(7, "Car", np.eye(4), [4, 2, 2])
        self.refused("occurs twice", step.box, "7", "Car", np.eye(4), [4, 2, 2])
        self.refused("'Bus', but 'Car'", r.add_step(1).box, 7, "Bus", np.eye(4), [4, 2, 2])

    def test_a_world_far_from_its_zero(self):
        """LiDAR points with large UTM coordinates are accepted: only the distance from the car is limited."""
        r = self.begin()
        car = poses.pose(np.eye(3), [691_000, 5_334_000, 520])
        points = np.array([[691_010.5, 5_334_000, 520], [691_000, 5_333_980, 521]])
        r.add_step(0, car).lidar(points, np.eye(4))
        self.refused(
            "2 LiDAR points are farther than 1000 m from the car",
            r.add_step(1, car).lidar,
            points - car[:3, 3],
            np.eye(4),
        )
        found = np.frombuffer(read(os.path.join(r.folder, "lidar", "000000.bin")), "<f4").reshape(-1, 3)
        np.testing.assert_allclose(found, [[10.5, 0, 0], [0, -20, 1]], atol=1e-5)

    def test_failures_leave_no_files(self):
        with self.assertRaises(RecordingError), Recording(self.path("D")) as r:
            r.add_camera("front", (16, 12), self.K)
            r.add_step(0).photograph("front", np.zeros((12, 16, 3), np.uint8), np.zeros((4, 4)))
        self.assertFalse(os.path.exists(self.path("D")))

    def test_other_folders_are_refused(self):
        self.write("D/notes.txt", "mine")
        self.refused("not empty", Recording, self.path("D"))
        self.assertEqual(os.listdir(self.path("D")), ["notes.txt"])


class Locks(Case):
    """The package and the program use the same lock: either one shuts out the other, and a killed process shuts out
    none."""

    HOLDER = "import sys, time; from pags_recordings import lock; held = lock.FolderLock(sys.argv[1], 'pags import photos'); print(flush=True); time.sleep(60)"

    def hold(self):
        environment = os.environ | {"PYTHONPATH": os.path.join(TOOLS, "recordings")}
        process = subprocess.Popen(
            [sys.executable, "-B", "-c", self.HOLDER, self.path("D")], stdout=subprocess.PIPE, env=environment
        )
        self.addCleanup(process.communicate)
        self.addCleanup(process.kill)
        process.stdout.readline()
        return process

    def test_python_and_the_program(self):
        process = self.hold()
        who = f"pags import photos, process {process.pid} on "
        with self.assertRaisesRegex(RecordingError, "D: another process is writing there: " + who):
            Recording(self.path("D"))
        self.fails(["synth", "town", "-o", self.path("D"), "-q"], who)
        self.assertEqual(os.listdir(self.path("D")), [lock.NAME])
        process.kill()
        process.wait()
        self.write("D/import.json.part", "")
        with Recording(self.path("D"), begun_from={}) as r:
            r.done = True
        os.remove(self.path("D", "import.json"))
        with lock.FolderLock(self.path("D")), lock.FolderLock(self.path("D")) as inner:
            self.fails(["synth", "town", "-o", self.path("D"), "-q"], f"process {os.getpid()} on ")
            inner.release()
            self.assertEqual(os.listdir(self.path("D")), [lock.NAME])
        self.assertEqual(os.listdir(self.path("D")), [])

    def test_without_locks(self):
        words = io.StringIO()
        with (
            mock.patch.object(lock, "try_lock", side_effect=OSError(errno.ENOLCK, "No locks available")),
            contextlib.redirect_stderr(words),
        ):
            with lock.FolderLock(self.path("new", "D")):
                self.assertTrue(os.path.isdir(self.path("new", "D")))
        self.assertRegex(words.getvalue(), "^warning: .*no locks")
        self.assertEqual(os.listdir(self.folder), [])


def encoded(picture, form):
    out = io.BytesIO()
    Image.fromarray(picture).save(out, form)
    return out.getvalue()


class Package(Case):
    def test_the_version_matches_pags(self):
        self.assertEqual(self.succeeds("--version").stdout.split()[1], pags_recordings.__version__)

    def test_the_template_is_short(self):
        self.assertLessEqual(len(pathlib.Path(TEMPLATE).read_text().splitlines()), 60)


if __name__ == "__main__":
    fixtures.main()
