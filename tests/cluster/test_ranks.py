#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""test_ranks.py PAGS: compares pags train, render and eval under mpirun with one process. In some tests, a rank fails,
is killed, is stopped or gets a signal.

PAGS_KILLS is the number of random moments at which a rank is killed and at which ranks are stopped (make check-cluster:
10)."""

import json
import os
import random
import shutil
import signal
import subprocess
import sys
import time
import unittest

sys.path.insert(0, os.path.dirname(os.path.abspath(__file__)))
import mpirun
import rank_jobs
from rank_jobs import children_of, contents, wait_for

KILLS = int(os.environ.get("PAGS_KILLS", "0"))


def without_times(value):
    if isinstance(value, dict):
        return {key: without_times(item) for key, item in value.items() if key != "ms"}
    return [without_times(item) for item in value] if isinstance(value, list) else value


class Ranks(rank_jobs.Jobs):
    @classmethod
    def setUpClass(cls):
        super().setUpClass()
        cls.scene = os.path.join(cls.root, "scene")
        cls.make(["train", cls.street, "-q", "-o", cls.scene, "--iterations", "8", "--seed", "1"])

    def compare(self, verb, *arguments):
        """Asserts that one process and two ranks give the same files and the same report."""
        reports = []
        for ranks in (1, 2):
            folder, report = self.path(f"{verb}-{ranks}"), self.path(f"{verb}-{ranks}.json")
            shutil.rmtree(folder, ignore_errors=True)
            command = [
                PAGS,
                verb,
                self.scene,
                "--images" if verb == "eval" else "-o",
                folder,
                "--json",
                report,
                "--threads",
                "1",
                *arguments,
            ]
            done = mpirun.run(2, command) if ranks == 2 else subprocess.run(command, capture_output=True, text=True)
            self.assertEqual(done.returncode, 0, done.stderr)
            with open(report, encoding="utf-8") as file:
                reports.append((without_times(json.load(file)), contents(folder), done.stdout))
        self.assertTrue(reports[0][1])
        self.assertEqual(reports[0][:2], reports[1][:2])
        return reports[1][2]

    def test_render(self):
        said = self.compare(
            "render", "--path", "ego", "--frames", "5", "--downscale", "2", "--channel", "color,depth,motion"
        )
        self.assertIn("5 frames", said)
        self.assertIn("on 2 ranks of 1 thread", said)
        self.assertEqual(said.count("ms each (cull"), 1)

    def test_eval(self):
        said = self.compare("eval")
        self.assertEqual(
            len([line for line in said.split("\n") if line.startswith("mean") or "training views" in line]),
            len({line for line in said.split("\n") if line.startswith("mean") or "training views" in line}),
        )

    # ---- Training ----

    def test_train(self):
        report = self.path("train.json")
        done = mpirun.run(
            2, [word for word in self.training("shared", "--checkpoint-every", "20", "--json", report) if word != "-q"]
        )
        self.assertEqual(done.returncode, 0, done.stderr)
        self.assertEqual(done.stdout.count("on 2 ranks of 1 thread"), 1, done.stdout)
        self.assertEqual(done.stdout.count("after 240 iterations"), 1, done.stdout)
        self.same_training("shared")
        with open(report, encoding="utf-8") as file:
            said = json.load(file)
        self.assertEqual(said["ranks"], 2)
        each = said["each_rank"]
        self.assertEqual([rank["photographs"] for rank in each], [120, 120])
        self.assertEqual(sum(rank["bytes_sent"] for rank in each), said["bytes_sent"])
        for rank in each:
            self.assertGreater(rank["bytes_sent"], rank["bytes_back"])
            self.assertGreater(rank["bytes_there"], 100000)
            self.assertGreater(rank["processor_ms"], 0)
            self.assertGreater(rank["peak_rss_bytes"], 10e6)

    def test_train_ends_by_signal(self):
        process = mpirun.start(2, self.training("asked"))
        wait_for(lambda: os.path.exists(os.path.join(self.path("asked"), "log.jsonl")))
        ranks = children_of(process.pid)
        for rank in ranks:
            os.kill(rank, signal.SIGSTOP)
        second = mpirun.run(2, self.training("asked", "--resume"))  # a second job at the same folder is refused
        for rank in ranks:
            os.kill(rank, signal.SIGCONT)
        self.assertEqual((second.returncode, second.stderr.count("pags: ")), (1, 1), second.stderr)
        self.assertIn(f"another process is writing there: pags train, process {ranks[0]} on ", second.stderr)
        os.kill(ranks[1], signal.SIGUSR2)
        err = self.ends(process)
        self.assertEqual(process.returncode, 3, err)
        self.assertEqual(err.count("pags: interrupted after iteration"), 1, err)
        self.assertIn("scene.json", self.trained("asked"))
        self.goes_on("asked", [2])

    def test_train_killed(self):
        process = mpirun.start(2, self.training("killed", "--checkpoint-every", "10"))
        wait_for(lambda: self.has_shards("killed"))
        os.kill(children_of(process.pid)[1], signal.SIGKILL)
        self.assertIn("signal 9", self.ends(process))
        self.assertTrue(self.has_shards("killed"))
        said = subprocess.run(
            [PAGS, "info", "--json", "-", os.path.join(self.path("killed"), "checkpoint.pags")],
            capture_output=True,
            text=True,
        )
        self.assertEqual(json.loads(said.stdout)["shards"], 2, said.stderr)
        self.goes_on("killed", [1, 2])

    def test_train_disk_full_on_one_rank(self):
        words = " ".join(f"'{word}'" for word in self.training("no-room", "--checkpoint-every", "5"))
        done = mpirun.run(2, ["sh", "-c", f'[ "$OMPI_COMM_WORLD_RANK" = 0 ] || {{ ulimit -f 0; }}; exec {words}'])
        self.assertEqual(done.returncode, 1)
        self.assertEqual(done.stderr.count("pags: rank 1: "), 1, done.stderr)
        self.assertEqual(done.stderr.count("rank 0: "), 0, done.stderr)
        self.assertIn("checkpoint.pags.g1.1", done.stderr)
        self.assertFalse([file for file in self.trained("no-room") if file.startswith("checkpoint")])

    def test_train_refuses(self):
        """An option that requires one process is refused with one message, before anything is written."""
        for given, said, code in (
            (["--estimate"], "pags: --estimate requires one process; it can't be shared between ranks", 1),
            (["--view"], "--view requires one process", 2),
        ):
            with self.subTest(given=given):
                done = mpirun.run(2, [word for word in self.training("refused", *given) if word != "-q"])
                self.assertEqual(done.returncode, code, done.stderr)
                self.assertEqual(done.stderr.count(said), 1, done.stderr)
                self.assertFalse(os.path.exists(self.path("refused")))

    # ---- Ends and failures ----

    def long_render(self, ranks=2, **more):
        """Starts a render that lasts for minutes. Returns when its first picture exists."""
        out = self.path("long")
        shutil.rmtree(out, ignore_errors=True)
        process = mpirun.start(
            ranks, [PAGS, "render", self.scene, "-o", out, "--frames", "100000", "--threads", "1"], **more
        )
        wait_for(lambda: os.path.isdir(out) and any(name.endswith(".png") for name in os.listdir(out)))
        return process, out

    def whole_pictures(self, out):
        """Asserts that every file with a picture's name is complete."""
        for name, data in contents(out).items():
            if name.endswith(".png"):
                self.assertEqual(data[-8:-4], b"IEND", name)

    def test_other_verbs(self):
        done = mpirun.run(2, [PAGS, "info", self.scene])
        self.assertEqual(done.returncode, 2)
        self.assertEqual(done.stderr.count("pags: 'info' runs as one process, but mpirun started 2"), 1, done.stderr)
        self.assertEqual(done.stdout.strip(), "")

    def test_wrong_usage_is_reported_once(self):
        done = mpirun.run(2, [PAGS, "render", self.scene, "--no-such-option"])
        self.assertEqual(done.returncode, 2)
        self.assertEqual(done.stderr.count("unknown option '--no-such-option'"), 1, done.stderr)

    def test_missing_scene_is_reported_once(self):
        done = mpirun.run(2, [PAGS, "eval", self.path("nowhere")])
        self.assertEqual(done.returncode, 1)
        self.assertEqual(done.stderr.count("pags: "), 1, done.stderr)
        self.assertEqual(done.stderr.count("rank 0"), 0, done.stderr)
        self.assertEqual(done.stderr.count("nowhere"), 1, done.stderr)

    def test_disk_full_on_one_rank(self):
        """A limit on file sizes simulates a full disk: rank 1 can't write a picture."""
        script = f'[ "$OMPI_COMM_WORLD_RANK" = 0 ] || {{ ulimit -f 0; }}; exec "{PAGS}" render "{self.scene}" -o "{self.path("full")}" --frames 6 --threads 1'
        done = mpirun.run(2, ["sh", "-c", script])
        self.assertEqual(done.returncode, 1)
        self.assertEqual(done.stderr.count("pags: rank 1: "), 1, done.stderr)
        self.assertIn("full/0000", done.stderr)
        self.whole_pictures(self.path("full"))

    def test_ends_by_signal(self):
        """SIGUSR1 ends the job. Either mpirun passes it on, or one rank receives it and tells the other rank."""
        for to_rank in (None, 1):
            process, out = self.long_render()
            target = process.pid if to_rank is None else children_of(process.pid)[to_rank]
            os.kill(target, signal.SIGUSR1)
            err = self.ends(process)
            self.assertEqual(process.returncode, 3, err)
            self.assertEqual(err.count("pags: interrupted after"), 1, err)
            self.whole_pictures(out)

    @unittest.skipUnless(KILLS, "make check-cluster")
    def test_killed(self):
        for i in range(KILLS):
            process, out = self.long_render(ranks=3 if i % 2 else 2)
            time.sleep(random.uniform(0, 1))
            os.kill(random.choice(children_of(process.pid)), signal.SIGKILL)
            err = self.ends(process)
            self.assertIn("signal 9", err)
            self.whole_pictures(out)

    @unittest.skipUnless(KILLS, "make check-cluster")
    def test_stopped(self):
        """A process is stopped, as if its network link were down. The other rank gives it up and reports this."""
        for rank in (0, 1):
            process, out = self.long_render(PAGS_WATCHDOG="2")
            os.kill(children_of(process.pid)[rank], signal.SIGSTOP)
            err = self.ends(process)
            self.assertIn(f"rank {rank} of 2 has been silent for 2 s", err)
            self.assertEqual(err.count("pags: "), 1, err)
            self.whole_pictures(out)


if __name__ == "__main__":
    PAGS = rank_jobs.PAGS = os.path.abspath(sys.argv.pop(1))
    unittest.main()
