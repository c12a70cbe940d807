# SPDX-License-Identifier: Apache-2.0
"""Tests the add-on in Blender without a window: long work and its threads."""

import os
import sys
import threading
from unittest import mock

sys.path.insert(0, os.path.dirname(os.path.abspath(__file__)))
from blender_case import BlenderCase, addon, main  # noqa: E402


class Jobs(BlenderCase):
    """Tests jobs, which do long work in steps."""

    def setUp(self):
        super().setUp()
        self.jobs = sys.modules[addon.__name__ + ".jobs"]

    def test_threads_of_a_job(self):
        """A job runs on the main thread between two yields. Yielded calls run in another thread, and their errors
        are raised at the yield."""
        threads = []

        def work(job):
            threads.append(threading.current_thread())
            self.assertEqual(
                (yield self.jobs.in_thread(lambda a, b: threads.append(threading.current_thread()) or a + b, 1, 2)), 3
            )
            yield
            threads.append(threading.current_thread())
            with self.assertRaises(ZeroDivisionError):
                yield self.jobs.in_thread(lambda: 1 // 0)
            job.tell(2.0, "more than all")
            return "done"

        job = self.jobs.at_once("Work", work)
        self.assertEqual(job.notice, "done")
        self.assertEqual(job.line(), "Work: more than all, 100 %")
        self.assertEqual([t is threading.main_thread() for t in threads], [True, False, True])

    def test_cancelled_between_steps(self):
        cleaned = []

        def work(job):
            try:
                for _ in range(10):
                    yield
            finally:
                cleaned.append(True)

        job = self.jobs.Job("Work", work)
        self.assertFalse(job.step())
        job.cancel()
        with self.assertRaises(self.jobs.Cancelled):
            job.step()
        self.assertEqual(cleaned, [True])

    def test_the_timeline_stays_where_the_user_has_it(self):
        """A search for edits along the timeline returns to the user's frame between steps, after an error and at the
        end."""
        cameras, seen, at = sys.modules[addon.__name__ + ".cameras"], [], []
        self.scene.frame_set(7)

        def visit(frame, depsgraph):
            self.assertEqual(self.scene.frame_current, frame)
            seen.append(frame)
            if frame == 40:
                raise ValueError("no")

        with mock.patch.object(self.jobs, "SLICE", 0):
            for _ in cameras.along(self.jobs.Job("x", lambda job: iter(())), self.scene, [1, 2, 3], visit):
                at.append(self.scene.frame_current)
                self.scene.frame_set(self.scene.frame_current + 1)  # the user moves to the next frame
            self.assertEqual((seen, at, self.scene.frame_current), ([1, 2, 3], [7, 8, 9], 10))
            with self.assertRaises(ValueError):
                for _ in cameras.along(self.jobs.Job("x", lambda job: iter(())), self.scene, [40], visit):
                    pass
        self.assertEqual(self.scene.frame_current, 10)


if __name__ == "__main__":
    main()
