# SPDX-License-Identifier: GPL-3.0-or-later
"""The __init__.py at the top of the add-on's zip, next to the folder pags_blender, the add-on. If the whole zip was unpacked into a folder of its own among
the add-ons, this file makes that folder an add-on. A folder named `pags`, the add-on's former name, is then also the Python API for `import pags`."""

import importlib

from .pags_blender import native, register, unregister

bl_info = {
    "name": "PAGS: driving scenes as Gaussian splats",
    "author": "The PAGS authors",
    "blender": (3, 4, 0),
    "location": "File > Import, Render engine PAGS, 3D View > Sidebar > PAGS",
    "description": "Import, edit and render Gaussian-splat driving scenes with the PAGS engine",
    "category": "Import-Export",
}
__all__ = ["bl_info", "register", "unregister"]


def __getattr__(name):
    """An attribute of the Python module, else a submodule of the add-on."""
    if hasattr(native.module, name):
        return getattr(native.module, name)
    try:
        return importlib.import_module(f".pags_blender.{name}", __package__)
    except ModuleNotFoundError:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}") from None
