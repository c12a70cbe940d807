# SPDX-License-Identifier: GPL-3.0-or-later
"""Stopwatches of a view's redraws and pictures, for its statistics, tests and benchmarks."""

import time


def clock():
    """(wall-clock ms, processor ms of this thread): with few processors the wall clock includes other threads' work."""
    return 1e3 * time.perf_counter(), 1e3 * time.thread_time()


class Stopwatch:
    """Records milliseconds per part of each redraw, and the displayed pictures, for tests and benchmarks. `work`: processor time of all parts."""

    MOST = 2000

    def __init__(self):
        self.python, self.upload, self.draw, self.work, self.redraws = [], [], [], [], []
        self.gathered = (0.0, 0.0)  # time spent in gather since the last redraw
        self.pictures = []  # tuples (time, statistics of the C module)

    def gather(self, begin):
        """Adds the time since `begin` to the next redraw."""
        self.gathered = tuple(all_ + end - start for all_, start, end in zip(self.gathered, begin, clock()))

    def add(self, begin, middle, upload):
        """Records a redraw from `begin` to now, with the picture drawn from `middle` on."""
        end = clock()
        for values, value in (
            (self.python, middle[0] - begin[0] - upload + self.gathered[0]),
            (self.upload, upload),
            (self.draw, end[0] - middle[0]),
            (self.work, end[1] - begin[1] + self.gathered[1]),
            (self.redraws, time.monotonic()),
        ):
            values.append(value)
            del values[: -self.MOST]
        self.gathered = (0.0, 0.0)

    def add_picture(self, shown):
        self.pictures.append((time.monotonic(), shown.stats))
        del self.pictures[: -self.MOST]
