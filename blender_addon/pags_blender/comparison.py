# SPDX-License-Identifier: GPL-3.0-or-later
"""Compares the recording's photographs with rendered pictures in the 3D view through a recorded camera (wipe, difference or SSIM), and lists all photographs
by PSNR, worst first.

The comparison uses the scene as trained, without edits from Blender, with the exposure found in training. A job of its own, driven by a timer, makes the pair
in the background once the view has rested on a photograph, and keeps it on the GPU."""

import json
import os
import tempfile
import time

import bpy
import gpu
import numpy as np
from bpy.props import BoolProperty, CollectionProperty, FloatProperty, IntProperty, StringProperty

from . import cameras, draw, inspector, jobs, lens, native, photographs, program, registry, whereabouts

REST = 0.15  # seconds that the view must rest on a photograph before the comparison starts
TICK = 0.02
MOST = 3  # cached pairs: some 60 MB each at 1920 x 1280
GAIN = 4  # gain of the difference view
ORDER = ("WIPE", "DIFFERENCE", "SSIM")  # numbers of the modes in the shader

_pairs = {}  # by (entry, data set folder as set by the user, name of the view): Pair, or an error text
_wanted, _since, _job, _job_key = None, 0.0, None, None
_filling = False


# ---- Figures ----


def ssim_map(a, b):
    """SSIM per pixel, mean of the channels, as in `pags eval`: Wang et al. 2004, window of 11 x 11, sigma 1.5, zeros beyond the border."""
    window = np.exp(-0.5 * ((np.arange(11) - 5) / 1.5) ** 2)
    window = (window / window.sum()).astype(np.float32)

    def blur(picture):
        for axis in range(2):
            size = picture.shape[axis]
            wide = np.pad(picture, [(5, 5) if k == axis else (0, 0) for k in range(3)])
            shifted = (wide[i : i + size] if axis == 0 else wide[:, i : i + size] for i in range(11))
            picture = sum(weight * part for weight, part in zip(window, shifted))
        return picture

    a, b = np.clip(a, 0, 1), np.clip(b, 0, 1)
    mean_a, mean_b = blur(a), blur(b)
    var_a, var_b, both = blur(a * a) - mean_a**2, blur(b * b) - mean_b**2, blur(a * b) - mean_a * mean_b
    c1, c2 = 0.01**2, 0.03**2
    return ((2 * mean_a * mean_b + c1) * (2 * both + c2) / ((mean_a**2 + mean_b**2 + c1) * (var_a + var_b + c2))).mean(
        axis=2
    )


class Pair:
    """A photograph and its rendered picture, arrays (height, width, 3), display-referred; `ssim` (height, width) is computed on demand."""

    def __init__(self, view, photograph, picture, psnr):
        self.view, self.photograph, self.picture, self.psnr = view, photograph, picture, psnr
        self.ssim = self.mean_ssim = None
        self.textures = {}

    def line(self):
        said = f"{self.view['name']}{' (held out)' if self.view['test'] else ''}: PSNR {self.psnr:.2f} dB"
        return said if self.ssim is None else f"{said}, SSIM {self.mean_ssim:.3f}"

    def texture(self, name):
        """One plane of the pair as a GPU texture."""
        if name not in self.textures:
            plane = getattr(self, name)[::-1]
            height, width = plane.shape[:2]
            rgba = np.ones((height, width, 4), dtype=np.float32)
            rgba[..., :3] = plane if plane.ndim == 3 else plane[..., None]
            self.textures[name] = draw.texture(rgba, width, height, 4)
        return self.textures[name]


def make(job, root, entry, view, threads):
    """Steps that make a Pair."""
    photograph = yield from photographs.load(job, root, entry, view)
    picture, value = yield jobs.in_thread(inspector.measure, entry, view, threads, True, photograph)
    return Pair(view, photograph, picture, value)


def add_ssim(job, pair):
    """Steps that add SSIM to a Pair and return it."""
    pair.ssim = yield jobs.in_thread(ssim_map, pair.photograph, pair.picture)
    pair.mean_ssim = float(pair.ssim.mean())
    return pair


# ---- What the view shows ----


def current(context):
    """The photograph that a 3D view looks at: (root, entry, view of the scene), or a text with the reason without one."""
    camera, scene = context.scene.camera, context.scene
    root = camera.pags.root if camera is not None and camera.pags.kind == "CAMERA" else None
    if root is None or context.region_data.view_perspective != "CAMERA":
        return "comparison: look through a camera of the recording (sidebar > PAGS > Cameras > Nearest)"
    entry = native.entry(whereabouts.absolute_path(root), False)
    if entry.scene is None:
        return "loading ..."
    sensor = camera.data.pags.sensor
    own = lambda v: v["sensor"] == sensor and "time" in v if sensor >= 0 else v["name"] == camera.get("pags_view")
    group = [v for v in entry.views if own(v)]
    if not group:
        return f"comparison: the scene has no photographs of {camera.name}"
    if sensor < 0:
        return root, entry, group[0]
    now = entry.time_of(root, scene.frame_current_final)
    view = min(group, key=lambda v: abs(v["time"] - now))
    if abs(view["time"] - now) * root.pags.fps > 0.5 + 1e-3:
        return "comparison: no photograph at this frame (sidebar > PAGS > Cameras > Nearest goes to one)"
    return root, entry, view


def pair_of(context):
    """The Pair for the view, or a text: an error, or that the pair is being made. Requests the pair if missing."""
    global _wanted, _since
    found = current(context)
    if isinstance(found, str):
        return found
    root, entry, view = found
    key, mode = (entry, root.pags.dataset, view["name"]), context.scene.pags.comparison
    pair = _pairs.get(key)
    if isinstance(pair, str) or (pair is not None and (mode != "SSIM" or pair.ssim is not None)):
        return pair
    if _job is not None and _job_key == key:
        return f"comparing {view['name']} ..."
    if _wanted is None or _wanted[0] != (key, pair is not None):
        threads = context.scene.pags.threads
        steps = lambda job: make(job, root, entry, view, threads) if pair is None else add_ssim(job, pair)
        _wanted, _since = ((key, pair is not None), steps), time.monotonic()
    registry.start(tick, TICK)
    return f"comparing {view['name']} ..."


def tick():
    """Makes the pair that was requested last."""
    global _wanted, _job, _job_key
    if _job is None:
        if _wanted is None:
            return None
        if time.monotonic() - _since < REST:
            return TICK
        (_job_key, _), steps = _wanted
        _job, _wanted = jobs.Job("comparison", steps), None
    try:
        if not _job.step():
            return TICK
        made = _job.notice
    except jobs.ERRORS as error:
        made = f"comparison: {error}"
    except ReferenceError:  # the scene has been deleted meanwhile
        made = None
    except BaseException:
        _job = None
        raise
    _job = None
    if made is not None:
        _pairs.pop(_job_key, None)
        _pairs[_job_key] = made
        for key in list(_pairs)[:-MOST]:
            del _pairs[key]
    draw.again()
    return TICK


def forget():
    global _wanted, _job
    _wanted = None
    _pairs.clear()
    if _job is not None:
        _job.abort()
        _job = None


# ---- Drawing ----

VERTEX = "void main() { uv = 0.5 * at + 0.5; gl_Position = vec4(mix(place.xy, place.zw, uv), 0.0, 1.0); }"
# `how`: number in ORDER, edge of the wipe, width of a pixel of the screen in the picture's widths, gain of differences.
# The view's frame buffer encodes linear light, as it does for overlay.py.
FRAGMENT = """
vec3 light(vec3 c) {
  c = clamp(c, 0.0, 1.0);
  return mix(c / 12.92, pow((c + 0.055) / 1.055, vec3(2.4)), step(vec3(0.04045), c));
}
vec3 heat(float v) {
  v = clamp(v, 0.0, 1.0) * 4.0;
  vec3 c = mix(vec3(0.0, 0.0, 0.05), vec3(0.35, 0.05, 0.45), clamp(v, 0.0, 1.0));
  c = mix(c, vec3(0.85, 0.20, 0.25), clamp(v - 1.0, 0.0, 1.0));
  c = mix(c, vec3(0.98, 0.65, 0.10), clamp(v - 2.0, 0.0, 1.0));
  return mix(c, vec3(1.0, 1.0, 0.75), clamp(v - 3.0, 0.0, 1.0));
}
void main() {
  vec3 a = texture(first, uv).rgb, b = texture(second, uv).rgb;
  vec3 shown = uv.x < how.y ? a : b;
  if (how.x < 0.5 && abs(uv.x - how.y) < how.z) {
    shown = vec3(1.0);
  }
  if (how.x > 0.5) {
    shown = how.x < 1.5 ? how.w * abs(a - b) : heat(1.0 - a.r);
  }
  color = vec4(light(shown), 1.0);
}
"""
_made = {}


def shader():
    if "shader" not in _made:
        constants, pictures = [("VEC4", "place"), ("VEC4", "how")], ["first", "second"]
        _made["shader"] = draw.compiled("comparison", VERTEX, FRAGMENT, draw.AT, draw.UV, constants, pictures)
        _made["quad"] = draw.rectangle(_made["shader"], -1, 1)
    return _made["shader"]


def place_of(context, view):
    """Place of a view's photograph in a region that looks through its camera: left, bottom, right, top in normalised device coordinates."""
    region, rv3d = context.region, context.region_data
    values, _ = lens.of_view(rv3d.window_matrix, rv3d.view_matrix, region.width, region.height)
    x = [values["fx"] * (u - view["cx"]) / view["fx"] + values["cx"] for u in (0, view["width"])]
    y = [values["fy"] * (v - view["cy"]) / view["fy"] + values["cy"] for v in (view["height"], 0)]
    return [
        f(k) for k in (0, 1) for f in (lambda k: 2 * x[k] / region.width - 1, lambda k: 1 - 2 * y[k] / region.height)
    ]


def on_draw():
    context = bpy.context
    settings, region = context.scene.pags, context.region
    if settings.comparison == "NONE" or context.region_data is None:
        return
    if not any(o.pags.kind == "ROOT" for o in context.scene.objects):
        return
    try:
        pair = pair_of(context)
    except native.SceneError as error:
        pair = str(error)
    if isinstance(pair, str):
        draw.text(context, 0.5, 0.1, pair)
        return
    names = ("ssim", "ssim") if settings.comparison == "SSIM" else ("photograph", "picture")
    textures = [pair.texture(name) for name in names]
    place = place_of(context, pair.view)
    program_ = shader()
    gpu.state.depth_test_set("NONE")
    gpu.state.blend_set("NONE")
    program_.bind()
    program_.uniform_sampler("first", textures[0])
    program_.uniform_sampler("second", textures[1])
    program_.uniform_float("place", place)
    width = max(1.0, 0.5 * (place[2] - place[0]) * region.width)
    program_.uniform_float("how", (ORDER.index(settings.comparison), settings.wipe, 1 / width, GAIN))
    _made["quad"].draw(program_)
    legend = {
        "WIPE": "left: photograph, right: rendered picture",
        "DIFFERENCE": f"difference, {GAIN} times amplified",
        "SSIM": "SSIM from dark (1, equal) to light (0)",
    }
    said = f"{pair.line()}; {legend[settings.comparison]}"
    draw.text(context, 0.5 + 0.25 * (place[0] + place[2]), 0.5 + 0.5 * place[1], said)


# ---- The list ----


def go(scene, context):
    """Go to the camera and time of a row in the list"""
    items = scene.pags_photographs
    if _filling or not 0 <= scene.pags_photograph < len(items):
        return
    item = items[scene.pags_photograph]
    root, scene.pags_photographs_said = bpy.data.objects.get(item.root), ""
    try:
        if root is None:
            raise native.SceneError(f"the scene {item.root} no longer exists; make the list again")
        frame = cameras.Frame(context, root)
        view = next((v for v in frame.scene.views if v["name"] == item.view), None)
        if view is None:
            raise native.SceneError(f"the scene no longer has the photograph {item.view}; make the list again")
        cameras.go_to(context, frame, view)
        index = next((i for i, o in enumerate(frame.entry.objects) if o["id"] == item.object), None)
        if index is not None:
            inspector.select(context, {"object": index, "root": root.name_full})
    except native.SceneError as error:
        scene.pags_photographs_said = str(error)


class PagsPhotograph(bpy.types.PropertyGroup):
    kind: StringProperty(name="Kind", description="Kind of row, as in the choice above the list")
    root: StringProperty(name="Scene", description="Name of the scene's root Empty")
    view: StringProperty(name="Photograph", description="File name of the photograph to go to")
    object: StringProperty(name="Object", description="Id of the object to select")
    psnr: FloatProperty(name="PSNR", description="PSNR in dB; of a gap its length in seconds")
    test: BoolProperty(name="Held out", description="Held out from training")


ICONS = {"PHOTOGRAPH": "IMAGE_DATA", "CAMERA": "CAMERA_DATA", "OBJECT": "OBJECT_DATA", "GAP": "TIME"}


class PAGS_UL_photographs(bpy.types.UIList):
    bl_idname = "PAGS_UL_photographs"

    def draw_item(self, context, layout, data, item, icon, active_data, active_property):
        row = layout.split(factor=0.68)
        row.label(text=item.name, icon="HIDE_ON" if item.test else ICONS[item.kind])
        row.label(text=f"{item.psnr:.1f} {'s' if item.kind == 'GAP' else 'dB'}")

    def filter_items(self, context, data, member):
        listed = context.scene.pags.listed
        return [self.bitflag_filter_item if item.kind == listed else 0 for item in getattr(data, member)], []


class PAGS_OT_rank(jobs.Long, cameras.OnScene, bpy.types.Operator):
    """Compare all photographs as "pags eval" does, and list photographs, cameras, objects and gaps of tracks, worst first"""

    bl_idname = "pags.rank"
    bl_label = "List errors"

    def steps(self, context, root):
        command, path = program.command(context), whereabouts.absolute_path(root)

        def work(job):
            entry = yield jobs.in_thread(native.load, path)
            if not entry.scene.views:
                raise native.SceneError("the scene has no photographs")
            photographs.find(root, entry, entry.scene.views[0]["name"])  # its error names the searched folders
            photographs.tell(job, root, entry)
            given = photographs.moved(root, entry)
            with tempfile.TemporaryDirectory(prefix="pags-list-") as folder:
                target = os.path.join(folder, "eval.json")
                words = ("eval", path, "--json", target, *(("--dataset", given) if given else ()))
                yield jobs.in_thread(program.run, job, command, *words)
                with open(target, encoding="utf-8") as file:
                    figures = json.load(file)
            job.changes = True
            return fill(bpy.context.scene, root, rows_of(entry, figures))

        return work


def rows_of(entry, figures):
    """Rows of the list, as dictionaries of PagsPhotograph's members, worst first within each kind."""
    sensors, by_sensor, rows = {v["name"]: v["sensor"] for v in entry.views}, {}, []
    for split in ("train", "test"):
        for view in figures[split]["per_view"]:
            name, psnr = view["name"], view["psnr"] if view["psnr"] is not None else 99.0  # equal bits
            rows.append({"kind": "PHOTOGRAPH", "name": name, "view": name, "psnr": psnr, "test": split == "test"})
            by_sensor.setdefault(sensors.get(name, -1), []).append((psnr, name))
    for sensor, found in by_sensor.items() if len(by_sensor) > 1 else ():
        mean = sum(psnr for psnr, _ in found) / len(found)
        rows.append({"kind": "CAMERA", "name": f"camera {sensor}", "view": min(found)[1], "psnr": mean})
    for found in figures.get("objects", ()):  # programs before 0.3 list none
        worst = {"view": found["worst_view"], "object": found["id"], "psnr": found["psnr"]}
        rows.append({"kind": "OBJECT", "name": found["id"], **worst})
    rows += gaps_of(entry)
    order, worse = list(ICONS), lambda r: -r["psnr"] if r["kind"] == "GAP" else r["psnr"]
    return sorted(rows, key=lambda r: (order.index(r["kind"]), worse(r), r["name"]))


def gaps_of(entry):
    """Rows of the times between keyframes of a track that are far longer than its recording's time step."""
    views, rows = [v for v in entry.views if "time" in v], []
    if not views:
        return rows
    times = np.unique([v["time"] for v in views])
    step = float(np.median(np.diff(times))) if len(times) > 1 else np.inf
    for index, record in enumerate(entry.objects):
        if not record["tracked"]:
            continue
        own = entry.track(index)[0]
        for begin, length in zip(own[:-1], np.diff(own)):
            if length > 1.5 * step:
                view = min(views, key=lambda v: (abs(v["time"] - begin - length / 2), v["sensor"]))
                row = {"view": view["name"], "object": record["id"], "psnr": float(length)}
                rows.append({"kind": "GAP", "name": record["id"], **row})
    return rows


def fill(scene, root, rows):
    """Fills the list; returns the message to report."""
    global _filling
    scene.pags_photographs.clear()
    scene.pags_photographs_said = ""
    for row in rows:
        item = scene.pags_photographs.add()
        item.root = root.name
        for name, value in row.items():
            setattr(item, name, value)
    _filling = True  # select no row, so that the view does not jump
    scene.pags_photograph = -1
    _filling = False
    found = [row for row in rows if row["kind"] == "PHOTOGRAPH"]
    return f"{len(found)} photographs; lowest PSNR: {found[0]['name']}, {found[0]['psnr']:.2f} dB"


ROWS = CollectionProperty(type=PagsPhotograph, name="Photographs", description="Worst first")
ROW = IntProperty(name="Row", description="Selected row; a click goes to its camera and time", default=-1, update=go)
SAID = StringProperty(name="Message", description="Why the selected photograph could not be shown")
PROPERTIES = (
    (bpy.types.Scene, "pags_photographs", ROWS),
    (bpy.types.Scene, "pags_photograph", ROW),
    (bpy.types.Scene, "pags_photographs_said", SAID),
)
DRAWN = ((on_draw, "POST_PIXEL"),)
TIMERS = (tick,)


def on_unregister():
    forget()
    _made.clear()
