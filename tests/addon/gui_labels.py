# SPDX-License-Identifier: Apache-2.0
"""Tests the interface in a real window: the sidebar at its default width, a legend for each mode of Show, and the
label of a picked point. PAGS_LABEL_IMAGES names a folder for the manual's small pictures."""

import os
import subprocess
import sys
import types

import bpy
import numpy as np

sys.path.insert(0, os.path.dirname(os.path.abspath(__file__)))
from gui_buttons import panels  # noqa: E402
from gui_case import (  # noqa: E402
    FOLDER,
    SHOTS,
    addon,
    area,
    click,
    color,
    deselect,
    empty_scene,
    in_view,
    look_ahead,
    near,
    on_screen,
    open_tab,
    redraw,
    region,
    sharp_shot,
    shoot,
    tell,
    view3d,
    viewport,
    window,
)
from panel_widths import Measured  # noqa: E402
from test_drive import make_drive  # noqa: E402

WINDOW = "960x900"
IMAGES = os.environ.get("PAGS_LABEL_IMAGES", "")
# Tolerance in grey levels for the legend's bar. Blender blends drawings over a view with a power of 2.2 instead of
# sRGB's curve. This raises grey level 8 to 17.
LIFTED = 11
RED, SKY = (10, 0, 0), (10, 3, -2)  # positions in metres at the second frame
BESIDE = 48  # pixels of the sidebar next to a panel's items: tabs and margins
ORDER = ["PAGS scene", "Show", "Cameras", "Inspect", "Recording", "Measure", "Clean up and look", "Proxies"]
ORDER += ["Export and composite"]
draw = sys.modules[addon.__name__ + ".draw"]
legend = sys.modules[addon.__name__ + ".legend"]


def keep(shot, name, *options):
    """Saves the part of a screenshot that `convert`'s options select, with 96 colours, for the manual."""
    if IMAGES:
        target = os.path.join(IMAGES, f"blender-{name}.png")
        subprocess.run(
            [
                "convert",
                os.path.join(SHOTS, shot + ".png"),
                *options,
                "+dither",
                "-colors",
                "96",
                "-strip",
                "PNG8:" + target,
            ],
            check=True,
        )
        print(f"{target}: {os.path.getsize(target) // 1024} KB")


def story():
    empty_scene()
    make_drive(os.path.join(FOLDER, "scene"))
    assert bpy.ops.import_scene.pags(filepath=os.path.join(FOLDER, "scene")) == {"FINISHED"}
    bpy.context.scene.frame_set(2)
    overlay = view3d().overlay
    overlay.show_floor = overlay.show_axis_x = overlay.show_axis_y = overlay.show_object_origins = (
        overlay.show_extras
    ) = False
    overlay.show_outline_selected = False
    deselect()
    look_ahead()
    yield from open_tab()
    yield from picked()
    yield from sidebar()
    yield from legends("RENDERED")
    yield from legends("SOLID")
    yield from hidden()


def picked():
    """The picked point is shown until the time changes or the pick is undone."""
    scene = bpy.context.scene
    with in_view():
        bpy.ops.ed.undo_push(message="before")
        assert bpy.ops.pags.pick("INVOKE_DEFAULT") == {"RUNNING_MODAL"}
    yield 0.3
    x, y = on_screen(RED)
    yield from click(x, window().height - 1 - y)
    assert "Car c=2" in scene.pags_picked, scene.pags_picked
    yield from sharp_shot("picked")
    assert "Car c=2" in scene.pags_picked, "drawing has forgotten it"
    scene.frame_set(3)
    assert scene.pags_picked == ""
    scene.frame_set(2)
    with in_view():
        bpy.ops.pags.pick(x=x - region().x, y=window().height - 1 - y - region().y)
    assert "Car c=2" in scene.pags_picked, scene.pags_picked
    yield 0.3
    with in_view():
        bpy.ops.ed.undo()
    yield 0.3
    assert bpy.context.scene.pags_picked == "", bpy.context.scene.pags_picked
    deselect()


def in_order():
    """Returns the panels of the sidebar from top to bottom."""
    found = [kind for kind in panels() if kind.bl_space_type == "VIEW_3D"]
    return sorted(found, key=lambda kind: kind.bl_order)


def uncut(r):
    """Checks that no label of any panel is cut at the sidebar's width, with and without a selected object."""
    with in_view():
        draw.font(bpy.context)
        for active in (None, *(o for o in bpy.data.objects if o.pags.kind in {"ROOT", "OBJECT"})):
            bpy.context.view_layer.objects.active = active
            for kind in in_order():
                layout = Measured()
                kind.draw(types.SimpleNamespace(layout=layout), bpy.context)
                cut = layout.cut(r.width - BESIDE)
                assert not cut, f"{kind.bl_label}: {cut}"


def sidebar():
    """Takes pictures of the panels at the sidebar's default width, and measures their labels."""
    r = next(r for r in area().regions if r.type == "UI")
    assert [p.bl_label for p in in_order()] == ORDER, [p.bl_label for p in in_order()]
    for shading in ("RENDERED", "SOLID"):
        view3d().shading.type = shading
        yield from sharp_shot("sidebar-" + shading.lower())
        uncut(r)
    width = r.width + 8
    keep(
        "sidebar-rendered",
        "sidebar-panels",
        "-crop",
        f"{width}x{r.height}+{r.x - 8}+{window().height - r.y - r.height}",
        "+repage",
    )


def bar():
    """Returns left edge, middle row and width of the legend's bar in a screenshot."""
    with in_view():
        left, bottom, width, scale = legend.place(bpy.context)
    r = region()
    return r.x + left, window().height - 1 - (r.y + bottom + 0.5 * legend.HEIGHT * scale), width


def at(picture, x, y):
    start = (int(round(y)) * picture[0] + int(round(x))) * picture[2]
    return tuple(picture[4][start : start + 3])


def legends(shading):
    """In each mode, the bar has the scale's colours and the car has the colour of its value. The mode Colour has no
    legend."""
    view3d().shading.type = shading
    settings = bpy.context.scene.pags
    settings.mode = "rgb"
    plain = yield from sharp_shot(f"legend-{shading.lower()}-rgb")
    for mode in (*legend.SCALES, "critical"):
        settings.mode = mode
        name = f"legend-{shading.lower()}-{mode}"
        picture = yield from sharp_shot(name)
        left, y, width = bar()
        if mode == "critical":
            near(at(picture, left + 0.1 * width, y), [255 * v for v in legend.KINDS[0][0]], LIFTED)
        else:
            for share in (0.1, 0.35, 0.6, 0.9):
                near(at(picture, left + share * width, y), [255 * v for v in legend.color(mode, share)[:3]], LIFTED)
        letters = np.frombuffer(bytes(picture[4]), np.uint8).reshape(picture[1], picture[0], -1)[
            int(y) + 8 : int(y) + 20, int(left) : int(left + width), :3
        ]
        assert letters.min(axis=2).max() > 200, f"{name}: no numbers"
        assert any(
            abs(a - b) > 20
            for share in (0.1, 0.6)
            for a, b in zip(at(plain, left + share * width, y), at(picture, left + share * width, y))
        )
        if shading == "RENDERED" and mode == "priority":
            near(color(picture, RED), [255 * v for v in legend.color(mode, 1)[:3]], 6)
        if shading == "RENDERED" and mode == "size":
            near(color(picture, RED), [255 * v for v in legend.color(mode, legend.share(mode, 0.1))[:3]], 6)
            keep(name, "legend", "-crop", f"{int(width) + 40}x70+{int(left) - 20}+{int(y) - 30}", "+repage")
        assert all(v.error == "" for v in viewport.views)
    settings.mode = "rgb"


def hidden():
    """Hiding text hides the legend; hiding non-critical Gaussians hides the sky."""
    view3d().shading.type = "RENDERED"
    settings = bpy.context.scene.pags
    settings.mode = "size"
    view3d().overlay.show_text = False
    picture = yield from sharp_shot("no-text")
    left, y, width = bar()
    assert at(picture, left + 0.9 * width, y) == at(picture, left + 0.6 * width, y), "the legend stays"
    view3d().overlay.show_text, settings.mode = True, "rgb"
    settings.hide_noncritical = True
    picture = yield from sharp_shot("critical-only")
    near(color(picture, SKY), (0, 0, 0), 1)
    near(color(picture, RED), (255, 0, 0), 12)
    settings.hide_noncritical = False
    redraw()
    shoot("end")


tell(story())
