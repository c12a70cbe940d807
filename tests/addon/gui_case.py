# SPDX-License-Identifier: Apache-2.0
"""Shared by the scripts that drive a Blender with a window: its 3D view, screenshots read back, waiting for sharp pictures.

A story is a generator that yields the seconds until it wants to go on; a timer tells it, as a user's clicks would.
PAGS_SHOTS names a folder that keeps the screenshots."""

import os
import shutil
import subprocess
import sys
import tempfile
import time
import traceback

import bpy
import numpy as np
from blender_case import addon
from fixtures import read_png
from mathutils import Euler

viewport = sys.modules[addon.__name__ + ".viewport"]
stopwatch = sys.modules[addon.__name__ + ".stopwatch"]
overlay = sys.modules[addon.__name__ + ".overlay"]
lens = sys.modules[addon.__name__ + ".lens"]
native = sys.modules[addon.__name__ + ".native"]

FOLDER = tempfile.mkdtemp(prefix="pags-gui-")
SHOTS = os.environ.get("PAGS_SHOTS", FOLDER)
# How much longer than on a machine of its own things may take.
PATIENCE = float(os.environ.get("PAGS_PATIENCE", "1"))
bpy.context.preferences.view.show_splash = False


def window():
    return bpy.context.window_manager.windows[0]


def area():
    return next(a for a in window().screen.areas if a.type == "VIEW_3D")


def region():
    return next(r for r in area().regions if r.type == "WINDOW")


def view3d():
    return area().spaces.active


def in_view():
    """The context that operators of the 3D view want."""
    return bpy.context.temp_override(window=window(), area=area(), region=region())


def look_ahead():
    """From the origin along x."""
    rv3d = view3d().region_3d
    rv3d.view_perspective = "PERSP"
    rv3d.view_rotation = Euler((np.pi / 2, 0, -np.pi / 2)).to_quaternion()
    rv3d.view_distance, rv3d.view_location = 10, (10, 0, 0)


def empty_scene():
    for block in list(bpy.data.objects):
        bpy.data.objects.remove(block)


def deselect():
    for block in bpy.context.selected_objects:
        block.select_set(False)


def redraw():
    with in_view():
        bpy.ops.wm.redraw_timer(type="DRAW_WIN_SWAP", iterations=1)


def shoot(name):
    """The whole screen as (width, height, channels, bits, samples)."""
    redraw()
    path = os.path.join(SHOTS, name + ".png")
    print("shot", name, f"{time.monotonic() - started:.0f} s")
    subprocess.run(["import", "-window", "root", "-depth", "8", "-type", "TrueColor", "png24:" + path], check=True)
    return read_png(path)


def in_region(point):
    """Column and row, from the region's top, of a point of the world."""
    rv3d, r = view3d().region_3d, region()
    values, pose = lens.of_view(rv3d.window_matrix, rv3d.view_matrix, r.width, r.height)
    x, y, z = np.linalg.inv(pose)[:3] @ np.array([*point, 1.0])
    return int(values["fx"] * x / z + values["cx"]), int(values["fy"] * y / z + values["cy"])


def on_screen(point):
    """Column and row, from the top, of a point of the world in a screenshot."""
    u, v = in_region(point)
    r = region()
    return r.x + u, window().height - r.y - r.height + v


def color(picture, point):
    x, y = on_screen(point)
    at = (y * picture[0] + x) * picture[2]
    return tuple(picture[4][at : at + 3])


def settled():
    """All is drawn and sharp."""
    return len(viewport.views) > 0 and all(
        v.shown is not None and not v.restless() and not v.shown.unsharp for v in viewport.views
    )


def near(value, wanted, by=4):
    assert all(abs(a - b) <= by for a, b in zip(value, wanted)), f"{value} is not {wanted}"


def wait(seconds=200):
    """Yields until all views are sharp."""
    end = time.monotonic() + seconds * PATIENCE
    yield 0.1
    while not settled():
        assert time.monotonic() < end, [(v.error, v.shown and v.shown.stats, v.job) for v in viewport.views]
        yield 0.05


def sharp_shot(name):
    """Yields until all is sharp and shown, then takes a picture; use as `picture = yield from sharp_shot(...)`."""
    yield 0.3
    yield from wait()
    yield 0.3
    return shoot(name)


# ---- The sidebar ----


def click(x, y):
    """Window coordinates, y from below."""
    for kind, value in (("MOUSEMOVE", "NOTHING"), ("LEFTMOUSE", "PRESS"), ("LEFTMOUSE", "RELEASE")):
        window().event_simulate(type=kind, value=value, x=int(x), y=int(y))
        yield 0.3


def open_tab():
    """The sidebar's tab PAGS. Blender 3.4 has no way to name it: tabs are clicked until its panel is drawn."""
    view3d().show_region_ui = True
    yield 0.5
    redraw()
    ui = next(r for r in area().regions if r.type == "UI")
    if hasattr(ui, "active_panel_category"):
        ui.active_panel_category = "PAGS"
        return
    drawn, panel = [], bpy.types.PAGS_PT_scene
    draw = panel.draw
    panel.draw = lambda self, context: (drawn.append(True), draw(self, context))
    for down in (170, 190, 210, 150, 230, 250, 130, 270):
        yield from click(ui.x + ui.width - 9, ui.y + ui.height - down)
        redraw()
        if drawn:
            print("tab at", down)
            break
    panel.draw = draw
    assert drawn, "the tab PAGS isn't found"


# ---- Telling ----

started = time.monotonic()


def end(code):
    shutil.rmtree(FOLDER, ignore_errors=True)
    if code == 0:
        print("all tests passed")
    sys.stdout.flush()
    os._exit(code)


def tell(story, seconds=800):
    """Tells it and ends Blender, with exit code 3 where something in it fails or it takes too long."""

    def run():
        try:
            assert time.monotonic() - started < seconds * PATIENCE, "the story takes too long"
            return next(story)
        except StopIteration:
            end(0)
        except BaseException:
            traceback.print_exc()
            try:
                shoot("failed")
            finally:
                end(3)

    bpy.app.timers.register(run, first_interval=1.0)
