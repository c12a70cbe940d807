# SPDX-License-Identifier: Apache-2.0
"""Tests pags render and pags info on small synthetic splat files."""

import json
import math
import os
import struct

import fixtures
import scenes
from fixtures import FRONT, Case, files_below, make_dataset, ply_bytes, read, read_png, some_splats, splat


class Render(Case):
    def camera(self, **more):
        return self.write("camera.json", json.dumps({**FRONT, **more}))

    def pixel(self, path, x, y):
        width, _, channels, bits, rows = read_png(path)
        at = (y * width + x) * channels * bits // 8
        return struct.unpack(f">{channels}{'H' if bits == 16 else 'B'}", rows[at : at + channels * bits // 8])

    def test_colour_of_one_splat(self):
        # One almost opaque Gaussian is in front of the camera. Its alpha is 0.99 at the centre, blended over the
        # background.
        scene = self.write("one.ply", ply_bytes([splat(0, 0, 4, (0.8, 0.4, 0.2), sigma=0.5, opacity=12.0)]))
        self.succeeds("render", scene, "--camera", self.camera(), "-o", self.path("out"), "--bits", 16)
        red, green, blue = [v / 65535 for v in self.pixel(self.path("out", "00000.png"), 32, 24)]
        for got, wanted in zip((red, green, blue), (0.8, 0.4, 0.2)):
            self.assertAlmostEqual(got, 0.99 * wanted, delta=1e-4)
        self.assertEqual(self.pixel(self.path("out", "00000.png"), 0, 0), (0, 0, 0))
        self.succeeds("render", scene, "--camera", self.camera(), "-o", self.path("out"), "--background", "0,0.5,1")
        self.assertEqual(self.pixel(self.path("out", "00000.png"), 0, 0), (0, 128, 255))

    def test_shutter(self):
        scene = self.write("a.ply", ply_bytes(some_splats()))
        shutter = {"direction": "left_to_right", "seconds": 0.1, "velocity": [0, 0, 0, 2, 0, 0]}
        rolling = self.camera(rolling_shutter=shutter)
        drawn = {}
        for name, more in {
            "default": [],
            "rolling": ["--shutter", "rolling"],
            "global": ["--shutter", "global"],
        }.items():
            self.succeeds("render", scene, "--camera", rolling, "-o", self.path(name), *more)
            drawn[name] = read(self.path(name, "00000.png"))
        self.assertEqual(drawn["default"], drawn["rolling"])
        self.assertNotEqual(drawn["default"], drawn["global"])
        self.succeeds("render", scene, "--camera", self.camera(), "-o", self.path("plain"))
        self.assertEqual(read(self.path("plain", "00000.png")), drawn["global"])
        error = self.fails(
            ["render", scene, "--camera", self.camera(), "-o", self.path("no"), "--shutter", "rolling"],
            "--shutter rolling",
        )
        self.assertIn("rolling_shutter", error)
        for wrong in (
            {**shutter, "direction": "down"},
            {**shutter, "seconds": -1},
            {**shutter, "velocity": [1]},
            {**shutter, "seconds": 2},
        ):
            self.fails(
                ["render", scene, "--camera", self.camera(rolling_shutter=wrong), "-o", self.path("no")], "camera.json:"
            )

    def test_shutter_along_a_path(self):
        # A path whose cameras have no shutters gets the read-out time of the scene. The times and places of its frames
        # give the velocities.
        folder = scenes.make_scene(self.path("scene"))
        with open(self.path("scene", "scene.json")) as file:
            scene = json.load(file)
        frames = [scenes.camera(f, 0.8 * f, 0.0) for f in range(4)]
        velocity = [0, 0, 0, 0, -8 * math.sin(0.15), 8 * math.cos(0.15)]
        shutter = {"direction": "top_to_bottom", "seconds": 0.1, "velocity": velocity}
        drawn = {}
        for name, own in {"given": {"rolling_shutter": shutter}, "found": {}}.items():
            path = self.write(f"{name}.json", json.dumps({"fps": 10, "frames": [{**frame, **own} for frame in frames]}))
            scene["cameras"] = [{**frame, "rolling_shutter": {**shutter, "velocity": [0] * 6}} for frame in frames]
            self.write("scene/scene.json", json.dumps(scene))
            for choice in ("rolling", "global"):
                out = self.path(name + choice)
                self.succeeds("render", folder, "--path", path, "-o", out, "--shutter", choice, "--format", "exr")
                drawn[name, choice] = [read(self.path(name + choice, f"0000{f}.exr")) for f in range(4)]
        self.assertEqual(drawn["given", "global"], drawn["found", "global"])
        for rolling, still in zip(drawn["given", "rolling"], drawn["given", "global"]):
            self.assertNotEqual(rolling, still)
        # The velocities agree up to rounding, and so do the pictures.
        self.succeeds(
            "render", folder, "--path", self.path("found.json"), "-o", self.path("again"), "--shutter", "rolling"
        )
        self.succeeds("render", folder, "--path", self.path("given.json"), "-o", self.path("png"))
        for f in range(4):
            first, second = (read_png(self.path(at, f"0000{f}.png"))[4] for at in ("again", "png"))
            self.assertLess(max(abs(x - y) for x, y in zip(first, second)), 3)
        still = [{k: v for k, v in frame.items() if k != "time"} for frame in frames]
        path = self.write("timeless.json", json.dumps({"fps": 10, "frames": still}))
        self.fails(
            ["render", folder, "--path", path, "-o", self.path("no"), "--shutter", "rolling"],
            "expected a path whose times increase",
        )

    def test_packed_file(self):
        scene, packed = self.write("a.ply", ply_bytes(some_splats())), self.path("a.pagsz")
        self.succeeds("export", scene, packed)
        self.succeeds("render", scene, "--packed", "--camera", self.camera(), "-o", self.path("out"), "--format", "exr")
        self.succeeds("render", packed, "--camera", self.camera(), "-o", self.path("mapped"), "--format", "exr")
        self.assertEqual(read(self.path("out", "00000.exr")), read(self.path("mapped", "00000.exr")))

    def test_budget(self):
        scene, out = self.write("a.ply", ply_bytes(some_splats())), self.path("out")
        common = ["render", scene, "-n", 6, "-o", out, "--json", self.path("r.json"), "--budget-ms"]
        self.succeeds(*common, 100000)  # the time budget suffices: quality isn't reduced
        told = json.loads(read(self.path("r.json")))
        self.assertEqual((told["budget"]["met"], told["budget"]["steps"][0]["frames"]), (6, 6))
        self.assertEqual(told["budget"]["error"]["psnr"], 100)
        self.assertTrue(all(frame["met"] and frame["step"] == 0 for frame in told["frames"]))
        self.succeeds(*common, 0.1)  # the time budget is too short: the reductions and their error are reported
        told = json.loads(read(self.path("r.json")))["budget"]
        self.assertEqual(sum(step["frames"] for step in told["steps"]), 6)
        self.assertLess(told["met"], 7)
        self.fails([*common, 5, "--early-z", "paper"], "--budget-ms", code=2)

    def test_nearest_in_front(self):
        placed = [(6, (0, 1, 0)), (3, (1, 0, 0)), (-3, (0, 0, 1))]
        rows = [splat(0, 0, z, colour, sigma=0.8, opacity=12.0) for z, colour in placed]
        scene = self.write("three.ply", ply_bytes(rows))
        channels = "color,alpha,depth,id,object"
        self.succeeds("render", scene, "--camera", self.camera(), "-o", self.path("out"), "--channel", channels)
        wanted = ["00000.png", "00000_alpha.png", "00000_depth.exr", "00000_id.exr", "00000_object.exr", "objects.json"]
        self.assertEqual(files_below(self.path("out")), wanted)
        red, green, blue = self.pixel(self.path("out", "00000.png"), 32, 24)
        self.assertGreater(red, 250)
        self.assertLess(green, 4)
        self.assertEqual(blue, 0)
        self.assertGreater(self.pixel(self.path("out", "00000_alpha.png"), 32, 24)[0], 251)

    def test_channels(self):
        scene = self.write("a.ply", ply_bytes(some_splats()))
        self.fails(["render", scene, "-n", 1, "-o", self.path("out"), "--channel", "priority"], "priority")
        self.assertFalse(os.path.exists(self.path("out")))
        self.succeeds("render", scene, "-n", 1, "-o", self.path("out"), "--channel", "depth")
        self.assertEqual(files_below(self.path("out")), ["00000_depth.exr"])
        self.succeeds("render", scene, "-n", 1, "-o", self.path("exr"), "--format", "exr")
        self.assertEqual(read(self.path("exr", "00000.exr"))[:4], b"\x76\x2f\x31\x01")

    def test_orbit_and_json(self):
        scene = self.write("a.ply", ply_bytes(some_splats()))
        out = self.path("out")
        done = self.succeeds("render", scene, "--frames", 3, "-o", out, "--downscale", 8, "--json", "-")
        self.assertEqual(files_below(out), ["00000.png", "00001.png", "00002.png"])
        report = json.loads(done.stdout)
        self.assertEqual([frame["name"] for frame in report["frames"]], ["00000", "00001", "00002"])
        for frame in [*report["frames"], report["mean"]]:
            self.assertEqual(frame["gaussians"], 40)
            for key in ["loaded", "shaded", "binned", "pairs_binned", "pairs_evaluated", "pairs_blended"]:
                self.assertGreater(frame[key], 0, key)
            for stage in ["cull", "project", "shade", "sort", "bin", "raster", "total"]:
                self.assertGreaterEqual(frame["ms"][stage], 0)
        self.assertEqual((report["frames"][0]["width"], report["frames"][0]["height"]), (160, 90))
        self.assertNotEqual(read(self.path("out", "00000.png")), read(self.path("out", "00001.png")))

    def test_same_bits_on_any_number_of_threads(self):
        scene = self.write("a.ply", ply_bytes(some_splats()))
        for threads in [1, 2, 3]:
            self.succeeds("render", scene, "-n", 2, "-o", self.path(f"{threads}"), "-j", threads, "--bits", 16)
        for name in ["00000.png", "00001.png"]:
            self.assertEqual(read(self.path("1", name)), read(self.path("2", name)))
            self.assertEqual(read(self.path("1", name)), read(self.path("3", name)))

    def test_paths(self):
        scene = self.write("a.ply", ply_bytes(some_splats()))
        path = self.write("path.json", json.dumps({"fps": 24, "frames": [FRONT, {**FRONT, "width": 33}]}))
        self.succeeds("render", scene, "--path", path, "-o", self.path("out"))
        self.assertEqual(read_png(self.path("out", "00000.png"))[:2], (65, 49))
        self.assertEqual(read_png(self.path("out", "00001.png"))[:2], (33, 49))
        self.fails(["render", scene, "--path", "ego", "-o", self.path("ego")], "2 training views")
        self.fails(["render", scene, "--split", "test", "-o", self.path("ego")], "held-out")
        self.assertFalse(os.path.exists(self.path("ego")))

    def test_views_of_a_data_set(self):
        scene = self.write("a.ply", ply_bytes(some_splats()))
        data = make_dataset(self.path("data"), views=5, width=16, height=12)
        out = self.path("out")
        self.succeeds("render", scene, "--dataset", data, "--split", "test", "--split-every", 2, "-o", out)
        self.assertEqual(files_below(out), ["000.png", "002.png", "004.png"])
        self.succeeds("render", scene, "--dataset", data, "--split", "all", "-o", self.path("all"))
        self.assertEqual(len(files_below(self.path("all"))), 5)

    def test_empty_scene(self):
        scene = self.write("none.ply", ply_bytes([]))
        self.succeeds("render", scene, "--camera", self.camera(), "-o", self.path("out"), "--background", "1,0,0")
        self.assertEqual(self.pixel(self.path("out", "00000.png"), 32, 24), (255, 0, 0))
        self.fails(["render", scene, "-o", self.path("orbit")], "at least one Gaussian")


class Info(Case):
    def info(self, path, *more):
        return json.loads(self.succeeds("info", path, "--json", "-", *more).stdout)

    def test_splat(self):
        scene = self.write("a.ply", ply_bytes([splat(1, 2, 3, (1, 1, 1)), splat(-1, 0, 5, (1, 1, 1))]))
        facts = self.info(scene, "--memory")
        self.assertEqual((facts["kind"], facts["gaussians"], facts["bytes"]), ("PLY", 2, os.path.getsize(scene)))
        self.assertEqual(facts["models"][0]["sh_degree"], 0)
        self.assertEqual((facts["bounds_lo"], facts["bounds_hi"]), ([-1, 0, 3], [1, 2, 5]))
        self.assertEqual(facts["memory"]["parameters"], 56)

    def test_info_of_other_files(self):
        data = make_dataset(self.path("data"), views=9, width=16, height=12)
        facts = self.info(data)
        self.assertEqual((facts["kind"], facts["views_train"], facts["views_test"]), ("data set", 7, 2))
        self.assertEqual(self.info(self.path("data", "transforms.json"))["kind"], "data set")
        image = self.info(self.path("data", "images", "000.png"))
        self.assertEqual((image["kind"], image["width"], image["height"]), ("image", 16, 12))
        camera = self.write("camera.json", json.dumps(FRONT))
        self.assertEqual(self.info(camera)["kind"], "camera")
        path = self.write("path.json", json.dumps({"fps": 24, "frames": [FRONT, FRONT]}))
        self.assertEqual((self.info(path)["kind"], self.info(path)["frames"]), ("path", 2))

    def test_info_as_text(self):
        scene = self.write("a.ply", ply_bytes(some_splats()))
        self.assertRegex(self.succeeds("info", scene).stdout, r"(?m)^gaussians +40$")
        self.assertEqual(self.succeeds("info", scene, "--quiet").stdout, "")

    def test_orbit_shows_few_large_gaussians_whole(self):
        """Draws four blobs at equal distances. Their sigmas are a tenth of the distance."""
        rows = [splat(x, 0, z, (1, 1, 1)) for x, z in [(0, 0), (1, 0), (0, 1), (1, 1)]]
        self.succeeds(
            "render", self.write("few.ply", ply_bytes(rows)), "-o", self.path("few"), "-n", 4, "--downscale", 8
        )
        for i in range(4):
            width, height, channels, _, data = read_png(self.path(f"few/{i:05d}.png"))
            row = width * channels
            sides = [data[y * row : y * row + 3] + data[(y + 1) * row - 3 : (y + 1) * row] for y in range(height)]
            self.assertGreater(max(data), 128)
            self.assertLess(max(data[:row] + data[-row:] + b"".join(sides)), 8)


if __name__ == "__main__":
    fixtures.main()
