# SPDX-License-Identifier: Apache-2.0
"""Tests pags import of a small synthetic tree of KITTI's tracking benchmark: stopping, resuming and missing files."""

import json
import os
import random
import signal
import struct
import subprocess
import time

import fixtures
from fixtures import Case, files_below, png_bytes, read, run, write

WIDTH, HEIGHT, FOCAL = 64, 24, 40.0
RIGHT = -0.5 * FOCAL


def row(values):
    return " ".join(f"{value:.12e}" for value in values) + "\n"


def calibration():
    text = ""
    for camera, shift in enumerate([0.0, RIGHT, 2.4, 2.4 + RIGHT]):
        text += f"P{camera}: " + row([FOCAL, 0, WIDTH / 2, shift, 0, FOCAL, HEIGHT / 2, 0, 0, 0, 1, 0])
    text += "R_rect " + row([1, 0, 0, 0, 1, 0, 0, 0, 1])
    text += "Tr_velo_cam " + row([0, -1, 0, 0, 0, 0, -1, -0.1, 1, 0, 0, -0.3])
    return text + "Tr_imu_velo " + row([1, 0, 0, -0.8, 0, 1, 0, 0.3, 0, 0, 1, -0.8])


def make_tree(folder, frames):
    """Writes the tree. The ego vehicle drives north at 10 m/s behind a car at 12 m/s."""
    dice = random.Random(0)
    picture = png_bytes(WIDTH, HEIGHT, dice.randbytes(WIDTH * HEIGHT * 3))
    oxts = labels = ""
    for t in range(frames):
        for camera in ["image_02", "image_03"]:
            write(os.path.join(folder, f"{camera}/0000/{t:06d}.png"), picture)
        points = [
            struct.pack("<4f", dice.uniform(5, 40), dice.uniform(-9, 9), dice.uniform(-2, 2), 0.5) for _ in range(50)
        ]
        write(os.path.join(folder, f"velodyne/0000/{t:06d}.bin"), b"".join(points))
        oxts += (
            " ".join([repr(49 + t * 9e-6), "8.4", "110", "0", "0", repr(1.5707963267948966), "10"] + ["0"] * 23) + "\n"
        )
        labels += f"{t} 0 Car 0 0 0 1 2 3 4 1.5 1.6 4 1 1.6 {10 + 0.2 * t} {-1.5707963267948966}\n"
    write(os.path.join(folder, "calib/0000.txt"), calibration())
    write(os.path.join(folder, "oxts/0000.txt"), oxts)
    write(os.path.join(folder, "label_02/0000.txt"), labels)
    return folder


class Import(Case):
    def setUp(self):
        super().setUp()
        if run("import", "--help").returncode:
            self.skipTest("this build has no pags import")

    def same(self, a, b):
        self.assertEqual(files_below(a), files_below(b))
        for name in files_below(a):
            self.assertEqual(read(os.path.join(a, name)), read(os.path.join(b, name)), name)

    def test_kitti(self):
        raw, out = make_tree(self.path("raw"), 6), self.path("out")
        said = json.loads(self.succeeds("import", "kitti", raw, "-o", out, "--json", "-").stdout)
        self.assertEqual((said["kind"], said["dataset"]), ("kitti", out))
        names = files_below(out)
        for t in range(6):
            for name in [
                f"images/{t:03d}_0.png",
                f"images/{t:03d}_1.png",
                f"ego_pose/{t:03d}.txt",
                f"lidar/{t:03d}.bin",
            ]:
                self.assertIn(name, names)
        # The ego vehicle drives north at 10 m/s, so y grows by 1 m per frame. At KITTI's radius of the Earth, 9e-6
        # degrees are 1.0019 m.
        pose = [float(word) for word in read(os.path.join(out, "ego_pose/005.txt")).split()]
        self.assertAlmostEqual(pose[7], 5 * 1.00187, 3)
        self.assertAlmostEqual(pose[3], 0, 9)
        description = json.loads(read(os.path.join(out, "dataset.json")))
        self.assertEqual((description["kind"], description["object_forward"], description["fps"]), ("kitti", "+x", 10))
        self.assertRegex(self.succeeds("info", out).stdout, r"format +kitti")
        before = {name: os.stat(os.path.join(out, name)).st_mtime_ns for name in names}
        self.succeeds("import", "kitti", raw, "-o", out)
        self.assertEqual(before, {name: os.stat(os.path.join(out, name)).st_mtime_ns for name in files_below(out)})

    def result(self, out):
        return json.loads(read(os.path.join(out, "import.json")))["result"]

    def test_account(self):
        """An import ends with a list of the data read, the data left out, and the reasons. import.json and --json hold
        the same list."""
        raw, out = make_tree(self.path("raw"), 6), self.path("out")
        os.remove(os.path.join(raw, "velodyne/0000/000002.bin"))
        write(os.path.join(raw, "velodyne/0000/000003.bin"), b"")
        lines = read(os.path.join(raw, "label_02/0000.txt")).decode().splitlines(keepends=True)
        write(os.path.join(raw, "label_02/0000.txt"), "".join(lines) + lines[-1].replace("5 0 Car", "9 0 Car", 1))
        words = ["import", "kitti", raw, "-o", out, "--frames", "1-5"]
        said = self.succeeds(*words).stdout.splitlines()
        self.assertRegex(
            said[0], "out: 5 time steps, 2 cameras, 10 photographs, 3 sweeps, 5 boxes, 1 object; imported in "
        )
        self.assertEqual(
            said[1:],
            [
                "left out: 1 time step: --frames chose others",
                "left out: 1 sweep: velodyne/0000/000002.bin: the files are missing",
                f"left out: 1 sweep: {raw}/velodyne/0000/000003.bin: the files are empty",
                "left out: 1 box: Car of track 0 in frame 9 (line 7): past the last photograph, frame 5",
            ],
        )
        result = self.result(out)
        self.assertEqual(
            [result[key] for key in ("steps", "cameras", "photographs", "sweeps", "boxes", "objects")],
            [5, 2, 10, 3, 5, 1],
        )
        # The second import finds a complete data set and writes nothing.
        again = json.loads(self.succeeds(*words, "--json", "-").stdout)
        self.assertEqual({key: again[key] for key in result}, result)

    def test_camera_without_its_last_photograph(self):
        raw, out = make_tree(self.path("raw"), 5), self.path("out")
        os.remove(os.path.join(raw, "image_02/0000/000004.png"))
        done = self.succeeds("import", "kitti", raw, "-o", out)
        self.assertIn("out: 4 time steps, 2 cameras, 8 photographs", done.stdout)
        self.assertIn(
            "1 photographs are left out, as image_02 ends before them; the first is "
            + raw
            + "/image_03/0000/000004.png",
            done.stderr,
        )
        self.assertIn("left out: 1 photograph: ", done.stdout)
        self.assertIn(
            "left out: 1 camera: image_03: --cameras chose others",
            self.succeeds("import", "kitti", raw, "-o", self.path("left"), "--cameras", "0").stdout,
        )

    def test_without_sweeps_and_labels(self):
        raw, out = make_tree(self.path("raw"), 3), self.path("out")
        os.rename(os.path.join(raw, "velodyne"), self.path("velodyne"))
        os.rename(os.path.join(raw, "label_02"), self.path("label_02"))
        said = self.succeeds("import", "kitti", raw, "-o", out).stdout
        self.assertIn("no sweeps: velodyne is missing or empty\nno boxes: label_02 is missing\n", said)

    def test_other_forms(self):
        """Sweeps and labels may be packed, have another extension or be all unusable. The summary doesn't call them
        missing."""
        raw, out = make_tree(self.path("raw"), 3), self.path("out")
        sweep, labels = os.path.join(raw, "velodyne/0000"), os.path.join(raw, "label_02/0000.txt")
        lines = read(labels).decode()
        os.rename(sweep, self.path("sweeps"))
        for name, words in [
            ("velodyne/0000/000000.bin.gz", "has 000000.bin.gz, but no file that ends in .bin"),
            ("velodyne/0000.zip", "0000.zip: sweeps are read from 0000; unpack"),
            ("Velodyne.tar.gz", "Velodyne.tar.gz: sweeps are read from velodyne; unpack"),
        ]:
            write(os.path.join(raw, name), "x")
            self.fails(["import", "kitti", raw, "-o", out], words)
            os.remove(os.path.join(raw, name))
            for folder in ("velodyne/0000", "velodyne"):
                if os.path.isdir(os.path.join(raw, folder)) and not os.listdir(os.path.join(raw, folder)):
                    os.rmdir(os.path.join(raw, folder))
        os.makedirs(os.path.dirname(sweep))
        os.rename(self.path("sweeps"), sweep)
        os.rename(labels, labels[:-4] + ".csv")
        self.fails(["import", "kitti", raw, "-o", out], "0000.csv: boxes are read from 0000.txt")
        write(labels, lines.replace(" 1.5 1.6 4 ", " -1 -1 -1 "))
        self.fails(["import", "kitti", raw, "-o", out], "0000.txt: 3 boxes in these frames, but none has a height")
        write(labels, lines)
        for t in range(3):
            write(os.path.join(sweep, f"{t:06d}.bin"), b"")
        self.fails(["import", "kitti", raw, "-o", out], "3 sweeps in these frames, but all are empty files")
        self.assertFalse(os.path.exists(out))

    def test_interrupted_import_is_resumed(self):
        raw, out, whole = make_tree(self.path("raw"), 40), self.path("out"), self.path("whole")
        running = subprocess.Popen(
            [fixtures.PAGS, "import", "kitti", raw, "-o", out], stdout=subprocess.PIPE, stderr=subprocess.PIPE
        )
        while running.poll() is None and not os.path.exists(os.path.join(out, "images/003_0.png")):
            time.sleep(0.001)
        running.send_signal(signal.SIGINT)
        error = running.communicate(timeout=60)[1].decode()
        self.assertEqual(running.returncode, 3, error)
        self.assertIn("the same command resumes", error)
        self.assertFalse(os.path.exists(os.path.join(out, "dataset.json")))
        self.succeeds("import", "kitti", raw, "-o", out)
        # An import killed at its begin leaves this incomplete file.
        fixtures.write(os.path.join(whole, "import.json.part"), b"{")
        self.succeeds("import", "kitti", raw, "-o", whole)
        self.same(out, whole)

    def test_missing_files(self):
        raw, out = make_tree(self.path("raw"), 3), self.path("out")
        os.remove(os.path.join(raw, "image_03/0000/000001.png"))
        self.fails(["import", "kitti", raw, "-o", out], raw, "lacks image_03/0000/000001.png")
        os.remove(os.path.join(raw, "oxts/0000.txt"))
        os.remove(os.path.join(raw, "calib/0000.txt"))
        self.fails(["import", "kitti", raw, "-o", out], raw, "calib/0000.txt", "oxts/0000.txt")
        self.fails(["import", "kitti", self.path("none"), "-o", out], "none")
        self.fails(["import", "waymo", self.path("none"), "-o", out], "none")
        self.assertFalse(os.path.exists(out))

    def test_folder_with_other_files(self):
        raw = make_tree(self.path("raw"), 3)
        self.write("out/notes.txt", "mine")
        out = self.path("out")
        self.fails(["import", "kitti", raw, "-o", out], out, "--overwrite")
        self.succeeds("import", "kitti", raw, "-o", out, "--overwrite", "--frames", "1-2")
        self.assertIn("notes.txt", files_below(out))
        self.assertNotIn("images/002_0.png", files_below(out))

    def test_usage(self):
        self.fails(
            ["import", "nuplan", "x", "-o", "y"],
            "kitti, waymo, argoverse2, nuscenes, pandaset, waymo2, kitti360, ncore or photos",
            "'nuplan'",
            code=2,
        )
        for frames in ["3-2", "a", "-3", "1-2-3"]:
            self.fails(["import", "kitti", "x", "-o", "y", f"--frames={frames}"], "--frames: expected a span", code=2)
        self.fails(["import", "waymo", "x", "-o", "y", "--sequence", "1"], "--sequence", code=2)
        self.fails(["import", "kitti"], "RAW is missing", code=2)


if __name__ == "__main__":
    fixtures.main()
