# SPDX-License-Identifier: Apache-2.0
"""Shared by the importers: files and their formats, selection of cameras and time steps, matching of photographs, boxes between labels, progress."""

import contextlib
import os
import sys
import time

import numpy as np

from . import poses
from .errors import RecordingError


def existing(*names):
    """The path of a required file."""
    path = os.path.join(*names)
    if not os.path.exists(path):
        raise RecordingError(f"{path}: is missing")
    return path


def inside(root, name, where):
    """The path of a file named in a table, which must be below the root. Links are created by the user, and followed."""
    plain = os.path.normpath(str(name))
    if os.path.isabs(plain) or plain.split(os.sep)[0] == os.pardir:
        raise RecordingError(f"{where}: names the file {str(name)[:200]!r}, which is not below {root}")
    return os.path.join(root, plain)


@contextlib.contextmanager
def others_reading(where, what):
    """Converts exceptions of other packages on damaged files, of any type, to a one-line RecordingError: these packages assert, index and decode."""
    try:
        yield
    except (RecordingError, MemoryError):
        raise
    except Exception as error:  # noqa: BLE001
        raise RecordingError(f"{where}: {what}: {type(error).__name__}: {' '.join(str(error).split())[:300]}") from None


PACKED = (".zip", ".tar", ".tar.gz", ".tgz", ".gz", ".7z", ".rar", ".bz2", ".xz", ".zst")


def others(folder, name):
    """Files and folders that may be the missing NAME in another form: packed, with another extension, in other case."""
    stem = name.lower().split(".")[0]
    there = os.listdir(folder) if os.path.isdir(folder) else []
    return sorted(
        entry
        for entry in there
        if entry != name
        and (
            entry.lower() == name.lower()
            or entry.lower().split(".")[0] == stem
            and (entry.lower().endswith(PACKED) or "." in name)
        )
    )


def optional(folder, name, what, account):
    """The path of an optional file or folder, or None if missing, with a note in the report. Another form of it (packed, renamed) is an error."""
    path = place = os.path.join(folder, name)
    if os.path.exists(path):
        return path
    while not os.path.exists(os.path.dirname(place)):  # a parent folder may be packed
        place = os.path.dirname(place)
    folder, name = os.path.split(place)
    other = others(folder, name)
    if other:
        raise RecordingError(
            f"{os.path.join(folder, other[0])}: {what} are read from {name}; unpack, convert or rename it, or move it elsewhere to import without {what}"
        )
    if account:
        account.lacks(what, f"{path} is missing")
    return None


def listed(folder, endings, what, account, besides=(".json", ".txt")):
    """Files of an optional folder by their names without extension. If none match, files with other extensions are an error, and a missing or empty folder is
    noted in the report; otherwise files with other extensions are counted."""
    place = optional(*os.path.split(folder), what, account)
    found, strange = {}, []
    for entry in sorted(os.listdir(place)) if place else ():
        ending = next((ending for ending in endings if entry.lower().endswith(ending)), None)
        if ending and not entry.startswith("."):
            found.setdefault(entry[: -len(ending)], os.path.join(place, entry))
        elif not entry.startswith(".") and not entry.lower().endswith(besides):
            strange.append(entry)
    if strange and not found:
        raise RecordingError(
            f"{place}: has {strange[0]}{' and others' if len(strange) > 1 else ''}, but no file that ends in {' or '.join(endings)}, which {what} are read from; convert or unpack them"
        )
    if account and place:
        account.leave_out(
            "files",
            f"don't end in {' or '.join(endings)}, which {what} are read from",
            [os.path.join(folder, entry) for entry in strange],
        )
        if not found:
            account.lacks(what, f"{place} is empty")
    return found


def nearest(times, at):
    """The index of the time nearest to `at`; times ascend."""
    t = np.asarray(times)
    i = int(np.clip(np.searchsorted(t, at), 1, len(t) - 1)) if len(t) > 1 else 0
    return i - 1 if i and at - t[i - 1] <= t[i] - at else i


def partners(times, at, gap):
    """For each time of `at` the index of its partner among `times`, or -1. Both ascend. Partners differ by at most `gap`, are unique, and in order of time.
    Maximises the sum of gap - distance by dynamic programming, as in sequence alignment (Needleman, Wunsch 1970): a missing time only loses its own partner,
    and an offset of half a period does not matter."""
    zero = at[0] if len(at) else 0
    t, a = (np.asarray(np.asarray(one) - zero, np.float64) for one in (times, at))
    best, top, rows = [0.0] * (len(t) + 1), 0, []  # best[j]: the largest sum for the first j of `times`
    for one in a:
        first, last = int(np.searchsorted(t, one - gap)), int(np.searchsorted(t, one + gap, "right"))
        best[top + 1 : last + 1] = [best[top]] * (last - top)
        before, top, how = best[first], last, []
        for j in range(first, last):
            taken, left = before + 1.001 * gap - abs(t[j] - one), best[j]
            before = best[j + 1]
            how.append("taken" if taken > max(left, before) else "left" if left > before else "before")
            best[j + 1] = max(taken, left, before)
        rows.append((first, how))
    found, end = [-1] * len(a), len(t)
    for i, (first, how) in reversed(list(enumerate(rows))):
        j = min(end - first, len(how)) - 1
        while j >= 0 and how[j] == "left":
            j -= 1
        if j >= 0 and how[j] == "taken":
            found[i] = first + j
            end = first + j
        else:
            end = min(end, first + max(j, -1) + 1)
    return found


def joined(anchors, shots, gap, frames, account, unit=1.0):
    """The time steps: for each anchor the number of its time, and for each camera of `shots` (times by name) the number of its matching photograph, used
    once, at most `gap` seconds away. Drops steps without a photograph of some camera, then those not selected by `frames`; the report counts both, and
    unmatched photographs. Times count `unit` per second and ascend."""
    found = {name: partners(times, anchors, gap * unit) for name, times in shots.items()}
    whole, lost = [], {}
    for i, at in enumerate(anchors):
        lacking = next((name for name in shots if found[name][i] < 0), None)
        if lacking is None:
            whole.append((i, {name: found[name][i] for name in shots}))
        else:
            lost.setdefault(lacking, []).append(f"{(at - anchors[0]) / unit:.3f} s after the beginning")
    for name, which in lost.items():
        account.leave_out("time steps", f"{name} has no photograph of its own within {gap} s", which)
    steps = choose_steps(whole, frames, account)
    account.leave_out(
        "photographs", "of the time steps that --frames left out", count=(len(whole) - len(steps)) * len(shots)
    )
    for name, times in shots.items():
        used = {picked[name] for _, picked in whole}
        account.leave_out(
            "photographs", f"of {name}, which match no time step", count=sum(i not in used for i in range(len(times)))
        )
    return steps


def choose_steps(steps, frames, account):
    """The steps selected by --frames, both ends included."""
    kept = steps if frames is None else steps[frames[0] : frames[1] + 1]
    account.leave_out("time steps", "not selected by --frames", count=len(steps) - len(kept))
    return kept


def sweeps_of_steps(times, steps, gap, where, account):
    """For each step's time the number of its matching sweep, used once, at most `gap` seconds away, or -1. Times are seconds and ascend."""
    found = partners(times, steps, gap)
    within = sum(steps[0] - gap <= at <= steps[-1] + gap for at in times)
    account.contains("sweeps", within, where)
    account.leave_out("sweeps", "before the first or after the last time step", count=len(times) - within)
    account.leave_out(
        "sweeps", f"between the time steps: no unmatched step within {gap} s", count=within - sum(i >= 0 for i in found)
    )
    return found


def complete(steps, shots, account):
    """The steps at which each camera has a photograph; `shots` has the steps with photographs, by camera. The report counts the other steps, and the
    photographs that are in none of the complete ones."""
    kept = []
    for step in steps:
        lacking = next((name for name in shots if step not in shots[name]), None)
        if lacking is None:
            kept.append(step)
        else:
            account.leave_out("time steps", f"{lacking} has no photograph of them", [f"number {step}"])
    for name in shots:
        account.leave_out(
            "photographs", f"of {name}, whose time steps are incomplete", count=len(shots[name]) - len(kept)
        )
    return kept


def chosen(available, asked, what):
    """The requested ones of the available names, in their order; all if none was requested."""
    if not asked:
        return list(available)
    unknown = [name for name in asked if name not in available]
    if unknown:
        raise RecordingError(f"no {what} is named {unknown[0]!r}; there are {', '.join(available)}")
    return [name for name in available if name in asked]


def one_of(names, asked, what, option):
    """The requested name, or the only one."""
    if asked is None and len(names) == 1:
        return names[0]
    if asked in names:
        return asked
    some = ", ".join(names[:20]) + (", ..." if len(names) > 20 else "")
    raise RecordingError(
        f"{f'no {what} is named {asked!r}' if asked else f'there are {len(names)} {what}s'}; choose one with {option}: {some}"
    )


TWICE = "duplicate label of the same object and time; the first one counts"


class Tracks:
    """Labels of objects by id, and boxes interpolated between them."""

    def __init__(self, account):
        self.labels, self.account, self.used = {}, account, set()

    def add(self, track, name, at, world_from_box, size):
        """A label at a time in seconds, times of a track ascending. A second one of an object at the same time is dropped."""
        self.labels.setdefault(track, (name, [], [], []))
        _, times, boxes, sizes = self.labels[track]
        if times and at == times[-1]:
            self.account.leave_out("boxes", TWICE, [f"{track} at {at:.3f} s"])
            return
        times.append(float(at))
        boxes.append(world_from_box)
        sizes.append(size)

    def within(self, first, last, where):
        """Reports how many labels lie between the first and the last time step."""
        self.span = first, last
        self.account.contains(
            "boxes", sum(first <= at <= last for _, times, _, _ in self.labels.values() for at in times), where
        )

    def put(self, step, at, gap):
        """Adds the boxes at a time to a step: between two labels with an interval of at most `gap` seconds, or within a quarter of that of a track's ends."""
        for track, (name, times, boxes, sizes) in self.labels.items():
            near = nearest(times, at)
            if abs(times[near] - at) < 1e-4:
                self.used.add(track)
                step.box(track, name, boxes[near], sizes[near])
                continue
            outside = at < times[0] or at > times[-1]
            i = min(max(int(np.searchsorted(times, at)) - 1, 0), max(len(times) - 2, 0))
            apart = times[i + 1] - times[i] if len(times) > 1 else 0
            reach = max(times[0] - at, at - times[-1])
            if not outside and apart > gap:
                self.account.leave_out(
                    "boxes", f"between two labels that are more than {gap} s apart", [f"{track} at {at:.3f} s"]
                )
            if apart == 0 or apart > gap or (outside and reach > min(gap / 4, apart)):
                continue
            self.used.add(track)
            step.box(track, name, poses.interpolate(times, boxes, at), sizes[near])

    def end(self):
        """Reports objects labelled between the first and the last time step that have no box."""
        first, last = self.span
        lost = [
            track
            for track, (_, times, _, _) in self.labels.items()
            if track not in self.used and any(first <= at <= last for at in times)
        ]
        self.account.leave_out("objects", "labelled once, not at a time step, or with too long gaps: no box", lost)


class Progress:
    """A progress line on standard error, rewritten on a terminal, else printed every ten seconds."""

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
