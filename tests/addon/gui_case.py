# SPDX-License-Identifier: Apache-2.0
"""Shared code of scripts that control a Blender with a window: the 3D view, screenshots, waiting for sharp pictures.

A story is a generator that yields the seconds until its next step; a timer runs its steps like a user's actions.
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
# Factor by which time limits are longer on a busy machine.
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
    """Returns the context that operators of the 3D view need."""
    return bpy.context.temp_override(window=window(), area=area(), region=region())


def look_ahead():
    """Sets the view to look from the origin along x."""
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


def shoot(name, again=True):
    """Takes a screenshot, after a redraw if `again`; returns (width, height, channels, bits, samples)."""
    if again:
        redraw()
    path = os.path.join(SHOTS, name + ".png")
    print("shot", name, f"{time.monotonic() - started:.0f} s")
    subprocess.run(["import", "-window", "root", "-depth", "8", "-type", "TrueColor", "png24:" + path], check=True)
    return read_png(path)


def in_region(point):
    """Returns column and row of a point of the world, from the region's top."""
    rv3d, r = view3d().region_3d, region()
    values, pose = lens.of_view(rv3d.window_matrix, rv3d.view_matrix, r.width, r.height)
    x, y, z = np.linalg.inv(pose)[:3] @ np.array([*point, 1.0])
    return int(values["fx"] * x / z + values["cx"]), int(values["fy"] * y / z + values["cy"])


def on_screen(point):
    """Returns column and row of a point of the world in a screenshot, from its top."""
    u, v = in_region(point)
    r = region()
    return r.x + u, window().height - r.y - r.height + v


def color(picture, point):
    x, y = on_screen(point)
    at = (y * picture[0] + x) * picture[2]
    return tuple(picture[4][at : at + 3])


def settled():
    """Returns whether all views are drawn and sharp."""
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
    """Yields until all views are sharp and shown, then takes a screenshot: `picture = yield from sharp_shot(...)`."""
    yield 0.3
    yield from wait()
    yield 0.3
    return shoot(name)


# ---- The sidebar ----


def click(x, y):
    """Clicks at window coordinates, with y from the bottom."""
    for kind, value in (("MOUSEMOVE", "NOTHING"), ("LEFTMOUSE", "PRESS"), ("LEFTMOUSE", "RELEASE")):
        window().event_simulate(type=kind, value=value, x=int(x), y=int(y))
        yield 0.3


def open_tab():
    """Opens the sidebar's tab PAGS. Blender 3.4 can't open it by name: tabs are clicked until its panel is drawn."""
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


# ---- Running a story ----

started = time.monotonic()


def end(code):
    shutil.rmtree(FOLDER, ignore_errors=True)
    if code == 0:
        print("all tests passed")
    sys.stdout.flush()
    os._exit(code)


def tell(story, seconds=800):
    """Runs a story, then ends Blender, with exit code 3 if an error occurs or the time limit is exceeded."""

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
