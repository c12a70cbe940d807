# SPDX-License-Identifier: Apache-2.0
"""Measures the Blender add-on in a 960x540 viewport: time to the first picture, orbiting, scrubbing the timeline, and
a still view.

  make bench-blender SCENE=FOLDER

Runs in a window under Xvfb, which Blender draws in software. The times of the upload and of Blender's own drawing are
reported separately, since they don't apply to a machine with a GPU. Times are wall clock; `load` is the machine's
load average, `stolen` the share of the processors' time that the host gave to other virtual machines meanwhile."""

import json
import os
import sys
import time

import bpy
import numpy as np
from mathutils import Quaternion

sys.path.insert(0, os.path.join(os.path.dirname(os.path.abspath(__file__)), "..", "tests", "addon"))
from gui_case import (  # noqa: E402
    PATIENCE,
    empty_scene,
    in_view,
    native,
    region,
    settled,
    stopwatch,
    tell,
    view3d,
    viewport,
    wait,
)

WINDOW = "960x540"
SCENE, OUTPUT = os.environ["PAGS_BENCH_SCENE"], os.environ.get("PAGS_BENCH_JSON", "")
SECONDS = float(os.environ.get("PAGS_BENCH_SECONDS", "10"))  # duration of each movement
figures = {}


def memory():
    """Resident memory in megabytes: now, and its peak."""
    with open("/proc/self/status") as file:
        rows = dict(line.split(":", 1) for line in file)
    return [round(int(rows[name].split()[0]) / 1024) for name in ("VmRSS", "VmHWM")]


def stolen():
    """Total time of all processors in seconds, and the part of it that the host gave to other virtual machines
    (proc(5), /proc/stat)."""
    with open("/proc/stat") as file:
        row = [int(v) / os.sysconf("SC_CLK_TCK") for v in file.readline().split()[1:9]]
    return np.array([sum(row), row[7]])


def spread(values):
    """Median, 95th percentile and maximum, rounded; None without values."""
    if not len(values):
        return None
    return [round(float(v), 2) for v in (np.median(values), np.percentile(values, 95), max(values))]


def put(name, value):
    figures[name] = value
    print(f"figures: {name}: {value}")


def story():
    empty_scene()
    put("threads", native.module.available_threads())
    put("load_before", [round(v, 1) for v in os.getloadavg()])
    with in_view():
        bpy.ops.screen.screen_full_area(use_hide_panels=True)
    yield 1.0
    view3d().shading.type = "RENDERED"
    yield from imported()
    put("viewport", [region().width, region().height])
    yield from orbiting()
    yield from scrubbing()
    yield from both(still, "still")
    put("load_after", [round(v, 1) for v in os.getloadavg()])
    put("gaussians", native.entry(os.path.abspath(SCENE), True).info["gaussians"])
    if OUTPUT:
        with open(OUTPUT, "w") as file:
            json.dump(figures, file, indent=1)


def bring_in(path):
    """Imports a scene; returns the wall-clock seconds and the processor seconds that the import took."""
    begin, work = time.monotonic(), time.process_time()
    assert bpy.ops.import_scene.pags(filepath=path) == {"FINISHED"}
    return [round(time.monotonic() - begin, 2), round(time.process_time() - work, 2)]


def the_view():
    return max(viewport.views, key=lambda v: len(v.watch.redraws))


def imported():
    put("memory_before", memory())
    put("import_seconds", bring_in(SCENE))
    view3d().region_3d.view_perspective = "CAMERA"
    begin = time.monotonic()
    while not any(v.shown for v in viewport.views):
        assert time.monotonic() - begin < 100 * PATIENCE, [v.error for v in viewport.views]
        yield 0.005
    put("first_picture_seconds", round(time.monotonic() - begin, 2))
    yield from wait()
    put("sharp_after_import_seconds", round(time.monotonic() - begin, 2))
    put("memory_after", memory())


def both(measure, name, *arguments):
    """Runs a measurement with Blender's overlays and once more without them."""
    yield from measure(name, *arguments)
    view3d().overlay.show_overlays = False
    yield from measure(name + "_without_overlays", *arguments)
    view3d().overlay.show_overlays = True


def moving(name, step):
    """Measures pictures a second and times while `step(i)` moves something at each tick of the timer; then the time
    until the still picture is at full quality."""
    view = the_view()
    view.watch = stopwatch.Stopwatch()
    ticks, begin, before = [], time.monotonic(), stolen()
    while time.monotonic() - begin < SECONDS:
        step(len(ticks))
        ticks.append(time.monotonic())
        yield 0.005
    pictures = list(view.watch.pictures)
    put(f"{name}_fps", round((len(pictures) - 1) / (pictures[-1][0] - pictures[0][0]), 1) if len(pictures) > 1 else 0)
    put(f"{name}_steps", dict(sorted(count(p[1]["step"] for p in pictures).items())))
    all_, others = stolen() - before
    put(f"{name}_stolen", round(others / all_, 3))
    tell_parts(name, view.watch)
    put(f"{name}_tick_ms", spread(1e3 * np.diff(ticks)))
    stopped = time.monotonic()
    while not settled():
        assert time.monotonic() - stopped < 100 * PATIENCE
        yield 0.005
    put(f"{name}_sharp_seconds", round(time.monotonic() - stopped, 2))


def count(keys):
    out = {}
    for key in keys:
        out[key] = out.get(key, 0) + 1
    return out


def tell_parts(name, watch):
    """Reports median, 95th percentile and maximum of the add-on's times in milliseconds. `redraw`: wall clock of the
    add-on's part of a redraw, the sum of `python`, `upload` and `draw`, which grows when other threads share the
    processors; `processor`: the same part in processor time of its own thread; `fill`: the add-on's C code on the
    engine's threads; `engine`: the rest of the render job."""
    put(f"{name}_redraw_ms", spread(np.sum([watch.python, watch.upload, watch.draw], axis=0)))
    put(f"{name}_processor_ms", spread(watch.work))
    put(f"{name}_python_ms", spread(watch.python))
    put(f"{name}_upload_ms", spread([v for v in watch.upload if v > 0]))
    put(f"{name}_draw_ms", spread(watch.draw))
    put(f"{name}_fill_ms", spread([p[1]["ms_fill"] for p in watch.pictures]))
    put(f"{name}_engine_ms", spread([p[1]["ms_job"] - p[1]["ms_fill"] for p in watch.pictures]))


def orbiting():
    """Orbits a point ten metres in front of the recording's camera at the middle of the drive."""
    scene = bpy.context.scene
    scene.frame_set((scene.frame_start + scene.frame_end) // 2)
    eye = scene.camera.matrix_world.copy()
    rv3d = view3d().region_3d
    rv3d.view_perspective = "PERSP"
    turn = eye.to_quaternion()
    rv3d.view_rotation, rv3d.view_distance = turn, 10
    rv3d.view_location = eye.translation + turn @ type(eye.translation)((0, 0, -10))
    yield from wait()

    def step(i):
        view3d().region_3d.view_rotation = Quaternion((0, 0, 1), 0.01 * i) @ turn

    yield from both(moving, "orbit", step)


def scrubbing():
    """Advances the timeline by one frame a tick: first from the view that the orbit left, then through the
    recording's camera, which moves as well."""
    scene = bpy.context.scene
    frames = list(range(scene.frame_start, scene.frame_end + 1))
    frames += frames[-2:0:-1]

    def step(i):
        scene.frame_set(frames[i % len(frames)])

    yield from both(moving, "scrub", step)
    view3d().region_3d.view_perspective = "CAMERA"
    yield from wait()
    yield from both(moving, "scrub_camera", step)


def still(name):
    """Redraws an unchanged view repeatedly. Blender's own time is the whole redraw less the add-on's part."""
    view = the_view()
    view.watch = stopwatch.Stopwatch()
    yield 0.2
    begin, times = time.perf_counter(), 20
    with in_view():
        bpy.ops.wm.redraw_timer(type="DRAW_WIN", iterations=times)
    whole = 1e3 * (time.perf_counter() - begin) / times
    tell_parts(name, view.watch)
    ours = np.sum([view.watch.python, view.watch.upload, view.watch.draw]) / max(1, len(view.watch.redraws))
    put(f"{name}_blender_ms", round(whole - float(ours), 2))


tell(story(), 600 + 20 * SECONDS)
