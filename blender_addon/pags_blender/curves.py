# SPDX-License-Identifier: GPL-3.0-or-later
"""Writes keyframes in bulk, for Blenders with fcurves on actions (up to 4.x) and with layered actions (5.x)."""

import bpy
import numpy as np
from mathutils import Matrix


def all_of(block):
    """The fcurves of an ID's own action; none without one."""
    data = block.animation_data
    if data is None or data.action is None:
        return []
    if hasattr(data.action, "fcurves"):
        return list(data.action.fcurves)
    from bpy_extras import anim_utils

    bag = anim_utils.action_get_channelbag_for_slot(data.action, data.action_slot)
    return list(bag.fcurves) if bag is not None else []


def frames_of(curve):
    """Frames of a curve's keyframes and their handles: left handle, key, right handle of each."""
    out = np.empty((3, 2 * len(curve.keyframe_points)), dtype=np.float32)
    for values, name in zip(out, ("handle_left", "co", "handle_right")):
        curve.keyframe_points.foreach_get(name, values)
    return out[:, 0::2].T.ravel().astype(np.float64)


def set_frames(curve, frames):
    """The inverse of `frames_of`."""
    values = np.empty(2 * len(curve.keyframe_points), dtype=np.float32)
    for name, own in zip(("handle_left", "co", "handle_right"), frames.reshape(-1, 3).T):
        curve.keyframe_points.foreach_get(name, values)
        values[0::2] = own
        curve.keyframe_points.foreach_set(name, values)
    curve.update()


def fcurve_owner(block):
    """The object whose `new` creates fcurves for the ID's own action; creates the action if missing."""
    data = block.animation_data or block.animation_data_create()
    if data.action is None:
        data.action = bpy.data.actions.new(block.name)
    slots = getattr(data.action, "slots", None)
    if slots is not None and data.action_slot is None:
        data.action_slot = slots[0] if slots else slots.new(block.id_type, block.name)
    if hasattr(data.action, "fcurves"):
        return data.action.fcurves
    from bpy_extras import anim_utils

    return anim_utils.action_ensure_channelbag_for_slot(data.action, data.action_slot).fcurves


def remove(block, path):
    """Removes the keyframes of one property."""
    for curve in [c for c in all_of(block) if c.data_path == path]:
        fcurve_owner(block).remove(curve)


def set_curve(block, path, index, frames, values, interpolation="LINEAR"):
    """Replaces the keyframes of one channel."""
    owner = fcurve_owner(block)
    old = owner.find(path, index=index)
    if old:
        owner.remove(old)
    curve = owner.new(path, index=index)
    curve.keyframe_points.add(len(frames))
    flat = np.empty(2 * len(frames), dtype=np.float32)
    flat[0::2], flat[1::2] = frames, values
    curve.keyframe_points.foreach_set("co", flat)
    code = curve.keyframe_points[0].bl_rna.properties["interpolation"].enum_items[interpolation].value
    curve.keyframe_points.foreach_set("interpolation", np.full(len(frames), code, dtype=np.int32))
    curve.update()
    return curve


def quaternions(rotations):
    """Quaternions (n, 4) w x y z of rotations (n, 3, 3), with signs that interpolate along the shorter arc."""
    out = np.array([list(Matrix(r.tolist()).to_quaternion()) for r in rotations])
    for i in range(1, len(out)):
        if out[i] @ out[i - 1] < 0:
            out[i] = -out[i]
    return out


def set_track(block, frames, poses):
    """Sets location and rotation keyframes of an object; poses (n, 3, 4) in its parent's frame. A single pose is set without keyframes."""
    block.rotation_mode = "QUATERNION"
    turns = quaternions(poses[:, :, :3])
    block.location, block.rotation_quaternion = poses[0, :, 3], turns[0]
    if len(frames) < 2:
        return
    for k in range(3):
        set_curve(block, "location", k, frames, poses[:, k, 3])
    for k in range(4):
        set_curve(block, "rotation_quaternion", k, frames, turns[:, k])


def set_lens(camera, frames, views):
    """Keyframes of focal length and principal point, if they change from view to view."""
    values = np.array([[v["fx"] * 36, v["width"] / 2 - v["cx"], v["cy"] - v["height"] / 2] for v in views])
    values /= np.array([[v["width"]] for v in views])
    for path, own in zip(("lens", "shift_x", "shift_y"), values.T if np.ptp(values, axis=0).max() > 1e-9 else ()):
        set_curve(camera, path, 0, frames, own)


def set_visibility(block, begin, end):
    """Keyframes that show a data block in viewport and renders from frame `begin` to before frame `end`."""
    for path in ("hide_viewport", "hide_render"):
        set_curve(block, path, 0, [begin - 1, begin, end], [1, 0, 1], "CONSTANT")
