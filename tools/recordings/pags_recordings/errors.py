# SPDX-License-Identifier: Apache-2.0
"""The exception for invalid input: one line that states the place, the value found and the value expected."""


class RecordingError(ValueError):
    pass
