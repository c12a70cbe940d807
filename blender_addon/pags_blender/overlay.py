# SPDX-License-Identifier: GPL-3.0-or-later
"""Overlay for Solid and Material shading and other render engines: splats composited with the meshes by depth, or preview points where splats are not drawn."""

import blf
import bpy
import gpu
import numpy as np
from gpu_extras.batch import batch_for_shader

from . import draw, gather, stopwatch, viewport
from .native import SceneError

_views = {}  # by region pointer
_batches = {}  # by mesh
_version = 0


def changed():
    global _version
    _version += 1


def forget():
    for view in _views.values():
        view.drop()
    _views.clear()
    _batches.clear()
    changed()


def draws_splats(context):
    """Whether the overlay draws this view's splats."""
    shading = context.space_data.shading.type
    if not context.scene.pags.overlay or shading == "WIREFRAME":
        return False
    return shading in {"SOLID", "MATERIAL"} or context.scene.render.engine != "PAGS"


def draws(context):
    """Whether the render engine or the overlay draws splats in this view."""
    engine = context.space_data.shading.type == "RENDERED" and context.scene.render.engine == "PAGS"
    return engine or draws_splats(context)


def view_of(context):
    key = context.region.as_pointer()
    view = _views.get(key)
    if view is None:
        view = _views[key] = viewport.View()
        view.version, view.among = -1, True
    return view


def on_draw():
    context = bpy.context
    if context.region_data is None or not any(o.pags.kind == "ROOT" for o in bpy.data.objects):
        return
    try:
        if draws_splats(context):
            draw_splats(context)
        elif context.space_data.shading.type != "RENDERED" and context.scene.pags.points:
            draw_points(context)
    except (SceneError, RuntimeError, ValueError) as error:
        view_of(context).error = str(error)


def draw_splats(context):
    begin = stopwatch.clock()
    view = view_of(context)
    depsgraph = context.evaluated_depsgraph_get()
    if view.version != _version or view.stale(depsgraph, context.space_data):
        view.update(depsgraph, context.space_data)
        view.watch.gathered = (0.0, 0.0)  # already counted in the time of this redraw
        view.version = _version
    width = context.region.width
    window = (0, 0, width, context.region.height)
    requested = view.request(context, depsgraph, window, ("rgba", "depth"), True)
    upload = view.advance(requested)
    second, edge = view.second, 1
    if second is not None:
        upload += second.advance(second.request(context, depsgraph, window, ("rgba", "depth"), True))
        edge = viewport.edge_of(context.scene.pags)
    middle = stopwatch.clock()
    if second is not None and second.shown is not None and second.shown.depth is not None and second.state is not None:
        put(context, second.shown, edge + 4 / width, 1)  # a gap of two pixels is the edge
    if view.shown is not None and view.shown.depth is not None and view.state is not None:
        put(context, view.shown, -1, edge)
    elif context.scene.pags.points:
        draw_points(context)
    view.watch.add(begin, middle, upload)


def put(context, shown, left, right):
    shader = draw.shader("depth")
    gpu.state.depth_test_set("LESS_EQUAL")
    gpu.state.depth_mask_set(True)
    gpu.state.blend_set("ALPHA_PREMULT")
    shader.bind()
    draw.bind_picture(shader, shown, context.region_data.window_matrix)
    draw.part("depth", left, right).draw(shader)
    gpu.state.blend_set("NONE")
    gpu.state.depth_mask_set(False)
    gpu.state.depth_test_set("NONE")


# ---- Points ----


def point_shader():
    return draw.builtin("POINT_FLAT_COLOR", "FLAT_COLOR", "3D_FLAT_COLOR")


def batch_of(mesh, shader):
    key = (mesh.name_full, len(mesh.vertices))
    if key not in _batches:
        count = len(mesh.vertices)
        points, colors = np.empty(3 * count, dtype=np.float32), np.ones(4 * count, dtype=np.float32)
        mesh.vertices.foreach_get("co", points)
        attribute = mesh.attributes.get("Col")
        if attribute and len(attribute.data) == count:
            attribute.data.foreach_get("color", colors)
        _batches[key] = batch_for_shader(
            shader, "POINTS", {"pos": points.reshape(-1, 3), "color": colors.reshape(-1, 4)}
        )
    return _batches[key]


def draw_points(context):
    shader = point_shader()
    gpu.state.depth_test_set("LESS_EQUAL")
    gpu.state.depth_mask_set(True)
    gpu.state.point_size_set(2.0)
    depsgraph = context.evaluated_depsgraph_get()
    for instance in gather.instances(depsgraph, gather.hidden_in(context.space_data, depsgraph)):
        part = instance.object
        if part.original.pags.kind not in gather.PARTS or part.type != "MESH" or not part.original.data.vertices:
            continue
        with gpu.matrix.push_pop():
            gpu.matrix.multiply_matrix(instance.matrix_world)
            batch_of(part.original.data, shader).draw(shader)
    gpu.state.depth_mask_set(False)
    gpu.state.depth_test_set("NONE")


def on_draw_text():
    """Shows the statistics of the overlay's pictures as text in the view."""
    context = bpy.context
    if context.region_data is None or not draws_splats(context) or not context.space_data.overlay.show_text:
        return
    view = _views.get(context.region.as_pointer())
    if view is None or (view.state is None and not view.error):
        return
    scale = draw.font(context)
    text = "PAGS | " + view.statistics(context.scene.pags)
    # On the right, next to the sidebar: Blender's own text is at the top, its panel of the last operation at the lower left.
    sidebar = next((r.width for r in context.area.regions if r.type == "UI" and r.width > 1), 0)
    left = context.region.width - sidebar - blf.dimensions(0, text)[0] - 20 * scale
    draw.lines([text], max(left, 20 * scale), 20 * scale, scale)


DRAWN = ((on_draw, "POST_VIEW"), (on_draw_text, "POST_PIXEL"))


def on_unregister():
    forget()
