# SPDX-License-Identifier: Apache-2.0
"""How fast the Blender add-on is in a 960x540 viewport: first picture, orbiting, scrubbing the timeline, still.

  make bench-blender SCENE=FOLDER

Runs in a window under Xvfb, which Blender draws in software: what the upload and Blender's own drawing take says nothing of a
machine with a GPU and is told apart. Times are of the wall's clock; `load` says what else the machine did, `stolen` what share of the
processors' time other machines on the same hardware took meanwhile."""

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
    pace,
    region,
    settled,
    tell,
    view3d,
    viewport,
    wait,
)

WINDOW = "960x540"
SCENE, OUTPUT = os.environ["PAGS_BENCH_SCENE"], os.environ.get("PAGS_BENCH_JSON", "")
SECONDS = float(os.environ.get("PAGS_BENCH_SECONDS", "10"))  # of each movement
figures = {}


def memory():
    """Resident megabytes, now and at most."""
    with open("/proc/self/status") as file:
        rows = dict(line.split(":", 1) for line in file)
    return [round(int(rows[name].split()[0]) / 1024) for name in ("VmRSS", "VmHWM")]


def stolen():
    """Seconds of all processors, and those of them that the host gave to others (proc(5), /proc/stat)."""
    with open("/proc/stat") as file:
        row = [int(v) / os.sysconf("SC_CLK_TCK") for v in file.readline().split()[1:9]]
    return np.array([sum(row), row[7]])


def spread(values):
    """Median, 95th percentile and worst, rounded."""
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
    """Seconds by the clock and of the processors."""
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
    """With Blender's overlays, and without."""
    yield from measure(name, *arguments)
    view3d().overlay.show_overlays = False
    yield from measure(name + "_without_overlays", *arguments)
    view3d().overlay.show_overlays = True


def moving(name, step):
    """`step(i)` moves something at each of the timer's ticks; then all stays still until the picture is sharp."""
    view = the_view()
    view.watch = pace.Stopwatch()
    ticks, begin, before = [], time.monotonic(), stolen()
    while time.monotonic() - begin < SECONDS:
        step(len(ticks))
        ticks.append(time.monotonic())
        yield 0.005
    pictures = list(view.watch.pictures)
    put(f"{name}_fps", round((len(pictures) - 1) / (pictures[-1][0] - pictures[0][0]), 1) if len(pictures) > 1 else 0)
    put(f"{name}_dropped", {"1/%g, SH %d" % key: n for key, n in count((p[1], p[2]) for p in pictures).items()})
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
    """Medians, 95th percentiles and worst milliseconds. `redraw`: ours by the wall's clock, which counts the threads that share the processors,
    of it `python`, `upload` and `draw`; `processor`: the same in its own thread's time; `fill`: ours in C, on the engine's threads."""
    put(f"{name}_redraw_ms", spread(np.sum([watch.python, watch.upload, watch.draw], axis=0)))
    put(f"{name}_processor_ms", spread(watch.work))
    put(f"{name}_python_ms", spread(watch.python))
    put(f"{name}_upload_ms", spread([v for v in watch.upload if v > 0]))
    put(f"{name}_draw_ms", spread(watch.draw))
    put(f"{name}_fill_ms", spread([p[3]["ms_fill"] for p in watch.pictures]))
    put(f"{name}_engine_ms", spread([p[3]["ms_job"] - p[3]["ms_fill"] for p in watch.pictures]))


def orbiting():
    """Round a point ten metres before the recording's camera in the middle of the drive."""
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
    """A frame of the timeline each tick, where the orbit left the view and through the recording's camera, which moves, too."""
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
    """Redraws of what is there; Blender's own part is what is left of the whole."""
    view = the_view()
    view.watch = pace.Stopwatch()
    yield 0.2
    begin, times = time.perf_counter(), 20
    with in_view():
        bpy.ops.wm.redraw_timer(type="DRAW_WIN", iterations=times)
    whole = 1e3 * (time.perf_counter() - begin) / times
    tell_parts(name, view.watch)
    ours = np.sum([view.watch.python, view.watch.upload, view.watch.draw]) / max(1, len(view.watch.redraws))
    put(f"{name}_blender_ms", round(whole - float(ours), 2))


tell(story(), 600 + 20 * SECONDS)
