# SPDX-License-Identifier: GPL-3.0-or-later
"""Lists Blender settings that the engine ignores, for the viewport's header and F12's report."""

from . import blur

MOST_NAMES = 3


def some(names):
    """A few names and the number of further ones."""
    more = len(names) - MOST_NAMES
    return ", ".join(names[:MOST_NAMES]) + (f" and {more} more" if more > 0 else "")


def of_render(depsgraph, state):
    """Lines for F12's report. state: from gather."""
    render, said = depsgraph.scene.render, list(state.ignored)
    said += ["stereoscopy"] if render.use_multiview else []
    said += ["Freestyle"] if render.use_freestyle else []
    strangers = f"not drawn by PAGS: {some(state.strangers)} (Composite with Cycles/EEVEE adds meshes)"
    lines = [strangers] if state.strangers else []
    lines += [f"ignored by PAGS: {', '.join(said)}"] if said else []
    return lines + [scene.remark for scene in state.scenes if scene.remark]


def of_view(context, state):
    """The same for a Rendered 3D view, in one line; empty if nothing is ignored."""
    camera, final = context.scene.camera, []
    if context.region_data.view_perspective == "CAMERA" and camera is not None and camera.type == "CAMERA":
        final += ["depth of field"] if blur.aperture_radius(camera.data) > 0 else []
    final += ["motion blur"] if blur.shutter(context.scene)[1] > 0 else []
    lists = (
        ("not in F12", some(state.strangers)),
        ("F12 alone", ", ".join(final)),
        ("ignored", ", ".join(state.ignored)),
    )
    said = [scene.remark for scene in state.scenes if scene.remark]
    return "; ".join(said + [f"{what}: {names}" for what, names in lists if names])
