# SPDX-License-Identifier: Apache-2.0
"""Tests pags import ncore: NVIDIA's package nvidia-ncore writes sequences of the synthetic street, and the imported
data sets are compared with it. Without the package only the lenses and the message about the missing package are
tested."""

import contextlib
import dataclasses
import enum
import importlib.util
import io
import os
import signal
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
from fixtures import Case, files_below, read, write  # noqa: E402
from pags_recordings import RecordingError, ncore  # noqa: E402
from pags_recordings import __main__ as importer
from street import about, labels, load, make_street, matrix, sweep  # noqa: E402

INSTALLED = all(importlib.util.find_spec(name) for name in ("ncore", "zarr", "scipy", "cbor2", "upath"))
STEP, BEGIN = 100_000, 1_700_000_000_000_000  # microseconds between the street's frames, and the time of the first
EXPOSURE = 8_000
BACKWARD = np.array(
    [0, 1 / 60, 2e-5, -4e-7, 0, 0], np.float32
)  # coefficients of the angle as a function of the distance from the centre in pixels
FORWARD = np.array([0, 70, -1.5, 0.8, 0.02, -0.3], np.float32)


def move(pose, points):
    return points @ pose[:3, :3].T + pose[:3, 3]


def angles_of(rotation):
    """Returns the angles of a rotation about the fixed axes x, then y, then z."""
    return (
        np.arctan2(rotation[2, 1], rotation[2, 2]),
        np.arcsin(-rotation[2, 0]),
        np.arctan2(rotation[1, 0], rotation[0, 0]),
    )


@dataclasses.dataclass
class Model:
    """Replaces the F-theta camera of nvidia-ncore."""

    PolynomialType = enum.Enum("PolynomialType", "PIXELDIST_TO_ANGLE ANGLE_TO_PIXELDIST")
    reference_poly: object
    pixeldist_to_angle_poly: object = dataclasses.field(default_factory=lambda: BACKWARD)
    angle_to_pixeldist_poly: object = dataclasses.field(default_factory=lambda: FORWARD)
    max_angle: float = 1.3
    linear_cde: object = (1.01, 0.002, -0.003)
    principal_point: object = (79.0, 47.5)
    resolution: object = (160, 96)


class Lenses(Case):
    def radius(self, focal, lens, angle):
        """Returns the radius by the formula of docs/lenses.md."""
        return focal[0] * angle * (1 + sum(k * angle ** (n + 1) for n, k in enumerate(lens["k"])))

    def test_forward(self):
        focal, lens, centre = ncore.ftheta(Model(Model.PolynomialType.ANGLE_TO_PIXELDIST), "x")
        angle = np.linspace(0, 1.3, 50)
        np.testing.assert_allclose(
            self.radius(focal, lens, angle), np.polyval(FORWARD[::-1].astype(float), angle), rtol=1e-12
        )
        np.testing.assert_allclose(lens["s"], [0.01, 0.002, -0.003], atol=1e-12)
        self.assertEqual(centre.tolist(), [79.5, 48.0])  # the package places the middle of pixels at whole numbers
        self.assertAlmostEqual(lens["field"], np.degrees(2.6), 4)

    def test_backward(self):
        """For a polynomial from radius to angle, our lens shows each pixel within 0.2 pixels of its place, and ends
        where the angle stops growing."""
        focal, lens, _ = ncore.ftheta(Model(Model.PolynomialType.PIXELDIST_TO_ANGLE), "x")
        radius = np.linspace(0, 79, 80)
        angle = np.polyval(BACKWARD[::-1].astype(float), radius)
        self.assertLess(np.abs(self.radius(focal, lens, angle) - radius).max(), 0.2)
        self.assertGreater(angle.max(), 1.1)
        turns = np.array([0, 1 / 60, 0, -1.2e-6, 0, 0])  # the angle grows up to 68 pixels, where it is 0.756
        _, lens, _ = ncore.ftheta(Model(Model.PolynomialType.PIXELDIST_TO_ANGLE, turns, max_angle=0.7), "x")
        self.assertLess(lens["field"], np.degrees(2 * 0.7) + 1)

    def test_refused(self):
        kind = Model.PolynomialType
        with self.assertRaisesRegex(RecordingError, "3 pixels at the angle 0"):
            ncore.ftheta(Model(kind.ANGLE_TO_PIXELDIST, angle_to_pixeldist_poly=[3, 70, 0, 0, 0, 0]), "x")
        with self.assertRaisesRegex(RecordingError, "focal length is -70"):
            ncore.ftheta(Model(kind.ANGLE_TO_PIXELDIST, angle_to_pixeldist_poly=[0, -70, 0, 0, 0, 0]), "x")
        with self.assertRaisesRegex(RecordingError, "has an error of"):
            ncore.ftheta(Model(kind.PIXELDIST_TO_ANGLE, [0, 1e-4, 0, 0, 0, 1.5e-11], max_angle=3), "x")

    def test_package_is_missing(self):
        script = f"import sys; sys.path.insert(0, {os.path.join(TOOLS, 'recordings')!r}); import importlib.util as u; find = u.find_spec; u.find_spec = lambda name: None if name in ('ncore', 'zarr') else find(name); from pags_recordings.__main__ import main; sys.exit(main())"
        modules = [
            name for name in ("scipy", "cbor2", "dataclasses_json", "upath") if not importlib.util.find_spec(name)
        ]
        done = subprocess.run(
            [sys.executable, "-B", "-c", script, "ncore", self.path(), "-o", self.path("out")],
            capture_output=True,
            text=True,
        )
        self.assertEqual((done.returncode, done.stderr.count("\n")), (1, 1), done.stderr)
        for word in ["'zarr<3'", f"{sys.executable} -m pip install --no-deps nvidia-ncore", *modules]:
            self.assertIn(
                word.replace("dataclasses_json", "dataclasses-json").replace("upath", "universal-pathlib"), done.stderr
            )
        self.assertFalse(os.path.exists(self.path("out")))


class Tree:
    """The street as a sequence of NCore: exposures of 8 ms that end at different times, a LiDAR that turns while the
    car drives, and boxes in the LiDAR's frame."""

    def __init__(self, street, folder, store="itar", models=("ftheta", "opencv-pinhole"), change=lambda tree: None):
        self.street, self.count = street, len(load(street, "timestamps.json")["frames"])
        self.ego = [matrix(street, "ego_pose", f"{t:03d}.txt") for t in range(self.count)]
        self.mounts = [matrix(street, "extrinsics", f"{c}.txt") for c in range(2)]
        self.lidar = np.eye(4)
        self.lidar[:3] = np.column_stack([about([0.2, 0.1, 1], 2.0), [0.9, 0.1, 1.8]])
        self.models, self.boxes, self.junk = models, labels(street), None
        self.lags, self.lost = (-10_000, 10_000), ()  # one camera 10 ms before the frame, the other 10 ms after it
        change(self)
        self.write(folder, store)

    def rig(self, at):
        """Returns the car's pose at a time, computed without the package and without our code. Between frames it
        moves along a line and turns about a fixed axis."""
        i = min(max(int((at - BEGIN) // STEP), 0), self.count - 2)
        share, a, b = (at - BEGIN - i * STEP) / STEP, self.ego[i], self.ego[i + 1]
        turn = a[:3, :3].T @ b[:3, :3]
        axis = np.array([turn[2, 1] - turn[1, 2], turn[0, 2] - turn[2, 0], turn[1, 0] - turn[0, 1]])
        size = np.linalg.norm(axis)
        out = np.eye(4)
        out[:3, :3] = a[:3, :3] @ (
            about(axis, share * np.arctan2(size, np.trace(turn) - 1)) if size > 1e-12 else np.eye(3)
        )
        out[:3, 3] = (1 - share) * a[:3, 3] + share * b[:3, 3]
        return out

    def photograph(self, t, c):
        """Returns the middle of an exposure and the camera's pose at this time."""
        at = BEGIN + t * STEP + self.lags[c]
        return at, self.rig(at) @ self.mounts[c]

    def world(self, t):
        return move(self.ego[t], sweep(self.street, f"{t:03d}.bin")[:, :3].astype(float))

    def parameters(self, c):
        from ncore import data

        fx, fy, cx, cy = np.loadtxt(os.path.join(self.street, "intrinsics", f"{c}.txt"))[:4].astype(np.float32)
        common = {
            "resolution": np.array([160, 96], np.uint64),
            "shutter_type": data.ShutterType.ROLLING_TOP_TO_BOTTOM,
            "external_distortion_parameters": None,
        }
        pinhole = {"principal_point": np.array([cx, cy]), "focal_length": np.array([fx, fy])}
        four = np.zeros(4, np.float32)
        radial = lambda *k: np.array([*k, *[0] * (6 - len(k))], np.float32)  # noqa: E731
        tangential = np.array([1e-3, -2e-3], np.float32)
        kind = self.models[c]
        if kind == "ftheta":
            types_of = data.FThetaCameraModelParameters.PolynomialType
            return data.FThetaCameraModelParameters(
                **common,
                principal_point=np.array([79, 47.5], np.float32),
                reference_poly=types_of.ANGLE_TO_PIXELDIST,
                pixeldist_to_angle_poly=BACKWARD,
                angle_to_pixeldist_poly=FORWARD,
                max_angle=1.3,
                linear_cde=np.array([1.01, 0.002, -0.003], np.float32),
            )
        if kind == "opencv-fisheye":
            return data.OpenCVFisheyeCameraModelParameters(
                **common, **pinhole, radial_coeffs=np.array([0.01, -0.002, 0, 0], np.float32), max_angle=1.2
            )
        if kind == "ideal-pinhole":
            return data.IdealPinholeCameraModelParameters(**common, **pinhole)
        if kind == "windshield":
            zero = np.zeros(1, np.float32)
            common["external_distortion_parameters"] = data.BivariateWindshieldModelParameters(
                data.ReferencePolynomial.FORWARD, zero, zero, zero, zero
            )
        k = radial(-0.1, 0.02, 0.003, *((0.01,) if kind == "rational" else ()))
        prism = four + np.float32(0.01) if kind == "prism" else four
        return data.OpenCVPinholeCameraModelParameters(
            **common, **pinhole, radial_coeffs=k, tangential_coeffs=tangential, thin_prism_coeffs=prism
        )

    def write(self, folder, store):
        from ncore.data import v4
        from ncore.impl.common.transformations import HalfClosedInterval
        from upath import UPath

        writer = v4.SequenceComponentGroupsWriter(
            UPath(folder), "drive", "drive", HalfClosedInterval(BEGIN, BEGIN + (self.count - 1) * STEP + 1), {}, store
        )
        make = writer.register_component_writer
        moves = make(v4.PosesComponent.Writer, "default")
        moves.store_dynamic_pose(
            "rig", "world", np.array(self.ego), np.array([BEGIN + t * STEP for t in range(self.count)], np.uint64)
        )
        for name, mount in (("front", self.mounts[0]), ("side", self.mounts[1]), ("top", self.lidar)):
            moves.store_static_pose(name, "rig", mount)
        intrinsics = make(v4.IntrinsicsComponent.Writer, "default")
        for c, name in enumerate(("front", "side")):
            intrinsics.store_camera_intrinsics(name, self.parameters(c))
            camera = make(v4.CameraSensorComponent.Writer, name, "cameras")
            for t in range(1, self.count - 1):
                if (t, c) in self.lost:
                    continue
                middle, _ = self.photograph(t, c)
                camera.store_frame(
                    read(os.path.join(self.street, "images", f"{t:03d}_{c}.png")),
                    "png",
                    np.array([middle - EXPOSURE // 2, middle + EXPOSURE // 2], np.uint64),
                    {},
                    {},
                )
        lidar = make(v4.LidarSensorComponent.Writer, "top", "lidar")
        for t in range(1, self.count - 1):
            self.write_sweep(lidar, t)
        if self.boxes:
            make(v4.CuboidsComponent.Writer, "default", "labels").store_observations(self.observations())
        if self.junk:
            self.junk(writer)
        writer.finalize()

    def write_sweep(self, lidar, t):
        """Writes the sweep of a frame with a time for each ray. Every fifth ray has a second return, 1 m farther
        away."""
        begin, end = BEGIN + t * STEP - STEP // 2 + 1000, BEGIN + t * STEP + STEP // 2 - 1000
        points = self.world(t)
        at = np.linspace(begin, end, len(points)).astype(np.uint64)
        seen = np.array([move(np.linalg.inv(self.rig(int(when)) @ self.lidar), p) for when, p in zip(at, points)])
        distance = np.linalg.norm(seen, axis=1)
        returns = np.stack([distance, np.where(np.arange(len(points)) % 5 == 0, distance + 1, np.nan)]).astype(
            np.float32
        )
        bright = np.where(np.isnan(returns), np.nan, np.linspace(0, 1, len(points))).astype(np.float32)
        lidar.store_frame(
            (seen / distance[:, None]).astype(np.float32),
            at,
            None,
            returns,
            bright,
            np.array([begin, end], np.uint64),
            {},
            {},
        )

    def observations(self):
        from ncore import data

        out = []
        for (t, track), (kind, pose, size) in self.boxes.items():
            if 1 <= t < self.count - 1:
                end = BEGIN + t * STEP + STEP // 2 - 1000
                own = np.linalg.inv(self.rig(end) @ self.lidar) @ pose
                box = data.BBox3(
                    tuple(own[:3, 3].tolist()),
                    tuple(float(v) for v in size),
                    tuple(float(v) for v in angles_of(own[:3, :3])),
                )
                out.append(
                    data.CuboidTrackObservation(
                        track, kind, BEGIN + t * STEP, "top", end, box, data.LabelSource.AUTOLABEL
                    )
                )
        return out[::-1]


@unittest.skipUnless(INSTALLED, "needs nvidia-ncore: make check-recordings has it")
class Sequences(Case):
    @classmethod
    def setUpClass(cls):
        cls.street = make_street(os.path.join(cls.shared_folder(), "street"))

    def run_import(self, *more):
        command = [
            sys.executable,
            "-B",
            "-m",
            "pags_recordings",
            "ncore",
            self.path("raw"),
            "-o",
            self.path("out"),
            "-q",
            *more,
        ]
        return subprocess.run(
            command, capture_output=True, text=True, env=os.environ | {"PYTHONPATH": os.path.join(TOOLS, "recordings")}
        )

    def imports(self, tree, *more):
        done = self.run_import(*more)
        self.assertEqual((done.returncode, done.stderr), (0, ""))
        return tree, self.path("out")

    def refused(self, *words, more=()):
        done = self.run_import(*more)
        self.assertEqual((done.returncode, done.stderr.count("\n")), (1, 1), done.stderr)
        for word in words:
            self.assertIn(word, done.stderr)
        self.assertFalse(os.path.exists(self.path("out", "dataset.json")))

    def check(self, tree, out):
        found = labels(out)
        self.assertEqual(len(load(out, "timestamps.json")["frames"]), tree.count - 2)
        for step in range(tree.count - 2):
            t = step + 1
            self.assertAlmostEqual(load(out, "timestamps.json")["frames"][step], t * 0.1, 9)
            ego = matrix(out, "ego_pose", f"{step:06d}.txt")
            np.testing.assert_allclose(ego, tree.ego[t], atol=1e-9)
            for c in range(2):
                at, pose = tree.photograph(t, c)
                self.assertAlmostEqual(load(out, "timestamps.json")["cameras"][str(c)][step], (at - BEGIN) / 1e6, 9)
                np.testing.assert_allclose(matrix(out, "extrinsics", f"{step:06d}_{c}.txt"), pose, atol=1e-9)
                self.assertEqual(
                    read(os.path.join(out, "images", f"{step:06d}_{c}.png")),
                    read(os.path.join(tree.street, "images", f"{t:03d}_{c}.png")),
                )
            rows = sweep(out, f"{step:06d}.bin").astype(float)
            points = tree.world(t)
            first, second = move(ego, rows[: len(points), :3]), move(ego, rows[len(points) :, :3])
            np.testing.assert_allclose(first, points, atol=1e-4)
            self.assertEqual(len(second), (len(points) + 4) // 5)
            np.testing.assert_allclose(np.linalg.norm(second - points[::5], axis=1), 1, atol=1e-3)
            np.testing.assert_allclose(rows[: len(points), 3], np.linspace(0, 1, len(points)), atol=1e-6)
            mine = {track: value for (frame, track), value in found.items() if frame == step}
            truth = {track: value for (frame, track), value in tree.boxes.items() if frame == t}
            self.assertEqual(sorted(mine), sorted(truth))
            for track, (kind, pose, size) in truth.items():
                self.assertEqual(mine[track][0], kind)
                np.testing.assert_allclose(mine[track][1], pose, atol=1e-6)
                np.testing.assert_allclose(mine[track][2], size, rtol=1e-6)

    def test_the_import_matches_the_street(self):
        tree, out = self.imports(Tree(self.street, self.path("raw")))
        self.check(tree, out)
        told = load(out, "dataset.json")
        self.assertEqual(told["cameras"], {"0": "front", "1": "side"})
        self.assertEqual((told["lenses"]["0"]["kind"], "1" in told["lenses"]), ("ftheta", False))
        np.testing.assert_allclose(np.loadtxt(os.path.join(out, "intrinsics", "0.txt")), [70, 70, 79.5, 48])
        k1, k2, k3 = np.float32(-0.1), np.float32(0.02), np.float32(0.003)
        np.testing.assert_allclose(
            np.loadtxt(os.path.join(out, "intrinsics", "1.txt"))[4:], [k1, k2, np.float32(1e-3), np.float32(-2e-3), k3]
        )
        done = fixtures.run("info", out)
        self.assertEqual(done.returncode, 0, done.stderr)

    def test_folders_and_lenses(self):
        """Imports stores that are folders one level deeper, a rational lens and a fisheye; then a choice of cameras
        and frames."""
        tree = Tree(self.street, self.path("raw", "clip"), "directory", ("opencv-fisheye", "rational"))
        _, out = self.imports(tree)
        lenses = load(out, "dataset.json")["lenses"]
        self.assertEqual((lenses["0"]["kind"], lenses["1"]["kind"]), ("fisheye", "rational"))
        np.testing.assert_allclose(lenses["1"]["d"], [np.float32(0.01), 0, 0])
        self.assertAlmostEqual(lenses["0"]["field"], np.degrees(2.4), 4)
        self.check(tree, out)
        self.assertEqual(fixtures.run("info", out).returncode, 0)
        done = self.run_import("--overwrite", "--cameras", "side", "--frames", "1-2", "--sequence", "drive")
        self.assertEqual((done.returncode, done.stderr, len(os.listdir(os.path.join(out, "images")))), (0, "", 2))

    def test_without_boxes_and_sweeps(self):
        def change(tree):
            tree.boxes = {}

        tree, out = self.imports(Tree(self.street, self.path("raw"), change=change))
        self.assertFalse(os.path.exists(os.path.join(out, "instances")))

    def test_lost_photographs(self):
        """A camera half a step behind the other has lost two photographs: each photograph belongs to one time step,
        and steps without one are counted."""

        def change(tree):
            tree.lags, tree.lost = (0, 50_000), ((2, 1), (3, 1))

        tree, out = self.imports(Tree(self.street, self.path("raw"), change=change))
        pictures = [
            read(os.path.join(out, "images", name))
            for name in sorted(os.listdir(os.path.join(out, "images")))
            if "_1." in name
        ]
        self.assertEqual((len(pictures), len(set(pictures))), (tree.count - 4, tree.count - 4))
        result = load(out, "import.json")["result"]
        left = {(row["what"], row["why"]): row["count"] for row in result["left_out"]}
        self.assertEqual(
            (result["steps"], left["time steps", "side has no photograph of its own within 0.05 s"]),
            (tree.count - 4, 2),
        )
        self.assertEqual(left["photographs", "of front, which match no time step"], 2)

    def test_refused(self):
        for kind, word in (
            ("windshield", "'side' looks through a windshield"),
            ("prism", "'side' has thin-prism coefficients"),
        ):
            Tree(self.street, self.path("raw"), models=("ideal-pinhole", kind))
            self.refused(word, "leave it out by --cameras", more=("--overwrite",))
        done = self.run_import("--overwrite", "--cameras", "front")
        self.assertEqual((done.returncode, done.stderr), (0, ""))
        self.refused("no camera is named 'rear'; there are front, side", more=("--overwrite", "--cameras", "rear"))
        os.makedirs(self.path("empty"))
        done = subprocess.run(
            [sys.executable, "-B", "-m", "pags_recordings", "ncore", self.path("empty"), "-o", self.path("o")],
            capture_output=True,
            text=True,
            env=os.environ | {"PYTHONPATH": os.path.join(TOOLS, "recordings")},
        )
        self.assertEqual((done.returncode, "found no recording of NVIDIA NCore" in done.stderr), (1, True), done.stderr)

    def test_damage(self):
        """If a store is missing, cut, empty or full of other bytes, the import prints one line or leaves out the
        damaged part."""
        import numcodecs.registry

        Tree(self.street, self.path("raw"))
        before = {name: read(self.path("raw", name)) for name in files_below(self.path("raw"))}
        refused = 0
        for name, content in before.items():
            for bad in (
                None,
                content[: len(content) // 2],
                content[:-1],
                b"",
                bytes(len(content)),
                bytes((37 * i) % 256 for i in range(len(content))),
            ):
                os.remove(self.path("raw", name)) if bad is None else write(self.path("raw", name), bad)
                words = io.StringIO()
                with (
                    contextlib.redirect_stderr(words),
                    mock.patch.dict(numcodecs.registry.codec_registry),
                    mock.patch.object(
                        sys,
                        "argv",
                        ["pags import", "ncore", self.path("raw"), "-o", self.path("out"), "-q", "--overwrite"],
                    ),
                ):
                    code = importer.main()
                signal.signal(signal.SIGINT, signal.default_int_handler)
                refused += code
                self.assertEqual(
                    (code, words.getvalue().count("\n")), (code and 1, code and 1), (name, words.getvalue())
                )
                self.assertEqual(os.path.exists(self.path("out", "dataset.json")), code == 0)
                self.assertEqual(set(os.listdir(self.path())) - {"out"}, {"raw"})
                write(self.path("raw", name), content)
        self.assertGreaterEqual(refused, 5 * 4)

    def test_a_missing_part_of_a_folder(self):
        """zarr fills missing chunks with zeros: these are refused as rays and as photographs."""
        Tree(self.street, self.path("raw"), "directory")
        for store, part, words in (
            ("lidar", "direction", "rays aren't of length 1"),
            ("cameras", "image", "can't be read as a picture"),
        ):
            store = self.path("raw", f"drive.ncore4-{store}.zarr")
            name = next(
                name
                for name in sorted(files_below(store))
                if f"{os.sep}{part}{os.sep}" in name and name.split(os.sep)[-1][0].isdigit()
            )
            content = read(os.path.join(store, name))
            os.remove(os.path.join(store, name))
            self.refused(words, more=("--overwrite",))
            write(os.path.join(store, name), content)

    def test_pickle(self):
        """A pickled array of objects is refused without unpickling it, as a pickle can call any function."""
        Tree(self.street, self.path("raw"), "directory")
        import numcodecs
        import zarr
        from ncore.impl.data import stores

        class Call:
            def __reduce__(self):
                return os.mkdir, (called,)

        called = self.path("called")
        group = zarr.open_group(zarr.storage.DirectoryStore(self.path("raw", "drive.ncore4-lidar.zarr")), "r+")
        frame = group["lidars"]["top"]["frames"]
        name = sorted(frame.group_keys())[0]
        bundle = frame[name]["ray_bundle"]
        rays = bundle["direction"].shape[0]
        del bundle["direction"]
        evil = bundle.create_dataset(
            "direction", shape=(1,), chunks=(1,), dtype=object, object_codec=numcodecs.Pickle()
        )
        evil[:] = np.array([Call()], object)
        self.assertGreater(rays, 1)
        if os.path.isdir(called):
            os.rmdir(called)
        stores.consolidate_compressed_metadata(group.store)
        with mock.patch.dict(
            os.environ, NUMCODECS_ALLOW_UNSAFE_PICKLE_DECODE="1"
        ):  # later versions of numcodecs refuse pickles unless this is set
            self.refused("nvidia-ncore can't read it")
        self.assertFalse(os.path.exists(called))


if __name__ == "__main__":
    fixtures.main()
