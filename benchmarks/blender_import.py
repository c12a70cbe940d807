# SPDX-License-Identifier: Apache-2.0
"""Measures the cost of the Blender add-on without a window: import time, memory, and the add-on's Python code before
each picture.

  make bench-blender SCENE=FOLDER

Import is measured in wall-clock and in processor seconds; the latter don't depend on the machine's load. The Python
code is measured in processor milliseconds of one thread."""

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
    """Resident memory in megabytes: now, and its peak."""
    with open("/proc/self/status") as file:
        rows = dict(line.split(":", 1) for line in file)
    return [round(int(rows[name].split()[0]) / 1024) for name in ("VmRSS", "VmHWM")]


def bring_in(path):
    """Imports a scene; returns the wall-clock seconds and the processor seconds that the import took."""
    begin, work = time.monotonic(), time.process_time()
    assert bpy.ops.import_scene.pags(filepath=path) == {"FINISHED"}
    return [round(time.monotonic() - begin, 2), round(time.process_time() - work, 2)]


def work_ms(function, times=15):
    """Calls `function` repeatedly; returns median and maximum of its processor time in this thread, milliseconds."""
    values = []
    for _ in range(times):
        begin = time.thread_time()
        function()
        values.append(1e3 * (time.thread_time() - begin))
    return [round(float(np.median(values)), 2), round(max(values), 2)]


def write_million(path):
    """Writes a PLY file of a million Gaussians: the background's, repeated or cut."""
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
    """Measures the Python code that view_update and view_draw run before a render job is submitted."""
    scene = bpy.context.scene
    scene.frame_set((scene.frame_start + scene.frame_end) // 2)
    depsgraph = bpy.context.evaluated_depsgraph_get()
    state = gather.gather(depsgraph)
    frame, now = state.load(True), scene.frame_current_final
    values, pose = lens.of_camera(scene.camera.data, scene.camera.matrix_world, 960, 540)

    def submit():
        return native.renderer("bench", 0).submit(
            frame.entry.scene,
            frame.camera(values, pose, now),
            **frame.contents_at(now),
            **gather.job_arguments(scene.pags, frame, False),
        )

    put("objects", len(frame.lead.indices))
    put("gather_ms", work_ms(lambda: gather.gather(depsgraph)))
    put("placements_ms", work_ms(lambda: frame.contents_at(now)))
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
