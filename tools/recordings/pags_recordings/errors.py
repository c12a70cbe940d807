# SPDX-License-Identifier: Apache-2.0
"""What the package raises for input that can't be right: one line that names what, what was found and what was expected."""


class RecordingError(ValueError):
    pass
