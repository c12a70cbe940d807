# SPDX-License-Identifier: GPL-3.0-or-later
"""Refuses tools of Blender that change a part's preview points: Gaussians follow the object's matrix, not its mesh. *Apply* and *Set Origin* are taken back,
Edit Mode and other modes are left, modifiers are removed, and *Join* is undone; a message says why."""

import bpy
import numpy as np
from bpy.app.handlers import persistent
from bpy.props import StringProperty
from mathutils import Matrix

from . import lens, registry

PARTS = {"BACKGROUND", "OBJECT"}
REST = "pags_rest"  # custom property of a part's mesh: positions of a few of its vertices at the import
FEW = 8
_parts, _last = 0, 0  # number of parts, and address of the operator that ran last, at the last change
_waiting = []  # for `tick`: what to do, and why


class PAGS_OT_say(bpy.types.Operator):
    """Show a message in the status bar"""

    bl_idname = "pags.say"
    bl_label = "Message of PAGS"
    bl_options = {"INTERNAL"}

    text: StringProperty(name="Text", description="The message")

    def execute(self, context):
        self.report({"WARNING"}, self.text)
        return {"FINISHED"}


def some_vertices(mesh):
    """Positions (n, 3) of up to FEW vertices, spread over the mesh."""
    points = np.empty(3 * len(mesh.vertices), dtype=np.float32)
    mesh.vertices.foreach_get("co", points)
    points = points.reshape(-1, 3)
    return points[np.linspace(0, len(points) - 1, min(FEW, len(points))).astype(int)].astype(np.float64)


def remember(mesh):
    mesh[REST] = [float(len(mesh.vertices)), *some_vertices(mesh).ravel().tolist()]


def applied(mesh):
    """The 4x4 matrix by which the vertices were moved since the import, or None."""
    if REST not in mesh or mesh[REST][0] != len(mesh.vertices) or len(mesh.vertices) == 0:
        return None
    rest, now = np.array(mesh[REST][1:]).reshape(-1, 3), some_vertices(mesh)
    if np.allclose(rest, now, rtol=1e-4, atol=1e-4):
        return None
    wide, out = np.hstack([rest, np.ones((len(rest), 1))]), np.eye(4)
    if np.linalg.matrix_rank(wide, tol=1e-4) == 4:
        out[:3] = np.linalg.lstsq(wide, now, rcond=None)[0].T
    else:  # too few points for more than an offset
        out[:3, 3] = (now - rest).mean(axis=0)
    return out if abs(np.linalg.det(out)) > 1e-12 else None


def take_back(part):
    """Puts a part's vertices back and their movement into its matrix; returns whether they had been moved."""
    moved = applied(part.data)
    if moved is None:
        return False
    part.data.transform(Matrix(np.linalg.inv(moved).tolist()))
    part.matrix_basis = Matrix((lens.matrix(part.matrix_basis) @ moved).tolist())
    return True


def ran_last():
    """Name of the operator that has run since the last change, or ""."""
    global _last
    done = bpy.context.window_manager.operators if bpy.context.window_manager else ()
    address, before = (done[-1].as_pointer() if len(done) else 0), _last
    _last = address
    return done[-1].bl_idname if address not in {0, before} else ""


@persistent
def after_change(scene, depsgraph=None):
    global _parts
    name, before, _parts = ran_last(), _parts, sum(o.pags.kind in PARTS for o in bpy.data.objects)
    if name == "OBJECT_OT_join" and _parts < before:
        later(undo, "splats can't be joined with other objects")
    for update in depsgraph.updates if depsgraph is not None else ():
        part = update.id.original
        if not (isinstance(part, bpy.types.Object) and part.pags.kind in PARTS and part.type == "MESH"):
            continue
        if part.mode != "OBJECT":
            later(leave_mode, f"{part.name}: splats have no vertices to edit; use Clean up and look > Crop")
        elif len(part.modifiers):
            part.modifiers.clear()
            later(None, f"{part.name}: modifiers have no effect on splats, and are removed")
        elif update.is_updated_geometry and take_back(part):
            later(None, f"{part.name}: splats keep their location, rotation and scale; nothing was applied")


def leave_mode():
    if bpy.context.view_layer.objects.active is not None:
        bpy.ops.object.mode_set(mode="OBJECT")


def undo():
    bpy.ops.ed.undo()


def later(action, why):
    """Calls `action` and shows a message once Blender is idle: handlers must do neither."""
    if why not in [text for _, text in _waiting]:
        _waiting.append((action, why))
    registry.start(tick, 0.01)


def tick():
    window = bpy.context.window_manager.windows[0] if bpy.context.window_manager.windows else None
    with bpy.context.temp_override(window=window):
        while _waiting:
            action, why = _waiting.pop(0)
            if action is not None:
                action()
            bpy.ops.pags.say("INVOKE_DEFAULT", text=why)


HANDLERS = ((bpy.app.handlers.depsgraph_update_post, after_change),)
TIMERS = (tick,)


def on_unregister():
    _waiting.clear()
