# SPDX-License-Identifier: GPL-3.0-or-later
"""Handlers of Blender events: file opened, file saved, object moved."""

import bpy
from bpy.app.handlers import persistent

from . import comparison, draw, meshes, native, overlay, photographs, picked, sweeps, viewport, whereabouts


def drop():
    """Drops all cached scenes and pictures."""
    for view in list(viewport.views):
        view.drop()
    for part in (overlay, comparison, sweeps, native, picked):
        part.forget()


class PAGS_OT_reload(bpy.types.Operator):
    """Reload the scene from its files"""

    bl_idname = "pags.reload"
    bl_label = "Reload"

    def execute(self, context):
        drop()
        return {"FINISHED"}


@persistent
def after_load(*_):
    """After opening another .blend."""
    drop()
    for part in (photographs, meshes, whereabouts):
        part.forget()
    draw.clear()
    whereabouts.tell()
    viewport.start_timer()
    sweeps.after_load()


# During a save: old and new path of the .blend, stored paths (whereabouts.py), their old values.
_saving = {"from": "", "to": "", "targets": [], "before": []}


@persistent
def before_save(*arguments):
    """Before saving: makes the scene paths of imports with *Relative path* relative once the .blend has a path, and adapts relative paths to the new folder
    of the .blend. Other paths don't change. Records the identity of the scenes."""
    target = next((a for a in arguments if isinstance(a, str)), "")  # newer Blenders pass the new path
    blend, targets = target or bpy.data.filepath, whereabouts.targets()
    before = [(root, name, getattr(root.pags, name), root.pags.record) for root, name, _, _ in targets]
    _saving.update({"from": bpy.data.filepath, "to": blend, "targets": targets, "before": before})
    move(blend)
    image = bpy.data.images.get(photographs.COMPARED)
    if image is not None and image.is_dirty:
        image.pack()
    for root in whereabouts.roots():
        entry = native.known(whereabouts.absolute_path(root))
        if root.library is None and entry is not None:
            photographs.note(root, entry)
    whereabouts.leave_check()


def move(blend):
    for root, name, path, relative in _saving["targets"]:
        whereabouts.place(root, name, path, blend, relative and bool(blend))
        root.pags.relative = root.pags.relative and not blend


@persistent
def after_save(*_):
    """Restores the paths after a copy was saved elsewhere. If Blender did not pass the new path (up to 4.1), the paths are adapted now; the file on disk gets
    them at its next save, and until then finds its scenes by their recorded identity."""
    if _saving["to"] != bpy.data.filepath:
        if bpy.data.filepath != _saving["from"]:
            move(bpy.data.filepath)
        else:
            for root, name, value, record in _saving["before"]:
                setattr(root.pags, name, value)
                root.pags.record = record
    _saving.update({"targets": [], "before": []})


@persistent
def after_change(scene, depsgraph=None):
    meshes.changed(depsgraph)
    overlay.changed()


@persistent
def after_frame(*_):
    meshes.changed(None)
    overlay.changed()


HANDLERS = (
    (bpy.app.handlers.load_post, after_load),
    (bpy.app.handlers.save_pre, before_save),
    (bpy.app.handlers.save_post, after_save),
    (bpy.app.handlers.depsgraph_update_post, after_change),
    (bpy.app.handlers.frame_change_post, after_frame),
)


def on_register():
    viewport.start_timer()


def on_unregister():
    viewport.stop_timer()
    native.close()
    draw.clear()
