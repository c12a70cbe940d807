# SPDX-License-Identifier: Apache-2.0
"""The pictures of docs/blender-guide.md: the steps of the guide, done in a window on the synthetic street, each looked at for what
has to be seen in it.

PAGS_GUIDE_SCENE names the trained street (`make demo` leaves one in build/demo/scene), PAGS_GUIDE_IMAGES a folder that keeps the
pictures."""

import glob
import os
import subprocess
import sys

import bpy
import numpy as np
from mathutils import Matrix, Vector

sys.path.insert(0, os.path.dirname(os.path.abspath(__file__)))
from gui_case import (  # noqa: E402
    FOLDER,
    addon,
    area,
    click,
    deselect,
    in_region,
    in_view,
    lens,
    native,
    open_tab,
    region,
    sharp_shot,
    shoot,
    tell,
    view3d,
    wait,
    window,
)

from fixtures import read_png  # noqa: E402

WINDOW = "960x600"
SCENE = os.environ.get("PAGS_GUIDE_SCENE", "")
STREET = os.path.join(FOLDER, "street")
IMAGES = os.environ.get("PAGS_GUIDE_IMAGES", FOLDER)
# Some of them alone: "rendered sidebar" and the like, in this order.
STEPS = os.environ.get("PAGS_GUIDE_STEPS", "imported rendered sidebar inspected recorded counted moved underway meshes composited several").split()
FRAME = int(os.environ.get("PAGS_GUIDE_FRAME", "14"))
inspector = sys.modules[addon.__name__ + ".inspector"]
composite = sys.modules[addon.__name__ + ".composite"]


def keep(name, source=None, crop=()):
    """In few colours, for a page; source: a picture other than the screen's; crop: convert's options for a part of it."""
    os.makedirs(IMAGES, exist_ok=True)
    source = source or os.path.join(os.environ.get("PAGS_SHOTS", FOLDER), name + ".png")
    target = os.path.join(IMAGES, f"blender-{name}.png")
    subprocess.run(["convert", source, *crop, "+dither", "-colors", "128", "-strip", "PNG8:" + target], check=True)
    print(f"{target}: {os.path.getsize(target) // 1024} KB")


def inside(picture):
    """Samples of the 3D view's region, (height, width, 3), row 0 at the top."""
    r = region()
    whole = np.frombuffer(bytes(picture[4]), dtype=np.uint8).reshape(picture[1], picture[0], picture[2])
    top = picture[1] - r.y - r.height
    return whole[top : top + r.height, r.x : r.x + r.width, :3].astype(int)


def picture_of(name, crop=()):
    """A sharp screenshot that isn't empty, kept."""
    picture = yield from sharp_shot(name)
    assert inside(picture).std() > 15, f"{name}: there is hardly anything to be seen"
    keep(name, crop=crop)
    return inside(picture)


# ---- The story ----


def story():
    os.symlink(os.path.abspath(SCENE), STREET)
    with in_view():  # a file that has a place: the scene's path is shown relative to it
        bpy.ops.wm.save_as_mainfile(filepath=os.path.join(FOLDER, "guide.blend"))
    assert bpy.ops.import_scene.pags(filepath=STREET) == {"FINISHED"}
    for name in ("Cube", "Light", "Camera"):
        if name in bpy.data.objects:
            bpy.data.objects.remove(bpy.data.objects[name])
    bpy.context.scene.frame_set(FRAME)
    overlay = view3d().overlay
    overlay.show_floor = overlay.show_axis_x = overlay.show_axis_y = False
    overlay.show_object_origins = overlay.show_extras = False
    view3d().shading.type = "RENDERED"
    for step in STEPS:
        yield from globals()[step]()


def imported():
    view3d().region_3d.view_perspective = "CAMERA"
    with in_view():
        bpy.ops.view3d.view_center_camera()
    yield from picture_of("imported")


def from_above():
    """From above and behind the recording car."""
    ego = bpy.data.objects["ego"].matrix_world
    rv3d = view3d().region_3d
    rv3d.view_perspective = "PERSP"
    eye, goal = ego @ Vector((-3, 0.5, 2.5)), ego @ Vector((18, -1, -1.0))
    rv3d.view_rotation = (goal - eye).to_track_quat("-Z", "Y")
    rv3d.view_distance, rv3d.view_location = (goal - eye).length, goal


def rendered():
    from_above()
    yield from picture_of("rendered")


def cars_ahead():
    """Parts of cars before the recording car, the nearest first."""
    ego, found = bpy.data.objects["ego"].matrix_world.inverted(), []
    for part in bpy.data.objects:
        if part.pags.kind == "OBJECT" and part.get("pags_category") == "vehicle" and not part.hide_viewport:
            at = ego @ part.matrix_world.translation
            if 6 < at.x < 35 and abs(at.y) < 9:
                found.append((at.x, part))
    return [part for _, part in sorted(found, key=lambda pair: pair[0])]


def car_in_sight():
    """The nearest whose middle nothing hides, and its pixel in the region, row 0 at the top."""
    r, rv3d = region(), view3d().region_3d
    values, pose = lens.of_view(rv3d.window_matrix, rv3d.view_matrix, r.width, r.height)
    for part in cars_ahead():
        x, y = in_region(part.matrix_world.translation)
        if 80 < x < r.width - 240 and 80 < y < r.height - 20:
            seen = inspector.pick(bpy.context, values, pose, x, y)
            if seen is not None and seen["object"] == part.pags.index:
                return part, x, y
    raise AssertionError("no car is in sight")


def sidebar():
    """A car picked by a click, priorities as colours, the sidebar's tab PAGS."""
    from_above()
    yield from wait()
    car, x, y = car_in_sight()
    with in_view():
        bpy.ops.pags.pick("INVOKE_DEFAULT")
    yield 0.2
    r = region()
    yield from click(r.x + x, r.y + r.height - 1 - y)
    assert car["pags_id"] in bpy.context.scene.pags_picked, (car["pags_id"], bpy.context.scene.pags_picked)
    assert bpy.context.view_layer.objects.active == car
    yield from open_tab()
    before = yield from sharp_shot("colour")
    bpy.context.scene.pags.mode = "priority"
    after = yield from picture_of("sidebar")
    assert np.abs(after - inside(before)).mean() > 10, "priorities look like colours"
    bpy.context.scene.pags.mode = "rgb"
    view3d().show_region_ui = False
    deselect()
    yield 0.3


def inspected():
    """The photograph of the recorded camera over the left of the picture, and the list of photographs; skipped where the recording isn't there."""
    comparison, jobs = (sys.modules[f"{addon.__name__}.{name}"] for name in ("comparison", "jobs"))
    settings, manager = bpy.context.scene.pags, bpy.context.window_manager
    with in_view():
        bpy.ops.pags.rank("INVOKE_DEFAULT")
    while jobs.current is not None:
        yield 0.1
    if not manager.pags_photographs:
        print("skipped: inspected: no photographs")
        return
    settings.comparison = "WIPE"
    yield from open_tab()
    above = [getattr(bpy.types, name) for name in ("PAGS_PT_scene", "PAGS_PT_show", "PAGS_PT_cameras", "PAGS_PT_export")]
    for panel in above:  # which a reader would fold
        bpy.utils.unregister_class(panel)
    with in_view():
        manager.pags_photograph = 0
        bpy.ops.view3d.view_center_camera()
    while not any(not isinstance(pair, str) for pair in comparison._pairs.values()):
        yield 0.1
    yield from picture_of("inspected", crop=small(600))
    settings.comparison = "NONE"
    view3d().show_region_ui = False
    for panel in above:
        bpy.utils.register_class(panel)
    bpy.context.scene.frame_set(FRAME)
    yield 0.3


def small(width, colours=128):
    """Options of convert: the 3D view alone, for a part of the page's width."""
    place = f"{area().width}x{area().height}+{area().x}+{window().height - area().y - area().height}"
    return ("-crop", place, "+repage", "-resize", f"{width}x", "+dither", "-colors", str(colours))


def recorded():
    """A LiDAR sweep and the labelled boxes over the street; skipped where the recording isn't there."""
    from_above()
    before = yield from sharp_shot("before-recording")
    for operator in (bpy.ops.pags.lidar, bpy.ops.pags.boxes):
        with in_view():
            operator("INVOKE_DEFAULT")
        while sys.modules[addon.__name__ + ".jobs"].current is not None:
            yield 0.1
    deselect()
    brought = [o for o in bpy.data.objects if "pags_lidar" in o or "pags_box" in o]
    if not any("pags_lidar" in o for o in brought):
        print("skipped: recorded: no sweeps")
        return
    after = yield from picture_of("recording", crop=small(480, 40))
    assert (np.abs(after - inside(before)).max(axis=2) > 40).mean() > 0.01, "the sweep isn't seen"
    for block in brought:
        block.hide_set(True)


def counted():
    """What each pixel costs."""
    from_above()
    before = yield from sharp_shot("before-overdraw")
    bpy.context.scene.pags.mode = "overdraw"
    after = yield from picture_of("overdraw", crop=small(480, 40))
    assert np.abs(after - inside(before)).mean() > 10, "overdraw looks like colours"
    bpy.context.scene.pags.mode = "rgb"


def moved():
    """A car moved across the street; its Gaussians follow."""
    from_above()
    before = yield from sharp_shot("before")
    (car, _, _), ego = car_in_sight(), bpy.data.objects["ego"].matrix_world.to_3x3()
    side = (ego.inverted() @ (car.matrix_world.translation - bpy.data.objects["ego"].matrix_world.translation)).y
    to_the_middle = ego @ Vector((0, -2.5 if side > 0 else 2.5, 0))
    car.location = car.parent.matrix_world.to_3x3().inverted() @ to_the_middle
    car.rotation_euler.z = 0.5
    car.select_set(True)
    after = yield from picture_of("moved")
    assert np.abs(after - inside(before)).max() > 60, "the car didn't move"
    car.location, car.rotation_euler.z = (0, 0, 0), 0
    deselect()


def underway():
    """Proxies that are being made, as the header tells."""
    jobs = sys.modules[addon.__name__ + ".jobs"]
    with in_view():
        bpy.ops.pags.import_proxies("INVOKE_DEFAULT")
    while jobs.current is not None and (jobs.current.end_other is None or jobs.current.fraction == 0):
        yield 0.05
    assert jobs.current is not None, "the proxies have failed"
    yield 0.2
    shoot("underway")
    keep("underway", crop=("-crop", f"{area().width}x150+{area().x}+{window().height - area().y - area().height}", "+repage"))
    bpy.ops.pags.cancel_job()
    while jobs.current is not None:
        yield 0.1


def mesh_car():
    """A green block of a car ahead on our lane, wheels on the road, axes as the recording car's."""
    scene = bpy.context.scene
    root = next(o for o in scene.objects if o.pags.kind == "ROOT")
    ego = bpy.data.objects["ego"].matrix_world
    road = root.matrix_world.translation.z + composite.road_height(native.load(STREET))
    parts = []
    with in_view():
        build(parts)
    car = parts[0][0]
    car.name = "mesh car"
    place = (ego @ Matrix.Translation((9, 0, 0))).copy()
    place.translation.z = road
    car.matrix_world = place @ Matrix.Translation((0, 0, 0.62)) @ Matrix.Diagonal((4.3, 1.8, 0.62, 1))
    deselect()


def build(parts):
    """Body, cabin and wheels as one object; (object, colour) into `parts`."""
    for size, at in (((4.3, 1.8, 0.62), (0, 0, 0.62)), ((2.3, 1.55, 0.55), (-0.25, 0, 1.2))):
        bpy.ops.mesh.primitive_cube_add(size=1, location=at)
        bpy.context.object.scale = size
        parts.append((bpy.context.object, (0.01, 0.4, 0.25, 1) if at[2] < 1 else (0.03, 0.04, 0.05, 1)))
    for x in (-1.35, 1.35):
        for y in (-0.85, 0.85):
            bpy.ops.mesh.primitive_cylinder_add(radius=0.33, depth=0.25, location=(x, y, 0.33), rotation=(np.pi / 2, 0, 0))
            parts.append((bpy.context.object, (0.02, 0.02, 0.02, 1)))
    for block, paint in parts:
        material = bpy.data.materials.new("paint")
        material.diffuse_color = paint
        material.use_nodes = True
        material.node_tree.nodes["Principled BSDF"].inputs["Base Color"].default_value = paint
        block.data.materials.append(material)
        block.select_set(True)
    bpy.context.view_layer.objects.active = parts[0][0]
    bpy.context.view_layer.update()
    bpy.ops.object.join()


def meshes():
    mesh_car()
    view3d().shading.type = "SOLID"
    view3d().shading.color_type = "MATERIAL"
    view3d().region_3d.view_perspective = "CAMERA"
    shown = yield from picture_of("meshes")
    assert painted(shown).sum() > 1000, "the mesh isn't seen among the splats"


def painted(picture):
    """Where a picture has the mesh's green."""
    red, green, blue = (picture[..., c] for c in range(3))
    return (green > red + 40) & (blue > red + 20)


def composited():
    scene = bpy.context.scene
    plain = render("plain")
    with in_view():
        bpy.ops.object.light_add(type="SUN", rotation=(0.3, 0.9, 0))
    sun = bpy.context.view_layer.objects.active
    sun.data.energy, sun.data.angle = 3, 0.02
    deselect()
    assert bpy.ops.pags.composite(engine="CYCLES") == {"FINISHED"}
    whole = render("composite")
    keep("composite", os.path.join(FOLDER, "composite.png"))
    mesh = painted(whole) & ~painted(plain)  # there may be a green car in the street
    assert mesh.sum() > 1000, "the mesh isn't in the picture"
    darker = (whole.sum(axis=2) < 0.7 * plain.sum(axis=2)) & ~mesh
    assert darker.sum() > 100, "there is no shadow"
    yield 0.1


def render(name):
    """F12 as (height, width, 3)."""
    scene = bpy.context.scene
    scene.render.image_settings.file_format, scene.render.image_settings.color_mode = "PNG", "RGB"
    scene.render.filepath = os.path.join(FOLDER, name + ".png")
    bpy.ops.render.render(write_still=True)
    picture = read_png(scene.render.filepath)
    return np.frombuffer(bytes(picture[4]), dtype=np.uint8).reshape(picture[1], picture[0], -1)[..., :3].astype(int)


def several():
    """A car of the street once more, from its own file, half as large and turned, on the road ahead."""
    view3d().shading.type = "RENDERED"
    bpy.context.scene.render.engine = "PAGS"
    alone = yield from picture_of_view("alone")
    cars = [path for path in glob.glob(os.path.join(STREET, "objects", "*car*.ply"))]
    path = max(cars, key=os.path.getsize)
    assert bpy.ops.import_scene.pags(filepath=path, whole=False, up="Z", cameras="NONE") == {"FINISHED"}
    root, ego = bpy.context.view_layer.objects.active, bpy.data.objects["ego"].matrix_world
    root.matrix_world = ego @ Matrix.Translation((7, -0.3, -1.1)) @ Matrix.Rotation(0.6, 4, "Z") @ Matrix.Scale(0.5, 4)
    deselect()
    both = yield from picture_of("several", ("-resize", "46%"))
    assert np.abs(both - alone).max(axis=2).astype(bool).mean() > 0.005, "the second scene isn't seen"


def picture_of_view(name):
    from_above()
    picture = yield from sharp_shot(name)
    return inside(picture)


if not os.path.exists(os.path.join(SCENE, "scene.json")):
    print("skipped: there is no trained street here (make demo makes one)")
    sys.stdout.flush()
    os._exit(77)
tell(story())
