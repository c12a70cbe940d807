# SPDX-License-Identifier: Apache-2.0
"""Follows docs/blender-guide.md step by step in a window with the synthetic street. Presses each key and button that the
page names. Takes each picture of the page and checks its contents.

PAGS_GUIDE_SCENE names the trained street (`make demo` makes one in build/demo/scene). PAGS_GUIDE_IMAGES names a folder
that keeps the pictures."""

import os
import re
import subprocess
import sys

import bpy
import numpy as np
from mathutils import Matrix, Vector

HERE = os.path.dirname(os.path.abspath(__file__))
sys.path[:0] = [HERE, os.path.join(HERE, "..", "cli")]
import guide_page  # noqa: E402
from fixtures import read_png  # noqa: E402
from gui_browser import accept, browsers, double_click, opened, until  # noqa: E402
from gui_buttons import buttons_of, call, panels, press, put  # noqa: E402
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
    redraw,
    region,
    sharp_shot,
    shoot,
    tell,
    view3d,
    wait,
    window,
)

WINDOW = "960x600"
SCENE = os.environ.get("PAGS_GUIDE_SCENE", "")
STREET = os.path.join(FOLDER, "street")
IMAGES = os.environ.get("PAGS_GUIDE_IMAGES", "")
part = lambda name: sys.modules[f"{addon.__name__}.{name}"]
inspector, light, comparison, jobs = part("inspector"), part("light"), part("comparison"), part("jobs")
KEYS = {"Space": "SPACE", "Return": "RET"}
DIGITS = {".": "PERIOD", "0": "ZERO", "5": "FIVE"}
seen = {}  # earlier pictures by name
pressed, rendered = [], []  # paths of pressed buttons, and pictures that F12 has finished


# ---- The page ----


def story():
    os.symlink(os.path.abspath(SCENE), STREET)
    bpy.context.preferences.view.render_display_type = "NONE"
    with in_view():  # in a saved file, the scene's path is shown relative to the file
        bpy.ops.wm.save_as_mainfile(filepath=os.path.join(FOLDER, "guide.blend"))
    bpy.app.handlers.render_complete.append(lambda *_: rendered.append(True))
    for section, number, kind, text, value in guide_page.actions():
        print(f"{section} {number}: {kind} {text}" + (f" to {value}" if value else ""))
        yield from DO[kind](text, value)
    if IMAGES:
        yield from underway()
        yield from written_anew()


def done_pressing(path, value):
    """Presses an item of a panel or menu, sets an option of an open file browser, or opens the sidebar's tab."""
    pressed.append(path)
    if path == "PAGS":
        yield from open_tab()
    elif browsers():
        name, _, item = path.partition(" > ")
        options = browsers()[0][1].spaces.active.active_operator.properties
        member = next(p.identifier for p in options.bl_rna.properties if p.name == name)
        put(path, options, member, item or None, value)
    else:
        press(path, value)
        yield 0.3
        if not browsers():
            yield from no_job()
    yield 0.3


def no_job():
    yield from until(lambda: jobs.current is None, 600)
    yield 0.3


def send(kind, value="PRESS", x=None, y=None, **more):
    r = region()
    x, y = (r.x + r.width // 3, r.y + r.height // 2) if x is None else (x, y)
    window().event_simulate(type=kind, value=value, x=int(x), y=int(y), **more)


def strike(kind, **held):
    send("MOUSEMOVE", "NOTHING")
    yield 0.2
    for value in ("PRESS", "RELEASE"):
        send(kind, value, **held)
        yield 0.2


def done_striking(text, _):
    *held, key = text.split()
    rendered.clear()
    yield from strike(KEYS.get(key, key.upper()), **{name.lower(): True for name in held})
    yield 0.5
    if key == "F12":
        yield from until(lambda: rendered and not bpy.app.is_job_running("RENDER"), 600)
        yield 0.5
        seen.setdefault("plain", result("plain")[0])
    yield from no_job()


def done_typing(text, _):
    for letter in text:
        yield from strike(DIGITS[letter])


def done_with_words(text, _):
    for pattern, function in WORDS.items():
        found = re.fullmatch(pattern, text)
        if found:
            yield from function(*found.groups())
            return
    raise AssertionError(f"the test of the guide doesn't know how to: {text}")


def done_nothing(text, _):
    raise AssertionError(f"nothing is pressed in the guide's step: {text}")
    yield


# ---- What is done with the mouse ----


def to_frame(number):
    bpy.context.scene.frame_set(int(number))
    yield 0.2


def remove(text):
    for name in re.findall("`([^`]+)`", text):
        for block in (*bpy.data.objects[name].children_recursive, bpy.data.objects[name]):
            bpy.data.objects.remove(block)
    yield 0.3


def choose(name, folder):
    """Opens a file in the open browser; afterwards there is one more scene."""
    roots = lambda: sum(o.pags.kind == "ROOT" for o in bpy.data.objects)  # noqa: E731
    before, browser = roots(), (yield from opened(folder))
    if IMAGES and before == 0:
        shoot("browser")
        keep("browser", crop=("-resize", "480x", "+dither", "-colors", "32"))
    yield from double_click(*browser, name)
    yield from until(lambda: roots() > before)
    yield from no_job()
    deselect()


def choose_part(name, folder):
    yield from choose(name, os.path.join(STREET, folder))
    yield from select(name)


def name_it(kind, name):
    path = os.path.join(FOLDER, name)
    if kind == "folder":
        os.makedirs(path)  # Blender's browser offers to make the folder
    browser = yield from opened(path if kind == "folder" else FOLDER)
    yield from accept(*browser, name if kind == "file" else "")
    yield from until(lambda: not browsers())
    yield from no_job()
    assert os.path.exists(os.path.join(path, "scene.json") if kind == "folder" else path), f"{name} wasn't written"


def above():
    """Sets the view above and behind the recording car."""
    ego = bpy.data.objects["ego"].matrix_world
    rv3d = view3d().region_3d
    rv3d.view_perspective = "PERSP"
    eye, goal = ego @ Vector((-3, 0.5, 2.5)), ego @ Vector((18, -1, -1.0))
    rv3d.view_rotation = (goal - eye).to_track_quat("-Z", "Y")
    rv3d.view_distance, rv3d.view_location = (goal - eye).length, goal

    yield from wait()


def cars_ahead():
    """Returns the parts of cars in front of the recording car, the nearest first."""
    ego, found = bpy.data.objects["ego"].matrix_world.inverted(), []
    for part in bpy.data.objects:
        if part.pags.kind == "OBJECT" and part.get("pags_category") == "vehicle" and not part.hide_viewport:
            at = ego @ part.matrix_world.translation
            if 6 < at.x < 35 and abs(at.y) < 9:
                found.append((at.x, part))
    return [part for _, part in sorted(found, key=lambda pair: pair[0])]


def car_in_sight():
    """Returns the nearest car whose middle is visible, and its pixel in the region, with row 0 at the top."""
    r, rv3d = region(), view3d().region_3d
    values, pose = lens.of_view(rv3d.window_matrix, rv3d.view_matrix, r.width, r.height)
    for part in cars_ahead():
        x, y = in_region(part.matrix_world.translation)
        if 80 < x < r.width - 240 and 80 < y < r.height - 20:
            seen = inspector.pick(bpy.context, values, pose, x, y)
            if seen is not None and seen["object"] == part.pags.index:
                return part, x, y
    raise AssertionError("no car is in sight")


def click_car():
    deselect()
    car, x, y = car_in_sight()
    r = region()
    yield from click(r.x + x, r.y + r.height - 1 - y)
    if pressed[-1] == "Show > Pick":
        assert car["pags_id"] in bpy.context.scene.pags_picked and bpy.context.object == car, (
            car["pags_id"],
            bpy.context.scene.pags_picked,
        )


def click_road():
    """Clicks in the middle of the view, near its lower edge."""
    r = region()
    yield from click(r.x + r.width // 2, r.y + 60)
    assert bpy.context.scene.pags_distance, "no distance is said"


def click_first():
    with in_view():
        bpy.context.scene.pags_photograph = 0
    yield 0.5
    assert view3d().region_3d.view_perspective == "CAMERA"


def forget_distance():
    (button,) = [b for b in buttons_of(bpy.types.PAGS_PT_measure) if b.target == "pags.forget_distance"]
    call(button.target, button.values)
    yield 0.3


def drag():
    """After the key G, moves the mouse towards the middle of the street and clicks."""
    car = bpy.context.object
    x, y = in_region(car.matrix_world.translation)
    r = region()
    towards = 130 if x < r.width / 2 else -130
    for step in (0, 40, 80, 130):
        send("MOUSEMOVE", "NOTHING", r.x + r.width // 3 + step * towards // 130, r.y + r.height // 2)
        yield 0.2
    for value in ("PRESS", "RELEASE"):
        send("LEFTMOUSE", value, r.x + r.width // 3 + towards, r.y + r.height // 2)
        yield 0.2
    assert Vector(car.location).length > 0.5, f"{car.name} wasn't moved"


def select(name):
    deselect()
    block = bpy.data.objects[name]
    block.select_set(True)
    bpy.context.view_layer.objects.active = block
    yield 0.2


def hide_recording():
    for block in bpy.data.objects:
        if "pags_lidar" in block or "pags_box" in block:
            block.hide_set(True)
    deselect()
    yield 0.2


def to_road():
    block, ego = bpy.context.object, bpy.data.objects["ego"].matrix_world
    if block.pags.kind == "ROOT":
        block.matrix_world = ego @ Matrix.Translation((7, -0.3, -1.1)) @ Matrix.Rotation(0.6, 4, "Z")
    else:
        block.matrix_world = ego @ Matrix.Translation((9, 0, -1.5)) @ Matrix.Scale(2.5, 4)
    yield 0.2


def build_car():
    """Builds a green car from meshes ahead on the same lane, with wheels on the road and axes as the recording
    car's."""
    root = next(o for o in bpy.context.scene.objects if o.pags.kind == "ROOT")
    ego = bpy.data.objects["ego"].matrix_world
    road = root.matrix_world.translation.z + light.road_height(native.load(STREET))
    parts = []
    with in_view():
        build(parts)
    car = parts[0][0]
    car.name = "mesh car"
    place = (ego @ Matrix.Translation((9, 0, 0))).copy()
    place.translation.z = road
    car.matrix_world = place @ Matrix.Translation((0, 0, 0.62)) @ Matrix.Diagonal((4.3, 1.8, 0.62, 1))
    deselect()
    yield 0.2


def build(parts):
    """Builds body, cabin and wheels; appends (object, colour) of each to `parts`."""
    for size, at in (((4.3, 1.8, 0.62), (0, 0, 0.62)), ((2.3, 1.55, 0.55), (-0.25, 0, 1.2))):
        bpy.ops.mesh.primitive_cube_add(size=1, location=at)
        bpy.context.object.scale = size
        parts.append((bpy.context.object, (0.01, 0.4, 0.25, 1) if at[2] < 1 else (0.03, 0.04, 0.05, 1)))
    for x in (-1.35, 1.35):
        for y in (-0.85, 0.85):
            bpy.ops.mesh.primitive_cylinder_add(
                radius=0.33, depth=0.25, location=(x, y, 0.33), rotation=(np.pi / 2, 0, 0)
            )
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


WORDS = {
    r"put the timeline to frame `(\d+)`": to_frame,
    r"(delete .*)": remove,
    r"click the X next to the distance": forget_distance,
    r"double-click `(scene\.json)` in the scene's folder": lambda name: choose(name, STREET),
    r"double-click `(scene\.json)` in the folder `(\w+)`": lambda name, folder: choose(
        name, os.path.join(FOLDER, folder)
    ),
    r"double-click `([\w.]+)` in the scene's folder `(\w+)`": choose_part,
    r"turn the view .*you see the street from above": above,
    r"click a car": click_car,
    r"click the road": click_road,
    r"click the first line of the list": click_first,
    r"hide both in the outliner": hide_recording,
    r"move the mouse and click": drag,
    r"move it onto the road ahead": to_road,
    r"select `([^`]+)` in the outliner": select,
    r"name the (folder|file) `([^`]+)`": name_it,
    r"build a car of meshes": build_car,
}


# ---- Pictures ----


def keep(name, source=None, crop=()):
    """Saves a picture for the manual with 128 colours. `source` replaces the screenshot; `crop` gives convert's
    options for a part."""
    os.makedirs(IMAGES, exist_ok=True)
    source = source or os.path.join(os.environ.get("PAGS_SHOTS", FOLDER), name + ".png")
    target = os.path.join(IMAGES, f"blender-{name}.png")
    subprocess.run(["convert", source, *crop, "+dither", "-colors", "128", "-strip", "PNG8:" + target], check=True)
    print(f"{target}: {os.path.getsize(target) // 1024} KB")


def inside(picture):
    """Returns the samples of the 3D view's region, (height, width, 3), with row 0 at the top."""
    r = region()
    whole = np.frombuffer(bytes(picture[4]), dtype=np.uint8).reshape(picture[1], picture[0], picture[2])
    top = picture[1] - r.y - r.height
    return whole[top : top + r.height, r.x : r.x + r.width, :3].astype(int)


def small(width, colours=128):
    """Returns options of convert that crop to the 3D view and scale it to part of the page's width."""
    place = f"{area().width}x{area().height}+{area().x}+{window().height - area().y - area().height}"
    return ("-crop", place, "+repage", "-resize", f"{width}x", "+dither", "-colors", str(colours))


def done_looking(name, _):
    """Takes a sharp picture, checks that it isn't empty and has the expected contents, and saves it for the manual
    if requested."""
    view3d().show_region_ui = name in PANELS
    folded = fold(PANELS[name]) if name in PANELS else []
    overlay = view3d().overlay
    overlay.show_object_origins = overlay.show_extras = overlay.show_outline_selected = name == "recording"
    if name == "composite":
        picture, source = result("composite")
    else:
        if name == "look":
            yield from unfold()
        picture, source = inside((yield from sharp_shot(name))), None
    assert picture.std() > 15, f"{name}: there is hardly anything to be seen"
    seen[name] = picture
    if name in CHECKS:
        CHECKS[name](picture)
    if IMAGES:
        keep(name, source, small(*SIZES.get(name, (480, 48))) if source is None else ())
    for kind in folded:
        bpy.utils.register_class(kind)
    yield 0.1


def fold(name):
    """Folds the sidebar's other panels, as a reader would, so that the named panel is visible; `name` None folds
    none."""
    others = [kind for kind in panels() if kind.bl_space_type == "VIEW_3D" and kind.__name__ != name and name]
    for kind in others:
        bpy.utils.unregister_class(kind)
    return others


def unfold():
    """Opens the panel at the top of the sidebar with a click on its header."""
    drawn, panel = [], bpy.types.PAGS_PT_cleanup
    draw = panel.draw
    panel.draw = lambda self, context: (drawn.append(True), draw(self, context))[1]
    yield 0.3
    redraw()
    if not drawn:
        ui = next(r for r in area().regions if r.type == "UI")
        yield from click(ui.x + 60, ui.y + ui.height - 18)
        redraw()
    panel.draw = draw
    assert drawn, "the panel Clean up and look doesn't open"


def result(name):
    """Returns the last rendering as (height, width, 3), and its file."""
    settings, path = bpy.context.scene.render.image_settings, os.path.join(FOLDER, name + ".png")
    settings.file_format, settings.color_mode = "PNG", "RGB"
    bpy.data.images["Render Result"].save_render(path)
    picture = read_png(path)
    return np.frombuffer(bytes(picture[4]), dtype=np.uint8).reshape(picture[1], picture[0], -1)[..., :3].astype(
        int
    ), path


def top_of_view():
    return ("-crop", f"{area().width}x150+{area().x}+{window().height - area().y - area().height}", "+repage")


def underway():
    """Takes the manual's picture of long work: the header shows the progress while proxies are made."""
    with in_view():
        bpy.ops.pags.import_proxies("INVOKE_DEFAULT")
    yield from until(
        lambda: jobs.current is not None and jobs.current.end_other is not None and jobs.current.fraction > 0
    )
    yield 0.2
    shoot("underway")
    keep("underway", crop=top_of_view())
    bpy.ops.pags.cancel_job()
    yield from no_job()


def written_anew():
    """Takes the manual's picture of the notice that a scene's files were written again."""
    yield 4
    os.utime(os.path.join(STREET, "scene.json"))
    yield from until(lambda: jobs.current is not None)
    yield from no_job()
    shoot("anew")
    keep("anew", crop=("-crop", f"{window().width}x24+0+{window().height - 24}", "+repage"))


def painted(picture):
    """Returns the mask of the pixels with the mesh's green."""
    red, green, blue = (picture[..., c] for c in range(3))
    return (green > red + 40) & (blue > red + 20)


def apart(a, b):
    """Returns the share of pixels that differ clearly, within the width of the narrower picture."""
    width = min(a.shape[1], b.shape[1])
    return (np.abs(a[:, :width] - b[:, :width]).max(axis=2) > 20).mean()


def check_imported(_):
    assert (view3d().shading.type, view3d().region_3d.view_perspective) == ("RENDERED", "CAMERA")
    assert bpy.context.scene.frame_current == 14 and "ego" in bpy.data.objects


def check_stood(_):
    ahead = view3d().region_3d.view_matrix.inverted().to_3x3() @ Vector((0, 0, -1))
    assert abs(ahead.z) < 1e-3, ahead


def check_look(picture):
    grey = lambda p: np.ptp(p, axis=2).mean()  # noqa: E731
    assert grey(picture) < 0.8 * grey(seen["rendered"]), "the street isn't grey"


def check_beside(picture):
    """Compares the halves without the lowest rows, where Blender shows the last action."""
    plain, middle = seen["rendered"][:-60], int(bpy.context.scene.pags.wipe * picture.shape[1])
    left, right = (
        apart(picture[:-60, half], plain[:, half]) for half in (slice(0, middle - 5), slice(middle + 5, None))
    )
    assert left < 0.02 and right > left + 0.02, (
        f"left of the edge isn't the first scene, or right isn't the edited one: {left:.3f}, {right:.3f}"
    )


def check_mesh(picture):
    assert painted(picture).sum() > 1000, "the mesh isn't in the picture"


def check_composite(picture):
    """Checks that the mesh and its shadow on the street are visible."""
    check_mesh(picture)
    mesh, plain = painted(picture) & ~painted(seen["plain"]), seen["plain"]  # the street may contain a green car
    darker = (picture.sum(axis=2) < 0.7 * plain.sum(axis=2)) & ~mesh
    assert mesh.sum() > 1000 and darker.sum() > 100, f"{mesh.sum()} pixels of mesh, {darker.sum()} of shadow"


def differs(name, share):
    """Returns a check that a picture differs from the named one."""

    def check(picture):
        assert apart(picture, seen[name]) > share, f"no different from {name}: {apart(picture, seen[name]):.4f}"

    return check


PANELS = {
    "sidebar": None,
    "inspected": "PAGS_PT_inspect",
    "look": "PAGS_PT_cleanup",
}  # the panel that is open in pictures of the sidebar
SIZES = {name: (540, 48) for name in ("imported", "rendered", "sidebar", "inspected", "look", "meshes")}
CHECKS = {
    "imported": check_imported,
    "sidebar": differs("rendered", 0.3),
    "overdraw": differs("rendered", 0.3),
    "recording": differs("rendered", 0.01),
    "distance": differs("rendered", 0.0005),
    "stood": check_stood,
    "moved": differs("rendered", 0.005),
    "look": check_look,
    "crop": differs("rendered", 0.005),
    "beside": check_beside,
    "several": differs("rendered", 0.005),
    "meshes": check_mesh,
    "composite": check_composite,
}
DO = {
    "press": done_pressing,
    "key": done_striking,
    "type": done_typing,
    "words": done_with_words,
    "image": done_looking,
    "nothing": done_nothing,
}

if not os.path.exists(os.path.join(SCENE, "scene.json")):
    print("skipped: there is no trained street here (make demo makes one)")
    sys.stdout.flush()
    os._exit(77)
tell(story(), 1600)
