# SPDX-License-Identifier: Apache-2.0
"""Functions shared by the checks in a headless Chromium."""

import math
import os
import shutil
import sys

HERE = os.path.dirname(os.path.abspath(__file__))
sys.path.insert(0, os.path.join(HERE, "..", "cli"))

import fixtures  # noqa: E402 (the path has to be set first)


def begin():
    """Returns the folder of the command line PAGS FOLDER, and the path of Chromium; exits with 77 if a program is
    missing."""
    fixtures.PAGS = os.path.abspath(sys.argv[1])
    chromium = shutil.which("chromium")
    if not (chromium and shutil.which("node") and os.path.isdir(os.path.join(HERE, "node_modules", "puppeteer-core"))):
        print("skipped: needs node, its modules and chromium: make setup")
        sys.exit(77)
    return os.path.abspath(sys.argv[2]), chromium


def camera_from_world(view):
    """Returns the rotation (three rows) and the translation of a camera of scene.json."""
    q = view["camera_from_world_quaternion_wxyz"]
    size = math.sqrt(sum(v * v for v in q))
    w, x, y, z = (v / size for v in q)
    rows = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
        [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
        [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
    ]
    return rows, view["camera_from_world_translation"]
