# SPDX-License-Identifier: Apache-2.0
"""Tests pags-bench render, scale and reference: their tables, CSV and JSON. No time is checked."""

import array
import csv
import json
import os
import re
import subprocess
import sys

import fixtures
from fixtures import FRONT, Case, ply_bytes, read, some_splats

CAMERA = {**FRONT, "camera_from_world_translation": [0, 0, 5]}


class Bench(Case):
    def render(self, *more):
        scene = self.write("a.ply", ply_bytes(some_splats()))
        return ["render", scene, "-n", 2, "-r", 2, "--sizes", "64x48,96x54", *more]

    def test_files(self):
        files = ["--csv", self.path("a.csv"), "--json", self.path("a.json")]
        done = self.succeeds(*self.render("--modes", "off,exp3,sh0,lossless,bounded=0.02", *files))
        told = json.loads(read(self.path("a.json")))
        self.assertEqual([(s["width"], s["height"]) for s in told["sizes"]], [(64, 48), (96, 54)])
        for size in told["sizes"]:
            off, fast, flat, lossless, bounded = size["modes"]
            self.assertEqual([m["mode"] for m in size["modes"]], ["off", "exp3", "sh0", "lossless", "bounded=0.02"])
            self.assertEqual((off["psnr"], off["max_error"], off["differing"]), (None, 0, 0))
            self.assertEqual(off["speed_up"], 1)
            # The splats have colours of degree 0 only, so the mode sh0 changes nothing.
            self.assertEqual(flat["differing"], 0)
            self.assertTrue(0 < fast["max_error"] < 0.01 and fast["psnr"] > 50)
            self.assertEqual((lossless["differing"], lossless["max_alpha_error"]), (0, 0))
            self.assertTrue(bounded["max_error"] <= 0.021)
            self.assertEqual((off["gaussians"], off["in_view"], off["hidden"]), (40, off["loaded"], 0))
            self.assertTrue(0 < off["pairs_blended"] <= off["pairs_evaluated"])
            for mode in size["modes"]:
                self.assertTrue(0 < mode["pairs_reached"] <= mode["pairs_binned"])
                self.assertTrue(mode["pairs_blended"] <= mode["pairs_open"] <= mode["pairs_evaluated"])
                self.assertTrue(
                    0 < mode["perfect_stop_ms"] <= mode["ms"]["frame"]["median"] and mode["share_of_bare"] > 0
                )
            self.assertTrue(bounded["pairs_open"] <= off["pairs_open"])
            self.assertTrue(size["gaussians_per_pixel"] > 0)
            self.assertTrue(off["ms"]["frame"]["low"] <= off["ms"]["frame"]["median"] <= off["ms"]["frame"]["high"])
        rows = list(csv.DictReader(read(self.path("a.csv")).decode().splitlines()))
        self.assertEqual([(r["width"], r["mode"]) for r in rows[:3]], [("64", "off"), ("64", "exp3"), ("64", "sh0")])
        self.assertEqual(len(rows), 10)
        self.assertEqual(rows[0]["psnr"], "inf")
        self.assertEqual(int(rows[5]["pairs_binned"]), told["sizes"][1]["modes"][0]["pairs_binned"])
        self.assertEqual([len(m["frame_ms"]) for s in told["sizes"] for m in s["modes"]], [2] * 10)
        self.fails(self.render("--plot", self.path("a.svg")), "benchmarks/curve.py", code=2)
        self.assertIn("speed-up", done.stdout)

    def test_budget(self):
        done = self.succeeds(*self.render("--modes", "off,paper", "--budget-ms", 100000, "--json", self.path("a.json")))
        self.assertIn("budget 100000 ms: 2 of 2 frames", done.stdout)
        for size in json.loads(read(self.path("a.json")))["sizes"]:
            self.assertEqual([m["mode"] for m in size["modes"]], ["off", "paper"])
            budget = size["budget"]
            self.assertEqual((budget["frames"], budget["met"], budget["checked"], budget["full_tiles"]), (2, 2, 2, 1))
            self.assertEqual(budget["error"]["psnr"], 100)

    def test_scale(self):
        scene = self.write("many.ply", ply_bytes(3 * some_splats()))
        camera = self.write("camera.json", json.dumps(CAMERA))
        done = self.succeeds(
            *["scale", scene, "--camera", camera, "--millions", "0.001,0.002", "--scratch", self.path()],
            *["--spacing", 3, "-n", 1, "-r", 1, "--csv", self.path("s.csv"), "--json", "-"],
        )
        rows = json.loads(done.stdout)["rows"]
        kinds = [("shared", "off"), ("shared", "lossless"), ("packed", "off"), ("packed", "lossless")]
        self.assertEqual([(r["form"], r["mode"]) for r in rows], 2 * kinds)
        for row in rows:
            # The scene has 120 rows. pags-bench enlarges it by copies of whole clusters of 64 rows.
            self.assertTrue(abs(row["gaussians"] - row["millions"] * 1e6) <= 64, row)
            self.assertTrue(0 < row["loaded"] <= row["in_view"] <= row["gaussians"])
            if row["mode"] == "lossless":
                self.assertEqual(row["max_error"], 0)
        self.assertEqual(rows[0]["rows_bytes"], rows[4]["rows_bytes"])
        self.assertTrue(rows[2]["rows_bytes"] < rows[6]["rows_bytes"] < 64 * rows[6]["gaussians"])
        self.assertEqual(len(read(self.path("s.csv")).decode().splitlines()), 9)
        self.assertEqual([n for n in os.listdir(self.path()) if n.endswith(".pagsz")], [])

    def test_reference(self):
        scene, camera = self.write("a.ply", ply_bytes(some_splats())), self.write("camera.json", json.dumps(CAMERA))
        found = []
        for background in ("0,0,0", "1,0.5,0"):
            self.succeeds("reference", scene, "--camera", camera, "-o", self.path("a.pfm"), "--background", background)
            head, size, order, data = read(self.path("a.pfm")).split(b"\n", 3)
            self.assertEqual(
                (head, size, float(order) < 0),
                (b"PF", f"{CAMERA['width']} {CAMERA['height']}".encode(), sys.byteorder == "little"),
            )
            self.assertEqual(len(data), 12 * CAMERA["width"] * CAMERA["height"])
            found.append(array.array("f", data))
        pags = os.path.join(os.path.dirname(fixtures.PAGS), "pags")
        drawn = subprocess.run(
            [pags, "render", scene, "--camera", camera, "-o", self.path("drawn"), "--bits", "16", "-q"],
            capture_output=True,
            text=True,
        )
        self.assertEqual(drawn.returncode, 0, drawn.stderr)
        width, height, channels, bits, data = fixtures.read_png(self.path("drawn/00000.png"))
        self.assertEqual((width, height, channels, bits), (CAMERA["width"], CAMERA["height"], 3, 16))
        ours = [int.from_bytes(data[i : i + 2], "big") / 65535 for i in range(0, len(data), 2)]
        theirs = [
            v for y in reversed(range(height)) for v in found[0][3 * width * y : 3 * width * (y + 1)]
        ]  # a PFM file begins with the bottom row
        self.assertTrue(max(ours) > 0.5)
        self.assertTrue(max(abs(a - min(b, 1)) for a, b in zip(ours, theirs)) < 1e-4)
        more = [b - a for a, b in zip(*found)]
        self.assertTrue(0.9 < max(more[0::3]) <= 1 and 0.45 < max(more[1::3]) <= 0.5 and max(more[2::3]) == 0)
        self.fails(["reference", scene, "-o", self.path("none/a.pfm")], "none/a.pfm")
        self.fails(["reference", scene], "-o FILE.pfm is missing", code=2)

    def test_wrong_usage(self):
        self.fails(self.render("--sizes", "64x"), "WIDTHxHEIGHT", code=2)
        self.fails(self.render("--repetitions", "0"), "repetitions", code=2)
        self.fails(self.render("--modes", "off,fast"), "got 'fast'")
        self.fails(["error", "scene"], "'error' was removed", "pags-bench curve", code=2)
        self.assertIn(
            "pags-bench render: ", self.fails(["render"], "SCENE is missing; usage: pags-bench render SCENE", code=2)
        )
        for arguments in [[], ["nothing"]]:
            self.fails(arguments, "expected stages, roofline", "render", code=2)

    def test_help(self):
        top = self.succeeds("--help").stdout
        for what in ["stages", "roofline", "train", "curve", "render", "scale", "scaling"]:
            self.assertIn(f"\n  {what} ", top)
            shown = self.succeeds(what, "--help").stdout
            self.assertTrue(shown.startswith(f"usage: pags-bench {what} "), shown)

    def test_manual_names_every_option(self):
        docs = os.path.join(os.path.dirname(__file__), "../../docs")
        chapter = read(os.path.join(docs, "pags-bench.md")).decode()
        chapter += read(os.path.join(docs, "command-line.md")).decode().split("\n## train\n")[0]
        chapter += read(os.path.join(docs, "cluster.md")).decode()
        for what in ["stages", "roofline", "reference", "train", "curve", "render", "scale", "scaling", "proxies"]:
            shown = fixtures.run(what, "--help").stdout  # the help is empty if this build lacks the command
            for name in re.findall(r"^  (?:-., |    )(--[a-z0-9-]+)", shown, re.M):
                self.assertTrue(name in chapter or name == "--help", f"{what} {name} is not in docs/pags-bench.md")


if __name__ == "__main__":
    fixtures.main()
