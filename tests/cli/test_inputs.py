# SPDX-License-Identifier: Apache-2.0
"""Tests inputs of every kind. Whatever is ignored, guessed, clamped or left out causes one warning, also in the JSON.
--strict makes the warning an error."""

import base64
import json
import os
import struct

import fixtures
import scenes
from fixtures import Case, ply_bytes, read, run, some_splats


class Warnings(Case):
    """Tests warnings with a splat file that has two zero quaternions."""

    def setUp(self):
        super().setUp()
        rows = some_splats()
        for row in rows[:2]:
            row[13:17] = [0.0] * 4
        self.odd = self.write("odd.ply", ply_bytes(rows))
        self.good = self.write("good.ply", ply_bytes(some_splats()))
        self.line = f"{self.odd}: 2 all-zero quaternions taken as no rotation"

    def test_warnings_are_printed_and_written(self):
        for verb in [["info", self.odd], ["export", self.odd, self.path("out.spz")]]:
            done = self.succeeds(*verb, "--json", self.path("out.json"))
            self.assertEqual(done.stderr.count(f"warning: {self.line}\n"), 1, done.stderr)
            self.assertEqual(json.loads(read(self.path("out.json")))["warnings"], [self.line])
        self.assertEqual(self.succeeds("info", self.odd, "--quiet").stdout, "")

    def test_warnings_are_errors_with_strict(self):
        for verb in [
            ["info", self.odd],
            ["export", self.odd, self.path("out.spz")],
            ["render", self.odd, "-o", self.path("out")],
        ]:
            done = run(*verb, "--strict")
            self.assertEqual(done.returncode, 1)
            self.assertIn(f"{self.line} (an error because of --strict)", done.stderr)
            self.assertFalse(os.path.exists(verb[-1]) and verb[-1] != self.odd)

    def test_good_files_give_none(self):
        done = self.succeeds("info", self.good, "--strict", "--json", "-")
        self.assertEqual(json.loads(done.stdout)["warnings"], [])

    def test_unknown_files_say_what_was_found(self):
        self.fails(["info", self.write("a.yaml", "a: 1\n")], "found text", "info also takes data sets")
        self.fails(
            ["render", self.write("a.bin", b"\x0f\xaf\x73\x40"), "-o", self.path("out")], "found bytes 0f af 73 40"
        )
        self.fails(
            ["info", self.write("times.json", '{"frames": [1.5, 2.5], "cameras": {}}')],
            "not a data set",
            "transform_matrix",
        )
        self.fails(
            ["info", self.write("raw.spz", b"NGSP" + struct.pack("<II4B", 2, 1, 0, 8, 0, 0) + bytes(40))],
            "without gzip",
            "`gzip` makes it",
        )
        self.fails(
            ["render", self.good, "--split", "test", "-o", self.path("out")],
            f"{self.good} has no held-out views",
            "--dataset DATASET",
        )


class Pictures(Case):
    """info recognises every picture that can be opened."""

    def size(self, name, data):
        path = self.write(name, data)
        done = run("info", path, "--json", "-")
        if "PNG, JPEG and EXR are read" in done.stderr:
            self.skipTest("this build reads no other pictures")
        self.assertEqual(done.returncode, 0, done.stderr)
        facts = json.loads(done.stdout)
        return facts["kind"], facts["width"], facts["height"]

    def test_webp(self):
        webp = base64.b64decode("UklGRhoAAABXRUJQVlA4TA0AAAAvAAAAEAcQERGIiP4HAA==")
        self.assertEqual(self.size("a.webp", webp), ("image", 1, 1))
        self.assertEqual(self.size("a", webp), ("image", 1, 1))

    def test_names_of_pictures(self):
        self.assertEqual(self.size("a.ppm", b"P6 2 1 255\n" + bytes(6)), ("image", 2, 1))
        self.fails(["info", self.write("b.bmp", b"no picture, just text")], "b.bmp", "picture")


class Times(Case):
    def test_clock_times_are_printed_in_full(self):
        """Times in seconds since 1970 have more digits than numbers are usually printed with."""
        path = os.path.join(scenes.make_empty_scene(self.path("scene")), "scene.json")
        scene = json.loads(read(path)) | {"time": [1556919593.2038, 1556919595.2036], "fps": 10}
        self.write(path, json.dumps(scene))
        self.assertIn("1556919593.204 to 1556919595.204 s", self.succeeds("info", self.path("scene")).stdout)


if __name__ == "__main__":
    fixtures.main()
