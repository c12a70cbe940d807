# SPDX-License-Identifier: GPL-3.0-or-later
"""Converts a scene to Blender's own splats: point clouds of the type GAUSSIAN_SPLAT, which Blender 5.3 draws in Cycles, EEVEE and the viewport.

Names, types and values of the attributes are those of Blender's PLY importer (blender/blender,
source/blender/io/ply/importer/ply_import_gsplat.cc and io/common/intern/IO_gsplat.cc at commit 082a5ac35773):

    position        FLOAT_VECTOR  metres
    scale           FLOAT_VECTOR  sigma, metres
    rotation        QUATERNION    w, x, y, z, of unit length
    radiance:base   FLOAT4        constant terms of the spherical harmonics; opacity, 0 to 1
    radiance:sh_N   FLOAT_VECTOR  further terms, N from 0, three channels each"""

import bpy
import numpy as np
from mathutils import Matrix

from . import cameras, native, whereabouts

NEEDED = (5, 3, 0)
MARK = "pags_native"  # custom property of a converted object: name of its source object


def missing():
    """Why this Blender has no native splats; empty if it has."""
    known = {p.identifier for p in bpy.types.PointCloud.bl_rna.properties} if hasattr(bpy.types, "PointCloud") else ()
    if "type" in known:
        return ""
    return f"native splats require Blender {NEEDED[0]}.{NEEDED[1]} or newer; this is {bpy.app.version_string}"


def attributes(arrays):
    """(name, type, key for foreach_set, values) of each attribute, for Gaussians from Scene.arrays."""
    rotation = arrays["quats"].astype(np.float64)
    length = np.linalg.norm(rotation, axis=1, keepdims=True)
    rotation = np.where(length > 0, rotation / np.where(length > 0, length, 1), [1.0, 0, 0, 0])
    opacity, sh = 1 / (1 + np.exp(-arrays["opacities"].astype(np.float64)))[:, None], arrays["sh"]
    found = [
        ("position", "FLOAT_VECTOR", "vector", arrays["means"]),
        ("scale", "FLOAT_VECTOR", "vector", np.exp(arrays["scales"].astype(np.float64))),
        ("rotation", "QUATERNION", "value", rotation),
        ("radiance:base", "FLOAT4", "vector", np.concatenate([sh[:, 0], opacity], axis=1)),
    ]
    found += [(f"radiance:sh_{k - 1}", "FLOAT_VECTOR", "vector", sh[:, k]) for k in range(1, sh.shape[1])]
    return [(*head, np.ascontiguousarray(values, dtype=np.float32)) for *head, values in found]


def make_cloud(name, arrays):
    """A point cloud of Gaussians."""
    cloud, count = bpy.data.pointclouds.new(name), len(arrays["means"])
    cloud.resize(count)
    cloud.type = "GAUSSIAN_SPLAT"
    for attribute, kind, key, values in attributes(arrays) if count else ():
        layer = cloud.attributes.get(attribute) or cloud.attributes.new(attribute, kind, "POINT")
        layer.data.foreach_set(key, values.reshape(-1))
    return cloud


def frame_of(entry, index):
    """4x4 pose, in an object's frame, of the coordinates of its means: those of parked objects are relative to the scene's origin."""
    if index < 0 or entry.objects[index]["tracked"]:
        return Matrix()
    pose = np.eye(4)
    pose[:3] = entry.track(index)[1][0]
    return Matrix(np.linalg.inv(pose).tolist())


def follow(converted, part):
    """Copies the part's visibility keyframes to the converted object."""
    for path in ("hide_viewport", "hide_render"):
        driver = converted.driver_add(path).driver
        driver.type = "AVERAGE"
        variable = driver.variables.new()
        variable.targets[0].id = part
        variable.targets[0].data_path = path


class PAGS_OT_native_splats(cameras.OnScene, bpy.types.Operator):
    """Convert the scene to Blender's own splats, one point cloud per object below its track, for Cycles, EEVEE and geometry nodes. PAGS still renders the
    scene"""

    bl_idname = "pags.native_splats"
    bl_label = "Convert to native splats"
    bl_options = {"REGISTER", "UNDO"}

    errors = (native.SceneError, RuntimeError, MemoryError)

    @classmethod
    def poll(cls, context):
        why = missing()
        if why:
            cls.poll_message_set(why)
            return False
        return True

    def work(self, context, root):
        entry = native.load(whereabouts.absolute_path(root))
        arrays = {name: np.asarray(values) for name, values in entry.scene.arrays().items()}
        owner = np.asarray(entry.scene.object_of)
        parts = [o for o in context.scene.objects if o.pags.kind in {"OBJECT", "BACKGROUND"} and o.pags.root == root]
        for old in [o for o in context.scene.objects if MARK in o and o.pags.root == root]:
            data = old.data
            bpy.data.objects.remove(old)
            if not data.users:
                bpy.data.pointclouds.remove(data)
        name = f"{root.name} native"
        collection = bpy.data.collections.get(name) or bpy.data.collections.new(name)
        home = root.users_collection[0] if root.users_collection else context.scene.collection
        if name not in home.children:
            home.children.link(collection)
        clouds, gaussians = {}, 0
        for part in parts:
            index = -1 if part.pags.kind == "BACKGROUND" else part.pags.index
            if index not in clouds:
                clouds[index] = make_cloud(part.name, {name: values[owner == index] for name, values in arrays.items()})
            cloud = clouds[index]
            converted = bpy.data.objects.new(f"{part.name} native", cloud)
            converted[MARK], converted.pags.root = part.name, root
            converted.parent, converted.matrix_parent_inverse = part.parent, part.matrix_parent_inverse
            converted.matrix_basis = part.matrix_basis @ frame_of(entry, index)
            follow(converted, part)
            collection.objects.link(converted)
            gaussians += len(cloud.points)
        return f"{len(parts)} point clouds with {gaussians:,} Gaussians in the collection {name}"
