# SPDX-License-Identifier: GPL-3.0-or-later
"""Imports proxy meshes, shown as wire: those of objects on their tracks, ground and background below the root. The source is a .glb from `pags export`
(docs/export.md), read here: Blender's own importer takes seconds of the main thread and changes the axes."""

import collections
import json
import os
import re
import struct
import tempfile

import bpy
import numpy as np
from bpy.props import EnumProperty, StringProperty

from . import cameras, exporter, jobs, native, program, reasons, ui

COMPONENTS = {5121: "<u1", 5123: "<u2", 5125: "<u4", 5126: "<f4"}  # of glTF 2.0, section 3.6.2
WIDTHS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4}


def make(job, root, command, level="mesh"):
    """Steps that run `pags export` and add the proxies to the scene."""
    with tempfile.TemporaryDirectory(prefix="pags-proxies-") as folder:
        source, _ = yield from exporter.source_of(job, root, os.path.join(folder, "scene"), False)
        path = os.path.join(folder, "proxies.glb")
        yield jobs.in_thread(program.run, job, command, "export", source, path, "--proxy", level)
        return (yield from bring_in(job, root, path))


# ---- Reading ----


# A mesh of the file: name, object index (-1: none), vertices, triangles, linear colours, whether it has normals.
Proxy = collections.namedtuple("Proxy", "name index points triangles colors smooth")


def read(path):
    """The proxies of a .glb from `pags export`; raises SceneError for other files."""
    try:
        with open(path, "rb") as file:
            data = file.read()
    except OSError as error:
        raise native.SceneError(f"{path}: {error.strerror}") from error
    try:
        magic, version, _, size, kind = struct.unpack_from("<4sIII4s", data)
        if (magic, version, kind) != (b"glTF", 2, b"JSON"):
            raise ValueError("not a .glb of version 2")
        gltf = json.loads(data[20 : 20 + size])
        return list(proxies_of(gltf, memoryview(data)[28 + size :]))
    except (ValueError, KeyError, IndexError, TypeError, struct.error) as error:
        raise native.SceneError(f"{path}: expected a .glb of proxies as pags export writes it: {error}") from error


def proxies_of(gltf, buffer):
    """Each mesh below the scene's nodes. Vertices of an object's proxy are in the object's frame, others relative to the scene's origin."""
    waiting = [(node, -1) for node in reversed(gltf["scenes"][0]["nodes"])]
    while waiting:
        number, index = waiting.pop()
        node = gltf["nodes"][number]
        named = re.search(r"_(\d{4,})$", node["name"])
        if named and "moving" in node.get("extras", {}):  # an object is named like car_0007
            index = int(named.group(1))
        if "mesh" in node:
            (primitive,) = gltf["meshes"][node["mesh"]]["primitives"]
            attributes = primitive["attributes"]
            if "COLOR_0" not in attributes:
                raise ValueError("it has textures; export it without --texture")
            colors = values_of(gltf, buffer, attributes["COLOR_0"]) / np.float32(65535)
            triangles = values_of(gltf, buffer, primitive["indices"]).astype(np.int32).reshape(-1, 3)
            points = values_of(gltf, buffer, attributes["POSITION"])
            yield Proxy(node["name"], index, points, triangles, colors, "NORMAL" in attributes)
        waiting += [(child, index) for child in reversed(node.get("children", []))]


def values_of(gltf, buffer, accessor):
    found = gltf["accessors"][accessor]
    view = gltf["bufferViews"][found["bufferView"]]
    width = WIDTHS[found["type"]]
    kind, count = COMPONENTS[found["componentType"]], found["count"] * width
    values = np.frombuffer(buffer, kind, count, view.get("byteOffset", 0))
    return values.reshape(found["count"], width)


# ---- Blender's meshes ----


def bring_in(job, root, path):
    """Steps that add the proxies of a file to the scene."""
    found = yield jobs.in_thread(read, path)
    collection, material = collection_for(root), material_for()
    tracks = {o.pags.index: o for o in bpy.context.scene.objects if o.pags.kind == "TRACK" and o.pags.root == root}
    job.changes = True
    found = [proxy for proxy in found if proxy.index < 0 or proxy.index in tracks]  # others are deleted here
    for number, proxy in enumerate(found):
        add(proxy, tracks.get(proxy.index, root), collection, material)
        job.tell((number + 1) / len(found), "adding meshes")
        yield
    return f"{len(found)} proxies in the collection {collection.name}"


def collection_of(root):
    """The collection of proxies below the scene's collection, or None."""
    own = root.users_collection[0] if root.users_collection else None
    return own.children.get(f"{own.name} proxies") if own is not None else None


def collection_for(root):
    """The collection of proxies; created if missing."""
    known, own = collection_of(root), root.users_collection[0]
    if known is None:
        known = bpy.data.collections.new(f"{own.name} proxies")
        own.children.link(known)
    return known


def material_for():
    """The material of all proxies: their vertex colours."""
    known = bpy.data.materials.get("PAGS proxy")
    if known is not None:
        return known
    material = bpy.data.materials.new("PAGS proxy")
    material.use_nodes = True
    nodes = material.node_tree.nodes
    colors = nodes.new("ShaderNodeVertexColor")
    colors.layer_name = "Col"
    material.node_tree.links.new(colors.outputs["Color"], nodes["Principled BSDF"].inputs["Base Color"])
    return material


def add(proxy, parent, collection, material):
    mesh = bpy.data.meshes.new(proxy.name)
    count = len(proxy.triangles)
    mesh.vertices.add(len(proxy.points))
    mesh.vertices.foreach_set("co", proxy.points.reshape(-1))
    mesh.loops.add(3 * count)
    mesh.loops.foreach_set("vertex_index", proxy.triangles.reshape(-1))
    mesh.polygons.add(count)
    mesh.polygons.foreach_set("loop_start", np.arange(0, 3 * count, 3, dtype=np.int32))
    if bpy.app.version < (4, 1, 0):  # later versions derive it from the starts
        mesh.polygons.foreach_set("loop_total", np.full(count, 3, dtype=np.int32))
    mesh.polygons.foreach_set("use_smooth", np.full(count, proxy.smooth, dtype=bool))
    attribute = mesh.attributes.new("Col", "FLOAT_COLOR", "POINT")
    attribute.data.foreach_set("color", np.ascontiguousarray(proxy.colors, dtype=np.float32).reshape(-1))
    mesh.materials.append(material)
    mesh.update(calc_edges=True)
    block = bpy.data.objects.new(proxy.name, mesh)
    collection.objects.link(block)
    block.parent = parent
    block["pags_proxy"] = True
    block.hide_render, block.display_type = True, "WIRE"


class PAGS_OT_import_proxies(jobs.Long, cameras.OnScene, bpy.types.Operator):
    """Import proxy meshes, shown as wire, on the tracks of their objects"""

    bl_idname = "pags.import_proxies"
    bl_label = "Import proxies"

    filepath: StringProperty(
        name="File",
        description="A .glb with proxies; empty: create them with the pags program, which takes a while",
        subtype="FILE_PATH",
        default="",
    )
    level: EnumProperty(name="Proxies", description="Kind of proxies that the program creates", items=exporter.LEVELS)

    def steps(self, context, root):
        if self.filepath:
            path = bpy.path.abspath(self.filepath)
            return lambda job: bring_in(job, root, path)
        command, level = exporter.proxy_program(context), self.level
        return lambda job: make(job, root, command, level)


class PAGS_OT_rigid_bodies(cameras.OnScene, bpy.types.Operator):
    """Make all proxies passive rigid bodies, so that other bodies fall on the road and are pushed by driving cars"""

    bl_idname = "pags.rigid_bodies"
    bl_label = "Make rigid bodies"
    bl_options = {"REGISTER", "UNDO"}

    def work(self, context, root):
        collection = collection_of(root)
        meshes = [o for o in collection.objects if o.type == "MESH"] if collection is not None else []
        if not meshes:
            raise native.SceneError("the scene has no proxies yet; import them first")
        if context.scene.rigidbody_world is None:
            bpy.ops.rigidbody.world_add()
        new = [o for o in meshes if o.rigid_body is None]
        if new:
            with context.temp_override(object=new[0], active_object=new[0], selected_objects=new):
                bpy.ops.rigidbody.objects_add(type="PASSIVE")
        for block in meshes:
            body = block.rigid_body
            body.type, body.collision_shape, body.mesh_source = "PASSIVE", "MESH", "BASE"
            body.kinematic = block.parent is not None and block.parent.pags.kind == "TRACK"  # follows its keyframes
        return f"passive rigid bodies: {len(meshes)}"


class PAGS_PT_proxies(ui.OfScene, bpy.types.Panel):
    bl_label = "Proxies"
    bl_order = 7
    bl_options = {"DEFAULT_CLOSED"}

    def draw(self, context):
        layout, lacking, collection = self.layout, program.lacking(context), collection_of(cameras.root_of(context))
        ui.where(layout, lacking).operator_menu_enum("pags.import_proxies", "level", icon="MESH_DATA")
        if lacking:
            reasons.explain(layout, lacking)
        if collection is not None:
            layout.prop(collection, "hide_viewport", text="Hide proxies")
            layout.operator("pags.rigid_bodies", icon="RIGID_BODY")
