# SPDX-License-Identifier: Apache-2.0
"""Tests long work in a real window, started as a user does: import, export, proxies, photographs, composite, saving
edits. Blender stays responsive: a timer ticks, and no call of the add-on takes half of a job's time. Cancelling
leaves nothing behind."""

import functools
import json
import os
import sys
import time

import bpy
import numpy as np

HERE = os.path.dirname(os.path.abspath(__file__))
sys.path[:0] = [HERE, os.path.join(HERE, "..", "cli")]
from fixtures import png_bytes, splat, write  # noqa: E402
from gui_case import FOLDER, PATIENCE, addon, in_view, look_ahead, shoot, tell, view3d, window  # noqa: E402
from test_drive import make_drive, with_object_id  # noqa: E402

SCENE, SET = os.path.join(FOLDER, "street"), os.path.join(FOLDER, "set")
CALLED = ("execute", "invoke", "modal", "cancel", "draw", "check", "view_draw", "view_update")
part = lambda name: sys.modules[f"{addon.__name__}.{name}"]
jobs, program, overlay, viewport, registry = map(part, ("jobs", "program", "overlay", "viewport", "registry"))

# ---- A stopwatch for all functions that Blender calls ----

taken, depth, ticks = [], [0], []


def timed(function, name):
    @functools.wraps(function)
    def call(*arguments):
        depth[0] += 1
        begin, own = time.perf_counter(), time.thread_time()
        try:
            return function(*arguments)
        finally:
            depth[0] -= 1
            if depth[0] == 0:
                taken.append((time.perf_counter() - begin, time.thread_time() - own, name))

    return call


def method(function, name):
    """Times a method. Blender passes as many arguments as the function's code declares."""
    call = timed(function, name)
    if function.__code__.co_argcount == 2:
        return lambda self, context: call(self, context)
    return lambda self, context, third: call(self, context, third)


def watch():
    for module in [m for n, m in list(sys.modules.items()) if n.startswith(addon.__name__ + ".")]:
        for cls in [
            c
            for c in vars(module).values()
            if isinstance(c, type) and issubclass(c, bpy.types.bpy_struct) and c.__module__ == module.__name__
        ]:
            for name in CALLED:
                if name in vars(cls):
                    setattr(cls, name, method(vars(cls)[name], f"{cls.__name__}.{name}"))
    for name in dir(bpy.app.handlers):
        handlers = getattr(bpy.app.handlers, name)
        for at, handler in enumerate(handlers if isinstance(handlers, list) else ()):
            if handler.__module__.startswith(addon.__name__):
                handlers[at] = timed(handler, handler.__name__)
    registry.unregister(overlay)
    overlay.DRAWN = [(timed(function, function.__name__), when) for function, when in overlay.DRAWN]
    registry.register(overlay)
    bpy.app.timers.unregister(viewport.tick)
    viewport.tick = timed(viewport.tick, "tick")
    viewport.start_timer()
    bpy.app.timers.register(tick, first_interval=0.01)


def tick():
    ticks.append(time.perf_counter())
    return 0.01


def report(what):
    """Prints the longest calls of the add-on, with processor time in brackets, and the longest time between two
    ticks (with Blender's drawing). A job that ran in one call would take nearly all the time and stop the timer.
    Milliseconds depend on the machine and are only printed."""
    longest = sorted(taken, reverse=True)[:3]
    gaps = np.diff(ticks) if len(ticks) > 1 else np.zeros(1)
    said = ", ".join(f"{1e3 * seconds:.0f} ({1e3 * own:.0f}) ms {name}" for seconds, own, name in longest)
    most = max(own for _, own, _ in taken)
    said += f"; most of the processor {1e3 * most:.0f} ms"
    print(
        f"figures: {what}: longest calls {said}; longest time between ticks {1e3 * gaps.max():.0f} ms, of {len(ticks)}"
    )
    assert longest and len(ticks) > 4 and longest[0][0] < 0.5 * (ticks[-1] - ticks[0]), (
        f"{what}: {longest} of {ticks[-1] - ticks[0]:.2f} s"
    )
    del taken[:], ticks[:]


# ---- A user's actions ----


def until(done, seconds=300):
    end = time.monotonic() + seconds * PATIENCE
    while not done():
        assert time.monotonic() < end, "it takes too long"
        yield 0.02


def browse(operator, path, **properties):
    """Starts an operator with a file browser, types the path and presses the button."""
    with in_view():
        assert operator("INVOKE_DEFAULT", **properties) == {"RUNNING_MODAL"}
    found = lambda: [
        (w, a) for w in bpy.context.window_manager.windows for a in w.screen.areas if a.type == "FILE_BROWSER"
    ]
    yield from until(lambda: found() and found()[0][1].spaces.active.params is not None)
    yield 1  # operators of the browser crash Blender before the browser is drawn for the first time
    browser, area = found()[0]
    params = area.spaces.active.params
    params.directory = os.path.dirname(path).encode() if os.path.basename(path) else path.encode()
    if os.path.basename(path):
        params.filename = os.path.basename(path)
    yield 1
    with bpy.context.temp_override(
        window=browser, area=area, region=next(r for r in area.regions if r.type == "WINDOW")
    ):
        bpy.ops.file.execute()
    yield 0.3


def finished(what, path=None):
    """Yields until no job runs; checks that no error was reported."""
    yield from until(lambda: jobs.current is None)
    yield 0.3
    report(what)
    assert path is None or os.path.exists(path), f"{what}: {path} isn't there"
    assert not errors, errors
    assert os.listdir(LEFT) == []


errors = []
LEFT = os.path.join(FOLDER, "temporary")


def collect_errors():
    """Collects the job operator's reports. Blender gives no access to them and shows them in a window."""
    original = jobs.PAGS_OT_job.modal

    @functools.wraps(original)
    def modal(self, context, event):
        class Told:
            def __getattr__(_, name):
                return getattr(self, name)

            def __setattr__(_, name, value):
                setattr(self, name, value)

            def report(_, kind, text):
                print("report:", kind, text)
                (errors if "ERROR" in kind else notices).append(text)

        return original(Told(), context, event)

    jobs.PAGS_OT_job.modal = modal


notices = []

# ---- The scene ----


def make_street():
    """Makes a street with enough work: 150,000 Gaussians of road and car, a track of 200 labels, distorted
    photographs."""
    make_drive(SCENE)
    generator = np.random.default_rng(1)
    with open(os.path.join(SCENE, "background.ply"), "rb") as file:
        header, _ = file.read().split(b"end_header\n")
    row = np.frombuffer(
        with_object_id([splat(0, 0, 0, (0.4, 0.4, 0.4), sigma=0.1, opacity=4.0)], [-1]).split(b"end_header\n")[1], "<f4"
    )
    rows = np.tile(row, (150000, 1))
    rows[:, :3] = generator.uniform((3, -15, -2), (60, 15, 3), (len(rows), 3))
    rows[-1, -1] = np.array(0, "<i4").view("<f4")  # the last row belongs to the parked car
    header = header.replace(b"element vertex 2\n", b"element vertex 150000\n")
    write(os.path.join(SCENE, "background.ply"), header + b"end_header\n" + rows.tobytes())
    with open(os.path.join(SCENE, "scene.json"), encoding="utf-8") as file:
        record = json.load(file)
    record["models"][0]["gaussians"] = len(rows)
    car = record["objects"][1]["knots"]
    record["objects"][1]["knots"] = [{**car[0], "time": 100 + 0.01 * i, "frame": i} for i in range(201)]
    record["dataset"] = "/recordings/set"  # a folder of another machine
    for view in record["cameras"]:
        view["name"] = view["name"].replace(".jpg", ".png")
        scale = 9
        for key in ("width", "height", "fx", "fy", "cx", "cy"):
            view[key] *= scale
        write(os.path.join(SET, "images", view["name"]), png_bytes(909, 909, bytes([90, 120, 150]) * 909 * 909))
    write(os.path.join(SET, "intrinsics", "0.txt"), "\n".join(map(str, [900, 900, 454.5, 454.5, -0.1, 0, 0, 0, 0])))
    write(os.path.join(SCENE, "scene.json"), json.dumps(record))


def story():
    make_street()
    os.mkdir(LEFT)
    part("exporter").tempfile.tempdir = LEFT
    collect_errors()
    watch()
    look_ahead()
    yield from browse(bpy.ops.import_scene.pags, os.path.join(SCENE, "scene.json"))
    yield from finished("import")
    root = next(o for o in bpy.data.objects if o.pags.kind == "ROOT")
    root.pags.dataset = SET
    view3d().shading.type = "RENDERED"
    view3d().region_3d.view_perspective = "CAMERA"
    yield 1
    car = next(o for o in bpy.data.objects if o.pags.kind == "OBJECT" and o.pags.index == 1)
    car.location.x += 1
    yield from browse(bpy.ops.export_scene.pags, os.path.join(FOLDER, "edited.ply"))
    yield from finished("export of Gaussians", os.path.join(FOLDER, "edited.ply"))
    os.mkdir(os.path.join(FOLDER, "saved"))
    yield from browse(bpy.ops.pags.save_edited, os.path.join(FOLDER, "saved", ""))
    yield from finished("edited scene", os.path.join(FOLDER, "saved", "scene.json"))
    yield from proxies()
    for camera in [o for o in bpy.data.objects if o.type == "CAMERA" and o.data.pags.sensor == 0]:
        bpy.context.scene.camera = camera
    with in_view():
        bpy.ops.pags.photographs("INVOKE_DEFAULT")
    yield from finished("photographs")
    background = bpy.context.scene.camera.data.background_images[0]
    assert os.path.exists(bpy.path.abspath(background.image.filepath)), "the photographs aren't there"
    with in_view():
        bpy.ops.pags.compare("INVOKE_DEFAULT")
    yield from finished("comparison")
    assert "PSNR" in bpy.context.scene.pags_compared
    yield from composited()


def proxies():
    """Cancels the import while a slow program runs and the header shows its progress; then runs it to the end."""
    if program.lacking(bpy.context):
        print("skipped: proxies:", program.lacking(bpy.context))
        return
    before, run = len(bpy.data.objects), program.run
    program.run = lambda job, *_: run(job, "/bin/sh", "-c", "echo 'background: 40 %, 5 min left'; exec sleep 300")
    with in_view():  # Leave the context before each yield: Blender must not use a context of Python while threads run.
        bpy.ops.pags.import_proxies("INVOKE_DEFAULT")
    yield from until(lambda: jobs.current is None or jobs.current.line() == "Import proxies: background, 40 %")
    assert jobs.current is not None, notices
    shoot("job")
    with in_view():
        try:
            bpy.ops.pags.import_proxies("INVOKE_DEFAULT")
            raise AssertionError("two jobs at a time")
        except RuntimeError as error:
            assert "is running" in str(error), error
        bpy.ops.pags.cancel_job()
    yield from finished("proxies, cancelled")
    program.run = run
    assert "Import proxies: cancelled" in notices and len(bpy.data.objects) == before, notices
    with in_view():
        bpy.ops.pags.import_proxies("INVOKE_DEFAULT", level="box")
    yield from finished("proxies")
    assert len(bpy.data.objects) > before and "proxies" in notices[-1], notices


def composited():
    """Opens the composite's dialog and closes it with Enter."""
    with in_view():
        bpy.ops.pags.composite("INVOKE_DEFAULT")
    yield 0.5
    x, y = window().width // 2, window().height // 2
    for kind, value in (("MOUSEMOVE", "NOTHING"), ("RET", "PRESS"), ("RET", "RELEASE")):
        window().event_simulate(type=kind, value=value, x=x, y=y)
        yield 0.3
    yield from finished("composite")
    assert bpy.context.scene.world.name == part("light").LIGHT
    with in_view():
        bpy.ops.ed.undo()  # the job has made an undo step
    yield 0.5
    assert bpy.context.scene.world.name != part("light").LIGHT


tell(story())
