# SPDX-License-Identifier: GPL-3.0-or-later
"""How fast a view's pictures come: what a picture may cost so that it keeps the deadline, and stopwatches for tests and benchmarks."""

import time

# What the picture's sides are divided by, and under which opacity times area, in pixels of that picture, Gaussians that aren't critical
# are left out: as pags render --budget-ms does it.
CUTS = {1.0: 0.0, 1.5: 0.25, 2.0: 0.25, 3.0: 0.5, 4.0: 0.75, 6.0: 1.0, 8.0: 1.0}


class Budget:
    """How long pictures take, from those that were drawn: what goes by pixels and what doesn't, by SH degree or without."""

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
        """The finest scale that keeps the deadline, and whether any does; before anything is known a coarse one."""
        if not self.known:
            return 4.0, True
        for scale in CUTS:
            if self.fixed + self.pixels * width * height / 1e6 / (scale * scale) <= deadline:
                return scale, True
        return max(CUTS), False


class Pace:
    """The share of the deadline that a picture may take, so that ten come in a second: without a graphics card Blender's own drawing takes
    the same processors, and a picture that keeps the deadline comes late all the same."""

    PERIOD = 0.095  # seconds; a little less than a tenth
    PAUSE = 0.5  # a longer one lies between two movements
    LEAST = 0.25
    COARSEST = 4.0  # scale; coarser ones are hardly sooner there

    def __init__(self):
        self.share, self.last = 1.0, -1e9

    def came(self, now):
        """A picture has come while something moves."""
        period, self.last = now - self.last, now
        if self.PERIOD < period < self.PAUSE:
            self.share = max(self.LEAST, 0.93 * self.share)
        elif period < 0.9 * self.PERIOD:
            self.share = min(1.0, 1.05 * self.share)


def clock():
    """Milliseconds of the wall's clock and of this thread's processor time: on few processors the former counts other threads', too."""
    return 1e3 * time.perf_counter(), 1e3 * time.thread_time()


class Stopwatch:
    """Milliseconds by part of the redraws, and what pictures came, for the tests and benchmarks. `work` is the processor's time of the parts
    together."""

    MOST = 2000

    def __init__(self):
        self.python, self.upload, self.draw, self.work, self.redraws = [], [], [], [], []
        self.gathered = (0.0, 0.0)  # since the last redraw
        self.pictures = []  # (time, scale, SH degree, statistics of the C module)

    def gather(self, begin):
        """What was done since `begin` belongs to the next redraw."""
        self.gathered = tuple(all_ + end - start for all_, start, end in zip(self.gathered, begin, clock()))

    def add(self, begin, middle, upload):
        """A redraw from `begin` to now; from `middle` on the picture was handed over."""
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
