# SPDX-License-Identifier: Apache-2.0
"""The import's file browser in a real window: it shows what can be read, and a scene.json chosen there is imported."""

import os
import sys

import bpy

sys.path.insert(0, os.path.dirname(os.path.abspath(__file__)))
from gui_case import FOLDER, PATIENCE, in_view, tell  # noqa: E402

from fixtures import write  # noqa: E402
from test_drive import make_drive  # noqa: E402

READ = ["background.ply", "b.compressed.ply", "c.spz", "d.splat", "e.pagsz", "f.PLY", "scene.json"]


def browsers():
    windows = bpy.context.window_manager.windows
    return [(w, a) for w in windows for a in w.screen.areas if a.type == "FILE_BROWSER"]


def until(done):
    """Yields until `done()` holds."""
    for _ in range(int(200 * PATIENCE)):
        if done():
            return
        yield 0.1
    raise AssertionError("the file browser takes too long")


def story():
    folder = make_drive(os.path.join(FOLDER, "street"))
    for name in READ[1:-1]:
        write(os.path.join(folder, name), b"")
    with in_view():
        assert bpy.ops.import_scene.pags("INVOKE_DEFAULT") == {"RUNNING_MODAL"}
    yield from until(browsers)
    window, area = browsers()[0]
    space = area.spaces.active
    yield from until(lambda: space.params is not None)
    yield 1 * PATIENCE  # operators of the browser crash Blender before it has drawn itself
    space.params.directory = folder.encode()
    yield 1 * PATIENCE
    region = next(r for r in area.regions if r.type == "WINDOW")
    found = []

    def listed():
        with bpy.context.temp_override(window=window, area=area, region=region):
            bpy.ops.file.select_all(action="SELECT")
        found[:] = sorted(f.name for f in space.active_operator.properties.files)
        return len(found) >= len(READ)

    yield from until(listed)
    assert found == sorted(READ), found  # and neither sky.npy nor the folder objects
    with bpy.context.temp_override(window=window, area=area, region=region):
        bpy.ops.file.select_all(action="DESELECT")
    space.activate_file_by_relative_path(relative_path="scene.json")
    yield 0.5
    with bpy.context.temp_override(window=window, area=area, region=region):
        bpy.ops.file.execute()
    yield from until(lambda: any(o.pags.kind == "ROOT" for o in bpy.data.objects))
    root = next(o for o in bpy.data.objects if o.pags.kind == "ROOT")
    assert os.path.samefile(root.pags.path, folder), root.pags.path


tell(story())
