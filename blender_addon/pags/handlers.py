# SPDX-License-Identifier: GPL-3.0-or-later
"""Handlers of Blender events: a file was opened or saved, an object moved."""

import os

import bpy
from bpy.app.handlers import persistent

from . import comparison, draw, native, overlay, photographs, recording, viewport


@persistent
def after_load(*_):
    """After another .blend was opened: drops all scenes, renderers and pictures of the last one."""
    for view in list(viewport.views):
        view.drop()
    overlay.forget()
    photographs.forget()
    comparison.forget()
    recording.forget()
    native.forget()
    draw.clear()
    viewport.start_timer()


@persistent
def before_save(*arguments):
    """Before saving: makes the scene paths of imports with *Relative path* relative, once the .blend has a path. Others stay as the user has them."""
    blend = bpy.data.filepath or next((a for a in arguments if isinstance(a, str)), "")  # newer Blenders say at the first save where it goes
    if not blend:
        return
    for root in bpy.data.objects:
        if root.pags.kind == "ROOT" and root.pags.relative and root.library is None:
            if os.path.isabs(root.pags.path):
                try:
                    root.pags.path = bpy.path.relpath(root.pags.path, start=os.path.dirname(blend))
                except ValueError:
                    pass  # on another drive of Windows, where no relative path exists
            root.pags.relative = False


@persistent
def after_change(*_):
    overlay.changed()


HANDLERS = (
    (bpy.app.handlers.load_post, after_load),
    (bpy.app.handlers.save_pre, before_save),
    (bpy.app.handlers.depsgraph_update_post, after_change),
    (bpy.app.handlers.frame_change_post, after_change),
)


def register():
    for handlers, function in HANDLERS:
        handlers.append(function)
    viewport.start_timer()


def unregister():
    viewport.stop_timer()
    for handlers, function in HANDLERS:
        if function in handlers:
            handlers.remove(function)
    native.close()
    draw.clear()
