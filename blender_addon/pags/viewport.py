# SPDX-License-Identifier: GPL-3.0-or-later
"""A 3D view's picture: coarse while something moves, sharp when all is still, never waited for.

Each view asks for what it wants (a key and the job's arguments) whenever it is drawn. At most one job of a view is under
way. Where what is wanted has changed, the next job is one that keeps the deadline; when nothing has changed for a
moment, a sharp one, which is broken off as soon as something changes again. A timer looks for finished jobs and has the views drawn."""

import time
import weakref

import bpy
import gpu

from . import draw, gather, lens, native
from .native import SceneError

# What the picture's sides are divided by, and under which opacity times area, in pixels of that picture, Gaussians that aren't critical
# are left out: as pags render --budget-ms does it.
CUTS = {1.0: 0.0, 1.5: 0.25, 2.0: 0.25, 3.0: 0.5, 4.0: 0.75, 6.0: 1.0, 8.0: 1.0}
STILL = 0.12  # seconds without change before the sharp picture is drawn
TICK = 0.008

views = weakref.WeakSet()


class Budget:
    """How long pictures take, from those that were drawn: what goes by pixels and what doesn't, by SH degree or without."""

    def __init__(self):
        self.fixed, self.pixels, self.known = 0.0, 0.0, False

    def learn(self, stats, width, height):
        size = width * height / 1e6
        raster = stats["ms_raster"] + max(0.0, stats["ms_job"] - stats["ms"])
        fixed = stats["ms_job"] - raster
        keep = 0.5 if self.known else 0.0
        self.fixed = keep * self.fixed + (1 - keep) * fixed
        self.pixels = keep * self.pixels + (1 - keep) * raster / max(size, 1e-3)
        self.known = True

    def choose(self, width, height, deadline):
        """The finest scale that keeps the deadline, and whether any does; before anything is known a coarse one."""
        if not self.known:
            return 4.0, True
        for scale in CUTS:
            if self.fixed + self.pixels * width * height / 1e6 / (scale * scale) <= deadline:
                return scale, True
        return max(CUTS), False


class Pace:
    """The share of the deadline that a picture may take, so that ten come in a second: without a graphics card Blender's own drawing takes
    the same processors, and a picture that keeps the deadline comes late all the same."""

    PERIOD = 0.095  # seconds; a little less than a tenth
    PAUSE = 0.5  # a longer one lies between two movements
    LEAST = 0.25
    COARSEST = 4.0  # scale; coarser ones are hardly sooner there

    def __init__(self):
        self.share, self.last = 1.0, -1e9

    def came(self, now):
        """A picture has come while something moves."""
        period, self.last = now - self.last, now
        if self.PERIOD < period < self.PAUSE:
            self.share = max(self.LEAST, 0.93 * self.share)
        elif period < 0.9 * self.PERIOD:
            self.share = min(1.0, 1.05 * self.share)


class Shown:
    """A picture on the GPU and what it shows."""

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


def clock():
    """Milliseconds of the wall's clock and of this thread's processor time: on few processors the former counts other threads', too."""
    return 1e3 * time.perf_counter(), 1e3 * time.thread_time()


class Stopwatch:
    """Milliseconds by part of the redraws, and what pictures came, for the tests and benchmarks. `work` is the processor's time of the parts
    together."""

    MOST = 2000

    def __init__(self):
        self.python, self.upload, self.draw, self.work, self.redraws = [], [], [], [], []
        self.gathered = (0.0, 0.0)  # since the last redraw
        self.pictures = []  # (time, scale, SH degree, statistics of the C module)

    def gather(self, begin):
        """What was done since `begin` belongs to the next redraw."""
        self.gathered = tuple(all_ + end - start for all_, start, end in zip(self.gathered, begin, clock()))

    def add(self, begin, middle, upload):
        """A redraw from `begin` to now; from `middle` on the picture was handed over."""
        end = clock()
        for values, value in (
            (self.python, middle[0] - begin[0] - upload + self.gathered[0]),
            (self.upload, upload),
            (self.draw, end[0] - middle[0]),
            (self.work, end[1] - begin[1] + self.gathered[1]),
            (self.redraws, time.monotonic()),
        ):
            values.append(value)
            del values[: -self.MOST]
        self.gathered = (0.0, 0.0)

    def add_picture(self, shown):
        self.pictures.append((time.monotonic(), shown.scale, shown.degree, shown.stats))
        del self.pictures[: -self.MOST]


class View:
    def __init__(self):
        self.state, self.count = None, 0
        self.job = self.job_key = self.job_scale = self.job_values = self.job_degree = None
        self.wanted, self.changed_at, self.wanted_degree = None, 0.0, 3
        self.shown = None
        self.budget, self.pace = Budget(), Pace()
        self.error = ""
        self.watch = Stopwatch()
        self.loading = False
        views.add(self)
        start_timer()

    # ---- What is wanted ----

    def update(self, depsgraph):
        begin = clock()
        self.state, self.count = gather.gather(depsgraph)
        self.watch.gather(begin)

    def want(self, context, depsgraph, width, height, outputs, transparent):
        """Key and the arguments of a job at full size, or None where there is nothing to draw."""
        if self.state is None:
            self.error = "no PAGS scene is visible: File > Import > PAGS scene"
            return None
        entry = gather.load(self.state, False)
        self.loading = entry.loading
        if entry.loading or entry.scene is None:
            self.error = f"loading {self.state.path} ..."
            return None
        region = context.region_data
        settings = depsgraph.scene.pags
        values, pose = lens.of_view(region.window_matrix, region.view_matrix, width, height)
        now = gather.time_of(self.state, entry, depsgraph.scene.frame_current_final)
        camera = gather.camera_for(self.state, entry, values, pose, now)
        wishes = gather.wishes(settings, self.state, entry, False)
        wishes.update(outputs=outputs, transparent=transparent)
        if region.view_perspective == "CAMERA":
            wishes.update(gather.exposure(settings, entry, depsgraph.scene.camera, now))
        key = (tuple(camera["world_from_camera"]), camera["fx"], camera["cx"], camera["cy"], now, width, height)
        key += (self.state.key(), settings.hide_noncritical, tuple(sorted(wishes.items())))
        self.error = ""
        return key, entry, camera, values, wishes, settings

    def submit(self, wanted, scale, degree):
        key, entry, camera, values, wishes, settings = wanted
        small = dict(camera)
        small["width"], small["height"] = (
            max(1, round(camera["width"] / scale)),
            max(1, round(camera["height"] / scale)),
        )
        across, down = small["width"] / camera["width"], small["height"] / camera["height"]
        small["fx"], small["cx"] = camera["fx"] * across, camera["cx"] * across
        small["fy"], small["cy"] = camera["fy"] * down, camera["cy"] * down
        wishes = dict(wishes, sh_degree=min(degree, wishes["sh_degree"]), cut=CUTS[scale])
        placements = gather.placements(self.state, entry, camera["time"], settings.hide_noncritical)
        self.job = native.renderer("view", settings.threads).submit(entry.scene, small, placements=placements, **wishes)
        self.job_key, self.job_scale, self.job_values, self.job_degree = key, scale, values, degree

    def advance(self, wanted):
        """Takes what is ready and orders what is next; returns milliseconds of upload."""
        upload = self.collect()
        if wanted is None:
            return upload
        key, settings, now = wanted[0], wanted[5], time.monotonic()
        self.wanted_degree = settings.sh_degree
        if key != self.wanted:
            self.wanted, self.changed_at = key, now
        if self.job is not None:
            if self.job_key != key and self.job_scale <= 1.0 and now - self.changed_at < STILL:
                self.job.cancel()
            return upload
        if self.shown is None or self.shown.key != key:
            size = wanted[2]["width"], wanted[2]["height"]
            scale, kept = self.budget.choose(*size, settings.deadline)
            hurried, _ = self.budget.choose(*size, settings.deadline * self.pace.share)
            scale = max(scale, min(hurried, self.pace.COARSEST))
            self.submit(wanted, scale, settings.sh_degree if kept else 0)
        elif self.shown.unsharp and now - self.changed_at >= STILL:
            self.submit(wanted, 1.0, settings.sh_degree)
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
        self.shown.unsharp = self.job_scale > 1.0 or self.job_degree < self.wanted_degree
        self.budget.learn(self.shown.stats, picture.width, picture.height)
        self.watch.add_picture(self.shown)
        if self.shown.unsharp:
            self.pace.came(time.monotonic())
        return self.shown.ms_upload

    def restless(self):
        """Whether the timer has to look after this view."""
        if self.loading or self.job is not None:
            return True
        return (
            self.shown is not None and self.wanted is not None and (self.shown.key != self.wanted or self.shown.unsharp)
        )

    # ---- Statistics ----

    def rate(self):
        times = [picture[0] for picture in self.watch.pictures[-100:] if picture[0] > time.monotonic() - 2]
        return (len(times) - 1) / (times[-1] - times[0]) if len(times) > 1 and times[-1] > times[0] else 0.0

    def statistics(self, settings):
        """While something moves, what was dropped alone: without a graphics card sixty letters take Blender a tenth of a redraw."""
        if self.error:
            return self.error
        if self.shown is None:
            return "drawing ..."
        text = self.dropped(settings) if self.shown.unsharp else self.counts()
        if self.rate() > 0:
            text += f", {self.rate():.1f} FPS"
        if self.count > 1:
            text += f"; {self.count} scenes are visible, {self.state.root_name} alone is drawn"
        if self.state is not None and self.state.scaled:
            text += "; scale is left out"
        return text

    def dropped(self, settings):
        """For the deadline."""
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
        begin = clock()
        width, height = context.region.width, context.region.height
        try:
            wanted = self.want(context, depsgraph, width, height, ("rgba",), False)
            upload = self.advance(wanted)
        except (SceneError, RuntimeError, ValueError) as error:
            self.error, upload = str(error), 0.0
        engine.update_stats("", self.statistics(depsgraph.scene.pags))
        middle = clock()
        if self.shown is not None:
            self.put_plain()
        self.watch.add(begin, middle, upload)

    def put_plain(self):
        shader = draw.shader("plain")
        gpu.state.depth_test_set("NONE")
        gpu.state.depth_mask_set(False)
        gpu.state.blend_set("NONE")
        shader.bind()
        shader.uniform_sampler("picture", self.shown.color)
        draw.quad("plain").draw(shader)

    def drop(self):
        if self.job is not None:
            self.job.cancel()
        self.job = self.shown = None


# ---- The timer ----


def regions():
    for window in bpy.context.window_manager.windows:
        for area in window.screen.areas:
            if area.type == "VIEW_3D":
                for region in area.regions:
                    if region.type == "WINDOW":
                        yield area, region


def tick():
    """Has views drawn whose picture is ready, or whose next one is due."""
    busy = [view for view in views if view.restless()]
    now = time.monotonic()
    due = any(
        (view.job is None or view.job.done())
        and (view.loading is False)
        and (view.job is not None or now - view.changed_at >= STILL)
        for view in busy
    )
    if due or any(view.loading for view in busy):
        for _, region in regions():
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
