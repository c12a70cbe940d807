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
def before_save(*_):
    """Before saving: makes scene paths relative to the .blend where it has a path already."""
    if not bpy.data.filepath:
        return
    for root in bpy.data.objects:
        for name in ("path", "dataset") if root.pags.kind == "ROOT" else ():
            path = getattr(root.pags, name)
            if path and os.path.isabs(path):
                try:
                    setattr(root.pags, name, bpy.path.relpath(path))
                except ValueError:
                    pass  # on another drive of Windows, where no relative path exists


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
