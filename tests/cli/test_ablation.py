# SPDX-License-Identifier: Apache-2.0
"""Tests benchmarks/ablation.py: rows and their names, written files, stopping and resuming. A run has the same bits as
`pags train`."""

import csv
import json
import os
import shutil
import signal
import subprocess
import sys
import time
import xml.etree.ElementTree

import fixtures
from fixtures import DataCase, read

# Few Gaussians keep the runs short.
SMALL = ["--max-gaussians", "1500", "--", "--random-points", "500"]


SCRIPT = os.path.join(os.path.dirname(os.path.abspath(__file__)), "../../benchmarks/ablation.py")
sys.path.insert(0, os.path.dirname(SCRIPT))
import ablation  # noqa: E402
import plots  # noqa: E402


class Ablation(DataCase):
    def command(self, rows, *more, iterations=40):
        own = [sys.executable, "-B", SCRIPT, self.data, "-o", self.path("t"), "--pags", fixtures.PAGS]
        return [str(word) for word in [*own, "-n", iterations, "--rows", rows, "-j", 1, *more]]

    def run_script(self, *arguments, code=0, **more):
        command = self.command(*arguments, **more)
        done = subprocess.run(command, capture_output=True, text=True, timeout=900)
        self.assertEqual(done.returncode, code, f"{command}: {done.stdout}{done.stderr}")
        return done

    def refuses(self, *arguments, words, code=1, **more):
        """Asserts that the script fails with one line that names the program and holds each of `words`."""
        lines = self.run_script(*arguments, code=code, **more).stderr.splitlines()
        self.assertEqual(len(lines), 1, lines)
        self.assertTrue(lines[0].startswith("ablation.py: "), lines)
        for word in words:
            self.assertIn(word, lines[0])

    def ablate(self, rows, *more, **options):
        done = self.run_script(rows, "--moments", 4, *more, "--json", "-", *SMALL, **options)
        self.said = done.stderr
        return json.loads(done.stdout)["rows"]

    def test_tables_follow_links(self):
        for ending in [".md", ".csv", "_curve.csv"]:
            os.symlink(f"far{ending}", self.path("t" + ending))
        self.ablate("plain", iterations=4)
        for ending in [".md", ".csv", "_curve.csv"]:
            self.assertTrue(os.path.islink(self.path("t" + ending)), ending)
            self.assertTrue(read(self.path("far" + ending)), ending)

    def folders(self):
        runs = self.path("t.runs")
        return sorted(n for n in os.listdir(runs) if os.path.isdir(os.path.join(runs, n)))

    def written(self):
        """Returns the modification times of each run's scene and evaluation."""
        return {
            name: [os.stat(self.path("t.runs", name, f)).st_mtime_ns for f in ["scene/background.ply", "eval.json"]]
            for name in self.folders()
        }

    def test_rows_tables_and_plot(self):
        rows = self.ablate("plain*2,sh=0,no-exposure+sh=0")
        expected = [("plain", 0), ("plain", 1), ("sh=0", 0), ("no-exposure+sh=0", 0)]
        self.assertEqual([(r["row"], r["seed"]) for r in rows], expected)
        for row in rows:
            self.assertEqual([m["step"] for m in row["moments"]], [10, 20, 30, 40])
            seconds = [m["seconds"] for m in row["moments"]]
            self.assertEqual(seconds, sorted(seconds))
            self.assertEqual(seconds[-1], row["training_seconds"])
            for key in ["psnr", "ssim", "gaussians", "bytes", "training_seconds", "training_cpu_seconds", "render_ms"]:
                self.assertGreater(row[key], 0, key)
            self.assertIsNone(row["psnr_critical"])
        self.assertLess(rows[2]["bytes"], 0.5 * rows[0]["bytes"])
        self.assertNotEqual(rows[0]["psnr"], rows[1]["psnr"])
        # Both held-out views are also evaluated at the intermediate moments.
        self.assertEqual(rows[0]["moments"][-1]["psnr"], rows[0]["psnr"])

        table = read(self.path("t.md")).decode()
        for words in ["| `plain` |", "| `sh=0` |", "Spread over seeds", "At equal time", "`--sh-degree 0`"]:
            self.assertIn(words, table)
        with open(self.path("t.csv"), newline="") as file:
            lines = list(csv.DictReader(file))
        self.assertEqual([line["row"] for line in lines], [r["row"] for r in rows])
        self.assertAlmostEqual(float(lines[0]["psnr"]), rows[0]["psnr"], 6)
        with open(self.path("t_curve.csv"), newline="") as file:
            self.assertEqual(len(list(csv.DictReader(file))), 16)
        if plots.pyplot():
            picture = xml.etree.ElementTree.parse(self.path("t.svg")).getroot()
            self.assertIn("plain", "".join(picture.itertext()))
        else:
            self.assertEqual(self.said.count(plots.MISSING), 1, self.said)
            self.assertFalse(os.path.exists(self.path("t.svg")))

        # Only missing runs are trained. So rows can be added later, and LPIPS can be requested later.
        before = self.written()
        again = self.ablate("sh=0,plain*2,sh=1")
        self.assertEqual(again[0], rows[2])
        after = self.written()
        self.assertEqual({name: after[name] for name in before}, before)
        self.assertEqual(len(after), len(before) + 1)
        self.refuses("sh=0", "--moments", 4, *SMALL, iterations=39, words=["t.runs/settings.json", "another -o"])

    def test_difference_within_the_spread_is_reported_as_none(self):
        """Two rows that name the same training show no difference."""
        self.ablate("default*2,--sh-degree=3")
        table = read(self.path("t.md")).decode()
        compared = table[table.index("Against `default`") :].splitlines()
        line = next(line for line in compared if line.startswith("| `--sh-degree=3`"))
        self.assertIn(" none |", line)

    def test_beside_option(self):
        rows = self.ablate("sh=0", "--beside", "sh=1")
        self.assertEqual(len(rows), 1)
        self.assertGreater(rows[0]["beside"], 0)
        self.assertGreater(rows[0]["pairs"], 0)
        self.assertIn("s / s beside", read(self.path("t.md")).decode())
        self.assertEqual(sorted(self.folders()), ["sh-degree-0_seed-0", "sh-degree-1_seed-0_beside_sh_0"])

    def test_rows_that_train_alike_share_their_run(self):
        self.ablate("sh=1,--sh-degree=1")
        self.assertEqual(self.folders(), ["sh-degree-1_seed-0"])

    def test_run_has_the_bits_of_a_single_training(self):
        self.ablate("sh=1")
        out = self.path("alone")
        small = [word for word in SMALL if word != "--"]
        self.succeeds("train", self.data, "-o", out, "-n", 40, "-j", 1, "--sh-degree", 1, "-q", *small)
        here = read(self.path("t.runs", "sh-degree-1_seed-0", "scene", "background.ply"))
        self.assertEqual(here, read(os.path.join(out, "background.ply")))

    def test_rows_at_equal_count(self):
        """With --equal-count, each pruning row resumes from before its last prune. That prune then leaves as many
        Gaussians as the smallest row has."""
        options = ["--moments", 4, "--equal-count", "--json", "-", *SMALL]
        done = self.run_script("plain,sp,sp+rate=30/10", *options, iterations=120)
        result = json.loads(done.stdout)
        counts = {row["row"]: row["gaussians"] for row in result["rows"]}
        self.assertLess(counts["sp"], counts["sp+rate=30/10"])
        self.assertEqual(result["equal_count"], counts["sp"])
        self.assertEqual([row["row"] for row in result["equal_rows"]], ["sp", "sp+rate=30/10"])
        for row in result["equal_rows"]:
            self.assertEqual(row["gaussians"], counts["sp"])
        own = {row["row"]: row for row in result["rows"]}["sp+rate=30/10"]
        equal = result["equal_rows"][1]
        self.assertEqual(equal["moments"][:3], own["moments"][:3])
        self.assertNotEqual(equal["moments"][3], own["moments"][3])
        self.assertIn("## At equal count", read(self.path("t.md")).decode())
        # A training with this limit on Gaussians from the start gives the same bits.
        out = self.path("alone")
        bounded = [
            "--preset",
            "paper",
            "--alpha",
            0,
            "--set",
            "dropout=0",
            "--prune-rate",
            "0.3/0.1",
            "--max-gaussians",
            counts["sp"],
        ]
        self.succeeds("train", self.data, "-o", out, "-n", 120, "-j", 1, "-q", "--random-points", 500, *bounded)
        run = f"preset-paper_alpha-0_set-dropout_0_prune-rate-0.3_0.1_max-gaussians-{counts['sp']}_seed-0"
        here = read(self.path("t.runs", run, "scene", "background.ply"))
        self.assertEqual(here, read(os.path.join(out, "background.ply")))

    def stopped(self, how, wait):
        """Starts the script, sends it the signal while its first run trains, and returns its exit code and stderr."""
        command = self.command("sh=1", "--moments", 2, *SMALL, iterations=800)
        running = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True)
        log = self.path("t.runs", "sh-degree-1_seed-0", "scene", "log.jsonl")
        for _ in range(6000):
            if running.poll() is not None or (os.path.exists(log) and os.path.getsize(log) > wait):
                break
            time.sleep(0.02)
        self.assertIsNone(running.poll(), "finished before it could be stopped")
        os.kill(running.pid, how)
        _, said = running.communicate(timeout=300)
        return running.returncode, said

    def finish(self):
        return json.loads(self.run_script("sh=1", "--moments", 2, "--json", "-", *SMALL, iterations=800).stdout)[
            "rows"
        ][0]

    def test_interrupted_and_killed_runs_are_resumed(self):
        code, said = self.stopped(signal.SIGINT, 100)
        self.assertEqual(code, 3, said)
        self.assertIn("interrupted", said)
        state = json.loads(read(self.path("t.runs", "sh-degree-1_seed-0", "run.json")))
        self.assertGreater(state["step"], 0)
        self.assertLess(state["step"], 400)
        self.assertGreater(state["seconds"], 0)
        code, _ = self.stopped(signal.SIGKILL, 200)
        self.assertEqual(code, -signal.SIGKILL)
        time.sleep(0.5)  # the training ends meanwhile, as its script was killed
        result = self.finish()
        ply = ("t.runs", "sh-degree-1_seed-0", "scene", "background.ply")
        disturbed = read(self.path(*ply))
        self.assertGreater(result["moments"][0]["seconds"], state["seconds"])
        shutil.rmtree(self.path("t.runs"))
        self.finish()
        self.assertEqual(read(self.path(*ply)), disturbed)

    def test_bad_rows(self):
        for rows, words in [
            ("plain,nonsense", ["nonsense", "no-sky"]),
            ("sh=", ["sh="]),
            ("sh=9", ["row 'sh=9'", "--sh-degree"]),
            ("alpha=x", ["alpha=x"]),
            ("rate=60", ["60/30"]),
            ("--no-such-thing", ["row '--no-such-thing'", "unknown option"]),
            ("set:no_such=1", ["row 'set:no_such=1'", "unknown training field"]),
            ("--densify-from=5", ["row '--densify-from=5'", "--set densify_from=N"]),
            ("plain,plain", ["twice"]),
            ("plain*99", ["plain"]),
            ("plain,", ["name of a row"]),
        ]:
            self.refuses(rows, *SMALL, words=words)
            self.assertFalse(os.path.exists(self.path("t.runs")), rows)
        self.refuses("sh=1", "--moments", 0, words=["--moments", "from 1 to 64"], code=2)
        self.refuses("sh=1", "--moments", 41, words=["--moments", "--iterations"], code=2)
        self.refuses("sh=1", "--no-such-thing", words=["--no-such-thing"], code=2)

    def test_options_of_rows(self):
        row = ablation.Row
        for name, words in [
            ("default", ""),
            ("plain", "--preset plain"),
            ("alpha=0.2", "--preset paper --alpha 0.2 --prune-rate 0.6/0.3 --set dropout=1 --set dropout_beta=0.5"),
            ("sp+sd", "--preset paper --alpha 0 --set dropout=1 --set dropout_beta=0"),
            (
                "sd+beta=0.1+score=default+no-fourier",
                "--preset plain --set dropout=1 --set dropout_beta=0.1 --set score=default --set fourier=0",
            ),
            ("plain+rate=40/20+no-sky", "--preset plain --prune-rate 0.4/0.2 --no-sky"),
            ("sh=2+--sh-degree=1+--mcmc", "--sh-degree 1 --mcmc"),
            ("no-lidar-loss+--a=b=c", "--set depth_weight=0 --a b=c"),
            ("set:a=1+--set=b=2+set:a=3", "--set a=3 --set b=2"),
        ]:
            self.assertEqual(" ".join(row(name, 1).train.words()), words, name)
        self.assertEqual(row("spr+pdr*3", 1).eval.words(), ["--early-z", "paper"])
        self.assertEqual(row("pdr+paper-order", 1).eval.words(), ["--early-z", "paper", "--order", "paper"])
        self.assertEqual(row("plain+pdr", 1).train.words(), row("plain", 1).train.words())
        self.assertEqual((row("spr*3", 1).seeds, row("spr", 2).seeds), (3, 2))
        self.assertTrue(row("default", 1).prunes and row("alpha=1", 1).prunes)
        self.assertFalse(row("sd", 1).prunes or row("default+no-prunes", 1).prunes)

    def test_output_to_links_and_fifos(self):
        """An output path may be a link, which is followed, or a FIFO, which no file replaces."""
        write = ablation.write
        os.mkfifo(self.path("fifo"))
        reader = subprocess.Popen(["cat", self.path("fifo")], stdout=subprocess.PIPE, text=True)
        write(self.path("fifo"), "text")
        self.assertEqual(reader.communicate(timeout=60)[0], "text")
        os.symlink("target", self.path("link"))
        write(self.path("link"), "text")
        self.assertTrue(os.path.islink(self.path("link")))
        self.assertEqual(read(self.path("target")), b"text")
        self.assertEqual(sorted(os.listdir(self.folder)), ["fifo", "link", "target"])

    def test_eval_of_some_views(self):
        out = self.path("scene")
        self.succeeds("train", self.data, "-o", out, "-n", 5, "--random-points", 500, "-q", "-j", 1)
        for views, count in [(0, 7), (1, 1), (3, 3), (7, 7), (99, 7)]:
            done = self.succeeds("eval", out, "--split", "train", "--views", views, "--json", "-")
            self.assertEqual(json.loads(done.stdout)["train"]["views"], count)

    def test_check_options_does_nothing(self):
        done = self.succeeds("train", "no/such/data", "-o", self.path("none"), "--sh-degree", 2, "--check-options")
        self.assertEqual((done.stdout, os.path.exists(self.path("none"))), ("", False))
        self.fails(["train", "x", "-o", self.path("none"), "--sh-degre", 2, "--check-options"], "--sh-degree", code=2)
        self.run_script("sh=1", "--check-options")
        self.refuses("sh=1+--sh-degre=2", "--check-options", words=["--sh-degree"])
        self.assertFalse(os.path.exists(self.path("t.runs")))


if __name__ == "__main__":
    fixtures.main()
