# SPDX-License-Identifier: Apache-2.0
"""Writes recordings of drives in the layout that pags reads (docs/own-recording.md): numpy arrays and files in, a folder out.

Poses are 4x4 matrices named TO_from_FROM: world_from_camera maps a point from the camera's frame to the world. Lengths are metres, times seconds. `poses`
converts from other conventions. The writer checks its input; error messages state the value found."""

from . import poses
from .errors import RecordingError
from .writer import Recording

__version__ = "0.2.0"  # version of pags, checked by the test addon.install

__all__ = ["Recording", "RecordingError", "poses"]
