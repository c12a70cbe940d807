# SPDX-License-Identifier: Apache-2.0
"""Tests corrections of camera poses, vignettes, response curves and rolling shutters. A street whose cameras have
faults is trained and evaluated. Any number of threads and a resumed run give the same bits."""

import itertools
import json
import math
import os

import fixtures
from fixtures import Case, files_below, read, run

STREET = ["--frames", 20, "--size", "128x72", "--samples", 2, "--objects", 2, "--lidar-points", 6000, "--no-shifts"]
TRAIN = ["--iterations", 300, "--set", "camera_poses=1", "--set", "light=1"]


def load(*names):
    with open(os.path.join(*names)) as file:
        return json.load(file)


class Cameras(Case):
    @classmethod
    def setUpClass(cls):
        cls.shared = cls.shared_folder()
        cls.noisy, cls.scene = os.path.join(cls.shared, "noisy"), os.path.join(cls.shared, "scene")
        noise = [
            "--fault",
            "position=0.15",
            "--fault",
            "angle=1",
            "--fault",
            "delay=0.02",
            "--fault",
            "vignette=0.6",
            "--fault",
            "response=0.2",
        ]
        done = run("synth", "street", "-o", cls.noisy, *STREET, *noise)
        assert done.returncode == 0, done.stderr
        cls.succeeds(cls(), "train", cls.noisy, "-o", cls.scene, *TRAIN, "--iterations", 800)

    def test_corrections_are_found(self):
        """Corrections are switched on automatically and bring the cameras nearer to the truth. eval uses them and the
        recorded data set."""
        modelled = load(self.scene, "scene.json")["modelled"]["camera_poses"]
        self.assertTrue(modelled["modelled"], modelled)
        self.assertGreater(modelled["gain_db"], 0.3)
        self.assertTrue(load(self.scene, "scene.json")["modelled"]["light"]["modelled"])
        self.assertIn("camera poses", self.succeeds("info", self.scene).stdout)
        self.succeeds("eval", self.scene, "--json", self.path("eval.json"))
        result = load(self.path("eval.json"))
        for name, least in (("metres", 0.7), ("degrees", 0.7)):
            cameras = result["cameras"]["train"]
            self.assertLess(cameras["corrected"][name], least * cameras["recorded"][name], cameras)
        views = load(self.scene, "scene.json")["cameras"]
        self.assertTrue(all(len(view["correction"]) == 6 and len(view["response"]) == 5 for view in views))
        for sensor in range(3):
            vignette = next(view["vignette"] for view in views if view["sensor"] == sensor)
            corner = (1 + vignette[3]) / (1 + vignette[0])
            self.assertTrue(0.5 < corner < 0.85, vignette)  # 0.4 of the light is about 0.66 of the pixel's value

        # Without its corrections, the scene draws its photographs worse, and its cameras differ from the data set's.
        for view in views:
            del view["correction"]
        bare = self.path("bare")
        os.mkdir(bare)
        for name in files_below(self.scene):
            os.makedirs(os.path.dirname(os.path.join(bare, name)), exist_ok=True)
            if name.endswith((".ply", ".npz")):
                os.link(os.path.join(self.scene, name), os.path.join(bare, name))
        with open(os.path.join(bare, "scene.json"), "w") as file:
            json.dump({**load(self.scene, "scene.json"), "cameras": views}, file)
        self.fails(["eval", bare], "is not the one that the scene was trained with")

    def test_same_bits(self):
        """A run with two threads gives the bits of one thread. So does a run stopped during the trial of the
        corrections and again after the trial."""
        once, threads, resumed = self.path("once"), self.path("threads"), self.path("resumed")
        self.succeeds("train", self.noisy, "-o", once, "-j", 1, *TRAIN)
        self.succeeds("train", self.noisy, "-o", threads, "-j", 2, *TRAIN)
        for iterations in (60, 200, 300):
            steps = (
                ["--iterations", iterations, "--set", "schedule_iterations=300"]
                if iterations < 300
                else ["--iterations", 300]
            )
            self.succeeds(
                "train", self.noisy, "-o", resumed, *TRAIN[2:], *steps, *(["--resume"] if iterations > 60 else [])
            )
        for name in ("background.ply", "scene.json"):
            self.assertEqual(read(os.path.join(once, name)), read(os.path.join(threads, name)), name)
        self.assertEqual(read(os.path.join(once, "background.ply")), read(os.path.join(resumed, "background.ply")))

    def test_capture(self):
        """A capture with wrong poses is trained with corrections; one with exact poses is trained as recorded. eval
        reports the PSNR that wrong poses cost. No light is fitted."""
        size, gains = ["--random-points", 2000, "--max-gaussians", 4000, "--iterations", 900], {}
        for name, angle in (("exact", 0), ("off", 0.03)):
            data, scene = fixtures.make_dataset(self.path(name), views=48), self.path(name + "-scene")
            root = load(data, "transforms.json")
            for i, frame in enumerate(root["frames"]):
                turned = [list(row) for row in frame["transform_matrix"]]
                c, s = math.cos(angle), (-1) ** (i // 2) * math.sin(angle)
                for row in turned[:3]:  # turns the camera about its vertical axis
                    row[0], row[2] = c * row[0] - s * row[2], s * row[0] + c * row[2]
                frame["transform_matrix"] = turned
            with open(os.path.join(data, "transforms.json"), "w") as file:
                json.dump(root, file)
            done = self.succeeds("train", data, "-o", scene, *size, *TRAIN[2:])
            self.assertIn("light is left out", done.stdout + done.stderr)
            modelled = load(scene, "scene.json")["modelled"]["camera_poses"]
            self.assertEqual(modelled["modelled"], angle > 0, modelled)
            corrected = ["correction" in view for view in load(scene, "scene.json")["cameras"] if not view["test"]]
            self.assertEqual(corrected, [angle > 0] * len(corrected))
            self.succeeds("eval", scene, "--fit-poses", "--json", self.path("eval.json"))
            gains[name] = {split: load(self.path("eval.json"))[split] for split in ("train", "test")}
        # Corrected poses usually give 33.1 dB, recorded poses 28.9 dB, and exact poses 38.6 dB.
        self.assertGreater(gains["off"]["train"]["psnr"], 31)
        held_out = gains["off"]["test"]  # the poses of held-out photographs aren't corrected
        self.assertGreater(held_out["psnr_right_fitted"], held_out["psnr_right"] + 1)
        for split in ("train", "test"):
            self.assertLess(gains["exact"][split]["psnr_right_fitted"], gains["exact"][split]["psnr_right"] + 1)
        self.fails(["eval", self.scene, "--fit-poses"], "--fit-poses is for captures")

    def test_rolling_shutter(self):
        """A street recorded with a rolling shutter is evaluated as its scene was trained: with the shutter or
        without."""
        data, scenes = self.path("rolling"), {1: self.path("with"), 0: self.path("without")}
        self.succeeds("synth", "street", "-o", data, *STREET, "--fault", "rolling-down=0.08")
        for rolls, scene in scenes.items():
            self.succeeds("train", data, "-o", scene, "--iterations", 300, "--set", f"rolling_shutter={rolls}")
            self.assertEqual(
                ["rolling_shutter" in view for view in load(scene, "scene.json")["cameras"]], [bool(rolls)] * 60
            )
        root = load(scenes[1], "scene.json")
        scores = {}
        for shutter in ("kept", "taken"):
            with open(os.path.join(scenes[1], "scene.json"), "w") as file:
                json.dump(root, file)
            self.succeeds("eval", scenes[1], "--json", self.path("eval.json"))
            scores[shutter] = load(self.path("eval.json"))["train"]["psnr"]
            for view in root["cameras"]:
                view.pop("rolling_shutter", None)
        self.assertGreater(scores["kept"], scores["taken"] + 1)

    def test_no_corrections_without_faults(self):
        """A street without faults keeps its recorded poses, and the scene says why."""
        clean, scene = self.path("clean"), self.path("scene")
        self.succeeds("synth", "street", "-o", clean, *STREET)
        self.succeeds("train", clean, "-o", scene, *TRAIN)
        modelled = load(scene, "scene.json")["modelled"]["camera_poses"]
        self.assertFalse(modelled["modelled"], modelled)
        for part in ("light", "exposure"):
            entry = load(scene, "scene.json")["modelled"][part]
            self.assertFalse(entry["modelled"], entry)
            self.assertGreater(entry["bytes_saved"], 0, part)
        self.assertFalse({"correction", "gain", "vignette"} & set(load(scene, "scene.json")["cameras"][0]))
        self.succeeds("eval", scene, "--json", self.path("eval.json"))
        self.assertLess(load(self.path("eval.json"))["cameras"]["train"]["corrected"]["metres"], 1e-4)

        # If photographs get darker along the drive, exposures are kept.
        for frame, camera in itertools.product(range(20), range(3)):
            name = os.path.join(clean, "images", f"{frame:03d}_{camera}.png")
            width, height, _, _, data = fixtures.read_png(name)
            darker = bytes(int((1 - 0.03 * frame) * value) for value in data)
            fixtures.write(name, fixtures.png_bytes(width, height, darker))
        only = ["--set", "camera_poses=0", "--set", "light=0", "--set", "exposure_rate=0.02"]
        small = ["--iterations", 900, "--max-gaussians", 8000]
        self.succeeds("train", clean, "-o", scene, "--overwrite", *small, *only)
        described = load(scene, "scene.json")
        entry = described["modelled"]["exposure"]
        self.assertTrue(entry["modelled"] and entry["gain_db"] > 0.3 and entry["bytes"] > 0, entry)
        gains = {view["frame"]: view["gain"][1] for view in described["cameras"] if view["sensor"] == 0}
        self.assertLess(gains[19], gains[0] - 0.2)
        self.assertRegex(self.succeeds("info", scene).stdout, r"(?m)^  exposure +yes +\+\d.* limit 0\.3\)")


if __name__ == "__main__":
    fixtures.main()
