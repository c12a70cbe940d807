# SPDX-License-Identifier: GPL-3.0-or-later
"""Imports proxy meshes as hidden objects: proxies of objects on their tracks, ground and background below the root."""

import os
import re
import tempfile

import bpy
import numpy as np
from bpy.props import EnumProperty, StringProperty
from mathutils import Matrix

from . import cameras, exporter, native

# Blender's importer converts every mesh from glTF's y up: (x, y, z) becomes (x, -z, y). The vertices in the file are in the recording's axes
# (the node "scene" rotates them all); this matrix restores those axes.
OWN_AXES = Matrix(((1, 0, 0, 0), (0, 0, 1, 0), (0, -1, 0, 0), (0, 0, 0, 1)))


def make(context, root, level="mesh"):
    """Runs `pags export` and imports its proxies (takes a while). Returns the meshes."""
    with tempfile.TemporaryDirectory(prefix="pags-proxies-") as folder:
        path = os.path.join(folder, "proxies.glb")
        exporter.run_program(context, "export", native.absolute_path(root), path, "--proxy", level)
        return bring_in(context, root, path)


def bring_in(context, root, path):
    if "bool" not in vars(np):
        np.bool = bool  # Blender 3.4's glTF importer uses np.bool, which newer numpy lacks
    if not hasattr(bpy.types, "IMPORT_SCENE_OT_gltf"):
        raise native.SceneError("Blender's glTF importer isn't enabled (Preferences > Add-ons)")
    if not os.path.exists(path):
        raise native.SceneError(f"{path}: there is no such file")
    before, actions = set(bpy.data.objects), set(bpy.data.actions)
    scene = context.scene
    range_before = scene.frame_start, scene.frame_end
    bpy.ops.import_scene.gltf(filepath=path)
    scene.frame_start, scene.frame_end = range_before
    made = [o for o in bpy.data.objects if o not in before]
    meshes = [o for o in made if o.type == "MESH"]
    collection = collection_for(root)
    places = [(mesh, *place_of(context, root, mesh)) for mesh in meshes]
    for mesh, parent, matrix in places:
        keep(mesh, parent, matrix, collection)
    for block in made:
        if block.type != "MESH":
            bpy.data.objects.remove(block)
    for action in set(bpy.data.actions) - actions:
        if action.users == 0:
            bpy.data.actions.remove(action)
    return meshes


def collection_for(root):
    """The collection of proxies below the scene's collection; created where missing."""
    own = root.users_collection[0]
    name = f"{own.name} proxies"
    known = next((c for c in own.children if c.name == name), None)
    if known is None:
        known = bpy.data.collections.new(name)
        own.children.link(known)
    return known


def place_of(context, root, mesh):
    """(parent, matrix relative to it) of a mesh: an object's proxy on the object's track, others below the root."""
    matrix, node = Matrix(), mesh
    while node is not None:
        track = track_of(context, root, node)
        if track is not None:
            return track, OWN_AXES @ matrix
        if node.name.split(".")[0] == "scene" and node.parent is None:
            break
        matrix = node.matrix_local @ matrix
        node = node.parent
    return root, OWN_AXES @ matrix


def track_of(context, root, node):
    """The track of the object that a glTF node represents, or None. Such a node is named like `car_0007` and has the extra `moving`."""
    number = re.search(r"_(\d{4,})(\.\d{3})?$", node.name)
    if number is None or "moving" not in node:
        return None
    return next(
        (
            o
            for o in context.scene.objects
            if o.pags.kind == "TRACK" and o.pags.root == root and o.pags.index == int(number.group(1))
        ),
        None,
    )


def keep(mesh, parent, matrix, collection):
    mesh.animation_data_clear()
    mesh.parent = parent
    mesh.matrix_parent_inverse.identity()
    mesh.matrix_basis = matrix
    for other in list(mesh.users_collection):
        other.objects.unlink(mesh)
    collection.objects.link(mesh)
    mesh["pags_proxy"] = True
    mesh.hide_render = True
    mesh.hide_set(True)


class PAGS_OT_import_proxies(cameras.OnScene, bpy.types.Operator):
    """Bring the exporter's proxies in as hidden meshes on their objects' tracks"""

    bl_idname = "pags.import_proxies"
    bl_label = "Import proxies"
    bl_options = {"REGISTER", "UNDO"}

    filepath: StringProperty(
        name="File",
        description="A .glb of proxies; empty: made now by the pags program, which takes a while",
        subtype="FILE_PATH",
        default="",
    )
    level: EnumProperty(name="Proxies", description="What the program is to make", items=exporter.LEVELS)

    errors = (native.SceneError, OSError, RuntimeError)

    def work(self, context, root):
        if self.filepath:
            made = bring_in(context, root, bpy.path.abspath(self.filepath))
        else:
            made = make(context, root, self.level)
        return f"{len(made)} proxies"


CLASSES = (PAGS_OT_import_proxies,)

register, unregister = bpy.utils.register_classes_factory(CLASSES)
