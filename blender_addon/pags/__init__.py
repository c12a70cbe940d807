# SPDX-License-Identifier: GPL-3.0-or-later
"""The Python API of PAGS in Blender up to 4.1, as `import pags`. The add-on itself is pags_blender; this was its name once, so that what is switched on or
imported under it is that add-on's."""

import importlib

import addon_utils
import pags_blender

bl_info = {
    "name": "PAGS: under its former name",
    "blender": (3, 4, 0),
    "description": "Switch on 'PAGS: driving scenes as Gaussian splats' in place of it",
    "support": "TESTING",  # which lists leave out
    "category": "Import-Export",
}


def __getattr__(name):
    """What the module has, else a part of the add-on."""
    api = pags_blender.native.module
    if api is None:
        raise ImportError(pags_blender.native.problem)
    if hasattr(api, name):
        return getattr(api, name)
    try:
        return importlib.import_module(f"pags_blender.{name}")
    except ModuleNotFoundError:
        raise AttributeError(f"module 'pags' has no attribute {name!r}") from None


def register():
    if not addon_utils.check("pags_blender")[1]:
        addon_utils.enable("pags_blender", default_set=True, persistent=True)


def unregister():
    pass  # the add-on has a switch of its own
