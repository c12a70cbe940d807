# SPDX-License-Identifier: Apache-2.0
"""Options that have no effect on the input are refused. If they would change nothing anyway, they cause a warning."""

import json
import os

import fixtures
from fixtures import SMALL, DataCase, ply_bytes, png_bytes, run, some_splats


class Effect(DataCase):
    """Makes a small static data set, a scene trained on it for one step, and a splat file."""

    @classmethod
    def setUpClass(cls):
        super().setUpClass()
        cls.scene = os.path.join(cls.shared_folder(), "scene")
        assert run("train", cls.data, "-o", cls.scene, "-n", "1", "-q", *SMALL).returncode == 0

    def setUp(self):
        super().setUp()
        self.splat = self.write("a.ply", ply_bytes(some_splats()))

    def test_options_of_driving_sets(self):
        for option, value in [
            ("cameras", "0"),
            ("frames", "0-1"),
            ("frames", "2-"),
            ("holdout-camera", "1"),
            ("ego-mask", "nowhere"),
            ("sfm", "nowhere"),
            ("critical", "cat"),
        ]:
            for verb in [["train", self.data, "-o", self.path("out")], ["info", self.data], ["eval", self.scene]]:
                with self.subTest(option, verb=verb[0]):
                    self.fails([*verb, f"--{option}", value], self.data, f"--{option} '{value}'", "only driving sets")
        self.assertFalse(os.path.exists(self.path("out")))
        transforms = os.path.join(self.data, "transforms.json")
        self.fails(["info", transforms, "--kind", "waymo"], "--kind 'waymo'", "only driving sets")

    def test_train(self):
        verb = ["train", self.data, "-n", "1", "--estimate", *SMALL]
        done = self.succeeds(*verb, "--no-sky", "--no-lidar-start")
        self.assertEqual(done.stderr.count("warning: "), 1, done.stderr)
        self.assertIn(f"{self.data}: --no-sky, --no-lidar-start: no effect on a static set", done.stderr)
        self.fails([*verb, "--no-sky", "--strict"], "--no-sky", "because of --strict")
        self.fails(
            [*verb, "--preset", "plain", "--prune-rate", "0.5/0.2"], "--prune-rate", "don't prune by score", code=2
        )

    def test_render(self):
        camera = self.write("camera.json", json.dumps(fixtures.FRONT))
        for options, words in [
            (["--split", "test", "-n", 3], ["--frames", "--path orbit or ego"]),
            (["--path", camera, "-n", 4], ["--frames", "--path orbit or ego"]),
            (["--camera", camera, "-n", 4], ["--frames", "--path orbit or ego"]),
            (["--split", "test", "--stand", "inside"], ["--stand", "--path orbit"]),
            (["--path", "ego", "--stand", "inside"], ["--stand", "--path orbit"]),
            (
                ["--split", "test", "--split-every", 3, "--allow-missing"],
                ["--split-every, --allow-missing", "--dataset"],
            ),
            (["--image-folder", "nowhere"], ["--image-folder", "--dataset"]),
            (["--split", "test", "--colmap", "nowhere"], ["--colmap", "--dataset"]),
            (["--format", "exr", "--bits", 16], ["--bits", "--format png"]),
        ]:
            with self.subTest(options):
                self.fails(
                    ["render", self.scene, "-o", self.path("out"), *options], *words, "no effect without", code=2
                )
        self.assertFalse(os.path.exists(self.path("out")))
        self.succeeds("render", self.scene, "-o", self.path("out"), "-n", 1, "--stand", "around", "--downscale", 16)

    def test_eval(self):
        for option in [["--split-every", "3"], ["--downscale", "2"], ["--allow-missing"]]:
            self.fails(["eval", self.scene, *option], self.scene, option[0], "no effect", "stores its views")
        self.succeeds("eval", self.splat, "--dataset", self.data, "--split-every", "3", "--downscale", "2")

    def test_info(self):
        picture = self.write("a.png", png_bytes(2, 2, bytes(12)))
        camera = self.write("camera.json", json.dumps(fixtures.FRONT))
        checkpoint = os.path.join(self.scene, "checkpoint.pags")
        others = [picture, camera] + [checkpoint] * os.path.exists(checkpoint)
        of_scenes = [["--axes", "rdf"], ["--up", "z"], ["--objects"], ["--memory"]]
        of_sets = [
            ["--overlay", "x"],
            ["--colmap", "nowhere"],
            ["--sfm", "nowhere"],
            ["--cameras", "0"],
            ["--split-every", "3"],
        ]
        for path, options in [(self.data, of_scenes), (self.splat, of_sets), (self.scene, of_sets)] + [
            (p, of_scenes + of_sets) for p in others
        ]:
            for option in options:
                with self.subTest(path, option=option):
                    self.fails(["info", path, *option], path, option[0], "no effect")
        self.succeeds("info", self.splat, "--up", "z", "--memory")


if __name__ == "__main__":
    fixtures.main()
