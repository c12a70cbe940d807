# SPDX-License-Identifier: Apache-2.0
"""Tests pags eval of a driving scene and pags info --overlay of its data set, on a small synthetic street."""

import json
import os
import shutil

import fixtures

REGIONS = ["critical", "noncritical", "moving", "vehicles", "pedestrians", "cyclists"]


def pixels_of(path):
    """Returns the width and the rows of pixels (r, g, b) of an 8-bit PNG file."""
    width, height, channels, _, samples = fixtures.read_png(path)
    pixels = [tuple(samples[i : i + 3]) for i in range(0, len(samples), channels)]
    return width, [pixels[y * width : (y + 1) * width] for y in range(height)]


class Eval(fixtures.Case):
    @classmethod
    def setUpClass(cls):
        folder = cls.shared_folder()
        cls.street = os.path.join(folder, "street")
        cls.scene = os.path.join(folder, "scene")
        made = fixtures.run(
            *["synth", "street", "-o", cls.street, "--size", "128x72", "--frames", "9", "--cameras", "1"],
            *["--samples", "2", "--objects", "3", "--lidar-points", "3000", "--pose-noise", "0.1", "--yaw-noise", "2"],
        )
        assert made.returncode == 0, made.stderr
        trained = fixtures.run("train", cls.street, "-o", cls.scene, "--iterations", "30", "-q")
        assert trained.returncode == 0, trained.stderr

    def test_figures_of_a_driving_scene(self):
        figures = json.loads(self.succeeds("eval", self.scene, "--shift", "--json", "-").stdout)
        self.assertEqual((figures["train"]["views"], figures["test"]["views"]), (7, 2))
        for split in ["train", "test"]:
            of = figures[split]
            for name in ["psnr", "psnr_critical", "psnr_noncritical", "psnr_moving", "psnr_vehicles"]:
                self.assertGreater(of[name], 5, name)
                self.assertGreater(of[name.replace("psnr", "ssim")], 0, name)
            for name in REGIONS:
                self.assertIn(f"psnr_{name}", of)
                self.assertIn(f"ssim_{name}", of["per_view"][0])
            self.assertGreater(of["depth"]["samples"], 100)
            self.assertLess(of["depth"]["median"], of["depth"]["mean"])
            self.assertLess(of["depth"]["mean_95"], of["depth"]["mean"])
            self.assertGreater(of["depth"]["within_5_percent"], 0.2)
        self.assertEqual(len({o["id"] for o in figures["objects"]}), len(figures["objects"]))
        views = {v["name"] for split in ("train", "test") for v in figures[split]["per_view"]}
        for found in figures["objects"]:
            self.assertGreater(found["psnr"], 5)
            self.assertIn(found["worst_view"], views)
            self.assertGreater(found["views"] * found["pixels"], 0)
        self.assertGreater(len(figures["objects"]), 0)
        names = [shift["name"] for shift in figures["shift"]]
        self.assertEqual(names, ["right1", "right2", "right3", "up1"])
        for shift in figures["shift"]:
            self.assertGreater(shift["views"], 0)
            self.assertGreater(shift["psnr"], 5)
            self.assertEqual(shift["road_views"], shift["views"])
            self.assertGreater(shift["road_psnr"], 5)

    def test_road_of_shifted_views(self):
        """The classes stored with the true pictures tell where the road is. A data set without them has no figure for
        the road."""
        street = self.path("street")
        shutil.copytree(self.street, street)
        shifted = os.path.join(street, "truth", "shift", "right2")
        size, road = (
            (128, 72),
            json.loads(self.succeeds("eval", self.scene, "--dataset", street, "--shift", "--json", "-").stdout)[
                "shift"
            ][1],
        )
        names = sorted(name for name in os.listdir(shifted) if name.endswith("_semantic.png"))
        self.assertEqual(len(names), road["views"])
        for name in names:
            fixtures.write(os.path.join(shifted, name), fixtures.png_bytes(*size, bytes(3 * size[0] * size[1])))
        everything = json.loads(
            self.succeeds("eval", self.scene, "--dataset", street, "--shift", "--json", "-").stdout
        )["shift"][1]
        self.assertAlmostEqual(everything["road_psnr"], everything["psnr"], 5)
        self.assertNotAlmostEqual(road["road_psnr"], road["psnr"], 2)
        fixtures.write(os.path.join(shifted, names[0]), fixtures.png_bytes(4, 2, bytes(24)))
        self.fails(["eval", self.scene, "--dataset", street, "--shift"], names[0], "4x2", "128x72")
        for name in names:
            os.remove(os.path.join(shifted, name))
        without = json.loads(self.succeeds("eval", self.scene, "--dataset", street, "--shift", "--json", "-").stdout)[
            "shift"
        ][1]
        self.assertEqual((without["road_views"], without["road_psnr"]), (0, None))

    def test_errors_of_noisy_poses(self):
        poses = json.loads(self.succeeds("eval", self.scene, "--split", "test", "--json", "-").stdout)["poses"]
        self.assertGreater(poses["objects"], 0)
        # Label noise with a sigma of 0.1 m in x and y has a mean length of 0.125 m. Noise with a sigma of 2 degrees has
        # a mean of 1.6 degrees.
        self.assertGreater(poses["absolute"]["label_metres"], 0.06)
        self.assertLess(poses["absolute"]["label_metres"], 0.25)
        self.assertGreater(poses["absolute"]["label_degrees"], 0.7)
        self.assertLess(poses["absolute"]["label_degrees"], 3.5)
        for kind in ["absolute", "relative", "held_out"]:
            of = poses[kind]
            self.assertAlmostEqual(of["recovered_metres"], 1 - of["metres"] / of["label_metres"], places=9)
        with open(os.path.join(self.scene, "scene.json")) as file:
            modelled = [o for o in json.load(file)["objects"] if o.get("model") is not None]
        knots = [k["trained"] for o in modelled for k in o["knots"]]
        self.assertEqual((poses["knots"], poses["held_out_knots"]), (knots.count(True), knots.count(False)))
        self.assertGreater(poses["held_out"]["label_metres"], 0.06)
        self.assertLess(poses["held_out"]["metres"], 0.3)

    def test_priorities_compared_with_the_truth(self):
        figures = json.loads(self.succeeds("eval", self.scene, "--split", "test", "--json", "-").stdout)["priorities"]
        self.assertGreater(figures["seen"], 300)
        self.assertEqual(figures["counted"], figures["critical"] + figures["other"])
        self.assertAlmostEqual(figures["left_out"], 1 - figures["counted"] / figures["seen"], places=9)
        self.assertAlmostEqual(figures["left_out"], figures["astray"] + figures["between"], places=9)
        self.assertGreater(figures["critical"], 20)
        self.assertGreater(figures["critical_high"], 0.7)
        self.assertLess(figures["other_high"], 0.1)

    def test_pruning_by_score(self):
        out = self.path("pruned")
        options = [
            "--iterations",
            "60",
            "--preset",
            "paper",
            "--set",
            "prunes=4",
            "--prune-rate",
            "0.5/0.25",
            "--set",
            "prune_floor=10",
            "-q",
        ]
        self.succeeds("train", self.street, "-o", out, *options)
        with open(os.path.join(out, "log.jsonl")) as log:
            prunes = [line for line in map(json.loads, log) if "pruned_by_score" in line]
        self.assertEqual(len(prunes), 4)
        for line, rate in zip(prunes, [0.5, 0.5, 0.5, 0.25]):
            before = line["gaussians"] + line["pruned_by_score"]
            self.assertEqual(line["pruned_by_score"], int(rate * before))
        facts = json.loads(self.succeeds("info", out, "--json", "-").stdout)
        self.assertEqual(facts["priority"]["gaussians"], prunes[-1]["gaussians"])
        self.assertGreater(facts["priority"]["over_0.1"], facts["priority"]["over_0.9"])
        frames = self.path("heat")
        self.succeeds("render", out, "--split", "test", "--channel", "priority", "-o", frames)
        self.assertEqual(sum(name.endswith("_heat.png") for name in os.listdir(frames)), 2)
        self.fails(["train", self.street, "-o", out, "--prune-rate", "0.5"], "--prune-rate", "'0.5'", code=2)
        self.fails(["train", self.street, "-o", out, "--prune-rate=-1/0.2"], "--prune-rate", "'-1/0.2'", code=2)
        self.fails(["train", self.street, "-o", out, "--prune-rate", "1/0.2"], "--prune-rate", "'1/0.2'", code=2)
        self.fails(["train", self.street, "-o", out, "--preset", "paper", "--strategy", "mcmc"], "preset", code=2)
        self.fails(["train", self.street, "-o", out, "--preset", "lean"], "--preset: lean is gone", code=2)

    def test_lidar_draws_gaussians_to_surfaces(self):
        left_out = []
        for pull in ["0", "0.5"]:
            out = self.path("pull" + pull)
            self.succeeds("train", self.street, "-o", out, "--iterations", "150", "--set", f"lidar_pull={pull}", "-q")
            figures = json.loads(self.succeeds("eval", out, "--split", "test", "--json", "-").stdout)
            left_out.append(figures["priorities"]["astray"])
        self.assertLess(left_out[1], 0.8 * left_out[0])

    def test_shift_needs_truth(self):
        street = self.path("plain")
        shutil.copytree(self.street, street, ignore=shutil.ignore_patterns("truth"))
        self.fails(["eval", self.scene, "--dataset", street, "--shift"], street, "truth/shift")
        figures = json.loads(self.succeeds("eval", self.scene, "--dataset", street, "--json", "-").stdout)
        self.assertIsNone(figures["poses"])
        self.assertIsNone(figures["shift"])

    def test_overlay_agrees(self):
        folder = self.path("overlay")
        facts = json.loads(self.succeeds("info", self.street, "--overlay", folder, "--json", "-").stdout)
        overlay = facts["overlay"]
        self.assertEqual(overlay["pictures"], 9)
        self.assertEqual(len(os.listdir(folder)), 9)
        self.assertGreater(overlay["front_cosine"], 0.98)
        self.assertGreater(overlay["lidar_in_boxes"], 0.8)
        self.assertLess(overlay["lidar_under_sky"], 0.02)
        self.assertEqual(overlay["warnings"], [])
        self.assertGreaterEqual(facts["objects_moving"]["all"], 2)

    def test_sheet_of_a_drive(self):
        """The cells show the photographs. The map shows the drive's cameras (held-out ones in red), its LiDAR points
        and its boxes."""
        facts = json.loads(self.succeeds("info", self.street, "--sheet", self.path("sheet.png"), "--json", "-").stdout)
        self.assertEqual(facts["sheet"], {"file": self.path("sheet.png"), "cameras": ["0: front"]})
        width, sheet = pixels_of(self.path("sheet.png"))
        _, photograph = pixels_of(os.path.join(self.street, "images", "000_0.png"))
        self.assertEqual(width, 1600)
        self.assertEqual(
            [row[36:164] for row in sheet[20:72]], photograph[20:]
        )  # compares the rows below the cell's number; the photograph isn't shrunk
        drawn = [pixel for row in sheet[76:] for pixel in row]
        counts = {
            name: drawn.count(colour)
            for name, colour in {
                "path": (40, 90, 220),
                "held out": (220, 40, 40),
                "LiDAR": (165, 165, 165),
                "vehicles": (0, 150, 150),
            }.items()
        }
        self.assertGreater(counts["LiDAR"], 300)
        self.assertGreater(counts["vehicles"], 200)
        self.assertLess(counts["held out"], counts["path"])
        self.assertGreaterEqual(counts["held out"], 18)  # 2 of 9 cameras are held out; each is drawn with 3 x 3 pixels

    def test_sheet_refuses_wrong_arguments(self):
        self.fails(["info", self.street, "--sheet", self.path("sheet.txt")], "sheet.txt")
        self.fails(["info", self.scene, "--sheet", self.path("sheet.png")], "--sheet", "only on data sets")

    def test_overlay_warns_of_a_wrong_front(self):
        street = self.path("turned")
        shutil.copytree(self.street, street, ignore=shutil.ignore_patterns("truth"))
        path = os.path.join(street, "dataset.json")
        text = fixtures.read(path).decode()
        self.assertIn('"+x"', text)
        with open(path, "w") as file:
            file.write(text.replace('"+x"', '"+y"'))
        facts = json.loads(self.succeeds("info", street, "--overlay", self.path("turned_out"), "--json", "-").stdout)
        self.assertLess(facts["overlay"]["front_cosine"], 0.5)
        self.assertTrue(any("object_forward" in warning for warning in facts["overlay"]["warnings"]))


if __name__ == "__main__":
    fixtures.main()
