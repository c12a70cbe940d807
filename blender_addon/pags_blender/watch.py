# SPDX-License-Identifier: GPL-3.0-or-later
"""Reloads a scene when its files change on disk, for example during training. The old scene is drawn until then; objects moved, hidden, keyed or deleted in
Blender stay so. Objects are matched by their ids; unedited tracks take the new poses."""

import bpy
import numpy as np

from . import curves, draw, jobs, native, registry, whereabouts

PERIOD = 2.0  # seconds between checks of the files, and for which they must be unchanged

_changed = {}  # by path: a stamp that differs from the loaded one
_tried = {}  # by path: the loaded stamp


def due(path, entry):
    """Whether a scene's files have changed, and are unchanged since the last check."""
    stamp = whereabouts.stamp_of(path)
    if entry.loading or entry.scene is None or stamp is None or stamp == entry.stamp:
        _changed.pop(path, None)
        return False
    rested, _changed[path] = _changed.get(path) == stamp, stamp
    return rested and _tried.get(path) != stamp


def tick():
    windows = bpy.context.window_manager.windows
    if jobs.current is None and len(windows):
        for path, entry in list(native.cached.items()):
            if due(path, entry) and roots_of(path):
                with bpy.context.temp_override(window=windows[0]):
                    jobs.start("Scene", lambda job: read_anew(job, path))
                break
    return PERIOD


def roots_of(path):
    return [o for o in bpy.data.objects if o.pags.kind == "ROOT" and whereabouts.absolute_path(o) == path]


def read_anew(job, path):
    """Steps that load a scene and replace the old one."""
    job.tell(0, "reloading the changed scene")
    old, fresh = native.entry(path, False), native.Entry(path)
    _tried[path] = fresh.stamp
    yield jobs.in_thread(fresh.thread.join)
    yield jobs.in_thread(whereabouts.look, path)  # makes the next save faster
    if fresh.error:
        job.notes.append(f"{path} has changed, but can't be read ({fresh.error}); the previous version is shown")
        return None
    native.replace(path, fresh)
    told = [adopt(root, old, fresh) for root in roots_of(path)]
    draw.again()
    for scene in (s for s in bpy.data.scenes if s.pags_photographs):
        scene.pags_photographs_said = "the scene has changed since the list was made"
    before, now = old.info["gaussians"], fresh.info["gaussians"]
    return f"{path} was reloaded: {now:,} Gaussians, {before:,} before" + "".join(sorted(set(filter(None, told))))


def adopt(root, old, fresh):
    """Matches the Blender objects of a scene with the reloaded one; returns the message to report."""
    index_of = {record["id"]: index for index, record in enumerate(fresh.objects)}
    root["pags_gaussians"] = fresh.info["gaussians"]
    gone = 0
    for part in [o for o in bpy.data.objects if o.pags.kind == "OBJECT" and o.pags.root == root and "pags_id" in o]:
        before, index = part.pags.index, index_of.get(part["pags_id"])
        if index is None:
            index = len(fresh.objects) + max(before, 0)  # belongs to no object; nothing of it is drawn
            gone += 1
        else:
            part["pags_gaussians"] = fresh.objects[index]["gaussians"]
        track = part.parent if part.parent is not None and part.parent.pags.kind == "TRACK" else None
        if track is not None and index < len(fresh.objects) and before < len(old.objects):
            renew_track(root, track, old, before, fresh, index)
        for block in filter(None, (part, track)):
            if block.pags.index != index:
                block.pags.index = index
    more = sum(r["gaussians"] > 0 for r in fresh.objects) - sum(r["gaussians"] > 0 for r in old.objects)
    told = f"; objects removed from it: {gone}" if gone else ""
    return told + (f"; new objects: {more}; import it again to add them" if more > 0 else "")


def renew_track(root, track, old, old_index, fresh, index):
    """Replaces a track's poses if its keyframes are still those of the previously loaded scene."""
    if not (old.objects[old_index]["tracked"] and fresh.objects[index]["tracked"]):
        return
    times, poses = old.track(old_index)
    frames = old.frame_of(root, times)
    if len(frames) < 2:
        return
    wanted = [("location", k, poses[:, k, 3]) for k in range(3)]
    wanted += [("rotation_quaternion", k, values) for k, values in enumerate(curves.quaternions(poses[:, :, :3]).T)]
    known = {(curve.data_path, curve.array_index): curve for curve in curves.all_of(track)}
    for path, k, values in wanted:
        curve = known.get((path, k))
        if curve is None or len(curve.keyframe_points) != len(frames):
            return
        keyed = np.empty(2 * len(frames), dtype=np.float32)
        curve.keyframe_points.foreach_get("co", keyed)
        if not np.allclose(keyed.reshape(-1, 2), np.stack([frames, values], axis=1), rtol=0, atol=1e-3):
            return
    times, poses = fresh.track(index)
    curves.set_track(track, fresh.frame_of(root, times), poses)


TIMERS = (tick,)


def on_register():
    registry.start(tick, PERIOD, persistent=True)


def on_unregister():
    _changed.clear()
    _tried.clear()
