# SPDX-License-Identifier: GPL-3.0-or-later
"""A tool of the 3D view: a click selects the object whose Gaussians are under the mouse; its name and depth are shown next to the mouse."""

import threading
import time

import bpy
from bpy.props import BoolProperty
from bpy_extras import view3d_utils

from . import draw, inspector, registry

REST = 0.12  # seconds that the mouse must rest before a pick
TICK = 0.05


class PAGS_OT_select(bpy.types.Operator):
    """Select the object whose Gaussians are under the mouse; without any, the object that Blender finds there"""

    bl_idname = "pags.select"
    bl_label = "Select splats under the mouse"
    bl_options = {"UNDO"}

    extend: BoolProperty(name="Extend", description="Extend the selection, or deselect the active object")

    @classmethod
    def poll(cls, context):
        return context.region_data is not None and context.mode == "OBJECT"

    def invoke(self, context, event):
        x, y = event.mouse_region_x, event.mouse_region_y
        try:
            found = inspector.aim(context).pick(x, y)
        except inspector.ERRORS as error:
            self.report({"WARNING"}, str(error))
            found = None
        if found is None or mesh_before(context, x, y, found["depth"]):
            how = {"extend": self.extend, "deselect_all": not self.extend}
            return bpy.ops.view3d.select("INVOKE_DEFAULT", location=(x, y), **how)
        context.scene.pags_picked = inspector.describe(found)
        self.report({"INFO"}, context.scene.pags_picked)
        inspector.select(context, found, self.extend)
        return {"FINISHED"}


def mesh_before(context, x, y, depth):
    """Whether a mesh is drawn at a pixel in front of the splats at this depth."""
    region, view = context.region, context.region_data
    origin = view3d_utils.region_2d_to_origin_3d(region, view, (x, y))
    direction = view3d_utils.region_2d_to_vector_3d(region, view, (x, y))
    hit, place, _, _, block, _ = context.scene.ray_cast(context.evaluated_depsgraph_get(), origin, direction)
    return hit and block.display_type not in {"WIRE", "BOUNDS"} and -(view.view_matrix @ place).z < depth


# ---- Pick under the resting mouse ----


class Hover:
    """Picks at the resting mouse, in a thread of its own."""

    def __init__(self):
        self.place = self.asked = None  # (region's address, x, y) of the mouse, and of the last pick
        self.since, self.thread = 0.0, None
        self.text, self.shown = "", True  # result of the last pick, and whether its region was redrawn since

    def moved(self, place):
        if place != self.place:
            self.place, self.since, self.text = place, time.monotonic(), ""
            registry.start(tick, TICK)

    def look(self):
        """Starts a pick under the mouse."""
        self.asked = self.place
        for window, area, region in draw.regions():
            space = area.spaces.active
            if region.as_pointer() == self.place[0] and not space.region_quadviews:
                aim = inspector.aim_of(space, space.region_3d, region, window.view_layer.depsgraph, wait=False)
                if aim.frame is not None:
                    self.thread = threading.Thread(target=self.pick, args=(aim, self.place), daemon=True)
                    self.thread.start()

    def pick(self, aim, place):
        try:
            found = inspector.describe(aim.pick(*place[1:]))
        except (RuntimeError, ValueError, MemoryError) as error:
            found = str(error)
        if self.place == place:
            self.text, self.shown = found, False


hover = Hover()


def tick():
    """Picks once the mouse rests, and redraws after a result; stops until the mouse moves again."""
    if hover.thread is not None and not hover.thread.is_alive():
        hover.thread = None
    if hover.thread is None and hover.place != hover.asked and time.monotonic() - hover.since >= REST:
        try:
            hover.look()
        except inspector.ERRORS as error:
            hover.text, hover.shown = str(error), False
    if not hover.shown:
        hover.shown = True
        for _, _, region in draw.regions():
            if region.as_pointer() == hover.place[0]:
                region.tag_redraw()
    return TICK if hover.thread is not None or hover.place != hover.asked else None


CLICK = {"type": "LEFTMOUSE", "value": "PRESS"}


class PAGS_TL_select(bpy.types.WorkSpaceTool):
    bl_space_type = "VIEW_3D"
    bl_context_mode = "OBJECT"
    bl_idname = "pags.select_tool"
    bl_label = "Select splats"
    bl_description = "Click: select the object under the mouse. Its name and depth are shown next to the mouse"
    bl_icon = "ops.generic.select"
    bl_widget = None
    bl_keymap = (
        (PAGS_OT_select.bl_idname, CLICK, None),
        (PAGS_OT_select.bl_idname, {**CLICK, "shift": True}, {"properties": [("extend", True)]}),
    )

    def draw_settings(context, layout, tool):
        layout.label(text=context.scene.pags_picked)

    def draw_cursor(context, tool, xy):
        region = context.region
        if region is None or region.type != "WINDOW":
            return
        place = (region.as_pointer(), int(xy[0]) - region.x, int(xy[1]) - region.y)
        hover.moved(place)
        if hover.text:
            said, scale = hover.text.split(", "), draw.font(context)
            draw.lines(said, xy[0] + 18 * scale, xy[1] - (3 + 15 * len(said)) * scale, scale)


KEYS = ((PAGS_OT_select, "Object Mode", {"type": "Y", "value": "PRESS"}),)  # an unused key in Blender's key maps
TIMERS = (tick,)
_tools = []


def on_register():
    if bpy.context.window_manager.keyconfigs.default is not None:
        # `blender -b` has no key maps when it enables the user's add-ons, and no toolbar
        bpy.utils.register_tool(PAGS_TL_select, separator=True)
        _tools.append(PAGS_TL_select)


def on_unregister():
    while _tools:
        bpy.utils.unregister_tool(_tools.pop())
