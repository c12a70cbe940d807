# SPDX-License-Identifier: Apache-2.0
"""Tests faults around the program: it is killed, disks are full or read-only, files change while in use, memory is
short.

The test is short by default. PAGS_FAULTS=100 kills training, import and export at 100 moments each
(docs/reliability.md)."""

import json
import os
import random
import re
import resource
import shutil
import signal
import subprocess
import sys
import time
import unittest

HERE = os.path.dirname(os.path.abspath(__file__))
sys.path.insert(0, os.path.join(HERE, "..", "cli"))

import fixtures  # noqa: E402
from fixtures import Case, files_below, make_dataset, ply_bytes, read, splat, write  # noqa: E402
from test_import import make_tree  # noqa: E402

MOMENTS = int(os.environ.get("PAGS_FAULTS", "3"))
SMALL = [
    "--random-points",
    "500",
    "--max-gaussians",
    "1500",
    "--checkpoint-every",
    "20",
    "--preview-every",
    "40",
    "--log-every",
    "10",
]
ITERATIONS = 150
LIMITS = max(6, min(MOMENTS, 60))  # number of memory limits tried between too little and enough
SANITIZED = os.environ.get("PAGS_SANITIZED", "") not in ("", "OFF")


def contents(folder):
    """Returns the files of a folder with their bytes, without the lock that a killed process leaves."""
    return {name: read(os.path.join(folder, name)) for name in files_below(folder) if not name.endswith(".pags.lock")}


def many_splats(count):
    dice = random.Random(5)
    rows = [
        splat(*[dice.uniform(-2, 2) for _ in range(3)], [dice.random() for _ in range(3)], 0.02) for _ in range(count)
    ]
    return ply_bytes(rows)


def catches(pid, number):
    """Tells whether the process has installed its handler of the signal. This takes a while on a slow machine or with a
    sanitizer."""
    try:
        caught = re.search(rb"SigCgt:\s*([0-9a-f]+)", read(f"/proc/{pid}/status"))
    except FileNotFoundError:
        return False
    return caught and int(caught[1], 16) >> (number - 1) & 1


class Faults(Case):
    """Base class with a data set and the files of an undisturbed training on it."""

    @classmethod
    def setUpClass(cls):
        cls.shared = cls.shared_folder()
        cls.data = make_dataset(os.path.join(cls.shared, "data"), views=9)

    def train_command(self, out, *more, data=None):
        return ["train", data or self.data, "-o", out, "-n", str(ITERATIONS), "-j", "2", "-q", *SMALL, *more]

    def undisturbed(self):
        """Returns the files of an undisturbed training and stores its seconds. Trains once for each class, since a
        scene names its data set."""
        own = type(self)
        if "whole" not in own.__dict__:
            out, begin = os.path.join(self.shared, "alone"), time.monotonic()
            self.succeeds(*self.train_command(out))
            own.seconds = time.monotonic() - begin
            own.whole = {
                name: data for name, data in contents(out).items() if name not in ("report.json", "report.html")
            }
        return own.whole

    def assert_trained(self, out):
        found = {name: data for name, data in contents(out).items() if name not in ("report.json", "report.html")}
        self.assertEqual(sorted(found), sorted(self.undisturbed()))
        for name, data in found.items():
            self.assertTrue(data == self.whole[name], f"{name} is another one")

    def start(self, *arguments, **more):
        command = [fixtures.PAGS, *map(str, arguments)]
        return subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True, **more)

    def kill_at(self, running, seconds):
        """Waits for a number of seconds, then kills the command. Returns False if the command has ended before."""
        try:
            running.wait(timeout=seconds)
            _, errors = running.communicate()
            self.assertEqual(running.returncode, 0, errors)
            return False
        except subprocess.TimeoutExpired:
            running.kill()
            running.communicate()
            return True

    def fails_somehow(self, done, *words):
        """Asserts that the program ended regularly with exit code 1 and a last line on stderr that holds `words`.
        Returns this line."""
        self.assertEqual(done.returncode, 1, f"{done.args}: {done.returncode} {done.stderr[-2000:]}")
        lines = [line for line in done.stderr.splitlines() if line.startswith("pags: ")]
        self.assertTrue(lines, done.stderr)
        for word in words:
            self.assertIn(word, lines[-1])
        return lines[-1]


class Kills(Faults):
    def test_training(self):
        self.undisturbed()
        dice, kills, round_number = random.Random(1), 0, 0
        while kills < MOMENTS:
            round_number += 1
            out = self.path(f"scene{round_number}")
            while kills < MOMENTS and self.kill_at(
                self.start(*self.train_command(out, "--resume")), dice.uniform(0.02, 0.7 * self.seconds)
            ):
                kills += 1
                self.check_scene(out)
            self.succeeds(*self.train_command(out, "--resume"))
            self.assert_trained(out)
            self.assertLess(round_number, 20 + 5 * MOMENTS)
        print(f"training: killed {kills} times in {round_number} runs, the same bits in the end")

    def check_scene(self, out):
        """Asserts that every output file that has its final name is complete."""
        if os.path.exists(os.path.join(out, "scene.json")):
            self.succeeds("info", out)
        for name in files_below(out) if os.path.isdir(out) else []:
            if name.endswith((".ply", ".pags")):
                self.succeeds("info", os.path.join(out, name))
            elif name.endswith(".png"):
                fixtures.read_png(os.path.join(out, name))

    def test_import(self):
        raw, whole = make_tree(self.path("raw"), 60), self.path("whole")
        begin = time.monotonic()
        self.succeeds("import", "kitti", raw, "-o", whole)
        seconds, expected = time.monotonic() - begin, contents(whole)
        dice, kills, rounds = random.Random(2), 0, 0
        while kills < MOMENTS:
            rounds += 1
            out = self.path(f"out{rounds}")
            while kills < MOMENTS and self.kill_at(
                self.start("import", "kitti", raw, "-o", out), dice.uniform(0, seconds)
            ):
                kills += 1
                for name, data in contents(out).items() if os.path.isdir(out) else []:
                    if not name.endswith(".part") and name != "import.json":
                        self.assertTrue(data == expected[name], f"{name} is torn")
            self.succeeds("import", "kitti", raw, "-o", out)
            self.assert_imported(contents(out), expected)
            shutil.rmtree(out)
            self.assertLess(rounds, 20 + 5 * MOMENTS)
        print(f"import: killed {kills} times in {rounds} runs, the same files in the end")

    def assert_imported(self, found, expected):
        self.assertEqual(sorted(found), sorted(expected))
        for name, data in found.items():
            self.assertTrue(data == expected[name], f"{name} is another one")

    def test_export(self):
        scene = self.write("scene.ply", many_splats(30000))
        kills = 0
        for name in ["out.ply", "out.spz", "out.glb", "out.pagsz"]:
            dice, whole, target = random.Random(3), self.path("whole-" + name), self.path(name)
            options = ["--splats"] if name.endswith(".glb") else []
            begin = time.monotonic()
            self.succeeds("export", scene, whole, *options)
            seconds, expected, tries = time.monotonic() - begin, read(whole), 0
            for _ in range((MOMENTS + 3) // 4):
                self.write(name, "what was there before")
                kills += self.kill_at(self.start("export", scene, target, *options), dice.uniform(0, seconds))
                self.assertIn(read(target), [b"what was there before", expected])
                tries += 1
            self.succeeds("export", scene, target, *options)
            self.assertEqual(read(target), expected)
        print(f"export: killed {kills} times, the old file or the whole new one each time")


class Signals(Faults):
    """SIGTERM ends the program regularly (exit code 3 and a message how to resume). A second Ctrl-C ends it at once. No
    output is partial. test_train.py has the tests of training."""

    def check(self, arguments, check_files):
        for second in [False, True]:
            running = self.start(*arguments)
            while running.poll() is None and not catches(running.pid, signal.SIGTERM):
                time.sleep(0.01)
            time.sleep(0.3)
            running.send_signal(signal.SIGINT if second else signal.SIGTERM)
            if second:
                running.send_signal(signal.SIGINT)
            _, errors = running.communicate(timeout=120)
            self.assertIn(running.returncode, (0, 3, 130) if second else (0, 3), errors)
            check_files()

    def test_import(self):
        raw, whole, out = make_tree(self.path("raw"), 200), self.path("whole"), self.path("out")
        self.succeeds("import", "kitti", raw, "-o", whole)
        expected = contents(whole)

        def check_files():
            for name, data in contents(out).items() if os.path.isdir(out) else []:
                if not name.endswith(".part") and name != "import.json":
                    self.assertTrue(data == expected[name], f"{name} is torn")

        self.check(["import", "kitti", raw, "-o", out], check_files)

    def test_render_and_export(self):
        scene, out = self.write("scene.ply", many_splats(20000)), self.path("out")

        def check_pictures():
            for name in files_below(out) if os.path.isdir(out) else []:
                if name.endswith(".png"):
                    fixtures.read_png(os.path.join(out, name))

        self.check(["render", scene, "--path", "orbit", "-n", 60, "-o", out], check_pictures)
        target = self.path("a.glb")
        self.check(
            ["export", scene, target, "--splats"], lambda: os.path.exists(target) and read(target)[:4] == b"glTF"
        )


class Disks(Faults):
    """Tests small and read-only file systems. Mounting them requires root."""

    def mount(self, size):
        folder = self.path("disk")
        os.makedirs(folder)
        done = subprocess.run(
            ["mount", "-t", "tmpfs", "-o", f"size={size}k", "tmpfs", folder],
            capture_output=True,
            text=True,
            check=False,
        )
        if done.returncode != 0:
            print(f"skipped: no small disk can be mounted here (root can): {done.stderr.strip()}")
            self.skipTest("mount")
        self.addCleanup(subprocess.run, ["umount", folder], check=False)
        return folder

    def remount(self, folder, options):
        subprocess.run(["mount", "-o", f"remount,{options}", folder], check=True)

    def assert_no_torn(self, folder):
        for name in files_below(folder):
            self.assertFalse(name.endswith(".part"), name)
            if name.endswith((".ply", ".pags")):
                self.succeeds("info", os.path.join(folder, name))

    def test_full_while_training(self):
        whole = self.undisturbed()
        need = sum(len(data) + 4096 for data in whole.values()) // 1024
        disk = self.mount(need // 3)
        out = os.path.join(disk, "scene")
        self.fails_somehow(fixtures.run(*self.train_command(out)), "No space left", out)
        self.assert_no_torn(disk)
        self.remount(disk, f"size={4 * need}k")
        self.succeeds(*self.train_command(out, "--resume"))
        self.assert_trained(out)

    def test_full_while_importing_rendering_and_exporting(self):
        raw, disk = make_tree(self.path("raw"), 30), self.mount(64)
        scene = self.write("scene.ply", many_splats(3000))
        self.fails_somehow(fixtures.run("import", "kitti", raw, "-o", os.path.join(disk, "data")), "No space left")
        shutil.rmtree(os.path.join(disk, "data"))
        for name in ["a.ply", "a.spz", "a.splat", "a.pagsz", "a.glb"]:
            options = ["--splats"] if name == "a.glb" else []
            write(os.path.join(disk, "fill"), bytes(60 * 1024))
            self.fails_somehow(fixtures.run("export", scene, os.path.join(disk, name), *options), "No space left", name)
            self.assertEqual(files_below(disk), ["fill"])
        self.fails_somehow(
            fixtures.run("render", scene, "--path", "orbit", "-n", 2, "-o", os.path.join(disk, "out")), "out"
        )
        self.assertEqual(files_below(disk), ["fill"])

    def test_read_only(self):
        raw, disk = make_tree(self.path("raw"), 3), self.mount(256)
        scene = self.write("scene.ply", many_splats(30))
        self.remount(disk, "ro")
        for arguments in [
            ["export", scene, os.path.join(disk, "a.ply")],
            ["import", "kitti", raw, "-o", os.path.join(disk, "data")],
            ["render", scene, "--path", "orbit", "-n", 1, "-o", os.path.join(disk, "out")],
            self.train_command(os.path.join(disk, "scene")),
        ]:
            self.fails_somehow(fixtures.run(*arguments), disk)

    def test_limit_on_files(self):
        """A limit of 20 kB on file sizes simulates a full disk without root."""
        scene, target = self.write("scene.ply", many_splats(3000)), self.path("a.ply")

        done = fixtures.run(
            "export", scene, target, preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_FSIZE, (20000, 20000))
        )
        self.fails_somehow(done, "a.ply", "File too large")
        self.assertFalse([name for name in files_below(self.folder) if name.startswith("a.ply")])


class Changes(Faults):
    """Tests files that are removed or changed while they are in use."""

    def begin_training(self, data):
        out = self.path("scene")
        running = self.start(*self.train_command(out, "--image-cache", "1", data=data), "-n", "100000")
        log = os.path.join(out, "log.jsonl")
        for _ in range(1200):
            if running.poll() is not None or (os.path.exists(log) and os.path.getsize(log)):
                break
            time.sleep(0.05)
        return running, out

    def ends_with(self, running, *words):
        try:
            _, errors = running.communicate(timeout=120)
        finally:
            running.kill()
        self.assertEqual(running.returncode, 1, errors)
        for word in words:
            self.assertIn(word, errors)

    def test_photographs(self):
        for how in ["removed", "cut", "another size"]:
            data = make_dataset(self.path("data"), views=5)
            running, out = self.begin_training(data)
            self.assertIsNone(running.poll(), "ended before")
            for i in range(5):
                path = os.path.join(data, f"images/{i:03d}.png")
                if how == "removed":
                    os.remove(path)
                elif how == "cut":
                    os.truncate(path, 200)
                else:
                    write(path, fixtures.png_bytes(8, 8, bytes(192)))
            self.ends_with(running, "images/0")
            for folder in (data, out):
                shutil.rmtree(folder, ignore_errors=True)

    def test_output(self):
        running, out = self.begin_training(make_dataset(self.path("data"), views=5))
        gone = self.path("gone")  # the folder vanishes in one step, as files come and go while a folder is removed
        os.rename(out, gone)
        shutil.rmtree(gone, ignore_errors=True)
        self.ends_with(running, out)

    def test_packed_scene_is_cut(self):
        """A packed scene is a mapped file. If it is truncated while in use, rendering fails with a message."""
        scene, packed = self.write("scene.ply", many_splats(20000)), self.path("a.pagsz")
        self.succeeds("export", scene, packed)
        out = self.path("out")
        running = self.start("render", packed, "--path", "orbit", "-n", 2000, "-o", out)
        for _ in range(1200):
            if running.poll() is not None or (os.path.isdir(out) and len(os.listdir(out)) > 2):
                break
            time.sleep(0.02)
        os.truncate(packed, 4096)
        self.ends_with(running, ".pagsz")

    def test_source_of_an_import(self):
        raw, out = make_tree(self.path("raw"), 400), self.path("out")
        running = self.start("import", "kitti", raw, "-o", out)
        for _ in range(5000):
            if running.poll() is not None or os.path.exists(os.path.join(out, "images/003_0.png")):
                break
            time.sleep(0.001)
        for t in range(399, 300, -1):
            os.remove(os.path.join(raw, f"image_02/0000/{t:06d}.png"))
        self.ends_with(running, "image_02/0000/000")
        self.assertFalse(os.path.exists(os.path.join(out, "dataset.json")))


@unittest.skipIf(SANITIZED, "sanitizers reserve terabytes")
class Memory(Faults):
    """Limits the memory (ulimit -v). If the limit suffices to start but not to finish, the program ends regularly and
    reports out of memory."""

    def limited(self, megabytes, *arguments):
        size = int(megabytes * 2**20)
        return fixtures.run(*arguments, preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_AS, (size, size)))

    def check(self, *arguments):
        """Finds a sufficient memory limit, then tries limits below it."""
        enough = 64
        while (done := self.limited(enough, *arguments)).returncode != 0:
            self.assertLess(enough, 16384, done.stderr)
            enough *= 1.5
        said = 0
        for share in [0.4 + 0.6 * i / LIMITS for i in range(LIMITS)]:
            done = self.limited(share * enough, *arguments)
            if (
                done.returncode == 127 and "shared libraries" in done.stderr
            ):  # the dynamic loader failed before the program began
                continue
            if done.returncode == 0:
                continue
            self.fails_somehow(done)
            said += "memory" in done.stderr or "thread" in done.stderr or "alloc" in done.stderr
        self.assertGreater(said, 0)

    def test_train(self):
        out = self.path("scene")
        self.check(
            "train",
            self.data,
            "-o",
            out,
            "-n",
            "2",
            "-j",
            "2",
            "-q",
            "--random-points",
            "10000",
            "--overwrite",
            "--split-every",
            "0",
        )

    def test_render(self):
        scene = self.write("scene.ply", many_splats(60000))
        camera = {"width": 1600, "height": 1200, "fx": 1200, "fy": 1200, "cx": 800, "cy": 600}
        camera.update(camera_from_world_quaternion_wxyz=[1, 0, 0, 0], camera_from_world_translation=[0, 0, 6])
        self.write("camera.json", json.dumps(camera))
        self.check("render", scene, "--camera", self.path("camera.json"), "-j", "2", "-o", self.path("out"))

    def test_module(self):
        module = os.environ.get("PAGS_MODULE", "")
        if not module or not os.path.isdir(module):
            print("skipped: needs the Python module (PAGS_MODULE)")
            self.skipTest("module")
        scene = self.write("scene.ply", many_splats(60000))
        program = os.path.join(HERE, "memory_of_module.py")
        done = subprocess.run(
            [sys.executable, "-B", program, module, scene], capture_output=True, text=True, timeout=300, check=False
        )
        self.assertEqual(done.returncode, 0, done.stdout + done.stderr)
        self.assertIn("MemoryError", done.stdout)


if __name__ == "__main__":
    fixtures.main()
