# SPDX-License-Identifier: GPL-3.0-or-later
"""What has to be noticed: files opened and saved, anything moved."""

import os

import bpy
from bpy.app.handlers import persistent

from . import draw, native, overlay, photographs, viewport


@persistent
def after_load(*_):
    """Another file: nothing of the last one's stays."""
    for view in list(viewport.views):
        view.drop()
    overlay.forget()
    photographs.forget()
    native.forget()
    draw.clear()
    viewport.start_timer()


@persistent
def before_save(*_):
    """Paths are kept relative to a .blend that has a place already."""
    if not bpy.data.filepath:
        return
    for root in bpy.data.objects:
        if root.pags.kind == "ROOT" and root.pags.path and os.path.isabs(root.pags.path):
            try:
                root.pags.path = bpy.path.relpath(root.pags.path)
            except ValueError:
                pass  # another drive


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
