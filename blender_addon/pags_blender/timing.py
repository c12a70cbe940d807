# SPDX-License-Identifier: GPL-3.0-or-later
"""Retimes a scene: its first frame and frame rate, which set the time of its appearance, and the keyframes of everything that belongs to it change together.
Keyframes that are all moved or stretched by hand set first frame and frame rate."""

import bpy
import numpy as np
from bpy.app.handlers import persistent

from . import curves, native, whereabouts

MARKER = "held out"  # name of the timeline's markers of held-out steps (recording.py)
EXACT = 0.01  # frames within which keyframes follow one first frame and frame rate


def keyed(block):
    """Frames of an object's keyframes of location, or none."""
    curve = next((c for c in curves.all_of(block) if c.data_path == "location"), None)
    return curves.frames_of(curve)[1::3] if curve is not None else np.zeros(0)


def of_keys(root):
    """First frame and frame rate that the keyframes follow, or None: of the recording car or, without one, of the first object with a track."""
    entry = native.known(whereabouts.absolute_path(root))
    if entry is None:
        return None
    views = [v for v in entry.views if "time" in v and v["sensor"] >= 0]
    for block in sorted(
        (o for o in root.children_recursive if o.pags.kind in {"EGO", "TRACK"}), key=lambda o: o.pags.index
    ):
        if block.pags.kind == "EGO":
            first = min((v["sensor"] for v in views), default=-1)
            times = np.sort([v["time"] for v in views if v["sensor"] == first])
        elif entry.objects[block.pags.index]["tracked"] if block.pags.index < len(entry.objects) else False:
            times = entry.track(block.pags.index)[0]
        else:
            continue
        frames = keyed(block)
        if len(frames) != len(times) or len(times) < 2 or times[-1] <= times[0] or frames[-1] <= frames[0]:
            continue
        fps = (frames[-1] - frames[0]) / (times[-1] - times[0])
        if np.abs(frames - frames[0] - (times - times[0]) * fps).max() < EXACT:
            return float(frames[0] - (times[0] - entry.info["time_begin"]) * fps), float(fps)
    return None


def same(root, found):
    """Whether first frame and frame rate of a root are these, over the scene's length."""
    settings, info = root.pags, native.known(whereabouts.absolute_path(root)).info
    return all(
        abs(found[0] + t * found[1] - settings.frame_start - t * settings.fps) < EXACT
        for t in (0.0, info["time_end"] - info["time_begin"])
    )


def chosen(settings, context):
    """First frame or frame rate were set: the keyframes follow. Those of a library override are linked and can't, so that both stay as they are."""
    root = settings.id_data
    old, new = of_keys(root), (settings.frame_start, settings.fps)
    if old is None or same(root, old):
        return
    if root.override_library:
        settings.frame_start, settings.fps = old
    else:
        move(root, old, new)


def move(root, old, new):
    """Moves all keyframes of a scene, its photographs and its markers from one first frame and frame rate to another."""
    rate = new[1] / old[1]
    blocks = [root, *root.children_recursive]
    blocks += [o.data for o in blocks if o.type == "CAMERA"]
    actions = {}
    for block in blocks:
        if block.animation_data and block.animation_data.action and not block.animation_data.action.library:
            actions.setdefault(block.animation_data.action.name, block)
    for block in actions.values():
        for curve in curves.all_of(block):
            curves.set_frames(curve, new[0] + (curves.frames_of(curve) - old[0]) * rate)
    for data in (o.data for o in blocks if getattr(o, "type", "") == "CAMERA"):
        for shown in [b for b in data.background_images if b.image is not None and "pags_photographs" in b.image]:
            if abs(rate - 1) < 1e-6:
                shown.image_user.frame_start = int(round(new[0]))
            else:  # the sequence has one photograph per frame of the old rate
                data.background_images.remove(shown)
    for scene in root.users_scene:
        for marker in (m for m in scene.timeline_markers if m.name.startswith(MARKER)):
            marker.frame = int(round(new[0] + (marker.frame - old[0]) * rate))


@persistent
def after_change(scene, depsgraph=None):
    """Handler: keyframes may have been moved or stretched by hand."""
    if depsgraph is None or bpy.app.is_job_running("RENDER"):
        return
    if not any(
        isinstance(u.id, bpy.types.Action) or isinstance(u.id, bpy.types.Object) and u.id.pags.kind == "EGO"
        for u in depsgraph.updates
    ):
        return
    for root in (o for o in scene.objects if o.pags.kind == "ROOT" and o.library is None and not o.override_library):
        found = of_keys(root)
        if found is not None and not same(root, found):
            root.pags.frame_start, root.pags.fps = found


HANDLERS = ((bpy.app.handlers.depsgraph_update_post, after_change),)
