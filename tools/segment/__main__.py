# SPDX-License-Identifier: Apache-2.0
"""python tools/segment DATASET ...: runs the package, called as a folder or as a module."""

import os
import sys

if not __package__:
    sys.path[0] = os.path.dirname(os.path.dirname(os.path.abspath(__file__)))

from segment.cli import main  # noqa: E402 (the path has to be set first)

sys.exit(main())
