# SPDX-License-Identifier: Apache-2.0
"""Runs the package in this file's folder from any working directory: pags import starts it by this path."""

import os
import sys

sys.path[0] = os.path.dirname(os.path.abspath(__file__))

from pags_recordings.__main__ import main  # noqa: E402 (the path has to be set first)

sys.exit(main())
