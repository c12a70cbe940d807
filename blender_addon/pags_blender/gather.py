# SPDX-License-Identifier: GPL-3.0-or-later
"""Collects from Blender the state that the engine renders: visible scenes, their parts and poses, time and render settings.

All visible scenes are rendered in one frame, in the world of the leading scene: of the scenes with a sky (or of all, if none has one) that of the active
camera, else the first by name. Sky, background and near plane are those of the leading scene."""

import numpy as np

from . import cleanup, lens, native, whereabouts

IDENTITY = [1.0, 0, 0, 0, 0, 1.0, 0, 0, 0, 0, 1.0, 0]
NOWHERE = [np.nan] * 12
# A part within this distance of its track is drawn exactly at the track's pose: Blender's matrices have single precision.
SNAP_METRES, SNAP_ROTATION = 2e-3, 3e-4
ROUNDING = 2e-5  # column lengths of a matrix within this distance of 1 count as a rotation in single precision
FLAT = 1e-9  # a matrix with a smaller determinant, relative to the cube of its longest column, flattens the object


def flattened(matrices):
    """For each 4x4 matrix, whether it is singular: it maps space to a plane, a line or a point."""
    longest = np.linalg.norm(matrices[:, :3, :3], axis=1).max(axis=1)
    return ~(np.abs(np.linalg.det(matrices[:, :3, :3])) > FLAT * longest**3)


class Gathered:
    """The state of one PAGS scene that determines a picture, except camera and time."""

    def __init__(self, root, depsgraph):
        self.root_name = root.original.name_full
        self.path, self.remark, _ = whereabouts.locate(root.original)
        self.rules = cleanup.rules_of(root, -1, depsgraph, everything=True)
        self.world_from_root = lens.matrix(root.matrix_world)
        self.frame_start, self.fps = root.pags.frame_start, root.pags.fps
        # For each part: key, object index (-1: background) and root_from_object, 4x4.
        self.keys, self.indices, self.poses = [], [], []
        self.pass_index, self.looks = {}, {}

    def add(self, key, drawn, index, matrix_world):
        """key: name of the Blender object and of its instance, the same at every frame."""
        self.keys.append(key)
        self.indices.append(index)
        self.poses.append([v for row in matrix_world for v in row])
        self.pass_index[index] = drawn.original.pass_index

    def add_rules(self, drawn, index, depsgraph):
        """Clean-up and look of an object or of the background. If several Blender objects represent one part, the first by name that has any counts."""
        found = cleanup.rules_of(drawn, index, depsgraph)
        if found and (index not in self.looks or drawn.name < self.looks[index][0]):
            self.looks[index] = (drawn.name, found)

    def finish(self):
        """Stacks the poses of all parts into one array: thousands of small arrays would dominate the time of a redraw. Returns the names of parts omitted
        because their scale flattens them."""
        self.edits = cleanup.text_of(
            self.rules + [rule for index in sorted(self.looks) for rule in self.looks[index][1]]
        )
        if flattened(self.world_from_root[None])[0]:
            self.indices, self.keys = np.zeros(0, dtype=int), []
            return [self.root_name]
        order = np.argsort(self.indices, kind="stable")
        poses = np.linalg.inv(self.world_from_root) @ np.array(self.poses, dtype=np.float64).reshape(-1, 4, 4)[order]
        lengths = np.linalg.norm(poses[:, :3, :3], axis=1)
        poses[:, :3, :3] /= np.where(np.abs(lengths - 1) < ROUNDING, lengths, 1)[:, None, :]
        flat = flattened(poses)
        keys = [self.keys[i] for i in order]
        self.indices, self.poses = np.array(self.indices)[order][~flat], poses[~flat]
        self.keys = [key for key, left_out in zip(keys, flat) if not left_out]
        arrays = [array.tobytes() for array in (self.world_from_root, self.indices, self.poses)]
        self.identity = (self.path, self.edits, self.fps, self.frame_start, *arrays)
        return [key[0] for key, left_out in zip(keys, flat) if left_out]


class Visible:
    """All visible PAGS scenes; `flat`: names of the parts and scenes omitted because their scale flattens them."""

    def __init__(self, scenes, camera_root):
        self.flat = [name for scene in scenes for name in scene.finish()]
        self.scenes = [scene for scene in scenes if len(scene.indices)]
        self.camera_root = camera_root
        self.frame = None
        self.strangers, self.ignored = [], []  # objects that are not drawn, and settings of parts

    def key(self):
        return (self.camera_root, *(scene.identity for scene in self.scenes))

    def making(self):
        """Whether a scene still shows the state before the last change of its clean-up and look."""
        return any(native.is_making(scene.path, scene.root_name, scene.edits) for scene in self.scenes)

    def load(self, wait):
        """The Frame of all scenes; None while one is loading (wait=False). Raises SceneError if one can't be loaded."""
        entries = [native.edited(scene.path, scene.root_name, scene.edits, wait) for scene in self.scenes]
        if any(entry.loading or entry.scene is None for entry in entries):
            return None
        if self.frame is None or self.stamp != entries:

            def rank(pair):
                scene, entry = pair
                return not entry.info["sky"], hollow(scene, entry), scene.root_name != self.camera_root

            scenes, ordered = zip(*sorted(zip(self.scenes, entries), key=rank))
            self.stamp, self.frame = entries, Frame(list(scenes), list(ordered), self.flat)
        return self.frame


class Frame:
    """The scenes of one frame, ready to render: `scenes` and `entries` in the order of pick results, the leading scene first."""

    def __init__(self, scenes, entries, flat, lent=None):
        """lent: whether only the sky of the leading scene is used as leading, since its scale isn't uniform; its Gaussians then follow as another scene.
        None: to be determined."""
        self.lead, self.entry, self.flat = scenes[0], entries[0], flat
        self.hollow = self.entry.info["sky"] and hollow(self.lead, self.entry)
        self.origin = np.array(self.entry.info["origin"])
        world_from_frame, self.scale = lens.rigid(self.lead.world_from_root)
        self.turn = world_from_frame[:3, :3].copy()
        world_from_frame[:3, :3] *= self.scale
        self.frame_from_world = np.linalg.inv(world_from_frame)
        self.lent = lent
        if lent is None:
            self.lent = not np.allclose(world_from_frame, self.lead.world_from_root, rtol=0, atol=1e-6 * self.scale)
            if self.lent:
                scenes, entries = [self.lead, *scenes], [self.entry, *entries]
        self.scenes, self.entries = scenes, entries

    @property
    def gaussians(self):
        return sum(entry.info["gaussians"] for entry in self.entries[self.lent :])

    def at(self, visible):
        """The same scenes in another state of Blender; scenes missing there keep this state."""
        found = {(scene.root_name, scene.path): scene for scene in visible.scenes} if visible is not None else {}
        scenes = [found.get((scene.root_name, scene.path), scene) for scene in self.scenes]
        return Frame(scenes, self.entries, self.flat, self.lent)

    def time(self, k, frame):
        """Scene k's time in seconds at a (fractional) frame of the timeline; constant for a scene without duration."""
        info = self.entries[k].info
        if info["time_end"] <= info["time_begin"]:
            return info["time_begin"]
        return self.entries[k].info["time_begin"] + (frame - self.scenes[k].frame_start) / self.scenes[k].fps

    def clips(self, planes):
        """Planes of Blender's world in the leading scene's coordinates, for the engine, or None."""
        out = np.array(planes, dtype=np.float64).reshape(-1, 4) @ np.linalg.inv(self.frame_from_world)
        out[:, 3] -= out[:, :3] @ self.origin
        return tuple(map(tuple, out.tolist())) or None

    def camera(self, lens_values, world_from_camera, frame):
        """The engine's camera (a dictionary) for a camera pose in Blender's world."""
        pose, _ = lens.rigid(self.frame_from_world @ world_from_camera)
        pose[:3, 3] += self.origin
        out = {key: lens_values[key] for key in ("width", "height", "fx", "fy", "cx", "cy")}
        out["world_from_camera"] = lens.pose12(pose)
        out["time"] = self.time(0, frame)
        return out

    def parts(self, k, frame, critical_only=False):
        """Keys and placements of the drawn parts of scene k."""
        if k == 0 and self.lent or self.entries[k].bare:
            return [], []
        scene, entry = self.scenes[k], self.entries[k]
        known = known_parts(scene, entry, critical_only)
        keys = [key for key, here in zip(scene.keys, known) if here]
        return keys, placements(scene, entry, self.time(k, frame), known)

    def contents(self, frame, drawn, object_values=False):
        """Keyword arguments of submit, render and pick. drawn: placements of each scene; object_values: include the values of the object pass."""
        found = []
        for k, (scene, entry) in enumerate(zip(self.scenes, self.entries)):
            own = {"placements": drawn[k]}
            if object_values:  # 0: deleted
                own["object_values"] = [float(scene.pass_index.get(i, 0)) for i in range(len(entry.objects))]
            if k > 0:
                own.update(scene=entry.scene, time=self.time(k, frame), world_from_scene=self.world_from_scene(k))
            found.append(own)
        return {**found[0], "others": found[1:]}

    def contents_at(self, frame, critical_only=False):
        """The same keyword arguments for a frame of the timeline."""
        return self.contents(frame, [self.parts(k, frame, critical_only)[1] for k in range(len(self.scenes))])

    def world_from_scene(self, k):
        """From scene k's absolute coordinates to those of the leading scene, 12 numbers."""
        out = self.frame_from_world @ self.scenes[k].world_from_root
        out[:3, 3] += self.origin - out[:3, :3] @ np.array(self.entries[k].info["origin"])
        return lens.pose12(out)

    def exposure(self, settings, camera, frame):
        """Keyword argument with the exposure of a recorded camera (a Blender object or None)."""
        if not settings.exposure or camera is None or camera.type != "CAMERA" or camera.data.pags.sensor < 0:
            return {}
        name = camera.original.pags.root.name_full if camera.original.pags.root is not None else ""
        k = next((k for k, scene in enumerate(self.scenes) if scene.root_name == name), 0)
        return {"exposure": self.entries[k].scene.exposure(camera.data.pags.sensor, self.time(k, frame))}

    def counts(self, stats):
        """Text on the Gaussians of a picture from its statistics; the first number is the total that the sidebar shows."""
        told, absent = f"{self.gaussians:,} Gaussians", self.gaussians - stats["gaussians"]
        if absent:
            told += f", {absent:,} absent at this time" if absent > 0 else f", {stats['gaussians']:,} with duplicates"
        told += f", {stats['gaussians'] - stats['shaded']:,} culled, {stats['ms']:.0f} ms"
        early = stats["in_view"] - stats["loaded"] + stats["hidden"]
        return told + (f" ({early:,} by Early-Z)" if early > 0 else "")

    def remarks(self, settings):
        """A note on several scenes and omitted parts; empty if neither applies."""
        count, behind = len({scene.root_name for scene in self.scenes}), ""
        if own_background(settings, self) is None:
            behind = f", {'sky' if self.entry.info['sky'] else 'background'} of {self.lead.root_name}"
        drawn = list(zip(self.scenes, self.entries))[self.lent :]
        said = [f"{count} scenes{behind}"] if count > 1 else []
        said += [f"clean-up and look hide all of {scene.root_name}" for scene, entry in drawn if entry.bare]
        said += [f"omitted, since a scale of 0 flattens them: {', '.join(self.flat[:3])}"] if self.flat else []
        return "; ".join(said)


def hollow(scene, entry):
    """Whether a scene has background Gaussians that aren't drawn. Its sky shows a ghost of the street where training saw only the background."""
    plain = native.known(scene.path) or entry
    return plain.background > 0 and (entry.bare or entry.background == 0 or -1 not in scene.indices)


PARTS = {"BACKGROUND", "OBJECT"}  # kinds of objects that represent Gaussians
SOLIDS = {"MESH", "CURVE", "CURVES", "SURFACE", "META", "FONT", "POINTCLOUD", "VOLUME", "GPENCIL", "GREASEPENCIL"}


def instances(depsgraph, hidden=frozenset()):
    """All visible instances of objects. hidden: full names of objects hidden in one 3D view."""
    for instance in depsgraph.object_instances:
        if instance.is_instance and not instance.show_self:
            continue
        owner = instance.parent if instance.is_instance and instance.parent is not None else instance.object
        if not hidden or owner.original.name_full not in hidden:
            yield instance


def hidden_in(space, depsgraph):
    """Full names of the view layer's objects hidden in a 3D view: outside of its local view, or in hidden local collections or kinds."""
    if space.local_view is None and not space.use_local_collections and space.show_object_viewport_mesh:
        return frozenset()
    # Only evaluated objects know whether they are in a local view.
    layer = depsgraph.view_layer.objects
    return frozenset(o.name_full for o in layer if not o.evaluated_get(depsgraph).visible_in_viewport_get(space))


def gather(depsgraph, hidden=frozenset(), only="", without=""):
    """The visible PAGS scenes, or None. only, without: full names of roots to include or exclude, for the wipe between scenes."""
    found, strangers, ignored = {}, set(), set()
    for instance in instances(depsgraph, hidden):
        drawn = instance.object
        settings = drawn.original.pags
        if settings.kind not in PARTS or settings.root is None:
            if drawn.type in SOLIDS and not drawn.original.hide_render:
                strangers.add(drawn.original.name)
            continue
        root = settings.root
        if (only and root.name_full != only) or root.name_full == without:
            continue
        state = found.get(root.name_full)
        if state is None:
            state = found[root.name_full] = Gathered(root.evaluated_get(depsgraph), depsgraph)
        index = -1 if settings.kind == "BACKGROUND" else settings.index
        state.add_rules(drawn, index, depsgraph)
        key = (drawn.original.name, tuple(instance.persistent_id) if instance.is_instance else ())
        state.add(key, drawn, index, instance.matrix_world)
        if drawn.original.holdout_get(view_layer=depsgraph.view_layer):
            ignored.add("holdout of splats")
        if drawn.original.indirect_only_get(view_layer=depsgraph.view_layer):
            ignored.add("indirect only of splats")
    if not found:
        return None
    camera = depsgraph.scene.camera
    root = camera.original.pags.root if camera is not None else None
    visible = Visible([found[name] for name in sorted(found)], root.name_full if root is not None else "")
    visible.strangers, visible.ignored = sorted(strangers), sorted(ignored)
    return visible if visible.scenes else None


def known_parts(state, entry, critical_only):
    """Whether each part is drawn."""
    known = state.indices < len(entry.objects)  # higher indices come from another version of the scene file
    if critical_only:
        critical = np.array([*(bool(o["critical"]) for o in entry.objects), False])  # the last: background, index -1
        known &= critical[np.where(known, state.indices, -1)]
    return known


def placements(state, entry, time, known):
    """Pairs (index, world_from_object) of the known parts; unmoved parts get the exact pose of their track."""
    indices, poses = state.indices[known], state.poses[known, :3]
    mine, origin = indices[:, None] >= 0, np.array(entry.info["origin"])
    found = [entry.scene.pose(int(i), time) if i >= 0 else IDENTITY for i in indices]
    exact = np.array([NOWHERE if pose is None else pose for pose in found]).reshape(-1, 3, 4)
    difference = np.abs(exact - poses)
    difference[:, :, 3] = np.abs(exact[:, :, 3] - np.where(mine, origin, 0) - poses[:, :, 3])
    same = (difference[:, :, :3] < SNAP_ROTATION).all(axis=(1, 2)) & (difference[:, :, 3] < SNAP_METRES).all(axis=1)
    moved = poses.copy()  # poses relative to the scene's origin, about which the background is moved
    moved[:, :, 3] += np.where(mine, origin, origin - poses[:, :, :3] @ origin)
    rows = np.where(same[:, None, None], exact, moved).reshape(-1, 12).tolist()
    return list(zip(indices.tolist(), rows))


def own_background(settings, frame):
    """The colour that replaces the scene's sky or background, or None. With *Critical only*, and without the background's Gaussians, it is black."""
    if settings.use_background:
        return tuple(settings.background)
    return (0.0, 0.0, 0.0) if settings.hide_noncritical or frame.hollow else None


def job_arguments(settings, frame, final):
    """Keyword arguments of Renderer.submit from the Blender scene's settings."""
    out = {"linear": True, "flip": True, "mode": settings.mode, "sh_degree": settings.sh_degree}
    out["exp_degree"] = 5 if final else 3
    if settings.antialiased != "SCENE":
        out["antialiased"] = int(settings.antialiased == "ON")
    if (background := own_background(settings, frame)) is not None:
        out["background"] = background
    out["depth_scale"] = frame.scale
    out["early_z"] = settings.early_z if settings.early_z != "bounded" else f"bounded={settings.early_z_eps:.6f}"
    return out
