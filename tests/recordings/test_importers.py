# SPDX-License-Identifier: Apache-2.0
"""Tests the importers of tools/recordings: the synthetic street is written in the raw format of each data set,
imported, and compared with the street."""

import gzip
import io
import json
import os
import signal
import subprocess
import sys
import time
import unittest

HERE = os.path.dirname(os.path.abspath(__file__))
sys.path[:0] = [os.path.dirname(HERE), os.path.join(os.path.dirname(HERE), "cli")]

from tool_python import TOOLS, need  # noqa: E402

need("recordings", "numpy", "PIL", "pandas", "pyarrow")
sys.path[:0] = [HERE, os.path.join(TOOLS, "recordings")]

import fixtures  # noqa: E402
import numpy as np  # noqa: E402
import old_pickle  # noqa: E402
import pandas as pd  # noqa: E402
import pyarrow as pa  # noqa: E402
from blind_tables import uncurl  # noqa: E402
from fixtures import Case, files_below, read, write  # noqa: E402
from pags_recordings import pandaset  # noqa: E402
from PIL import Image  # noqa: E402
from pyarrow import parquet as pq  # noqa: E402
from street import about, labels, load, make_street, matrix, parts, sweep  # noqa: E402

FRAMES = 8


def command(*arguments):
    return [sys.executable, "-B", "-m", "pags_recordings", *(str(word) for word in arguments)]


ENVIRONMENT = os.environ | {"PYTHONPATH": os.path.join(TOOLS, "recordings")}


def run(*arguments):
    return subprocess.run(command(*arguments), capture_output=True, text=True, env=ENVIRONMENT)


def jpeg(path):
    out = io.BytesIO()
    with Image.open(path) as picture:
        picture.convert("RGB").save(out, "JPEG", quality=95)
    return out.getvalue()


class Importer(Case):
    """A test case whose tests share one raw recording."""

    def refused(self, raw, *words, more=()):
        done = run(
            self.kind, raw, "-o", self.path("out"), "-q", *more
        )  # -q, as a slow machine would print progress lines
        self.assertEqual(done.returncode, 1, done.stdout + done.stderr)
        self.assertEqual(done.stderr.count("\n"), 1, done.stderr)
        for word in words:
            self.assertIn(word, done.stderr)
        self.assertFalse(os.path.exists(self.path("out", "dataset.json")))

    def imports(self, raw, out, *more):
        done = run(self.kind, raw, "-o", out, *more)
        self.assertEqual(done.returncode, 0, done.stderr)
        return done.stdout

    def changed(self, name, change):
        """Returns a copy of the raw recording, made of links, in which `change` replaces one file."""
        copy = self.path("copy")
        subprocess.run(["cp", "-rs", self.raw, copy], check=True)
        path = os.path.join(copy, name)
        os.remove(path)
        change(path)
        return copy

    def hold_to_street(self, out, first=0, tolerance=1e-8):
        """Compares poses with the street's; rounding to 17 digits and quaternions set the tolerance."""
        for t in range(len(os.listdir(os.path.join(out, "ego_pose")))):
            ego = matrix(self.street, "ego_pose", f"{t + first:03d}.txt")
            np.testing.assert_allclose(matrix(out, "ego_pose", f"{t:06d}.txt"), ego, atol=tolerance)
            for n in range(len(load(out, "dataset.json")["cameras"])):
                np.testing.assert_allclose(
                    matrix(out, "extrinsics", f"{t:06d}_{n}.txt"),
                    ego @ matrix(self.street, "extrinsics", f"{n}.txt"),
                    atol=tolerance,
                )


# ---- Argoverse 2 ----


def rows_of_poses(poses):
    """Returns columns of quaternions and translations, as Argoverse 2's tables have them."""
    table = {key: [] for key in ("qw", "qx", "qy", "qz", "tx_m", "ty_m", "tz_m")}
    for pose in poses:
        (x, y, z, w), (a, b, c) = parts(pose)
        for key, value in zip(table, (w, x, y, z, a, b, c)):
            table[key].append(value)
    return table


class Argoverse2(Importer):
    kind, NAMES, START = "argoverse2", ("ring_front_center", "ring_front_left"), 315_966_253_660_357_000

    @classmethod
    def setUpClass(cls):
        shared = cls.shared_folder()
        cls.street, cls.raw = make_street(os.path.join(shared, "street"), FRAMES), os.path.join(shared, "logs", "a-log")
        street, times = cls.street, load(cls.street, "timestamps.json")["frames"]
        stamps = [cls.START + round(t * 1e9) for t in times]
        egos = [matrix(street, "ego_pose", f"{t:03d}.txt") for t in range(FRAMES)]
        feather = lambda name, table: (
            os.makedirs(os.path.dirname(os.path.join(cls.raw, name)), exist_ok=True),
            pd.DataFrame(table).to_feather(os.path.join(cls.raw, name)),
        )  # noqa: E731
        feather("city_SE3_egovehicle.feather", {"timestamp_ns": stamps, **rows_of_poses(egos)})
        lenses = [np.loadtxt(os.path.join(street, "intrinsics", f"{n}.txt")) for n in range(2)]
        pinhole = {
            "fx_px": [k[0] for k in lenses],
            "fy_px": [k[1] for k in lenses],
            "cx_px": [k[2] - 0.5 for k in lenses],
            "cy_px": [k[3] - 0.5 for k in lenses],
        }
        feather(
            "calibration/intrinsics.feather",
            {
                "sensor_name": cls.NAMES,
                **pinhole,
                "k1": [-0.2, -0.3],
                "k2": [0.1, 0.1],
                "k3": [0.0, 0.0],
                "height_px": np.array([96, 96], np.uint16),
                "width_px": np.array([160, 160], np.uint16),
            },
        )
        feather(
            "calibration/egovehicle_SE3_sensor.feather",
            {
                "sensor_name": [*cls.NAMES, "up_lidar"],
                **rows_of_poses([matrix(street, "extrinsics", f"{n}.txt") for n in range(2)] + [np.eye(4)]),
            },
        )
        for t, stamp in enumerate(stamps):
            for n, name in enumerate(cls.NAMES):
                write(
                    os.path.join(cls.raw, "sensors", "cameras", name, f"{stamp}.jpg"),
                    jpeg(os.path.join(street, "images", f"{t:03d}_{n}.png")),
                )
            rows = sweep(street, f"{t:03d}.bin")
            feather(
                f"sensors/lidar/{stamp}.feather",
                {
                    "x": rows[:, 0].astype(np.float16),
                    "y": rows[:, 1].astype(np.float16),
                    "z": rows[:, 2].astype(np.float16),
                    "intensity": (rows[:, 3] * 255).astype(np.uint8),
                    "laser_number": np.zeros(len(rows), np.uint8),
                    "offset_ns": np.zeros(len(rows), np.int32),
                },
            )
        table = []
        for (t, track), (name, pose, size) in sorted(labels(street).items(), key=lambda item: item[0][1]):
            (x, y, z, w), (a, b, c) = parts(np.linalg.inv(egos[t]) @ pose)
            table.append(
                {
                    "timestamp_ns": stamps[t],
                    "track_uuid": track,
                    "category": name,
                    "length_m": size[0],
                    "width_m": size[1],
                    "height_m": size[2],
                    "qw": w,
                    "qx": x,
                    "qy": y,
                    "qz": z,
                    "tx_m": a,
                    "ty_m": b,
                    "tz_m": c,
                    "num_interior_pts": 5,
                }
            )
        feather("annotations.feather", table)

    def test_the_import_matches_the_street(self):
        out = self.path("out")
        self.assertIn(f"{FRAMES} time steps, 2 cameras", self.imports(os.path.dirname(self.raw), out))
        self.hold_to_street(out)
        self.assertEqual(load(out, "dataset.json")["cameras"], {"0": "ring_front_center", "1": "ring_front_left"})
        self.assertEqual(
            np.loadtxt(os.path.join(out, "intrinsics", "1.txt")).tolist(),
            np.loadtxt(os.path.join(self.street, "intrinsics", "1.txt"))[:4].tolist(),
        )
        true, made = labels(self.street), labels(out)
        self.assertEqual(set(made), set(true))
        for key, (name, pose, size) in made.items():
            self.assertEqual(name, true[key][0])
            np.testing.assert_allclose(pose, true[key][1], atol=1e-7)
            np.testing.assert_array_equal(size, true[key][2])
        stamps = sorted(os.listdir(os.path.join(self.raw, "sensors", "cameras", "ring_front_left")))
        for t, name in enumerate(stamps):
            got, rows = sweep(out, f"{t:06d}.bin"), sweep(self.street, f"{t:03d}.bin")
            np.testing.assert_array_equal(got[:, :3], rows[:, :3].astype(np.float16).astype(np.float32))
            self.assertEqual(
                read(os.path.join(out, "images", f"{t:06d}_1.jpg")),
                read(os.path.join(self.raw, "sensors", "cameras", "ring_front_left", name)),
            )
        overlay = json.loads(self.succeeds("info", out, "--overlay", self.path("look"), "--json", "-").stdout)[
            "overlay"
        ]
        self.assertEqual(overlay["warnings"], [])
        self.assertGreater(overlay["lidar_in_boxes"], 0.98)  # half floats move points by up to 3 cm at 50 m

    def test_boxes_between_labels(self):
        """If every second label is left out, boxes of the steps in between lie halfway between their neighbours."""
        out = self.path("out")
        stamps = [self.START + round(t * 1e9) for t in load(self.street, "timestamps.json")["frames"]]
        copy = self.changed(
            "annotations.feather",
            lambda path: (
                pd.read_feather(os.path.join(self.raw, "annotations.feather"))
                .query("timestamp_ns in @stamps[::2]", local_dict={"stamps": stamps})
                .reset_index(drop=True)
                .to_feather(path)
            ),
        )
        self.imports(copy, out)
        made = labels(out)
        between = [key for key in made if key[0] % 2 and (key[0] - 1, key[1]) in made and (key[0] + 1, key[1]) in made]
        self.assertGreater(len(between), 20)
        for t, track in between:
            middle = 0.5 * (made[t - 1, track][1][:3, 3] + made[t + 1, track][1][:3, 3])
            np.testing.assert_allclose(made[t, track][1][:3, 3], middle, atol=1e-6)

    def test_choice_and_resuming(self):
        out, again = self.path("out"), self.path("again")
        choice = ["--cameras", "ring_front_left", "--frames", "2-6"]
        self.imports(self.raw, out, *choice)
        self.assertEqual(load(out, "dataset.json")["cameras"], {"0": "ring_front_left"})
        self.assertEqual(len(os.listdir(os.path.join(out, "ego_pose"))), 5)
        self.assertIn("is already complete", self.imports(self.raw, out, *choice))
        self.refused_at(out, "from another source or with other options started here")
        # If an import is stopped after some photographs, the same command completes it with the same bytes.
        self.imports(self.raw, again, *choice)
        for name in ["dataset.json", "timestamps.json", "images/000003_0.jpg", "lidar/000004.bin"]:
            os.remove(os.path.join(again, *name.split("/")))
        kept = os.stat(os.path.join(again, "images", "000001_0.jpg")).st_mtime_ns
        self.imports(self.raw, again, *choice)
        self.assertEqual(os.stat(os.path.join(again, "images", "000001_0.jpg")).st_mtime_ns, kept)
        for name in files_below(out):
            self.assertEqual(read(os.path.join(out, name)), read(os.path.join(again, name)), name)

    def refused_at(self, out, *words):
        done = run(self.kind, self.raw, "-o", out)
        self.assertEqual((done.returncode, done.stderr.count("\n")), (1, 1), done.stderr)
        for word in words:
            self.assertIn(word, done.stderr)

    def test_interrupted(self):
        process = subprocess.Popen(
            command(self.kind, self.raw, "-o", self.path("out")),
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
            env=ENVIRONMENT,
        )
        while process.poll() is None and not os.path.exists(self.path("out", "import.json")):
            time.sleep(0.005)
        process.send_signal(signal.SIGINT)
        _, said = process.communicate(timeout=60)
        if process.returncode != 0:  # otherwise the import ended before the signal
            self.assertEqual((process.returncode, said.count("\n")), (3, 1), said)
            self.assertFalse(os.path.exists(self.path("out", "dataset.json")))
        self.imports(self.raw, self.path("out"))

    def test_bad_input(self):
        self.refused(self.path("none"), "none: not a folder")
        self.refused(self.street, "found no recording of Argoverse 2")
        self.refused(
            self.changed("annotations.feather", lambda path: write(path, b"ARROW1\0\0" + b"\xff" * 300)),
            "annotations.feather",
            "can't be read as feather",
        )

    def test_missing_table(self):
        self.refused(
            self.changed("calibration/intrinsics.feather", lambda path: None), "intrinsics.feather: is missing"
        )

    def test_missing_column(self):
        self.refused(
            self.changed(
                "city_SE3_egovehicle.feather", lambda path: pd.DataFrame({"timestamp_ns": [1]}).to_feather(path)
            ),
            "city_SE3_egovehicle.feather",
            "no column 'qw'",
        )

    def test_cut_photograph(self):
        name = sorted(os.listdir(os.path.join(self.raw, "sensors", "cameras", "ring_front_left")))[3]
        at = f"sensors/cameras/ring_front_left/{name}"
        self.refused(
            self.changed(at, lambda path: write(path, read(os.path.join(self.raw, at))[:900])),
            name,
            "can't be read as a picture",
        )

    def test_by_the_program(self):
        """pags import starts the package in its installation folder, whatever the working directory, and returns its
        exit codes."""
        out = self.path("out")
        self.write("here/pags_recordings/__init__.py", "raise SystemExit('a file of the working directory')")
        self.write("here/pags_recordings/__main__.py", "raise SystemExit('a file of the working directory')")
        words = ["import", "argoverse2", self.raw, "-o", out, "--frames", "5-", "--json", "-"]
        self.assertEqual(json.loads(self.succeeds(*words, cwd=self.path("here")).stdout)["kind"], "argoverse2")
        self.assertEqual(len(os.listdir(os.path.join(out, "ego_pose"))), 3)
        self.imports(self.raw, self.path("other"), "--frames", "5-")
        for name in files_below(out):
            self.assertEqual(read(os.path.join(out, name)), read(self.path("other", name)), name)
        self.fails(["import", "argoverse2", self.street, "-o", self.path("x")], "found no recording of Argoverse 2")
        self.fails(
            ["import", "argoverse3", self.street, "-o", self.path("x")],
            "expected kitti, waymo, argoverse2, nuscenes, pandaset, waymo2, kitti360, ncore or photos",
            code=2,
        )

    def test_usage(self):
        for words in (
            ["argoverse3", self.raw, "-o", "x"],
            ["argoverse2", self.raw],
            ["argoverse2", self.raw, "-o", "x", "--frames", "5-2"],
        ):
            self.assertEqual(run(*words).returncode, 2)
        self.refused(self.raw, "no camera is named 'rear'", more=["--cameras", "rear"])
        self.refused(os.path.dirname(self.raw), "no recording is named 'b-log'", "a-log", more=["--sequence", "b-log"])


# ---- nuScenes ----


class NuScenes(Importer):
    kind, NAMES, START = "nuscenes", ("CAM_FRONT", "CAM_FRONT_LEFT"), 1_532_402_927_600_000
    CATEGORIES = {"Car": "vehicle.car", "Pedestrian": "human.pedestrian.adult", "Cyclist": "vehicle.bicycle"}
    KEYS = (0, 4, 7)  # sensor data between two samples belong to the later sample

    @classmethod
    def setUpClass(cls):
        shared = cls.shared_folder()
        cls.street, cls.raw = make_street(os.path.join(shared, "street"), FRAMES), os.path.join(shared, "nuscenes")
        street = cls.street
        stamps = [cls.START + round(t * 1e6) for t in load(street, "timestamps.json")["frames"]]
        egos = [matrix(street, "ego_pose", f"{t:03d}.txt") for t in range(FRAMES)]
        cls.lidar = np.block(
            [[about([0.02, 0.01, 1], -1.6), np.array([[0.9], [0.0], [1.8]])], [np.zeros((1, 3)), np.ones((1, 1))]]
        )
        mounts = [matrix(street, "extrinsics", f"{n}.txt") for n in range(2)] + [cls.lidar]
        tables = {
            name: []
            for name in (
                "attribute",
                "visibility",
                "sensor",
                "calibrated_sensor",
                "ego_pose",
                "sample",
                "sample_data",
                "sample_annotation",
                "instance",
                "category",
                "lidarseg",
            )
        }
        tables["log"] = [{"token": "l0", "logfile": "", "vehicle": "", "date_captured": "", "location": ""}]
        tables["map"] = [{"token": "m0", "log_tokens": ["l0"], "category": "semantic_prior", "filename": ""}]
        tables["scene"] = [
            {
                "token": "s0",
                "name": "scene-0061",
                "log_token": "l0",
                "first_sample_token": "k0",
                "last_sample_token": "k7",
                "nbr_samples": 3,
            },
            {
                "token": "s1",
                "name": "scene-0103",
                "log_token": "l0",
                "first_sample_token": "other",
                "last_sample_token": "other",
                "nbr_samples": 0,
            },
        ]
        for n, channel in enumerate([*cls.NAMES, "LIDAR_TOP"]):
            k = np.loadtxt(os.path.join(street, "intrinsics", f"{n}.txt")) if n < 2 else None
            tables["sensor"].append(
                {"token": f"sensor{n}", "channel": channel, "modality": "camera" if n < 2 else "lidar"}
            )
            tables["calibrated_sensor"].append(
                {
                    "token": f"mount{n}",
                    "sensor_token": f"sensor{n}",
                    **cls.part(mounts[n]),
                    "camera_intrinsic": [] if k is None else [[k[0], 0, k[2] - 0.5], [0, k[1], k[3] - 0.5], [0, 0, 1]],
                }
            )
        for t, stamp in enumerate(stamps):
            key, sample = t in cls.KEYS, next(k for k in cls.KEYS if k >= t)
            if key:
                before = [f"k{k}" for k in cls.KEYS if k < t]
                tables["sample"].append(
                    {
                        "token": f"k{t}",
                        "timestamp": stamp,
                        "scene_token": "s0",
                        "prev": before[-1] if before else "",
                        "next": "",
                    }
                )
            for n, channel in enumerate([*cls.NAMES, "LIDAR_TOP"]):
                name = f"{'samples' if key else 'sweeps'}/{channel}/n015__{channel}__{stamp}{'.jpg' if n < 2 else '.pcd.bin'}"
                tables["ego_pose"].append({"token": f"e{t}_{n}", "timestamp": stamp, **cls.part(egos[t])})
                tables["sample_data"].append(
                    {
                        "token": f"d{t}_{n}",
                        "sample_token": f"k{sample}",
                        "ego_pose_token": f"e{t}_{n}",
                        "calibrated_sensor_token": f"mount{n}",
                        "timestamp": stamp,
                        "is_key_frame": key,
                        "width": 160 if n < 2 else 0,
                        "height": 96 if n < 2 else 0,
                        "filename": name,
                    }
                )
                write(
                    os.path.join(cls.raw, *name.split("/")),
                    jpeg(os.path.join(street, "images", f"{t:03d}_{n}.png")) if n < 2 else cls.rows(t).tobytes(),
                )
            if key:
                write(
                    os.path.join(cls.raw, "lidarseg", "v1.0-mini", f"d{t}_2_lidarseg.bin"),
                    (np.arange(len(cls.rows(t))) % 32).astype(np.uint8).tobytes(),
                )
                tables["lidarseg"].append(
                    {
                        "token": f"d{t}_2",
                        "sample_data_token": f"d{t}_2",
                        "filename": f"lidarseg/v1.0-mini/d{t}_2_lidarseg.bin",
                    }
                )
        for (t, track), (name, pose, size) in labels(street).items():
            if t in cls.KEYS:
                tables["sample_annotation"].append(
                    {
                        "token": f"a{t}_{track}",
                        "sample_token": f"k{t}",
                        "instance_token": track,
                        **cls.part(pose),
                        "size": [size[1], size[0], size[2]],
                        "attribute_tokens": [],
                        "visibility_token": "",
                        "prev": "",
                        "next": "",
                        "num_lidar_pts": 5,
                        "num_radar_pts": 0,
                    }
                )
            name = cls.CATEGORIES[name]
            if track not in [row["token"] for row in tables["instance"]]:
                tables["instance"].append({"token": track, "category_token": name})
            if name not in [row["token"] for row in tables["category"]]:
                tables["category"].append({"token": name, "name": name, "index": len(tables["category"])})
        for name, rows in tables.items():
            write(os.path.join(cls.raw, "v1.0-mini", f"{name}.json"), json.dumps(rows))

    @staticmethod
    def part(pose):
        (x, y, z, w), translation = parts(pose)
        return {"rotation": [w, x, y, z], "translation": translation}

    @classmethod
    def rows(cls, t):
        rows = sweep(cls.street, f"{t:03d}.bin").astype(float)
        moved = (rows[:, :3] - cls.lidar[:3, 3]) @ cls.lidar[:3, :3]
        return np.column_stack([moved, rows[:, 3], np.zeros(len(rows))]).astype("<f4")

    def test_the_import_matches_the_street(self):
        out = self.path("out")
        self.assertIn(f"{FRAMES} time steps, 2 cameras", self.imports(self.raw, out, "--sequence", "scene-0061"))
        self.hold_to_street(out)
        self.assertEqual(load(out, "dataset.json")["lidar_columns"], ["x", "y", "z", "intensity", "label"])
        true, made = labels(self.street), labels(out)
        keys = [key for key in true if key[0] in self.KEYS]
        self.assertEqual([key for key in made if key[0] in self.KEYS and key not in true], [])
        for key in keys:
            self.assertEqual(made[key][0], self.CATEGORIES[true[key][0]])
            np.testing.assert_allclose(made[key][1], true[key][1], atol=1e-8)
            np.testing.assert_array_equal(made[key][2], true[key][2])
        between = [key for key in made if key in true and key[0] not in self.KEYS]
        self.assertGreater(len(between), 50)
        for key in between:  # the street's cars change their speed by less than 2 m/s in these 0.4 s
            self.assertLess(np.linalg.norm(made[key][1][:3, 3] - true[key][1][:3, 3]), 0.1, key)
        for t in range(FRAMES):
            rows = np.fromfile(os.path.join(out, "lidar", f"{t:06d}.bin"), "<f4").reshape(-1, 5)
            np.testing.assert_allclose(rows[:, :4], sweep(self.street, f"{t:03d}.bin"), atol=1e-4)
            self.assertEqual(rows[:, 4].tolist(), (np.arange(len(rows)) % 32 * (t in self.KEYS)).tolist())
        overlay = json.loads(self.succeeds("info", out, "--overlay", self.path("look"), "--json", "-").stdout)[
            "overlay"
        ]
        self.assertEqual(overlay["warnings"], [])
        self.assertGreater(overlay["lidar_in_boxes"], 0.98)

    def table(self, name, change):
        """Returns a copy of the raw recording in which the rows of one table are changed."""
        rows = load(self.raw, "v1.0-mini", f"{name}.json")
        return self.changed(f"v1.0-mini/{name}.json", lambda path: write(path, json.dumps(change(rows))))

    def refused(self, raw, *words, more=("--sequence", "scene-0061")):
        super().refused(raw, *words, more=more)

    def test_sequences(self):
        self.refused(self.raw, "there are 2 recordings", "--sequence", "scene-0061, scene-0103", more=())
        self.refused(self.raw, "no recording is named 'x'", more=("--sequence", "x"))
        self.refused(self.raw, "no sample of scene-0103", more=("--sequence", "scene-0103"))

    def test_a_hostile_path(self):
        secret = self.write("secret.jpg", jpeg(os.path.join(self.street, "images", "000_0.png")))
        for name in (secret or self.path("secret.jpg"), "../secret.jpg"):
            copy = self.table("sample_data", lambda rows, name=name: [{**rows[0], "filename": name}, *rows[1:]])
            self.refused(copy, "is not below", "secret.jpg")
            subprocess.run(["rm", "-rf", copy, self.path("out")], check=True)

    def test_missing_rows(self):
        self.refused(self.table("ego_pose", lambda rows: rows[3:]), "ego_pose.json", "doesn't exist")

    def test_missing_keys(self):
        self.refused(
            self.table("calibrated_sensor", lambda rows: [{"token": "mount0"}]),
            "calibrated_sensor.json: row 0 has no 'sensor_token'",
        )

    def test_cut_table(self):
        self.refused(
            self.changed("v1.0-mini/sample.json", lambda path: write(path, '[{"token": ')), "sample.json: not JSON"
        )

    def test_cut_sweep(self):
        name = load(self.raw, "v1.0-mini", "sample_data.json")[2]["filename"]
        self.refused(self.changed(name, lambda path: write(path, b"\0" * 44)), "11 numbers are not rows of 5")


# ---- PandaSet ----


class PandaSet(Importer):
    kind, NAMES, START = "pandaset", ("front_camera", "left_camera"), 1_557_539_924.5
    LIDAR = np.array(
        [[0.0, 1, 0, 0], [-1, 0, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]
    )  # the car's x axis (forward) is the LiDAR's y axis

    @classmethod
    def setUpClass(cls):
        shared = cls.shared_folder()
        cls.street, cls.raw = (
            make_street(os.path.join(shared, "street"), FRAMES),
            os.path.join(shared, "pandaset", "002"),
        )
        street, times = cls.street, load(cls.street, "timestamps.json")["frames"]
        stamps = [cls.START + t for t in times]
        egos = [matrix(street, "ego_pose", f"{t:03d}.txt") for t in range(FRAMES)]
        put = lambda content, *names: write(os.path.join(cls.raw, *names), json.dumps(content))  # noqa: E731
        put([cls.part(ego @ cls.LIDAR) for ego in egos], "lidar", "poses.json")
        put(stamps, "lidar", "timestamps.json")
        for n, name in enumerate(cls.NAMES):
            k, mount = (
                np.loadtxt(os.path.join(street, "intrinsics", f"{n}.txt")),
                matrix(street, "extrinsics", f"{n}.txt"),
            )
            put({"fx": k[0], "fy": k[1], "cx": k[2] - 0.5, "cy": k[3] - 0.5}, "camera", name, "intrinsics.json")
            put([cls.part(ego @ mount) for ego in egos], "camera", name, "poses.json")
            put([stamp - 0.05 for stamp in stamps], "camera", name, "timestamps.json")
            for t in range(FRAMES):
                write(
                    os.path.join(cls.raw, "camera", name, f"{t:02d}.jpg"),
                    jpeg(os.path.join(street, "images", f"{t:03d}_{n}.png")),
                )
        put({"5": "Vegetation"}, "annotations", "semseg", "classes.json")
        boxes = labels(street)
        for t in range(FRAMES):
            rows = sweep(street, f"{t:03d}.bin").astype(float)
            points = rows[:, :3] @ egos[t][:3, :3].T + egos[t][:3, 3]
            columns = {
                "x": points[:, 0],
                "y": points[:, 1],
                "z": points[:, 2],
                "i": rows[:, 3],
                "t": np.full(len(rows), stamps[t]),
                "d": np.arange(len(rows)) % 2,
            }
            write(os.path.join(cls.raw, "lidar", f"{t:02d}.pkl.gz"), old_pickle.packed(columns))
            write(
                os.path.join(cls.raw, "annotations", "semseg", f"{t:02d}.pkl.gz"),
                old_pickle.packed({"class": np.arange(len(rows)) % 43}),
            )
            write(
                os.path.join(cls.raw, "annotations", "cuboids", f"{t:02d}.pkl.gz"),
                old_pickle.packed(cls.cuboids(boxes, t)),
            )

    @staticmethod
    def part(pose):
        (x, y, z, w), (a, b, c) = parts(pose)
        return {"position": {"x": a, "y": b, "z": c}, "heading": {"w": w, "x": x, "y": y, "z": z}}

    @classmethod
    def cuboids(cls, boxes, t):
        """Returns the street's boxes, and from the second time step on a twin of the first box, which the
        forward-looking LiDAR sees."""
        rows, now = [], sorted((track, *box) for (frame, track), box in boxes.items() if frame == t)
        for n, (track, name, pose, size) in enumerate(now):
            yaw = np.arctan2(pose[1, 0], pose[0, 0]) - np.pi / 2
            row = [
                track,
                name,
                yaw,
                *pose[:3, 3],
                size[1],
                size[0],
                size[2],
                "twin" if n == 0 else "-",
                0 if n == 0 else -1,
            ]
            rows += (
                [row]
                if n or t == 0
                else [row, ["twin", name, yaw, *(pose[:3, 3] + 0.3), size[1], size[0], size[2], track, 1]]
            )
        return {
            name: np.array([row[i] for row in rows], object if isinstance(rows[0][i], str) else None)
            for i, name in enumerate(pandaset.BOX)
        } | {"stationary": np.zeros(len(rows), bool)}

    def test_the_import_matches_the_street(self):
        out = self.path("out")
        self.assertIn(f"{FRAMES} time steps, 2 cameras", self.imports(os.path.dirname(self.raw), out))
        self.hold_to_street(out)
        self.assertEqual(load(out, "dataset.json")["lidar_columns"], ["x", "y", "z", "intensity", "sensor", "label"])
        self.assertAlmostEqual(
            load(out, "timestamps.json")["cameras"]["1"][2],
            load(self.street, "timestamps.json")["frames"][2]
            - load(self.street, "timestamps.json")["frames"][0]
            - 0.05,
            places=6,
        )
        for n in range(2):
            np.testing.assert_allclose(
                np.loadtxt(os.path.join(out, "intrinsics", f"{n}.txt"))[:4],
                np.loadtxt(os.path.join(self.street, "intrinsics", f"{n}.txt"))[:4],
                atol=1e-12,
            )
        true, made = labels(self.street), labels(out)
        self.assertEqual(set(made), set(true))  # the twin is left out
        for key, (name, pose, size) in made.items():
            self.assertEqual(name, true[key][0])
            np.testing.assert_allclose(pose, true[key][1], atol=1e-7)
            np.testing.assert_array_equal(size, true[key][2])
        for t in range(FRAMES):
            rows = np.fromfile(os.path.join(out, "lidar", f"{t:06d}.bin"), "<f4").reshape(-1, 6)
            np.testing.assert_allclose(rows[:, :4], sweep(self.street, f"{t:03d}.bin"), atol=1e-4)
            np.testing.assert_array_equal(rows[:, 4], np.arange(len(rows)) % 2)
            np.testing.assert_array_equal(rows[:, 5], np.arange(len(rows)) % 43)
        overlay = json.loads(self.succeeds("info", out, "--overlay", self.path("look"), "--json", "-").stdout)[
            "overlay"
        ]
        self.assertEqual(overlay["warnings"], [])
        self.assertGreater(overlay["lidar_in_boxes"], 0.98)

    def test_a_missing_sweep(self):
        out = self.path("out")
        self.imports(
            self.changed("lidar/03.pkl.gz", lambda path: None), out, "--cameras", "front_camera", "--frames", "2-4"
        )
        self.assertEqual(sorted(os.listdir(os.path.join(out, "lidar"))), ["000000.bin", "000002.bin"])

    def test_a_pickle_that_calls_something(self):
        """Nothing that a pickle names is called: no function of the system or of numpy, and no class by indirect
        access."""
        mark = self.path("called")
        calls = {
            "posix.system": old_pickle.Named(("posix", "system"), (f"touch {mark}",)),
            "builtins.eval": old_pickle.Named(("builtins", "eval"), (f"open({mark!r}, 'w')",)),
            "numpy.load": old_pickle.Named(("numpy", "load"), (mark,)),
            "numpy.core.multiarray.fromfile": old_pickle.Named(("numpy.core.multiarray", "fromfile"), (mark,)),
            "pandas.core.frame.DataFrame.to_csv": old_pickle.Named(("pandas.core.frame", "DataFrame.to_csv"), (mark,)),
        }
        for name, thing in calls.items():
            for part in ("annotations/cuboids/02.pkl.gz", "lidar/02.pkl.gz"):
                content = gzip.compress(old_pickle.dumps(thing))
                copy = self.changed(part, lambda path, content=content: write(path, content))
                self.refused(copy, part, f"names {name}, which is not allowed in a table")
                subprocess.run(["rm", "-rf", copy, self.path("out")], check=True)
        self.assertFalse(os.path.exists(mark))

    def test_bad_tables(self):
        whole = read(os.path.join(self.raw, "lidar", "02.pkl.gz"))
        columns = {name: np.zeros(3) for name in ("x", "y", "z", "i", "d")}
        for content, word in [
            (whole[: len(whole) // 2], "can't be read as a pickled table"),
            (b"no gzip", "can't be read as a pickled table"),
            (gzip.compress(b""), "can't be read as a pickled table"),
            (gzip.compress(old_pickle.dumps([1, 2])), "can't be read as a pickled table"),
            (
                gzip.compress(old_pickle.dumps(old_pickle.Named(("pandas.core.frame", "DataFrame"), (), {"_data": 3}))),
                "can't be read as a pickled table",
            ),
            (old_pickle.packed({"x": np.zeros(3)}), "no column 'y'"),
            (old_pickle.packed(columns), "classes for 3 points"),
        ]:
            copy = self.changed("lidar/02.pkl.gz", lambda path, content=content: write(path, content))
            self.refused(copy, word)
            subprocess.run(["rm", "-rf", copy, self.path("out")], check=True)

    def test_bad_files(self):
        for part, content, word in [
            ("camera/front_camera/intrinsics.json", "{}", "expected fx, fy, cx and cy"),
            ("camera/front_camera/poses.json", "[]", "expected a list"),
            ("camera/front_camera/poses.json", "[{}]", "has 1 entries, but lidar/poses.json 8"),
            ("lidar/timestamps.json", "[1, 2", "can't be read as JSON"),
            ("lidar/poses.json", json.dumps([{"position": {}}] * FRAMES), "expected position x y z"),
        ]:
            copy = self.changed(part, lambda path, content=content: content is None or write(path, content))
            self.refused(copy, word)
            subprocess.run(["rm", "-rf", copy, self.path("out")], check=True)


# ---- Waymo, version 2 ----


class Waymo2(Importer):
    kind, START = "waymo2", 1_552_440_195_362_591
    ROOF = np.block([[about([0, 0, 1], 2.5), np.array([[1.4], [0.1], [2.1]])], [np.zeros((1, 3)), np.ones((1, 1))]])
    AXES = np.array(
        [[0.0, 0, 1, 0], [-1, 0, 0, 0], [0, -1, 0, 0], [0, 0, 0, 1]]
    )  # turns a camera's axes (x right, y down, z forward) into Waymo's (x forward, y left, z up)
    CLASSES = {"Car": 1, "Pedestrian": 2, "Cyclist": 4}

    @classmethod
    def setUpClass(cls):
        shared = cls.shared_folder()
        cls.street, cls.raw = make_street(os.path.join(shared, "street"), FRAMES), os.path.join(shared, "waymo")
        street, names = cls.street, [f"{t:03d}" for t in range(FRAMES)]
        cls.stamps = [cls.START + round(t * 1e6) for t in load(street, "timestamps.json")["frames"]]
        cls.egos = [matrix(street, "ego_pose", f"{name}.txt") for name in names]
        lenses = [np.loadtxt(os.path.join(street, "intrinsics", f"{n}.txt")) for n in range(2)]
        mounts = [matrix(street, "extrinsics", f"{n}.txt") @ np.linalg.inv(cls.AXES) for n in range(2)]
        frames = [{"key.frame_timestamp_micros": stamp} for stamp in cls.stamps]
        cls.put(
            "vehicle_pose",
            "VehiclePoseComponent",
            [key | {"world_from_vehicle.transform": ego.ravel().tolist()} for key, ego in zip(frames, cls.egos)],
        )
        cls.put(
            "camera_calibration",
            "CameraCalibrationComponent",
            [
                {
                    "key.camera_name": n + 1,
                    **dict(
                        zip(("intrinsic.f_u", "intrinsic.f_v", "intrinsic.c_u", "intrinsic.c_v"), lens[:4].tolist())
                    ),
                    **{f"intrinsic.{k}": 0.0 for k in ("k1", "k2", "p1", "p2", "k3")},
                    "extrinsic.transform": mount.ravel().tolist(),
                    "width": 160,
                    "height": 96,
                }
                for n, (lens, mount) in enumerate(zip(lenses, mounts))
            ],
        )
        cls.put("camera_image", "CameraImageComponent", [row for t in range(FRAMES) for row in cls.photographs(t)])
        cls.put(
            "lidar_box", "LiDARBoxComponent", [cls.box(t, track, *box) for (t, track), box in labels(street).items()]
        )
        cls.put(
            "lidar_calibration",
            "LiDARCalibrationComponent",
            [
                {
                    "key.laser_name": 1,
                    "extrinsic.transform": cls.ROOF.ravel().tolist(),
                    "beam_inclination.min": -0.3,
                    "beam_inclination.max": 0.05,
                    "beam_inclination.values": [-0.3, -0.1, -0.04, 0.05],
                },
                {
                    "key.laser_name": 2,
                    "extrinsic.transform": np.eye(4).ravel().tolist(),
                    "beam_inclination.min": -0.4,
                    "beam_inclination.max": 0.2,
                    "beam_inclination.values": None,
                },
            ],
        )
        dice = np.random.default_rng(3)
        cls.images = {
            (t, laser): np.where(dice.random((4, 7, 1)) < 0.2, -1, dice.uniform(3, 60, (4, 7, 4))).astype(np.float32)
            for t in range(FRAMES)
            for laser in (1, 2)
        }
        cls.turns = {
            t: dice.normal(0, 0.02, (4, 7, 6)).astype(np.float32) + cls.flat(cls.egos[t]) for t in range(FRAMES)
        }
        image = lambda name, array: {
            f"{name}.values": [] if array is None else array.ravel().tolist(),
            f"{name}.shape": None if array is None else list(array.shape),
        }  # noqa: E731
        cls.put(
            "lidar",
            "LiDARComponent",
            [
                frames[t]
                | {
                    "key.laser_name": laser,
                    **image("range_image_return1", cls.images[t, laser]),
                    **image("range_image_return2", cls.images[t, 2] if laser == 1 else None),
                }
                for t in range(FRAMES)
                for laser in (1, 2)
            ],
        )
        cls.put(
            "lidar_pose",
            "LiDARPoseComponent",
            [frames[t] | {"key.laser_name": 1, **image("range_image_return1", cls.turns[t])} for t in range(FRAMES)],
        )

    @staticmethod
    def flat(pose):
        """Returns roll, pitch, yaw and position of a car on flat ground."""
        return np.array([0, 0, np.arctan2(pose[1, 0], pose[0, 0]), *pose[:3, 3]], np.float32)

    @classmethod
    def put(cls, folder, component, rows, raw=None):
        path = os.path.join(raw or cls.raw, folder, "a-segment.parquet")
        os.makedirs(os.path.dirname(path), exist_ok=True)
        named = [
            {
                "key.segment_context_name": "a-segment",
                **{name if name.startswith("key.") else f"[{component}].{name}": value for name, value in row.items()},
            }
            for row in rows
        ]
        pq.write_table(pa.Table.from_pylist(named), path, row_group_size=5)

    @classmethod
    def photographs(cls, t):
        """Yields rows of photographs whose poses are 8 ms before the middle of the exposure. From there the car
        continues at 5 m/s and turns at 0.3 rad/s about a slanted axis."""
        way, turn = np.array([5.0, 1, 0]) * 0.008, np.array([0.1, 0, 0.3]) * 0.008
        before = cls.egos[t].copy()
        before[:3, :3] = about(turn, -np.linalg.norm(turn)) @ before[:3, :3]
        before[:3, 3] -= way
        at = cls.stamps[t] / 1e6
        for n in range(2):
            yield {
                "key.frame_timestamp_micros": cls.stamps[t],
                "key.camera_name": n + 1,
                "image": jpeg(os.path.join(cls.street, "images", f"{t:03d}_{n}.png")),
                "pose.transform": before.ravel().tolist(),
                "pose_timestamp": at,
                **{f"velocity.linear_velocity.{axis}": v / 0.008 for axis, v in zip("xyz", way)},
                **{f"velocity.angular_velocity.{axis}": v / 0.008 for axis, v in zip("xyz", turn)},
                "rolling_shutter_params.shutter": 0.003,
                "rolling_shutter_params.camera_trigger_time": at - 0.012,
                "rolling_shutter_params.camera_readout_done_time": at + 0.028,
            }

    @classmethod
    def box(cls, t, track, name, pose, size):
        pose = np.linalg.inv(cls.egos[t]) @ pose
        centre, heading = pose[:3, 3], np.arctan2(pose[1, 0], pose[0, 0])
        return {
            "key.frame_timestamp_micros": cls.stamps[t],
            "key.laser_object_id": track,
            "type": cls.CLASSES[name],
            "box.heading": heading,
            **{f"box.center.{axis}": v for axis, v in zip("xyz", centre)},
            **{f"box.size.{axis}": v for axis, v in zip("xyz", size)},
        }

    def expected(self, t):
        """Yields the expected LiDAR points, computed one by one."""
        beams = {1: [-0.3, -0.1, -0.04, 0.05], 2: [-0.325, -0.175, -0.025, 0.125]}
        for laser, image, beam in [(1, self.images[t, 1], 1), (1, self.images[t, 2], 1), (2, self.images[t, 2], 2)]:
            mount = self.ROOF if laser == 1 else np.eye(4)
            for r in range(4):
                for c in range(7):
                    d, up, around = (
                        float(image[r, c, 0]),
                        beams[beam][3 - r],
                        np.pi - (c + 0.5) * 2 * np.pi / 7 - (2.5 if laser == 1 else 0),
                    )
                    if d > 0:
                        p = mount @ [
                            d * np.cos(up) * np.cos(around),
                            d * np.cos(up) * np.sin(around),
                            d * np.sin(up),
                            1,
                        ]
                        roll, pitch, yaw, *place = self.turns[t][r, c].astype(float)
                        if laser == 1:
                            world = (
                                about([0, 0, 1], yaw) @ about([0, 1, 0], pitch) @ about([1, 0, 0], roll) @ p[:3] + place
                            )
                            p = np.linalg.inv(self.egos[t]) @ [*world, 1]
                        yield [*p[:3], float(image[r, c, 1])]

    def test_the_import_matches_the_street(self):
        out = self.path("out")
        self.assertIn(f"{FRAMES} time steps, 2 cameras", self.imports(self.raw, out))
        self.hold_to_street(
            out, tolerance=3e-6
        )  # times near 1.5e9 s are rounded to 0.24 us, during which a car drives at 5 m/s
        for n in range(2):
            np.testing.assert_allclose(
                np.loadtxt(os.path.join(out, "intrinsics", f"{n}.txt"))[:4],
                np.loadtxt(os.path.join(self.street, "intrinsics", f"{n}.txt"))[:4],
                atol=1e-12,
            )
        self.assertAlmostEqual(
            load(out, "timestamps.json")["cameras"]["1"][2] - load(out, "timestamps.json")["frames"][2], 0.008, places=5
        )
        true, made = labels(self.street), labels(out)
        self.assertEqual(set(made), set(true))
        for key, (name, pose, size) in made.items():
            self.assertEqual(name, {"Car": "Vehicle"}.get(true[key][0], true[key][0]))
            upright = np.linalg.inv(self.egos[key[0]]) @ true[key][1]  # Waymo's boxes stand upright in the car's frame
            heading = np.arctan2(upright[1, 0], upright[0, 0])
            upright[:3, :3] = about([0, 0, 1], heading)
            np.testing.assert_allclose(pose, self.egos[key[0]] @ upright, atol=1e-7)
            np.testing.assert_array_equal(size, true[key][2])
        for t in range(FRAMES):
            np.testing.assert_allclose(
                sweep(out, f"{t:06d}.bin"), np.array(list(self.expected(t))), atol=3e-5
            )  # float32 at 100 m
        self.assertEqual(
            read(os.path.join(out, "images", "000003_1.jpg")), jpeg(os.path.join(self.street, "images", "003_1.png"))
        )
        self.succeeds("info", out, "--overlay", self.path("look"))

    def test_bad_input(self):
        self.refused(self.street, "found no recording of Waymo Open Dataset, version 2")
        for part, content, words in [
            ("lidar_box", b"PAR1" + bytes(60), ["lidar_box/a-segment.parquet: can't be read as parquet"]),
            (
                "camera_image",
                read(os.path.join(self.raw, "camera_image", "a-segment.parquet"))[:-3000],
                ["camera_image/a-segment.parquet: can't be read as parquet"],
            ),
            ("vehicle_pose", None, ["vehicle_pose/a-segment.parquet: is missing"]),
        ]:
            name = f"{part}/a-segment.parquet"
            copy = self.changed(name, lambda path, content=content: content is None or write(path, content))
            self.refused(copy, *words)
            subprocess.run(["rm", "-rf", copy, self.path("out")], check=True)

    def test_bad_tables(self):
        key = {"key.frame_timestamp_micros": self.stamps[0]}
        image = {
            "range_image_return1.values": [1.0] * 24,
            "range_image_return1.shape": [4, 6, 4],
            "range_image_return2.values": [],
            "range_image_return2.shape": None,
        }
        for folder, component, rows, words in [
            (
                "vehicle_pose",
                "VehiclePoseComponent",
                [key],
                ["no column '[VehiclePoseComponent].world_from_vehicle.transform'"],
            ),
            (
                "vehicle_pose",
                "VehiclePoseComponent",
                [key | {"world_from_vehicle.transform": [0.5] * 16}],
                [f"frame {self.stamps[0]} is not rigid"],
            ),
            (
                "vehicle_pose",
                "VehiclePoseComponent",
                [key | {"world_from_vehicle.transform": [1.0, 2.0]}],
                ["expected 16 numbers, found 2"],
            ),
            (
                "lidar",
                "LiDARComponent",
                [key | {"key.laser_name": 2} | image],
                ["LiDAR 2", "has 24 numbers and the shape [4, 6, 4]"],
            ),
            (
                "camera_image",
                "CameraImageComponent",
                [{**row, "image": b"no JPEG"} for row in self.photographs(0)],
                ["can't be read as a picture"],
            ),
        ]:
            copy = self.changed(f"{folder}/a-segment.parquet", lambda path: None)
            self.put(folder, component, rows, copy)
            self.refused(copy, *words)
            subprocess.run(["rm", "-rf", copy, self.path("out")], check=True)


# ---- KITTI-360 ----


class Kitti360(Importer):
    kind, DRIVE, NUMBERS = "kitti360", "2013_05_28_drive_0000_sync", {"Car": 13, "Pedestrian": 19, "Cyclist": 20}
    POSE = np.diag([1.0, -1, -1, 1])  # the car's pose has y right and z down
    VELO = np.block(
        [[about([0.02, -0.01, 1], 0.1), np.array([[0.8], [0.3], [-0.1]])], [np.zeros((1, 3)), np.ones((1, 1))]]
    )  # pose of camera 0 in the Velodyne's frame
    FIRST = 250  # the frames before have no pose

    @classmethod
    def setUpClass(cls):
        shared = cls.shared_folder()
        cls.street, cls.raw = make_street(os.path.join(shared, "street"), FRAMES), os.path.join(shared, "kitti360")
        street, raw, drive = cls.street, cls.raw, cls.DRIVE
        cls.egos = [matrix(street, "ego_pose", f"{t:03d}.txt") for t in range(FRAMES)]
        mounts = [matrix(street, "extrinsics", f"{n}.txt") for n in range(2)]
        cls.turned = [np.eye(4), np.eye(4)]
        cls.turned[0][:3, :3], cls.turned[1][:3, :3] = about([1, 2, 3], 0.01), about([2, 0, 1], -0.02)
        cls.mounts = [cls.POSE @ mount @ turned for mount, turned in zip(mounts, cls.turned)]
        text = lambda values: " ".join(repr(float(v)) for v in np.ravel(values))  # noqa: E731
        put = lambda content, *names: write(os.path.join(raw, *names), content)  # noqa: E731
        put(
            "".join(
                f"image_{n:02d}: {text(mount[:3])}\n" for n, mount in enumerate([*cls.mounts, np.eye(4), np.eye(4)])
            ),
            "calibration",
            "calib_cam_to_pose.txt",
        )
        put(text(cls.VELO[:3]) + "\n", "calibration", "calib_cam_to_velo.txt")
        lines = ["calib_time: 2013", "corner_dist: 0.06"]
        for n in range(2):
            fx, fy, cx, cy = np.loadtxt(os.path.join(street, "intrinsics", f"{n}.txt"))[:4]
            lines += [
                f"S_rect_{n:02d}: 160.0 96.0",
                f"R_rect_{n:02d}: {text(cls.turned[n][:3, :3])}",
                f"P_rect_{n:02d}: {text([fx, 0, cx - 0.5, 0, 0, fy, cy - 0.5, 0, 0, 0, 1, 0])}",
            ]
        put("\n".join(lines) + "\n", "calibration", "perspective.txt")
        put(
            "".join(f"{cls.FIRST + t} {text((ego @ cls.POSE)[:3])}\n" for t, ego in enumerate(cls.egos)),
            "data_poses",
            drive,
            "poses.txt",
        )
        times = load(street, "timestamps.json")["frames"]
        stamps = [f"2013-05-28 08:{30 + i // 600:02d}:{i % 600 / 10:012.9f}" for i in range(cls.FIRST)] + [
            f"2013-05-28 08:40:{t - times[0] + 1:012.9f}" for t in times
        ]
        for n in range(2):
            put("\n".join(stamps) + "\n", "data_2d_raw", drive, f"image_{n:02d}", "timestamps.txt")
            for t in range(FRAMES):
                put(
                    read(os.path.join(street, "images", f"{t:03d}_{n}.png")),
                    "data_2d_raw",
                    drive,
                    f"image_{n:02d}",
                    "data_rect",
                    f"{cls.FIRST + t:010d}.png",
                )
        cls.seen = []
        for t in range(FRAMES):
            rows = sweep(street, f"{t:03d}.bin").astype(float)
            ego_from_velo = cls.POSE @ cls.mounts[0] @ np.linalg.inv(cls.VELO)
            moved = (rows[:, :3] - ego_from_velo[:3, 3]) @ ego_from_velo[:3, :3]
            motion = np.linalg.inv(cls.egos[t] @ ego_from_velo) @ cls.egos[t - 1] @ ego_from_velo if t else np.eye(4)
            moved, seen = uncurl(moved, motion)  # the scanner turns while the car drives
            cls.seen.append(seen)
            put(
                np.column_stack([moved, rows[:, 3]])[seen].astype("<f4").tobytes(),
                "data_3d_raw",
                drive,
                "velodyne_points",
                "data",
                f"{cls.FIRST + t:010d}.bin",
            )
        put(cls.boxes(), "data_3d_bboxes", "train", f"{drive}.xml")

    @classmethod
    def boxes(cls):
        """Writes the boxes as mirrored cubes of 0.5 m around (0.25, 0, 0) that face -y, and adds a building and a
        standing object."""
        tracks, out = {}, ["<?xml version='1.0'?>\n<opencv_storage>\n"]
        body = np.array([[x, y, z] for x in (0.0, 0.5) for y in (-0.25, 0.25) for z in (-0.25, 0.25)])
        matrix_text = lambda m: (
            f"<rows>{m.shape[0]}</rows><cols>{m.shape[1]}</cols><dt>d</dt><data>\n{' '.join(repr(float(v)) for v in m.ravel())}</data>"
        )  # noqa: E731

        def entry(number, frame, kind, instance, pose, size, first, last):
            turned = pose @ np.array([[0.0, -1, 0, 0], [1, 0, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]])  # the body faces -y
            turned[:3, 0] *= -1
            stretch = 2 * np.array([size[1], size[0], size[2]])
            transform = turned.copy()
            transform[:3, :3] = turned[:3, :3] * stretch
            transform[:3, 3] = turned[:3, 3] - turned[:3, 0] * stretch[0] * 0.25
            out.append(
                f"<object{number}><index>{number}</index><label>x</label><category>t</category><semanticId>{kind}</semanticId><instanceId>{instance}</instanceId>"
                f"<timestamp>{frame}</timestamp><dynamic>1</dynamic><start_frame>{first}</start_frame><end_frame>{last}</end_frame>"
                f'<transform type_id="opencv-matrix">{matrix_text(transform)}</transform><vertices type_id="opencv-matrix">{matrix_text(body)}</vertices>'
                f'<faces type_id="opencv-matrix">{matrix_text(np.zeros((12, 3)))}</faces></object{number}>\n'
            )

        truth = labels(cls.street)
        for number, ((t, track), (name, pose, size)) in enumerate(truth.items()):
            instance = tracks.setdefault(track, len(tracks) + 1)
            entry(number, cls.FIRST + t, cls.NUMBERS[name], instance, pose, size, cls.FIRST, cls.FIRST + FRAMES)
        cls.tracks = {number: track for track, number in tracks.items()}
        entry(9000, -1, 11, 77, np.eye(4), [10, 10, 10], 0, 9999)
        entry(9001, -1, 15, 78, np.eye(4), [3, 2, 1], cls.FIRST + 2, cls.FIRST + 4)
        return "".join([*out, "</opencv_storage>\n"])

    def test_the_import_matches_the_street(self):
        out = self.path("out")
        self.assertIn(f"{FRAMES} time steps, 2 cameras", self.imports(self.raw, out))
        self.hold_to_street(out)
        for n in range(2):
            np.testing.assert_allclose(
                np.loadtxt(os.path.join(out, "intrinsics", f"{n}.txt"))[:4],
                np.loadtxt(os.path.join(self.street, "intrinsics", f"{n}.txt"))[:4],
                atol=1e-12,
            )
        found, times = load(out, "timestamps.json")["frames"], load(self.street, "timestamps.json")["frames"]
        np.testing.assert_allclose(np.diff(found), np.diff(times), atol=1e-8)
        true, made, goes = labels(self.street), labels(out), {}
        for (t, track), (_, pose, _) in true.items():
            goes.setdefault(track, []).append(pose[:3, 3])
        standing = {key for key in made if key[1] == "trailer 78"}
        self.assertEqual(sorted(t for t, _ in standing), [2, 3, 4])
        named = {
            (t, self.tracks[int(track.split()[-1])]): box
            for (t, track), box in made.items()
            if (t, track) not in standing
        }
        self.assertEqual(set(named), set(true))
        moving = 0
        for key, (name, pose, size) in named.items():
            self.assertEqual(name, {"Car": "car", "Pedestrian": "person", "Cyclist": "rider"}[true[key][0]])
            np.testing.assert_allclose(pose[:3, 3], true[key][1][:3, 3], atol=1e-7)
            if np.linalg.norm(goes[key[1]][-1] - goes[key[1]][0]) > 2:
                np.testing.assert_allclose(pose, true[key][1], atol=1e-7)
                np.testing.assert_allclose(size, true[key][2], atol=1e-7)
                moving += 1
        self.assertGreater(moving, 20)
        for t in range(FRAMES):
            np.testing.assert_allclose(
                sweep(out, f"{t:06d}.bin"), sweep(self.street, f"{t:03d}.bin")[self.seen[t]], atol=1e-4
            )
            self.assertGreater(self.seen[t].mean(), 0.99)
        overlay = json.loads(self.succeeds("info", out, "--overlay", self.path("look"), "--json", "-").stdout)[
            "overlay"
        ]
        self.assertEqual(overlay["warnings"], [])
        self.assertGreater(overlay["lidar_in_boxes"], 0.98)

    def test_frames(self):
        """--frames takes the recording's frame numbers; frames without a pose are left out."""
        out = self.path("out")
        self.assertIn(
            "2 time steps, 1 camera",
            self.imports(self.raw, out, "--frames", f"248-{self.FIRST + 1}", "--cameras", "image_01"),
        )

    def test_bad_files(self):
        for part, content, words in [
            ("calibration/perspective.txt", "S_rect_00: 1 1\n", ["perspective.txt: has no line R_rect_00:"]),
            ("calibration/calib_cam_to_velo.txt", "1 2 3\n", ["calib_cam_to_velo.txt: expected 12 numbers"]),
            (f"data_poses/{self.DRIVE}/poses.txt", "250 1 2 x\n", ["poses.txt:1: expected 13 numbers"]),
            (f"data_poses/{self.DRIVE}/poses.txt", None, ["poses.txt: is missing"]),
            (f"data_2d_raw/{self.DRIVE}/image_00/timestamps.txt", "yesterday\n", ["timestamps.txt:1: expected a date"]),
            (f"data_3d_raw/{self.DRIVE}/velodyne_points/data/0000000251.bin", b"abc", ["aren't rows of 4 float32"]),
            (f"data_3d_bboxes/train/{self.DRIVE}.xml", "<opencv_storage><object1>", ["can't be read as XML"]),
            (
                f"data_3d_bboxes/train/{self.DRIVE}.xml",
                "<a><object1><transform/><timestamp>x</timestamp></object1></a>",
                ["object1: expected whole numbers"],
            ),
            (
                f"data_2d_raw/{self.DRIVE}/image_01/data_rect/0000000252.png",
                b"x",
                ["0000000252.png: can't be read as a picture"],
            ),
        ]:
            copy = self.changed(part, lambda path, content=content: content is None or write(path, content))
            self.refused(copy, *words)
            subprocess.run(["rm", "-rf", copy, self.path("out")], check=True)


if __name__ == "__main__":
    unittest.TestCase.maxDiff = None
    fixtures.main()
