# SPDX-License-Identifier: Apache-2.0
"""Tests forked processes: the parent's renderer raises an error that mentions the fork, and never hangs. Everything
else works."""

import functools
import gc
import os
import signal
import sys
import unittest

sys.path.insert(0, os.path.dirname(os.path.abspath(__file__)))

from test_module import IDENTITY, SANITIZED, fixtures, pags  # noqa: E402

LIMIT = 20  # seconds after which a child process counts as hanging


@unittest.skipUnless(hasattr(os, "fork") and not SANITIZED, "no fork here, or none that the sanitizer survives")
class Fork(unittest.TestCase):
    def setUp(self):
        rows = 2000
        self.scene = pags.Scene(
            [[0, 0, 3]] * rows, [[1, 0, 0, 0]] * rows, [[-2] * 3] * rows, [2] * rows, [[[1, 1, 1]]] * rows
        )
        self.view = dict(width=320, height=240, fx=250, fy=250, cx=160, cy=120, world_from_camera=IDENTITY)
        self.deadline = pags.Deadline(50)
        self.renderer = pags.Renderer(2)
        self.done = self.renderer.submit(self.scene, self.view)
        self.done.wait()

    def child(self, work):
        """Returns the result of work() in a forked child as text, or its error message. The child exits normally,
        with all destructors."""
        ends = os.pipe()
        sys.stdout.flush()
        number = os.fork()
        if number == 0:
            signal.signal(signal.SIGALRM, signal.SIG_DFL)
            signal.alarm(LIMIT)
            try:
                said = str(work())
            except Exception as error:
                said = f"{type(error).__name__}: {error}"
            os.write(ends[1], said.encode())
            for name in ("renderer", "done", "scene", "deadline"):
                self.__dict__.pop(name, None)
            del work
            gc.collect()
            os._exit(0)
        os.close(ends[1])
        with os.fdopen(ends[0], "rb") as pipe:
            said = pipe.read().decode()
        self.assertEqual(os.waitpid(number, 0)[1], 0, f"the child hung or died: {said}")
        return said

    def test_fork_while_idle(self):
        self.assertIn("fork", self.child(lambda: self.renderer.submit(self.scene, self.view)))
        self.assertIn("Picture", self.child(lambda: self.done.take()))
        self.assertIn("Picture", self.child(lambda: pags.render(self.scene, self.view)))
        self.assertIn(
            "Picture", self.child(lambda: pags.Renderer(1).submit(self.scene, self.view, deadline=self.deadline).take())
        )
        self.assertEqual(self.child(lambda: pags.pick(self.scene, self.view, 160, 120)["object"]), "None")
        self.assertIn(
            "fork", self.child(lambda: self.child(lambda: self.renderer.submit(self.scene, self.view))), "a grandchild"
        )
        self.assertIn("Picture", str(self.done.take()), "and the parent goes on")

    def test_fork_while_drawing(self):
        """Forks while the renderer draws the scene and holds its lock."""
        busy = [self.renderer.submit(self.scene, self.view, deadline=self.deadline) for _ in range(300)]
        last = busy[-1]
        calls = [
            last.take,
            last.done,
            functools.partial(last.wait, 1),
            last.cancel,
            lambda: self.renderer.submit(self.scene, self.view),
        ]
        for call in calls:
            self.assertIn("fork", self.child(call))
        calls = [
            last.__repr__,
            self.scene.arrays,
            lambda: self.scene.points(-1, 5),
            lambda: pags.render(self.scene, self.view),
            lambda: pags.pick(self.scene, self.view, 1, 1),
            lambda: self.deadline.step,
            lambda: self.scene.info["gaussians"],
        ]
        for call in calls:
            said = self.child(call)  # the lock may be free at that moment
            self.assertTrue("Error" not in said or "fork" in said, said)
        del calls, last
        for job in busy:
            job.cancel()
        busy.clear()


if __name__ == "__main__":
    fixtures.main()
