# SPDX-License-Identifier: Apache-2.0
"""Tests Blender's settings in a real window: local view, render border, clipping, notes on ignored settings, and the
tool that selects with a click."""

import os
import sys
import time

import bpy
from mathutils import Vector

HERE = os.path.dirname(os.path.abspath(__file__))
sys.path[:0] = [HERE, os.path.join(HERE, "..", "cli")]
from fixtures import splat, write  # noqa: E402
from gui_case import (  # noqa: E402
    FOLDER,
    PATIENCE,
    addon,
    color,
    deselect,
    empty_scene,
    in_view,
    look_ahead,
    near,
    on_screen,
    redraw,
    region,
    sharp_shot,
    shoot,
    tell,
    view3d,
    viewport,
    window,
)
from test_drive import make_drive, with_object_id  # noqa: E402

GREY, GREEN, RED, SKY = (10, 0, 3), (10, 1.5, 0), (10, 0, 0), (10, -2, -1)  # positions in metres at the second frame
BLUE = (0, 0, 128)  # the sky
select_tool = sys.modules[addon.__name__ + ".select_tool"]


def story():
    empty_scene()
    make_drive(os.path.join(FOLDER, "scene"))
    rows = [
        splat(10, 0, 3, (0.5, 0.5, 0.5), sigma=0.15, opacity=12.0),
        splat(10, 1.5, 0, (0, 1, 0), sigma=0.15, opacity=12.0),
    ]
    write(os.path.join(FOLDER, "scene", "background.ply"), with_object_id(rows, [-1, 0]))
    assert bpy.ops.import_scene.pags(filepath=os.path.join(FOLDER, "scene")) == {"FINISHED"}
    bpy.context.scene.frame_set(2)
    overlay = view3d().overlay
    overlay.show_floor = overlay.show_axis_x = overlay.show_axis_y = False
    overlay.show_object_origins = overlay.show_extras = overlay.show_outline_selected = False
    view3d().shading.type = "RENDERED"
    deselect()
    look_ahead()
    for part in (local_view, border, border_of_the_camera, clipping, emptied, said, tool, surface):
        yield from part()
        deselect()
        print("part", part.__name__)


def part_of(index):
    return next(o for o in bpy.data.objects if o.pags.kind in {"OBJECT", "BACKGROUND"} and o.pags.index == index)


def apart(value, other, by=20):
    assert max(abs(a - b) for a, b in zip(value, other)) > by, f"{value} is {other}"


def text():
    return "\n".join(v.statistics(bpy.context.scene.pags) for v in viewport.views)


def local_view():
    """Local view shows only the car, without the sky, also in Solid shading. A pick elsewhere finds nothing."""
    for shading in ("RENDERED", "SOLID"):
        view3d().shading.type = shading
        near(color((yield from sharp_shot(f"local-before-{shading.lower()}")), GREEN), (0, 255, 0), 12)
        car = part_of(1)
        car.select_set(True)
        with in_view():
            bpy.ops.view3d.localview(frame_selected=False)
        assert view3d().local_view is not None
        car.select_set(False)
        picture = yield from sharp_shot(f"local-{shading.lower()}")
        near(color(picture, RED), (255, 0, 0), 12)
        apart(color(picture, GREEN), (0, 255, 0), 100)
        if shading == "RENDERED":
            near(color(picture, GREEN), (0, 0, 0))
        with in_view():
            bpy.ops.view3d.localview(frame_selected=False)
        near(color((yield from sharp_shot(f"local-after-{shading.lower()}")), GREEN), (0, 255, 0), 12)
    view3d().shading.type = "RENDERED"


def border():
    """The render border shows only the area left of the middle."""
    whole = yield from sharp_shot("border-before")
    view = view3d()
    view.use_render_border = True
    view.render_border_min_x, view.render_border_max_x, view.render_border_min_y, view.render_border_max_y = (
        0.0,
        0.47,
        0.0,
        1.0,
    )
    picture = yield from sharp_shot("border")
    near(color(picture, GREEN), color(whole, GREEN), 2)
    apart(color(picture, RED), color(whole, RED))
    apart(color(picture, SKY), BLUE)
    shown = next(v.shown for v in viewport.views if v.shown is not None and v.shown.place[2] < 0.6 * window().width)
    assert shown.size[0] < 0.5 * window().width, shown.size
    view.use_render_border = False
    near(color((yield from sharp_shot("border-after")), RED), color(whole, RED), 2)


def border_of_the_camera():
    """In camera view, the camera's border applies. The picture inside keeps its place."""
    scene = bpy.context.scene
    view3d().region_3d.view_perspective = "CAMERA"
    with in_view():
        bpy.ops.view3d.view_center_camera()
    whole = yield from sharp_shot("camera-border-before")
    render = scene.render
    render.use_border = True
    # The car, 9 m in front of the camera, is in the middle. The parked car, 1.5 m to its left, is at 0.5 - 1.5 / 9 *
    # 100 / 101 of the width.
    render.border_min_x, render.border_max_x, render.border_min_y, render.border_max_y = 0.45, 0.6, 0.4, 0.6
    picture = yield from sharp_shot("camera-border")
    near(color(picture, RED), (255, 0, 0), 12)
    near(color(picture, RED), color(whole, RED), 3)
    apart(color(picture, GREEN), (0, 255, 0), 100)
    apart(color(picture, GREEN), BLUE)
    render.border_min_x = 0.25
    near(color((yield from sharp_shot("camera-border-wider")), GREEN), (0, 255, 0), 12)
    render.use_border = False
    look_ahead()


def clipping():
    view = view3d()
    end, start = view.clip_end, view.clip_start
    for view.clip_start, view.clip_end, drawn in ((start, 9.5, False), (start, 10.5, True), (10.5, end, False)):
        picture = yield from sharp_shot("clip")
        near(color(picture, RED), (255, 0, 0) if drawn else BLUE, 12)
    view.clip_start, view.clip_end = start, end
    # Sets the planes of Alt B around the middle of the view.
    x, y = on_screen(RED)
    x, y = x - region().x, window().height - 1 - y - region().y
    view.shading.type = "SOLID"  # Blender 5 allows planes to be set only in Wireframe and Solid
    with in_view():
        assert bpy.ops.view3d.clip_border(xmin=x - 30, xmax=x + 30, ymin=y - 30, ymax=y + 30, wait_for_input=False) == {
            "FINISHED"
        }
    view.shading.type = "RENDERED"
    assert view.region_3d.use_clip_planes
    picture = yield from sharp_shot("clip-border")
    near(color(picture, RED), (255, 0, 0), 12)
    near(color(picture, GREEN), BLUE)
    view.region_3d.use_clip_planes = False
    redraw()  # scripts that set it don't redraw the view
    near(color((yield from sharp_shot("clip-after")), GREEN), (0, 255, 0), 12)


def emptied():
    """If nothing is visible, no old picture remains."""
    layer = bpy.context.view_layer.layer_collection.children["scene"]
    layer.exclude = True
    yield 1.0
    picture = shoot("emptied")
    apart(color(picture, RED), (255, 0, 0))
    apart(color(picture, SKY), BLUE)
    assert "no PAGS scene is visible here" in text(), text()
    layer.exclude = False
    near(color((yield from sharp_shot("emptied-after")), RED), (255, 0, 0), 12)


def said():
    """The header lists meshes, which F12 doesn't draw, and motion blur and depth of field, which the viewport doesn't."""
    assert "F12" not in text(), text()
    bpy.ops.mesh.primitive_cube_add(size=0.8, location=(6, 0.9, 0))
    scene = bpy.context.scene
    scene.render.use_motion_blur = scene.camera.data.dof.use_dof = True
    view3d().region_3d.view_perspective = "CAMERA"
    yield from sharp_shot("said")
    assert "not in F12: Cube; F12 alone: depth of field, motion blur" in text(), text()
    scene.render.use_motion_blur = scene.camera.data.dof.use_dof = False
    look_ahead()


def click(point, **more):
    x, y = on_screen(point)
    for kind, value in (("MOUSEMOVE", "NOTHING"), ("LEFTMOUSE", "PRESS"), ("LEFTMOUSE", "RELEASE")):
        window().event_simulate(type=kind, value=value, x=x, y=window().height - 1 - y, **more)
        yield 0.2


def selected():
    return {o.name for o in bpy.context.selected_objects}


def tool():
    """A click selects objects in Rendered and Solid shading; a mesh in front of the splats is preferred. The resting
    mouse shows a label. The shortcut works, too."""
    with in_view():
        assert bpy.ops.wm.tool_set_by_id(name="pags.select_tool") == {"FINISHED"}
    car = part_of(1).name
    yield from click(RED)
    assert selected() == {car}, selected()
    assert "Car c=2" in bpy.context.scene.pags_picked
    yield from click(GREEN, shift=True)
    assert len(selected()) == 2 and car in selected(), selected()
    end = time.monotonic() + 20 * PATIENCE
    while "p,1" not in select_tool.hover.text:
        assert time.monotonic() < end, (select_tool.hover.text, select_tool.hover.place)
        redraw()
        yield 0.1
    yield 0.3
    shoot("tool")
    yield from click(SKY)
    assert selected() == set(), selected()
    view3d().shading.type = "SOLID"
    yield from sharp_shot("tool-solid")
    yield from click((6, 0.9, 0))
    assert selected() == {"Cube"}, selected()
    yield from click(RED)
    assert selected() == {car}, selected()
    with in_view():
        bpy.ops.wm.tool_set_by_id(name="builtin.select_box")
    deselect()
    x, y = on_screen(RED)
    window().event_simulate(type="MOUSEMOVE", value="NOTHING", x=x, y=window().height - 1 - y)
    yield 0.2
    window().event_simulate(type=select_tool.KEY, value="PRESS", x=x, y=window().height - 1 - y)
    yield 0.3
    assert selected() == {car}, selected()
    view3d().shading.type = "RENDERED"


def surface():
    """Blender's keys find the splats: the 3D cursor, the centre of the view's turns, and moving with snapping."""
    scene, inputs = bpy.context.scene, bpy.context.preferences.inputs
    for block in [o for o in bpy.data.objects if o.name.startswith("Cube")]:
        bpy.data.objects.remove(block)
    look_ahead()
    yield from sharp_shot("surface")
    x, y = on_screen(GREEN)
    send = lambda kind, value, **more: window().event_simulate(type=kind, value=value, **more)  # noqa: E731
    at = {"x": x, "y": window().height - 1 - y}
    send("MOUSEMOVE", "NOTHING", **at)
    yield 0.2
    send("RIGHTMOUSE", "PRESS", shift=True, **at)
    send("RIGHTMOUSE", "RELEASE", shift=True, **at)
    yield 0.3
    assert (scene.cursor.location - Vector(GREEN)).length < 0.4, scene.cursor.location
    inputs.use_mouse_depth_navigate = True
    view = view3d().region_3d
    before = view.view_matrix.copy()
    view.view_distance, view.view_location = 3, (3, 0, 0)
    redraw()
    send("MIDDLEMOUSE", "PRESS", **at)
    send("MIDDLEMOUSE", "RELEASE", **at)
    yield 0.3
    redraw()
    assert abs(view.view_distance - 10) < 0.4, view.view_distance
    assert all(abs(a - b) < 1e-3 for r, q in zip(view.view_matrix, before) for a, b in zip(r, q))
    bpy.ops.mesh.primitive_cube_add(size=0.5, location=(6, -2, -2))
    cube, tools = bpy.context.object, scene.tool_settings
    tools.use_snap, tools.snap_elements = True, {"FACE"}
    yield 0.3
    send("MOUSEMOVE", "NOTHING", **at)
    yield 0.2
    send("G", "PRESS", **at)
    yield 0.2
    for dx in (3, 0):
        send("MOUSEMOVE", "NOTHING", x=at["x"] + dx, y=at["y"])
        yield 0.2
    send("LEFTMOUSE", "PRESS", **at)
    send("LEFTMOUSE", "RELEASE", **at)
    yield 0.3
    assert (cube.location - Vector(GREEN) - Vector((0, 0, 0.25))).length < 0.4, cube.location
    tools.use_snap = False


tell(story())
