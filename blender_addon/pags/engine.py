# SPDX-License-Identifier: GPL-3.0-or-later
"""Render engine "PAGS": F12 renders submit jobs to the C module; the Rendered viewport uses viewport.View."""

import bpy
import numpy as np

from . import gather, lens, native, passes
from .native import SceneError

EMPTY_DEPTH = 1e10  # depth of pixels without a surface, as Cycles writes it


def border_window(render, width, height):
    """Render border as (x, y, width, height) in pixels with row 0 at the top, or None; Blender counts its border from the bottom."""
    if not render.use_border:
        return None
    x0, x1 = int(render.border_min_x * width), int(render.border_max_x * width)
    y0, y1 = int(render.border_min_y * height), int(render.border_max_y * height)
    return (x0, height - y1, max(1, x1 - x0), max(1, y1 - y0))


def fill_pass(render_pass, buffer):
    """Fills a whole render pass with one call: Blender 3.4 takes an array (pixels, channels), later versions a flat one."""
    flat = np.asarray(buffer).reshape(-1)
    try:
        render_pass.rect.foreach_set(flat)
    except TypeError:
        render_pass.rect.foreach_set(flat.reshape(-1, render_pass.channels))


class PagsRenderEngine(bpy.types.RenderEngine):
    bl_idname = "PAGS"
    bl_label = "PAGS"
    bl_use_preview = False
    bl_use_eevee_viewport = True
    bl_use_postprocess = True
    bl_use_shading_nodes_custom = False
    bl_use_custom_freestyle = False

    def __init__(self, *args, **kwargs):
        super().__init__(*args, **kwargs)
        self.view = None

    # ---- F12 ----

    def update_render_passes(self, scene=None, renderlayer=None):
        self.register_pass(scene, renderlayer, "Combined", 4, "RGBA", "COLOR")
        if renderlayer.use_pass_z:
            self.register_pass(scene, renderlayer, "Depth", 1, "Z", "VALUE")
        if renderlayer.use_pass_object_index:
            self.register_pass(scene, renderlayer, "IndexOB", 1, "X", "VALUE")
        if scene.pags.use_pass_heat:
            self.register_pass(scene, renderlayer, "PriorityHeat", 4, "RGBA", "COLOR")
        passes.register(self, scene, renderlayer)

    def render(self, depsgraph):
        width, height = self.resolution_x, self.resolution_y  # Blender's: within a compositor, that of the scene that is rendered
        window = border_window(depsgraph.scene.render, width, height)
        size = window[2:] if window else (width, height)
        result = self.begin_result(
            0, 0, *size, layer=depsgraph.view_layer_eval.name if hasattr(depsgraph, "view_layer_eval") else ""
        )
        cancelled = False
        try:
            cancelled = not self.draw_into(depsgraph, result, width, height, window)
        except (SceneError, lens.LensError, RuntimeError, ValueError, MemoryError) as error:
            self.fail(str(error))
            cancelled = True
        finally:
            self.end_result(result, cancel=cancelled)

    def fail(self, text):
        self.report({"ERROR"}, text)
        self.error_set(text)

    def draw_into(self, depsgraph, result, width, height, window):
        """Waits for the job with progress; False when the user cancelled."""
        scene = depsgraph.scene
        state, count = gather.gather(depsgraph)
        if state is None:
            raise SceneError("there is no PAGS scene to render: import one (File > Import > PAGS scene), or unhide it")
        if count > 1:
            self.report({"WARNING"}, f"{count} PAGS scenes are visible; {state.root_name} alone is rendered")
        if state.scaled:
            self.report({"WARNING"}, "PAGS moves and turns objects; their scale is left out")
        if scene.camera is None:
            raise SceneError("there is no camera in the scene")
        entry = gather.load(state, True)
        critical_only = scene.pags.hide_noncritical
        keys = gather.keys(state, entry, critical_only)
        placements = gather.placements(
            state, entry, gather.time_of(state, entry, scene.frame_current_final), critical_only
        )
        job = self.submit(depsgraph, state, entry, width, height, window, layer_of(result), keys, placements)
        while not job.wait(0.05):
            if self.test_break():
                job.cancel()
                return False
        self.hand_over(job.take(), layer_of(result), state)
        passes.describe(
            self.get_result(), depsgraph.view_layer_eval.name, layer_of(result), passes.names(keys, placements, entry)
        )
        return True

    def submit(self, depsgraph, state, entry, width, height, window, layer, keys, placements):
        scene, render = depsgraph.scene, depsgraph.scene.render
        camera = scene.camera.evaluated_get(depsgraph)
        values, pose = lens.of_camera(
            camera.data, camera.matrix_world, width, height, render.pixel_aspect_x, render.pixel_aspect_y
        )
        time = gather.time_of(state, entry, scene.frame_current_final)
        names = {"Combined": "rgba", "Depth": "depth", "IndexOB": "object", "PriorityHeat": "heat"}
        outputs = [names[p.name] for p in layer.passes if p.name in names] + passes.outputs(layer)
        arguments = {
            "outputs": outputs,
            "placements": placements,
            **gather.job_arguments(scene.pags, state, entry, True),
            **gather.exposure(scene.pags, entry, camera, time),
        }
        transparent, threads = render.film_transparent, scene.pags.threads
        view = gather.camera_for(state, entry, values, pose, time)
        values_of_objects = gather.object_values(state, entry)
        # The last, since it goes to other frames and back: what was evaluated before is not to be used after it.
        arguments.update(
            passes.arguments(self, depsgraph, state, entry, placements, keys, scene.pags.hide_noncritical, outputs)
        )
        self.update_stats("PAGS", f"{entry.info['gaussians']:,} Gaussians")
        return native.renderer("final", threads).submit(
            entry.scene,
            view,
            window=window,
            object_values=values_of_objects,
            transparent=transparent,
            depth_empty=EMPTY_DEPTH,
            **arguments,
        )

    def hand_over(self, picture, layer, state):
        planes = {
            "Combined": picture.rgba,
            "Depth": picture.depth,
            "IndexOB": picture.object,
            "PriorityHeat": picture.heat,
            **passes.planes(picture, state),
        }
        for render_pass in layer.passes:
            if planes.get(render_pass.name) is not None:
                fill_pass(render_pass, planes[render_pass.name])
        stats = picture.stats
        self.update_stats("PAGS", f"{stats['gaussians']:,} Gaussians, {stats['shaded']:,} drawn, {stats['ms']:.0f} ms")

    # ---- The Rendered viewport ----

    def view_update(self, context, depsgraph):
        from . import viewport

        if self.view is None:
            self.view = viewport.View()
        self.view.update(depsgraph)

    def view_draw(self, context, depsgraph):
        from . import viewport

        if self.view is None:
            self.view = viewport.View()
            self.view.update(depsgraph)
        self.view.draw_rendered(self, context, depsgraph)


def layer_of(result):
    return result.layers[0]


def compatible_panels():
    """Blender's own panels that make sense for this engine."""
    left_out = {"VIEWLAYER_PT_filter", "VIEWLAYER_PT_layer_passes"}
    for panel in bpy.types.Panel.__subclasses__():
        engines = getattr(panel, "COMPAT_ENGINES", None)
        if engines and "BLENDER_RENDER" in engines and panel.__name__ not in left_out:
            yield panel


def register():
    bpy.utils.register_class(PagsRenderEngine)
    for panel in compatible_panels():
        panel.COMPAT_ENGINES.add("PAGS")


def unregister():
    for panel in compatible_panels():
        panel.COMPAT_ENGINES.discard("PAGS")
    bpy.utils.unregister_class(PagsRenderEngine)
    native.close()
