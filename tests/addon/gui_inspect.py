# SPDX-License-Identifier: Apache-2.0
"""Tests the panel "Inspect" in a real window: photographs over the 3D view and their list, a wipe between two
scenes, a distance between two clicks, a view on the ground, LiDAR points and boxes, counts of Gaussians, and a scene
that is written again while shown."""

import json
import os
import sys
import time

import bpy
import numpy as np
from mathutils import Vector

HERE = os.path.dirname(os.path.abspath(__file__))
sys.path[:0] = [HERE, os.path.join(HERE, "..", "cli")]
import fixtures  # noqa: E402
from drive_set import make_set, make_sweeps  # noqa: E402
from fixtures import ply_bytes, png_bytes, splat, write  # noqa: E402
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
    window,
)  # noqa: E402
from test_drive import make_drive, sky_npy  # noqa: E402

part = lambda name: sys.modules[f"{addon.__name__}.{name}"]
comparison, jobs, watch, native = part("comparison"), part("jobs"), part("watch"), part("native")
SCENE, OTHER, SET = (os.path.join(FOLDER, name) for name in ("street", "other", "set"))
WHITE, GREEN = (10, 0, 3), (10, 1.5, 0)
PHOTO = (200, 30, 90)


def until(done, seconds=120):
    end = time.monotonic() + seconds * PATIENCE
    while not done():
        assert time.monotonic() < end, "it takes too long"
        yield 0.05


def pave():
    rows = []
    for x in range(30):
        for y in range(-6, 7):
            flat = splat(3 + 0.4 * x, 0.4 * y, -1.6, (0.3, 0.3, 0.3), sigma=0.3, opacity=12.0)
            flat[12] = -5.0  # the third scale is a few millimetres
            rows.append(flat)
    return rows


def make_scenes():
    """Makes the scenes. One photograph, of the front camera, is uniform and has exposure gain 1.1; the others are
    rendered from the scene."""
    make_drive(SCENE, pave())
    make_set(SCENE, SET)
    write(os.path.join(SET, "images", "001_0.png"), png_bytes(101, 101, bytes(PHOTO) * 101 * 101))
    make_sweeps(
        SET,
        lambda t: [[8, 0.05 * k - 1, 0.3 + 0.02 * j, 1.0] for k in range(40) for j in range(20)],
        lambda t: (0, 0, 0),
    )
    path = os.path.join(SET, "dataset.json")
    write(path, json.dumps({**json.loads(fixtures.read(path)), "lidar_columns": ["x", "y", "z", "intensity"]}))
    make_drive(OTHER)
    write(os.path.join(OTHER, "sky.npy"), sky_npy([0.5, 0.0, 0.0]))


taken = []


def watched(function, name):
    def call(*arguments):
        begin = time.perf_counter()
        try:
            return function(*arguments)
        finally:
            taken.append((time.perf_counter() - begin, name))

    return call


def story():
    empty_scene()
    make_scenes()
    assert bpy.ops.import_scene.pags(filepath=SCENE) == {"FINISHED"}
    view3d().overlay.show_floor = view3d().overlay.show_axis_x = view3d().overlay.show_axis_y = False
    view3d().overlay.show_object_origins = view3d().overlay.show_extras = view3d().overlay.show_outline_selected = False
    deselect()
    space = bpy.types.SpaceView3D
    space.draw_handler_remove(comparison._handle, "WINDOW")
    comparison._handle = space.draw_handler_add(
        watched(comparison.on_draw, "comparison drawn"), (), "WINDOW", "POST_PIXEL"
    )
    comparison.tick = watched(comparison.tick, "comparison made")
    yield from compared()
    yield from listed()
    yield from counted()
    yield from recorded()
    yield from measured()
    yield from stood()
    yield from wiped()
    yield from written_anew()
    longest = sorted(taken, reverse=True)[:3]
    print("figures: longest calls", ", ".join(f"{1e3 * seconds:.0f} ms {name}" for seconds, name in longest))


# ---- Photographs ----


def over(picture, view, u, v):
    """Returns the screen's colour at a photograph's pixel."""
    with in_view():
        left, bottom, right, top = comparison.place_of(bpy.context, view)
    r, u, v = region(), (u + 0.5) / view["width"], 1 - (v + 0.5) / view["height"]
    x = int(r.x + r.width * (0.5 + 0.5 * (left + u * (right - left))))
    y = int(window().height - 1 - (r.y + r.height * (0.5 + 0.5 * (bottom + v * (top - bottom)))))
    at = (y * picture[0] + x) * picture[2]
    return tuple(picture[4][at : at + 3])


def pair(name, ssim=False):
    """Yields until the pair of photograph and picture is made and on the screen; returns it."""
    found = lambda: next(
        (p for (_, _, n), p in comparison._pairs.items() if n == name and not isinstance(p, str)), None
    )
    yield from until(lambda: found() is not None and (not ssim or found().ssim is not None))
    yield 0.5
    return found()


def compared():
    settings, scene = bpy.context.scene.pags, bpy.context.scene
    scene.frame_set(2)
    yield from sharp_shot("before-wipe")
    settings.comparison = "WIPE"
    made = yield from pair("001_0.png")
    view = made.view
    near(over(shoot("first-wipe", again=False), view, 15, 90), PHOTO, 6)  # without a further redraw
    settings.wipe = 0.3
    picture = yield from sharp_shot("wipe")
    near(over(picture, view, 15, 90), PHOTO, 6)
    near(over(picture, view, 85, 10), (0, 0, 140), 6)  # the sky with exposure gain
    settings.wipe = 0.95
    picture = yield from sharp_shot("wipe-right")
    near(over(picture, view, 85, 10), PHOTO, 6)
    settings.comparison = "DIFFERENCE"
    picture = yield from sharp_shot("difference")
    near(over(picture, view, 85, 10), (255, 120, 200), 10)  # 4 |(200, 30, 90) - (0, 0, 140)|
    settings.comparison = "SSIM"
    made = yield from pair("001_0.png", ssim=True)
    assert "SSIM" in made.line() and "(held out)" in made.line() and made.ssim.mean() < 0.8, made.line()
    picture = yield from sharp_shot("ssim")
    assert sum(over(picture, view, 50, 50)) > 300
    scene.frame_set(1)  # the comparison follows the timeline; photograph and picture are equal at this time
    made = yield from pair("000_0.png", ssim=True)
    assert made.psnr > 50, made.psnr
    picture = yield from sharp_shot("alike")
    assert max(over(picture, made.view, 50, 30)) < 40
    settings.comparison = "DIFFERENCE"
    picture = yield from sharp_shot("alike-difference")
    assert max(over(picture, made.view, 50, 30)) < 10
    scene.frame_set(2)
    os.rename(os.path.join(SET, "images", "001_1.png"), os.path.join(SET, "images", "away.png"))
    scene.camera = next(o for o in bpy.data.objects if o.type == "CAMERA" and o.data.pags.sensor == 1)
    yield from until(lambda: any(isinstance(p, str) and "001_1.png" in p for p in comparison._pairs.values()))
    os.rename(os.path.join(SET, "images", "away.png"), os.path.join(SET, "images", "001_1.png"))
    yield 0.3
    scene.camera = next(o for o in bpy.data.objects if o.type == "CAMERA" and o.data.pags.sensor == 0)


def listed():
    manager = bpy.context.scene
    with in_view():
        bpy.ops.pags.rank("INVOKE_DEFAULT")
    yield from until(lambda: jobs.current is None)
    names = [item.name for item in manager.pags_photographs if item.kind == "PHOTOGRAPH"]
    assert names[0] == "001_0.png" and len(names) == 6, names
    bpy.context.scene.frame_set(1)
    view3d().region_3d.view_perspective = "PERSP"
    with in_view():
        manager.pags_photograph = 0
    assert bpy.context.scene.frame_current == 2 and view3d().region_3d.view_perspective == "CAMERA"
    bpy.context.scene.pags.comparison = "WIPE"
    bpy.context.scene.pags.wipe = 0.5
    view3d().show_region_ui = True
    yield from pair("001_0.png")
    yield from sharp_shot("list")
    view3d().show_region_ui = False
    bpy.context.scene.pags.comparison = "NONE"
    yield 0.3


# ---- The rest ----


def counted():
    settings = bpy.context.scene.pags
    view3d().shading.type = "RENDERED"
    look_ahead()
    before = yield from sharp_shot("colour")
    settings.mode = "count"
    count = yield from sharp_shot("count")
    settings.mode = "overdraw"
    yield from sharp_shot("overdraw")
    road, sky = (8, 0, -1.6), (10, -3, 1)
    assert color(count, road) != color(before, road)
    assert sum(color(count, road)) > sum(color(count, sky)) + 60, (color(count, road), color(count, sky))
    settings.mode = "rgb"


def recorded():
    look_ahead()
    before = yield from sharp_shot("no-lidar")
    with in_view():
        bpy.ops.pags.lidar("INVOKE_DEFAULT")
    yield from until(lambda: jobs.current is None)
    with in_view():
        bpy.ops.pags.boxes("INVOKE_DEFAULT")
    yield from until(lambda: jobs.current is None)
    deselect()
    after = yield from sharp_shot("recording")
    x, y = on_screen((8, 0, 0.5))
    patch = lambda p: np.array(
        [tuple(p[4][((y + j) * p[0] + x + i) * p[2] :][:3]) for j in range(-4, 5) for i in range(-4, 5)]
    ).astype(int)
    assert np.abs(patch(after) - patch(before)).max() > 60, "the LiDAR points aren't seen"
    for block in [o for o in bpy.data.objects if "pags_lidar" in o or "pags_box" in o]:
        block.hide_set(True)


def measured():
    look_ahead()
    yield from sharp_shot("before-distance")
    with in_view():
        assert bpy.ops.pags.distance("INVOKE_DEFAULT") == {"RUNNING_MODAL"}
    yield 0.2
    for point in (WHITE, GREEN):
        x, y = on_screen(point)
        for kind, value in (("MOUSEMOVE", "NOTHING"), ("LEFTMOUSE", "PRESS"), ("LEFTMOUSE", "RELEASE")):
            window().event_simulate(type=kind, value=value, x=x, y=window().height - 1 - y)
            yield 0.2
    said = bpy.context.scene.pags_distance
    assert abs(float(said.split()[0]) - np.hypot(3, 1.5)) < 0.05, said
    assert "-3.0" in said or "-2.9" in said, said
    picture = yield from sharp_shot("distance")
    x, y = on_screen(0.75 * np.array(WHITE) + 0.25 * np.array(GREEN))  # on the line, above its text
    around = [
        tuple(picture[4][((y + j) * picture[0] + x + i) * picture[2] :][:3]) for j in range(-3, 4) for i in range(-3, 4)
    ]
    assert any(c[0] > 200 and c[2] < 120 for c in around), around
    bpy.ops.pags.forget_distance()


def stood():
    rv3d = view3d().region_3d
    rv3d.view_perspective = "PERSP"
    rv3d.view_distance = 4
    eye, goal = Vector((6, 0.1, 5)), Vector((12, 0.1, -1))
    rv3d.view_rotation = (goal - eye).to_track_quat("-Z", "Y")
    rv3d.view_location = eye + rv3d.view_rotation @ Vector((0, 0, -4))
    redraw()
    yield 0.2
    with in_view():
        assert bpy.ops.pags.stand(height=1.5) == {"FINISHED"}
    redraw()
    yield 0.2
    stands = rv3d.view_matrix.inverted()
    assert (stands.translation - Vector((6, 0.1, -0.1))).length < 0.06, stands.translation
    assert abs((stands.to_3x3() @ Vector((0, 0, -1))).z) < 1e-4
    yield from sharp_shot("stood")


def wiped():
    assert bpy.ops.import_scene.pags(filepath=OTHER) == {"FINISHED"}
    scene, settings = bpy.context.scene, bpy.context.scene.pags
    scene.frame_set(2)
    deselect()
    look_ahead()
    settings.wipe = 0.5
    for shading in ("RENDERED", "SOLID"):
        view3d().shading.type = shading
        settings.wipe_root = bpy.data.objects[os.path.basename(OTHER)]
        picture = yield from sharp_shot("two-" + shading.lower())
        if shading == "RENDERED":
            # the left half has the first scene's sky, the right half the other's
            near(color(picture, (10, 3, 1)), (0, 0, 128))
            near(color(picture, (10, -3, 1)), (128, 0, 0))
        near(color(picture, GREEN), (0, 255, 0), 30)
        settings.wipe = 0.1
        picture = yield from sharp_shot("two-moved-" + shading.lower())
        if shading == "RENDERED":
            near(color(picture, (10, 2, 1)), (128, 0, 0))
        settings.wipe = 0.5
        settings.wipe_root = None
    view3d().shading.type = "RENDERED"
    picture = yield from sharp_shot("together")
    near(color(picture, (10, -3, 1)), color(picture, (10, 3, 1)))
    for block in list(bpy.data.objects[os.path.basename(OTHER)].children_recursive) + [
        bpy.data.objects[os.path.basename(OTHER)]
    ]:
        bpy.data.objects.remove(block)


def written_anew():
    """When the car's file and scene.json are written again, the car's colour changes automatically and a notice
    appears."""
    scene, notices = bpy.context.scene, []
    modal = jobs.PAGS_OT_job.modal

    def noting(self, context, event):
        job = jobs.current
        answer = modal(self, context, event)
        if answer == {"FINISHED"}:
            notices.append(job.notice)
        return answer

    jobs.PAGS_OT_job.modal = noting
    scene.frame_set(2)
    look_ahead()
    picture = yield from sharp_shot("before-anew")
    near(color(picture, (10, 0, 0)), (255, 0, 0), 20)
    write(os.path.join(SCENE, "objects", "car.ply"), ply_bytes([splat(0, 0, 0, (1, 1, 0), sigma=0.1, opacity=12.0)]))
    path = os.path.join(SCENE, "scene.json")
    with open(path, encoding="utf-8") as file:
        record = json.load(file)
    write(path, json.dumps(record, indent=1))
    yield from until(lambda: bool(notices), 60)
    assert "was reloaded" in notices[0], notices
    picture = yield from sharp_shot("anew")
    near(color(picture, (10, 0, 0)), (255, 255, 0), 20)
    jobs.PAGS_OT_job.modal = modal


tell(story())
