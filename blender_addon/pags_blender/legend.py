# SPDX-License-Identifier: GPL-3.0-or-later
"""Draws a legend for all modes of *Show* except colour: a bar of the picture's colours with numbers and units, at the lower edge of each 3D view in such a
mode."""

import math

import blf
import bpy

from . import draw, native, overlay

COUNTS = [(v, str(v)) for v in (1, 10, 100, 1000)]
# For each mode: title, ends of the scale (logarithmic from the first, unless that is 0), whether the low end is light, and the labelled
# values, as in `mode_color` in blender_addon/native/picture.c.
SCALES = {
    "priority": ("Semantic priority", (0, 1), False, [(v / 4, f"{v / 4:g}") for v in range(5)]),
    "depth": ("Depth, metres", (1, 200), True, ((1, "1 m"), (3, "3"), (10, "10"), (30, "30"), (200, "200 m"))),
    "size": ("Largest sigma", (0.003, 3), False, ((0.003, "3 mm"), (0.03, "3 cm"), (0.3, "0.3 m"), (3, "3 m"))),
    "count": ("Gaussians blended per pixel", (1, 1000), False, COUNTS),
    "overdraw": ("Gaussians computed per pixel", (1, 1000), False, COUNTS),
}
# The two colours of the mode "critical", which has no scale.
KINDS = (((1, 0.45, 0.1), "vehicles, pedestrians, cyclists"), ((0.35, 0.35, 0.4), "all else"))
STOPS = 5  # the colour map is linear between this number of equally spaced colours
# The bar's size, and its distance from the view's lower edge, in pixels at interface scale 1.
WIDTH, HEIGHT, BOTTOM = 280, 12, 62


def share(mode, value):
    """Position of a value on a mode's scale, from 0 to 1."""
    low, high = SCALES[mode][1]
    return (value - low) / (high - low) if low == 0 else math.log(value / low) / math.log(high / low)


def color(mode, at):
    """The colour at a position on a mode's scale, 0 to 1, as the screen shows it."""
    return (*native.module.heat(1 - at if SCALES[mode][2] else at), 1.0)


def shows(context):
    """Whether a 3D view has a legend: it draws splats in a mode that needs one, and shows its text."""
    settings, space = context.scene.pags, context.space_data
    if settings.mode == "rgb" or not (space.overlay.show_overlays and space.overlay.show_text) or native.module is None:
        return False
    return overlay.draws(context) and any(o.pags.kind == "ROOT" for o in context.scene.objects)


def write(text, x, y, align=0.0):
    """A line that begins at x (0), is centred there (0.5) or ends there (1)."""
    blf.position(0, x - align * blf.dimensions(0, text)[0], y, 0)
    blf.draw(0, text)


def note(scene):
    """Suffix of a mode's title: other view transforms change the picture's colours."""
    transform = scene.view_settings.view_transform
    return "" if transform in {"Standard", "Raw"} else f" (colours as under Standard; this is {transform})"


def place(context):
    """Left, bottom, width and interface scale of the bar: centred in the part of the view left of the sidebar."""
    scale, region = draw.font(context), context.region
    sidebar = next((r.width for r in context.area.regions if r.type == "UI" and r.width > 1), 0)
    width = min(WIDTH * scale, 0.7 * (region.width - sidebar))
    return (region.width - sidebar - width) / 2, BOTTOM * scale, width, scale


def on_draw():
    context = bpy.context
    if context.region_data is None or not shows(context):
        return
    mode = context.scene.pags.mode
    left, bottom, width, scale = place(context)
    shade = (0.0, 0.0, 0.0, 0.6)
    margin = 14 * scale
    draw.strip(left - margin, bottom - 20 * scale, width + 2 * margin, (HEIGHT + 42) * scale, (shade, shade))
    blf.color(0, 1, 1, 1, 1)
    title = SCALES[mode][0] if mode in SCALES else "Critical"
    write(title + note(context.scene), left, bottom + (HEIGHT + 6) * scale)
    if mode not in SCALES:
        for (shade, text), at in zip(KINDS, (left, left + 0.75 * width)):
            draw.strip(at, bottom, 0.25 * width, HEIGHT * scale, [(*shade, 1.0)] * 2)
            write(text, at, bottom - 14 * scale)
        return
    draw.strip(left, bottom, width, HEIGHT * scale, [color(mode, k / (STOPS - 1)) for k in range(STOPS)])
    for value, text in SCALES[mode][3]:
        at = share(mode, value)
        write(text, left + at * width, bottom - 14 * scale, at if at in (0, 1) else 0.5)


DRAWN = ((on_draw, "POST_PIXEL"),)
