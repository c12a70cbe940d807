# SPDX-License-Identifier: Apache-2.0
"""What the add-on itself costs, without a window: importing, memory, and our Python before each picture.

  make bench-blender SCENE=FOLDER

Import: seconds of the clock and of the processors; the latter don't depend on what else the machine does. Our Python: processor milliseconds of
one thread."""

import json
import os
import sys
import time

import bpy
import numpy as np

sys.path.insert(0, os.path.join(os.path.dirname(os.path.abspath(__file__)), "..", "tests", "addon"))
from blender_case import addon  # noqa: E402

gather = sys.modules[addon.__name__ + ".gather"]
lens = sys.modules[addon.__name__ + ".lens"]
native = sys.modules[addon.__name__ + ".native"]

SCENE, OUTPUT = os.environ["PAGS_BENCH_SCENE"], os.environ.get("PAGS_BENCH_JSON", "")
MILLION = 1000000
figures = {}


def put(name, value):
    figures[name] = value
    print(f"figures: {name}: {value}", flush=True)


def memory():
    """Resident megabytes, now and at most."""
    with open("/proc/self/status") as file:
        rows = dict(line.split(":", 1) for line in file)
    return [round(int(rows[name].split()[0]) / 1024) for name in ("VmRSS", "VmHWM")]


def bring_in(path):
    """Seconds by the clock and of the processors."""
    begin, work = time.monotonic(), time.process_time()
    assert bpy.ops.import_scene.pags(filepath=path) == {"FINISHED"}
    return [round(time.monotonic() - begin, 2), round(time.process_time() - work, 2)]


def work_ms(function, times=15):
    """Median and worst processor milliseconds of this thread."""
    values = []
    for _ in range(times):
        begin = time.thread_time()
        function()
        values.append(1e3 * (time.thread_time() - begin))
    return [round(float(np.median(values)), 2), round(max(values), 2)]


def write_million(path):
    """The background's Gaussians, repeated or cut, as a bare file."""
    with open(os.path.join(SCENE, "background.ply"), "rb") as file:
        head = b""
        while not head.endswith(b"end_header\n"):
            head += file.readline()
        lines = head.decode().splitlines()
        width = 4 * sum(line.startswith("property") for line in lines)
        rows = np.frombuffer(file.read(), dtype=f"V{width}")
    lines = [f"element vertex {MILLION}" if line.startswith("element vertex") else line for line in lines]
    with open(path, "wb") as file:
        file.write(("\n".join(lines) + "\n").encode() + np.resize(rows, MILLION).tobytes())


def python_side():
    """What view_update and view_draw do before a picture is submitted."""
    scene = bpy.context.scene
    scene.frame_set((scene.frame_start + scene.frame_end) // 2)
    depsgraph = bpy.context.evaluated_depsgraph_get()
    state, _ = gather.gather(depsgraph)
    entry = gather.load(state, True)
    now = gather.time_of(state, entry, scene.frame_current_final)
    values, pose = lens.of_camera(scene.camera.data, scene.camera.matrix_world, 960, 540)

    def submit():
        camera = gather.camera_for(state, entry, values, pose, now)
        return native.renderer("bench", 0).submit(
            entry.scene,
            camera,
            placements=gather.placements(state, entry, now),
            **gather.job_arguments(scene.pags, state, entry, False),
        )

    put("objects", len(state.indices))
    put("gather_ms", work_ms(lambda: gather.gather(depsgraph)))
    put("placements_ms", work_ms(lambda: gather.placements(state, entry, now)))
    put("submit_ms", work_ms(lambda: submit().cancel()))
    picture = submit().take()
    put("picture_wall_ms", {k: round(picture.stats[k], 1) for k in ("ms", "ms_job", "ms_fill")})


def main():
    for block in list(bpy.data.objects):
        bpy.data.objects.remove(block)
    put("load", [round(v, 1) for v in os.getloadavg()])
    put("memory_before", memory())
    put("import_seconds", bring_in(SCENE))
    put("memory_after", memory())
    put("gaussians", native.entry(os.path.abspath(SCENE), True).info["gaussians"])
    python_side()
    path = os.path.join(bpy.app.tempdir, "million.ply")
    write_million(path)
    before = memory()
    put("million_import_seconds", bring_in(path))
    put("million_memory", [after - b for after, b in zip(memory(), before)])
    if OUTPUT:
        with open(OUTPUT, "w") as file:
            json.dump(figures, file, indent=1)
    print("all tests passed", flush=True)


main()
