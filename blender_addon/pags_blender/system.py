# SPDX-License-Identifier: GPL-3.0-or-later
"""Which system this is, and where in the add-on's folder its module and its program lie: in the folder itself where the zip is for one system, as
extensions are, else in a folder of the system's name."""

import os
import platform
import sys
import sysconfig

HERE = os.path.dirname(os.path.abspath(__file__))
ADDON = __package__.removesuffix(".pags_blender")  # the module that Blender switches on: of a zip that was unpacked as a whole the folder around
SYSTEMS = {"linux": "linux", "darwin": "macos", "win32": "windows"}
PROCESSORS = {"x86_64": "x64", "amd64": "x64", "aarch64": "arm64", "arm64": "arm64"}
MODULES = ("pags.abi3.so", "pags.pyd")


def name():
    """As in the zips' names: "linux-x64", "macos-arm64". Of the process: a Blender for x86-64 is one on a processor that emulates it, too, which
    Windows' answer about the machine leaves open."""
    machine = sysconfig.get_platform().split("-")[-1] if sys.platform == "win32" else platform.machine()
    return f"{SYSTEMS.get(sys.platform, sys.platform)}-{PROCESSORS.get(machine.lower(), machine.lower())}"


def held():
    """Names of the systems that a zip for several holds; empty where it is for one."""
    return sorted(n for n in os.listdir(HERE) if any(os.path.isfile(os.path.join(HERE, n, file)) for file in MODULES))


def folder():
    """Folder of this system's program and module, which needn't be there where the zip is for other systems."""
    return os.path.join(HERE, name() if held() else "")


def module():
    """The module's name for an import from this package. Raises ImportError where the zip is for other systems."""
    systems = held()
    if systems and name() not in systems:
        raise ImportError(f"this zip of the add-on is for {', '.join(systems)}, and this Blender is one for {name()}; take that one's, or build it (docs/porting.md)")
    return f".{name()}.pags" if systems else ".pags"
