# SPDX-License-Identifier: GPL-3.0-or-later
"""Places cameras: at a photograph's position, at the view, along the drive; writes and reads paths for `pags render --path`."""

import json
import os
import time

import bpy
import numpy as np
from bpy.props import BoolProperty, EnumProperty, FloatProperty, IntProperty, StringProperty
from bpy_extras.io_utils import ExportHelper, ImportHelper

from . import curves, jobs, lens, native, reasons, whereabouts


def root_of(context):
    """The root of the current PAGS scene: that of the active object, else of the scene camera, else the first root."""
    for candidate in (context.active_object, context.scene.camera):
        if candidate is not None and candidate.pags.kind != "NONE":
            return candidate if candidate.pags.kind == "ROOT" else candidate.pags.root
    return next((o for o in context.scene.objects if o.pags.kind == "ROOT"), None)


class OnScene:
    """Base of the operators on a PAGS scene. A subclass defines `work`, which returns the message to report; exceptions of the types in `errors` are reported
    as errors."""

    errors = (native.SceneError, OSError)

    def invoke(self, context, event):
        """Called from the interface: unlike in scripts, does not wait for a scene that is still loading."""
        root = root_of(context)
        if root is not None and native.is_loading(whereabouts.absolute_path(root)):
            self.report({"WARNING"}, "the scene is still loading; try again in a moment")
            return {"CANCELLED"}
        return self.asked(context, event)

    def asked(self, context, event):
        return self.execute(context)

    def execute(self, context):
        root = root_of(context)
        if root is None:
            self.report({"ERROR"}, "there is no PAGS scene in this file: File > Import > PAGS scene")
            return {"CANCELLED"}
        if remark := whereabouts.locate(root)[1]:
            self.report({"WARNING"}, remark)
        try:
            told = self.work(context, root)
        except self.errors as error:
            self.report({"ERROR"}, str(error))
            return {"CANCELLED"}
        if told:
            self.report({"INFO"}, told)
        return {"FINISHED"}


class Frame:
    """Converts between the scene's seconds and axes and Blender's frames and axes."""

    def __init__(self, context, root):
        self.root, self.context = root, context
        self.entry = native.load(whereabouts.absolute_path(root))
        self.info, self.scene = self.entry.info, self.entry.scene
        self.origin = np.array(self.info["origin"])

    def frame_of(self, time):
        return self.entry.frame_of(self.root, time)

    def time_of(self, frame):
        return self.entry.time_of(self.root, frame)

    def local(self, view):
        """4x4 pose of a view's camera relative to the root, in Blender's camera axes (x right, y up, looking along -z)."""
        pose = lens.view_matrix4(view)
        pose[:3, 3] -= self.origin
        return pose @ lens.FLIP

    def view_of(self, camera, frame, width, height, render):
        """The engine's camera (a dictionary) with the same view as a Blender camera."""
        values, pose = lens.of_camera(
            camera.data, camera.matrix_world, width, height, render.pixel_aspect_x, render.pixel_aspect_y
        )
        root = np.linalg.inv(lens.matrix(self.root.matrix_world))
        moved = root @ pose
        pose, scale = lens.rigid(moved)
        if not np.allclose(scale * pose[:3, :3], moved[:3, :3], rtol=0, atol=1e-4 * scale):
            raise lens.LensError(
                f"{self.root.name} is stretched or mirrored: no camera can represent this; set its scale to one positive value for all axes"
            )
        pose[:3, 3] += self.origin
        return {
            **{k: values[k] for k in ("width", "height", "fx", "fy", "cx", "cy")},
            "world_from_camera": lens.pose12(pose),
            "time": self.time_of(frame),
        }


def set_frame(scene, frame):
    whole = int(np.floor(frame + 1e-4))
    scene.frame_set(whole, subframe=float(min(max(frame - whole, 0), 0.9999)))


def along(job, scene, frames, visit):
    """Steps that call `visit(frame, depsgraph)` at each of the frames. Between steps the timeline returns to the user's frame."""
    users, away, end = scene.frame_current_final, False, time.perf_counter() + jobs.SLICE
    try:
        for number, frame in enumerate(frames):
            if time.perf_counter() > end:
                set_frame(scene, users)
                away = False
                job.tell(number / len(frames), "reading the timeline")
                yield
                if bpy.context.scene != scene:
                    raise native.SceneError("the active Blender scene has changed; try again")
                users, end = scene.frame_current_final, time.perf_counter() + jobs.SLICE
            away = True
            set_frame(scene, frame)
            visit(frame, bpy.context.evaluated_depsgraph_get())
    finally:
        if away:
            set_frame(scene, users)


# ---- Photographs' cameras ----


def camera_of(context, root, view):
    """The Blender camera of a view of the scene, or None."""
    cameras = [o for o in context.scene.objects if o.pags.kind == "CAMERA" and o.pags.root == root]
    by_name = [c for c in cameras if c.get("pags_view") == view["name"] and "pags_time" in c]
    by_sensor = [c for c in cameras if c.data.pags.sensor == view["sensor"]]
    same = [c for c in cameras if c.get("pags_view") == view["name"]]
    return next(iter((by_sensor if view["sensor"] >= 0 else []) + by_name + same), None)


def go_to(context, frame, view):
    """Goes to a view's time and looks through its camera."""
    camera = camera_of(context, frame.root, view)
    if camera is None:
        raise native.SceneError("the scene was imported without its cameras")
    context.scene.camera = camera
    if "time" in view:
        set_frame(context.scene, frame.frame_of(view["time"]))
    if getattr(context, "region_data", None) is not None:
        context.region_data.view_perspective = "CAMERA"


def view_at(context, frame, name="", step=0):
    """The view of this name or, without one, of the scene's camera nearest in time, `step` views on; None in a scene without views."""
    views = frame.scene.views
    if name:
        return next((v for v in views if v["name"] == name), None)
    current = context.scene.camera
    sensor = current.data.pags.sensor if current is not None and current.type == "CAMERA" else -1
    group = [v for v in views if v["sensor"] == sensor and "time" in v] or views
    if not group or "time" not in group[0]:
        return group[0] if group else None
    group = sorted(group, key=lambda v: v["time"])
    now = frame.time_of(context.scene.frame_current_final)
    nearest = min(range(len(group)), key=lambda i: abs(group[i]["time"] - now))
    return group[min(max(nearest + step, 0), len(group) - 1)]


class PAGS_OT_jump(OnScene, bpy.types.Operator):
    """Go to the time of a photograph and look through its camera"""

    bl_idname = "pags.jump"
    bl_label = "Jump to photograph"
    bl_options = {"REGISTER", "UNDO"}

    step: IntProperty(
        name="Step",
        description="Move this many photographs of the camera forward or back from the current time",
        default=0,
    )
    name: StringProperty(
        name="Photograph", description="File name of the photograph; empty: the nearest in time", default=""
    )

    def work(self, context, root):
        frame = Frame(context, root)
        view = view_at(context, frame, self.name, self.step)
        if view is None:
            raise native.SceneError(
                f"the scene has no photograph {self.name}" if self.name else "the scene has no photographs"
            )
        go_to(context, frame, view)
        return view["name"] + (" (held out)" if view["test"] else "")


class PAGS_OT_camera_here(bpy.types.Operator):
    """Add a camera at the current view and look through it"""

    bl_idname = "pags.camera_here"
    bl_label = "Camera at view"
    bl_options = {"REGISTER", "UNDO"}

    @classmethod
    def poll(cls, context):
        return context.region_data is not None

    def execute(self, context):
        region = context.region_data
        data = bpy.data.cameras.new("view")
        data.lens = context.space_data.lens / 2  # a 3D view's lens refers to a sensor of 72 mm, a camera's to 36 mm
        data.clip_end = 10000
        camera = bpy.data.objects.new("view", data)
        context.scene.collection.objects.link(camera)
        camera.matrix_world = region.view_matrix.inverted()
        context.scene.camera = camera
        region.view_perspective = "CAMERA"
        return {"FINISHED"}


class OfRecording:
    """Base of the operators on a camera of the recording."""

    @classmethod
    def poll(cls, context):
        camera = context.scene.camera
        cls.poll_message_set("the scene's camera is not from the recording; choose one with Nearest")
        return camera is not None and camera.type == "CAMERA" and camera.data.pags.width > 0


class PAGS_OT_size_of_camera(OfRecording, bpy.types.Operator):
    """Set the render size to that of the recording's camera"""

    bl_idname = "pags.size_of_camera"
    bl_label = "Recording's size"
    bl_options = {"REGISTER", "UNDO"}

    def execute(self, context):
        size, render = context.scene.camera.data.pags, context.scene.render
        render.resolution_x, render.resolution_y, render.resolution_percentage = size.width, size.height, 100
        return {"FINISHED"}


class PAGS_OT_ego_path(OnScene, bpy.types.Operator):
    """Add a camera that follows the recording car, shifted to another lane or height"""

    bl_idname = "pags.ego_path"
    bl_label = "Camera along the drive"
    bl_options = {"REGISTER", "UNDO"}

    lane: FloatProperty(
        name="Lane shift", description="Offset to the right in metres; negative: to the left", default=0, unit="LENGTH"
    )
    ahead: FloatProperty(name="Ahead", description="Metres forward", default=0, unit="LENGTH")
    height: FloatProperty(name="Height", description="Metres up", default=0, unit="LENGTH")
    turn: FloatProperty(name="Turn", description="Yaw to the left", default=0, subtype="ANGLE")
    sensor: IntProperty(
        name="Sensor", description="Sensor that provides lens and direction; -1: the first", default=-1, min=-1
    )

    def work(self, context, root):
        source = self.source(context, root)
        if source is None:
            raise native.SceneError("the scene was imported without its cameras, or the car did not move")
        camera = source.copy()
        camera.data = source.data.copy()
        camera.name = "drive"
        camera.animation_data_clear()
        rig = bpy.data.objects.new("drive rig", None)
        rig.empty_display_size = 0.5
        for block in (rig, camera):
            source.users_collection[0].objects.link(block)
        rig.parent = source.parent
        rig.location = (self.ahead, -self.lane, self.height)
        rig.rotation_euler = (0, 0, self.turn)
        camera.parent = rig
        for name in ("pags_view", "pags_test"):
            if name in camera:
                del camera[name]
        camera.pags.kind = "NONE"
        camera.location, camera.rotation_quaternion = source.location, source.rotation_quaternion
        context.scene.camera = camera

    def source(self, context, root):
        cameras = [o for o in context.scene.objects if o.pags.kind == "CAMERA" and o.pags.root == root]
        cameras = [o for o in cameras if o.parent and o.parent.pags.kind == "EGO"]
        cameras.sort(key=lambda o: o.data.pags.sensor)
        return next((c for c in cameras if self.sensor in (-1, c.data.pags.sensor)), None)


# ---- Path files ----


def record_of(view):
    """A view as an entry of camera and path files."""
    pose = np.linalg.inv(lens.view_matrix4(view))
    out = {k: view[k] for k in ("width", "height", "fx", "fy", "cx", "cy")}
    out["camera_from_world_quaternion_wxyz"] = list(quaternion(pose[:3, :3]))
    out["camera_from_world_translation"] = [float(v) for v in pose[:3, 3]]
    out["time"] = view["time"]
    return out


def quaternion(r):
    """Quaternion w x y z of a 3x3 rotation in double precision, which mathutils lacks: an eigenvector (Bar-Itzhack, J. Guidance 23(6), 2000)."""
    k = np.empty((4, 4))
    k[0, 0], k[1:, 1:] = np.trace(r), r + r.T - np.trace(r) * np.eye(3)
    k[0, 1:] = k[1:, 0] = r[2, 1] - r[1, 2], r[0, 2] - r[2, 0], r[1, 0] - r[0, 1]
    q = np.linalg.eigh(k)[1][:, 3]
    return [float(v) for v in (-q if q[0] < 0 else q)]


def rotation(q):
    w, x, y, z = np.array(q, dtype=np.float64) / np.linalg.norm(q)
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return np.eye(3) + 2 * (w * cross + cross @ cross)


class PAGS_OT_write_path(jobs.Long, OnScene, bpy.types.Operator, ExportHelper):
    """Write the scene's camera over the frame range as a path that "pags render --path" reads"""

    bl_idname = "export_scene.pags_path"
    bl_label = "Write camera path"

    filename_ext = ".json"
    filter_glob: StringProperty(default="*.json", options={"HIDDEN"})
    single: BoolProperty(name="Current frame", description="A camera file for pags render --camera", default=False)

    def invoke(self, context, event):
        self.by_hand = True
        return ExportHelper.invoke(self, context, event)

    def steps(self, context, root):
        scene, path, single = context.scene, self.filepath, self.single
        if scene.camera is None:
            raise native.SceneError("there is no camera in the scene")
        if os.path.exists(path) and not os.stat(path).st_mode & 0o222:  # refused even for root, which could write it
            raise native.SceneError(f"{path}: can't write: it is read-only")
        every = range(scene.frame_start, scene.frame_end + 1, scene.frame_step)
        numbers = [scene.frame_current_final] if single else every
        (width, height), scene_path = lens.picture_size(scene.render), whereabouts.absolute_path(root)

        def work(job):
            yield jobs.in_thread(native.load, scene_path)
            frame, found = Frame(bpy.context, root), []

            def visit(number, depsgraph):
                camera = scene.camera.evaluated_get(depsgraph)
                if camera.data.type != "PERSP":
                    raise lens.LensError("a path supports perspective cameras only")
                found.append(record_of(frame.view_of(camera, number, width, height, scene.render)))

            yield from along(job, scene, numbers, visit)
            record = found[0] if single else {"fps": scene.render.fps / scene.render.fps_base, "frames": found}
            yield jobs.in_thread(write_json, path, record)
            return f"{reasons.count(len(found), 'camera')} in {path}"

        return work


def write_json(path, record):
    with open(path, "w", encoding="utf-8") as file:
        json.dump(record, file, indent=1)


class PAGS_OT_read_path(OnScene, bpy.types.Operator, ImportHelper):
    """Make an animated camera from a camera or path file"""

    bl_idname = "import_scene.pags_path"
    bl_label = "Read camera path"
    bl_options = {"REGISTER", "UNDO"}

    filename_ext = ".json"
    filter_glob: StringProperty(default="*.json", options={"HIDDEN"})
    timing: EnumProperty(
        name="Timing",
        description="Frames at which to place the file's cameras",
        items=[
            ("FRAMES", "One per frame", "One camera per frame, from the start of the timeline"),
            ("TIMES", "By their times", "At the times stored in the file, in seconds of the scene"),
        ],
        default="TIMES",
    )

    def asked(self, context, event):
        return ImportHelper.invoke(self, context, event)

    def work(self, context, root):
        try:
            self.read(context, Frame(context, root))
        except (ValueError, KeyError, TypeError, IndexError) as error:
            raise native.SceneError(
                f"{self.filepath}: not a camera or path file ({type(error).__name__}: {error})"
            ) from error

    def read(self, context, frame):
        with open(self.filepath, encoding="utf-8") as file:
            data = json.load(file)
        records = data["frames"] if "frames" in data else [data]
        poses, lenses, frames = [], [], []
        for i, record in enumerate(records):
            turn = rotation(record["camera_from_world_quaternion_wxyz"])
            pose = np.eye(4)
            pose[:3, :3] = turn.T
            pose[:3, 3] = -turn.T @ np.array(record["camera_from_world_translation"], dtype=np.float64) - frame.origin
            poses.append((pose @ lens.FLIP)[:3])
            lenses.append({k: float(record[k]) for k in ("width", "height", "fx", "fy", "cx", "cy")})
            timed = self.timing == "TIMES" and "time" in record
            frames.append(frame.frame_of(float(record["time"])) if timed else context.scene.frame_start + i)
        if len(set(frames)) < len(frames):  # several poses at one time: give each its own frame
            frames = [context.scene.frame_start + i for i in range(len(frames))]
        self.make(context, frame.root, np.array(poses), lenses, frames)

    def make(self, context, root, poses, lenses, frames):
        data = bpy.data.cameras.new("path")
        lens.set_blender_lens(data, {**lenses[0], "width": int(lenses[0]["width"]), "height": int(lenses[0]["height"])})
        data.clip_end = 10000
        camera = bpy.data.objects.new("path", data)
        context.scene.collection.objects.link(camera)
        camera.parent = root
        curves.set_track(camera, frames, poses)
        curves.set_lens(data, frames, lenses)
        context.scene.camera = camera
