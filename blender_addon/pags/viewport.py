# SPDX-License-Identifier: GPL-3.0-or-later
"""The picture of a 3D view: coarse while something moves, full resolution when nothing does; drawing never waits for it.

Each view makes a request (a key and the job's arguments) whenever it is drawn. At most one job of a view runs at a time.
After a change of the request, the next job is a coarse one that keeps the deadline; after a pause without change, one at
full resolution, which is cancelled when the request changes. A timer looks for finished jobs and redraws their views."""

import time
import weakref

import bpy
import gpu

from . import draw, gather, lens, native, pace
from .native import SceneError

STILL = 0.12  # seconds without change before the picture at full resolution is rendered
TICK = 0.008

views = weakref.WeakSet()


class Shown:
    """A picture on the GPU with the request that it answers."""

    def __init__(self, key, scale, picture, values):
        self.key, self.scale, self.values, self.degree = key, scale, values, 3
        self.stats = picture.stats
        self.size = (picture.width, picture.height)
        begin = time.perf_counter()
        self.color = draw.texture(picture.rgba, picture.width, picture.height, 4)
        self.depth = (
            draw.texture(picture.depth, picture.width, picture.height, 1) if picture.depth is not None else None
        )
        self.ms_upload = 1e3 * (time.perf_counter() - begin)


def wiped_scene(depsgraph):
    """Name of the root that is drawn right of the wipe's edge, or ""."""
    scene = depsgraph.scene.original
    root = scene.pags.wipe_root
    return root.name if root is not None and scene.objects.get(root.name) is not None else ""


def edge_of(settings):
    """The wipe's edge, from -1 to 1 across a view."""
    return 2 * settings.wipe - 1


class View:
    def __init__(self):
        self.state = self.frame = None
        self.job = self.job_key = self.job_scale = self.job_values = self.job_degree = None
        self.requested, self.changed_at, self.requested_degree = None, 0.0, 3
        self.shown = None
        self.budget, self.pace = pace.Budget(), pace.Pace()
        self.error = ""
        self.watch = pace.Stopwatch()
        self.loading = False
        self.wiped, self.second = "", None  # name of the scene that is drawn right of the wipe's edge, and the View that draws it
        views.add(self)
        start_timer()

    # ---- Requests and jobs ----

    def update(self, depsgraph):
        begin = pace.clock()
        self.wiped = wiped_scene(depsgraph)
        self.state = gather.gather(depsgraph, without=self.wiped)
        if self.wiped:
            self.second = self.second or View()
            self.second.state = gather.gather(depsgraph, only=self.wiped)
        elif self.second is not None:
            self.second.drop()
            self.second = None
        self.watch.gather(begin)

    def request(self, context, depsgraph, width, height, outputs, transparent):
        """A request: key and arguments of a job at full resolution, or None where there is nothing to draw."""
        if self.state is None:
            self.error = "no PAGS scene is visible: File > Import > PAGS scene"
            return None
        self.frame = frame = self.state.load(False)
        self.loading = frame is None
        if frame is None:
            self.error = f"loading {', '.join(scene.path for scene in self.state.scenes)} ..."
            return None
        region = context.region_data
        settings = depsgraph.scene.pags
        values, pose = lens.of_view(region.window_matrix, region.view_matrix, width, height)
        now = depsgraph.scene.frame_current_final
        camera = frame.camera(values, pose, now)
        job_arguments = gather.job_arguments(settings, frame, False)
        job_arguments.update(outputs=outputs, transparent=transparent)
        if region.view_perspective == "CAMERA":
            job_arguments.update(frame.exposure(settings, depsgraph.scene.camera, now))
        key = (tuple(camera["world_from_camera"]), camera["fx"], camera["cx"], camera["cy"], now, width, height)
        key += (native.generation, self.state.key(), settings.hide_noncritical, tuple(sorted(job_arguments.items())))
        self.error = ""
        return key, frame, camera, values, job_arguments, settings, now

    def submit(self, requested, scale, degree):
        key, frame, camera, values, job_arguments, settings, now = requested
        small = dict(camera)
        small["width"], small["height"] = (
            max(1, round(camera["width"] / scale)),
            max(1, round(camera["height"] / scale)),
        )
        across, down = small["width"] / camera["width"], small["height"] / camera["height"]
        small["fx"], small["cx"] = camera["fx"] * across, camera["cx"] * across
        small["fy"], small["cy"] = camera["fy"] * down, camera["cy"] * down
        job_arguments = dict(job_arguments, sh_degree=min(degree, job_arguments["sh_degree"]), cut=pace.CUTS[scale])
        self.job = native.renderer("view", settings.threads).submit(
            frame.entry.scene, small, **frame.contents_at(now, settings.hide_noncritical), **job_arguments
        )
        self.job_key, self.job_scale, self.job_values, self.job_degree = key, scale, values, degree

    def advance(self, requested):
        """Takes a finished picture and submits the next job; returns the milliseconds of the upload to the GPU."""
        upload = self.collect()
        if requested is None:
            return upload
        key, settings, now = requested[0], requested[5], time.monotonic()
        self.requested_degree = settings.sh_degree
        if key != self.requested:
            self.requested, self.changed_at = key, now
        if self.job is not None:
            if self.job_key != key and self.job_scale <= 1.0 and now - self.changed_at < STILL:
                self.job.cancel()
            return upload
        if self.shown is None or self.shown.key != key:
            size = requested[2]["width"], requested[2]["height"]
            scale, kept = self.budget.choose(*size, settings.deadline)
            hurried, _ = self.budget.choose(*size, settings.deadline * self.pace.share)
            scale = max(scale, min(hurried, self.pace.COARSEST))
            self.submit(requested, scale, settings.sh_degree if kept else 0)
        elif self.shown.unsharp and now - self.changed_at >= STILL:
            self.submit(requested, 1.0, settings.sh_degree)
        return upload

    def collect(self):
        if self.job is None or not self.job.done():
            return 0.0
        job, self.job = self.job, None
        try:
            picture = job.take()
        except native.module.Cancelled:
            return 0.0
        except (native.module.Error, MemoryError) as error:
            self.error = str(error)
            return 0.0
        self.shown = Shown(self.job_key, self.job_scale, picture, self.job_values)
        self.shown.degree = self.job_degree
        self.shown.unsharp = self.job_scale > 1.0 or self.job_degree < self.requested_degree
        self.budget.learn(self.shown.stats, picture.width, picture.height)
        self.watch.add_picture(self.shown)
        if self.shown.unsharp:
            self.pace.came(time.monotonic())
        return self.shown.ms_upload

    def restless(self):
        """Whether the timer has to watch this view: it loads, renders, or shows a picture that is not final."""
        if self.loading or self.job is not None:
            return True
        return (
            self.shown is not None and self.requested is not None and (self.shown.key != self.requested or self.shown.unsharp)
        )

    # ---- Statistics ----

    def rate(self):
        times = [picture[0] for picture in self.watch.pictures[-100:] if picture[0] > time.monotonic() - 2]
        return (len(times) - 1) / (times[-1] - times[0]) if len(times) > 1 and times[-1] > times[0] else 0.0

    def statistics(self, settings):
        """The text shown over the view. During movement only what was reduced: without a graphics card sixty letters take 10 % of a redraw."""
        if self.error:
            return self.error
        if self.shown is None:
            return "drawing ..."
        text = self.dropped(settings) if self.shown.unsharp else self.counts()
        if self.rate() > 0:
            text += f", {self.rate():.1f} FPS"
        said = "" if self.shown.unsharp or self.frame is None else self.frame.remarks()
        return f"{text}; {said}" if said else text

    def dropped(self, settings):
        """How the picture was reduced to keep the deadline: size and SH degree."""
        less_colour = f", SH degree {self.shown.degree}" if self.shown.degree < settings.sh_degree else ""
        return f"1/{self.shown.scale:g} size{less_colour}"

    def counts(self):
        stats = self.shown.stats
        text = (
            f"{stats['gaussians']:,} Gaussians, {stats['gaussians'] - stats['shaded']:,} culled, {stats['ms']:.0f} ms"
        )
        if stats["hidden"] or stats["loaded"] < stats["in_view"]:
            text += f" ({stats['in_view'] - stats['loaded'] + stats['hidden']:,} by Early-Z)"
        return text

    # ---- Drawing ----

    def draw_rendered(self, engine, context, depsgraph):
        begin = pace.clock()
        width, height = context.region.width, context.region.height
        try:
            if self.wiped != wiped_scene(depsgraph):
                self.update(depsgraph)
            requested = self.request(context, depsgraph, width, height, ("rgba",), False)
            upload = self.advance(requested)
            if self.second is not None:
                upload += self.second.advance(self.second.request(context, depsgraph, width, height, ("rgba",), False))
        except (SceneError, RuntimeError, ValueError) as error:
            self.error, upload = str(error), 0.0
        engine.update_stats("", self.statistics(depsgraph.scene.pags))
        middle = pace.clock()
        edge = edge_of(depsgraph.scene.pags) if self.second is not None else 1
        if self.shown is not None:
            self.put_plain(-1, edge)
        if self.second is not None and self.second.shown is not None:
            self.second.put_plain(edge + 4 / width, 1)  # a gap of two pixels is the edge
        self.watch.add(begin, middle, upload)

    def put_plain(self, left, right):
        shader = draw.shader("plain")
        gpu.state.depth_test_set("NONE")
        gpu.state.depth_mask_set(False)
        gpu.state.blend_set("NONE")
        shader.bind()
        shader.uniform_sampler("picture", self.shown.color)
        draw.part("plain", left, right).draw(shader)

    def drop(self):
        if self.job is not None:
            self.job.cancel()
        self.job = self.shown = None
        if self.second is not None:
            self.second.drop()


# ---- The timer ----


def tick():
    """Redraws the views whose picture is ready or whose next job is due."""
    busy = [view for view in views if view.restless()]
    now = time.monotonic()
    due = any(
        (view.job is None or view.job.done())
        and (view.loading is False)
        and (view.job is not None or now - view.changed_at >= STILL)
        for view in busy
    )
    if due or any(view.loading for view in busy):
        for _, region in draw.regions():
            region.tag_redraw()
    return TICK if busy else 0.05


def start_timer():
    if not bpy.app.background and not bpy.app.timers.is_registered(tick):
        bpy.app.timers.register(tick, persistent=True)


def stop_timer():
    if bpy.app.timers.is_registered(tick):
        bpy.app.timers.unregister(tick)
    for view in list(views):
        view.drop()
