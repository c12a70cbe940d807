# SPDX-License-Identifier: GPL-3.0-or-later
"""Detects the system and locates the add-on's module and program for it: in the add-on's folder if the zip is for one system, as extensions are, else in a
folder with the system's name."""

import os
import platform
import sys
import sysconfig

HERE = os.path.dirname(os.path.abspath(__file__))
ADDON = __package__.removesuffix(".pags_blender")  # what Blender enables; of an unpacked zip the folder around
SYSTEMS = {"linux": "linux", "darwin": "macos", "win32": "windows"}
PROCESSORS = {"x86_64": "x64", "amd64": "x64", "aarch64": "arm64", "arm64": "arm64"}
MODULES = ("pags.abi3.so", "pags.pyd")


def name():
    """The system's name as in the zips: "linux-x64", "macos-arm64". The processor is that of the process: a Blender for x86-64 may run emulated, which
    Windows' machine name does not show."""
    machine = sysconfig.get_platform().split("-")[-1] if sys.platform == "win32" else platform.machine()
    return f"{SYSTEMS.get(sys.platform, sys.platform)}-{PROCESSORS.get(machine.lower(), machine.lower())}"


def held():
    """Names of the systems in a zip for several; empty for a zip for one system."""
    return sorted(n for n in os.listdir(HERE) if any(os.path.isfile(os.path.join(HERE, n, file)) for file in MODULES))


def folder():
    """Folder of this system's program and module; may be missing if the zip is for other systems."""
    return os.path.join(HERE, name() if held() else "")


def module():
    """The module's name for imports from this package. Raises ImportError if the zip is for other systems."""
    systems = held()
    if systems and name() not in systems:
        raise ImportError(
            f"this zip of the add-on is for {', '.join(systems)}, but this Blender needs {name()}; get that zip, or build it (docs/porting.md)"
        )
    return f".{name()}.pags" if systems else ".pags"
