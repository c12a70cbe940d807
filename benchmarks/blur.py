# SPDX-License-Identifier: Apache-2.0
"""What depth of field and motion blur of F12 cost and how far they are from many pictures: tests/addon/run_blender.py runs it in Blender.

  PAGS_BENCH_SCENE=FOLDER python3 tests/addon/run_blender.py ../../benchmarks/blur.py build/pags build/pags-blender-*.zip

Draws the scene's camera in the middle of its time with a shutter of half a frame at f/2.8 and 85 mm, focused at 12 m, by 2 to 256 samples, and prints
time and PSNR against the mean of 1,024."""

import os
import sys
import time

import bpy
import numpy as np

sys.path.insert(0, os.path.join(os.path.dirname(os.path.abspath(__file__)), "..", "tests", "addon"))
from blender_case import addon  # noqa: E402

blur = sys.modules[addon.__name__ + ".blur"]
engine = sys.modules[addon.__name__ + ".engine"]
MANY = int(os.environ.get("PAGS_BENCH_MANY", "1024"))
kept = {}


def keep(render_pass, buffer):
    kept[render_pass.name] = np.asarray(buffer).reshape(-1)[:].copy()


def draw(samples):
    """Colours as the screen shows them, and seconds."""
    bpy.context.scene.pags.blur_samples = samples
    begin = time.monotonic()
    bpy.ops.render.render()
    took = time.monotonic() - begin
    light = np.clip(kept["Combined"], 0, 1)
    return np.where(light <= 0.0031308, 12.92 * light, 1.055 * light ** (1 / 2.4) - 0.055), took


def main():
    bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
    bpy.ops.preferences.addon_enable(module=addon.__name__)
    bpy.ops.import_scene.pags(filepath=os.environ["PAGS_BENCH_SCENE"])
    scene = bpy.context.scene
    scene.frame_set((scene.frame_start + scene.frame_end) // 2)
    engine.fill_pass = keep
    sharp, alone = draw(2)
    scene.render.use_motion_blur, scene.render.motion_blur_shutter = True, 0.5
    dof = scene.camera.data.dof
    dof.use_dof, dof.focus_distance = True, 12.0
    dof.aperture_fstop = scene.camera.data.lens / (85 / 2.8)  # the aperture's size of such a lens, whatever the camera's own
    wanted, _ = draw(MANY)
    error = float(np.mean((sharp - wanted) ** 2))
    print(f"without: {alone:.2f} s, {-10 * np.log10(error):.2f} dB")
    for samples in (2, 4, 8, 16, 32, 64, 128, 256):
        picture, took = draw(samples)
        print(f"{samples} samples: {took:.2f} s, {-10 * np.log10(max(float(np.mean((picture - wanted) ** 2)), 1e-10)):.2f} dB")
    print("all tests passed")


main()
