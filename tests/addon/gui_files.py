# SPDX-License-Identifier: Apache-2.0
"""Tests the import's file browser in a real window. The browser shows only readable files. A double click on
scene.json or on a .ply in its folder imports the scene and selects its camera."""

import os
import sys

import bpy

HERE = os.path.dirname(os.path.abspath(__file__))
sys.path[:0] = [HERE, os.path.join(HERE, "..", "cli")]
from fixtures import write  # noqa: E402
from gui_browser import double_click, opened, until  # noqa: E402
from gui_case import FOLDER, in_view, sharp_shot, tell, view3d  # noqa: E402
from test_drive import make_drive  # noqa: E402

READ = ["background.ply", "b.compressed.ply", "c.spz", "d.splat", "e.pagsz", "f.PLY", "scene.json"]


def story():
    bpy.data.objects.remove(bpy.data.objects["Cube"])  # meshes are drawn, too, and the camera is in this one
    folder = make_drive(os.path.join(FOLDER, "street"))
    for name in READ[1:-1]:
        write(os.path.join(folder, name), b"")
    view3d().shading.type = "SOLID"
    for chosen, count in (("background.ply", 1), ("scene.json", 2)):
        yield from choose(folder, chosen, count)
    root = next(o for o in bpy.data.objects if o.pags.kind == "ROOT")
    assert (view3d().shading.type, view3d().region_3d.view_perspective) == ("RENDERED", "CAMERA")
    assert bpy.context.scene.camera.pags.root == root
    picture = yield from sharp_shot("imported")
    blue = sum(picture[4][at + 2] > 120 and picture[4][at] < 10 for at in range(0, len(picture[4]), picture[2]))
    assert blue > 0.1 * picture[0] * picture[1], "the street's sky isn't seen"


def choose(folder, name, count):
    """Chooses a file in the browser; checks the number of scenes and that all belong to the folder."""
    with in_view():
        assert bpy.ops.import_scene.pags("INVOKE_DEFAULT") == {"RUNNING_MODAL"}
    window, area, region = yield from opened(folder)
    space = area.spaces.active
    found = []

    def listed():
        with bpy.context.temp_override(window=window, area=area, region=region):
            bpy.ops.file.select_all(action="SELECT")
        found[:] = sorted(f.name for f in space.active_operator.properties.files)
        return len(found) >= len(READ)

    yield from until(listed)
    assert found == sorted(READ), found  # sky.npy and the folder `objects` aren't shown
    with bpy.context.temp_override(window=window, area=area, region=region):
        bpy.ops.file.select_all(action="DESELECT")
    yield from double_click(window, area, region, name)
    roots = lambda: [o for o in bpy.data.objects if o.pags.kind == "ROOT"]  # noqa: E731
    yield from until(lambda: len(roots()) == count)
    for root in roots():
        assert os.path.samefile(root.pags.path, folder), root.pags.path


tell(story())
