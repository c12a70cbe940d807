# SPDX-License-Identifier: GPL-3.0-or-later
"""Imports further recorded data on demand: LiDAR sweeps as points that follow the timeline, labelled boxes as wire objects along their tracks, held-out time
steps as markers of the timeline.

The engine knows the format of the sweeps' files."""

import os
import re

import bpy
import gpu
import numpy as np
from bpy.app.handlers import persistent
from gpu_extras.batch import batch_for_shader

from . import cameras, curves, jobs, native, overlay, photographs, whereabouts

POSES = {"ego": "ego_pose", "laser": "lidar_pose", "world": None}
MARKER = "held out"
HEIGHTS = ((0.13, 0.18, 0.55), (0.1, 0.55, 0.6), (0.45, 0.8, 0.3), (0.98, 0.9, 0.15))  # linear colours from low to high
CORNERS = [(x, y, z) for x in (-0.5, 0.5) for y in (-0.5, 0.5) for z in (-0.5, 0.5)]
BOX_EDGES = [(a, b) for a in range(8) for b in range(a) if bin(a ^ b).count("1") == 1] + [
    (8, 9)
]  # the last edge: from the centre to the front

_sets, _batches = {}, {}
_handle = None


# ---- Sweeps ----


class Sweeps:
    """The sweeps of a scene's data set: files by time, and their format."""

    def __init__(self, root, entry):
        self.origin = np.array(entry.info["origin"])
        places = photographs.places(root, entry)
        self.folder = next((p for p in places if os.path.isdir(os.path.join(p, "lidar"))), None)
        if self.folder is None:
            searched = f"looked in {', '.join(places)}" if places else "the scene names no data set"
            raise native.SceneError(f"found no folder lidar: {searched}; {photographs.FIELD}")
        try:
            self.columns, self.position, self.frame = native.module.sweep_format(self.folder)
        except native.module.Error as error:
            raise native.SceneError(str(error)) from error
        steps = {}
        for view in entry.scene.views:
            if "time" in view:
                digits = len(re.match(r"\d*", os.path.basename(view["name"])).group()) or 3
                steps.setdefault(f"{view['frame']:0{digits}d}", view["time"])
        found = [(time, step) for step, time in steps.items() if os.path.isfile(self.path(step))]
        if not found:
            raise native.SceneError(
                f"{os.path.join(self.folder, 'lidar')}: no sweep for the scene's {len(steps)} time steps, such as {self.path(min(steps, default='000'))}"
            )
        self.times, self.steps = (list(column) for column in zip(*sorted(found)))
        self.half = (
            0.75 * float(np.median(np.diff(self.times))) if len(found) > 1 else 0.05
        )  # seconds for which a sweep is shown before and after its time

    def path(self, step):
        return os.path.join(self.folder, "lidar", step + ".bin")

    def read(self, number):
        """Points (n, 3) of a sweep, float32, relative to the scene's origin."""
        path = self.path(self.steps[number])
        data = np.fromfile(path, dtype="<f4")
        if len(data) % self.columns:
            raise native.SceneError(
                f"{path}: {4 * len(data)} bytes, expected a multiple of {4 * self.columns} ({self.columns} floats per row)"
            )
        points = data.reshape(-1, self.columns)[:, list(self.position)].astype(np.float64)
        if POSES[self.frame]:
            where = os.path.join(self.folder, POSES[self.frame], self.steps[number] + ".txt")
            try:
                pose = np.array([float(word) for word in open_text(where).replace(",", " ").split()]).reshape(4, 4)
            except ValueError as error:
                raise native.SceneError(f"{where}: expected 16 numbers, 4 x 4 ({error})") from error
            points = points @ pose[:3, :3].T + pose[:3, 3]
        points = points - self.origin
        return points[np.isfinite(points).all(axis=1)].astype(np.float32)

    def nearest(self, time):
        """The index of the sweep at a time; -1 if none is near."""
        number = int(np.argmin(np.abs(np.array(self.times) - time)))
        return number if abs(self.times[number] - time) <= self.half else -1


def open_text(path):
    with open(path, encoding="utf-8") as file:
        return file.read()


def sweeps_of(root, entry):
    key = (root.name, entry)
    if key not in _sets:
        _sets.clear()
        _sets[key] = Sweeps(root, entry)
    return _sets[key]


def put(block, points, up):
    """Replaces a mesh's content with these points, coloured by height."""
    mesh = block.data
    mesh.clear_geometry()
    mesh.vertices.add(len(points))
    if len(points):
        mesh.vertices.foreach_set("co", points.reshape(-1))
        heights = points @ np.array(up, dtype=np.float32)
        low, high = np.percentile(heights, (5, 95))
        share = np.clip((heights - low) / max(high - low, 1e-3), 0, 1)
        colors = np.ones((len(points), 4), dtype=np.float32)
        for c in range(3):
            colors[:, c] = np.interp(share, np.linspace(0, 1, len(HEIGHTS)), [color[c] for color in HEIGHTS])
        attribute = mesh.attributes.get("Col") or mesh.attributes.new("Col", "FLOAT_COLOR", "POINT")
        attribute.data.foreach_set("color", colors.reshape(-1))
    mesh.update()
    _batches.pop(mesh.name_full, None)


def show_sweep(block, scene):
    """Loads the sweep at the current time into a LiDAR object. Never waits: while a scene loads, the sweep stays unchanged."""
    root = block.parent
    if root is None or root.pags.kind != "ROOT":
        return
    entry = native.entry(whereabouts.absolute_path(root), False)
    if entry.scene is None:
        return
    sweeps = sweeps_of(root, entry)
    number = sweeps.nearest(
        entry.info["time_begin"] + (scene.frame_current_final - root.pags.frame_start) / root.pags.fps
    )
    if number != block.get("pags_sweep"):
        points = sweeps.read(number) if number >= 0 else np.zeros((0, 3), dtype=np.float32)
        put(block, points, np.array(root.matrix_world)[2, :3])
        block["pags_sweep"], block["pags_lidar"] = number, sweeps.steps[number] if number >= 0 else ""


@persistent
def after_frame(scene, *_):
    if bpy.app.is_job_running("RENDER"):
        return  # Blender's data must not change during a render, which ignores sweeps anyway
    for block in scene.objects:
        if "pags_lidar" in block and not block.hide_viewport:
            try:
                show_sweep(block, scene)
            except (native.SceneError, OSError) as error:
                block["pags_sweep"], block["pags_lidar"] = -2, str(error)


def forget():
    _sets.clear()
    _batches.clear()


class PAGS_OT_lidar(jobs.Long, cameras.OnScene, bpy.types.Operator):
    """Show the recording's LiDAR sweeps as points, coloured by height, along the timeline"""

    bl_idname = "pags.lidar"
    bl_label = "LiDAR sweeps"
    bl_options = {"REGISTER", "UNDO"}

    def steps(self, context, root):
        path, scene = whereabouts.absolute_path(root), context.scene

        def work(job):
            entry = yield jobs.in_thread(native.load, path)
            forget()
            sweeps = sweeps_of(root, entry)
            photographs.tell(job, root, entry)
            yield jobs.in_thread(sweeps.read, 0)  # errors in reading come before any change
            job.changes = True
            block = next((o for o in scene.objects if "pags_lidar" in o and o.parent == root), None)
            if block is None:
                name = f"{root.name} LiDAR"
                block = bpy.data.objects.new(name, bpy.data.meshes.new(name))
                root.users_collection[0].objects.link(block)
                block.parent, block.hide_render, block.display_type = root, True, "BOUNDS"
            block["pags_lidar"], block["pags_sweep"] = "", -3
            show_sweep(block, scene)
            return f"{len(sweeps.times)} sweeps in {sweeps.folder}; now {len(block.data.vertices):,} points"

        return work


def on_draw():
    """Draws the points of LiDAR objects: Blender would show the vertices of a mesh without faces as black dots."""
    context = bpy.context
    blocks = [o for o in context.visible_objects or () if "pags_lidar" in o and len(o.data.vertices)]
    shader = overlay.point_shader() if blocks else None
    if shader is None:
        return
    gpu.state.depth_test_set("LESS_EQUAL")
    gpu.state.point_size_set(2.0)
    for block in blocks:
        mesh = block.data
        if mesh.name_full not in _batches:
            points, colors = (
                np.empty(3 * len(mesh.vertices), dtype=np.float32),
                np.ones(4 * len(mesh.vertices), dtype=np.float32),
            )
            mesh.vertices.foreach_get("co", points)
            mesh.attributes["Col"].data.foreach_get("color", colors)
            _batches[mesh.name_full] = batch_for_shader(
                shader, "POINTS", {"pos": points.reshape(-1, 3), "color": colors.reshape(-1, 4)}
            )
        with gpu.matrix.push_pop():
            gpu.matrix.multiply_matrix(block.matrix_world)
            _batches[mesh.name_full].draw(shader)
    gpu.state.depth_test_set("NONE")


# ---- Boxes ----


class PAGS_OT_boxes(jobs.Long, cameras.OnScene, bpy.types.Operator):
    """Show the labelled boxes of all objects as wire along their recorded tracks, independent of edits in this file"""

    bl_idname = "pags.boxes"
    bl_label = "Labelled boxes"
    bl_options = {"REGISTER", "UNDO"}

    def steps(self, context, root):
        path, scene = whereabouts.absolute_path(root), context.scene

        def work(job):
            entry = yield jobs.in_thread(native.load, path)
            if not entry.objects:
                raise native.SceneError(f"{root.name}: the scene has no labelled objects")
            job.changes = True
            name = f"{root.name} boxes"
            collection = next(
                (c for c in scene.collection.children_recursive if c.get("pags_boxes") == root.name), None
            )
            if collection is None:
                collection = bpy.data.collections.new(name)
                collection["pags_boxes"] = root.name
                scene.collection.children.link(collection)
            for block in list(collection.objects):
                bpy.data.objects.remove(block)
            frame = cameras.Frame(bpy.context, root)
            for index, record in enumerate(entry.objects):
                add_box(collection, frame, index, record)
                job.tell(index / len(entry.objects), "boxes")
                yield
            return f"{len(entry.objects)} boxes in the collection {collection.name}"

        return work


def add_box(collection, frame, index, record):
    """One box: edges, and a line on its floor from the centre to the front, which is +x."""
    mesh = bpy.data.meshes.new(f"box {record['id']}"[:60])
    size = record["size"]
    corners = [[a * b for a, b in zip(corner, size)] for corner in CORNERS]
    corners += [[0, 0, -0.5 * size[2]], [0.5 * size[0], 0, -0.5 * size[2]]]
    mesh.from_pydata(corners, BOX_EDGES, [])
    block = bpy.data.objects.new(mesh.name, mesh)
    collection.objects.link(block)
    block.parent, block.hide_render, block.display_type = frame.root, True, "WIRE"
    block["pags_box"], block["pags_class"] = record["id"], record["class"]
    rows = np.array(frame.scene.track(index)).reshape(-1, 13)
    if not record["tracked"] or len(rows) == 0:  # a parked box has one pose for all times
        poses, times = (
            np.array(frame.scene.pose(index, frame.info["time_begin"])).reshape(1, 3, 4),
            [frame.info["time_begin"]],
        )
    else:
        poses, times = rows[:, 1:].reshape(-1, 3, 4).copy(), rows[:, 0]
    poses[:, :, 3] -= frame.origin
    frames = [frame.frame_of(time) for time in times]
    curves.set_track(block, frames, poses)
    if record["tracked"] and len(frames) > 0:
        half = (
            float(np.median(np.diff(frames)) if len(frames) > 1 else frame.root.pags.fps / (frame.info["fps"] or 10))
            / 2
        )
        curves.set_curve(
            block,
            "hide_viewport",
            0,
            [frames[0] - half - 1, frames[0] - half, frames[-1] + half + 1e-3],
            [1, 0, 1],
            "CONSTANT",
        )


# ---- Held-out steps ----


class PAGS_OT_mark(cameras.OnScene, bpy.types.Operator):
    """Mark the time steps on the timeline whose photographs were held out from training; repeat to remove the marks"""

    bl_idname = "pags.mark_held_out"
    bl_label = "Mark held-out steps"
    bl_options = {"REGISTER", "UNDO"}

    def work(self, context, root):
        markers = context.scene.timeline_markers
        old = [marker for marker in markers if marker.name.startswith(MARKER)]
        for marker in old:
            markers.remove(marker)
        if old:
            return f"{len(old)} marks removed"
        frame, steps = cameras.Frame(context, root), {}
        for view in frame.scene.views:
            if "time" in view:
                steps.setdefault(int(round(frame.frame_of(view["time"]))), []).append(view)
        held_out = {at: [v for v in views if v["test"]] for at, views in steps.items()}
        held_out = {at: views for at, views in sorted(held_out.items()) if views}
        if not held_out:
            raise native.SceneError("no photograph of the recording was held out from training")
        for at, views in held_out.items():
            some = len(views) < len(steps[at])
            markers.new(MARKER + (": camera " + ", ".join(str(v["sensor"]) for v in views) if some else ""), frame=at)
        return f"{len(held_out)} held-out time steps marked"


def marked(scene):
    return any(marker.name.startswith(MARKER) for marker in scene.timeline_markers)


CLASSES = (PAGS_OT_lidar, PAGS_OT_boxes, PAGS_OT_mark)


def register():
    global _handle
    for cls in CLASSES:
        bpy.utils.register_class(cls)
    bpy.app.handlers.frame_change_post.append(after_frame)
    if not bpy.app.background:
        _handle = bpy.types.SpaceView3D.draw_handler_add(on_draw, (), "WINDOW", "POST_VIEW")


def unregister():
    global _handle
    if _handle is not None:
        bpy.types.SpaceView3D.draw_handler_remove(_handle, "WINDOW")
        _handle = None
    if after_frame in bpy.app.handlers.frame_change_post:
        bpy.app.handlers.frame_change_post.remove(after_frame)
    forget()
    for cls in reversed(CLASSES):
        bpy.utils.unregister_class(cls)
