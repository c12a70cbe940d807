# SPDX-License-Identifier: Apache-2.0
"""The errors that end a run with a one-line message."""


class SegmentError(Exception):
    """Its text names the file, the place in the file and what was expected there."""


class Interrupted(SegmentError):
    """The run was stopped by Ctrl-C or by a signal that asks it to end; finished images are kept."""
