# SPDX-License-Identifier: Apache-2.0
"""Tests pags train, eval and render on a small synthetic data set, and interrupted and resumed runs."""

import json
import os
import re
import shutil
import signal
import struct
import subprocess
import time
import unittest
import zlib

import fixtures
from fixtures import SMALL, DataCase, files_below, make_dataset, read

# These output files hold times, which differ between otherwise identical runs.
TIMED = {"report.json", "report.html"}
ALL_TERMS = ["--set", "sh_loss=0"]  # the scene is as trained


class Train(DataCase):
    alone = None

    def train(self, out, *more, iterations=300):
        done = self.succeeds("train", self.data, "-o", out, "-n", iterations, "--json", "-", *SMALL, *more)
        return json.loads(done.stdout)

    def scene_files(self, folder):
        """Returns the contents of the files that must have the same bits in repeated runs."""
        wanted = [n for n in files_below(folder) if n not in TIMED and not n.endswith(".pags")]
        return {name: read(os.path.join(folder, name)) for name in wanted}

    def spoil(self, checkpoint):
        """Sets the mean's x of every fourth Gaussian in a checkpoint to NaN. A section of the checkpoint has a tag, a
        size, a payload and a CRC."""
        data = bytearray(read(checkpoint))
        at = 8
        while data[at : at + 4] != b"GAUS":
            at += 16 + struct.unpack_from("<Q", data, at + 4)[0]
        size = struct.unpack_from("<Q", data, at + 4)[0]
        rows = len(data[at + 12 : at + 12 + size]) // 4 // 59
        for row in range(0, rows, 4):
            struct.pack_into("<f", data, at + 12 + 4 * row, float("nan"))
        struct.pack_into("<I", data, at + 12 + size, zlib.crc32(data[at : at + 12 + size]))
        with open(checkpoint, "wb") as file:
            file.write(data)

    def test_nan_in_a_checkpoint(self):
        out = self.path("scene")
        self.assertEqual(self.train(out, iterations=40)["bad_rows"], 0)
        self.spoil(os.path.join(out, "checkpoint.pags"))
        more = ["train", self.data, "-o", out, "-n", 60, "--resume", "--log-every", 1, "--json", "-", *SMALL]
        self.fails(
            [*more, "-q", "--max-bad-rows", 200],
            "200 are allowed; the first was mean x of row ",
            "of the background at step 41",
        )
        result = json.loads(self.succeeds(*more, "--max-bad-rows", 1000000).stdout)
        self.assertGreater(result["bad_rows"], 200)
        self.assertIn("mean x of row ", result["first_bad_row"])
        with open(os.path.join(out, "log.jsonl"), encoding="utf-8") as file:
            last = json.loads(file.read().splitlines()[-1])
        self.assertEqual(last["bad_rows"], result["bad_rows"])
        self.succeeds("info", out)  # every number of the scene is finite

    def test_held_out_views_in_the_log(self):
        plain, measured, resumed = self.path("plain"), self.path("measured"), self.path("resumed")
        often = ["--preview-every", 20, *ALL_TERMS]
        self.train(plain, *ALL_TERMS, iterations=60)
        self.train(measured, *often, iterations=60)
        for name in ["background.ply", "scene.json", "checkpoint.pags"]:
            self.assertEqual(read(os.path.join(plain, name)), read(os.path.join(measured, name)), name)
        self.assertNotIn("held_out_psnr", read(os.path.join(plain, "log.jsonl")).decode())
        lines = [json.loads(line) for line in read(os.path.join(measured, "log.jsonl")).splitlines()]
        held = [line for line in lines if "held_out_psnr" in line]
        self.assertEqual([(line["step"], line["held_out_views"]) for line in held], [(20, 2), (40, 2), (60, 2)])
        scores = json.loads(self.succeeds("eval", measured, "--split", "test", "--json", "-").stdout)
        self.assertAlmostEqual(
            held[-1]["held_out_psnr"], scores["test"]["psnr"], delta=0.01
        )  # the numbers of the scene were rounded in its PLY file
        self.train(resumed, *often, "--set", "schedule_iterations=60", iterations=40)
        self.train(resumed, *often, "--resume", iterations=60)
        self.assertEqual(
            [line for line in read(os.path.join(resumed, "log.jsonl")).splitlines() if b"held_out" in line],
            [line for line in read(os.path.join(measured, "log.jsonl")).splitlines() if b"held_out" in line],
        )

    def test_train_eval_render_info(self):
        out = self.path("scene")
        result = self.train(out)
        self.assertTrue(result["finished"])
        self.assertEqual(result["iterations"], 300)
        for key in ["seconds", "gaussians", "peak_rss_bytes", "iterations_per_second"]:
            self.assertGreater(result[key], 0, key)
        for name in ["scene.json", "background.ply", "log.jsonl", "report.json"]:
            self.assertIn(name, files_below(out))
        self.assertFalse([n for n in files_below(out) if n.endswith(".part")])

        scores = json.loads(self.succeeds("eval", out, "--json", "-", "--images", self.path("pictures")).stdout)
        self.assertEqual((scores["train"]["views"], scores["test"]["views"]), (7, 2))
        for split in ["train", "test"]:
            self.assertGreater(scores[split]["psnr"], 15)
            self.assertGreater(scores[split]["ssim"], 0.3)
            for absent in ["lpips", "psnr_critical", "psnr_noncritical", "psnr_moving"]:
                self.assertIsNone(scores[split][absent])
            self.assertEqual(len(scores[split]["per_view"]), scores[split]["views"])
        self.assertIn("000_render.png", files_below(self.path("pictures")))
        self.assertEqual(len(files_below(self.path("pictures"))), 18)

        for split, count in [("train", 7), ("test", 2), ("all", 9)]:
            self.succeeds("render", out, "--split", split, "-o", self.path(split))
            self.assertEqual(len(files_below(self.path(split))), count)
        self.succeeds("render", out, "--path", "ego", "--frames", 4, "-o", self.path("ego"))
        self.succeeds("render", out, "--path", "orbit", "--frames", 4, "-o", self.path("orbit"))

        facts = json.loads(self.succeeds("info", out, "--json", "-").stdout)
        self.assertEqual((facts["kind"], facts["iterations"]), ("scene", 300))
        self.assertEqual(facts["gaussians"], result["gaussians"])
        plys = [os.path.join(out, name) for name in files_below(out) if name.endswith(".ply")]
        counts = [json.loads(self.succeeds("info", ply, "--json", "-").stdout)["gaussians"] for ply in plys]
        self.assertEqual(sum(counts), result["gaussians"])
        self.succeeds("render", os.path.join(out, "background.ply"), "-n", 1, "-o", self.path("bare"))

    def test_every_field_of_the_configuration_is_listed(self):
        self.train(
            self.path("scene"),
            "--set",
            "lidar_pull=0.25",
            "--set",
            "densify_gradient=0.0003",
            "--antialiased",
            iterations=1,
        )
        config = json.loads(read(self.path("scene", "scene.json")))["config"]
        self.assertEqual((config["lidar_pull"], config["densify_gradient"], config["antialiased"]), (0.25, 0.0003, 1))
        listed = re.findall(r"^  ([a-z]\w*) ", self.succeeds("train", "--fields").stdout, re.M)
        self.assertGreater(len(config), 80)
        self.assertEqual(sorted(listed), sorted(config))

    def test_eval_of_a_downscaled_scene_finds_its_size(self):
        out = self.path("scene")
        self.train(out, "--downscale", "1.5", "--split-every", "4", iterations=50)
        scores = json.loads(self.succeeds("eval", out, "--json", "-").stdout)
        self.assertEqual((scores["train"]["views"], scores["test"]["views"]), (6, 3))
        other = make_dataset(self.path("other"), views=4)
        self.fails(["eval", out, "--dataset", other, "-q"], other)

    def test_same_bits_on_one_and_two_threads(self):
        self.train(self.path("one"), "-j", 1, iterations=200)
        self.train(self.path("two"), "-j", 2, iterations=200)
        self.assertEqual(self.scene_files(self.path("one")), self.scene_files(self.path("two")))

    def start(self, out, iterations, *more):
        """Starts a training in the background. Returns when its log has a new line."""
        command = [fixtures.PAGS, "train", self.data, "-o", out, "--iterations", str(iterations), "--json"]
        command += [self.path("result.json"), "--log-every", "10", "--checkpoint-every", "50", "--resume"]
        command += [*SMALL, *more]
        running = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True)
        log, before = os.path.join(out, "log.jsonl"), 0
        if os.path.exists(log):
            before = os.path.getsize(log)
        for _ in range(1200):
            if running.poll() is not None or (os.path.exists(log) and os.path.getsize(log) > before):
                break
            time.sleep(0.05)
        return running

    def left_alone(self, iterations, options):
        """Returns the files of an uninterrupted run. All tests share one run."""
        if Train.alone is None:
            self.train(self.path("alone"), *options, iterations=iterations)
            Train.alone = self.scene_files(self.path("alone"))
        return Train.alone

    def interrupted(self, how):
        """Interrupts a run by a signal and resumes it to its end. Asserts that its files are those of an uninterrupted
        run."""
        out, iterations = self.path("scene"), 600
        running = self.start(out, iterations)
        running.send_signal(how)
        _, errors = running.communicate(timeout=120)
        if how != signal.SIGKILL:
            self.assertEqual(running.returncode, 3, errors)
            self.assertIn("--resume", errors)
            self.assertEqual(len(errors.splitlines()), 1)
            result = json.loads(read(self.path("result.json")))
            self.assertFalse(result["finished"])
            self.assertLess(result["iterations"], iterations)
            self.assertIn("scene.json", files_below(out))
            self.succeeds("render", out, "--split", "test", "-o", self.path("early"))
            checkpoint = [n for n in files_below(out) if n.endswith(".pags")]
            facts = json.loads(self.succeeds("info", os.path.join(out, checkpoint[0]), "--json", "-").stdout)
            self.assertEqual((facts["kind"], facts["step"]), ("checkpoint", result["iterations"]))
        options = ["--log-every", "10", "--checkpoint-every", "50"]
        result = self.train(out, "--resume", *options, iterations=iterations)
        self.assertTrue(result["finished"])
        self.assertEqual(result["iterations"], iterations)
        self.assertEqual(self.scene_files(out), self.left_alone(iterations, options))

    def test_interrupt_and_resume(self):
        self.interrupted(signal.SIGINT)

    def test_terminate_and_resume(self):
        self.interrupted(signal.SIGTERM)

    @unittest.skipUnless(hasattr(signal, "SIGUSR1"), "Windows has no such signal")
    def test_user_signal_and_resume(self):
        self.interrupted(signal.SIGUSR1)

    def test_checkpoints_by_the_clock(self):
        out = self.path("scene")
        command = [
            fixtures.PAGS,
            "train",
            self.data,
            "-o",
            out,
            "--iterations",
            "1000000",
            "--checkpoint-every",
            "0",
            "--checkpoint-minutes",
            "0.001",
        ]
        running = subprocess.Popen(
            [*command, "-q", *SMALL], stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True
        )
        for _ in range(1200):
            if running.poll() is not None or os.path.exists(os.path.join(out, "checkpoint.pags")):
                break
            time.sleep(0.05)
        running.kill()
        running.communicate()
        facts = json.loads(self.succeeds("info", os.path.join(out, "checkpoint.pags"), "--json", "-").stdout)
        self.assertGreater(facts["step"], 0)

    def test_kill_and_resume(self):
        self.interrupted(signal.SIGKILL)

    def test_resumed_with_other_kernels(self):
        """Resuming with other kernels changes bits. Then a warning says so, even when the first kernels are used again.
        Otherwise there is no warning."""
        words, plain = ["train", self.data, "-q", *SMALL, "-n"], {**os.environ, "PAGS_CPU": "scalar"}
        self.succeeds(*words, 30, "-o", self.path("whole"))
        self.assertEqual(self.succeeds(*words, 10, "-o", self.path("alike")).stderr, "")
        self.assertEqual(self.succeeds(*words, 30, "-o", self.path("alike"), "--resume").stderr, "")
        self.succeeds(*words, 10, "-o", self.path("mixed"), env=plain)
        said = [
            self.succeeds(*words, n, "-o", self.path("mixed"), "--resume", env=env).stderr
            for n, env in [(20, None), (30, plain), (30, None)]
        ]
        same = all(
            read(self.path(name, "background.ply")) == read(self.path("whole", "background.ply"))
            for name in ["alike", "mixed"]
        )
        kernels = [] if same else ["scalar", self.succeeds("--version").stdout.split("run here; ")[1].split()[0]]
        self.assertEqual([line.count("the bits will differ") for line in said], [len(kernels) // 2] * 2 + [0], said)
        for name, line in zip(kernels, said):
            self.assertIn(f"mixed/checkpoint.pags: steps were computed with the kernels {name}, ", line)

    def test_second_interrupt_ends_at_once(self):
        running = self.start(self.path("scene"), 1000000)
        running.send_signal(signal.SIGSTOP)
        running.send_signal(signal.SIGINT)
        running.send_signal(signal.SIGCONT)
        time.sleep(0.001)
        running.send_signal(signal.SIGINT)
        running.communicate(timeout=60)
        self.assertIn(running.returncode, [3, 130])

    def test_broken_checkpoint(self):
        out = self.path("scene")
        self.train(out, iterations=60)
        name = [n for n in files_below(out) if n.endswith(".pags")][0]
        path = os.path.join(out, name)
        whole = read(path)
        for broken in [whole[: len(whole) // 2], whole[:200] + b"\xff" + whole[201:], b""]:
            self.write(os.path.join("scene", name), broken)
            before = self.scene_files(out)
            self.fails(["train", self.data, "-o", out, "--iterations", 90, "--resume", "-q", *SMALL], path)
            self.assertEqual(self.scene_files(out), before)
        self.write(os.path.join("scene", name), whole)
        self.train(out, "--resume", iterations=90)

    def test_resume_without_a_checkpoint(self):
        out, more = self.path("scene"), ["--iterations", 60, "--resume", *SMALL]
        begun = self.succeeds(
            "train", self.data, "-o", out, *more
        )  # there is no checkpoint yet, so the message says that the run begins
        self.assertIn("no checkpoint to go on from: the run begins", begun.stdout)
        os.remove(os.path.join(out, "checkpoint.pags"))
        before = {name: read(os.path.join(out, name)) for name in files_below(out)}
        self.fails(["train", self.data, "-o", out, *more, "-q"], out, "no checkpoint to go on from", "--overwrite")
        self.assertEqual({name: read(os.path.join(out, name)) for name in files_below(out)}, before)
        os.remove(
            os.path.join(out, "scene.json")
        )  # a run that is killed before its first checkpoint leaves such a folder
        again = self.succeeds("train", self.data, "-o", out, *more)
        self.assertIn("the run begins", again.stdout)
        self.assertIn("checkpoint.pags", files_below(out))
        self.assertNotIn("begins", self.succeeds("train", self.data, "-o", out, *more, "--iterations", 70).stdout)

    def test_overwrite_and_refusal(self):
        out = self.path("scene")
        self.train(out, iterations=30)
        before = self.scene_files(out)
        self.fails(["train", self.data, "-o", out, "--iterations", 30, "-q"], out, "--overwrite")
        self.assertEqual(self.scene_files(out), before)
        self.train(out, "--overwrite", "--seed", "5", iterations=30)
        self.assertNotEqual(self.scene_files(out)["background.ply"], before["background.ply"])
        other = ["--iterations", 60, "--resume", "-q", *SMALL, "--seed", "6"]
        self.fails(["train", self.data, "-o", out, *other], "seed")

    def test_bound_on_gaussians(self):
        result = self.train(self.path("scene"), "--max-gaussians", "600", iterations=400)
        self.assertLessEqual(result["gaussians"], 600)

    def test_strategies(self):
        for more in [["--strategy", "mcmc"], ["--set", "long_axis_split=0"], ["--antialiased"], ["--sh-degree", "0"]]:
            out = self.path("scene")
            result = self.train(out, *more, "--reconstruction", iterations=120)
            self.assertTrue(result["finished"])
            scores = json.loads(self.succeeds("eval", out, "--json", "-").stdout)
            self.assertEqual((scores["test"]["views"], scores["test"]["psnr"]), (0, None))
            self.assertGreater(scores["train"]["psnr"], 12)
            shutil.rmtree(out)

    def test_estimate(self):
        done = self.succeeds("train", self.data, "--estimate", "--json", "-")
        result = json.loads(done.stdout)
        self.assertGreater(result["estimated_seconds"], 0)
        self.assertGreater(result["estimated_bytes"], 0)
        self.assertEqual(files_below(self.folder), [])


if __name__ == "__main__":
    fixtures.main()
