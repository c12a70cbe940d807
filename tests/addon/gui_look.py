# SPDX-License-Identifier: Apache-2.0
"""Tests the panel "Clean up and look" in a real window. Compares screenshots of the viewport with F12 and with `pags
render` of files exported with the same settings."""

import math
import os
import random
import sys

import bpy
import numpy as np

HERE = os.path.dirname(os.path.abspath(__file__))
sys.path[:0] = [HERE, os.path.join(HERE, "..", "cli")]
import fixtures  # noqa: E402
from fixtures import read_png, splat  # noqa: E402
from gui_case import FOLDER, deselect, empty_scene, in_view, look_ahead, region, sharp_shot, tell, view3d, window  # noqa: E402
from test_drive import make_drive  # noqa: E402

SCENE = os.path.join(FOLDER, "street")
EDGE = 32  # pixels
LEAST = 45  # dB, required by the add-on's specification


def psnr(a, b):
    """Returns the PSNR of two pictures of the region's size without edges, where Blender draws round corners and
    arrows."""
    a, b = (
        np.frombuffer(p, np.uint8).reshape(region().height, region().width, 3)[EDGE:-EDGE, EDGE:-EDGE].astype(float)
        for p in (a, b)
    )
    error = ((a - b) ** 2).mean()
    return 99.0 if error == 0 else 10 * math.log10(255**2 / error)


def viewport_alone():
    """Hides everything over the picture: header, tools, overlays and gizmos."""
    space = view3d()
    space.show_region_header = space.show_region_toolbar = space.show_region_tool_header = space.show_gizmo = False
    space.overlay.show_overlays = False


def on_screen(picture):
    """Returns the region's RGB samples, with row 0 at the top."""
    r, width = region(), picture[0]
    top = window().height - r.y - r.height
    rows = (((top + y) * width + r.x) * picture[2] for y in range(r.height))
    return b"".join(bytes(picture[4][start : start + r.width * picture[2]]) for start in rows)


def f12():
    scene = bpy.context.scene
    scene.render.filepath = os.path.join(FOLDER, "f12.png")
    bpy.ops.render.render(write_still=True)
    return bytes(read_png(scene.render.filepath)[4])


def program(name):
    """Returns the program's picture of a file for the scene's camera, on black."""
    camera, out = os.path.join(FOLDER, "camera.json"), os.path.join(FOLDER, "out")
    assert bpy.ops.export_scene.pags_path(filepath=camera, single=True) == {"FINISHED"}
    said = fixtures.run("render", os.path.join(FOLDER, name), "--camera", camera, "--background", "0,0,0", "-o", out)
    assert said.returncode == 0, said.stderr
    return bytes(read_png(os.path.join(out, "00000.png"))[4])


def story():
    empty_scene()
    dice = random.Random(3)
    make_drive(
        SCENE,
        [
            splat(
                dice.uniform(6, 20),
                dice.uniform(-4, 4),
                dice.uniform(-2, 3),
                [dice.random() for _ in range(3)],
                sigma=0.1,
            )
            for _ in range(1500)
        ],
    )
    assert bpy.ops.import_scene.pags(filepath=SCENE) == {"FINISHED"}
    scene = bpy.context.scene
    scene.frame_set(2)
    deselect()
    look_ahead()
    viewport_alone()
    scene.pags.use_background, scene.pags.background = True, (0, 0, 0)
    yield from sharp_shot("plain")
    with in_view():
        assert bpy.ops.pags.camera_here() == {"FINISHED"}
    look_ahead()
    r, render = region(), scene.render
    render.resolution_x, render.resolution_y, render.resolution_percentage = r.width, r.height, 100
    render.image_settings.file_format, render.image_settings.color_mode, render.dither_intensity = "PNG", "RGB", 0
    root = next(o for o in scene.objects if o.pags.kind == "ROOT")
    before = on_screen((yield from sharp_shot("before")))
    look = root.pags_look
    look.exposure, look.tint, look.saturation, look.contrast, look.sh, look.opacity = (
        0.4,
        (1, 0.85, 0.7),
        0.7,
        1.2,
        0.5,
        0.8,
    )
    look.least_opacity, look.greatest_size = 0.02, 0.3
    part = next(o for o in scene.objects if o.pags.kind == "OBJECT" and o.pags.index == 1)
    part.pags_look.exposure = -1
    after = on_screen((yield from sharp_shot("after")))
    assert psnr(before, after) < 30, "the settings aren't seen"
    figures = {"F12": f12()}
    for name in ("a.ply", "a.pagsz", "a.spz"):
        assert bpy.ops.export_scene.pags(filepath=os.path.join(FOLDER, name)) == {"FINISHED"}
        figures[name[1:]] = program(name)
    for name, picture in figures.items():
        print(f"figures: the viewport's pixels and {name}: {psnr(after, picture):.1f} dB")
    for name, picture in figures.items():
        assert psnr(after, picture) > LEAST, f"{name}: {psnr(after, picture):.1f} dB"


tell(story())
