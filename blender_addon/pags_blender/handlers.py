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


_saving = {"from": "", "to": "", "before": []}  # the .blend's place before a save, where it goes, and the paths as they were: (root, property, value)


def move_paths(old, new):
    """Of the roots that this file owns, paths relative to the .blend, which goes from one place to another; returns what they were. Blender itself
    does so with the paths it knows."""
    before = []
    for root in bpy.data.objects:
        if root.pags.kind != "ROOT" or root.library is not None:
            continue
        for name in ("path", "dataset"):
            value = getattr(root.pags, name)
            if not value.startswith("//") or root.override_library and value == getattr(root.override_library.reference.pags, name):
                continue  # an override's is relative to its library
            place = os.path.normpath(os.path.join(os.path.dirname(old), value[2:]))
            before.append((root, name, value))
            try:
                setattr(root.pags, name, bpy.path.relpath(place, start=os.path.dirname(new)))
            except ValueError:  # on another drive of Windows, where no relative path exists
                setattr(root.pags, name, place)
    return before


@persistent
def before_save(*arguments):
    """Before saving: makes the scene paths of imports with *Relative path* relative, once the .blend has a path. Others stay as the user has them, but for
    relative ones where the .blend is saved elsewhere."""
    target = next((a for a in arguments if isinstance(a, str)), "")  # newer Blenders say where it goes
    blend = target or bpy.data.filepath
    _saving.update({"from": bpy.data.filepath, "to": blend, "before": []})
    if not blend:
        return
    if bpy.data.filepath and os.path.dirname(blend) != os.path.dirname(bpy.data.filepath):
        _saving["before"] = move_paths(bpy.data.filepath, blend)
    for root in bpy.data.objects:
        if root.pags.kind == "ROOT" and root.pags.relative and root.library is None:
            if os.path.isabs(root.pags.path):
                try:
                    root.pags.path = bpy.path.relpath(root.pags.path, start=os.path.dirname(blend))
                except ValueError:
                    pass  # on another drive of Windows, where no relative path exists
            root.pags.relative = False


@persistent
def after_save(*_):
    """After a copy was saved elsewhere the paths are again what they were. Where Blender didn't say where the file goes (up to 4.1) they are moved now;
    the file on the disk gets them when it is saved again."""
    if _saving["to"] != bpy.data.filepath and _saving["from"]:
        if bpy.data.filepath != _saving["from"]:
            move_paths(_saving["from"], bpy.data.filepath)
        else:
            for root, name, value in _saving["before"]:
                setattr(root.pags, name, value)
    _saving["before"] = []


@persistent
def after_change(*_):
    overlay.changed()


HANDLERS = (
    (bpy.app.handlers.load_post, after_load),
    (bpy.app.handlers.save_pre, before_save),
    (bpy.app.handlers.save_post, after_save),
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
