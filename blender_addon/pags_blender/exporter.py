# SPDX-License-Identifier: GPL-3.0-or-later
"""Exports through the `pags` program with the edits made in Blender: objects moved, deleted or hidden, tracks changed.

The program does not read .blend files. Its input is a scene folder: scene.json with the tracks of the current timeline and without deleted objects, and links
to or copies of the models."""

import contextlib
import json
import os
import tempfile

import bpy
import numpy as np
from bpy.props import BoolProperty, EnumProperty, StringProperty
from bpy_extras.io_utils import ExportHelper

from . import cameras, cleanup, curves, files, gather, jobs, lens, native, photographs, program, reasons, whereabouts


def parts_by_index(context, root):
    """The Blender objects of the scene's objects by index, without deleted ones."""
    out = {}
    for part in context.scene.objects:
        if part.pags.kind == "OBJECT" and part.pags.root == root and part.pags.index not in out:
            out[part.pags.index] = part
    return out


def pose_now(root_inverse, part, origin):
    """The rigid pose of a part, 4x4, and whether a scale was dropped: scene files store no scale."""
    matrix = root_inverse @ lens.matrix(part.matrix_world)
    pose, _ = lens.rigid(matrix)
    scaled = not np.allclose(pose[:3, :3], matrix[:3, :3], rtol=0, atol=gather.SNAP_ROTATION)
    pose[:3, 3] += origin
    return pose, scaled


class Edited:
    """Writes the edited scene as a scene folder."""

    def __init__(self, context, root, cleaned=""):
        """cleaned: a temporary folder with the scene after clean-up and look; empty: read the original scene."""
        self.context, self.root, self.cleaned = context, root, cleaned
        self.frame = cameras.Frame(context, root)
        self.entry = self.frame.entry
        self.source = cleaned or self.entry.path
        if not os.path.isdir(self.source):
            raise native.SceneError(
                f"{self.entry.path}: saving edits requires a scene folder; this is a splat file, which Export writes"
            )
        self.dataset = photographs.dataset(root, self.entry)
        with open(os.path.join(self.source, "scene.json"), encoding="utf-8") as file:
            self.scene = json.load(file)
        self.inverse = np.linalg.inv(lens.matrix(root.matrix_world))
        self.moved, self.gone, self.scaled = (
            {},
            [],
            set(),
        )  # moved: motion of the world, 4x4, by index; None: of a track

    def collect(self, job):
        """Steps that find moved objects and their new track poses in one pass over the timeline. Between steps the timeline returns to the user's frame."""
        parts, scene = parts_by_index(self.context, self.root), self.context.scene
        records = self.scene.get("objects", [])
        self.gone = [
            i
            for i, r in enumerate(self.entry.objects)
            if r["gaussians"] > 0 and (i not in parts or parts[i].hide_render and not animated(parts[i], "hide_render"))
        ]
        times = sorted(
            {
                k["time"]
                for i in parts
                if i < len(records) and self.entry.objects[i]["tracked"]
                for k in records[i]["knots"]
            }
        )
        times = times or [self.entry.info["time_begin"]]
        time_at = {self.frame.frame_of(time): time for time in times}

        def visit(frame, depsgraph):
            for index, part in parts.items():
                if index < len(records):
                    self.take(
                        records[index], index, part.evaluated_get(depsgraph), time_at[frame], time_at[frame] == times[0]
                    )

        yield from cameras.along(job, scene, list(time_at), visit)

    def take(self, record, index, part, time, first):
        pose, scaled = pose_now(self.inverse, part, self.frame.origin)
        if scaled:
            self.scaled.add(part.name)
        exact = self.entry.scene.pose(index, time)
        if exact is None:
            return
        wanted = np.array(exact).reshape(3, 4)
        apart = np.abs(wanted - pose[:3])
        if apart[:, :3].max() < gather.SNAP_ROTATION and apart[:, 3].max() < gather.SNAP_METRES:
            return
        if not self.entry.objects[index]["tracked"]:
            if first:
                self.moved[index] = pose @ np.linalg.inv(np.vstack([wanted, [0, 0, 0, 1]]))
            return
        for knot in record["knots"]:
            if abs(knot["time"] - time) < 1e-6:
                knot.update(
                    world_from_object=lens.pose12(pose), rotation=[0, 0, 0], translation=[0, 0, 0], trained=True
                )
                self.moved[index] = None

    def left_out(self):
        """A report suffix with the edits missing from the written scene; empty if complete."""
        return f"; not exported: the scale of {', '.join(sorted(self.scaled))}" if self.scaled else ""

    def write(self, folder, job):
        """Runs in a background thread. Unchanged models become links to the old files, or copies if links fail. The Gaussians of a parked object belong to
        the background, of which the engine writes a new file. Never replaces files; on failure, removes its own."""
        records, parked = self.scene.get("objects", []), [not o["tracked"] for o in self.entry.objects]
        rules = [{"object": i, "opacity": 0} for i in self.gone if parked[i]]
        rules += [
            {"object": i, "motion": lens.pose12(motion)}
            for i, motion in self.moved.items()
            if parked[i] and i not in self.gone
        ]
        with (
            tempfile.TemporaryDirectory(prefix="pags-parked-") as beside,
            files.NewFiles(os.path.abspath(folder)) as new,
        ):
            renewed = ""
            if rules:
                place = os.path.join(beside, "scene")
                native.module.write_edited(self.source, json.dumps(rules), place)
                with open(os.path.join(place, "scene.json"), encoding="utf-8") as file:
                    made = json.load(file)
                renewed = os.path.join(place, made["models"][0]["file"])
                self.scene["models"][0]["gaussians"] = made["models"][0]["gaussians"]
                for i, motion in self.moved.items():
                    if parked[i]:
                        records[i] = made["objects"][i]
            gone_models = {records[i]["model"] for i in self.gone if records[i].get("model")}
            self.scene["models"] = [m for m in self.scene["models"] if m["name"] not in gone_models]
            for i in self.gone:
                if records[i].get("model"):
                    records[i]["model"] = None
            put = new.copy if self.cleaned else new.link
            for number, model in enumerate(self.scene["models"]):
                job.check()
                job.tell(number / len(self.scene["models"]), "writing models")
                if number == 0 and renewed:
                    new.copy(renewed, model["file"])
                else:
                    put(os.path.join(self.source, model["file"]), model["file"])
            if self.scene.get("sky"):
                put(os.path.join(self.source, self.scene["sky"]), self.scene["sky"])
            self.scene["dataset"] = self.dataset
            new.write("scene.json", json.dumps(self.scene))
        return folder


def animated(block, path):
    return any(curve.data_path == path for curve in curves.all_of(block))


LEVELS = [
    ("mesh", "Surface", "Proxies: the surface of each object"),
    ("cage", "Cage", "Proxies: a closed cage of quads, subdivided"),
    ("hull", "Hull", "Proxies: convex hulls"),
    ("box", "Box", "Proxies: the labelled boxes"),
    ("convex", "Convex parts", "Proxies: up to eight convex parts of each object"),
]


class PAGS_OT_export(jobs.Long, cameras.OnScene, bpy.types.Operator, ExportHelper):
    """Export proxies or splats with the pags program, including edits made in Blender"""

    bl_idname = "export_scene.pags"
    bl_label = "Export from PAGS scene"

    filename_ext = ""
    filter_glob: StringProperty(default="*.glb;*.gltf;*.ply;*.spz;*.splat;*.pagsz;*.usda;*.usdz", options={"HIDDEN"})
    content: EnumProperty(
        name="In glTF",
        description="Content of .glb and .gltf files; .ply, .spz, .splat and .pagsz store the Gaussians, .usda and .usdz both",
        items=[*LEVELS, ("splats", "Gaussians", "The Gaussians themselves (KHR_gaussian_splatting)")],
    )
    edits: BoolProperty(
        name="Apply edits",
        description="Include objects moved, deleted or hidden and tracks changed in Blender",
        default=True,
    )

    def invoke(self, context, event):
        self.by_hand = True
        return ExportHelper.invoke(self, context, event)

    def draw(self, context):
        lacking, row = program.lacking(context), self.layout.row()
        row.enabled = not lacking
        row.prop(self, "content")
        if lacking:
            reasons.explain(self.layout, f".glb, .gltf, .usda, .usdz: {lacking}")
        self.layout.prop(self, "edits")

    def steps(self, context, root):
        needs = self.filepath.endswith((".glb", ".gltf", ".usda", ".usdz"))
        command = proxy_program(context) if needs else program.command(context)
        return export(root, command, self.filepath, self.form(), self.edits)

    def form(self):
        """The arguments of `pags export` for .glb and .gltf, which store either splats or proxies; empty for other extensions."""
        if not self.filepath.endswith((".glb", ".gltf")):
            return []
        return ["--splats"] if self.content == "splats" else ["--proxy", self.content]


def proxy_program(context):
    """Path of the program; raises SceneError if it supports no proxies, glTF and USD."""
    command, lacking = program.command(context), program.lacking(context)
    if lacking:
        raise native.SceneError(lacking)
    return command


def export(root, command, path, form, edits):
    def work(job):
        with tempfile.TemporaryDirectory(prefix="pags-edited-") as folder:
            source, lacking = yield from source_of(job, root, os.path.join(folder, "scene"), edits)
            try:
                yield jobs.in_thread(program.run, job, command, "export", source, path, *form)
            finally:
                if job.stopped.is_set():  # Windows has no signal that lets a program clean up
                    for part in (path + ".part", os.path.splitext(path)[0] + ".bin.part"):
                        with contextlib.suppress(OSError):
                            os.remove(part)
        return f"wrote {path}{lacking}"

    return work


def source_of(job, root, folder, edits):
    """Steps that return the program's input (the scene itself, or in `folder` a copy made of links with Blender's edits and the current data set folder) and
    the report suffix of missing edits."""
    path = whereabouts.absolute_path(root)
    yield jobs.in_thread(native.load, path)
    cleaned = (
        (yield from cleaned_of(job, root, path, os.path.join(os.path.dirname(folder), "cleaned"))) if edits else ""
    )
    if not cleaned and (not os.path.isdir(path) or not (edits or root.pags.dataset)):
        return path, ""
    edited = Edited(bpy.context, root, cleaned)
    if edits:
        yield from edited.collect(job)
    return (yield jobs.in_thread(edited.write, folder, job)), edited.left_out()


def cleaned_of(job, root, path, folder):
    """Steps that write the scene after clean-up and look to `folder` and return its path; empty without clean-up."""
    rules = cleanup.edits_of(root, bpy.context.evaluated_depsgraph_get())
    if not rules:
        return ""
    job.tell(0, "clean-up and look")
    yield jobs.in_thread(native.module.write_edited, path, rules, folder)
    return folder


class PAGS_OT_save_edited(jobs.Long, cameras.OnScene, bpy.types.Operator):
    """Write the edited scene as a new scene folder for all pags commands"""

    bl_idname = "pags.save_edited"
    bl_label = "Save edited scene"

    directory: StringProperty(name="Folder", description="New folder for the scene", subtype="DIR_PATH")

    def invoke(self, context, event):
        self.by_hand = True
        context.window_manager.fileselect_add(self)
        return {"RUNNING_MODAL"}

    def steps(self, context, root):
        folder = bpy.path.abspath(self.directory)
        if not folder:
            raise native.SceneError("choose a folder for the scene")
        if os.path.exists(os.path.join(folder, "scene.json")):
            raise native.SceneError(f"{folder}: already contains a scene; choose another folder")
        path = whereabouts.absolute_path(root)

        def work(job):
            yield jobs.in_thread(native.load, path)
            with tempfile.TemporaryDirectory(prefix="pags-cleaned-") as beside:
                edited = Edited(
                    bpy.context, root, (yield from cleaned_of(job, root, path, os.path.join(beside, "cleaned")))
                )
                yield from edited.collect(job)
                yield jobs.in_thread(edited.write, folder, job)
            return f"{folder}: {reasons.count(len(edited.moved), 'object')} moved, {len(edited.gone)} removed{edited.left_out()}"

        return work


def menu(self, context):
    self.layout.operator(PAGS_OT_export.bl_idname, text="From PAGS scene (proxies, splats)")


MENUS = ((bpy.types.TOPBAR_MT_file_export, menu),)
