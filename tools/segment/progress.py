# SPDX-License-Identifier: Apache-2.0
"""Shows the progress of a run: one line rewritten in place on a terminal, a line every 30 seconds elsewhere."""

import sys
import time

EVERY = 30  # seconds between lines if the stream is no terminal


def duration(seconds):
    seconds = int(seconds + 0.5)
    if seconds < 100:
        return f"{seconds} s"
    if seconds < 6000:
        return f"{(seconds + 30) // 60} min"
    return f"{seconds // 3600} h {seconds % 3600 // 60:02d} min"


class Progress:
    def __init__(self, total, quiet=False, stream=None, clock=time.monotonic):
        self.stream = stream or sys.stdout
        self.quiet = quiet
        self.moving = self.stream.isatty()
        self.clock = clock
        self.total, self.done = total, 0
        self.begun = self.told = clock()

    def show(self, text, keep):
        if self.quiet:
            return
        if self.moving:
            self.stream.write(f"\r\033[K{text}" + ("\n" if keep else ""))
        elif keep:
            self.stream.write(text + "\n")
        self.stream.flush()

    def each(self):
        return (self.clock() - self.begun) / max(1, self.done)

    def within(self, name, part, whole):
        """Shows how many of the current picture's points are done."""
        if self.moving and self.clock() - self.told >= 0.5:
            self.told = self.clock()
            self.show(f"{self.done + 1} of {self.total}, {name}: point {part} of {whole}", False)

    def finished(self, name):
        """Counts a finished picture and shows the time per image and the time left."""
        self.done += 1
        left = duration(self.each() * (self.total - self.done))
        if self.done == 1:
            self.told = self.clock()
            self.show(f"{name}: {self.each():.2f} s per image, {self.total} images, about {left} left", True)
        elif self.moving or self.clock() - self.told >= EVERY:
            self.told = self.clock()
            self.show(f"{self.done} of {self.total}, {self.each():.2f} s per image, {left} left", not self.moving)

    def end(self):
        if self.done and self.moving and not self.quiet:
            self.stream.write("\r\033[K")
