# SPDX-License-Identifier: GPL-3.0-or-later
"""The picture of a 3D view: coarse while something moves, full resolution at rest; drawing never waits for it.

Each redraw of a view makes a request (a key and the job's arguments). At most one job per view runs at a time. After a change of the request, the next job
keeps the deadline: the engine's controller reduces quality. After a pause without change, a job renders at full quality; a new request cancels it. A timer
polls for finished jobs and redraws their views."""

import time
import weakref

import bpy
import gpu

from . import draw, gather, ignored, lens, meshes, native, registry, stopwatch
from .native import SceneError

STILL = 0.12  # seconds without change before the picture of full quality is rendered
TICK = 0.008
PERIOD = 95  # milliseconds per picture as the target: a little more than ten pictures per second
UNANSWERED = 50  # redraw requests until a view counts as closed: Blender 5 keeps a view's engine after its region

EMPTY = 1e9  # depth of pixels without a surface

views = weakref.WeakSet()


class Shown:
    """A picture on the GPU with the request that it answers."""

    def __init__(self, key, unsharp, picture, values):
        """unsharp: rendered within the deadline, so that one of full quality has to follow."""
        self.key, self.unsharp, self.values = key, unsharp, values
        self.stats = picture.stats
        self.size = (picture.width, picture.height)
        x, y, width, height = picture.place
        self.place = (x, values["height"] - y - height, width, height)  # in the region, in pixels from its bottom
        begin = time.perf_counter()
        self.color = draw.texture(picture.rgba, picture.width, picture.height, 4)
        self.depth = None
        if picture.depth is not None:
            self.depth = draw.texture(picture.depth, picture.width, picture.height, 1)
        self.ms_upload = 1e3 * (time.perf_counter() - begin)


def wiped_scene(depsgraph):
    """Name of the root right of the wipe's edge, or ""."""
    scene = depsgraph.scene.original
    root = scene.pags.wipe_root
    return root.name_full if root is not None and scene in root.users_scene else ""


def edge_of(settings):
    """The wipe's edge, from -1 to 1 across a view."""
    return 2 * settings.wipe - 1


class View:
    def __init__(self):
        self.state = self.frame = None
        self.hidden, self.remark = frozenset(), ""  # objects hidden in this view, and settings that it ignores
        self.job = self.job_key = self.job_values = self.job_unsharp = None
        self.requested, self.changed_at = None, 0.0
        self.shown = None
        self.deadline, self.came = None, -1e9  # the engine's controller; time of its last picture
        self.error = ""
        self.watch = stopwatch.Stopwatch()
        self.loading = False
        self.unanswered = 0  # requested redraws since the last one
        self.among = False  # whether Blender draws its meshes in this view; otherwise they are drawn here
        self.meshes = []
        self.wiped, self.second = "", None  # name of the scene right of the wipe's edge, and the View that draws it
        views.add(self)
        start_timer()

    # ---- Requests and jobs ----

    def update(self, depsgraph, space):
        begin = stopwatch.clock()
        self.hidden = gather.hidden_in(space, depsgraph)
        self.wiped = wiped_scene(depsgraph)
        self.state = gather.gather(depsgraph, self.hidden, without=self.wiped)
        self.meshes = meshes.collect(depsgraph, self.hidden) if not self.among and self.state is not None else []
        if self.wiped:
            self.second = self.second or View()
            self.second.state = gather.gather(depsgraph, self.hidden, only=self.wiped)
        elif self.second is not None:
            self.second.drop()
            self.second = None
        self.watch.gather(begin)

    def stale(self, depsgraph, space):
        """Whether an update is due without a change of the file's data: local view began or ended, or another scene is wiped."""
        return self.wiped != wiped_scene(depsgraph) or self.hidden != gather.hidden_in(space, depsgraph)

    def request(self, context, depsgraph, window, outputs, transparent):
        """A request (key and arguments of a job), or None if there is nothing to draw. window: x, y, width and height of the drawn part of the region, in
        pixels from its top."""
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
        job_arguments.update(depth_empty=EMPTY, depth_alpha=0.5)
        if region.view_perspective == "CAMERA":
            job_arguments.update(frame.exposure(settings, depsgraph.scene.camera, now))
        key = (tuple(camera["world_from_camera"]), camera["fx"], camera["cx"], camera["cy"], now, width, height)
        key += (native.generation, tuple(map(id, frame.entries)), self.state.key(), settings.hide_noncritical)
        key += (tuple(sorted(job_arguments.items())),)
        self.error = ""
        return key, frame, camera, values, job_arguments, settings, now

    def submit(self, requested, unsharp):
        key, frame, camera, values, job_arguments, settings, now = requested
        self.deadline = self.deadline or native.module.Deadline(settings.deadline)
        self.deadline.ms = settings.deadline
        self.job = native.renderer("view", settings.threads).submit(
            frame.entry.scene,
            camera,
            deadline=self.deadline if unsharp else None,
            **frame.contents_at(now, settings.hide_noncritical),
            **job_arguments,
        )
        self.job_key, self.job_values, self.job_unsharp = key, {**values, "height": camera["height"]}, unsharp

    def advance(self, requested):
        """Takes a finished picture and submits the next job; returns the milliseconds of the upload to the GPU."""
        self.unanswered = 0
        views.add(self)
        upload = self.collect()
        if requested is None:
            return upload
        key, now = requested[0], time.monotonic()
        if key != self.requested:
            self.requested, self.changed_at = key, now
        if self.job is not None:
            if self.job_key != key and not self.job_unsharp and now - self.changed_at < STILL:
                self.job.cancel()
            return upload
        if self.shown is None or self.shown.key != key:
            self.submit(requested, True)
        elif self.shown.unsharp and now - self.changed_at >= STILL:
            self.submit(requested, False)
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
        self.shown = Shown(self.job_key, self.job_unsharp, picture, self.job_values)
        self.watch.add_picture(self.shown)
        if self.shown.unsharp:
            now = time.monotonic()
            self.deadline.pace(1e3 * (now - self.came), PERIOD)
            self.came = now
        return self.shown.ms_upload

    def restless(self):
        """Whether the timer has to watch this view: it loads, renders, or shows a picture that is not final."""
        if self.loading or self.job is not None:
            return True
        if self.shown is None or self.requested is None:
            return False
        return self.shown.key != self.requested or self.shown.unsharp

    # ---- Statistics ----

    def rate(self):
        times = [picture[0] for picture in self.watch.pictures[-100:] if picture[0] > time.monotonic() - 2]
        return (len(times) - 1) / (times[-1] - times[0]) if len(times) > 1 and times[-1] > times[0] else 0.0

    def statistics(self, settings):
        """The text over the view. During movement only the reductions: without a graphics card sixty letters take 10 % of a redraw."""
        if self.error:
            return self.error
        if self.shown is None:
            return "drawing ..."
        text = self.given_up() if self.shown.unsharp or self.frame is None else self.frame.counts(self.shown.stats)
        if self.rate() > 0:
            text += f", {self.rate():.1f} FPS"
        said = "" if self.shown.unsharp or self.frame is None else self.frame.remarks(settings)
        return "; ".join(filter(None, (text, said, self.remark)))

    def given_up(self):
        """The reductions made to keep the deadline, in a few words."""
        stats = self.shown.stats
        if stats["divisor"] > 1:
            return f"1/{stats['divisor']:g} size"
        return "the rest at 1/4 size" if stats["sampled"] else f"moving, step {stats['step']}"

    # ---- Drawing ----

    def draw_rendered(self, engine, context, depsgraph):
        begin = stopwatch.clock()
        try:
            if self.stale(depsgraph, context.space_data):
                self.update(depsgraph, context.space_data)
            window = border_window(context)
            outputs = ("rgba", "depth") if self.meshes else ("rgba",)
            requested = self.request(context, depsgraph, window, outputs, False)
            self.remark = ignored.of_view(context, self.state) if self.state is not None else ""
            upload = self.advance(requested)
            if self.second is not None:
                upload += self.second.advance(self.second.request(context, depsgraph, window, outputs, False))
        except (SceneError, RuntimeError, ValueError) as error:
            self.error, upload = str(error), 0.0
        engine.update_stats("", self.statistics(depsgraph.scene.pags))
        middle = stopwatch.clock()
        edge = edge_of(depsgraph.scene.pags) if self.second is not None else 1
        if self.shown is not None:
            self.put(context, -1, edge)
        if self.second is not None and self.second.shown is not None:
            self.second.put(context, edge + 4 / context.region.width, 1)  # a gap of two pixels is the edge
        if self.meshes and self.shown is not None and self.shown.depth is not None:
            meshes.show(context, self.meshes)
        self.watch.add(begin, middle, upload)

    def put(self, context, left, right):
        """Draws the picture between two columns of the region, -1 to 1, with its depth if it has one."""
        shown, name = self.shown, "depth" if self.shown.depth is not None else "plain"
        shader = draw.shader(name)
        gpu.state.depth_test_set("ALWAYS" if shown.depth is not None else "NONE")
        gpu.state.depth_mask_set(shown.depth is not None)
        gpu.state.blend_set("NONE")
        whole = gpu.state.viewport_get()
        x, y, width, height = shown.place
        gpu.state.viewport_set(whole[0] + x, whole[1] + y, width, height)
        shader.bind()
        draw.bind_picture(shader, shown, context.region_data.window_matrix)
        # from the region's width to the picture's, both -1 to 1
        left, right = (min(max(((u + 1) * whole[2] - 2 * x) / width - 1, -1), 1) for u in (left, right))
        if left < right:
            draw.part(name, left, right).draw(shader)
        gpu.state.viewport_set(*whole)
        gpu.state.depth_mask_set(False)
        gpu.state.depth_test_set("NONE")

    def clear(self):
        if self.job is not None:
            self.job.cancel()
        self.job = self.shown = None

    def drop(self):
        self.clear()
        if self.second is not None:
            self.second.drop()


def border_window(context):
    """The part of its region that a Rendered view draws, (x, y, width, height) in pixels from the top: all, or its render border or camera frame."""
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
        draw.again()
        for view in busy:
            view.unanswered += 1
            if view.unanswered > UNANSWERED:
                view.drop()
                views.discard(view)
    return TICK if busy else 0.05


def start_timer():
    registry.start(tick, persistent=True)


def stop_timer():
    registry.stop(tick)
    for view in list(views):
        view.drop()
