# SPDX-License-Identifier: Apache-2.0
"""What the importers share: the choice of cameras and time steps, photographs nearest to a time, boxes between their labels, progress."""

import os
import sys
import time

import numpy as np

from . import poses
from .errors import RecordingError


def existing(*names):
    """The path of a file that must be there."""
    path = os.path.join(*names)
    if not os.path.exists(path):
        raise RecordingError(f"{path}: is missing")
    return path


def inside(root, name, where):
    """The path of a file that a table names, which must lie below the root. Links are the user's own, and followed."""
    plain = os.path.normpath(str(name))
    if os.path.isabs(plain) or plain.split(os.sep)[0] == os.pardir:
        raise RecordingError(f"{where}: names the file {str(name)[:200]!r}, which isn't below {root}")
    return os.path.join(root, plain)


def nearest(times, at):
    """The index of the time nearest to `at`; times ascend."""
    t = np.asarray(times)
    i = int(np.clip(np.searchsorted(t, at), 1, len(t) - 1)) if len(t) > 1 else 0
    return i - 1 if i and at - t[i - 1] <= t[i] - at else i


def chosen(available, asked, what):
    """Those of the available names, in their order, that were asked for; all if nothing was."""
    if not asked:
        return list(available)
    unknown = [name for name in asked if name not in available]
    if unknown:
        raise RecordingError(f"no {what} is named {unknown[0]!r}; there are {', '.join(available)}")
    return [name for name in available if name in asked]


def one_of(names, asked, what, option):
    """The one that was asked for, or the only one."""
    if asked is None and len(names) == 1:
        return names[0]
    if asked in names:
        return asked
    some = ", ".join(names[:20]) + (", ..." if len(names) > 20 else "")
    raise RecordingError(f"{f'no {what} is named {asked!r}' if asked else f'there are {len(names)} {what}s'}; choose one with {option}: {some}")


class Tracks:
    """Labels of things by id, and their boxes between the labels."""

    def __init__(self):
        self.labels = {}

    def add(self, track, name, at, world_from_box, size):
        """A label at a time in seconds, times of a track ascending."""
        self.labels.setdefault(track, (name, [], [], []))
        _, times, boxes, sizes = self.labels[track]
        times.append(float(at))
        boxes.append(world_from_box)
        sizes.append(size)

    def put(self, step, at, gap):
        """Gives a step the boxes at a time: between two labels at most `gap` seconds apart, or within a quarter of that of a track's ends."""
        for track, (name, times, boxes, sizes) in self.labels.items():
            near = nearest(times, at)
            if abs(times[near] - at) < 1e-4:
                step.box(track, name, boxes[near], sizes[near])
                continue
            outside = at < times[0] or at > times[-1]
            i = min(max(int(np.searchsorted(times, at)) - 1, 0), max(len(times) - 2, 0))
            apart = times[i + 1] - times[i] if len(times) > 1 else 0
            reach = max(times[0] - at, at - times[-1])
            if apart == 0 or apart > gap or (outside and reach > min(gap / 4, apart)):
                continue
            step.box(track, name, poses.interpolate(times, boxes, at), sizes[near])


class Progress:
    """A line on standard error, rewritten on a terminal, else every ten seconds."""

    def __init__(self, quiet=False, what="time step"):
        self.what = what
        self.total, self.begun, self.shown = 0, time.monotonic(), time.monotonic()
        self.stream = None if quiet else sys.stderr

    def show(self, done):
        now = time.monotonic()
        every = 0.5 if self.stream and self.stream.isatty() else 10
        if self.stream and now - self.shown >= every and done:
            self.shown = now
            left = (now - self.begun) / done * (self.total - done)
            end = "\r" if every < 1 else "\n"
            print(f"{self.what} {done} of {self.total}, {left:.0f} s left", end=end, file=self.stream, flush=True)

    def end(self):
        if self.stream and self.stream.isatty():
            print(" " * 60, end="\r", file=self.stream)
