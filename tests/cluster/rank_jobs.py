# SPDX-License-Identifier: Apache-2.0
"""Helpers of the tests of jobs with several ranks: a small street, its training, and functions that watch and end such
a job."""

import os
import shutil
import subprocess
import tempfile
import time
import unittest

import mpirun

PAGS = ""  # path of the program; the main function of each test sets it


def contents(folder):
    """Returns {path: bytes} of all files in the folder and its subfolders."""
    found = {}
    for base, _, names in os.walk(folder):
        for name in names:
            with open(os.path.join(base, name), "rb") as file:
                found[os.path.relpath(os.path.join(base, name), folder)] = file.read()
    return found


def children_of(pid):
    """Returns the ids of the pags processes of an mpirun, in the order of their start."""
    found = []
    for name in os.listdir("/proc"):
        try:
            with open(f"/proc/{name}/stat", encoding="ascii", errors="replace") as file:
                head, tail = file.read().rsplit(")", 1)
            if name.isdigit() and int(tail.split()[1]) == pid and head.endswith("(pags"):
                found.append(int(name))
        except OSError:
            pass
    return sorted(found)


def wait_for(condition, seconds=60):
    end = time.monotonic() + seconds
    while not condition():
        if time.monotonic() > end:
            raise AssertionError("it doesn't happen")
        time.sleep(0.02)


class Jobs(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.root = tempfile.mkdtemp(prefix="pags-ranks-")
        cls.street = os.path.join(cls.root, "street")
        cls.make(
            [
                "synth",
                "street",
                "-q",
                "-o",
                cls.street,
                "--size",
                "128x72",
                "--frames",
                "7",
                "--cameras",
                "1",
                "--no-shifts",
            ]
        )

    @classmethod
    def tearDownClass(cls):
        shutil.rmtree(cls.root)

    @staticmethod
    def make(arguments):
        done = subprocess.run([PAGS, *arguments], capture_output=True, text=True)
        assert done.returncode == 0, done.stderr

    def path(self, name):
        return os.path.join(self.root, name)

    SHORT = [
        "--iterations",
        "240",
        "--batch",
        "4",
        "--max-gaussians",
        "4500",
        "--log-every",
        "1",
        "--set",
        "resolution_floor=24",
        "--set",
        "fourier_gain=0",
        "--threads",
        "1",
        "-q",
    ]

    def training(self, name, *more):
        return [PAGS, "train", self.street, "-o", self.path(name), *self.SHORT, *more]

    def trained(self, name):
        """Returns all files of a scene's folder except those that hold times and the command line."""
        return {
            file: data for file, data in contents(self.path(name)).items() if file not in ("report.json", "report.html")
        }

    def same_training(self, name):
        """Asserts that the folder equals that of a training by one process, which runs once."""
        if not os.path.exists(self.path("alone")):
            done = subprocess.run(self.training("alone"), capture_output=True, text=True)
            self.assertEqual(done.returncode, 0, done.stderr)
            log = self.trained("alone")["log.jsonl"].decode()
            self.assertGreater(log.count('"split"'), 3)
            self.assertGreater(log.count('"pruned_by_score"'), 1)
        alone, shared = self.trained("alone"), self.trained(name)
        self.assertEqual(sorted(alone), sorted(shared))
        for file, data in alone.items():
            self.assertTrue(data == shared[file], f"{name}/{file}")

    def goes_on(self, name, numbers):
        """Resumes a run that ended early with each number of ranks (1: a single process). Asserts that the bits are
        those of an uninterrupted run."""
        for ranks in numbers:
            copy = f"{name}-{ranks}"
            shutil.copytree(self.path(name), self.path(copy))
            command = self.training(copy, "--resume")
            done = mpirun.run(2, command) if ranks == 2 else subprocess.run(command, capture_output=True, text=True)
            self.assertEqual(done.returncode, 0, done.stderr)
            self.same_training(copy)

    def has_shards(self, name):
        try:
            with open(os.path.join(self.path(name), "checkpoint.pags"), "rb") as file:
                return file.read(1) == b"{"
        except OSError:
            return False

    def ends(self, process):
        try:
            out, err = process.communicate(timeout=60)
        except subprocess.TimeoutExpired:
            process.kill()
            raise
        self.assertNotEqual(process.returncode, 0, out + err)
        return err
