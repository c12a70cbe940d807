# SPDX-License-Identifier: Apache-2.0
"""Runs the tests of all blender_*.py in this folder in Blender without a window. Each file can also run alone;
PAGS_TESTS selects tests."""

import os
import sys

sys.path.insert(0, os.path.dirname(os.path.abspath(__file__)))
from blender_cameras import Cameras  # noqa: E402
from blender_case import main  # noqa: E402
from blender_composite import Composite  # noqa: E402
from blender_edits import Edits  # noqa: E402
from blender_export import Export  # noqa: E402
from blender_files import Files  # noqa: E402
from blender_final import Final  # noqa: E402
from blender_import import Import  # noqa: E402
from blender_inspecting import Inspecting  # noqa: E402
from blender_interface import Interface  # noqa: E402
from blender_jobs import Jobs  # noqa: E402
from blender_native_splats import NativeSplats  # noqa: E402
from blender_program import Program  # noqa: E402
from blender_scenes import SeveralScenes  # noqa: E402
from blender_sun import Sun  # noqa: E402
from blender_tools import Tools  # noqa: E402
from blender_whereabouts import Whereabouts  # noqa: E402

__all__ = [
    "Cameras",
    "Composite",
    "Edits",
    "Export",
    "Files",
    "Final",
    "Import",
    "Inspecting",
    "Interface",
    "Jobs",
    "NativeSplats",
    "Program",
    "SeveralScenes",
    "Sun",
    "Tools",
    "Whereabouts",
]

if __name__ == "__main__":
    main()
