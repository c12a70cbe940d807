#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""test_failures.py PAGS FAILING_MALLOC: one rank of a training under mpirun fails, is killed, stops or can't be
reached. All ranks end, and one line says why. The checkpoint is complete, and resuming it gives the bits of a run
without failures.

PAGS_KILLS is the number of random moments at which ranks are killed and allocations fail (make check-cluster: 10). If
it is set, disks fill up and links go down, too."""

import os
import random
import shutil
import signal
import subprocess
import sys
import tempfile
import time
import unittest

sys.path.insert(0, os.path.dirname(os.path.abspath(__file__)))
import mpirun
import rank_jobs
import two_machines
from rank_jobs import children_of, wait_for

KILLS = int(os.environ.get("PAGS_KILLS", "0"))
LONG = unittest.skipUnless(KILLS, "make check-cluster")


class Failures(rank_jobs.Jobs):
    def lines(self, err):
        """Returns the lines printed by the ranks, without those of mpirun."""
        return [line for line in err.split("\n") if line.startswith("pags: ")]

    def has_ended(self, done, *said):
        self.assertEqual(done.returncode, 1, done.stderr)
        lines = self.lines(done.stderr)
        self.assertEqual(len(lines), 1, done.stderr)
        for words in said:
            self.assertIn(words, lines[0])

    def seconds_alone(self):
        """Returns the seconds that a training of three undisturbed ranks takes."""
        if not hasattr(Failures, "seconds"):
            since = time.monotonic()
            done = mpirun.run(3, self.training("undisturbed", "--checkpoint-every", "5"))
            self.assertEqual(done.returncode, 0, done.stderr)
            Failures.seconds = time.monotonic() - since
            self.same_training("undisturbed")
        return Failures.seconds

    def resumes(self, name):
        done = subprocess.run(self.training(name, "--resume"), capture_output=True, text=True)
        self.assertEqual(done.returncode, 0, done.stderr)
        self.same_training(name)

    def test_removed_photograph(self):
        """Photographs are removed during the training. The rank that reads one fails in the middle of a step."""
        street = self.path("removed")
        shutil.copytree(self.street, street)
        command = [
            word if word != self.street else street
            for word in self.training("unread", "--image-cache", "1", "--iterations", "100000")
        ]
        process = mpirun.start(3, command)
        wait_for(lambda: os.path.exists(os.path.join(self.path("unread"), "log.jsonl")))
        images = os.path.join(street, "images")
        os.remove(os.path.join(images, sorted(os.listdir(images))[1]))
        err = self.ends(process)
        self.has_ended(
            subprocess.CompletedProcess(command, process.returncode, "", err), "pags: rank ", "images/", "No such file"
        )

    def refuse(self, rank, number, **more):
        return mpirun.run(
            3,
            self.training("refused", "--overwrite", "--checkpoint-every", "5"),
            LD_PRELOAD=FAILING,
            PAGS_REFUSE=str(number),
            PAGS_REFUSE_RANK=str(rank),
            **more,
        )

    def test_memory_of_one_rank(self):
        count = self.path("count")
        done = self.refuse(1, 10**9, PAGS_REFUSE_COUNT=count)
        self.assertEqual(done.returncode, 0, done.stderr)
        with open(count, encoding="ascii") as file:
            most = int(file.read())
        self.assertGreater(most, 1000)
        failed = 0
        for i in range(max(KILLS, 1)):
            rank, number = (i + 1) % 3, random.randint(most // 4, most)
            done = self.refuse(rank, number)
            with self.subTest(rank=rank, number=number):
                if done.returncode == 0:  # the training didn't need this allocation
                    self.same_training("refused")
                    continue
                failed += 1
                self.has_ended(done, "memory")
                self.assertIn(f"rank {rank}: ", done.stderr)
                self.resumes("refused")
        self.assertTrue(failed or KILLS < 2)

    @LONG
    def test_killed(self):
        """A rank is killed at any moment, before or after the first checkpoint."""
        seconds = self.seconds_alone()
        killed = begun = 0
        while killed < KILLS:
            name, after, rank = f"killed{begun}", random.uniform(0, seconds), random.randrange(3)
            begun += 1  # a run that ended before it could be killed keeps its folder
            process = mpirun.start(3, self.training(name, "--checkpoint-every", "5"))
            time.sleep(after)
            ranks = children_of(process.pid)
            if len(ranks) == 3:
                os.kill(ranks[rank], signal.SIGKILL)
            out, err = process.communicate(timeout=60)
            with self.subTest(after=after, rank=rank):
                if process.returncode:
                    self.assertIn("signal 9", err)
                    killed += 1
                    print(f"rank {rank} killed after {after:.2f} s: {self.shards(name)}", flush=True)
                self.resumes(name)

    def shards(self, name):
        found = (
            sorted(file for file in self.trained(name) if file.startswith("checkpoint"))
            if os.path.isdir(self.path(name))
            else []
        )
        return ", ".join(found) or "no checkpoint yet"

    @LONG
    def test_stopped(self):
        """A process is stopped. The other ranks give it up and report this."""
        for rank in range(3):
            name = f"stopped{rank}"
            process = mpirun.start(3, self.training(name, "--checkpoint-every", "5"), PAGS_WATCHDOG="2")
            wait_for(lambda: self.has_shards(name))
            os.kill(children_of(process.pid)[rank], signal.SIGSTOP)
            err = self.ends(process)
            self.assertEqual(len(self.lines(err)), 1, err)
            self.assertIn(f"pags: rank {rank} of 3 has been silent for 2 s", err)
            self.resumes(name)

    @LONG
    def test_full_disk(self):
        """The disk has room for one checkpoint of three shards (the first includes the sky), but not for two."""
        self.seconds_alone()
        size = os.path.getsize(os.path.join(self.path("alone"), "checkpoint.pags")) // 1024
        disk = tempfile.mkdtemp(prefix="pags-disk-")
        self.addCleanup(os.rmdir, disk)
        mounted = subprocess.run(
            ["mount", "-t", "tmpfs", "-o", f"size={3 * size // 2}k", "tmpfs", disk], capture_output=True, text=True
        )
        if mounted.returncode:
            self.skipTest(f"no small disk can be mounted here (root can): {mounted.stderr.strip()}")
        self.addCleanup(subprocess.run, ["umount", disk], check=False)
        name = os.path.join(disk, "scene")
        done = mpirun.run(3, self.training(name, "--checkpoint-every", "5"))
        self.has_ended(done, "rank ", disk, "No space left")
        self.assertTrue(self.has_shards(name))
        self.assertFalse([file for file in self.trained(name) if file.endswith(".part")])
        subprocess.run(["mount", "-o", f"remount,size={8 * size}k", disk], check=True)
        self.resumes(name)

    @LONG
    def test_link_goes_down(self):
        if not two_machines.can_be_made():
            self.skipTest("network namespaces can't be made here (root can, with iproute2)")
        machines = two_machines.Machines(self.root)
        self.addCleanup(machines.remove)
        said = self.path("said")
        with open(said, "w", encoding="utf-8") as file:
            command = [*machines.mpirun(), "-x", "PAGS_WATCHDOG", *self.training("parted", "--checkpoint-every", "5")]
            process = subprocess.Popen(
                command, stdin=subprocess.DEVNULL, stdout=file, stderr=file, env=mpirun.environment(PAGS_WATCHDOG="3")
            )
        wait_for(lambda: self.has_shards("parted"))
        self.assertEqual(list(machines.processes().values()).count("pags"), 2)
        since = time.monotonic()
        machines.cut()
        wait_for(lambda: "pags" not in machines.processes().values())
        print(
            f"both ended {time.monotonic() - since:.1f} s after the link went down; {self.shards('parted')}", flush=True
        )
        machines.remove()  # mpirun waits for the other machine until TCP gives up the connection
        self.assertNotEqual(process.wait(timeout=60), 0)
        with open(said, encoding="utf-8") as file:
            self.assertIn("pags: rank 1 of 2 has been silent for 3 s", file.read())
        self.resumes("parted")


if __name__ == "__main__":
    FAILING = os.path.abspath(sys.argv.pop(2))
    rank_jobs.PAGS = os.path.abspath(sys.argv.pop(1))
    unittest.main()
