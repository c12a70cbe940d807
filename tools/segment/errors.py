# SPDX-License-Identifier: Apache-2.0
"""The one kind of error that ends a run with a line for people."""


class SegmentError(Exception):
    """Its text names the file, the place in it and what was expected."""


class Interrupted(SegmentError):
    """Ctrl-C or SIGTERM; what was finished is kept."""
