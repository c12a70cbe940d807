# SPDX-License-Identifier: Apache-2.0
"""Sends every signal at random moments of training, import, export and merge, and runs several processes at one folder.
All files left are complete, and the next command succeeds.

The test is short by default. `make check-interrupts` sets PAGS_MOMENTS=10 moments for each signal, PAGS_TOGETHER=50
rounds of two and of four processes, and PAGS_ORDINARY=200 ordinary runs in sequence."""

import collections
import os
import random
import re
import shutil
import signal
import sys
import time

HERE = os.path.dirname(os.path.abspath(__file__))
sys.path[:0] = [os.path.join(HERE, "..", "cli"), HERE]

import fixtures  # noqa: E402
from fixtures import read  # noqa: E402
from test_blocks import make_blocks  # noqa: E402
from test_faults import Faults, contents, many_splats  # noqa: E402
from test_import import make_tree  # noqa: E402

MOMENTS = int(os.environ.get("PAGS_MOMENTS", "1"))
TOGETHER = int(os.environ.get("PAGS_TOGETHER", "2"))
ORDINARY = int(os.environ.get("PAGS_ORDINARY", "5"))
SAVE = [
    number
    for number in map(signal.Signals.__members__.get, ("SIGHUP", "SIGINT", "SIGTERM", "SIGUSR1", "SIGUSR2", "SIGXCPU"))
    if number
]
STOP = [signal.SIGTSTP, signal.SIGTTIN, signal.SIGTTOU]
# Tests skip all real-time signals except the first and the last.
REAL_TIME = range(signal.SIGRTMIN + 1, signal.SIGRTMAX)
CATCHABLE = sorted(signal.valid_signals() - {signal.SIGKILL, signal.SIGSTOP} - set(REAL_TIME))
CHOSEN = CATCHABLE if MOMENTS > 1 else [signal.SIGHUP, signal.SIGQUIT]


def name_of(number):
    return number.name if isinstance(number, signal.Signals) else f"signal {number}"


class Interrupts(Faults):
    def interrupt(self, number, after, arguments):
        """Runs a command and sends it a signal after `after` seconds. Returns its exit code, or None if it ended earlier."""
        running = self.start(*arguments)
        time.sleep(after)
        late = running.poll() is not None
        if not late:
            running.send_signal(number)
            if number in STOP:
                time.sleep(0.05)
                running.send_signal(signal.SIGCONT)
        _, errors = running.communicate(timeout=120)
        allowed = (
            [0] if late or number in STOP else [0, 3, -number] if number in SAVE else [0, -number]
        )  # the program may not handle the signal yet
        self.assertIn(running.returncode, allowed, f"{name_of(number)} after {after:.3f} s: {arguments}: {errors}")
        return None if late else running.returncode

    def each(self, verb, begin, check):
        """begin(round) prepares a round and returns its command. check(command) asserts that the files left are
        complete and that the command then succeeds."""
        since = time.monotonic()
        command = begin("whole")
        self.succeeds(*command)
        seconds = time.monotonic() - since
        dice, ended = random.Random(verb), collections.Counter()
        for number, moment in ((number, moment) for number in CHOSEN for moment in range(MOMENTS)):
            code, tries = None, 0
            while code is None and tries < 20:  # repeats a command that ended before the signal
                command = begin(f"{int(number)}-{moment}")
                code = self.interrupt(number, dice.uniform(0, seconds), command)
                if code is None:
                    seconds, tries = 0.9 * seconds, tries + 1
                with self.subTest(verb=verb, signal=name_of(number), moment=moment, code=code):
                    check(command)
            ended[
                "had ended before"
                if code is None
                else "done"
                if code == 0
                else "saved"
                if code == 3
                else "ended by the signal"
            ] += 1
        print(
            f"{verb}: {len(CHOSEN)} signals at {MOMENTS} moments: {', '.join(f'{count} {how}' for how, count in sorted(ended.items()))}",
            flush=True,
        )

    def assert_same(self, found, expected):
        self.assertEqual(sorted(found), sorted(expected))
        for name, data in found.items():
            self.assertTrue(data == expected[name], f"{name} is another one")

    def test_training(self):
        self.undisturbed()

        def check(command):
            self.succeeds(*command)
            self.assert_trained(command[3])
            shutil.rmtree(command[3])

        self.each("train", lambda name: self.train_command(self.path(name), "--resume"), check)

    def test_import(self):
        raw = make_tree(self.path("raw"), 60)
        self.succeeds("import", "kitti", raw, "-o", self.path("expected"))
        expected = contents(self.path("expected"))

        def check(command):
            for name, data in contents(command[4]).items() if os.path.isdir(command[4]) else []:
                self.assertTrue(
                    name.endswith(".part") or name == "import.json" or data == expected[name], f"{name} is torn"
                )
            self.succeeds(*command)
            self.assert_same(contents(command[4]), expected)
            shutil.rmtree(command[4])

        self.each("import", lambda name: ["import", "kitti", raw, "-o", self.path(name)], check)

    def test_export(self):
        scene, target = self.write("scene.ply", many_splats(20000)), self.path("a.spz")
        self.succeeds("export", scene, target)
        expected = read(target)

        def begin(name):
            self.write("a.spz", b"what was there before")
            return ["export", scene, target]

        def check(command):
            self.assertIn(read(target), [b"what was there before", expected])
            self.succeeds(*command)
            self.assertEqual(read(target), expected)

        self.each("export", begin, check)

    def test_merge(self):
        make_blocks(self.path("blocks"))
        self.succeeds("merge", self.path("blocks"), "-o", self.path("expected"))
        expected = contents(self.path("expected"))

        def check(command):
            if not os.path.exists(os.path.join(command[3], "scene.json")):
                self.succeeds(*command)
            self.assert_same(
                {name: data for name, data in contents(command[3]).items() if not name.endswith(".part")}, expected
            )
            shutil.rmtree(command[3])

        self.each("merge", lambda name: ["merge", self.path("blocks"), "-o", self.path(name)], check)


class Together(Faults):
    """Several processes start at random moments and use one folder at the same time."""

    def run_together(self, commands, dice, longest):
        """Starts the commands in sequence within `longest` seconds. Asserts that a refused command names another
        process. Returns the exit codes."""
        running = []
        for command in commands:
            running.append(self.start(*command))
            time.sleep(dice.uniform(0, longest / len(commands)))
        said = [process.communicate(timeout=300)[1] for process in running]
        pids = {str(process.pid) for process in running}
        for process, errors in zip(running, said):
            self.assertIn(process.returncode, (0, 1), errors)
            if process.returncode:
                holder = re.search(r"another process is writing .*process (\d+) on ", errors)
                self.assertTrue(holder and holder[1] in pids - {str(process.pid)}, errors)
        return [process.returncode for process in running]

    def test_trainings(self):
        self.undisturbed()
        dice, refused, done = random.Random(4), 0, 0
        for count in (2, 4):
            for number in range(TOGETHER):
                out = self.path(f"scene{count}-{number}")
                codes = self.run_together(
                    [self.train_command(out, "--resume")] * count, dice, dice.choice([0, self.seconds])
                )
                refused, done = refused + sum(codes), done + codes.count(0)
                self.assertIn(0, codes)
                self.assert_trained(out)
                self.succeeds(*self.train_command(out, "--resume"))
                self.assert_trained(out)
                shutil.rmtree(out)
        print(
            f"{TOGETHER} times two and four trainings at one folder: {done} done, {refused} refused, no bit changed",
            flush=True,
        )

    def test_different_commands(self):
        """A training, an import, an export and a rendering write to one folder. The refused commands change nothing."""
        self.undisturbed()
        raw, scene = make_tree(self.path("raw"), 20), self.write("scene.ply", many_splats(3000))
        dice, refused = random.Random(5), 0
        for number in range(TOGETHER):
            out = self.path(f"folder{number}")
            self.succeeds(*self.train_command(out))
            others = [
                ["export", scene, os.path.join(out, "a.ply")],
                ["render", scene, "--path", "orbit", "-n", "2", "-o", out],
                ["import", "kitti", raw, "-o", out],
            ]
            training = self.start(*self.train_command(out, "--resume"), "-n", "1000000")
            deadline = time.monotonic() + 60
            lock = os.path.join(out, ".pags.lock")
            while not (os.path.exists(lock) and os.path.getsize(lock)):  # the lock file is written after locking
                self.assertLess(time.monotonic(), deadline)
                time.sleep(0.002)
            dice.shuffle(others)
            together = [self.start(*command) for command in others]
            for process in together:
                _, errors = process.communicate(timeout=60)
                self.assertEqual(process.returncode, 1, errors)
                self.assertIn(f"pags train, process {training.pid} on ", errors)
                refused += 1
            training.kill()
            training.communicate()
            self.assertFalse(
                [name for name in os.listdir(out) if name.startswith("a.") or name == "images" or re.match(r"\d", name)]
            )
            self.succeeds(*others[0] if others[0][0] != "import" else others[1])
            shutil.rmtree(out)
        print(f"{TOGETHER} times a training with three others: {refused} refused", flush=True)

    def test_ordinary_runs(self):
        """Commands that follow each other without a pause aren't refused."""
        out, scene = self.path("scene"), self.write("scene.ply", many_splats(500))
        for number in range(ORDINARY):
            command = self.train_command(out)
            command[5] = str(20 * (number % 20 + 1))
            self.succeeds(*command, "--resume" if number % 20 else "--overwrite")
            if number % 4 == 1:
                self.succeeds("export", scene, os.path.join(out, "a.ply"))
                self.succeeds("render", scene, "--path", "orbit", "-n", "1", "-o", self.path("orbit"))
            elif number % 4 == 3:
                running = self.start(*self.train_command(self.path("killed"), "--resume"))
                time.sleep(0.1)
                running.kill()
                running.communicate()
        self.assertFalse(
            [name for name in fixtures.files_below(self.folder) if name.endswith(".pags.lock") and "killed" not in name]
        )
        print(f"{ORDINARY} ordinary runs: none refused", flush=True)


if __name__ == "__main__":
    fixtures.main()
