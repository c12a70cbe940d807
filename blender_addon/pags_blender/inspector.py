# SPDX-License-Identifier: GPL-3.0-or-later
"""Picks the object under the mouse, and compares a rendered picture with its photograph."""

import bpy
import numpy as np
from bpy.props import BoolProperty, IntProperty, StringProperty

from . import cameras, gather, jobs, lens, native, photographs, whereabouts

ERRORS = (native.SceneError, RuntimeError, ValueError)  # of a pick


class InView:
    """Base of the operators in a 3D view. A subclass defines `act`, which returns the message to report."""

    @classmethod
    def poll(cls, context):
        return context.region_data is not None

    def execute(self, context):
        try:
            told = self.act(context)
        except ERRORS as error:
            self.report({"ERROR"}, str(error))
            return {"CANCELLED"}
        self.report({"INFO"}, told)
        return {"FINISHED"}


class PAGS_OT_pick(InView, bpy.types.Operator):
    """Click on the scene to show object, class, priority and depth"""

    bl_idname = "pags.pick"
    bl_label = "Pick"
    bl_options = {"REGISTER", "UNDO"}

    x: IntProperty(name="X", description="Pixels from the left of the view", default=0, subtype="PIXEL")
    y: IntProperty(name="Y", description="Pixels from the bottom of the view", default=0, subtype="PIXEL")

    def invoke(self, context, event):
        context.window.cursor_modal_set("EYEDROPPER")
        context.window_manager.modal_handler_add(self)
        return {"RUNNING_MODAL"}

    def modal(self, context, event):
        if event.type == "LEFTMOUSE" and event.value == "PRESS":
            context.window.cursor_modal_restore()
            self.x, self.y = event.mouse_region_x, event.mouse_region_y
            return self.execute(context)
        if event.type in {"ESC", "RIGHTMOUSE"}:
            context.window.cursor_modal_restore()
            return {"CANCELLED"}
        return {"RUNNING_MODAL"}

    def act(self, context):
        found = aim(context).pick(self.x, self.y)
        context.scene.pags_picked = describe(found)
        select(context, found)
        return context.scene.pags_picked


class Aim:
    """A camera's view at one moment, for picking. Only the constructor reads Blender's data."""

    def __init__(self, depsgraph, values, pose, hidden, planes, wait):
        """values, pose: camera from lens.of_view; hidden, planes: excluded objects and clipping. wait: for scenes that are still loading; otherwise `frame`
        is None then."""
        state, scene = gather.gather(depsgraph, hidden), depsgraph.scene
        if state is None:
            raise native.SceneError("there is no PAGS scene to pick in")
        self.values, self.pose, self.frame, now = values, pose, state.load(wait), scene.frame_current_final
        if self.frame is not None:
            self.camera = self.frame.camera(values, pose, now)
            self.contents = self.frame.contents_at(now, scene.pags.hide_noncritical)
            self.contents["clips"] = self.frame.clips(planes)

    def pick(self, x, y):
        """The pick result at a pixel (row 0 at the bottom) from the C module, plus "record", the object, and "place", the point in Blender's world; or None."""
        frame, values, y = self.frame, self.values, self.values["height"] - 1 - y
        found = native.module.pick(frame.entry.scene, self.camera, x, y, **self.contents)
        if found is not None:
            entry = frame.entries[found["scene"]]
            found["record"] = entry.objects[found["object"]] if found["object"] is not None else None
            found["root"] = frame.scenes[found["scene"]].root_name
            found["of"] = f" of {found['root']}" if len({scene.root_name for scene in frame.scenes}) > 1 else ""
            depth = found["depth"] * frame.scale
            ray = np.array([(x + 0.5 - values["cx"]) / values["fx"], (y + 0.5 - values["cy"]) / values["fy"], 1.0])
            found["place"] = self.pose[:3, :3] @ (depth * ray) + self.pose[:3, 3]
            found["depth"] = depth - values.get("ortho", 0.0)
        return found


def aim_of(space, view, region, depsgraph, wait=True, without=frozenset()):
    """The Aim of a 3D view, without the objects of these full names."""
    values, pose = lens.of_view(view.window_matrix, view.view_matrix, region.width, region.height)
    planes = lens.clip_planes(space, view, values, pose, depsgraph.scene.camera)
    return Aim(depsgraph, values, pose, gather.hidden_in(space, depsgraph) | without, planes, wait)


def aim(context):
    """The Aim of the context's 3D view."""
    return aim_of(context.space_data, context.region_data, context.region, context.evaluated_depsgraph_get())


def pick(context, values, pose, x, y):
    """The pick result at a pixel (row 0 at the top) of a Blender camera, independent of the 3D view."""
    return Aim(context.evaluated_depsgraph_get(), values, pose, frozenset(), [], True).pick(x, values["height"] - 1 - y)


def describe(found):
    if found is None:
        return "nothing is drawn there"
    record = found["record"]
    what = f"{record['class']} {record['id']} (number {found['object']})" if record else "background"
    what += found["of"]
    return f"{what}, priority {found['priority']:.2f}, depth {found['depth']:.2f} m, Gaussian {found['id']}"


def select(context, found, extend=False):
    """Selects the picked object: alone, or with `extend` added to the selection, or removed from it if it was already active."""
    if found is None:
        return
    index = found["object"] if found["object"] is not None else -1
    for other in context.selected_objects if not extend else ():
        other.select_set(False)
    for part in context.view_layer.objects:
        settings = part.pags
        if settings.kind not in {"OBJECT", "BACKGROUND"} or settings.index != index or not settings.root:
            continue
        if settings.root.name_full == found["root"] and part.visible_get():
            if extend and part.select_get() and context.view_layer.objects.active == part:
                part.select_set(False)
                return
            part.select_set(True)
            context.view_layer.objects.active = part
            return


# ---- Against the photograph ----


def psnr(a, b):
    error = float(np.mean((np.clip(a, 0, 1) - np.clip(b, 0, 1)) ** 2))
    return 99.0 if error == 0 else -10 * np.log10(error)


def exposed(picture, view):
    """Applies the photograph's exposure to a picture: photograph = gain * picture + offset."""
    gain, offset = (np.array(view[name], dtype=np.float32) for name in ("gain", "offset"))
    return np.clip(picture * gain + offset, 0, 1)


def draw_view(entry, view, threads):
    """Renders one of the scene's views without Blender's edits: (height, width, 3), display-referred sRGB."""
    picture = native.renderer("final", threads).submit(entry.scene, view).take()
    return np.asarray(picture.rgba)[..., :3].copy()


class PAGS_OT_compare(jobs.Long, cameras.OnScene, bpy.types.Operator):
    """Show the photograph at the current time and the rendered picture side by side, with their PSNR"""

    bl_idname = "pags.compare"
    bl_label = "Compare with photograph"

    name: StringProperty(
        name="Photograph",
        description="File name of the photograph; empty: the nearest in time of the active camera",
        default="",
    )
    use_exposure: BoolProperty(
        name="Exposure",
        description="Apply the photograph's exposure from training to the rendered picture",
        default=True,
    )

    def steps(self, context, root):
        name, use_exposure, threads = self.name, self.use_exposure, context.scene.pags.threads
        path = whereabouts.absolute_path(root)

        def work(job):
            yield jobs.in_thread(native.load, path)
            frame = cameras.Frame(bpy.context, root)
            view = cameras.view_at(bpy.context, frame, name)
            if view is None:
                raise native.SceneError("the scene has no photographs")
            photograph = yield from photographs.load(job, root, frame.entry, view)
            picture, value = yield jobs.in_thread(measure, frame.entry, view, threads, use_exposure, photograph)
            photographs.compare(bpy.context, photograph, picture)
            told = f"{view['name']}: PSNR {value:.2f} dB" + (" (held out)" if view["test"] else "")
            bpy.context.scene.pags_compared = told
            return told

        return work


def measure(entry, view, threads, use_exposure, photograph):
    """The rendered picture of a view and its PSNR."""
    picture = draw_view(entry, view, threads)
    if use_exposure:
        picture = exposed(picture, view)
    return picture, psnr(picture, photograph)


PROPERTIES = (
    (bpy.types.Scene, "pags_picked", StringProperty(name="Picked", options={"SKIP_SAVE"})),
    (bpy.types.Scene, "pags_compared", StringProperty(name="Compared", options={"SKIP_SAVE"})),
)
