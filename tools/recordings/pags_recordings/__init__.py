# SPDX-License-Identifier: Apache-2.0
"""Writes recordings of driving in the layout that pags reads (docs/own-recording.md): numpy arrays and files in, a folder out.

Poses are 4x4 matrices named TO_from_FROM: world_from_camera takes a point of the camera's frame to the world. Lengths are metres, times
seconds. `poses` turns other conventions into these; what the writer is given it checks, and says what it found.
"""

from . import poses
from .errors import RecordingError
from .writer import Recording

__version__ = "0.2.0"  # pags' own, which the test addon.install compares

__all__ = ["Recording", "RecordingError", "poses"]
