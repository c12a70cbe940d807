# SPDX-License-Identifier: GPL-3.0-or-later
"""The recording's photographs: finds them, undistorts them, and shows them as a camera's background, frame by frame."""

import hashlib
import json
import os
import secrets
import tempfile

import bpy
import numpy as np

from . import farm_check, files, jobs, native, program, undistort, whereabouts

# ---- Where they are ----


FIELD = "set Data set folder (sidebar > PAGS > Cameras) to its location on this machine"


def candidates(root, entry):
    """Yields the candidate folders of the data set in order of priority: the scene's *Data set folder*, the folder used in training, a folder next to the
    scene. A different data set of the same name next to the scene is skipped."""
    if root.pags.dataset:
        yield whereabouts.locate(root, "dataset")[0]
    recorded = entry.info.get("dataset")
    if recorded:
        for base in (entry.path, os.path.dirname(entry.path)) if not os.path.isabs(recorded) else ("",):
            yield os.path.normpath(os.path.join(base, recorded))
        beside = beside_scene(entry)
        if not os.path.exists(beside) or not why_not(root, entry, beside):
            yield beside


def beside_scene(entry):
    """The folder next to the scene with the name of the data set used in training, perhaps on another system."""
    name = os.path.basename(os.path.normpath((entry.info.get("dataset") or "").replace("\\", "/")))
    return os.path.normpath(os.path.join(os.path.dirname(entry.path), name))


def why_not(root, entry, folder):
    """Why a folder next to the scene can't be the missing data set; empty if it can."""
    record = whereabouts.record_of(root, "photographs", entry.info["dataset"])
    if record:
        return "" if farm_check.is_same(folder, record, whereabouts.identity_of) else "is another data set"
    held = lambda name: any(os.path.exists(os.path.join(folder, inner, name)) for inner in ("images", ""))
    return next((f"lacks {v['name']}" for v in entry.views if not held(v["name"])), "")


def places(root, entry):
    """Candidates without repetition, up to the first that exists: a photograph missing there is not taken from another folder, which may have a different one
    of that name."""
    out = []
    for path in candidates(root, entry):
        if path not in out:
            out.append(path)
        if os.path.exists(path):
            break
    return out


def dataset(root, entry):
    """The existing data set folder, else the path in the scene file, which may be None."""
    return next((p for p in places(root, entry) if os.path.exists(p)), entry.info.get("dataset"))


def moved(root, entry):
    """The data set folder for a program that reads the scene, if it differs from the path in the scene; else None."""
    found, recorded = dataset(root, entry), entry.info.get("dataset")
    same = recorded is not None and os.path.normpath(recorded) == os.path.normpath(found)
    return None if found is None or same else found


def note(root, entry):
    """Records the identity of the data set at the folder used in training, to recognise it elsewhere."""
    recorded = entry.info.get("dataset")
    if recorded and os.path.isabs(recorded) and os.path.exists(recorded):
        whereabouts.note(root, "photographs", recorded, recorded, "")


def tell(job, root, entry):
    """Warns about a data set that is neither at its chosen folder nor at the folder used in training."""
    found = places(root, entry)
    chosen = whereabouts.locate(root, "dataset") if root.pags.dataset else ("", "", "")
    if chosen[1]:
        job.notes.append(chosen[1])
    elif len(found) > 1 and os.path.exists(found[-1]):
        job.notes.append(f"the data set {found[0]} is missing; using {found[-1]}")


def find(root, entry, name, looked_in=None):
    """(data set folder, path) of a view's photograph. SceneError lists the searched folders: `looked_in`, or the scene's candidates."""
    looked_in = places(root, entry) if looked_in is None else looked_in
    if not looked_in:
        raise native.SceneError(f"photograph {name} not found: the scene doesn't name its data set; {FIELD}")
    for inner in ("images", ""):
        path = os.path.join(looked_in[-1], inner, name)
        if os.path.exists(path):
            return looked_in[-1], path
    raise native.SceneError(
        f"photograph {name} not found: looked in {', '.join(looked_in)} and in images there{refused(root, entry)}; {FIELD}"
    )


def refused(root, entry):
    """A clause that explains why a folder of the data set's name next to the scene was rejected."""
    recorded, beside = entry.info.get("dataset") or "", beside_scene(entry)
    why = why_not(root, entry, beside) if recorded and os.path.isdir(beside) and not os.path.exists(recorded) else ""
    return f"; {beside} has the same name, but {why}" if why else ""


def lens_of(folder, sensor):
    """Nine numbers fx fy cx cy k1 k2 p1 p2 k3 of a driving set's camera with distortion, else None."""
    try:
        with open(os.path.join(folder, "intrinsics", f"{sensor}.txt"), encoding="utf-8") as file:
            numbers = [float(word) for word in file.read().split()]
    except (OSError, ValueError):
        return None
    return numbers[:9] if len(numbers) >= 9 and any(abs(k) > 1e-9 for k in numbers[4:9]) else None


def refuse_lens(view):
    """Raises SceneError for a view with a lens that Blender's cameras do not support: its photograph would not match the picture."""
    if "lens" in view:
        raise native.SceneError(
            f"the photograph {view['name']} was taken, and is modelled, through a lens ({view['lens']}), not a pinhole; pags view and pags eval compare it"
        )


def load(job, root, entry, view):
    """Steps that return a view's photograph, undistorted to its pinhole camera."""
    refuse_lens(view)
    folder, path = find(root, entry, view["name"])
    tell(job, root, entry)
    picture = undistort.read(path)
    yield
    return (yield jobs.in_thread(undistort.as_view, picture, view, lens_of(folder, view["sensor"])))


# ---- Background of a camera ----


def cache_folder(entry, source, sensor, fps):
    """Folder of the numbered copies or links: in the user's data folder, where extensions have to write."""
    status = os.stat(source)  # another data set at this path may have older photographs of the same names
    told = f"{entry.path} {entry.stamp} {source} {status.st_dev} {status.st_ino} {sensor} {fps:.6f}"
    key = hashlib.sha1(told.encode("utf-8", "surrogateescape")).hexdigest()[:12]
    inner = os.path.join("photographs", key)
    if hasattr(bpy.utils, "extension_path_user") and __package__.startswith("bl_ext."):
        return bpy.utils.extension_path_user(__package__, path=inner, create=True)
    return bpy.utils.user_resource("DATAFILES", path=os.path.join("pags", inner), create=True)


def plan(paths, views, frames, distortion, folder):
    """The work that creates files 00001.*, ... with the photograph nearest in time for every frame of the timeline: [(source, target)] of links, and items
    for undistort.py with one frame each; further frames of the same photograph are links to it."""
    links, items, made = [], [], {}
    extension = ".png" if distortion else os.path.splitext(paths[0])[1]
    for number, nearest in enumerate(frames):
        target = os.path.join(folder, f"{number + 1:05d}{extension}")
        if os.path.exists(target) and os.path.getmtime(target) >= os.path.getmtime(paths[nearest]):
            continue
        if os.path.lexists(target):  # a broken link, or a copy of an older photograph
            os.remove(target)
        if distortion and nearest not in made:
            view = {k: views[nearest][k] for k in ("width", "height", "fx", "fy", "cx", "cy")}
            items.append({"source": paths[nearest], "view": view, "distortion": distortion, "target": target})
            made[nearest] = target
        else:
            links.append((made.get(nearest, paths[nearest]), target))
    return links, items, extension


def link_all(job, links):
    for number, (source, target) in enumerate(links):
        job.check()
        job.tell(number / len(links), "linking photographs")
        files.link_or_copy(source, target)


def convert(job, items):
    """Steps that undistort photographs, in a second Blender, or here without a window. Another Blender may be writing the same files."""
    for item in items:
        item["part"] = f"{item['target']}.{secrets.token_hex(4)}.part"
    if bpy.app.background:
        for item in items:
            undistort.convert(item)
        return
    with tempfile.TemporaryDirectory(prefix="pags-photographs-") as folder:
        path = os.path.join(folder, "list.json")
        with open(path, "w", encoding="utf-8") as file:
            json.dump(items, file)
        flags = ("-b", "--factory-startup", "-P", undistort.__file__, "--", path)
        try:
            yield jobs.in_thread(program.run, job, bpy.app.binary_path, *flags)
        finally:
            if job.stopped.is_set():
                for item in items:
                    if os.path.exists(item["part"]):
                        os.remove(item["part"])


def show(job, camera, root):
    """Steps that show a sensor's photographs as its camera's background and replace those shown before."""
    path = whereabouts.absolute_path(root)
    entry = yield jobs.in_thread(native.load, path)
    sensor, fps = camera.data.pags.sensor, root.pags.fps
    views = sorted((v for v in entry.scene.views if v["sensor"] == sensor and "time" in v), key=lambda v: v["time"])
    if not views:
        raise native.SceneError(f"{camera.name}: the scene has no photographs of this camera")
    refuse_lens(views[0])
    looked_in = places(root, entry)
    source = find(root, entry, views[0]["name"], looked_in)[0]
    tell(job, root, entry)
    paths = [find(root, entry, v["name"], looked_in)[1] for v in views]
    distortion = lens_of(source, sensor)
    times, begin = np.array([v["time"] for v in views]), entry.info["time_begin"]
    count = int(np.floor((times[-1] - begin) * fps + 1e-6)) + 1
    frames = [int(np.argmin(np.abs(times - (begin + number / fps)))) for number in range(count)]
    folder = cache_folder(entry, source, sensor, fps)
    links, items, extension = yield jobs.in_thread(plan, paths, views, frames, distortion, folder)
    if items:
        yield from convert(job, items)
    yield jobs.in_thread(link_all, job, links)
    job.changes = True
    image = bpy.data.images.load(os.path.join(folder, "00001" + extension), check_existing=True)
    put_behind(camera, image, count, root)


def put_behind(camera, image, count, root):
    image.source = "SEQUENCE" if count > 1 else "FILE"
    camera.data.show_background_images = True
    image["pags_photographs"] = True
    shown = (b for b in camera.data.background_images if b.image is not None and "pags_photographs" in b.image)
    background = next(shown, None) or camera.data.background_images.new()
    background.image, background.alpha, background.display_depth = image, 1.0, "BACK"
    background.frame_method = "STRETCH"
    user = background.image_user
    user.frame_duration, user.frame_start, user.frame_offset = count, int(round(root.pags.frame_start)), 0
    user.use_auto_refresh = True


# ---- Comparison image ----


COMPARED = "PAGS comparison"  # name of the image
_compared = None  # (photograph, rendered picture of the same view)


def compare(context, photograph, picture):
    """Shows the photograph and the rendered picture side by side, split at the scene's wipe setting."""
    global _compared
    _compared = (photograph, picture)
    wipe(context, context.scene.pags.wipe)


def wipe(context, share):
    """Updates the comparison image: photograph left of the edge (fraction of the width), rendered picture right of it."""
    if _compared is None:
        return
    photograph, picture = _compared
    height, width = picture.shape[:2]
    edge = int(round(share * width))
    rgba = np.ones((height, width, 4), dtype=np.float32)
    rgba[:, :edge, :3], rgba[:, edge:, :3] = photograph[::-1, :edge], picture[::-1, edge:]
    if 0 < edge < width:
        rgba[:, edge - 1 : edge + 1, :3] = 1
    image = bpy.data.images.get(COMPARED)
    if image is not None and tuple(image.size) != (width, height):
        bpy.data.images.remove(image)
        image = None
    image = image or bpy.data.images.new(COMPARED, width, height, alpha=False)
    image.pixels.foreach_set(rgba.reshape(-1))
    image.update()
    for area in context.screen.areas if context.screen else ():
        if area.type == "IMAGE_EDITOR":
            area.spaces.active.image = image
            area.tag_redraw()


def forget():
    global _compared
    _compared = None
