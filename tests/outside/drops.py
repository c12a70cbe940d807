# SPDX-License-Identifier: Apache-2.0
"""blender -b -P drops.py -- SCENE.glb JOB.json FOUND.json: lets bodies fall on collision shapes in Blender's physics.

JOB.json has seconds (the time in the animation) and drops (name to {from, wheel}: a box of 0.4 m, or a wheel of radius
0.3 m and width 0.2 m, in glTF's world with y up, in metres). FOUND.json receives for each the height of the surface
below, hit by a ray, and of the body's lowest vertex after four seconds: a wheel may have fallen over, as a push of one
of the surface's edges suffices for that."""

import json
import math
import sys

import bpy
import numpy
from mathutils import Vector

FRAMES = 96  # at 24 per second
MARGIN = 0.005  # metres; at 0 wheels are kicked aside by inner edges


def add_body(thing, kind, shape):
    bpy.context.view_layer.objects.active = thing
    bpy.ops.rigidbody.object_add(type=kind)
    thing.rigid_body.collision_shape = shape
    thing.rigid_body.use_margin = True
    thing.rigid_body.collision_margin = MARGIN
    thing.rigid_body.friction = 0.8


def add_drop(drop):
    if drop["wheel"]:
        bpy.ops.mesh.primitive_cylinder_add(radius=0.3, depth=0.2, rotation=(math.pi / 2, 0, 0))
    else:
        bpy.ops.mesh.primitive_cube_add(size=0.4)
    body = bpy.context.object
    x, y, z = drop["from"]
    body.location = (x, -z, y)
    add_body(body, "ACTIVE", "CYLINDER" if drop["wheel"] else "BOX")
    return body


def main():
    source, job, out = sys.argv[sys.argv.index("--") + 1 :]
    with open(job) as file:
        job = json.load(file)
    numpy.bool = bool  # which the importer of Debian's Blender still names
    bpy.ops.wm.read_factory_settings(use_empty=True)
    bpy.ops.import_scene.gltf(filepath=source)
    scene = bpy.context.scene
    scene.frame_set(round(job["seconds"] * scene.render.fps))
    solids = [thing for thing in bpy.data.objects if thing.type == "MESH"]
    for thing in bpy.data.objects:  # they stay where they are now
        place = thing.matrix_basis.copy()
        thing.animation_data_clear()
        thing.matrix_basis = place
    scene.frame_set(1)
    bpy.ops.rigidbody.world_add()
    scene.rigidbody_world.substeps_per_frame = 20
    scene.rigidbody_world.solver_iterations = 20
    scene.rigidbody_world.point_cache.frame_end = FRAMES
    graph = bpy.context.evaluated_depsgraph_get()
    found = {"version": bpy.app.version_string, "drops": {}}
    for name, drop in job["drops"].items():
        x, y, z = drop["from"]
        hit, place, *_ = scene.ray_cast(graph, Vector((x, -z, y)), Vector((0, 0, -1)))
        found["drops"][name] = {"ground": place.z if hit else None}
    for thing in solids:
        add_body(thing, "PASSIVE", "CONVEX_HULL" if "_part" in thing.name else "MESH")
    bodies = {name: add_drop(drop) for name, drop in job["drops"].items()}
    for frame in range(1, FRAMES + 1):
        scene.frame_set(frame)
    graph = bpy.context.evaluated_depsgraph_get()
    for name, body in bodies.items():
        place = body.evaluated_get(graph).matrix_world
        found["drops"][name]["lowest"] = min((place @ vertex.co).z for vertex in body.data.vertices)
    with open(out, "w") as file:
        json.dump(found, file)


main()
