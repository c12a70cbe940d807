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
        state = gather.gather(depsgraph)
        if state is None:
            raise SceneError("there is no PAGS scene to render: import one (File > Import > PAGS scene), or unhide it")
        if state.flat:
            self.report({"WARNING"}, f"flattened by their scale and left out: {', '.join(state.flat)}")
        if scene.camera is None:
            raise SceneError("there is no camera in the scene")
        frame, critical_only = state.load(True), scene.pags.hide_noncritical
        drawn = [frame.parts(k, scene.frame_current_final, critical_only) for k in range(len(frame.scenes))]
        job = self.submit(depsgraph, frame, width, height, window, layer_of(result), drawn)
        while not job.wait(0.05):
            if self.test_break():
                job.cancel()
                return False
        self.hand_over(job.take(), layer_of(result), frame)
        passes.describe(self.get_result(), depsgraph.view_layer_eval.name, layer_of(result), passes.names(frame, drawn))
        return True

    def submit(self, depsgraph, frame, width, height, window, layer, drawn):
        scene, render = depsgraph.scene, depsgraph.scene.render
        camera = scene.camera.evaluated_get(depsgraph)
        values, pose = lens.of_camera(
            camera.data, camera.matrix_world, width, height, render.pixel_aspect_x, render.pixel_aspect_y
        )
        now = scene.frame_current_final
        names = {"Combined": "rgba", "Depth": "depth", "IndexOB": "object", "PriorityHeat": "heat"}
        outputs = [names[p.name] for p in layer.passes if p.name in names] + passes.outputs(layer)
        transparent, threads, critical_only = render.film_transparent, scene.pags.threads, scene.pags.hide_noncritical
        arguments = {
            "outputs": outputs,
            "window": window,
            "transparent": transparent,
            "depth_empty": EMPTY_DEPTH,
            **frame.contents(now, [placements for _, placements in drawn], object_values=True),
            **gather.job_arguments(scene.pags, frame, True),
            **frame.exposure(scene.pags, camera, now),
        }
        view = frame.camera(values, pose, now)
        self.update_stats("PAGS", f"{frame.gaussians:,} Gaussians")
        # The last, since it goes to other frames and back: what was evaluated before is not to be used after it.
        passes.add_arguments(self, depsgraph, frame, drawn, critical_only, arguments)
        return native.renderer("final", threads).submit(frame.entry.scene, view, **arguments)

    def hand_over(self, picture, layer, frame):
        planes = {
            "Combined": picture.rgba,
            "Depth": picture.depth,
            "IndexOB": picture.object,
            "PriorityHeat": picture.heat,
            **passes.planes(picture, frame),
        }
        for render_pass in layer.passes:
            if planes.get(render_pass.name) is not None:
                fill_pass(render_pass, planes[render_pass.name])
        stats = picture.stats
        said = f"{stats['gaussians']:,} Gaussians, {stats['shaded']:,} drawn, {stats['ms']:.0f} ms"
        self.update_stats("PAGS", "; ".join(filter(None, (said, frame.remarks()))))

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
