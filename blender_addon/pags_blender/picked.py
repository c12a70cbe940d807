# SPDX-License-Identifier: GPL-3.0-or-later
"""Clears the pick result when it is outdated: at another time, after undo or opening a file, or when PAGS objects were moved, hidden or deleted. Clears the
text of a comparison after undo and opening a file if its picture is gone; files store both."""

import bpy
from bpy.app.handlers import persistent

from . import photographs


def forget():
    for scene in bpy.data.scenes:
        if scene.pags_picked:
            scene.pags_picked = ""


@persistent
def after_time(*_):
    forget()


@persistent
def after_another_state(*_):
    forget()
    image = bpy.data.images.get(photographs.COMPARED)
    for scene in bpy.data.scenes:
        if scene.pags_compared and (image is None or image.packed_file is None):
            scene.pags_compared = ""


@persistent
def after_change(scene, depsgraph=None):
    """Handler of changes of the file: a moved or removed object may have been the picked one, or may have occluded it."""
    if scene.pags_picked and depsgraph is not None and any(concerns(update) for update in depsgraph.updates):
        forget()


def concerns(update):
    block = update.id
    if isinstance(block, bpy.types.Collection):
        return True  # objects were added, removed or hidden
    return (
        isinstance(block, bpy.types.Object)
        and update.is_updated_transform
        and block.original.pags.kind not in {"NONE", "CAMERA", "EGO"}
    )


HANDLERS = (
    (bpy.app.handlers.load_post, after_another_state),
    (bpy.app.handlers.undo_post, after_another_state),
    (bpy.app.handlers.redo_post, after_another_state),
    (bpy.app.handlers.frame_change_post, after_time),
    (bpy.app.handlers.depsgraph_update_post, after_change),
)
