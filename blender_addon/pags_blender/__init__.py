# SPDX-License-Identifier: GPL-3.0-or-later
"""PAGS in Blender: import a reconstructed driving scene, see it, scrub its time, move its objects, place cameras,
render.

One tree is a legacy add-on up to Blender 4.1 and an extension from 4.2 on. Layers: this file registers; engine.py,
viewport.py and overlay.py draw; gather.py turns Blender's state into what is to be drawn; native.py alone knows the C
module."""

bl_info = {
    "name": "PAGS: driving scenes as Gaussian splats",
    "author": "The PAGS authors",
    "version": (0, 0, 0),  # the build puts the engine's here
    "blender": (3, 4, 0),
    "location": "File > Import, Render engine PAGS, 3D View > Sidebar > PAGS",
    "description": "Import, edit and render Gaussian-splat driving scenes with the PAGS engine",
    "category": "Import-Export",
}

import importlib
import sys

import addon_utils
import bpy

from . import native, properties, registry

NAMES = """properties cleanup guard jobs importer cameras engine overlay inspector select_tool comparison measure surface
recording sweeps composite exporter native_splats proxies legend picked ui inspect_panel handlers timing watch"""
PARTS = [importlib.import_module(f".{name}", __package__) for name in NAMES.split()]
FORMER = "pags"  # the add-on's former name, which is now that of the Python module


def leave_former_copy():
    """Disables the running copy of the add-on that has the former name, also in the preferences; returns its settings. Raises RuntimeError if a copy with
    another name is enabled: both would register the same classes."""
    known = bpy.types.Operator.bl_rna_get_subclass_py("PAGS_OT_job")
    package = known.__module__.rpartition(".")[0] if known else ""
    if package not in {"", __package__, FORMER}:
        raise RuntimeError(f"another copy of this add-on is enabled as {package}; disable that copy first")
    former = bpy.context.preferences.addons.get(FORMER) if __package__ == "pags_blender" else None
    names = [name for name in ("program", "budget") if former and hasattr(former.preferences, name)]
    kept = {name: getattr(former.preferences, name) for name in names}
    if package == FORMER != __package__:
        addon_utils.disable(FORMER, default_set=True)
        sys.modules.pop(FORMER)  # now the name of the Python module
    elif former:
        bpy.context.preferences.addons.remove(former)
    return kept


def register():
    kept = leave_former_copy()
    native.publish()
    for part in PARTS:
        registry.register(part)
    chosen = properties.preferences(bpy.context)
    for name, value in kept.items() if chosen else ():
        setattr(chosen, name, value)


def unregister():
    for part in reversed(PARTS):
        registry.unregister(part)
