# SPDX-License-Identifier: GPL-3.0-or-later
"""Chooses the resolution and SH degree of a view's pictures so that they keep the deadline; stopwatches for tests and benchmarks."""

import time

# By divisor of the picture's width and height: the contribution (opacity times projected area, pixels) below which Gaussians that are not
# critical are culled, as in pags render --budget-ms.
CUTS = {1.0: 0.0, 1.5: 0.25, 2.0: 0.25, 3.0: 0.5, 4.0: 0.75, 6.0: 1.0, 8.0: 1.0}


class Budget:
    """Predicts the time of a picture from those drawn before: a fixed part and a part in proportion to the pixels."""

    def __init__(self):
        self.fixed, self.pixels, self.known = 0.0, 0.0, False

    def learn(self, stats, width, height):
        size = width * height / 1e6
        raster = stats["ms_raster"] + max(0.0, stats["ms_job"] - stats["ms"])
        fixed = stats["ms_job"] - raster
        keep = 0.5 if self.known else 0.0
        self.fixed = keep * self.fixed + (1 - keep) * fixed
        self.pixels = keep * self.pixels + (1 - keep) * raster / max(size, 1e-3)
        self.known = True

    def choose(self, width, height, deadline):
        """The smallest divisor of the picture's sides that keeps the deadline, and whether any does; a coarse one before the first picture."""
        if not self.known:
            return 4.0, True
        for scale in CUTS:
            if self.fixed + self.pixels * width * height / 1e6 / (scale * scale) <= deadline:
                return scale, True
        return max(CUTS), False


class Pace:
    """Adapts the share of the deadline that a picture may take, so that ten pictures a second appear: without a graphics card Blender's own
    drawing takes the same processors, and a picture that keeps its deadline still appears late."""

    PERIOD = 0.095  # target time between pictures, seconds: slightly below 0.1
    PAUSE = 0.5  # seconds; pictures further apart belong to two movements of the view, and their distance is not a period
    LEAST = 0.25
    COARSEST = 4.0  # largest divisor: coarser pictures are hardly faster

    def __init__(self):
        self.share, self.last = 1.0, -1e9

    def came(self, now):
        """Records that a picture appeared at a time during a movement."""
        period, self.last = now - self.last, now
        if self.PERIOD < period < self.PAUSE:
            self.share = max(self.LEAST, 0.93 * self.share)
        elif period < 0.9 * self.PERIOD:
            self.share = min(1.0, 1.05 * self.share)


def clock():
    """(wall-clock ms, processor ms of this thread): on few processors the wall clock includes the work of other threads."""
    return 1e3 * time.perf_counter(), 1e3 * time.thread_time()


class Stopwatch:
    """Records milliseconds by part of each redraw, and the pictures shown, for tests and benchmarks. `work` is the processor time of all parts."""

    MOST = 2000

    def __init__(self):
        self.python, self.upload, self.draw, self.work, self.redraws = [], [], [], [], []
        self.gathered = (0.0, 0.0)  # time spent in gather since the last redraw
        self.pictures = []  # tuples (time, divisor, SH degree, statistics of the C module)

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
        self.pictures.append((time.monotonic(), shown.scale, shown.degree, shown.stats))
        del self.pictures[: -self.MOST]
