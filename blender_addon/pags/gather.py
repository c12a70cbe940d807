# SPDX-License-Identifier: GPL-3.0-or-later
"""Collects from Blender's state what the engine has to draw: the parts of a scene, their poses, the time and the render settings."""

import numpy as np

from . import lens, native

IDENTITY = [1.0, 0, 0, 0, 0, 1.0, 0, 0, 0, 0, 1.0, 0]
NOWHERE = [np.nan] * 12
# A part whose pose differs from its track by no more than this is drawn exactly at the track's pose: Blender's matrices have float precision.
SNAP_METRES, SNAP_ROTATION = 2e-3, 3e-4


class Gathered:
    """State of one PAGS scene on which a picture depends, difference from camera and time."""

    def __init__(self, root):
        self.root_name, self.path = root.name, native.absolute_path(root)
        self.world_from_root = lens.matrix(root.matrix_world)
        self.root_from_world = np.linalg.inv(self.world_from_root)
        self.scale = lens.rigid(self.world_from_root)[1]
        self.frame_start, self.fps = root.pags.frame_start, root.pags.fps
        self.indices, self.poses = [], []  # of each part: object index (-1: background) and root_from_object, 4x4
        self.keys = []  # of each part: its object's name, and what tells instances apart
        self.pass_index = {}
        self.scaled = False

    def add(self, index, matrix_world, pass_index, key):
        self.indices.append(index)
        self.keys.append(key)
        self.poses.append([v for row in matrix_world for v in row])
        self.pass_index[index] = pass_index

    def finish(self):
        """Stacks the poses of all parts into one array: thousands of small arrays would cost more than the rest of a redraw."""
        order = np.argsort(self.indices, kind="stable")
        self.indices = np.array(self.indices)[order]
        self.keys = [self.keys[i] for i in order]
        poses = self.root_from_world @ np.array(self.poses, dtype=np.float64).reshape(-1, 4, 4)[order]
        lengths = np.linalg.norm(poses[:, :3, :3], axis=1)
        lengths[lengths == 0] = 1
        poses[:, :3, :3] /= lengths[:, None, :]
        self.poses = poses
        self.scaled = bool((np.abs(lengths.mean(axis=1) - 1) > 1e-3).any())
        self.identity = (
            self.path,
            self.world_from_root.tobytes(),
            self.fps,
            self.frame_start,
            self.indices.tobytes(),
            poses.tobytes(),
        )
        return self

    def key(self):
        return self.identity


def roots(depsgraph):
    """The objects of a Blender scene that are roots of PAGS scenes."""
    return [o for o in depsgraph.scene.objects if o.pags.kind == "ROOT"]


def gather(depsgraph):
    """The state of the first visible PAGS scene by name, or None, and the number of visible PAGS scenes."""
    found = {}
    for instance in depsgraph.object_instances:
        drawn = instance.object
        settings = drawn.original.pags
        if settings.kind not in {"BACKGROUND", "OBJECT"} or settings.root is None:
            continue
        if instance.is_instance and not instance.show_self:
            continue
        root = settings.root
        state = found.get(root.name)
        if state is None:
            state = found[root.name] = Gathered(root.evaluated_get(depsgraph))
        index = -1 if settings.kind == "BACKGROUND" else settings.index
        key = (drawn.original.name, tuple(instance.persistent_id) if instance.is_instance else ())
        state.add(index, instance.matrix_world, drawn.original.pass_index, key)
    if not found:
        return None, 0
    return found[sorted(found)[0]].finish(), len(found)


def time_of(state, entry, frame):
    """The scene's time in seconds at a (fractional) frame of the timeline."""
    return entry.info["time_begin"] + (frame - state.frame_start) / state.fps


def known_parts(state, entry, critical_only=False):
    """Whether each part is drawn."""
    known = state.indices < len(entry.objects)  # higher indices come from another version of the scene file
    if critical_only:
        critical = np.array([*(bool(o["critical"]) for o in entry.objects), False])  # the last entry is the background, index -1
        known &= critical[np.where(known, state.indices, -1)]
    return known


def keys(state, entry, critical_only=False):
    """The keys of the parts in `placements`."""
    return [key for key, known in zip(state.keys, known_parts(state, entry, critical_only)) if known]


def placements(state, entry, time, critical_only=False):
    """Pairs (index, world_from_object) of all parts; a part that was not moved gets the exact pose of its track."""
    known = known_parts(state, entry, critical_only)
    indices, poses = state.indices[known], state.poses[known, :3]
    mine, origin = indices[:, None] >= 0, np.array(entry.info["origin"])
    found = [entry.scene.pose(int(i), time) if i >= 0 else IDENTITY for i in indices]
    exact = np.array([NOWHERE if pose is None else pose for pose in found]).reshape(-1, 3, 4)
    difference = np.abs(exact - poses)
    difference[:, :, 3] = np.abs(exact[:, :, 3] - np.where(mine, origin, 0) - poses[:, :, 3])
    same = (difference[:, :, :3] < SNAP_ROTATION).all(axis=(1, 2)) & (difference[:, :, 3] < SNAP_METRES).all(axis=1)
    moved = poses.copy()  # poses relative to the scene's origin; the background is rotated about that origin
    moved[:, :, 3] += np.where(mine, origin, origin - poses[:, :, :3] @ origin)
    rows = np.where(same[:, None, None], exact, moved).reshape(-1, 12).tolist()
    return list(zip(indices.tolist(), rows))


def camera_for(state, entry, lens_values, world_from_camera, time):
    """The engine's camera (a dictionary) of a camera pose in Blender's world."""
    pose, _ = lens.rigid(state.root_from_world @ world_from_camera)
    pose[:3, 3] += np.array(entry.info["origin"])
    out = {key: lens_values[key] for key in ("width", "height", "fx", "fy", "cx", "cy")}
    out["world_from_camera"] = lens.pose12(pose)
    out["time"] = time
    return out


def object_values(state, entry):
    """Values of the object-index pass by object: Blender's pass index, or 0 where the object was deleted."""
    return [float(state.pass_index.get(i, 0)) for i in range(len(entry.objects))]


def job_arguments(settings, state, entry, final):
    """Keyword arguments of Renderer.submit from the scene's settings."""
    out = {"linear": True, "flip": True, "mode": settings.mode, "sh_degree": settings.sh_degree}
    out["exp_degree"] = 5 if final or settings.exact else 3
    if settings.antialiased != "SCENE":
        out["antialiased"] = int(settings.antialiased == "ON")
    out["depth_scale"] = state.scale
    out["early_z"] = settings.early_z if settings.early_z != "bounded" else f"bounded={settings.early_z_eps:.6f}"
    return out


def exposure(settings, entry, camera, time):
    """Keyword argument with the exposure of a recorded camera (a Blender object or None) at a time."""
    if not settings.exposure or camera is None or camera.type != "CAMERA" or camera.data.pags.sensor < 0:
        return {}
    return {"exposure": entry.scene.exposure(camera.data.pags.sensor, time)}


def load(state, wait):
    return native.entry(state.path, wait)
