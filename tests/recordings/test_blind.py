# SPDX-License-Identifier: Apache-2.0
"""Imports raw recordings whose author had read only the data sets' documentation, not the importers. The data sets
must have all of the recordings' contents."""

import hashlib
import os
import pathlib
import shutil
import sys
import types

HERE = os.path.dirname(os.path.abspath(__file__))
sys.path[:0] = [os.path.dirname(HERE), os.path.join(os.path.dirname(HERE), "cli")]

from tool_python import TOOLS, need  # noqa: E402

need("recordings", "numpy", "PIL", "pandas", "pyarrow")
sys.path[:0] = [os.path.join(TOOLS, "recordings")]

import blind_tables  # noqa: E402
import blind_trees  # noqa: E402
import fixtures  # noqa: E402
import numpy as np  # noqa: E402
import pyarrow.feather  # noqa: E402
import pyarrow.parquet  # noqa: E402
from blind_trees import Street, turned  # noqa: E402
from fixtures import Case, files_below  # noqa: E402
from pags_recordings import waymo2  # noqa: E402
from street import labels, load, matrix, world_points  # noqa: E402

FORWARD = {
    "+x": np.eye(4),
    "+y": turned(-np.pi / 2),
}  # turns the axes of a box that faces +x into those of one that faces +y


def photographs(folder):
    """Returns the photographs of a data set: SHA-1 -> step, camera, name, world_from_camera of OpenCV's axes, fx fy
    cx cy k1 k2 p1 p2 k3."""
    told = load(folder, "dataset.json")
    turn = np.eye(4) if told["camera_axes"] == "opencv" else blind_tables.OPENCV_FROM_WAYMO.T
    out = {}
    for file in sorted(os.listdir(os.path.join(folder, "images"))):
        step, camera = (int(part) for part in file.split(".")[0].split("_"))
        digest = hashlib.sha1(pathlib.Path(folder, "images", file).read_bytes()).hexdigest()
        own = os.path.join(folder, "extrinsics", f"{file.split('.')[0]}.txt")
        pose = (
            matrix(own)
            if os.path.exists(own)
            else matrix(folder, "ego_pose", file.split("_")[0] + ".txt") @ matrix(folder, "extrinsics", f"{camera}.txt")
        )
        out[digest] = (
            step,
            told["cameras"][str(camera)],
            pose @ turn,
            lens_of(os.path.join(folder, "intrinsics", f"{camera}.txt")),
        )
    return out


def lens_of(file):
    """Returns fx fy cx cy k1 k2 p1 p2 k3 of a file of intrinsics."""
    values = np.loadtxt(file)
    return np.append(values.ravel(), np.zeros(9))[:9]


def farthest(points, others):
    """Returns the largest distance from a point to the nearest of the others."""
    order = np.lexsort(np.round(others, 1).T)
    others = others[order]
    return max(float(np.sqrt(((others - p) ** 2).sum(1).min())) for p in points)


def make_blind_street(folder):
    done = fixtures.run(
        "synth",
        "street",
        "-o",
        folder,
        "--size",
        "160x90",
        "--frames",
        "10",
        "--lidar-points",
        "2400",
        "--samples",
        "1",
        "--no-shifts",
    )
    assert done.returncode == 0, done.stderr
    return folder


class Blind(Case):
    @classmethod
    def setUpClass(cls):
        cls.street = make_blind_street(os.path.join(cls.shared_folder(), "street"))

    def tree(self, write):
        return write(Street(self.street), self.path("raw"))

    def bring(self, kind, truth):
        done = fixtures.run("import", kind, truth.raw, "-o", self.path("d"), *truth.options)
        self.assertEqual(done.returncode, 0, done.stderr)
        return self.path("d")

    def compare(self, truth, folder, unseen=()):
        """Compares photographs, poses, lenses, boxes and sweeps of a data set with the recording's contents. Frames
        in `unseen` must be left out, because a photograph or a sweep of them is missing."""
        steps, worst = {}, {"pose": 0.0, "lens": 0.0, "box": 0.0, "point": 0.0}
        found = photographs(folder)
        for digest, (frame, name, pose, lens) in truth.photographs.items():
            if frame in unseen:
                self.assertFalse(digest in found)
                continue
            self.assertTrue(digest in found, f"frame {frame} of {name} isn't there byte by byte")
            step, called, got, k = found[digest]
            self.assertEqual(steps.setdefault(step, frame), frame, "a step mixes frames")
            worst["pose"] = max(worst["pose"], np.abs(got - pose).max())
            worst["lens"] = max(worst["lens"], np.abs(k[:4] - lens[:4]).max())
            np.testing.assert_allclose(k[4:9], lens[4:9], atol=1e-9)
        self.assertFalse(set(found) - set(truth.photographs), "photographs of something else")
        told, given = load(folder, "dataset.json"), labels(folder)
        for step, frame in steps.items():
            there = {identity: box for (at, identity), box in given.items() if at == step}
            for identity, (kind, pose, size) in truth.boxes.get(frame, {}).items():
                self.assertTrue(identity in there, f"frame {frame}: a {kind} has no box")
                name, got, extent = there.pop(identity)
                got = got @ np.linalg.inv(FORWARD[told["object_forward"]]) if told["object_forward"] != "+x" else got
                extent = extent if told["object_forward"] == "+x" else extent[[1, 0, 2]]
                self.assertEqual(name.lower(), kind.lower())
                worst["box"] = max(worst["box"], np.abs(got - pose).max(), np.abs(extent - size).max())
            self.assertFalse(set(there) - set(truth.spare.get(frame, {})), f"frame {frame}: boxes of nothing")
            points = world_points(folder, step)
            if frame in truth.points:
                self.assertIsNotNone(points, f"frame {frame} has no sweep")
                self.assertEqual(len(points), len(truth.points[frame]), f"frame {frame}")
                worst["point"] = max(
                    worst["point"],
                    farthest(truth.points[frame][::97], points),
                    farthest(points[::97], truth.points[frame]),
                )
        print("   ", ", ".join(f"{name} {value:.2g}" for name, value in worst.items()))
        self.assertLess(worst["pose"], 2e-3)
        self.assertLess(worst["lens"], 0.5 + 1e-6)  # data sets place the middle of the first pixel at 0 or at 0.5
        self.assertLess(worst["box"], truth.box_error)
        self.assertLess(worst["point"], truth.point_error)
        self.assertTrue(steps)
        return steps

    def test_nuscenes(self):
        truth = self.tree(blind_trees.nuscenes)
        self.compare(truth, self.bring("nuscenes", truth), unseen=[5])

    def test_argoverse2(self):
        truth = self.tree(blind_trees.argoverse2)
        self.compare(truth, self.bring("argoverse2", truth), unseen=range(1, 10, 2))

    def test_a_hostile_name_in_a_table(self):
        """A camera's name is part of a path: a name that leads out of the log's folder is refused, even if
        photographs are there."""
        truth = self.tree(blind_trees.argoverse2)
        log = os.path.join(truth.raw, truth.options[1])
        os.rename(os.path.join(log, "sensors", "cameras", "ring_front_left"), self.path("elsewhere"))
        for name in ("../../../../elsewhere", self.path("elsewhere")):
            for table in ("intrinsics", "egovehicle_SE3_sensor"):
                path = os.path.join(log, "calibration", f"{table}.feather")
                columns = pyarrow.feather.read_table(path).to_pydict()
                columns["sensor_name"] = [
                    name if "elsewhere" in sensor or sensor == "ring_front_left" else sensor
                    for sensor in columns["sensor_name"]
                ]
                pyarrow.feather.write_feather(pyarrow.table(columns), path)
            before = files_below(self.folder)
            self.fails(
                ["import", "argoverse2", truth.raw, "-o", self.path("d"), *truth.options],
                "intrinsics.feather",
                "is not below",
            )
            self.assertEqual([file for file in files_below(self.folder) if not file.startswith("d" + os.sep)], before)
            shutil.rmtree(self.path("d"))

    def test_pandaset(self):
        truth = self.tree(blind_tables.pandaset)
        self.compare(truth, self.bring("pandaset", truth))

    def test_waymo2(self):
        truth = self.tree(blind_tables.waymo2)
        self.compare(truth, self.bring("waymo2", truth), unseen=[4])

    def test_waymo2_shuffled_rows(self):
        """Access to a row of a shuffled table reads only its row group, not the file up to it."""
        order = np.random.default_rng(1).permutation(60)
        os.makedirs(self.path("stats"))
        pyarrow.parquet.write_table(
            pyarrow.table({"key": order, "[S].value": order * 10}), self.path("stats", "a.parquet"), row_group_size=5
        )
        component = waymo2.Component(self.path(), "stats", "a", "S", ["value"], ["key"])
        iterate, rows = component.file.iter_batches, []

        def counted(**given):
            for batch in iterate(**given):
                rows.append(batch.num_rows)
                yield batch

        component.file = types.SimpleNamespace(iter_batches=counted)
        for key in range(60):
            self.assertEqual(component.at(key), {"value": 10 * key})
        self.assertIsNone(component.at(60))
        self.assertLessEqual(sum(rows), 60 * 5)

    def test_kitti360(self):
        truth = self.tree(blind_tables.kitti360)
        self.compare(truth, self.bring("kitti360", truth))


if __name__ == "__main__":
    fixtures.main()
