# SPDX-License-Identifier: GPL-3.0-or-later
"""Why a control of the interface has no effect: a sentence, or "" if it has one."""

import os
import textwrap

from . import native, whereabouts


def entries(context):
    """The loaded PAGS scenes in the Blender scene."""
    roots = [o for o in context.scene.objects if o.pags.kind == "ROOT"]
    found = [native.known(whereabouts.absolute_path(root)) for root in roots]
    return [entry for entry in found if entry is not None]


def critical(context):
    """For *Critical only* and the mode that shows critical objects in orange."""
    loaded = entries(context)
    if loaded and not any(record["critical"] for entry in loaded for record in entry.objects):
        return "the scene has no vehicles, pedestrians or cyclists"
    return ""


def exposure(context):
    """For *Recorded exposure*."""
    camera = context.scene.camera
    if camera is None or camera.type != "CAMERA" or camera.data.pags.sensor < 0 or camera.pags.root is None:
        return "the scene's camera is not from the recording"
    entry = native.known(whereabouts.absolute_path(camera.pags.root))
    return "" if entry is None or entry.exposed else "training found no exposures in this recording"


def harmonics(context):
    """For *SH degree*."""
    return "" if context.scene.pags.mode == "rgb" else "view-dependent colours appear only with Show: Colour"


def several(context):
    """Whether there is more than one scene."""
    return sum(o.pags.kind == "ROOT" for o in context.scene.objects) > 1


def recording(root):
    """For imports of recorded data other than the scene."""
    try:
        entry = native.entry(whereabouts.absolute_path(root), False)
    except native.SceneError:
        return "the scene can't be read"
    return "the scene has no photographs" if entry.scene is not None and not entry.views else ""


def photographs(context, root):
    """For commands that go to photographs and show them."""
    said = recording(root)
    if said:
        return said
    if not any(o.pags.kind == "CAMERA" and o.pags.root == root for o in context.scene.objects):
        return "the scene was imported without its cameras"
    return ""


def drive(context, root):
    """For a camera along the drive."""
    said = photographs(context, root)
    if not said and not any(o.pags.kind == "EGO" and o.pags.root == root for o in context.scene.objects):
        return "the car did not move in this recording"
    return said


def folder(root):
    """For commands that write a new scene folder."""
    path = whereabouts.absolute_path(root)
    return (
        ""
        if os.path.isdir(path) or not os.path.exists(path)
        else "this is a splat file, not a scene folder; Export writes it"
    )


def count(number, thing):
    """A number with its noun: "1 object", "2 objects"."""
    return f"{number:,} {thing}{'' if number == 1 else 's'}"


def explain(layout, text, icon="INFO", width=32):
    """Shows a text in lines that fit a panel at its default width."""
    column = layout.column(align=True)
    for number, line in enumerate(textwrap.wrap(text, width)):
        column.label(text=line, icon=icon if number == 0 else "BLANK1")
