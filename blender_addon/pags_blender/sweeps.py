# SPDX-License-Identifier: GPL-3.0-or-later
"""LiDAR sweeps as points that follow the timeline, coloured by height, intensity or distance to the splats.

The engine knows the format of the sweeps' files. Sweeps are read, and distances computed, ahead of the timeline in a thread; a step only exchanges points."""

import os
import re
import threading

import bpy
import gpu
import numpy as np
from bpy.app.handlers import persistent
from gpu_extras.batch import batch_for_shader

from . import cameras, draw, jobs, native, overlay, photographs, registry, whereabouts

POSES = {"ego": "ego_pose", "laser": "lidar_pose", "world": None}
# Linear, from low to high.
PALETTE = np.array(((0.13, 0.18, 0.55), (0.1, 0.55, 0.6), (0.45, 0.8, 0.3), (0.98, 0.9, 0.15)))
SIDE = 512  # pixels of a side of the cube of depths around the car
NEAR = 4  # pixels around one whose mean depth counts
FAR = 0.5  # metres: the highest colour of a distance
KEPT = 100  # sweeps in memory, some 2 MB each
TICK = 0.02

_sets, _batches, _shown = {}, {}, {}


class Sweeps:
    """The sweeps of a scene's data set: files by time, and their format."""

    def __init__(self, root, entry):
        self.entry, self.origin = entry, np.array(entry.info["origin"])
        places = photographs.places(root, entry)
        self.folder = next((p for p in places if os.path.isdir(os.path.join(p, "lidar"))), None)
        if self.folder is None:
            searched = f"looked in {', '.join(places)}" if places else "the scene names no data set"
            raise native.SceneError(f"found no folder lidar: {searched}; {photographs.FIELD}")
        try:
            self.columns, self.position, self.frame, self.intensity = native.module.sweep_format(self.folder)
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
        # Seconds for which a sweep is shown before and after its time.
        self.half = 0.75 * float(np.median(np.diff(self.times))) if len(found) > 1 else 0.05
        self.kept, self.thread = {}, None  # (points, colours) by number of the sweep and kind of colours

    def path(self, step):
        return os.path.join(self.folder, "lidar", step + ".bin")

    def read(self, number):
        """Points (n, 3) of a sweep, float32, relative to the scene's origin, and their intensities or None."""
        path = self.path(self.steps[number])
        data = np.fromfile(path, dtype="<f4")
        if len(data) % self.columns:
            raise native.SceneError(
                f"{path}: {4 * len(data)} bytes, expected a multiple of {4 * self.columns} ({self.columns} floats per row)"
            )
        rows = data.reshape(-1, self.columns)
        points = rows[:, list(self.position)].astype(np.float64)
        if POSES[self.frame]:
            where = os.path.join(self.folder, POSES[self.frame], self.steps[number] + ".txt")
            try:
                with open(where, encoding="utf-8") as file:
                    pose = np.array([float(word) for word in file.read().replace(",", " ").split()]).reshape(4, 4)
            except ValueError as error:
                raise native.SceneError(f"{where}: expected 16 numbers, 4 x 4 ({error})") from error
            points = points @ pose[:3, :3].T + pose[:3, 3]
        points = points - self.origin
        good = np.isfinite(points).all(axis=1)
        return points[good].astype(np.float32), rows[good, self.intensity] if self.intensity >= 0 else None

    def nearest(self, time):
        """The index of the sweep at a time; -1 if none is near."""
        number = int(np.argmin(np.abs(np.array(self.times) - time)))
        return number if abs(self.times[number] - time) <= self.half else -1

    # ---- Colours ----

    def colored(self, number, kind, up, threads):
        """Points and linear colours (n, 4) of a sweep."""
        points, intensities = self.read(number)
        if kind == "DISTANCE":
            values, low, high = self.distances(points, self.times[number], threads), 0, FAR
        elif kind == "INTENSITY" and intensities is not None:
            values, low, high = intensities, *np.percentile(intensities, (2, 98))
        else:
            values = points @ np.array(up, dtype=np.float32)
            low, high = np.percentile(values, (5, 95)) if len(values) else (0, 1)
        share = np.clip((values - low) / max(high - low, 1e-3), 0, 1) * (len(PALETTE) - 1)
        colors = np.ones((len(points), 4), dtype=np.float32)
        for c in range(3):
            colors[:, c] = np.interp(share, np.arange(len(PALETTE)), PALETTE[:, c])
        return points, colors

    def distances(self, points, time, threads):
        """Metres from each point to the surface of the splats that is drawn in its direction from the car; infinite where nothing is drawn.

        It is the smaller of two: along the ray to the drawn depth, and to the plane around it. In a picture of a plane the inverse depth w is linear:
        w = a x / z + b y / z + c, where the plane is a x + b y + c z = 1. As all of a Gaussian has one depth, w is the mean of a few pixels."""
        last = min(abs(v["time"] - time) for v in self.entry.views if "time" in v)
        views = [v for v in self.entry.views if "time" in v and abs(v["time"] - time) <= last + 1e-6]
        eye = np.mean([np.array(v["world_from_camera"]).reshape(3, 4)[:, 3] for v in views], axis=0) - self.origin
        away = points - eye
        face, out = face_of(away), np.full(len(points), np.inf)
        for number, axes, picture in cube(self.entry, eye, time, threads, ("depth",), SIDE):
            here = np.flatnonzero(face == number)
            local, depth = away[here] @ axes, np.asarray(picture.depth).astype(np.float64)
            drawn = depth > 0
            inverse = np.where(drawn, 1 / np.maximum(depth, 1e-6), 0)
            with np.errstate(divide="ignore", invalid="ignore"):
                mean = around(inverse, NEAR) / around(drawn.astype(np.float64), NEAR)
                ray = local[:, :2] / local[:, 2:]
                cell = (SIDE / 2 * (1 + ray)).astype(int)
                x, y = np.clip(cell, NEAR, SIDE - 1 - NEAR).T
                slope_x = (mean[y, x + NEAR] - mean[y, x - NEAR]) * SIDE / (4 * NEAR)
                slope_y = (mean[y + NEAR, x] - mean[y - NEAR, x]) * SIDE / (4 * NEAR)
                at = (np.stack([x, y], axis=1) + 0.5) * 2 / SIDE - 1
                plane = np.stack([slope_x, slope_y, mean[y, x] - slope_x * at[:, 0] - slope_y * at[:, 1]], axis=1)
                to_plane = np.abs((plane * local).sum(axis=1) - 1) / np.linalg.norm(plane, axis=1)
                x, y = np.clip(cell, 0, SIDE - 1).T
                along = np.abs(depth[y, x] - local[:, 2]) * np.linalg.norm(local, axis=1) / local[:, 2]
            out[here] = np.where(drawn[y, x], np.fmin(to_plane, along), np.inf)
        return out

    def take(self, number, kind, up, threads, wait):
        """Points and colours of a sweep, or None while a thread prepares them, which also prepares the next sweep."""
        key = (number, kind)
        if key not in self.kept and wait:
            self.keep(key, up, threads)
        ahead = [k for k in (key, (number + 1, kind)) if k not in self.kept and k[0] < len(self.times)]
        if ahead and not wait and (self.thread is None or not self.thread.is_alive()):
            self.thread = threading.Thread(target=self.prepare, args=(ahead, up, threads), daemon=True)
            self.thread.start()
            registry.start(tick, TICK)
        found = self.kept.get(key)
        if isinstance(found, Exception):
            raise found
        return found

    def keep(self, key, up, threads):
        self.kept[key] = self.colored(*key, up, threads)
        for old in list(self.kept)[:-KEPT]:
            del self.kept[old]

    def prepare(self, keys, up, threads):
        for key in keys:
            try:
                self.keep(key, up, threads)
            except (native.SceneError, native.module.Error, OSError, MemoryError) as error:
                self.kept[key] = (
                    error if isinstance(error, (native.SceneError, OSError)) else native.SceneError(str(error))
                )


def around(plane, reach):
    """Sum of the values within `reach` pixels of each pixel, to all sides."""
    size = 2 * reach + 1
    sums = np.pad(plane, ((reach + 1, reach), (reach + 1, reach))).cumsum(axis=0).cumsum(axis=1)
    return sums[size:, size:] - sums[:-size, size:] - sums[size:, :-size] + sums[:-size, :-size]


def face_of(directions):
    """Number of the cube's face that each direction meets: two per axis, the positive side first."""
    largest = np.abs(directions).argmax(axis=-1)
    return 2 * largest + (np.take_along_axis(directions, largest[..., None], -1)[..., 0] < 0)


def cube(entry, eye, time, threads, outputs, side, **arguments):
    """Yields the six pictures around a point (relative to the scene's origin): number of the face, its axes as columns (right, down, forward), picture."""
    for number in range(6):
        forward = np.eye(3)[number // 2] * (1 - 2 * (number % 2))
        right = np.eye(3)[(number // 2 + 1) % 3]
        axes = np.stack([right, np.cross(forward, right), forward], axis=1)
        pose = np.hstack([axes, (eye + np.array(entry.info["origin"]))[:, None]])
        camera = {"width": side, "height": side, "fx": side / 2, "fy": side / 2, "cx": side / 2, "cy": side / 2}
        camera.update(world_from_camera=[float(v) for v in pose.ravel()], time=time)
        job = native.renderer("cube", threads).submit(entry.scene, camera, outputs=outputs, **arguments)
        yield number, axes, job.take()


# ---- The object ----


def sweeps_of(root, entry):
    key = (root.name, entry)
    if key not in _sets:
        _sets.clear()
        _sets[key] = Sweeps(root, entry)
    return _sets[key]


def put(block, points, colors):
    """Replaces the points of a LiDAR object."""
    mesh = block.data
    mesh.clear_geometry()
    mesh.vertices.add(len(points))
    if len(points):
        mesh.vertices.foreach_set("co", points.reshape(-1))
    mesh.update()
    _shown[mesh.name_full] = points, colors
    _batches.pop(mesh.name_full, None)


def show_sweep(block, scene):
    """Loads the sweep at the current time into a LiDAR object. In a window it never waits: until a sweep is ready, the last one stays."""
    root, kind = block.parent, scene.pags.lidar_color
    if root is None or root.pags.kind != "ROOT":
        return
    entry = native.entry(whereabouts.absolute_path(root), False)
    if entry.scene is None:
        return
    sweeps = sweeps_of(root, entry)
    number = sweeps.nearest(entry.time_of(root, scene.frame_current_final))
    if [number, kind] == [block.get("pags_sweep"), block.get("pags_colors")] and block.data.name_full in _shown:
        return
    found = np.zeros((0, 3), dtype=np.float32), np.zeros((0, 4), dtype=np.float32)
    if number >= 0:
        up = np.array(root.matrix_world)[2, :3]
        found = sweeps.take(number, kind, up, scene.pags.threads, bpy.app.background)
    if found is not None:
        put(block, *found)
        block["pags_sweep"], block["pags_colors"] = number, kind
        block["pags_lidar"] = sweeps.steps[number] if number >= 0 else ""


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


def tick():
    """Shows sweeps that a thread has prepared."""
    busy = any(s.thread is not None and s.thread.is_alive() for s in _sets.values())
    for scene in bpy.data.scenes:
        after_frame(scene)
        blocks = [
            o for o in scene.objects if "pags_lidar" in o and not o.hide_viewport and o.get("pags_sweep", -2) >= -1
        ]
        busy = busy or any(o.data.name_full not in _shown for o in blocks)
    draw.again()
    return TICK if busy else None


def after_load():
    """After opening a file: its sweeps appear once its scenes are loaded."""
    registry.start(tick, TICK)


def forget():
    for kept in (_sets, _batches, _shown):
        kept.clear()


class PAGS_OT_lidar(jobs.Long, cameras.OnScene, bpy.types.Operator):
    """Show the recording's LiDAR sweeps as points along the timeline"""

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
            return f"{len(sweeps.times)} sweeps in {sweeps.folder}"

        return work


def on_draw():
    """Draws the points of LiDAR objects: Blender would show the vertices of a mesh without faces as black dots."""
    context = bpy.context
    blocks = [o for o in context.visible_objects or () if "pags_lidar" in o and o.data.name_full in _shown]
    if not blocks:
        return
    shader = overlay.point_shader()
    gpu.state.depth_test_set("LESS_EQUAL")
    gpu.state.point_size_set(2.0)
    for block in blocks:
        name = block.data.name_full
        if name not in _batches:
            points, colors = _shown[name]
            _batches[name] = batch_for_shader(shader, "POINTS", {"pos": points, "color": colors})
        if len(_shown[name][0]):
            with gpu.matrix.push_pop():
                gpu.matrix.multiply_matrix(block.matrix_world)
                _batches[name].draw(shader)
    gpu.state.depth_test_set("NONE")


HANDLERS = ((bpy.app.handlers.frame_change_post, after_frame),)
DRAWN = ((on_draw, "POST_VIEW"),)
TIMERS = (tick,)


def on_unregister():
    forget()
