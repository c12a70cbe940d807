# SPDX-License-Identifier: GPL-3.0-or-later
"""Imports a scene folder or splat file as Blender objects: a root, the background, one object per track, cameras on the ego."""

import json
import os
import types

import bpy
import numpy as np
from bpy.props import BoolProperty, CollectionProperty, EnumProperty, StringProperty
from bpy_extras.io_utils import ImportHelper
from mathutils import Matrix, Quaternion, Vector

from . import curves, draw, exporter, guard, jobs, lens, native, photographs, program, proxies, reasons, whereabouts
from .properties import preview_budget

# Rotations from a file's up axis to Blender's z: quarter and half turns about x, or about y for files with x up.
FROM_UP = {
    "z": [[1, 0, 0], [0, 1, 0], [0, 0, 1]],
    "-z": [[1, 0, 0], [0, -1, 0], [0, 0, -1]],
    "y": [[1, 0, 0], [0, 0, -1], [0, 1, 0]],
    "-y": [[1, 0, 0], [0, 0, 1], [0, -1, 0]],
    "x": [[0, 0, -1], [0, 1, 0], [1, 0, 0]],
    "-x": [[0, 0, 1], [0, 1, 0], [-1, 0, 0]],
}
AS_STORED = "From the file; -Y, as most training programs write, for splat files that store none"
UP_AXES = [("AUTO", "As stored in the file", AS_STORED)]
UP_AXES += [(axis.upper(), axis.upper(), f"The file's {axis.upper()} axis points up") for axis in FROM_UP]
EMPTY_SIZE = 0.25  # metres, of the Empties of tracks
MAP = 20e3  # metres; scenes in map coordinates within this distance keep their relative position
FRAMED = 1.1  # size of a new camera's view relative to the framed content


# Custom properties of imported objects: description and subtype.
NOTES = {
    "id": ("Name of the object in the recording", None),
    "class": ("Class of the object in the recording", None),
    "category": ("Kind of the class", None),
    "critical": ("Whether quality has priority for this object: vehicles, pedestrians, cyclists", None),
    "gaussians": ("Number of Gaussians", None),
    "origin": ("Offset of all positions of a scene in map coordinates, metres", None),
    "up": ("Axis of those coordinates that points up", None),
    "size": ("Length, width and height of the labelled box, metres", "DISTANCE"),
    "view": ("File name of the photograph; for a sensor's camera, of its first one", None),
    "test": ("Whether the photograph was held out from training", None),
    "time": ("Seconds since the beginning of the scene", "TIME_ABSOLUTE"),
}


def note(block, key, value):
    """Sets a custom property with its description and unit."""
    name, (description, subtype) = "pags_" + key, NOTES[key]
    block[name] = value
    manager = block.id_properties_ui(name)
    try:
        manager.update(description=description, **({"subtype": subtype} if subtype else {}))
    except (TypeError, ValueError):  # a Blender without this subtype for custom properties
        manager.update(description=description)


class Import:
    """Imports one scene: creates its collection, root, parts, tracks and cameras."""

    def __init__(self, context, path, options, budget, replaces_camera):
        """options: the import operator's properties; points: size limit of the preview; replaces_camera: make a recorded camera the scene's camera even if
        there is one."""
        self.context, self.path, self.options, self.budget = context, path, options, budget
        self.replaces_camera = replaces_camera
        self.entry = native.load(path)
        self.scene, self.info, self.objects = self.entry.scene, self.entry.info, self.entry.objects
        self.origin = np.array(self.info["origin"])
        self.fps = context.scene.render.fps / context.scene.render.fps_base
        self.first = float(context.scene.frame_start)
        self.name = os.path.basename(os.path.normpath(path)) or "scene"
        up = self.info["up"] if options.up == "AUTO" else options.up.lower()
        self.up = up if up in FROM_UP else "z"
        self.turn = np.array(FROM_UP[self.up], dtype=np.float64)
        self.collection = self.root = None
        self.sensors = []  # cameras of sensors
        self.of_class = {}

    def run(self):
        """Steps that create everything."""
        self.collection = bpy.data.collections.new(self.name)
        self.context.scene.collection.children.link(self.collection)
        self.root = self.add_empty(self.name, "ROOT", None, 1.0)
        self.root.pags.path = self.path
        self.root.pags.frame_start, self.root.pags.fps = self.first, self.fps
        note(self.root, "gaussians", self.info["gaussians"])
        self.root.matrix_world = self.place()
        share = self.budget / max(1, self.info["gaussians"])
        background = self.entry.background
        if background > 0:
            part = self.add_part("background", -1, "BACKGROUND", self.root, background * share)
            note(part, "gaussians", background)
        for index, record in enumerate(self.objects):
            if record["gaussians"] > 0:
                self.add_object(index, record, record["gaussians"] * share)
                yield
        if self.options.cameras != "NONE":
            if self.scene.views:
                yield from self.add_cameras()
            else:
                self.add_framing_camera()
            mine, scene = [o for o in self.collection.objects if o.type == "CAMERA"], self.context.scene
            if mine and (scene.camera is None or self.replaces_camera):
                scene.camera = mine[0]

    def place(self):
        """Location of the root: zero, or for a scene in map coordinates its offset to the first such scene, unless that is too far for Blender's single
        precision."""
        turn = Matrix(self.turn.tolist()).to_4x4()
        if not self.origin.any():
            return turn
        note(self.root, "origin", self.origin.tolist())
        note(self.root, "up", self.up)
        roots = [o for o in self.context.scene.objects if o.pags.kind == "ROOT" and o != self.root]
        others = [o for o in roots if o.get("pags_up") == self.up]
        if not others:
            return turn
        apart = self.origin - np.array(others[0]["pags_origin"])
        return others[0].matrix_world @ Matrix.Translation(apart) if 0 < np.linalg.norm(apart) < MAP else turn

    def frame_of(self, time):
        return self.first + (np.asarray(time) - self.info["time_begin"]) * self.fps

    def link(self, block, kind, parent, collection=None):
        (collection or self.collection).objects.link(block)
        block.pags.kind = kind
        block.pags.root = self.root if self.root else None
        if parent is not None:
            block.parent = parent
        return block

    def collection_of(self, name):
        """The collection of a class below the scene's collection."""
        if name not in self.of_class:
            self.of_class[name] = bpy.data.collections.new(name[:60] or "objects")
            self.collection.children.link(self.of_class[name])
        return self.of_class[name]

    def add_empty(self, name, kind, parent, size, collection=None):
        empty = bpy.data.objects.new(name, None)
        empty.empty_display_type, empty.empty_display_size = ("PLAIN_AXES" if kind == "ROOT" else "ARROWS"), size
        return self.link(empty, kind, parent, collection)

    def add_part(self, name, index, kind, parent, budget, collection=None):
        points, colors = self.scene.points(index, int(budget)) if budget >= 1 else (np.zeros((0, 3)), np.zeros((0, 4)))
        points = np.ascontiguousarray(points, dtype=np.float32)
        mesh = bpy.data.meshes.new(name)
        mesh.vertices.add(len(points))
        mesh.vertices.foreach_set("co", points.reshape(-1))
        attribute = mesh.attributes.new("Col", "FLOAT_COLOR", "POINT")
        attribute.data.foreach_set("color", np.ascontiguousarray(colors, dtype=np.float32).reshape(-1))
        mesh.update()
        guard.remember(mesh)
        part = self.link(bpy.data.objects.new(name, mesh), kind, parent, collection)
        part.pags.index = index
        part.pass_index = index + 1
        part.display_type = "BOUNDS"  # Blender would draw vertices of a mesh without faces as black dots
        return part

    def add_object(self, index, record, budget):
        collection = self.collection_of(record["class"])
        name = f"{record['class'][: 59 - len(record['id'])]} {record['id']}"[:60]
        track = self.add_empty(name, "TRACK", self.root, EMPTY_SIZE, collection)
        track.pags.index = index
        part = self.add_part(record["id"][:60], index, "OBJECT", track, budget, collection)
        for key in NOTES:
            if key in record:
                note(part, key, record[key])
        times, poses = self.entry.track(index)
        curves.set_track(track, self.frame_of(times), poses)
        if record["tracked"]:
            self.limit(part, times)

    def limit(self, part, times):
        """Hides a part before and after its track; a track is valid for half a time step before its first and after its last pose."""
        step = float(np.median(np.diff(times)) if len(times) > 1 else 1 / (self.info["fps"] or 10)) / 2
        begin, end = float(times[0]) - step, float(times[-1]) + step
        if begin > self.info["time_begin"] + 1e-6 or end < self.info["time_end"] - 1e-6:
            curves.set_visibility(part, float(self.frame_of(begin)), float(self.frame_of(end)) + 1e-3)

    # ---- Cameras ----

    def add_cameras(self):
        views, rig = self.scene.views, {}
        for view in views:
            rig.setdefault(view["sensor"] if "time" in view else -1, []).append(view)
        recorded = {sensor: group for sensor, group in rig.items() if sensor >= 0}
        ego = self.add_ego(recorded[min(recorded)]) if recorded else None
        for sensor, group in sorted(recorded.items()):
            self.add_sensor(sensor, sorted(group, key=lambda v: v["time"]), ego)
            yield
        for view in views if self.options.cameras == "ALL" or not recorded else ():
            self.add_still(view)
            yield

    def add_framing_camera(self):
        """Adds a camera that frames a file without cameras, from the front, slightly right and above. Ignores the outermost twentieth of the points along
        each axis: trained splats have distant strays."""
        points = np.array(self.scene.points(-1, 20000)[0]).reshape(-1, 3) @ self.turn.T
        if not len(points):
            return
        low, high = np.percentile(points, 2.5, axis=0), np.percentile(points, 97.5, axis=0)
        middle, radius = (low + high) / 2, max(float(np.linalg.norm(high - low)) / 2, 1e-3)
        data = bpy.data.cameras.new("view of " + self.name)
        render = self.context.scene.render
        sides = render.resolution_x * render.pixel_aspect_x, render.resolution_y * render.pixel_aspect_y
        distance = FRAMED * radius / np.sin(np.arctan(min(sides) / max(sides) * data.sensor_width / (2 * data.lens)))
        data.clip_start, data.clip_end = distance / 1000, distance * 1000
        data.display_size = radius / 10
        towards = Vector((-0.5, 1.0, -0.35)).normalized()
        pose = (
            Matrix.Translation(Vector(middle.tolist()) - float(distance) * towards)
            @ towards.to_track_quat("-Z", "Y").to_matrix().to_4x4()
        )
        camera = self.link(bpy.data.objects.new(data.name, data), "CAMERA", self.root)
        camera.matrix_basis = self.root.matrix_world.inverted() @ pose

    def local_pose(self, view):
        pose = lens.view_matrix4(view)
        pose[:3, 3] -= self.origin
        return pose @ lens.FLIP

    def add_ego(self, group):
        """Adds the ego vehicle, an Empty at the positions of the first sensor, kept upright: x forward, z up."""
        group = sorted(group, key=lambda v: v["time"])
        poses = np.array([self.ego_pose(self.local_pose(view)) for view in group])
        ego = self.add_empty("ego", "EGO", self.root, 1.5)
        curves.set_track(ego, self.frame_of([v["time"] for v in group]), poses[:, :3])
        self.ego_times, self.ego_poses = np.array([v["time"] for v in group]), poses
        return ego

    def ego_pose(self, camera):
        up = self.turn[2]  # the scene's axis that becomes Blender's z
        forward = -camera[:3, 2]
        forward = forward - (forward @ up) * up
        size = np.linalg.norm(forward)
        forward = forward / size if size > 1e-6 else np.array([1.0, 0, 0])
        out = np.eye(4)
        out[:3, 0], out[:3, 1], out[:3, 2], out[:3, 3] = forward, np.cross(up, forward), up, camera[:3, 3]
        return out

    def ego_at(self, time):
        """4x4 pose of the ego at a time, interpolated between keyframes as in Blender; other sensors' poses are relative to it."""
        turns = curves.quaternions(self.ego_poses[:, :3, :3])
        columns = np.hstack([turns, self.ego_poses[:, :3, 3]]).T
        found = np.array([np.interp(time, self.ego_times, column) for column in columns])
        out = np.eye(4)
        out[:3, :3], out[:3, 3] = np.array(Quaternion(found[:4]).normalized().to_matrix()), found[4:]
        return out

    def new_camera(self, name, view, parent):
        data = bpy.data.cameras.new(name)
        lens.set_blender_lens(data, view)
        data.display_size, data.clip_start, data.clip_end = 0.5, 0.05, 10000
        data.show_passepartout = False  # would hide the street and costs 5 % of a redraw
        camera = self.link(bpy.data.objects.new(name, data), "CAMERA", parent)
        note(camera, "view", view["name"])
        note(camera, "test", view["test"])
        return camera

    def add_sensor(self, sensor, group, ego):
        camera = self.new_camera(f"camera {sensor}", group[0], ego)
        poses = [np.linalg.inv(self.ego_at(view["time"])) @ self.local_pose(view) for view in group]
        curves.set_track(camera, self.frame_of([v["time"] for v in group]), np.array(poses)[:, :3])
        curves.set_lens(camera.data, self.frame_of([v["time"] for v in group]), group)
        self.sensors.append(camera)

    def add_still(self, view):
        camera = self.new_camera(view["name"], view, self.root)
        curves.set_track(camera, [self.first], self.local_pose(view)[None, :3])
        if "time" in view:
            note(camera, "time", view["time"] - self.info["time_begin"])


def blend_is_empty(scene):
    """Whether the Blender scene has only the start-up objects, so that the import may set its frame rate, range and size."""
    return all(o.name in {"Cube", "Light", "Camera"} and not o.animation_data for o in scene.objects)


def adopt_rate(scene, fps):
    scene.render.fps = max(1, int(round(fps)))
    scene.render.fps_base = scene.render.fps / fps


def adopt_settings(scene, work, frame):
    """Applies the recording's settings to the Blender scene as chosen in the options; `frame`: including timeline range and render size."""
    info, views = work.info, work.scene.views
    span = info["time_end"] - info["time_begin"]
    if work.options.use_standard:
        scene.view_settings.view_transform = "Standard"
        scene.view_settings.look = "None"
    if frame and span > 0:
        scene.frame_end = int(np.ceil(work.first + span * work.fps - 1e-3))
    if frame and views:
        scene.render.resolution_x, scene.render.resolution_y = views[0]["width"], views[0]["height"]
        scene.render.resolution_percentage = 100


def look_through_camera(context):
    """Shows the import in all open 3D views: Rendered, through the scene's camera, fitted to the view."""
    for window, area, region in draw.regions():
        space = area.spaces.active
        space.shading.type = "RENDERED"
        space.clip_end = max(space.clip_end, 10000)
        if context.scene.camera is not None:
            space.region_3d.view_perspective = "CAMERA"
            with context.temp_override(window=window, area=area, region=region):
                bpy.ops.view3d.view_center_camera()


def scene_of(path):
    """The scene folder whose scene.json lists this splat file as a model, or None."""
    folder = os.path.dirname(path)
    for _ in range(3):  # models are in the folder itself or one below
        inner = os.path.join(folder, "scene.json")
        if os.path.isfile(inner):
            try:
                with open(inner, encoding="utf-8") as file:
                    models = [os.path.join(folder, model["file"]) for model in json.load(file)["models"]]
            except (OSError, ValueError, KeyError, TypeError):
                return None  # not one of our scenes
            here = os.path.normcase(os.path.normpath(path))
            return folder if here in [os.path.normcase(os.path.normpath(model)) for model in models] else None
        folder = os.path.dirname(folder)
    return None


def clear_views():
    """Turns off relationship lines and Blender's floor in all 3D views: the lines hide the street; the floor covers the road and costs a sixth of a redraw
    without a graphics card."""
    for area in (area for screen in bpy.data.screens for area in screen.areas if area.type == "VIEW_3D"):
        overlay = area.spaces.active.overlay
        overlay.show_relationship_lines = False
        overlay.show_floor = overlay.show_axis_x = overlay.show_axis_y = False


def bring_in(job, path, options, said):
    """Steps that import a scene. said: sentences for the report on the choice of the path."""
    entry = yield jobs.in_thread(native.load, path)  # an unreadable scene fails here, before any change
    yield jobs.in_thread(whereabouts.look, path)
    context, scene, fps = bpy.context, bpy.context.scene, entry.info["fps"]
    empty = blend_is_empty(scene)
    rate = fps > 0 and (options.use_rate == "YES" or (options.use_rate == "AUTO" and empty))
    if rate:
        adopt_rate(scene, fps)
    start_up = empty and scene.camera is not None and scene.camera.name == "Camera"
    job.changes = True
    work = Import(context, path, options, preview_budget(context), start_up)
    yield from work.run()
    adopt_settings(scene, work, empty or options.use_rate == "YES")
    if options.use_engine:
        scene.render.engine = "PAGS"
    if empty:
        clear_views()
        if options.use_engine and not bpy.app.background:
            look_through_camera(context)
    whereabouts.place(work.root, "path", path, bpy.data.filepath, options.relative and bool(bpy.data.filepath))
    photographs.note(work.root, entry)
    work.root.pags.relative = options.relative and not bpy.data.filepath
    for other in context.selected_objects:
        other.select_set(False)
    work.root.select_set(True)
    context.view_layer.objects.active = work.root
    yield from more(job, work, options)
    if fps > 0 and not rate and abs(fps - work.fps) > 1e-3:
        said.append(f"the recording has {fps:g} frames per second, the timeline {work.fps:g}; tracks keep their speed")
    return "; ".join([f"{work.name}: {entry.counts()}", *said])


def more(job, work, options):
    """Optional steps of an import: their errors become warnings."""
    for camera in work.sensors if options.photographs else ():
        try:
            yield from photographs.show(job, camera, work.root)
        except jobs.ERRORS as error:
            job.notes.append(f"{camera.name}: {error}")
    if options.proxies:
        try:
            yield from proxies.make(job, work.root, exporter.proxy_program(bpy.context))
        except jobs.ERRORS as error:
            job.notes.append(f"imported without proxies: {error}")


# Blender matches a filter with the whole path: "scene.json" as a filter would match nothing, "*scene.json" does.
EXTENSIONS = (".json", ".ply", ".spz", ".splat", ".pagsz")
OPTIONS = ("whole", "up", "cameras", "photographs", "proxies", "use_rate", "use_standard", "use_engine", "relative")


class PAGS_OT_import(bpy.types.Operator, ImportHelper):
    """Import a PAGS scene folder or a splat file (.ply, .spz, .splat, .pagsz) with its objects, tracks and cameras"""

    bl_idname = "import_scene.pags"
    bl_label = "Import PAGS scene"
    bl_options = {"REGISTER", "UNDO", "PRESET"}

    filename_ext = ".json"
    filter_glob: StringProperty(default="*scene.json;" + ";".join("*" + e for e in EXTENSIONS[1:]), options={"HIDDEN"})
    filepath: StringProperty(
        name="Path", description="scene.json, its folder, or a splat file", subtype="FILE_PATH", options={"SKIP_SAVE"}
    )
    directory: StringProperty(subtype="DIR_PATH", options={"SKIP_SAVE", "HIDDEN"})
    files: CollectionProperty(type=bpy.types.OperatorFileListElement, options={"SKIP_SAVE", "HIDDEN"})
    whole: BoolProperty(
        name="Whole scene",
        description="If the splat file belongs to a scene folder, import the whole scene; off: this file only",
        default=True,
    )
    up: EnumProperty(name="Up axis", description="Axis of the file that becomes Blender's Z", items=UP_AXES)
    cameras: EnumProperty(
        name="Cameras",
        description="Cameras to create; a file without cameras gets one that frames it",
        items=[
            ("SENSORS", "One per sensor", "One animated camera per sensor, on the ego"),
            ("ALL", "All views too", "Also one static camera per photograph"),
            ("NONE", "None", "No cameras"),
        ],
    )
    photographs: BoolProperty(
        name="Photographs",
        description="Show each sensor's photographs as the background of its camera, as an image sequence",
        default=False,
    )
    proxies: BoolProperty(
        name="Proxies",
        description="Create closed meshes of objects and ground with the pags program on the objects' tracks (takes minutes)",
        default=False,
    )
    use_rate: EnumProperty(
        name="Frame rate",
        description="Whether the timeline takes the recording's frame rate",
        items=[
            ("AUTO", "In an empty file", "Use the recording's rate, size and range if the file has no other content"),
            ("YES", "Take it", "Always"),
            ("NO", "Keep mine", "Keep the timeline; tracks keep their true speed"),
        ],
    )
    use_standard: BoolProperty(
        name="Standard view transform",
        description='Use the view transform "Standard", which shows the photographs\' colours unchanged',
        default=True,
    )
    use_engine: BoolProperty(name="Render with PAGS", description="Set the render engine to PAGS", default=True)
    relative: BoolProperty(
        name="Relative path",
        description="Store the scene's path relative to the .blend once it is saved; off: always absolute",
        default=True,
    )

    by_hand = False

    def execute(self, context):
        path = bpy.path.abspath(self.filepath or self.directory)
        if os.path.basename(path) == "scene.json" or (os.path.isdir(path) and path.endswith(os.sep)):
            path = os.path.dirname(path)
        if not path:
            self.report({"ERROR"}, "choose a scene folder, its scene.json, or a splat file")
            return {"CANCELLED"}
        path, options = os.path.abspath(path), types.SimpleNamespace(**{name: getattr(self, name) for name in OPTIONS})
        whole = scene_of(path) if self.whole else None
        belongs = f"{os.path.basename(path)} belongs to {whole}; imported the whole scene (disable: Whole scene)"
        said = [belongs] if whole else []
        try:
            jobs.begin(self, lambda job: bring_in(job, whole or path, options, said))
        except jobs.ERRORS as error:
            self.report({"ERROR"}, str(error))
            return {"CANCELLED"}
        return {"CANCELLED"} if self.by_hand else {"FINISHED"}  # from the interface no undo step is pending yet

    def draw(self, context):
        lacking = program.lacking(context)
        for name in OPTIONS:
            row = self.layout.row()
            row.enabled = name != "proxies" or not lacking
            row.prop(self, name)
        if lacking:
            reasons.explain(self.layout, f"Proxies: {lacking}")

    def invoke(self, context, event):
        self.by_hand = True
        if hasattr(self, "invoke_popup") and self.filepath:
            return self.invoke_popup(context)  # dropped onto the window
        return ImportHelper.invoke(self, context, event)


def menu(self, context):
    self.layout.operator(PAGS_OT_import.bl_idname, text="PAGS scene (scene.json, .ply, .spz, .splat, .pagsz)")


if hasattr(bpy.types, "FileHandler"):

    class PAGS_FH_import(bpy.types.FileHandler):
        bl_idname = "PAGS_FH_import"
        bl_label = "PAGS scene"
        bl_import_operator = "import_scene.pags"
        bl_file_extensions = ";".join(EXTENSIONS)

        @classmethod
        def poll_drop(cls, context):
            return context.area and context.area.type in {"VIEW_3D", "OUTLINER"}


MENUS = ((bpy.types.TOPBAR_MT_file_import, menu),)
