# SPDX-License-Identifier: Apache-2.0
"""Tests the programs of examples/ on a small street, which is trained here, and on a splat file. EXAMPLES is the folder
of the built programs. PAGS_MODULE is the folder of the Python module; without it, first.py isn't tested."""

import json
import os
import re
import subprocess
import sys
import unittest

import fixtures

EXAMPLES = os.environ["EXAMPLES"]
MODULE = os.environ.get("PAGS_MODULE")
SOURCES = os.path.join(os.path.dirname(__file__), "..", "..", "examples")
NUMPY = fixtures.numpy_python()


class Examples(fixtures.Case):
    @classmethod
    def setUpClass(cls):
        """Runs the example train.c, which makes the scene that the other examples read."""
        folder = cls.shared_folder()
        cls.scene, cls.street = os.path.join(folder, "scene"), os.path.join(folder, "street")
        fixtures.run(
            "synth",
            "street",
            "--size",
            "96x64",
            "--frames",
            4,
            "--cameras",
            1,
            "--objects",
            2,
            "--lidar-points",
            2000,
            "--no-shifts",
            "-o",
            cls.street,
        )
        cls.trained = cls.example("train", cls.street, cls.scene, 200)
        cls.camera = os.path.join(folder, "camera.json")
        with open(os.path.join(cls.scene, "scene.json"), encoding="utf-8") as file:
            fixtures.write(cls.camera, json.dumps(json.load(file)["cameras"][0]))

    @staticmethod
    def example(name, *arguments):
        program = (
            [NUMPY or sys.executable, "-B", os.path.join(SOURCES, name)]
            if name.endswith(".py")
            else [os.path.join(EXAMPLES, name)]
        )
        done = subprocess.run(
            [*program, *map(str, arguments)],
            capture_output=True,
            text=True,
            timeout=300,
            env={**os.environ, "PYTHONPATH": MODULE or ""},
        )
        assert done.returncode == 0, f"{name} {arguments}: {done.stderr}"
        return done.stdout

    def check_picture(self, path, width, height):
        """Asserts that the picture has the right size and more than one colour."""
        head, pixels = fixtures.read(path).split(b"\n", 1)
        self.assertEqual(head, f"P6 {width} {height} 255".encode())
        self.assertEqual(len(pixels), 3 * width * height)
        self.assertGreater(len(set(pixels)), 30)

    def test_train_counts_its_steps(self):
        steps = [int(step) for step in re.findall(r"^step (\d+) of 200: \d+ Gaussians", self.trained, re.M)]
        self.assertEqual(steps, list(range(20, 201, 20)))
        self.assertRegex(self.trained, r"scene: \d+ Gaussians after 200 steps\n$")

    def test_first_draws_a_scene(self):
        self.example("first", self.scene, self.camera, self.path("picture.ppm"))
        self.check_picture(self.path("picture.ppm"), 96, 64)

    def test_first_draws_a_splat_file(self):
        cloud = self.write(
            "cloud.ply", fixtures.ply_bytes([fixtures.splat(0.1 * i, 0.0, 4.0, (0.9, 0.1, 0.1 * i)) for i in range(9)])
        )
        camera = self.write("front.json", json.dumps(fixtures.FRONT))
        self.example("first", cloud, camera, self.path("picture.ppm"))
        self.check_picture(self.path("picture.ppm"), 65, 49)

    def test_pick_finds_the_gaussian_in_the_middle(self):
        cloud = self.write(
            "cloud.ply", fixtures.ply_bytes([fixtures.splat(x, 0.0, 4.0, (1, 0, 0)) for x in (-1.0, 0.0, 1.0)])
        )
        camera = self.write("front.json", json.dumps(fixtures.FRONT))
        self.assertRegex(self.example("pick", cloud, camera, 32, 24), r"^Gaussian 1, 4\.00 m away")
        self.assertEqual(self.example("pick", cloud, camera, 0, 0), "nothing\n")

    def test_pick_finds_something_on_the_street(self):
        found = [self.example("pick", self.scene, self.camera, x, 56) for x in range(8, 96, 16)]
        self.assertTrue(any(text.startswith("Gaussian") for text in found), found)

    @unittest.skipUnless(MODULE and NUMPY, "there is no Python module or no numpy")
    def test_fit_picture(self):
        """Fits 2,000 Gaussians to 96 x 64 pixels of the street. After 150 steps, 34 dB were measured; a clearly lower
        PSNR means a fault."""
        width, height, _, _, pixels = fixtures.read_png(os.path.join(self.street, "images", "001_0.png"))
        picture = self.write("street.ppm", b"P6 %d %d 255\n" % (width, height) + pixels)
        said = re.findall(
            r"^step (\d+): PSNR (\d+\.\d+) dB$",
            self.example("fit_picture.py", picture, self.path("fit.ply"), 150),
            re.M,
        )
        self.assertEqual([step for step, _ in said], ["1", "50", "100", "150"])
        self.assertLess(float(said[0][1]), 20)
        self.assertGreater(float(said[-1][1]), 32)
        self.assertIn("2000", fixtures.run("info", self.path("fit.ply")).stdout.replace(",", ""))

    @unittest.skipUnless(MODULE, "the Python module is not built")
    def test_first_py(self):
        self.assertRegex(
            self.example("first.py", self.scene),
            r"^000_0\.png \(96, 64\) farthest: \d+\.\d m\n(None|\{'id': \d+, .*\})\n$",
        )


if __name__ == "__main__":
    fixtures.main()
