# SPDX-License-Identifier: GPL-3.0-or-later
"""The drawn splats as a surface for Blender's keys: the 3D cursor (Shift and right mouse button, and the Cursor tool), auto depth of the navigation, moving with
snapping to faces (G), the Measure tool; and objects that stand on the road.

Blender's own tools read the depth of meshes only. These operators come before them in the key maps and leave the event to them where no splats are hit, or a
mesh is nearer."""

import bpy
import numpy as np
from mathutils import Matrix, Vector

from . import gather, inspector, lens, measure, overlay, select_tool


def aim(context, without=frozenset()):
    """The Aim of a 3D view that shows splats, without these objects, or None."""
    space, view = context.space_data, context.region_data
    if view is None or space.type != "VIEW_3D" or not overlay.draws(context):
        return None
    if not any(o.pags.kind == "ROOT" for o in bpy.data.objects):
        return None
    try:
        found = inspector.aim_of(space, view, context.region, context.evaluated_depsgraph_get(), False, without)
    except inspector.ERRORS:
        return None
    return found if found.frame is not None else None


def under_mouse(context, event):
    """The pick result under the mouse, or None without splats or with a nearer mesh."""
    found, x, y = aim(context), event.mouse_region_x, event.mouse_region_y
    if found is None:
        return None
    try:
        hit = found.pick(x, y)
    except inspector.ERRORS:
        return None
    return None if hit is None or select_tool.mesh_before(context, x, y, hit["depth"]) else hit


class OnSplats:
    """Base of the operators on keys of Blender: `act` returns an operator's answer for the pick result under the mouse."""

    bl_options = {"INTERNAL"}

    def invoke(self, context, event):
        hit = under_mouse(context, event)
        return {"PASS_THROUGH"} if hit is None else self.act(context, hit)


class PAGS_OT_cursor(OnSplats, bpy.types.Operator):
    """Set the 3D cursor on the splats under the mouse"""

    bl_idname = "pags.cursor"
    bl_label = "3D cursor on splats"

    def act(self, context, hit):
        context.scene.cursor.location = hit["place"]
        return {"FINISHED"}


class PAGS_OT_auto_depth(OnSplats, bpy.types.Operator):
    """Turn and zoom about the depth of the splats under the mouse (Preferences > Navigation > Auto Depth)"""

    bl_idname = "pags.auto_depth"
    bl_label = "Auto depth of splats"

    @classmethod
    def poll(cls, context):
        return context.region_data is not None and context.preferences.inputs.use_mouse_depth_navigate

    def act(self, context, hit):
        view = context.region_data
        if view.view_perspective == "PERSP":  # the picture stays: only the centre moves along the view's axis
            eye = view.view_matrix.inverted()
            view.view_distance = max(hit["depth"], 0.01)
            view.view_location = eye @ Vector((0, 0, -view.view_distance))
        return {"PASS_THROUGH"}


# ---- Objects on the surface ----


def box_of(block):
    """Lowest and highest corner (3) of an object and its children in Blender's world."""
    corners = []
    for part in (block, *block.children_recursive):
        if "pags_size" in part:
            local = np.array(np.meshgrid(*[(-v / 2, v / 2) for v in part["pags_size"]])).reshape(3, -1).T
        elif part.type in gather.SOLIDS:
            local = np.array([list(corner) for corner in part.bound_box])
        else:
            continue
        matrix = lens.matrix(part.matrix_world)
        corners.append(local @ matrix[:3, :3].T + matrix[:3, 3])
    corners = np.vstack(corners) if corners else np.array([block.matrix_world.translation])
    return corners.min(axis=0), corners.max(axis=0)


def outermost(blocks):
    """Those of the objects that are no children of others of them."""
    chosen = set(blocks)
    return [o for o in blocks if o.parent is None or not any(p in chosen for p in ancestors(o))]


def ancestors(block):
    while block.parent is not None:
        block = block.parent
        yield block


def names_of(blocks):
    """Full names of the objects and their children."""
    return frozenset(o.name_full for block in blocks for o in (block, *block.children_recursive))


class PAGS_OT_place(bpy.types.Operator):
    """Move the selected objects on the splats under the mouse: their lower sides stand on it"""

    bl_idname = "pags.place"
    bl_label = "Move on splats"
    bl_options = {"REGISTER", "UNDO"}

    def invoke(self, context, event):
        tools, self.blocks = context.scene.tool_settings, outermost(context.selected_objects)
        if not (tools.use_snap and "FACE" in tools.snap_elements and self.blocks):
            return {"PASS_THROUGH"}
        self.without, self.start = names_of(self.blocks), [o.matrix_world.copy() for o in self.blocks]
        low, high = box_of(context.active_object if context.active_object in self.blocks else self.blocks[0])
        self.base = np.array([*(low[:2] + high[:2]) / 2, low[2]])
        self.aim = self.seen = None
        if aim(context, self.without) is None:
            return {"PASS_THROUGH"}
        context.workspace.status_text_set("Move on splats. Left mouse button: confirm; right mouse button: cancel")
        context.window_manager.modal_handler_add(self)
        return {"RUNNING_MODAL"}

    def modal(self, context, event):
        if event.type in {"ESC", "RIGHTMOUSE"} or event.type in {"LEFTMOUSE", "RET"} and event.value == "PRESS":
            context.workspace.status_text_set(None)
            if event.type in {"LEFTMOUSE", "RET"}:
                return {"FINISHED"}
            self.put(Vector())
            return {"CANCELLED"}
        if event.type != "MOUSEMOVE":
            return {"PASS_THROUGH"}  # the view can be moved meanwhile
        if self.seen != context.region_data.perspective_matrix:
            self.seen, self.aim = context.region_data.perspective_matrix.copy(), aim(context, self.without)
        hit = self.aim.pick(event.mouse_region_x, event.mouse_region_y) if self.aim is not None else None
        if hit is not None:
            self.put(Vector(hit["place"] - self.base))
        return {"RUNNING_MODAL"}

    def put(self, offset):
        for block, start in zip(self.blocks, self.start):
            block.matrix_world = Matrix.Translation(offset) @ start


class PAGS_OT_stand_on_road(bpy.types.Operator):
    """Move the selected objects up or down so that they stand on the road below them"""

    bl_idname = "pags.stand_on_road"
    bl_label = "Stand on road"
    bl_options = {"REGISTER", "UNDO"}

    @classmethod
    def poll(cls, context):
        cls.poll_message_set("select the objects that are to stand on the road")
        return context.mode == "OBJECT" and len(context.selected_objects) > 0

    def execute(self, context):
        blocks = outermost(context.selected_objects)
        hidden, floating = names_of(blocks), []
        for block in blocks:
            low, high = box_of(block)
            ground = None
            for above in (high[2] + 0.5, high[2] + 5):  # the nearer start is below trees and bridges
                if ground is None:
                    start = np.array([*(low[:2] + high[:2]) / 2, above])
                    ground = measure.ground_below(context, start, hidden)
            if ground is None:
                floating.append(block.name)
            else:
                block.matrix_world = Matrix.Translation((0, 0, ground - low[2])) @ block.matrix_world
        if floating:
            self.report({"WARNING"}, f"no surface below {', '.join(floating[:3])}")
        return {"FINISHED"} if len(floating) < len(blocks) else {"CANCELLED"}


KEYS = (  # operator, key map, event
    (PAGS_OT_cursor, "3D View", {"type": "RIGHTMOUSE", "value": "PRESS", "shift": True}),
    (PAGS_OT_cursor, "3D View Tool: Cursor", {"type": "LEFTMOUSE", "value": "PRESS"}),
    (PAGS_OT_auto_depth, "3D View", {"type": "MIDDLEMOUSE", "value": "PRESS", "any": True}),
    (PAGS_OT_place, "Object Mode", {"type": "G", "value": "PRESS"}),
    (measure.PAGS_OT_distance, "3D View Tool: Measure", {"type": "LEFTMOUSE", "value": "CLICK_DRAG"}),
)


def menu(self, context):
    self.layout.operator(PAGS_OT_stand_on_road.bl_idname)


MENUS = ((bpy.types.VIEW3D_MT_object, menu),)
