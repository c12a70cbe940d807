# SPDX-License-Identifier: Apache-2.0
"""Tests the importers' reports of what was read and left out: lost photographs, files in unexpected forms, duplicate
labels. The tests write tiny raw recordings; test_importers.py compares poses and boxes."""

import contextlib
import gzip
import io
import json
import os
import shutil
import signal
import sys
from itertools import combinations
from unittest import mock

HERE = os.path.dirname(os.path.abspath(__file__))
sys.path[:0] = [os.path.dirname(HERE), os.path.join(os.path.dirname(HERE), "cli")]

from tool_python import TOOLS, need  # noqa: E402

need("recordings", "numpy", "PIL", "pandas", "pyarrow")
sys.path[:0] = [HERE, os.path.join(TOOLS, "recordings")]

import fixtures  # noqa: E402
import fuzz_tables  # noqa: E402
import numpy as np  # noqa: E402
import old_pickle  # noqa: E402
import pandas as pd  # noqa: E402
from fixtures import Case, read, write  # noqa: E402
from pags_recordings import RecordingError, pandaset  # noqa: E402
from pags_recordings import __main__ as importer
from pags_recordings.account import Account, lines  # noqa: E402
from pags_recordings.importing import joined, listed, optional, partners  # noqa: E402
from PIL import Image  # noqa: E402

FORWARD = [0.5, -0.5, 0.5, -0.5]  # quaternion w x y z of a camera that looks along x


def jpeg(path, shade):
    os.makedirs(os.path.dirname(path), exist_ok=True)
    Image.fromarray(np.full((12, 16, 3), shade, np.uint8)).save(path)


class WithImports(Case):
    kind, more = "", ()

    def setUp(self):
        super().setUp()
        self.raw, self.out = self.path("raw"), self.path("out")

    def run_import(self, *more):
        said, wrong = io.StringIO(), io.StringIO()
        words = ["pags import", self.kind, self.raw, "-o", self.out, *self.more, *more]
        with mock.patch.object(sys, "argv", words), contextlib.redirect_stdout(said), contextlib.redirect_stderr(wrong):
            code = importer.main()
        signal.signal(signal.SIGINT, signal.default_int_handler)
        return code, said.getvalue(), wrong.getvalue()

    def imports(self, *more):
        """Imports and returns the messages and the result in import.json. Stores the counts of what was left out, by
        subject and reason, in self.left."""
        code, said, wrong = self.run_import(*more)
        self.assertEqual((code, wrong), (0, ""))
        result = json.loads(read(os.path.join(self.out, "import.json")))["result"]
        self.left = {(row["what"], row["why"]): row["count"] for row in result["left_out"]}
        for line in lines(result["left_out"]):
            self.assertIn(line + "\n", said)
        return said, result

    def counts(self, *more):
        _, result = self.imports(*more)
        return [result[key] for key in ("steps", "photographs", "sweeps", "boxes")]

    def refused(self, *words, more=()):
        code, said, wrong = self.run_import(*more)
        self.assertEqual((code, said, wrong.count("\n")), (1, "", 1), wrong)
        for word in words:
            self.assertIn(word, wrong)
        self.assertFalse(os.path.exists(os.path.join(self.out, "dataset.json")))
        shutil.rmtree(self.out, ignore_errors=True)


class Parts(Case):
    def test_partners(self):
        self.assertEqual(partners([0, 10, 20], [1, 9, 22], 3), [0, 1, 2])
        self.assertEqual(
            partners([0, 20], [0, 12, 16], 9), [0, -1, 1]
        )  # 12 and 16 are both near 20, which goes to the nearer, 16
        self.assertEqual(partners([5, 15, 25, 35], [0, 10, 20, 30], 5), [0, 1, 2, 3])  # half a period late
        self.assertEqual(partners([5, 25, 35, 45], [0, 10, 20, 30], 5), [0, -1, 1, 2])
        self.assertEqual(
            partners([0, 3, 9, 12, 15, 18], [0, 3, 6, 9, 12, 15], 5), [0, 1, -1, 2, 3, 4]
        )  # 6 has no partner; the others keep theirs
        self.assertEqual(partners([0, 0, 10], [0, 10], 3), [0, 2])
        self.assertEqual(partners([0], [0, 0], 3).count(0), 1)
        self.assertEqual(partners([], [1, 2], 3), [-1, -1])
        random = np.random.default_rng(2)
        for trial in range(120):
            times, at = (
                np.sort(random.integers(0, 12 if trial % 2 else 60, random.integers(1, 6 if trial % 2 else 20)))
                for _ in range(2)
            )
            found = partners(times, at, 5)
            used = [j for j in found if j >= 0]
            self.assertEqual(used, sorted(set(used)))  # each at most once, and in the order of time
            self.assertLessEqual(max((abs(times[j] - at[i]) for i, j in enumerate(found) if j >= 0), default=0), 5)
            score = lambda pairs: sum(5.005 - abs(times[j] - at[i]) for i, j in pairs)  # noqa: E731
            if len(times) <= 5 and len(at) <= 5:  # all possible choices that keep the order
                choices = (
                    list(zip(i, j))
                    for n in range(6)
                    for i in combinations(range(len(at)), n)
                    for j in combinations(range(len(times)), n)
                )
                best = max(score(pairs) for pairs in choices if all(abs(times[j] - at[i]) <= 5 for i, j in pairs))
                self.assertAlmostEqual(score([(i, j) for i, j in enumerate(found) if j >= 0]), best)

    def test_every_photograph_is_accounted_for(self):
        random = np.random.default_rng(3)
        for frames in (None, (1, 3)):
            shots = {
                name: np.flatnonzero(random.random(40) < share).tolist()
                for name, share in (("a", 1), ("b", 0.7), ("c", 0.5))
            }
            account = Account()
            steps = joined(shots["a"], shots, 0.4, frames, account)
            rows = list(account.rows.values())
            left = {
                what: sum(row["count"] for row in rows if row["what"] == what) for what in ("time steps", "photographs")
            }
            self.assertEqual(left["time steps"] + len(steps), 40)
            self.assertEqual(left["photographs"] + 3 * len(steps), sum(map(len, shots.values())))

    def test_files_in_other_forms(self):
        folder = self.path("here")
        for name in (
            "a.zip",
            "LABELS",
            "boxes.csv",
            "lidar/00.las",
            "lidar/meta.json",
            "mixed/00.bin",
            "mixed/01.las",
            "empty/x.json",
        ):
            write(os.path.join(folder, name), "x")
        for name in ("a", "labels", "boxes.feather"):
            with self.assertRaisesRegex(RecordingError, "unpack, convert or rename it"):
                optional(folder, name, "things", Account())
        with self.assertRaisesRegex(RecordingError, r"has 00.las, but no file that ends in .bin"):
            listed(os.path.join(folder, "lidar"), (".bin",), "sweeps", Account())
        account = Account()
        self.assertEqual(list(listed(os.path.join(folder, "mixed"), (".bin",), "sweeps", account)), ["00"])
        self.assertEqual(
            [listed(os.path.join(folder, name), (".bin",), "sweeps", account) for name in ("empty", "none")], [{}, {}]
        )
        self.assertEqual([row["count"] for row in account.rows.values()], [1, 0, 0])

    def test_unreadable_data_are_refused(self):
        account = Account()
        account.leave_out("sweeps", "have no points", ["a", "b"])
        account.contains("sweeps", 2, "lidar")
        self.assertEqual(account.result({"sweeps": 1})["sweeps"], 1)
        with self.assertRaisesRegex(
            RecordingError, "lidar: 2 sweeps in these time steps, but none could be read; 2 sweeps: have no points"
        ):
            account.result({"sweeps": 0})


# ---- Damaged tables ----


class Damage(Case):
    """Damaged tables: faults that fuzz_tables.py has found, and a small part of its inputs."""

    def test_damaged_tables(self):
        for name, count in (("pickle", 700), ("parquet", 300), ("feather", 200)):
            done, read_whole = fuzz_tables.run(name, seed=5, count=count)
            self.assertEqual(done, count)
            self.assertGreater(read_whole, 0, name)  # some changes are harmless

    def test_wrong_row_counts(self):
        """A row count in the row groups that differs from the file's is refused; pyarrow would allocate memory by
        it."""
        whole, said = fuzz_tables.parquets("vehicle_pose")[0], []
        for at in (
            i for i in range(whole.rindex(b"PAR1") - 1500, len(whole)) if whole[i] == 12
        ):  # the byte 12 is 6 rows in Parquet's zigzag notation
            write(self.path("vehicle_pose", "a.parquet"), whole[:at] + bytes([10]) + whole[at + 1 :])
            try:
                fuzz_tables.read_parquet(self.path("vehicle_pose", "a.parquet"))
            except RecordingError as error:
                said.append(str(error))
        self.assertTrue(
            any("its row groups have 5 rows, the file 6; expected the same" in words for words in said), said
        )

    def table_of(self, thing):
        path = self.path("00.pkl")
        write(path, old_pickle.dumps(thing))
        return pandaset.table(path, ["x"])

    def test_impossible_arrays(self):
        """Refuses pickled states that would make numpy's types read or write memory outside of their arrays."""
        kind = lambda code, state=(3, "<", None, None, None, -1, -1, 0): old_pickle.Named(
            ("numpy", "dtype"), (code, False, True), state
        )  # noqa: E731
        array = lambda shape, of, data: old_pickle.Named(
            ("numpy.core.multiarray", "_reconstruct"),
            (old_pickle.Named(("numpy", "ndarray"), None), (0,), b"b"),
            (1, shape, of, False, data),
        )  # noqa: E731
        names = array((1,), kind("O8"), ["x"])
        whole = lambda values, names=names: old_pickle.Named(
            ("pandas.core.frame", "DataFrame"),
            (),
            {
                "_data": old_pickle.Named(
                    ("pandas.core.internals.managers", "BlockManager"),
                    (),
                    (  # noqa: E731
                        [],
                        [],
                        [],
                        {
                            "0.14.1": {
                                "axes": [{"data": names}],
                                "blocks": [
                                    {"values": values, "mgr_locs": old_pickle.Named(("builtins", "slice"), (0, 1, 1))}
                                ],
                            }
                        },
                    ),
                )
            },
        )
        self.assertEqual(
            self.table_of(whole(array((1, 2), kind("f8"), np.arange(2.0).tobytes())))["x"].tolist(), [0, 1]
        )
        for values, words in [
            (array((1, 2), kind("O8"), bytes(16)), "number of objects differs"),
            (array((1, 2), kind("O8", (3, "|", None, None, None, -1, -1, 0)), bytes(16)), "number of objects differs"),
            (array((1, 2**40), kind("f8"), bytes(16)), "number of bytes differs"),
            (array((1, -2), kind("f8"), bytes(16)), "number of bytes differs|without shape"),
            (array((1, 2), kind("V8"), bytes(16)), "an array of the unsupported type 'V8'"),
            (array((1, 2), kind("f8,O8"), bytes(32)), "an array of the unsupported type"),
            (3, "another type instead of an array"),
        ]:
            with self.assertRaisesRegex(RecordingError, words):
                self.table_of(whole(values))
        write(self.path("00.pkl"), b"\x80\x03]r\xff\xff\xff\x7f.")
        with self.assertRaisesRegex(RecordingError, "uses memo index 2147483647"):
            pandaset.table(self.path("00.pkl"), ["x"])


# ---- nuScenes ----


class NuScenes(WithImports):
    kind, BEGIN = "nuscenes", 1_532_402_927_600_000

    def setUp(self):
        super().setUp()
        self.tables = {
            name: []
            for name in ("sample", "sample_data", "calibrated_sensor", "sensor", "ego_pose", "sample_annotation")
        }
        self.tables["scene"] = [{"token": "sc", "name": "scene-0001", "first_sample_token": "s0"}]
        self.tables["sample"] = [
            {"token": f"s{i}", "timestamp": self.BEGIN + i * 500_000, "scene_token": "sc"} for i in range(3)
        ]
        for channel, period in (("CAM_FRONT", 1e6 / 12), ("CAM_BACK", 1e6 / 12), ("LIDAR_TOP", 5e4)):
            self.tables["sensor"].append({"token": channel, "channel": channel})
            self.tables["calibrated_sensor"].append(
                {
                    "token": channel,
                    "sensor_token": channel,
                    "translation": [1.5, 0, 1.5],
                    "rotation": FORWARD,
                    "camera_intrinsic": [[10, 0, 8], [0, 10, 6], [0, 0, 1]],
                }
            )
            for i in range(round(1e6 / period) + 1):
                at = self.BEGIN + round(i * period)
                name = f"sweeps/{channel}/{at}.{'bin' if channel == 'LIDAR_TOP' else 'jpg'}"
                if channel == "LIDAR_TOP":
                    write(os.path.join(self.raw, name), np.ones((4, 5), "<f4").tobytes())
                else:
                    jpeg(os.path.join(self.raw, name), 20 + i)
                self.tables["ego_pose"].append(
                    {"token": f"{channel}{i}", "translation": [(at - self.BEGIN) / 1e5, 0, 0], "rotation": [1, 0, 0, 0]}
                )
                self.tables["sample_data"].append(
                    {
                        "token": f"{channel}{i}",
                        "sample_token": f"s{min(2, i // 6)}",
                        "ego_pose_token": f"{channel}{i}",
                        "calibrated_sensor_token": channel,
                        "timestamp": at,
                        "height": 12,
                        "width": 16,
                        "filename": name,
                    }
                )
        self.tables["category"] = [{"token": "k", "name": "vehicle.car"}]
        self.tables["instance"] = [{"token": "inst-A", "category_token": "k"}]
        for i in range(3):
            self.label(i, 30 + 8 * i)
        self.save()

    def label(self, sample, x):
        self.tables["sample_annotation"].append(
            {
                "token": f"a{x}",
                "sample_token": f"s{sample}",
                "instance_token": "inst-A",
                "translation": [x, 3, 0.8],
                "rotation": [1, 0, 0, 0],
                "size": [1.8, 4.5, 1.6],
            }
        )

    def save(self):
        for name, rows in self.tables.items():
            write(os.path.join(self.raw, "v1.0-mini", name + ".json"), json.dumps(rows))

    def data(self, channel):
        return [row for row in self.tables["sample_data"] if row["calibrated_sensor_token"] == channel]

    def photographs_once(self):
        pictures = [
            read(os.path.join(self.out, "images", name))
            for name in sorted(os.listdir(os.path.join(self.out, "images")))
            if "_1." in name
        ]
        self.assertEqual(len(pictures), len(set(pictures)))

    def test_whole(self):
        said, result = self.imports()
        self.assertIn("13 time steps, 2 cameras, 26 photographs, 13 sweeps, 13 boxes, 1 object; check it with", said)
        self.assertEqual(self.left, {("sweeps", "between the time steps: no unmatched step within 0.03 s"): 8})
        again, _ = self.imports()
        self.assertEqual(again, said.replace("out: 13", "out: is already complete; 13"))
        facts = json.loads(self.run_import("--json", "-")[1])
        self.assertEqual({key: facts[key] for key in result}, result)

    def test_lost_photographs(self):
        """If rows or files are missing, no photograph belongs to two time steps, and steps without a photograph are
        counted."""
        for name in ("rows", "files"):
            gone = self.data("CAM_BACK")[4:7]
            if name == "rows":
                self.tables["sample_data"] = [row for row in self.tables["sample_data"] if row not in gone]
                self.save()
            else:
                for row in self.data("CAM_BACK")[6:9]:
                    os.remove(os.path.join(self.raw, row["filename"]))
            self.assertEqual(self.counts("--overwrite")[:2], [10, 20] if name == "rows" else [7, 14])
            self.photographs_once()
            self.assertEqual(
                self.left["time steps", "CAM_BACK has no photograph of its own within 0.05 s"],
                3 if name == "rows" else 6,
            )
        self.assertEqual(self.left["photographs", "CAM_BACK: the files are missing"], 3)
        self.assertEqual(self.left["photographs", "of CAM_FRONT, which match no time step"], 6)

    def test_a_slow_camera(self):
        """A second camera at half the rate, with times between the first camera's, gives each photograph to one time
        step only."""
        keep = [row["token"] for row in self.data("CAM_BACK")[::2]]
        for row in self.data("CAM_BACK"):
            row["timestamp"] += 41_000
        self.tables["sample_data"] = [
            row
            for row in self.tables["sample_data"]
            if row["calibrated_sensor_token"] != "CAM_BACK" or row["token"] in keep
        ]
        self.save()
        self.assertEqual(self.counts()[:2], [7, 14])
        self.photographs_once()

    def test_one_file_in_two_rows(self):
        rows = self.data("CAM_BACK")
        rows[5]["filename"] = rows[4]["filename"]
        self.save()
        self.assertEqual(self.counts()[0], 12)
        self.photographs_once()

    def test_a_label_twice(self):
        self.label(1, 38.1)
        self.save()
        self.assertEqual(self.counts()[3], 13)
        self.assertEqual([count for (what, why), count in self.left.items() if "duplicate label" in why], [1])

    def test_labels_too_far_apart(self):
        self.tables["sample_annotation"] = self.tables["sample_annotation"][::2]
        self.save()
        self.assertEqual(self.counts()[3], 2)
        self.assertEqual(self.left["boxes", "between two labels that are more than 0.75 s apart"], 11)

    def test_an_object_labelled_once(self):
        self.tables["instance"].append({"token": "inst-B", "category_token": "k"})
        self.label(1, 50)
        self.tables["sample_annotation"][-1]["instance_token"] = "inst-B"
        for row in self.tables["sample"]:
            row["timestamp"] += 30_000
        self.save()
        self.assertEqual(self.counts()[3], 13)
        self.assertEqual(
            [row for row in self.left if row[0] == "objects"],
            [("objects", "labelled once, not at a time step, or with too long gaps: no box")],
        )

    def test_missing_sweeps_and_labels(self):
        shutil.rmtree(os.path.join(self.raw, "sweeps", "LIDAR_TOP"))
        os.remove(os.path.join(self.raw, "v1.0-mini", "sample_annotation.json"))
        self.assertEqual(self.counts()[2:], [0, 0])
        self.assertEqual(self.left["sweeps", "LIDAR_TOP: the files are missing"], 21)
        self.assertEqual(
            [why.endswith("sample_annotation.json is missing") for (what, why) in self.left if what == "boxes"], [True]
        )

    def test_files_in_another_form(self):
        for row in self.data("LIDAR_TOP"):
            path = os.path.join(self.raw, row["filename"])
            os.rename(path, path + ".gz")
        self.refused(".bin.gz: sweeps are read from ", "unpack, convert or rename it")

    def test_sweeps_at_other_times(self):
        for row in self.data("LIDAR_TOP"):
            row["timestamp"] += 100
        self.tables["sample_data"] = [
            row for row in self.tables["sample_data"] if row["calibrated_sensor_token"] != "LIDAR_TOP"
        ] + [self.data("LIDAR_TOP")[0] | {"timestamp": self.BEGIN + 41_600}]
        self.save()
        self.refused("sample_data.json: 1 sweep in these time steps, but none could be read")


# ---- PandaSet ----


class PandaSet(WithImports):
    kind, STEPS = "pandaset", 4

    def setUp(self):
        super().setUp()
        pose = lambda x, turn: {"position": {"x": 0.0, "y": float(x), "z": 1.8}, "heading": dict(zip("wxyz", turn))}  # noqa: E731
        times = [0.1 * i for i in range(self.STEPS)]
        for folder, turn in (
            ("lidar", [1.0, 0, 0, 0]),
            ("camera/front_camera", [0.5**0.5, -(0.5**0.5), 0, 0]),
            ("camera/back_camera", [0.5**0.5, -(0.5**0.5), 0, 0]),
        ):
            write(os.path.join(self.raw, folder, "poses.json"), json.dumps([pose(i, turn) for i in range(self.STEPS)]))
            write(os.path.join(self.raw, folder, "timestamps.json"), json.dumps(times))
            write(os.path.join(self.raw, folder, "intrinsics.json"), json.dumps({"fx": 10, "fy": 10, "cx": 8, "cy": 6}))
            for i in range(self.STEPS if folder != "lidar" else 0):
                jpeg(os.path.join(self.raw, folder, f"{i:02d}.jpg"), 20 + i)
        box = dict(zip(pandaset.BOX, ["a", "Car", 0.0, 5.0, 9.0, 1.0, 2.0, 4.0, 1.5, "-", -1]))
        for i in range(self.STEPS):
            self.put("lidar", i, {name: np.ones(3) for name in pandaset.SWEEP})
            self.put(
                "annotations/cuboids",
                i,
                {name: np.array([value], object if isinstance(value, str) else None) for name, value in box.items()},
            )

    def put(self, folder, i, columns):
        write(os.path.join(self.raw, folder, f"{i:02d}.pkl.gz"), old_pickle.packed(columns))

    def rename(self, ending, change=lambda content: content):
        for folder in ("lidar", "annotations/cuboids"):
            for i in range(self.STEPS):
                path = os.path.join(self.raw, folder, f"{i:02d}")
                write(path + ending, change(read(path + ".pkl.gz")))
                if ending != ".pkl.gz":
                    os.remove(path + ".pkl.gz")

    def test_compressed_or_not(self):
        """Decompressed tables give the same data set, whether their names end in .pkl.gz or .pkl."""
        self.assertEqual(self.counts(), [4, 8, 4, 4])
        self.assertEqual(
            [row for row in self.left if row[0] != "cameras"],
            [("classes of LiDAR points", os.path.join(self.raw, "annotations", "semseg") + " is missing")],
        )
        first = {
            name: read(os.path.join(self.out, name)) for name in ("lidar/000002.bin", "instances/instances_info.json")
        }
        for ending, change in ((".pkl.gz", gzip.decompress), (".pkl", lambda content: content)):
            self.rename(ending, change)
            self.assertEqual(self.counts("--overwrite"), [4, 8, 4, 4])
            self.assertEqual({name: read(os.path.join(self.out, name)) for name in first}, first)

    def test_other_forms(self):
        self.rename(".parquet")
        self.refused("has 00.parquet and others, but no file that ends in .pkl.gz or .pkl")
        shutil.rmtree(os.path.join(self.raw, "annotations"))
        write(os.path.join(self.raw, "annotations", "cuboids.zip"), "x")
        self.refused("cuboids.zip: boxes are read from cuboids; unpack")
        shutil.rmtree(os.path.join(self.raw, "annotations"))
        write(os.path.join(self.raw, "annotations.zip"), "x")
        self.refused("annotations.zip: boxes are read from annotations; unpack")
        os.remove(os.path.join(self.raw, "annotations.zip"))
        for i in range(self.STEPS):
            pd.DataFrame({name: np.ones(3) for name in pandaset.SWEEP}).to_pickle(
                os.path.join(self.raw, "lidar", f"{i:02d}.pkl")
            )
        self.refused("00.pkl", "tables of pandas 1.3 and later are not supported")

    def test_lost_files(self):
        os.remove(os.path.join(self.raw, "camera/back_camera/01.jpg"))
        os.remove(os.path.join(self.raw, "lidar/02.pkl.gz"))
        os.remove(os.path.join(self.raw, "annotations/cuboids/03.pkl.gz"))
        self.assertEqual(self.counts(), [3, 6, 2, 2])
        for row in (
            ("time steps", "back_camera has no photograph of them"),
            ("photographs", "of front_camera, whose time steps are incomplete"),
            ("sweeps", "the files are missing"),
            ("files of boxes", "are missing"),
        ):
            self.assertEqual(self.left[row], 1)
        self.assertEqual(self.counts("--overwrite", "--frames", "2-3")[:2], [2, 4])

    def test_numbers(self):
        """Refuses columns without numbers; leaves out rows with non-finite numbers, and a duplicate box."""
        self.put("lidar", 1, {name: np.array(["x"], object) for name in pandaset.SWEEP})
        self.refused("01.pkl.gz: expected numbers in the columns x, y, z, i, d")
        self.put("lidar", 1, {name: np.array([1.0, np.nan]) for name in pandaset.SWEEP})
        self.put("lidar", 2, {name: np.array([np.inf]) for name in pandaset.SWEEP})
        box = dict(zip(pandaset.BOX, ["a", "Car", 0.0, 5.0, 9.0, 1.0, 2.0, 4.0, 1.5, "-", -1]))
        self.put(
            "annotations/cuboids",
            0,
            {name: np.array([value] * 2, object if isinstance(value, str) else None) for name, value in box.items()},
        )
        self.assertEqual(self.counts(), [4, 8, 3, 4])
        self.assertEqual(
            (self.left["LiDAR points", "non-finite numbers"], self.left["sweeps", "have no points"]), (2, 1)
        )
        self.assertEqual(sum(count for (_, why), count in self.left.items() if "duplicate label" in why), 1)


if __name__ == "__main__":
    fixtures.main()
