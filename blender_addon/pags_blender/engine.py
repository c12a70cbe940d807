# SPDX-License-Identifier: GPL-3.0-or-later
"""Render engine "PAGS": F12 renders submit jobs to the C module; the Rendered viewport uses viewport.View."""

import bpy
import numpy as np

from . import blur, gather, ignored, lens, native, passes
from .native import SceneError

EMPTY_DEPTH = 1e10  # depth of pixels without a surface, as in Cycles


def border_window(render, width, height):
    """Render border as (x, y, width, height) in pixels with row 0 at the top, or None; Blender counts from the bottom."""
    if not render.use_border:
        return None
    x0, x1 = int(render.border_min_x * width), int(render.border_max_x * width)
    y0, y1 = int(render.border_min_y * height), int(render.border_max_y * height)
    return (x0, height - y1, max(1, x1 - x0), max(1, y1 - y0))


def fill_pass(render_pass, buffer):
    """Fills a render pass with one call: Blender 3.4 takes an array (pixels, channels), later versions a flat one."""
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
        for name, channels, kind in passes.enabled(scene, renderlayer):
            self.register_pass(scene, renderlayer, name, len(channels), channels, kind)

    def render(self, depsgraph):
        # The size of the scene being rendered, which in a compositor differs from the active one.
        width, height = self.resolution_x, self.resolution_y
        window = border_window(depsgraph.scene.render, width, height)
        size = window[2:] if window else (width, height)
        result = self.begin_result(0, 0, *size, layer=depsgraph.view_layer_eval.name)
        cancelled = False
        try:
            cancelled = not self.draw_into(depsgraph, result, width, height, window)
        except (SceneError, lens.LensError, RuntimeError, ValueError, MemoryError) as error:
            self.fail(str(error))
            cancelled = True
        finally:
            self.end_result(result, cancel=cancelled)

    def warn(self, text):
        self.report({"WARNING"}, text)

    def fail(self, text):
        self.report({"ERROR"}, text)
        self.error_set(text)

    def draw_into(self, depsgraph, result, width, height, window):
        """Waits for the job and reports progress; false if the user cancelled."""
        scene, layer = depsgraph.scene, result.layers[0]
        state = gather.gather(depsgraph)
        if state is None:
            self.leave_empty(depsgraph, result)
            return True
        if scene.camera is None:
            raise SceneError("there is no camera in the scene")
        said = [f"omitted, since a scale of 0 flattens them: {', '.join(state.flat)}"] if state.flat else []
        said += ignored.of_render(depsgraph, state)
        for text in said:
            self.warn(text)
        frame, camera, now = state.load(True), scene.camera.original, scene.frame_current_final
        samples = blur.Samples(depsgraph.scene_eval, camera.evaluated_get(depsgraph), scene.pags.blur_samples)
        outputs, threads = outputs_of(layer), scene.pags.threads
        drawn = [frame.parts(k, now, scene.pags.hide_noncritical) for k in range(len(frame.scenes))]
        self.update_stats("PAGS", f"{frame.gaussians:,} Gaussians")
        picture = colours = None
        if not samples or outputs != ["rgba"]:
            # with samples, all passes except the colours are those of the sharp picture at the frame itself
            view, arguments = self.arguments(depsgraph, frame, drawn, camera, now, (width, height), window)
            arguments["outputs"] = [name for name in outputs if name != "rgba" or not samples]
            # Must be last: it changes the frame and back, which invalidates earlier evaluated data.
            passes.add_arguments(self, depsgraph, frame, drawn, scene.pags.hide_noncritical, arguments)
            picture = self.finish(native.renderer("final", threads).submit(frame.entry.scene, view, **arguments))
            if picture is None:
                return False
        if samples and "rgba" in outputs:
            colours = self.blurred(depsgraph, frame, samples, camera, now, (width, height), window)
            if colours is None:
                return False
        self.hand_over(picture, colours, layer, frame, samples, [frame.remarks(scene.pags), *said])
        passes.describe(self.get_result(), depsgraph.view_layer_eval.name, layer, passes.names(frame, drawn))
        return True

    def finish(self, job):
        """The job's picture; None if the user cancelled."""
        while not job.wait(0.05):
            if self.test_break():
                job.cancel()
                return None
        return job.take()

    def leave_empty(self, depsgraph, result):
        """Writes empty passes for a view layer without visible PAGS scene."""
        if not any(o.pags.kind in gather.PARTS for o in bpy.data.objects):
            raise SceneError("there is no PAGS scene to render: import one (File > Import > PAGS scene)")
        text = f"view layer {depsgraph.view_layer_eval.name}: no PAGS scene is visible, so the layer is empty"
        self.warn(text)
        self.update_stats("PAGS", text)
        for render_pass in result.layers[0].passes:
            if render_pass.name == "Depth":
                pixels = result.resolution_x * result.resolution_y
                fill_pass(render_pass, np.full(pixels, EMPTY_DEPTH, dtype=np.float32))

    def arguments(self, depsgraph, frame, drawn, camera, now, size, window, point=None):
        """The view of a picture and the keyword arguments of its job, colours only. point: on the aperture; None: its centre."""
        scene, render = depsgraph.scene, depsgraph.scene.render
        camera = camera.evaluated_get(depsgraph)
        values, pose = lens.of_camera(
            camera.data, camera.matrix_world, *size, render.pixel_aspect_x, render.pixel_aspect_y
        )
        planes = lens.depth_planes(values, pose, camera.data.clip_start, camera.data.clip_end)
        if point is not None:
            values, pose = blur.through(point, blur.focus_distance(camera, depsgraph), values, pose)
        arguments = {
            "outputs": ["rgba"],
            "window": window,
            "transparent": render.film_transparent,
            "depth_empty": EMPTY_DEPTH,
            "clips": frame.clips(planes),
            **frame.contents(now, [placements for _, placements in drawn], object_values=True),
            **gather.job_arguments(scene.pags, frame, True),
            **frame.exposure(scene.pags, camera, now),
        }
        return frame.camera(values, pose, now), arguments

    def blurred(self, depsgraph, frame, samples, camera, now, size, window):
        """The colours with depth of field and motion blur; None if the user cancelled."""
        scene = depsgraph.scene
        number, subframe, settings = scene.frame_current, scene.frame_subframe, scene.pags

        def prepare(offset, point):
            then, time, nothing = frame, now + offset, False
            if samples.moves:
                self.frame_set(int(np.floor(time)), float(time - np.floor(time)))
                state = gather.gather(depsgraph)
                nothing = state is None
                then = frame if nothing else state.load(True)
            scenes, only = range(len(then.scenes)), settings.hide_noncritical
            drawn = [([], []) if nothing else then.parts(k, time, only) for k in scenes]
            point = point if samples.focuses else None
            view, arguments = self.arguments(depsgraph, then, drawn, camera, time, size, window, point)
            return then.entry.scene, view, arguments

        def submit(scene, view, arguments):
            return native.renderer("final", settings.threads).submit(scene, view, **arguments)

        def take(job, k):
            self.update_progress(k / len(samples))
            self.update_stats("PAGS", f"{' and '.join(samples.names())}: sample {k + 1} of {len(samples)}")
            return self.finish(job)

        try:
            return blur.mean(samples, prepare, submit, take)
        finally:
            if samples.moves:
                self.frame_set(number, subframe)

    def hand_over(self, picture, colours, layer, frame, samples, said):
        """Fills the passes. picture: None if only colours are rendered; colours: the blurred picture, or None."""
        planes = {"Combined": colours}
        if picture is not None:
            planes = {
                "Combined": picture.rgba if colours is None else colours,
                "Depth": picture.depth,
                "IndexOB": picture.object,
                "PriorityHeat": picture.heat,
                **passes.planes(picture, frame),
            }
        for render_pass in layer.passes:
            if planes.get(render_pass.name) is not None:
                fill_pass(render_pass, planes[render_pass.name])
        if samples:
            text = f"{frame.gaussians:,} Gaussians, {' and '.join(samples.names())} of {len(samples)} samples"
        else:
            text = frame.counts(picture.stats)
        self.update_stats("PAGS", "; ".join(filter(None, (text, *said))))

    # ---- The Rendered viewport ----

    def view_update(self, context, depsgraph):
        from . import viewport

        if self.view is None:
            self.view = viewport.View()
        self.view.update(depsgraph, context.space_data)

    def view_draw(self, context, depsgraph):
        from . import viewport

        if self.view is None:
            self.view = viewport.View()
            self.view.update(depsgraph, context.space_data)
        self.view.draw_rendered(self, context, depsgraph)


OUTPUTS = {"Combined": "rgba", "Depth": "depth", "IndexOB": "object", "PriorityHeat": "heat"}


def outputs_of(layer):
    """The engine outputs required by the passes of a render layer."""
    return [OUTPUTS[p.name] for p in layer.passes if p.name in OUTPUTS] + passes.outputs(layer)


def compatible_panels():
    """Blender's own panels that apply to this engine."""
    left_out = {"VIEWLAYER_PT_filter", "VIEWLAYER_PT_layer_passes"}
    for panel in bpy.types.Panel.__subclasses__():
        engines = getattr(panel, "COMPAT_ENGINES", None)
        if engines and "BLENDER_RENDER" in engines and panel.__name__ not in left_out:
            yield panel


def on_register():
    for panel in compatible_panels():
        panel.COMPAT_ENGINES.add("PAGS")


def on_unregister():
    for panel in compatible_panels():
        panel.COMPAT_ENGINES.discard("PAGS")
    native.close()
