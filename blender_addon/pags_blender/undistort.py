# SPDX-License-Identifier: GPL-3.0-or-later
"""Undistorts photographs to the scene's pinhole cameras. Hundreds of photographs would block Blender's main thread, so photographs.py also runs this file
separately in a second Blender without a window: `blender -b -P undistort.py -- LIST.json`."""

import json
import os
import sys
import traceback

import bpy
import numpy as np


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
        if image.file_format in ("OPEN_EXR", "HDR"):  # linear light
            flat = np.where(
                flat <= 0.0031308, np.maximum(flat, 0) * 12.92, 1.055 * np.clip(flat, 0.0031308, 1) ** (1 / 2.4) - 0.055
            ).astype(np.float32)
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
    """The photograph undistorted to the view's pinhole camera, at the view's size (Brown's model of radial and tangential distortion)."""
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


def convert(item):
    """Processes one item of the list (photograph, view, lens, new file) and writes the file atomically."""
    part = item["part"]
    try:
        save(as_view(read(item["source"]), item["view"], item["distortion"]), part)
        os.replace(part, item["target"])
    finally:
        if os.path.exists(part):
            os.remove(part)


def main(path):
    with open(path, encoding="utf-8") as file:
        items = json.load(file)
    for number, item in enumerate(items):
        print(f"undistorting photographs: {100 * number // len(items)} %", flush=True)
        convert(item)


if __name__ == "__main__":
    try:
        main(sys.argv[sys.argv.index("--") + 1])
    except (OSError, RuntimeError) as error:
        print(str(error).strip(), flush=True)  # the caller shows the last line to the user
        os._exit(1)
    except Exception:
        traceback.print_exc()
        os._exit(1)
