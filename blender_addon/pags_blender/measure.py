# SPDX-License-Identifier: GPL-3.0-or-later
"""Measures in the 3D view: the distance between two picked points, and eye height above the ground."""

import bpy
import gpu
import numpy as np
from bpy.props import FloatProperty, FloatVectorProperty, IntVectorProperty, StringProperty
from gpu_extras.batch import batch_for_shader
from mathutils import Matrix, Vector

from . import draw, gather, inspector, lens, native

BESIDE = 0.4  # metres between the vertical rays; the ground is the median of nine
DOWN = np.array([[1.0, 0, 0], [0, -1.0, 0], [0, 0, -1.0]])  # a camera that looks down, in the engine's axes


# ---- Distance ----


def place_at(context, x, y):
    """The point of Blender's world at a pixel of the 3D view (row 0 at the bottom). Raises SceneError without one."""
    found = inspector.aim(context).pick(x, y)
    if found is None:
        raise native.SceneError("nothing is drawn there")
    return found["place"]


class PAGS_OT_distance(inspector.InView, bpy.types.Operator):
    """Click on two points of the scene to measure their distance. The view can be moved between the clicks; Escape ends it"""

    bl_idname = "pags.distance"
    bl_label = "Distance"
    bl_options = {"UNDO"}  # no panel for adjustment: the clicked points are not properties

    start: IntVectorProperty(name="From", description="Pixels from the left and the bottom of the view", size=2)
    end: IntVectorProperty(name="To", description="Pixels from the left and the bottom of the view", size=2)

    def invoke(self, context, event):
        self.first, self.dragged = None, event.value == "CLICK_DRAG"
        if self.dragged:  # with Blender's tool Measure: from the press to the release of the mouse button
            x, y = event.mouse_prev_press_x - context.region.x, event.mouse_prev_press_y - context.region.y
            try:
                self.first = place_at(context, x, y)
            except inspector.ERRORS:
                return {"PASS_THROUGH"}
        context.window.cursor_modal_set("EYEDROPPER")
        context.workspace.status_text_set("Click on the first point; Escape: cancel")
        context.window_manager.modal_handler_add(self)
        return {"RUNNING_MODAL"}

    def modal(self, context, event):
        if event.type in {"ESC", "RIGHTMOUSE"}:
            return self.close(context, {"CANCELLED"})
        if event.type != "LEFTMOUSE" or event.value != ("RELEASE" if self.dragged else "PRESS"):
            return {"PASS_THROUGH"}  # the view can be moved meanwhile
        try:
            place = place_at(context, event.mouse_region_x, event.mouse_region_y)
        except inspector.ERRORS as error:
            self.report({"WARNING"}, f"{error}; click on another point")
            return {"RUNNING_MODAL"}
        if self.first is None:
            self.first = place
            context.workspace.status_text_set("Click on the second point; Escape: cancel")
            return {"RUNNING_MODAL"}
        self.report({"INFO"}, self.tell(context, self.first, place))
        return self.close(context, {"FINISHED"})

    def close(self, context, answer):
        context.window.cursor_modal_restore()
        context.workspace.status_text_set(None)
        return answer

    def act(self, context):
        return self.tell(context, place_at(context, *self.start), place_at(context, *self.end))

    def tell(self, context, a, b):
        unit = context.scene.unit_settings.scale_length
        apart = unit * (b - a)
        context.scene.pags_measured = [*a, *b]
        far, level = np.linalg.norm(apart), np.linalg.norm(apart[:2])
        context.scene.pags_distance = f"{far:.3f} m ({level:.3f} m level, {apart[2]:+.3f} m up)"
        return context.scene.pags_distance


class PAGS_OT_forget_distance(bpy.types.Operator):
    """Remove the measured distance from the views"""

    bl_idname = "pags.forget_distance"
    bl_label = "Remove distance"
    bl_options = {"UNDO"}

    def execute(self, context):
        context.scene.pags_distance = ""
        return {"FINISHED"}


def on_draw():
    context = bpy.context
    if not context.scene.pags_distance or context.region_data is None:
        return
    points = np.array(context.scene.pags_measured).reshape(2, 3)
    shader = draw.builtin("UNIFORM_COLOR", "3D_UNIFORM_COLOR")
    gpu.state.depth_test_set("NONE")
    gpu.state.line_width_set(2.0)
    gpu.state.point_size_set(6.0)
    shader.bind()
    shader.uniform_float("color", (1.0, 0.6, 0.1, 1.0))
    for kind in ("LINES", "POINTS"):
        batch_for_shader(shader, kind, {"pos": points}).draw(shader)
    gpu.state.line_width_set(1.0)


def on_draw_text():
    context = bpy.context
    if not context.scene.pags_distance or context.region_data is None:
        return
    region, matrix = context.region, context.region_data.perspective_matrix
    middle = np.array(context.scene.pags_measured).reshape(2, 3).mean(axis=0)
    at = matrix @ Vector((*middle.tolist(), 1.0))
    if at.w > 0 and region.width > 0:
        draw.text(context, 0.5 + 0.5 * at.x / at.w, 0.5 + 0.5 * at.y / at.w, context.scene.pags_distance)


# ---- Eye height ----


def ground_below(context, place, without=frozenset()):
    """Height in Blender's world of the ground below a point, without the objects of these full names: the median of nine rays, robust against gaps and bollards; from an imported LiDAR sweep if the
    scene has no surface there. None if neither has one."""
    depsgraph = context.evaluated_depsgraph_get()
    state, heights = gather.gather(depsgraph, without), []
    if state is not None:
        frame, now = state.load(True), context.scene.frame_current_final
        contents = frame.contents_at(now)
        values = {"width": 1, "height": 1, "fx": 1.0, "fy": 1.0, "cx": 0.5, "cy": 0.5}
        pose = np.eye(4)
        pose[:3, :3] = DOWN
        for x in (-BESIDE, 0, BESIDE):
            for y in (-BESIDE, 0, BESIDE):
                pose[:3, 3] = place + np.array([x, y, 0])
                found = native.module.pick(frame.entry.scene, frame.camera(values, pose, now), 0, 0, **contents)
                if found is not None:
                    heights.append(place[2] - found["depth"] * frame.scale)
    return float(np.median(heights)) if heights else lidar_below(context, place)


def lidar_below(context, place):
    """The same from the points of LiDAR sweeps within a metre: their 5th percentile."""
    heights = []
    for block in context.scene.objects:
        if "pags_lidar" not in block:
            continue
        points = np.empty(3 * len(block.data.vertices), dtype=np.float32)
        block.data.vertices.foreach_get("co", points)
        matrix = lens.matrix(block.matrix_world)
        world = points.reshape(-1, 3) @ matrix[:3, :3].T + matrix[:3, 3]
        near = np.linalg.norm(world[:, :2] - place[:2], axis=1) < 1
        heights += [h for h in world[near, 2].tolist() if h < place[2]]
    return float(np.percentile(heights, 5)) if heights else None


class PAGS_OT_stand(inspector.InView, bpy.types.Operator):
    """Move the view or its camera to eye height above the ground, level, in the same direction. Cameras of the recording stay; the view moves instead"""

    bl_idname = "pags.stand"
    bl_label = "Stand on ground"
    bl_options = {"REGISTER", "UNDO"}

    height: FloatProperty(
        name="Eye height",
        description="Height above the ground in metres",
        default=1.6,
        min=0.01,
        max=1000,
        unit="LENGTH",
    )

    def act(self, context):
        view = context.region_data
        eye = view.view_matrix.inverted()
        place = np.array(eye.translation if view.is_perspective else view.view_location, dtype=np.float64)
        ground = ground_below(context, place)
        if ground is None:
            raise native.SceneError("no surface and no LiDAR point below the view; move it over the ground")
        towards = eye.to_3x3() @ Vector((0, 0, -1))
        if towards.xy.length < 0.05 * towards.length:  # looking straight up or down: the picture's top is ahead
            towards = eye.to_3x3() @ Vector((0, 1, 0))
        turn = Vector((towards.x, towards.y, 0)).to_track_quat("-Z", "Y")
        stand = Vector((place[0], place[1], ground + self.height))
        camera = context.space_data.camera if view.view_perspective == "CAMERA" else None
        if camera is not None and camera.pags.kind == "NONE":
            camera.matrix_world = Matrix.Translation(stand) @ turn.to_matrix().to_4x4()
        else:
            view.view_perspective = "PERSP"
            view.view_rotation = turn
            view.view_location = stand + turn @ Vector((0, 0, -view.view_distance))
        return f"{self.height:g} m above the ground at height {ground:.2f} m"


MEASURED = FloatVectorProperty(name="Measured", description="The two points", size=6, options={"SKIP_SAVE"})
DISTANCE = StringProperty(name="Distance", description="Distance between the two points", options={"SKIP_SAVE"})
PROPERTIES = ((bpy.types.Scene, "pags_measured", MEASURED), (bpy.types.Scene, "pags_distance", DISTANCE))
DRAWN = ((on_draw, "POST_VIEW"), (on_draw_text, "POST_PIXEL"))
