# SPDX-License-Identifier: Apache-2.0
"""Controls Blender's file browser, open in a window."""

import time

import bpy
from gui_case import PATIENCE


def browsers():
    windows = bpy.context.window_manager.windows
    return [(w, a) for w in windows for a in w.screen.areas if a.type == "FILE_BROWSER"]


def until(done, seconds=120):
    """Yields until `done()` is true."""
    end = time.monotonic() + seconds * PATIENCE
    while not done():
        assert time.monotonic() < end, "it takes too long"
        yield 0.1


def opened(folder=None):
    """Yields until a file browser is open, and shows the folder in it; returns the browser's window, area and
    region."""
    yield from until(browsers)
    window, area = browsers()[0]
    yield from until(lambda: area.spaces.active.params is not None)
    yield 1 * PATIENCE  # operators of the browser crash Blender before the browser is drawn for the first time
    if folder is not None:
        area.spaces.active.params.directory = folder.encode()
        yield 1 * PATIENCE
    return window, area, next(r for r in area.regions if r.type == "WINDOW")


def double_click(window, area, region, name):
    """Clicks on the rows of the list until the file is active, then calls the operator of a double click."""
    for down in range(30, region.height, 10):
        for kind, value in (("MOUSEMOVE", "NOTHING"), ("LEFTMOUSE", "PRESS"), ("LEFTMOUSE", "RELEASE")):
            window.event_simulate(type=kind, value=value, x=region.x + 60, y=region.y + region.height - down)
            yield 0.1
        with bpy.context.temp_override(window=window, area=area, region=region):
            if bpy.context.active_file is not None and bpy.context.active_file.name == name:
                return bpy.ops.file.mouse_execute("INVOKE_DEFAULT")
    raise AssertionError(f"the browser doesn't show {name}")


def accept(window, area, region, name=""):
    """Types the name and presses the browser's confirm button."""
    if name:
        area.spaces.active.params.filename = name
        yield 0.3 * PATIENCE
    with bpy.context.temp_override(window=window, area=area, region=region):
        bpy.ops.file.execute()
    yield 0.3
