# SPDX-License-Identifier: Apache-2.0
"""Tests benchmarks/paper.py on a small synthetic street: rows and columns of its tables, trainings that tables share,
resuming, plots with and without matplotlib, and the picture of an object."""

import csv
import os
import re
import signal
import subprocess
import sys
import time
import xml.etree.ElementTree

import fixtures
from fixtures import Case, read, read_png, write

SCRIPT = os.path.join(os.path.dirname(os.path.abspath(__file__)), "../../benchmarks/paper.py")
sys.path.insert(0, os.path.dirname(SCRIPT))
import ablation  # noqa: E402
import paper  # noqa: E402
import plots  # noqa: E402

SMALL = ["--", "--set", "lidar_points=1000", "--max-gaussians", "3000"]


def table_of(page):
    """The first table of a page in Markdown: a dict per row, by the heads of its columns."""
    lines = [[cell.strip() for cell in line.strip("|").split("|")] for line in page.splitlines() if line[:1] == "|"]
    heads, first = lines[0], lines[2:]
    same = next((i for i, line in enumerate(first) if len(line) != len(heads) or line[0] == "row"), len(first))
    return [dict(zip(heads, line)) for line in first[:same]]


class Paper(Case):
    @classmethod
    def setUpClass(cls):
        cls.data = os.path.join(cls.shared_folder(), "street")
        words = ["--size", "96x54", "--frames", 9, "--cameras", 1, "--samples", 1, "--no-shifts", "-q", "-j", 1]
        done = fixtures.run("synth", "street", "-o", cls.data, *words)
        assert done.returncode == 0, done.stderr

    def command(self, table, *more, data=None, iterations=8):
        own = [sys.executable, "-B", SCRIPT, table, data or self.data, "-o", self.path("t"), "--pags", fixtures.PAGS]
        return [str(w) for w in [*own, "-n", iterations, "--moments", 1, "--downscale", 1, "-j", 1, *more, *SMALL]]

    def make(self, table, *more, code=0, plots=False, **options):
        """Runs the script; without `plots`, as where matplotlib is missing, which is quicker."""
        command, path = self.command(table, *more, **options), {"PYTHONPATH": self.path("none")}
        write(self.path("none/matplotlib.py"), "raise ImportError\n")
        environment = {**os.environ, **({} if plots else path)}
        done = subprocess.run(command, capture_output=True, text=True, timeout=600, env=environment)
        self.assertEqual(done.returncode, code, f"{command}: {done.stdout}{done.stderr}")
        return done

    def rows(self, table):
        return table_of(read(self.path("t", f"{table}.md")).decode())

    def runs(self):
        return {name for name in os.listdir(self.path("t/runs")) if name != "settings.json"}

    def test_table3_and_tables_that_share_its_trainings(self):
        self.make("table3", "-q")
        rows = {row["row"]: row for row in self.rows("table3")}
        self.assertEqual(list(rows), ["plain", "SP", "SD", "SP + SD", "SPR", "PDR", "SPR + PDR", "default"])
        for row in rows.values():
            for head in [
                *("PSNR", "PSNR-C", "PSNR-NC", "PSNR moving", "SSIM", "Gaussians", "MB", "peak MB", "training s"),
                *("CPU s", "frames / s"),
            ]:
                self.assertGreater(float(row[head]), 0, head)
        # PDR renders the models of plain and SPR.
        for of, pdr in [("plain", "PDR"), ("SPR", "SPR + PDR")]:
            self.assertEqual(rows[of]["Gaussians"], rows[pdr]["Gaussians"])
            self.assertEqual(rows[of]["training s"], rows[pdr]["training s"])
        self.assertLess(int(rows["SPR"]["Gaussians"]), int(rows["plain"]["Gaussians"]))
        page = read(self.path("t/table3.md")).decode()
        self.assertIn("--set camera_poses=1 --set light=1", page)
        self.assertEqual(len(self.runs()), 6)
        for end in [".csv", "_curve.csv"]:
            self.assertTrue(os.path.exists(self.path(f"t/table3{end}")))

        before = self.runs()
        self.make("order", "-q")
        self.assertEqual(self.runs(), before)
        with open(self.path("t/order.csv"), newline="") as file:
            orders = {line["row"]: line["psnr"] for line in csv.DictReader(file)}
        self.assertEqual(len(orders), 12)
        self.assertNotEqual(orders[paper.PLAIN], orders[paper.PLAIN + "+paper-order"])
        self.assertEqual([row["PSNR"] for row in self.rows("order")][0], rows["plain"]["PSNR"])

    def test_rows_of_the_tables(self):
        """alpha 0.4 of Table 4 and the centre of figure 5 are the training of SPR, which has the paper's values."""

        def words(table, title):
            return ablation.Row(paper.TABLES[table][0][title], 1).train.words()

        spr = words("table3", "SPR")
        self.assertEqual(words("table4", "hybrid, alpha 0.4"), spr)
        self.assertEqual(words("figure5", "60 %, 30 %"), spr)
        for pair in [["--alpha", "0.4"], ["--prune-rate", "0.6/0.3"], ["--set", "dropout_beta=0.5"]]:
            self.assertIn(pair, [spr[i : i + 2] for i in range(len(spr))])
        self.assertEqual(len({tuple(words("figure5", title)) for title in paper.TABLES["figure5"][0]}), 9)
        self.make("figure5", "--check-options")
        self.assertFalse(os.path.exists(self.path("t")))

    def test_interrupted_table_is_resumed(self):
        running = subprocess.Popen(
            self.command("object", "--target-size", 20, iterations=300),
            stdout=subprocess.DEVNULL,
            stderr=subprocess.PIPE,
            text=True,
        )
        for _ in range(6000):
            logs = [self.path("t/runs", run, "scene/log.jsonl") for run in self.runs_or_none()]
            if running.poll() is not None or any(os.path.exists(log) and os.path.getsize(log) > 100 for log in logs):
                break
            time.sleep(0.02)
        self.assertIsNone(running.poll(), "finished before it could be stopped")
        os.kill(running.pid, signal.SIGINT)
        _, said = running.communicate(timeout=300)
        self.assertEqual(running.returncode, 3, said)
        self.assertIn("paper.py: interrupted; the same command resumes", said)
        (run,) = self.runs()
        before = ablation.read_json(self.path("t/runs", run, "run.json"))
        self.assertTrue(0 < before["step"] < 300, before)
        refused = self.make("object", "--target-size", 20, code=1)  # another number of steps
        self.assertIn("paper.py: ", refused.stderr)
        self.assertIn("settings.json", refused.stderr)
        self.make("object", "-q", "--target-size", 20, iterations=300)
        after = ablation.read_json(self.path("t/runs", run, "run.json"))
        self.assertEqual(after["step"], 300)
        self.assertGreater(after["seconds"], before["seconds"])
        self.assertEqual([row["row"] for row in self.rows("object")], ["plain", "paper", "default"])

    def runs_or_none(self):
        return self.runs() if os.path.exists(self.path("t/runs")) else []

    def test_start(self):
        """Rows for LiDAR, structure from motion, both and neither; for a capture without LiDAR, other rows."""
        write(self.path("model/cameras.txt"), "1 PINHOLE 96 54 80 80 48 27\n")
        write(self.path("model/images.txt"), "1 1 0 0 0 0 0 0 1 other.png\n\n")
        points = (f"{i} {i % 20} {i % 7 - 3} {i % 5} 90 90 90 0.5 1 0 1 1\n" for i in range(1, 300))
        write(self.path("model/points3D.txt"), "".join(points))
        self.make("start", "-q", "--sfm", self.path("model"))
        rows = self.rows("start")
        titles = ["LiDAR", "matched", "SfM", "LiDAR and SfM"]
        self.assertEqual([row["row"] for row in rows], titles)
        self.assertEqual(len({row["PSNR"] + row["Gaussians"] for row in rows}), len(titles))
        capture = fixtures.make_dataset(self.path("capture"))
        for more, titles in [([], ["matched"]), (["--sfm", "model"], ["matched", "SfM"])]:
            given, _ = paper.parse_arguments(["start", capture, "-o", "t", "--pags", fixtures.PAGS, *more])
            self.assertEqual(list(paper.rows_of_start(given)), titles)
        failed = self.make("start", "--sfm", "a+b", code=1)
        self.assertIn("expected a path without", failed.stderr)

    def test_without_matplotlib(self):
        done = self.make("object", "--target-size", 20)
        for name in ["object.svg", "object.png"]:
            self.assertEqual(len(re.findall(f"no .*{name}: plots need matplotlib; 'make setup'", done.stdout)), 1)
            self.assertFalse(os.path.exists(self.path("t", name)))
        rows = self.rows("object")
        self.assertEqual([row["row"] for row in rows], ["plain", "paper", "default"])

    def test_plots_and_picture_of_an_object(self):
        if not plots.pyplot():
            self.skipTest(plots.MISSING)
        self.make("object", "-q", "--target-size", 20, plots=True)
        words = "".join(xml.etree.ElementTree.parse(self.path("t/object.svg")).getroot().itertext())
        for word in ["plain", "paper", "default", "seconds of training"]:
            self.assertIn(word, words)
        width, height = plots.pyplot().imread(self.path("t/object.png")).shape[1::-1]
        self.assertGreater(width, 3 * height)
        self.assertLess(os.path.getsize(self.path("t/object.png")), 200000)

    def test_box_of_the_largest_object(self):
        """The masks of moving objects, which pags synth draws, fill the box of the chosen object."""
        scene = self.path("scene")
        self.succeeds("train", self.data, "-o", scene, "-n", 2, "-q", "-j", 1, *SMALL[1:])
        camera, (left, top, right, bottom) = paper.largest_object(ablation.read_json(os.path.join(scene, "scene.json")))
        name = os.path.splitext(camera["name"])[0]
        width, height, channels, _, samples = read_png(os.path.join(self.data, "dynamic_masks/all", f"{name}.png"))
        self.assertTrue(camera["test"])
        inside = [
            samples[(v * width + u) * channels] for v in range(height) for u in range(width)
            if left + 1 < u + 0.5 < right - 1 and top + 1 < v + 0.5 < bottom - 1
        ]  # fmt: skip
        self.assertGreater(len(inside), 20)
        self.assertGreater(sum(sample > 0 for sample in inside) / len(inside), 0.5)


if __name__ == "__main__":
    fixtures.main()
