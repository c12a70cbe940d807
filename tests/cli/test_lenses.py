# SPDX-License-Identifier: Apache-2.0
"""Tests training in a lens's pixels. A street photographed by fisheyes of 200 degrees is read, trained, compared and
exported."""

import json
import os
import shutil

import fixtures
from fixtures import Case, png_bytes, read, read_png, write

STREET = ["--size", "64x64", "--frames", "8", "--samples", "4", "--no-shifts", "--lidar-points", "6000"]
KEPT = "24 of 24 views keep theirs"


class Lenses(Case):
    @classmethod
    def setUpClass(cls):
        super().setUpClass()
        cls.shared = cls.shared_folder()
        cls.fish = os.path.join(cls.shared, "fish")
        cls.ready("synth", "street", "-o", cls.fish, *STREET, "--fault", "fisheye=200")
        cls.trained = cls.train(cls.fish, "trained", 1)

    @classmethod
    def ready(cls, *arguments):
        done = fixtures.run(*arguments, "-q")
        assert done.returncode == 0, done.stderr
        return done

    @classmethod
    def train(cls, data, name, threads=2, more=()):
        scene = os.path.join(cls.shared, name)
        cls.ready("train", data, "-o", scene, "-n", "150", "--threads", str(threads), *more)
        return scene

    def held_out(self, scene, *more):
        """Returns the PSNR of the held-out photographs."""
        facts = os.path.join(scene, "eval.json")
        self.ready("eval", scene, "--json", facts, *more)
        return json.loads(read(facts))["test"]["psnr"]

    def changed(self, name, change):
        """Returns a copy of the street after change(lenses) has edited the lenses in its dataset.json."""
        out = os.path.join(self.folder, name)
        shutil.copytree(self.fish, out)
        facts = json.loads(read(os.path.join(out, "dataset.json")))
        change(facts["lenses"])
        write(os.path.join(out, "dataset.json"), json.dumps(facts))
        return out

    def test_street_is_read_back(self):
        facts = json.loads(read(os.path.join(self.fish, "dataset.json")))
        self.assertEqual(facts["lenses"]["2"], {"kind": "fisheye", "k": [-0.02, 0.0015, 0, 0, 0, 0], "field": 200})
        done = fixtures.run(
            "info",
            self.fish,
            "--overlay",
            os.path.join(self.folder, "look"),
            "--json",
            os.path.join(self.folder, "info.json"),
        )
        self.assertEqual(done.returncode, 0, done.stderr)
        self.assertIn(KEPT, done.stdout)
        look = json.loads(read(os.path.join(self.folder, "info.json")))["overlay"]
        self.assertEqual(look["warnings"], [])
        self.assertGreater(look["lidar_points"], 20000)  # counts points behind the cameras' planes, too
        self.assertGreater(look["lidar_in_boxes"], 0.97)
        self.assertLess(look["lidar_under_sky"], 0.01)

    def test_views_have_the_lens(self):
        scene = json.loads(read(os.path.join(self.trained, "scene.json")))
        for view in scene["cameras"]:
            self.assertEqual((view["lens"]["kind"], view["lens"]["field"], view["width"]), ("fisheye", 200, 64))

    def test_threads(self):
        other = self.train(self.fish, "two threads", 2)
        for name in ("background.ply", "scene.json"):
            self.assertEqual(read(os.path.join(self.trained, name)), read(os.path.join(other, name)), name)

    def test_pixels_outside_the_image_circle(self):
        """Pixels outside a fisheye's image circle become white instead of black. Training doesn't use them, so the
        scene keeps its bytes."""
        other = self.changed("white", lambda lenses: None)
        for name in os.listdir(os.path.join(other, "images")):
            path = os.path.join(other, "images", name)
            pixels = bytearray(read_png(path)[4])
            for at in range(64 * 64):
                if (at % 64 - 31.5) ** 2 + (at // 64 - 31.5) ** 2 > 33**2:
                    pixels[3 * at : 3 * at + 3] = b"\xff\xff\xff"
            write(path, png_bytes(64, 64, bytes(pixels)))
        scene = self.train(other, "white scene", 2)
        self.assertEqual(
            read(os.path.join(scene, "background.ply")), read(os.path.join(self.trained, "background.ply"))
        )

    def test_the_right_lens_is_the_best(self):
        right = self.held_out(self.trained)
        self.assertGreater(right, 20)

        def bend(lenses):
            for lens in lenses.values():
                lens["k"][0] -= 0.03

        wrong = self.held_out(self.train(self.changed("bent", bend), "bent scene"))
        self.assertGreater(right, wrong + 1)

    def test_changed_lenses_are_refused(self):
        """eval refuses photographs whose lens has changed since the training. A resumed run refuses them, too."""
        other = self.changed("other", lambda lenses: lenses["1"].__setitem__("field", 190))
        done = fixtures.run("eval", self.trained, "--dataset", other)
        self.assertEqual(done.returncode, 1)
        self.assertIn("is not the one that the scene was trained with", done.stderr)
        scene = os.path.join(self.folder, "resumed")
        shutil.copytree(self.trained, scene)
        done = fixtures.run("train", other, "-o", scene, "-n", "200", "--resume")
        self.assertEqual(done.returncode, 1)
        self.assertIn("the lens of", done.stderr)

    def test_undistort(self):
        scene = self.train(self.fish, "pinholes", 2, ["--undistort"])
        views = json.loads(read(os.path.join(scene, "scene.json")))["cameras"]
        self.assertFalse([view for view in views if "lens" in view])
        self.assertGreater(self.held_out(scene), 15)  # eval finds the undistorted photographs without an option

    def test_unseen_pixels_are_black(self):
        out = os.path.join(self.folder, "pictures")
        self.ready("render", self.trained, "-o", out, "--split", "test")
        name = sorted(n for n in os.listdir(out) if n.endswith(".png"))[0]
        width, height, channels, _, pixels = read_png(os.path.join(out, name))
        self.assertEqual((width, height), (64, 64))
        self.assertEqual(pixels[: 3 * channels], bytes(3 * channels))
        self.assertGreater(sum(pixels[channels * (64 * 32 + 32) :][:3]), 60)

    def test_proxies(self):
        """A proxy's depth views are pinhole views, even if the scene's views have a lens."""
        self.ready("export", self.trained, os.path.join(self.folder, "scene.glb"), "--proxy", "hull")
        self.assertEqual(read(os.path.join(self.folder, "scene.glb"))[:4], b"glTF")

    def test_rolling_shutter(self):
        """A fisheye's rolling shutter is read with its lens. Training with it fits the held-out photographs better than
        training as if each picture were exposed at once."""
        data = os.path.join(self.folder, "rolling")
        self.ready("synth", "street", "-o", data, *STREET, "--fault", "fisheye=200", "--fault", "rolling-right=0.2")
        scene = self.train(data, "rolling scene", 2)
        for view in json.loads(read(os.path.join(scene, "scene.json")))["cameras"]:
            self.assertEqual((view["lens"]["kind"], view["rolling_shutter"]["direction"]), ("fisheye", "left_to_right"))
        ignored = self.train(data, "ignored scene", 2, ["--set", "rolling_shutter=0"])
        self.assertGreater(self.held_out(scene), self.held_out(ignored) + 0.3)

    def test_faults_that_exclude_each_other(self):
        done = fixtures.run(
            *("synth", "street", "-o", os.path.join(self.folder, "none")),
            *("--fault", "fisheye=200", "--fault", "distortion=0.1"),
        )
        self.assertEqual((done.returncode, done.stderr.count("\n")), (1, 1))
        self.assertIn("expected no distortion", done.stderr)


if __name__ == "__main__":
    fixtures.main()
