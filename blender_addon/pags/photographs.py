# SPDX-License-Identifier: GPL-3.0-or-later
"""The recording's photographs: finds them, undistorts them, and shows them as a camera's background, frame by frame."""

import hashlib
import os

import bpy
import numpy as np

from . import files, native


def path_of(entry, name):
    """Path of a view's photograph, or None where it isn't found."""
    dataset = entry.info.get("dataset")
    if not dataset:
        return None
    base = os.path.dirname(entry.path)
    for folder in (dataset, os.path.join(base, dataset), os.path.join(base, os.path.basename(dataset.rstrip("/")))):
        for inner in ("images", ""):
            path = os.path.join(folder, inner, name)
            if os.path.exists(path):
                return path
    return None


def lens_file(entry, sensor):
    """Nine numbers fx fy cx cy k1 k2 p1 p2 k3 of a driving set's camera where it has distortion, else None."""
    path = os.path.join(entry.info.get("dataset") or "", "intrinsics", f"{sensor}.txt")
    try:
        with open(path, encoding="utf-8") as file:
            numbers = [float(word) for word in file.read().split()]
    except (OSError, ValueError):
        return None
    return numbers[:9] if len(numbers) >= 9 and any(abs(k) > 1e-9 for k in numbers[4:9]) else None


def read(path):
    """Reads a picture: (height, width, 3), display-referred sRGB, row 0 at the top."""
    image = bpy.data.images.load(path, check_existing=False)
    try:
        image.colorspace_settings.name = "Non-Color"
        width, height = image.size
        if width == 0:
            raise OSError(f"{path}: not a picture that Blender reads")
        flat = np.empty(width * height * image.channels, dtype=np.float32)
        image.pixels.foreach_get(flat)
        return flat.reshape(height, width, -1)[::-1, :, :3].copy()
    finally:
        bpy.data.images.remove(image)


def sample(picture, x, y):
    """Samples a picture bilinearly at x, y (pixels, corner at 0), clamped at the border."""
    height, width = picture.shape[:2]
    x, y = np.clip(x - 0.5, 0, width - 1), np.clip(y - 0.5, 0, height - 1)
    x0, y0 = np.minimum(x.astype(int), width - 2), np.minimum(y.astype(int), height - 2)
    u, v = (x - x0)[..., None].astype(np.float32), (y - y0)[..., None].astype(np.float32)
    top = picture[y0, x0] * (1 - u) + picture[y0, x0 + 1] * u
    return top * (1 - v) + (picture[y0 + 1, x0] * (1 - u) + picture[y0 + 1, x0 + 1] * u) * v


def as_view(picture, view, distortion):
    """The photograph as the view's pinhole camera sees it, at the view's size (Brown's model of radial and tangential distortion)."""
    height, width = picture.shape[:2]
    u, v = np.meshgrid(np.arange(view["width"]) + 0.5, np.arange(view["height"]) + 0.5)
    x, y = (u - view["cx"]) / view["fx"], (v - view["cy"]) / view["fy"]
    if distortion is None:
        if (width, height) == (view["width"], view["height"]):
            return picture
        return sample(picture, u * width / view["width"], v * height / view["height"])
    fx, fy, cx, cy, k1, k2, p1, p2, k3 = distortion
    r = x * x + y * y
    radial = 1 + r * (k1 + r * (k2 + r * k3))
    return sample(
        picture,
        fx * (x * radial + 2 * p1 * x * y + p2 * (r + 2 * x * x)) + cx,
        fy * (y * radial + p1 * (r + 2 * y * y) + 2 * p2 * x * y) + cy,
    )


def load(entry, view):
    """A view's photograph as its pinhole camera sees it; OSError where it isn't there."""
    path = path_of(entry, view["name"])
    if path is None:
        raise OSError(f"the photograph {view['name']} of {entry.info.get('dataset') or 'this scene'} is not there")
    return as_view(read(path), view, lens_file(entry, view["sensor"]))


def save(picture, path):
    """Writes a picture (row 0 at the top) as an 8-bit PNG."""
    height, width = picture.shape[:2]
    image = bpy.data.images.new("pags photograph", width, height, alpha=False)
    try:
        image.colorspace_settings.name = "Non-Color"
        rgba = np.ones((height, width, 4), dtype=np.float32)
        rgba[..., :3] = picture[::-1]
        image.pixels.foreach_set(rgba.reshape(-1))
        image.file_format = "PNG"
        image.filepath_raw = path
        image.save()
    finally:
        bpy.data.images.remove(image)


def cache_folder(entry, sensor, fps):
    """Folder of the numbered copies or links: below the user's data folder, where extensions have to write."""
    key = hashlib.sha1(f"{entry.path} {entry.stamp} {sensor} {fps:.6f}".encode()).hexdigest()[:12]
    inner = os.path.join("photographs", key)
    if hasattr(bpy.utils, "extension_path_user") and __package__.startswith("bl_ext."):
        return bpy.utils.extension_path_user(__package__, path=inner, create=True)
    return bpy.utils.user_resource("DATAFILES", path=os.path.join("pags", inner), create=True)


def prepare(entry, sensor, folder, fps):
    """Makes a file 00001.*, ... for every frame of the timeline, a link to (or, where links can't be made, a copy of) the photograph nearest in
    time, undistorted where the lens has distortion. Returns the count and the extension."""
    views = sorted((v for v in entry.scene.views if v["sensor"] == sensor and "time" in v), key=lambda v: v["time"])
    times = np.array([v["time"] for v in views])
    paths = [path_of(entry, v["name"]) for v in views]
    if not paths or not all(paths):
        raise OSError(f"the photographs of {entry.info.get('dataset') or 'this scene'} are not there")
    distortion = lens_file(entry, sensor)
    begin = entry.info["time_begin"]
    count = int(np.floor((times[-1] - begin) * fps + 1e-6)) + 1
    made = {}
    extension = ".png" if distortion else os.path.splitext(paths[0])[1]
    for number in range(count):
        nearest = int(np.argmin(np.abs(times - (begin + number / fps))))
        target = os.path.join(folder, f"{number + 1:05d}{extension}")
        if os.path.exists(target) and os.path.getmtime(target) >= os.path.getmtime(paths[nearest]):
            continue
        if os.path.lexists(target):  # a broken link, or a copy of an older photograph
            os.remove(target)
        if distortion and nearest not in made:
            picture = as_view(read(paths[nearest]), views[nearest], distortion)
            files.complete(target, lambda part, picture=picture: save(picture, part), "can't be written")
            made[nearest] = target
        else:
            files.link_or_copy(made.get(nearest, paths[nearest]), target)
    return count, extension


def show(camera, entry, root):
    """Shows a sensor's photographs as its camera's background, in place of those shown before. Returns a list of messages for the user."""
    sensor = camera.data.pags.sensor
    try:
        folder = cache_folder(entry, sensor, root.pags.fps)
        count, extension = prepare(entry, sensor, folder, root.pags.fps)
        image = bpy.data.images.load(os.path.join(folder, "00001" + extension), check_existing=True)
    except (native.SceneError, OSError, RuntimeError) as error:
        return [f"{camera.name}: {error}"]
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
    return []


_compared = None  # (photograph, the engine's picture of the same view)


def compare(context, photograph, picture):
    """Shows the photograph and the engine's picture side by side, split at the scene's wipe setting."""
    global _compared
    _compared = (photograph, picture)
    wipe(context, context.scene.pags.wipe)


def wipe(context, share):
    """Updates the comparison image: the photograph left of the edge (a share of the width), the engine's picture right of it."""
    if _compared is None:
        return
    photograph, picture = _compared
    height, width = picture.shape[:2]
    edge = int(round(share * width))
    rgba = np.ones((height, width, 4), dtype=np.float32)
    rgba[:, :edge, :3], rgba[:, edge:, :3] = photograph[::-1, :edge], picture[::-1, edge:]
    if 0 < edge < width:
        rgba[:, edge - 1 : edge + 1, :3] = 1
    image = bpy.data.images.get("PAGS comparison")
    if image is not None and tuple(image.size) != (width, height):
        bpy.data.images.remove(image)
        image = None
    image = image or bpy.data.images.new("PAGS comparison", width, height, alpha=False)
    image.pixels.foreach_set(rgba.reshape(-1))
    image.update()
    for area in context.screen.areas if context.screen else ():
        if area.type == "IMAGE_EDITOR":
            area.spaces.active.image = image
            area.tag_redraw()


def forget():
    global _compared
    _compared = None
