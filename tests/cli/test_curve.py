# SPDX-License-Identifier: Apache-2.0
"""Tests speed against error: pags-bench curve and benchmarks/curve.py. Errors are compared with those of pictures that
pags render and pags eval make. No time is checked."""

import json
import math
import os
import shutil
import signal
import subprocess
import sys
import time
import xml.etree.ElementTree

import fixtures
from fixtures import Case, ply_bytes, read, read_png, run, some_splats

SCRIPT = os.path.join(os.path.dirname(os.path.abspath(__file__)), "../../benchmarks/curve.py")
sys.path.insert(0, os.path.dirname(SCRIPT))
import plots  # noqa: E402

SMALL = ["--max-gaussians", 1500, "--set", "lidar_points=1000"]


def curve(scene, *more):
    return ["pags-bench", "curve", scene, "-r", 1, "-j", 1, *more]


class Frames(Case):
    """On a driving scene, which has critical pixels and exposures, and on a splat file, which has no photographs."""

    @classmethod
    def setUpClass(cls):
        shared = cls.shared_folder()
        cls.data, cls.scene = os.path.join(shared, "street"), os.path.join(shared, "scene")
        street = ["synth", "street", "--size", "96x54", "--frames", 8, "--cameras", 2, "--no-shifts", "-q"]
        train = [
            "train",
            cls.data,
            "-o",
            cls.scene,
            "-n",
            60,
            "-j",
            1,
            "--preview-every",
            0,
            "--set",
            "exposure=1",
            "-q",
        ]
        for arguments in [[*street, "-o", cls.data], [*train, *SMALL]]:
            done = run(*arguments)
            if done.returncode:
                raise AssertionError(done.stderr)

    def points(self, *arguments):
        done = self.succeeds(*arguments, "--json", self.path("c.json"))
        self.told = json.loads(read(self.path("c.json")))
        self.assertIn("speed-up", done.stdout)
        return {point["point"]: point for point in self.told["points"]}

    def test_errors_are_those_of_the_pictures(self):
        found = self.points(*curve(self.scene, "--modes", "off,bounded=0.5,paper-order", "--limits", "1e5"))
        levels = [f"level {level}" for level in range(1, 8)]
        self.assertEqual(list(found), ["off", "bounded=0.5", "paper-order", *levels, "limit 1e5 ms"])
        cameras = json.loads(read(os.path.join(self.scene, "scene.json")))["cameras"]
        held_out = sum(camera["test"] for camera in cameras)
        self.assertEqual((self.told["views"], self.told["exact"]), (held_out, "double precision"))
        modes = {
            "off": ["--early-z", "off"],
            "bounded=0.5": ["--early-z", "bounded=0.5"],
            "paper-order": ["--early-z", "paper", "--order", "paper"],
        }
        for mode, options in modes.items():
            test = [self.scene, "--split", "test", "-q", *options]
            self.succeeds("eval", *test, "--json", self.path("e.json"))
            scores = json.loads(read(self.path("e.json")))["test"]
            self.assertAlmostEqual(found[mode]["all"]["psnr_photo"], scores["psnr"], 3)
            self.assertAlmostEqual(found[mode]["critical"]["psnr_photo"], scores["psnr_critical"], 3)
            self.succeeds("render", *test, "--bits", 16, "-o", self.path(mode))
        # The mode off in 16 bits is exact to 1/65535, far below the errors of the other modes.
        names = sorted(name for name in fixtures.files_below(self.path("off")) if name.endswith(".png"))
        self.assertEqual(len(names), held_out)
        for mode in ["bounded=0.5", "paper-order"]:
            errors, changed = [], 0
            for name in names:
                one, other = (read_png(self.path(m, name))[4] for m in ("off", mode))
                values = [
                    [int.from_bytes(data[i : i + 2], "big") / 65535 for i in range(0, len(data), 2)]
                    for data in (one, other)
                ]
                errors += [abs(a - b) for a, b in zip(*values)]
                eight = [[math.floor(255 * v + 0.5) for v in picture] for picture in values]
                changed += sum(eight[0][i : i + 3] != eight[1][i : i + 3] for i in range(0, len(eight[0]), 3))
            point = found[mode]["all"]
            psnr = -10 * math.log10(sum(e * e for e in errors) / len(errors))
            self.assertAlmostEqual(point["psnr_exact"], psnr, 1)
            self.assertAlmostEqual(point["max_error"], max(errors), delta=0.02)  # few pixels stop elsewhere in float
            self.assertAlmostEqual(point["changed"], 3 * changed / len(errors), 2)
        self.assertGreater(found["off"]["all"]["psnr_exact"], 85)

    def test_time_limits(self):
        found = self.points(*curve(self.scene, "--modes", "lossless", "--limits", "1e5,0.001,50%"))
        loose, tight, half = (found[name] for name in ["limit 1e5 ms", "limit 0.001 ms", "limit 50%"])
        self.assertEqual((loose["met"], loose["limit_ms"]), (1, 1e5))
        self.assertEqual((tight["met"], tight["limit_ms"]), (0, 0.001))
        self.assertTrue(0 < half["limit_ms"] < 1e5)
        self.assertEqual(found["lossless"]["limit_ms"], None)
        self.assertEqual(loose["all"], found["lossless"]["all"])
        self.assertLess(tight["all"]["psnr_exact"], loose["all"]["psnr_exact"] - 10)
        self.assertLess(tight["all"]["psnr_photo"], loose["all"]["psnr_photo"])

    def test_scene_without_photographs(self):
        scene = self.write("a.ply", ply_bytes(some_splats()))
        found = self.points(*curve(scene, "-n", 2, "--modes", "off,exp3,sh0", "--limits", "none"))
        self.assertEqual(list(found), ["off", "exp3"])  # colours of degree 0: sh0 is the same as off
        self.assertEqual(found["off"]["critical"]["psnr_exact"], None)
        self.assertEqual(found["off"]["all"]["psnr_photo"], None)
        # A picture of the orbit is too large for double precision, so it is compared with the mode off.
        self.assertEqual(self.told["exact"], "mode off, exp of degree 5")
        self.assertEqual((found["off"]["all"]["psnr_exact"], found["off"]["all"]["max_error"]), (None, 0))
        self.assertTrue(50 < found["exp3"]["all"]["psnr_exact"] < 150)

    def test_missing_data_set(self):
        shutil.copytree(self.scene, self.path("moved"))
        told = json.loads(read(self.path("moved", "scene.json")))
        told["dataset"] = self.path("gone")
        self.write("moved/scene.json", json.dumps(told))
        few = curve(self.path("moved"), "-n", 1, "--modes", "off", "--limits", "none")
        done = self.succeeds(*few)
        self.assertIn(f"{self.path('gone')}: missing", done.stdout)
        self.assertIsNotNone(self.points(*few, "--dataset", self.data)["off"]["critical"]["psnr_photo"])

    def test_wrong_usage(self):
        scene = self.write("a.ply", ply_bytes(some_splats()))
        for limits, word in [
            ("x", "got 'x'"),
            ("0", "got '0'"),
            ("9s", "milliseconds or per cent"),
            ("9," * 9, "at most 8"),
        ]:
            self.fails(curve(scene, "--limits", limits), "--limits", word)
        self.fails(curve(scene, "--modes", "fast"), "got 'fast'")
        self.fails(curve(self.path("none")), "none")

    def test_script(self):
        """benchmarks/curve.py frame: a table and JSON of every scene, and a picture where there is matplotlib."""
        words = [sys.executable, "-B", SCRIPT, "frame", f"first={self.scene}", self.scene, "-o", self.path("t")]
        bench = os.path.join(os.path.dirname(fixtures.PAGS), "pags-bench")
        more = ["--bench", bench, "-j", 1, "--", "-n", 1, "-r", 1]
        done = subprocess.run([*words, *map(str, more)], capture_output=True, text=True)
        self.assertEqual(done.returncode, 0, done.stderr)
        told = json.loads(read(self.path("t.json")))
        self.assertEqual([scene["name"] for scene in told["scenes"]], ["first", "scene"])
        names = [point["point"] for point in told["scenes"][0]["points"]]
        for name in ["off", "lossless", "paper-order", "exp3", "limit 100%"]:
            self.assertIn(name, names)
        table = read(self.path("t.md")).decode()
        self.assertEqual(table.count("\n| `off` |"), 2)
        self.check_picture(done.stdout, ["first", "error bound (bounded=EPS)", "critical pixels", "time limit"])
        bad = subprocess.run([*words, "--bench", self.path("none")], capture_output=True, text=True)
        self.assertEqual((bad.returncode, bad.stderr.count("\n")), (1, 1), bad.stderr)
        self.assertIn("make", bad.stderr)

    def check_picture(self, said, words):
        if plots.pyplot():
            picture = xml.etree.ElementTree.parse(self.path("t.svg")).getroot()
            shown = "".join(picture.itertext())
            for word in words:
                self.assertIn(word, shown)
        else:
            self.assertIn(plots.MISSING, said)
            self.assertFalse(os.path.exists(self.path("t.svg")))


class Training(fixtures.DataCase):
    """benchmarks/curve.py training."""

    def command(self, steps, rows="default,sh=0"):
        words = [sys.executable, "-B", SCRIPT, "training", self.data, "-o", self.path("t"), "--pags", fixtures.PAGS]
        words += [
            "--steps",
            steps,
            "--rows",
            rows,
            "-j",
            1,
            "--",
            "--max-gaussians",
            1500,
            "--",
            "--random-points",
            500,
        ]
        return [str(word) for word in words]

    def test_table_and_resume(self):
        running = subprocess.Popen(self.command("4,600"), stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
        log = self.path("t.runs/600.runs/set-camera_poses_1_set-light_1_seed-0/scene/log.jsonl")
        for _ in range(3000):
            if running.poll() is not None or (os.path.exists(log) and os.path.getsize(log) > 100):
                break
            time.sleep(0.02)
        running.send_signal(signal.SIGTERM)
        said, errors = running.communicate(timeout=300)
        self.assertEqual(running.returncode, 3, said + errors)
        self.assertIn("1208 steps to train: about ", said)
        self.assertFalse(os.path.exists(self.path("t.md")))
        done = subprocess.run(self.command("4,600"), capture_output=True, text=True)
        self.assertEqual(done.returncode, 0, done.stderr)
        self.assertNotIn("to estimate", done.stdout)  # there are earlier trainings to estimate by
        rows = json.loads(read(self.path("t.json")))["rows"]
        self.assertEqual(
            [(r["row"], r["steps"]) for r in rows], [(n, s) for s in (4, 600) for n in ("default", "sh=0")]
        )
        self.assertGreater(rows[2]["psnr"], rows[0]["psnr"])
        table = read(self.path("t.md")).decode()
        for words in ["| `sh=0` | 600 |", "of training", "processor"]:
            self.assertIn(words, table)
        Frames.check_picture(self, done.stdout, ["sh=0", "All pixels"])

    def test_errors(self):
        for steps, rows, code, word in [("0", "default", 2, "numbers of steps"), ("4", "nonsense", 1, "nonsense")]:
            done = subprocess.run(self.command(steps, rows), capture_output=True, text=True)
            self.assertEqual(done.returncode, code, done.stderr)
            self.assertIn(word, done.stderr)


if __name__ == "__main__":
    fixtures.main()
