# SPDX-License-Identifier: Apache-2.0
"""Tests benchmarks/published.py on small recordings in the raw formats: split, crop and counts are the published ones,
and the run ends in a row of a table."""

import io
import json
import os
import shutil
import subprocess
import sys

HERE = os.path.dirname(os.path.abspath(__file__))
sys.path[:0] = [os.path.dirname(HERE), os.path.join(os.path.dirname(HERE), "cli")]

from tool_python import TOOLS, need  # noqa: E402

need("recordings", "numpy", "PIL", "pandas", "pyarrow")
sys.path[:0] = [HERE, os.path.join(os.path.dirname(TOOLS), "benchmarks")]

import fixtures  # noqa: E402
import numpy as np  # noqa: E402
import published  # noqa: E402
import test_importers  # noqa: E402
import test_recordings as v1  # noqa: E402
from fixtures import SMALL, Case, read  # noqa: E402
from PIL import Image  # noqa: E402


def run(*arguments):
    words = [sys.executable, "-B", published.__file__, *arguments[:2], "--pags", fixtures.PAGS, *arguments[2:]]
    return subprocess.run([str(word) for word in words], capture_output=True, text=True)


def views(scene):
    """The scene's views by frame: whether each is held out."""
    return {view["name"].split(".")[0]: view["test"] for view in json.loads(read(f"{scene}/scene.json"))["cameras"]}


class Protocols(Case):
    def test_splits(self):
        held_out = published.half_held_out(80)  # as SplatAD's
        trained = sorted(set(range(80)) - set(held_out))
        self.assertEqual(trained, np.linspace(0, 79, 40, dtype=np.int64).tolist())
        self.assertEqual(held_out[-3:], [75, 77, 78])
        for count in (1, 2, 3, 8, 79):
            trained = np.linspace(0, count - 1, -(-count // 2), dtype=np.int64)
            self.assertEqual(published.half_held_out(count), sorted(set(range(count)) - set(trained.tolist())))
        self.assertEqual(published.fourth_held_out(13), [3, 7, 11])
        self.assertEqual(1080 - round(1080 * published.CUT / published.OF_ROWS), 820)
        self.assertEqual((len(published.PANDASET), len(published.WAYMO)), (10, 12))

    def test_pandaset(self):
        class Tree(test_importers.PandaSet):
            NAMES = ("front_camera", "back_camera")

        Tree.setUpClass()
        self.addCleanup(Tree.doClassCleanups)
        raw, out = self.path("raw"), self.path("out")
        shutil.copytree(Tree.raw, os.path.join(raw, "011"))
        words = ["pandaset", raw, "-o", out, "--sequences", "011"]
        done = run(*words)
        self.assertNotEqual(done.returncode, 0)
        self.assertIn(f"{raw}/011/camera/front_left_camera: is missing", done.stderr)
        for name in set(published.PANDASET_CAMERAS) - set(Tree.NAMES):
            shutil.copytree(os.path.join(raw, "011/camera/front_camera"), os.path.join(raw, "011/camera", name))
        done = run(*words, "--prepare")
        self.assertEqual(done.returncode, 0, done.stderr)
        self.assertIn("011: 24 photographs to train, 24 held out", done.stderr)
        images = os.path.join(out, "011/data/images")
        self.assertEqual(len(os.listdir(images)), 48)
        names = json.loads(read(f"{out}/011/data/dataset.json"))["cameras"]
        for name in os.listdir(images):
            with Image.open(os.path.join(images, name)) as picture:
                back = names[name.split(".")[0].split("_")[1]] == "back_camera"
                self.assertEqual(picture.size, (160, 96 - round(96 * 260 / 1080) if back else 96))
                if back:
                    with Image.open(f"{raw}/011/camera/back_camera/{int(name.split('_')[0]):02}.jpg") as whole:
                        self.assertEqual(picture.tobytes(), whole.crop((0, 0, 160, 73)).tobytes())
        more = ["--iterations", 2, "--", *SMALL]
        done = run(*words, *more)
        self.assertEqual(done.returncode, 0, done.stderr)
        self.assertIn("| 011 | 24 | ", done.stdout)
        self.assertIn("| mean of 1 | 24 | ", done.stdout)
        test = views(f"{out}/011/scene")
        self.assertEqual({int(name.split("_")[0]) for name, held_out in test.items() if held_out}, {1, 3, 5, 6})
        self.assertEqual(len(test), 48)
        self.assertEqual(read(f"{out}/table.md").decode(), done.stdout)
        before = os.stat(f"{out}/011/scene/scene.json").st_mtime_ns
        self.assertEqual(run(*words, *more).stdout, done.stdout)  # kept, not made again
        self.assertEqual(os.stat(f"{out}/011/scene/scene.json").st_mtime_ns, before)

    def segment(self, path, frames):
        """Writes a segment of Waymo v1 with four cameras of 64 x 48 pixels."""
        field, transform = v1.field, v1.transform
        cameras = b"".join(
            field(
                2,
                field(1, n)
                + b"".join(field(2, v) for v in [40.0, 40.0, 32.0, 24.0] + [0.0] * 5)
                + transform(3, 0.1 * n)
                + field(4, 64)
                + field(5, 48)
                + field(6, 2),
            )
            for n in range(1, 5)
        )
        dice = np.random.default_rng(1)
        with open(path, "wb") as file:
            for t in range(frames):
                out = io.BytesIO()
                Image.fromarray(dice.integers(0, 255, (48, 64, 3), np.uint8)).save(out, "JPEG")
                frame = field(1, field(1, "a") + cameras) + field(2, 10**15 + 100000 * t) + transform(3, t)
                for n in range(1, 5):
                    frame += field(4, field(1, n) + field(2, out.getvalue()) + transform(3, t))
                file.write(v1.record(frame))

    def test_waymo(self):
        raw, out = self.path("raw"), self.path("out")
        os.makedirs(raw)
        words = ["waymo", raw, "-o", out, "--sequences", "147"]
        self.assertIn("segment-13207915841618107559", run(*words).stderr)
        self.segment(
            os.path.join(raw, "segment-13207915841618107559_2980_000_3000_000_with_camera_labels.tfrecord"), 58
        )
        done = run(*words, "--iterations", 1, "--", *SMALL)
        self.assertEqual(done.returncode, 0, done.stderr)
        # Frames 6 to 54 are 49 time steps of three cameras; the 4th, 8th, ... 48th are held out.
        self.assertIn("147: 111 photographs to train, 36 held out", done.stderr)
        self.assertIn("| 147 | 36 | ", done.stdout)
        data, test = f"{out}/147/data", views(f"{out}/147/scene")
        self.assertEqual(json.loads(read(f"{data}/dataset.json"))["first_frame"], 6)
        self.assertEqual({int(name.split("_")[0]) for name, held_out in test.items() if held_out}, set(range(3, 49, 4)))
        self.assertEqual({name.split("_")[1] for name in test}, {"0", "1", "2"})
        view = json.loads(read(f"{out}/147/scene/scene.json"))["cameras"][0]
        self.assertEqual((view["width"], view["height"]), (32, 24))  # half

    def test_refuses(self):
        self.assertIn(
            "expected some of 001,011", run("pandaset", self.path(), "-o", self.path("o"), "--sequences", "002").stderr
        )
        self.assertIn("001: is missing", run("pandaset", self.path(), "-o", self.path("o")).stderr)


if __name__ == "__main__":
    fixtures.main()
