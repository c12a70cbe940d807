# SPDX-License-Identifier: Apache-2.0
"""Tests two processes at one folder, the signals that ask a process to end, and files that grow too large."""

import os
import pty
import resource
import select
import shutil
import signal
import subprocess
import time
import unittest

import fixtures
from fixtures import SMALL, DataCase, files_below, ply_bytes, read, some_splats, write
from test_import import make_tree

LOCK = ".pags.lock"


def catches(pid, number):
    """Tells whether the process has installed its handler of the signal (Linux only)."""
    try:
        caught = [line for line in read(f"/proc/{pid}/status").splitlines() if line.startswith(b"SigCgt:")]
    except FileNotFoundError:
        return False
    return bool(caught) and int(caught[0].split()[1], 16) >> (number - 1) & 1


class Processes(DataCase):
    def start(self, *arguments, **more):
        command = [fixtures.PAGS, *[str(word) for word in arguments]]
        running = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True, **more)
        self.addCleanup(lambda: running.returncode is None and (running.kill(), running.communicate()))
        return running

    def start_training(self, out, *more, wait=True, **options):
        running = self.start(
            "train",
            self.data,
            "-o",
            out,
            "-n",
            1000000,
            "-j",
            1,
            "--log-every",
            10,
            "--checkpoint-every",
            50,
            "--preview-every",
            0,
            *SMALL,
            *more,
            **options,
        )
        log, deadline = os.path.join(out, "log.jsonl"), time.monotonic() + 60
        while wait and running.poll() is None and not (os.path.exists(log) and os.path.getsize(log)):
            self.assertLess(time.monotonic(), deadline)
            time.sleep(0.02)
        return running

    def wait_for_handler(self, running):
        deadline = time.monotonic() + 60
        while running.poll() is None and not catches(running.pid, signal.SIGTERM):
            self.assertLess(time.monotonic(), deadline)
            time.sleep(0.001)

    def ends(self, running, code, *words):
        _, errors = running.communicate(timeout=60)
        self.assertEqual(running.returncode, code, errors)
        for word in words:
            self.assertIn(word, errors)


class Locks(Processes):
    def refused(self, holder, *arguments):
        self.fails([*arguments, "-q"], "another process is writing", f"process {holder.pid} on ", ", since 2")

    def test_two_at_one_folder(self):
        """Commands that write to the folder of a running training are refused and change nothing. Commands that only
        read succeed. The lock of a killed training has no effect."""
        out, splats = self.path("scene"), self.write("a.ply", ply_bytes(some_splats()))
        raw = make_tree(self.path("raw"), 3)
        running = self.start_training(out)
        deadline = time.monotonic() + 60
        while not os.path.exists(os.path.join(out, "checkpoint.pags")):
            self.assertLess(time.monotonic(), deadline)
            time.sleep(0.02)
        copy, link = self.path("copy"), self.path("link")
        shutil.copytree(out, copy)  # copies the lock, too
        os.symlink("scene", link)
        for words in (
            ["train", self.data, "-o", link + "/", "-n", 20, "--overwrite", *SMALL],
            ["import", "kitti", raw, "-o", out, "--overwrite"],
            ["render", splats, "--path", "orbit", "-n", 1, "-o", out],
            ["export", splats, os.path.join(out, "x.ply")],
        ):
            self.refused(running, *words)
        self.assertFalse([name for name in os.listdir(out) if name[0] not in ".cls"], os.listdir(out))
        self.succeeds("info", os.path.join(out, "checkpoint.pags"))
        self.succeeds("render", splats, "--path", "orbit", "-n", 1, "-o", os.path.join(out, "orbit"))
        running.kill()
        running.communicate()
        self.assertIn(LOCK, os.listdir(out))
        for folder in (out, copy):
            running = self.start(
                "train", self.data, "-o", folder, "-n", 1000000, "-j", 1, "--preview-every", 0, *SMALL, "--resume"
            )
            self.wait_for_handler(running)
            running.terminate()
            self.ends(running, 3)
            self.assertNotIn(LOCK, os.listdir(folder))
        self.succeeds("export", out, os.path.join(out, "x.ply"))
        self.succeeds("eval", out, "--images", self.path("images"))
        self.assertFalse([name for name in files_below(self.folder) if name.endswith(LOCK)])

    def test_four_trainings_started_at_once(self):
        out = self.path("scene")
        together = [self.start_training(out, wait=False) for _ in range(4)]
        deadline = time.monotonic() + 60
        while sum(running.poll() is None for running in together) > 1:
            self.assertLess(time.monotonic(), deadline)
            time.sleep(0.02)
        (first,) = [running for running in together if running.poll() is None]
        for running in together:
            if running is not first:
                self.ends(running, 1, f"pags train, process {first.pid} on ")
        first.terminate()
        self.ends(first, 3)

    def test_two_exports_of_one_file(self):
        scene = self.write("scene.ply", ply_bytes(some_splats() * 2000))
        out = self.path("a.gltf")
        both = [self.start("export", scene, out, "--splats", *more) for more in ([], ["--sh-degree", "0"])]
        codes = [(running.communicate(timeout=60), running.returncode)[1] for running in both]
        self.assertIn(sorted(codes), [[0, 0], [0, 1]])  # the first export may end before the second begins
        self.succeeds("info", out)
        self.assertEqual(sorted(name for name in files_below(self.folder) if name != "scene.ply"), ["a.bin", "a.gltf"])

    def test_created_parent_folders_are_removed(self):
        self.fails(["merge", self.data, "-o", self.path("new", "folder"), "-q"], "split.json")
        self.assertEqual(os.listdir(self.folder), [])

    def test_lock_of_another_user(self):
        """A killed process of another user has left its lock, which this user may not write to."""
        if os.getuid():
            self.skipTest("needs another user, which root can be")
        out = self.path("scene")
        write(os.path.join(out, LOCK), b"pags train, process 1 on elsewhere\n")
        os.chmod(self.folder, 0o777)
        os.chmod(out, 0o777)
        os.chmod(os.path.join(out, LOCK), 0o444)
        scene = self.write("scene.ply", ply_bytes(some_splats()))
        program = os.path.join(self.folder, "pags")
        shutil.copy(fixtures.PAGS, program)
        command = [program, "render", scene, "--path", "orbit", "-n", "1", "-o", out, "-q"]
        done = subprocess.run(command, capture_output=True, text=True, user=65534, group=65534, timeout=60)
        self.assertEqual((done.returncode, done.stderr), (0, ""))
        self.assertNotIn(LOCK, os.listdir(out))


class Signals(Processes):
    @unittest.skipUnless(hasattr(signal, "SIGXCPU"), "Windows has no such signals")
    def test_signals_that_end_a_training(self):
        for number in (signal.SIGHUP, signal.SIGUSR2, signal.SIGXCPU):
            with self.subTest(number.name):
                out = self.path(number.name)
                running = self.start_training(out, "-q")
                running.send_signal(number)
                self.ends(running, 3, "--resume continues")
                self.assertLessEqual({"checkpoint.pags", "scene.json"}, set(os.listdir(out)))
                self.assertNotIn(LOCK, os.listdir(out))

    def test_signal_during_an_import(self):
        raw, whole = make_tree(self.path("raw"), 60), self.path("whole")
        running = self.start("import", "kitti", raw, "-o", whole, "-q")
        self.wait_for_handler(running)
        running.send_signal(signal.SIGHUP)
        running.communicate(timeout=60)
        self.assertIn(running.returncode, (0, 3))
        self.succeeds("import", "kitti", raw, "-o", whole)

    def test_signal_during_an_export(self):
        """An interrupted export leaves nothing behind, in any format."""
        scene = self.write("scene.ply", ply_bytes(some_splats() * 5000))
        for name in ("a.ply", "a.spz", "a.pagsz", "a.gltf"):
            running = self.start("export", scene, self.path(name), *(["--splats"] if name == "a.gltf" else []), "-q")
            self.wait_for_handler(running)
            running.send_signal(signal.SIGUSR2)
            self.ends(running, 3, "interrupted")
            self.assertEqual(os.listdir(self.folder), ["scene.ply"])

    def test_nohup(self):
        out = self.path("scene")
        running = self.start_training(out, "-q", preexec_fn=lambda: signal.signal(signal.SIGHUP, signal.SIG_IGN))
        running.send_signal(signal.SIGHUP)
        time.sleep(0.2)
        self.assertIsNone(running.poll())
        running.send_signal(signal.SIGTERM)
        self.ends(running, 3)

    def test_interrupt_delivered_twice(self):
        """A terminal and mpirun may both send SIGINT for one key press. Two signals within 0.3 s count as one."""
        running = self.start_training(self.path("scene"), "-q")
        running.send_signal(signal.SIGINT)
        time.sleep(0.02)
        running.send_signal(signal.SIGINT)
        self.ends(running, 3, "the state is saved")

    def test_two_interrupts(self):
        """A later second interrupt ends the training at once. Whether the state was saved or not, the next command
        succeeds."""
        out = self.path("scene")
        running = self.start_training(out, "-q")
        running.send_signal(signal.SIGINT)
        time.sleep(0.32)
        running.send_signal(signal.SIGINT)
        running.communicate(timeout=60)
        self.assertIn(running.returncode, (3, 130))
        self.succeeds("train", self.data, "-o", out, "-n", 5, "-q", "--overwrite", *SMALL)

    def in_a_terminal(self, out):
        """Starts a training in a new terminal. When the training has begun, returns its process id and the terminal's
        other end."""
        pid, terminal = pty.fork()
        if pid == 0:
            signal.pthread_sigmask(signal.SIG_SETMASK, [])
            os.execv(
                fixtures.PAGS,
                [
                    fixtures.PAGS,
                    "train",
                    self.data,
                    "-o",
                    out,
                    "-n",
                    "1000000",
                    "-j",
                    "1",
                    "--log-every",
                    "10",
                    "--preview-every",
                    "0",
                    *SMALL,
                ],
            )
        self.addCleanup(os.close, terminal)
        log, deadline = os.path.join(out, "log.jsonl"), time.monotonic() + 60
        while not (os.path.exists(log) and os.path.getsize(log)):
            self.assertLess(time.monotonic(), deadline)
            self.read_terminal(terminal)
        return pid, terminal

    def read_terminal(self, terminal):
        try:
            return os.read(terminal, 65536) if select.select([terminal], [], [], 0.02)[0] else b""
        except OSError:  # the process has ended
            return b""

    def test_ctrl_c_in_a_terminal(self):
        """Ctrl-C is typed twice within 0.05 s and counts as one."""
        pid, terminal = self.in_a_terminal(self.path("scene"))
        os.write(terminal, b"\x03")
        time.sleep(0.05)
        os.write(terminal, b"\x03")
        said, ended, deadline = b"", 0, time.monotonic() + 60
        while not ended:
            self.assertLess(time.monotonic(), deadline)
            said += self.read_terminal(terminal)
            ended, how = os.waitpid(pid, os.WNOHANG)
        self.assertEqual(os.waitstatus_to_exitcode(how), 3, said)
        self.assertIn(b"the state is saved", said + self.read_terminal(terminal))

    def test_the_terminal_is_closed(self):
        """The terminal is closed. The training gets SIGHUP and can't print any more, but saves its state."""
        out = self.path("scene")
        pid, terminal = self.in_a_terminal(out)
        os.dup2(os.open(os.devnull, os.O_RDWR), terminal)  # closes the terminal
        self.assertEqual(os.waitstatus_to_exitcode(os.waitpid(pid, 0)[1]), 3)
        self.assertLessEqual({"checkpoint.pags", "scene.json"}, set(os.listdir(out)))

    def test_limit_on_files(self):
        """A limit on file sizes (ulimit -f) makes the write fail with the file's name. Nothing else is prepared for the
        program."""

        def limit():
            signal.signal(signal.SIGXFSZ, signal.SIG_DFL)
            resource.setrlimit(resource.RLIMIT_FSIZE, (20000, 20000))

        out = self.path("scene")
        self.fails(
            ["train", self.data, "-o", out, "-n", 20, "-q", *SMALL],
            "checkpoint.pags",
            "File too large",
            preexec_fn=limit,
        )
        self.assertFalse([name for name in files_below(self.folder) if name.endswith((".part", LOCK))])
        self.succeeds("train", self.data, "-o", out, "-n", 20, "-q", "--resume", *SMALL)
        street = [
            "synth",
            "street",
            "-o",
            self.path("street"),
            "--frames",
            2,
            "--size",
            "64x36",
            "--cameras",
            1,
            "--no-shifts",
            "-q",
        ]
        if self.succeeds("synth", "--help").returncode == 0:
            self.fails(street, self.path("street"), "File too large", preexec_fn=limit)

    def test_other_programs_get_their_signals_back(self):
        """pags import becomes a Python process. Signals that pags ignores aren't ignored there."""
        os.makedirs(self.path("bin"))
        write(self.path("bin", "python3"), b"#!/bin/sh\ngrep SigIgn /proc/self/status\n")
        os.chmod(self.path("bin", "python3"), 0o755)
        shutil.copy(fixtures.PAGS, self.path("bin", "pags"))
        done = subprocess.run(
            [self.path("bin", "pags"), "import", "photos", self.data, "-o", self.path("out")],
            capture_output=True,
            text=True,
            env={**os.environ, "PATH": self.path("bin") + ":" + os.environ["PATH"]},
        )
        ignored = int(done.stdout.split()[-1], 16)
        for number in (signal.SIGPIPE, signal.SIGXFSZ):
            self.assertFalse(ignored >> (number - 1) & 1, number.name)


class Surroundings(Processes):
    """Tests settings of a user's machine that other tests lack: rights of new files, locale, home folder and temporary
    folder."""

    def test_rights_and_places(self):
        out, empty = self.path("scene"), self.path("empty")
        os.makedirs(empty)
        environment = {
            "PATH": "/nonexistent",
            "HOME": "/nonexistent",
            "TMPDIR": "/nonexistent",
            "LC_ALL": "de_DE.UTF-8",
            "TZ": "Asia/Tokyo",
        }
        for words in (
            ["train", self.data, "-o", out, "-n", 20, *SMALL],
            ["export", out, os.path.join(out, "a.spz")],
            ["render", out, "-o", os.path.join(out, "r")],
        ):
            self.succeeds(*words, umask=0o002, env=environment, cwd=empty, stdin=subprocess.DEVNULL)
        self.assertEqual(os.listdir(empty), [])
        for folder, _, names in os.walk(out):
            self.assertEqual(os.stat(folder).st_mode & 0o777, 0o775, folder)
            for name in names:
                self.assertEqual(os.stat(os.path.join(folder, name)).st_mode & 0o777, 0o664, name)


if __name__ == "__main__":
    fixtures.main()
