# SPDX-License-Identifier: GPL-3.0-or-later
"""Imports further recorded data on demand: labelled boxes as wire objects along their tracks, held-out time steps as markers of the timeline."""

import bpy
import numpy as np

from . import cameras, curves, jobs, native, whereabouts
from .timing import MARKER

CORNERS = [(x, y, z) for x in (-0.5, 0.5) for y in (-0.5, 0.5) for z in (-0.5, 0.5)]
BOX_EDGES = [(a, b) for a in range(8) for b in range(a) if bin(a ^ b).count("1") == 1]
BOX_EDGES += [(8, 9)]  # from the centre to the front

# ---- Boxes ----


class PAGS_OT_boxes(jobs.Long, cameras.OnScene, bpy.types.Operator):
    """Show the labelled boxes of all objects as wire along their recorded tracks, independent of edits in this file"""

    bl_idname = "pags.boxes"
    bl_label = "Labelled boxes"
    bl_options = {"REGISTER", "UNDO"}

    def steps(self, context, root):
        path, scene = whereabouts.absolute_path(root), context.scene

        def work(job):
            entry = yield jobs.in_thread(native.load, path)
            if not entry.objects:
                raise native.SceneError(f"{root.name}: the scene has no labelled objects")
            job.changes = True
            name = f"{root.name} boxes"
            known = (c for c in scene.collection.children_recursive if c.get("pags_boxes") == root.name)
            collection = next(known, None)
            if collection is None:
                collection = bpy.data.collections.new(name)
                collection["pags_boxes"] = root.name
                scene.collection.children.link(collection)
            for block in list(collection.objects):
                bpy.data.objects.remove(block)
            frame = cameras.Frame(bpy.context, root)
            for index, record in enumerate(entry.objects):
                add_box(collection, frame, index, record)
                job.tell(index / len(entry.objects), "boxes")
                yield
            return f"{len(entry.objects)} boxes in the collection {collection.name}"

        return work


def add_box(collection, frame, index, record):
    """One box: edges, and a line on its floor from the centre to the front, which is +x."""
    mesh = bpy.data.meshes.new(f"box {record['id']}"[:60])
    size = record["size"]
    corners = [[a * b for a, b in zip(corner, size)] for corner in CORNERS]
    corners += [[0, 0, -0.5 * size[2]], [0.5 * size[0], 0, -0.5 * size[2]]]
    mesh.from_pydata(corners, BOX_EDGES, [])
    block = bpy.data.objects.new(mesh.name, mesh)
    collection.objects.link(block)
    block.parent, block.hide_render, block.display_type = frame.root, True, "WIRE"
    block["pags_box"], block["pags_class"] = record["id"], record["class"]
    times, poses = frame.entry.track(index)
    frames = frame.frame_of(times)
    curves.set_track(block, frames, poses)
    if record["tracked"]:
        step = float(np.median(np.diff(frames))) if len(frames) > 1 else frame.root.pags.fps / (frame.info["fps"] or 10)
        begin, end = frames[0] - step / 2, frames[-1] + step / 2 + 1e-3
        curves.set_curve(block, "hide_viewport", 0, [begin - 1, begin, end], [1, 0, 1], "CONSTANT")


# ---- Held-out steps ----


class PAGS_OT_mark(cameras.OnScene, bpy.types.Operator):
    """Mark the time steps on the timeline whose photographs were held out from training; repeat to remove the marks"""

    bl_idname = "pags.mark_held_out"
    bl_label = "Mark held-out steps"
    bl_options = {"REGISTER", "UNDO"}

    def work(self, context, root):
        markers = context.scene.timeline_markers
        old = [marker for marker in markers if marker.name.startswith(MARKER)]
        for marker in old:
            markers.remove(marker)
        if old:
            return f"{len(old)} marks removed"
        frame, steps = cameras.Frame(context, root), {}
        for view in frame.scene.views:
            if "time" in view:
                steps.setdefault(int(round(frame.frame_of(view["time"]))), []).append(view)
        held_out = {at: [v for v in views if v["test"]] for at, views in steps.items()}
        held_out = {at: views for at, views in sorted(held_out.items()) if views}
        if not held_out:
            raise native.SceneError("no photograph of the recording was held out from training")
        for at, views in held_out.items():
            some = len(views) < len(steps[at])
            markers.new(MARKER + (": camera " + ", ".join(str(v["sensor"]) for v in views) if some else ""), frame=at)
        return f"{len(held_out)} held-out time steps marked"


def marked(scene):
    return any(marker.name.startswith(MARKER) for marker in scene.timeline_markers)
