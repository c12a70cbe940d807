# SPDX-License-Identifier: GPL-3.0-or-later
"""From Blender's state to what the engine is to draw: which parts of which scene, where, at what time."""

import numpy as np

from . import lens, native
from .properties import absolute_path

IDENTITY = [1.0, 0, 0, 0, 0, 1.0, 0, 0, 0, 0, 1.0, 0]
# A part that is no further than this from where the scene has it is drawn exactly there: Blender's matrices are floats.
SNAP_METRES, SNAP_ROTATION = 2e-3, 3e-4


class Gathered:
    """Everything of one scene that a picture depends on but camera and time."""

    def __init__(self, root):
        self.root_name, self.path = root.name, absolute_path(root)
        self.world_from_root = lens.matrix(root.matrix_world)
        self.root_from_world = np.linalg.inv(self.world_from_root)
        self.scale = lens.rigid(self.world_from_root)[1]
        self.frame_start, self.fps = root.pags.frame_start, root.pags.fps
        self.parts = []  # (index, root_from_object 4x4)
        self.pass_index = {}
        self.scaled = False

    def key(self):
        return (
            self.path,
            self.world_from_root.tobytes(),
            self.fps,
            self.frame_start,
            tuple((i, m.tobytes()) for i, m in self.parts),
        )


def roots(depsgraph):
    """Objects of the scene's that are roots of a PAGS scene."""
    return [o for o in depsgraph.scene.objects if o.pags.kind == "ROOT"]


def gather(depsgraph):
    """What the first PAGS scene that is drawn needs, or None; and how many scenes there are."""
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
        pose, scale = lens.rigid(state.root_from_world @ lens.matrix(instance.matrix_world))
        state.scaled |= abs(scale - 1) > 1e-3
        state.parts.append((index, pose))
        state.pass_index[index] = drawn.original.pass_index
    if not found:
        return None, 0
    first = found[sorted(found)[0]]
    first.parts.sort(key=lambda part: part[0])
    return first, len(found)


def time_of(state, entry, frame):
    """Seconds of the scene's clock at a frame of the timeline, which may be a fraction."""
    return entry.info["time_begin"] + (frame - state.frame_start) / state.fps


def placements(state, entry, time, critical_only=False):
    origin = np.array(entry.info["origin"])
    out = []
    for index, pose in state.parts:
        if index >= len(entry.objects):
            continue  # of another version of the scene file
        if critical_only and (index < 0 or not entry.objects[index]["critical"]):
            continue
        out.append((index, place(entry, index, pose, origin, time)))
    return out


def place(entry, index, pose, origin, time):
    if index < 0:
        if np.abs(pose - np.eye(4)).max() < SNAP_ROTATION:
            return IDENTITY
        moved = pose.copy()
        moved[:3, 3] += origin - pose[:3, :3] @ origin
        return lens.pose12(moved)
    exact = entry.scene.pose(index, time)
    if exact is not None:
        wanted = np.array(exact).reshape(3, 4)
        apart = np.abs(wanted[:, :3] - pose[:3, :3]).max(), np.abs(wanted[:, 3] - origin - pose[:3, 3]).max()
        if apart[0] < SNAP_ROTATION and apart[1] < SNAP_METRES:
            return list(exact)
    moved = pose.copy()
    moved[:3, 3] += origin
    return lens.pose12(moved)


def camera_for(state, entry, lens_values, world_from_camera, time):
    """The engine's camera for a camera in Blender's world."""
    pose, _ = lens.rigid(state.root_from_world @ world_from_camera)
    pose[:3, 3] += np.array(entry.info["origin"])
    out = {key: lens_values[key] for key in ("width", "height", "fx", "fy", "cx", "cy")}
    out["world_from_camera"] = lens.pose12(pose)
    out["time"] = time
    return out


def object_values(state, entry):
    """What the object-index pass holds for each object: Blender's own pass index where the object is there."""
    return [float(state.pass_index.get(i, 0)) for i in range(len(entry.objects))]


def wishes(settings, state, entry, final):
    """Keywords of Renderer.submit that the scene's settings ask for."""
    out = {"linear": True, "flip": True, "mode": settings.mode, "sh_degree": settings.sh_degree}
    out["exp_degree"] = 5 if final or settings.exact else 3
    if settings.antialiased != "SCENE":
        out["antialiased"] = int(settings.antialiased == "ON")
    out["depth_scale"] = state.scale
    out["early_z"] = settings.early_z if settings.early_z != "bounded" else f"bounded={settings.early_z_eps:.6f}"
    return out


def exposure(settings, entry, camera, time):
    """Keywords for what a camera of the recording (a Blender object or None) does to colours."""
    if not settings.exposure or camera is None or camera.type != "CAMERA" or camera.data.pags.sensor < 0:
        return {}
    return {"exposure": entry.scene.exposure(camera.data.pags.sensor, time)}


def load(state, wait):
    return native.entry(state.path, wait)
