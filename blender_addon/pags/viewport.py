# SPDX-License-Identifier: GPL-3.0-or-later
"""The picture of a 3D view: coarse while something moves, full resolution when nothing does; drawing never waits for it.

Each view makes a request (a key and the job's arguments) whenever it is drawn. At most one job of a view runs at a time.
After a change of the request, the next job is a coarse one that keeps the deadline; after a pause without change, one at
full resolution, which is cancelled when the request changes. A timer looks for finished jobs and redraws their views."""

import math
import time
import weakref

import bpy
import gpu

from . import draw, gather, ignored, lens, native, pace
from .native import SceneError

STILL = 0.12  # seconds without change before the picture at full resolution is rendered
TICK = 0.008
UNANSWERED = 50  # redraws asked for in vain before a view counts as gone: Blender 5 keeps a view's engine after its region

views = weakref.WeakSet()


class Shown:
    """A picture on the GPU with the request that it answers."""

    def __init__(self, key, scale, picture, values, place):
        """place: (x, y, width, height) in the region, in pixels from its bottom."""
        self.key, self.scale, self.values, self.degree, self.place = key, scale, values, 3, place
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
    return root.name_full if root is not None and scene in root.users_scene else ""


def edge_of(settings):
    """The wipe's edge, from -1 to 1 across a view."""
    return 2 * settings.wipe - 1


class View:
    def __init__(self):
        self.state = self.frame = None
        self.hidden, self.remark = frozenset(), ""  # what this view leaves out, and what it ignores
        self.job = self.job_key = self.job_scale = self.job_values = self.job_degree = self.job_place = None
        self.requested, self.changed_at, self.requested_degree = None, 0.0, 3
        self.shown = None
        self.budget, self.pace = pace.Budget(), pace.Pace()
        self.error = ""
        self.watch = pace.Stopwatch()
        self.loading = False
        self.unanswered = 0  # redraws that were asked for since the last one
        self.wiped, self.second = "", None  # name of the scene that is drawn right of the wipe's edge, and the View that draws it
        views.add(self)
        start_timer()

    # ---- Requests and jobs ----

    def update(self, depsgraph, space):
        begin = pace.clock()
        self.hidden = gather.hidden_in(space, depsgraph)
        self.wiped = wiped_scene(depsgraph)
        self.state = gather.gather(depsgraph, self.hidden, without=self.wiped)
        if self.wiped:
            self.second = self.second or View()
            self.second.state = gather.gather(depsgraph, self.hidden, only=self.wiped)
        elif self.second is not None:
            self.second.drop()
            self.second = None
        self.watch.gather(begin)

    def stale(self, depsgraph, space):
        """Whether an update is due without a change of the file's data: local view has begun or ended, another scene is wiped."""
        return self.wiped != wiped_scene(depsgraph) or self.hidden != gather.hidden_in(space, depsgraph)

    def request(self, context, depsgraph, window, outputs, transparent):
        """A request: key and arguments of a job at full resolution, or None where there is nothing to draw. window: x, y, width and height of what is
        drawn of the region, in pixels from its top."""
        space, width, height = context.space_data, context.region.width, context.region.height
        if self.state is None:
            self.clear()
            self.error = "no PAGS scene is visible here"
            if not any(o.pags.kind == "ROOT" for o in bpy.data.objects):
                self.error = "there is no PAGS scene: File > Import > PAGS scene"
            return None
        self.frame = frame = self.state.load(False)
        self.loading = frame is None or self.state.making()
        if frame is None:
            self.error = f"loading {', '.join(scene.path for scene in self.state.scenes)} ..."
            return None
        region = context.region_data
        settings = depsgraph.scene.pags
        values, pose = lens.of_view(region.window_matrix, region.view_matrix, width, height)
        now = depsgraph.scene.frame_current_final
        camera = frame.camera(values, pose, now)
        job_arguments = gather.job_arguments(settings, frame, False)
        clips = frame.clips(lens.clip_planes(space, region, values, pose, depsgraph.scene.camera))
        job_arguments.update(outputs=outputs, transparent=transparent, clips=clips, window=window)
        if region.view_perspective == "CAMERA":
            job_arguments.update(frame.exposure(settings, depsgraph.scene.camera, now))
        key = (tuple(camera["world_from_camera"]), camera["fx"], camera["cx"], camera["cy"], now, width, height)
        key += (native.generation, tuple(map(id, frame.entries)), self.state.key(), settings.hide_noncritical, tuple(sorted(job_arguments.items())))
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
        x, y, width, height = job_arguments["window"]
        x0, y0 = int(x * across), int(y * down)
        x1, y1 = min(small["width"], math.ceil((x + width) * across)), min(small["height"], math.ceil((y + height) * down))
        window = (x0, y0, max(1, x1 - x0), max(1, y1 - y0))
        left, right = round(x0 / across), round((x0 + window[2]) / across)
        top, bottom = round(y0 / down), round((y0 + window[3]) / down)
        self.job_place = (left, camera["height"] - bottom, right - left, bottom - top)
        job_arguments = dict(job_arguments, window=window, sh_degree=min(degree, job_arguments["sh_degree"]), cut=pace.CUTS[scale])
        self.job = native.renderer("view", settings.threads).submit(
            frame.entry.scene, small, **frame.contents_at(now, settings.hide_noncritical), **job_arguments
        )
        self.job_key, self.job_scale, self.job_values, self.job_degree = key, scale, values, degree

    def advance(self, requested):
        """Takes a finished picture and submits the next job; returns the milliseconds of the upload to the GPU."""
        self.unanswered = 0
        views.add(self)
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
            size = requested[4]["window"][2:]
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
        self.shown = Shown(self.job_key, self.job_scale, picture, self.job_values, self.job_place)
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
        text = self.dropped(settings) if self.shown.unsharp or self.frame is None else self.frame.counts(self.shown.stats)
        if self.rate() > 0:
            text += f", {self.rate():.1f} FPS"
        said = "" if self.shown.unsharp or self.frame is None else self.frame.remarks(settings)
        return "; ".join(filter(None, (text, said, self.remark)))

    def dropped(self, settings):
        """How the picture was reduced to keep the deadline: size and SH degree."""
        less_colour = f", SH degree {self.shown.degree}" if self.shown.degree < settings.sh_degree else ""
        return f"1/{self.shown.scale:g} size{less_colour}"

    # ---- Drawing ----

    def draw_rendered(self, engine, context, depsgraph):
        begin = pace.clock()
        try:
            if self.stale(depsgraph, context.space_data):
                self.update(depsgraph, context.space_data)
            window = border_window(context)
            requested = self.request(context, depsgraph, window, ("rgba",), False)
            self.remark = ignored.of_view(context, self.state) if self.state is not None else ""
            upload = self.advance(requested)
            if self.second is not None:
                upload += self.second.advance(self.second.request(context, depsgraph, window, ("rgba",), False))
        except (SceneError, RuntimeError, ValueError) as error:
            self.error, upload = str(error), 0.0
        engine.update_stats("", self.statistics(depsgraph.scene.pags))
        middle = pace.clock()
        edge = edge_of(depsgraph.scene.pags) if self.second is not None else 1
        if self.shown is not None:
            self.put_plain(-1, edge)
        if self.second is not None and self.second.shown is not None:
            self.second.put_plain(edge + 4 / context.region.width, 1)  # a gap of two pixels is the edge
        self.watch.add(begin, middle, upload)

    def put_plain(self, left, right):
        shader = draw.shader("plain")
        gpu.state.depth_test_set("NONE")
        gpu.state.depth_mask_set(False)
        gpu.state.blend_set("NONE")
        whole = gpu.state.viewport_get()
        x, y, width, height = self.shown.place
        gpu.state.viewport_set(whole[0] + x, whole[1] + y, width, height)
        shader.bind()
        shader.uniform_sampler("picture", self.shown.color)
        # From the region's width to the picture's, -1 to 1 both.
        left, right = (min(max(((u + 1) * whole[2] - 2 * x) / width - 1, -1), 1) for u in (left, right))
        if left < right:
            draw.part("plain", left, right).draw(shader)
        gpu.state.viewport_set(*whole)

    def clear(self):
        if self.job is not None:
            self.job.cancel()
        self.job = self.shown = None

    def drop(self):
        self.clear()
        if self.second is not None:
            self.second.drop()


def border_window(context):
    """What a Rendered view draws of its region, (x, y, width, height) in pixels from the top: all, or what its render border or its camera's
    encloses."""
    space, view, render = context.space_data, context.region_data, context.scene.render
    width, height = context.region.width, context.region.height
    if view.view_perspective == "CAMERA" and context.scene.camera is not None and context.scene.camera.type == "CAMERA":
        if not render.use_border:
            return 0, 0, width, height
        left, top, wide, tall = lens.camera_frame(context.scene.camera, render, view, width, height)
        xs = left + wide * render.border_min_x, left + wide * render.border_max_x
        ys = top + tall * (1 - render.border_max_y), top + tall * (1 - render.border_min_y)
    elif space.use_render_border:
        xs = width * space.render_border_min_x, width * space.render_border_max_x
        ys = height * (1 - space.render_border_max_y), height * (1 - space.render_border_min_y)
    else:
        return 0, 0, width, height
    x0, y0 = (min(max(round(v), 0), most - 1) for v, most in ((xs[0], width), (ys[0], height)))
    x1, y1 = (min(max(round(v), low + 1), most) for v, low, most in ((xs[1], x0, width), (ys[1], y0, height)))
    return x0, y0, x1 - x0, y1 - y0


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
        for view in busy:
            view.unanswered += 1
            if view.unanswered > UNANSWERED:
                view.drop()
                views.discard(view)
    return TICK if busy else 0.05


def start_timer():
    if not bpy.app.background and not bpy.app.timers.is_registered(tick):
        bpy.app.timers.register(tick, persistent=True)


def stop_timer():
    if bpy.app.timers.is_registered(tick):
        bpy.app.timers.unregister(tick)
    for view in list(views):
        view.drop()
