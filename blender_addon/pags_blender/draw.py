# SPDX-License-Identifier: GPL-3.0-or-later
"""Draws pictures on the screen: GPU textures made without a copy in Python, and the shaders that show them."""

import blf
import bpy
import gpu
import numpy as np
from gpu_extras.batch import batch_for_shader

from . import native

VERTEX = "void main() { uv = 0.5 * at + 0.5; gl_Position = vec4(at, 0.0, 1.0); }"

PLAIN = """
void main() {
  color = texture(picture, uv);
}
"""

# Writes the depth buffer from the picture's depths, so that meshes and splats hide each other. `lens` holds the elements P22 and P23 of the
# view's projection matrix and whether it is a perspective; for an orthographic view, rendered from far behind, the distance back is subtracted.
DEPTH = """
void main() {
  vec4 texel = texture(picture, uv);
  float z = texture(depths, uv).r - lens.w;
  if (texel.a < 0.5) {
    discard;
  }
  float ndc = lens.z > 0.5 ? (lens.x * -z + lens.y) / z : lens.x * -z + lens.y;
  gl_FragDepth = clamp(0.5 * ndc + 0.5, 0.0, 1.0);
  color = texel;
}
"""

_made = {}


def compiled(name, vertex, fragment, inputs, between, constants=(), pictures=(), depth=False):
    """A shader. inputs, between, constants: (type, name) of the vertices' attributes, of what the fragments get, and of the push constants; pictures: names
    of the textures; depth: it writes the depth buffer."""
    info, face = gpu.types.GPUShaderCreateInfo(), gpu.types.GPUStageInterfaceInfo("pags_" + name)
    for number, value in enumerate(inputs):
        info.vertex_in(number, *value)
    for value in between:
        face.smooth(*value)
    info.vertex_out(face)
    for number, picture in enumerate(pictures):
        info.sampler(number, "FLOAT_2D", picture)
    for value in constants:
        info.push_constant(*value)
    if depth and hasattr(info, "depth_write"):
        info.depth_write("ANY")
    info.fragment_out(0, "VEC4", "color")
    info.vertex_source(vertex)
    info.fragment_source(fragment)
    return gpu.shader.create_from_info(info)


def builtin(*names):
    """The first of Blender's own shaders that this version has."""
    for name in names:
        try:
            return gpu.shader.from_builtin(name)
        except (ValueError, SystemError):
            continue
    raise native.SceneError(f"this Blender has no shader {names[0]}")


AT, UV = [("VEC2", "at")], [("VEC2", "uv")]


def shader(name):
    if name not in _made and name == "depth":
        _made[name] = compiled(name, VERTEX, DEPTH, AT, UV, [("VEC4", "lens")], ["picture", "depths"], True)
    elif name not in _made:
        _made[name] = compiled(name, VERTEX, PLAIN, AT, UV, pictures=["picture"])
    return _made[name]


def bind_picture(shader_, shown, window_matrix):
    """Binds a picture (viewport.Shown) to the shader, with its depth if it has one."""
    shader_.uniform_sampler("picture", shown.color)
    if shown.depth is not None:
        p = window_matrix
        shader_.uniform_sampler("depths", shown.depth)
        perspective = 1.0 if p[3][3] == 0 else 0.0
        shader_.uniform_float("lens", (p[2][2], p[2][3], perspective, shown.values.get("ortho", 0.0)))


def rectangle(shader_, left, right):
    """The part of the view between two columns, from -1 to 1."""
    corners = [(left, -1), (right, -1), (right, 1), (left, 1)]
    return batch_for_shader(shader_, "TRIS", {"at": corners}, indices=[(0, 1, 2), (0, 2, 3)])


def quad(name):
    key = "quad " + name
    if key not in _made:
        _made[key] = rectangle(shader(name), -1, 1)
    return _made[key]


def part(name, left, right):
    """The part of a shader's quad between two columns."""
    return quad(name) if (left, right) == (-1, 1) else rectangle(shader(name), left, max(left, right))


def font(context):
    """Sets the text size of a view; returns the scale of the user interface."""
    scale = context.preferences.system.ui_scale
    try:
        blf.size(0, int(11 * scale))
    except TypeError:
        blf.size(0, int(11 * scale), 72)  # up to Blender 3.x the call takes dots per inch
    return scale


def strip(x, y, width, height, colors):
    """Draws a bar with these equally spaced colours."""
    places, shades = [], []
    for number, shade in enumerate(colors):
        at = x + width * number / max(1, len(colors) - 1)
        places += [(at, y), (at, y + height)]
        shades += [shade, shade]
    smooth = gpu.shader.from_builtin("SMOOTH_COLOR" if bpy.app.version >= (4, 0, 0) else "2D_SMOOTH_COLOR")
    gpu.state.blend_set("ALPHA")
    batch_for_shader(smooth, "TRI_STRIP", {"pos": places, "color": shades}).draw(smooth)
    gpu.state.blend_set("NONE")


def lines(texts, left, bottom, scale):
    """Draws white lines of text on a dark box, readable on any picture; `bottom`: of the last line's letters."""
    step, margin = 15 * scale, 5 * scale
    width = max(blf.dimensions(0, text)[0] for text in texts)
    shade = (0.0, 0.0, 0.0, 0.6)
    strip(left - margin, bottom - margin, width + 2 * margin, len(texts) * step + margin, (shade, shade))
    blf.color(0, 1, 1, 1, 1)
    for row, text in enumerate(reversed(texts)):
        blf.position(0, left, bottom + row * step, 0)
        blf.draw(0, text)


def text(context, x, y, said):
    """Draws a line over a view, centred at x and a little above y (fractions of the region's size), moved into the region if possible."""
    region, scale = context.region, font(context)
    width, height = blf.dimensions(0, said)
    left = min(max(x * region.width - width / 2, 20 * scale), region.width - width - 20 * scale)
    lines([said], left, min(max(y * region.height, 0), region.height - 3 * height) + 10 * scale, scale)


def texture(buffer, width, height, channels):
    flat = np.asarray(buffer).reshape(-1)
    data = gpu.types.Buffer("FLOAT", width * height * channels, flat)
    return gpu.types.GPUTexture((width, height), format="RGBA16F" if channels == 4 else "R32F", data=data)


def clear():
    _made.clear()


def live(kind, name, description, **more):
    """A property whose change redraws the views, also from a script."""
    return kind(name=name, description=description, update=again, **more)


def again(settings=None, context=None):
    """Redraws all 3D views."""
    for _, _, region in regions():
        region.tag_redraw()


def regions():
    """Window, area and main region of all open 3D views."""
    for window in bpy.context.window_manager.windows:
        for area in (area for area in window.screen.areas if area.type == "VIEW_3D"):
            for region in (region for region in area.regions if region.type == "WINDOW"):
                yield window, area, region
