# SPDX-License-Identifier: GPL-3.0-or-later
"""Draws Blender's meshes in the Rendered viewport, by depth with the splats, in their materials' base colour under a plain light: a preview of what the composite
of F12 puts there."""

import bpy
import gpu
import numpy as np
from gpu_extras.batch import batch_for_shader
from mathutils import Matrix

from . import draw, gather, lens

DRAWN = {"MESH", "CURVE", "SURFACE", "META", "FONT"}
VERTEX = """
void main() {
  lit = normalize(mat3(turn) * normal);
  paint = shade;
  gl_Position = clip * vec4(pos, 1.0);
}
"""
FRAGMENT = """
void main() {
  float light = 0.35 + 0.65 * abs(dot(normalize(lit), normalize(vec3(0.3, 0.5, 0.8))));
  color = vec4(paint.rgb * light, 1.0);
}
"""
_meshes = {}  # by name of the object: arrays of a mesh
_batches = {}  # by name of the object: batch
_made = {}


def forget():
    for kept in (_meshes, _batches, _made):
        kept.clear()


def changed(depsgraph):
    """Drops what a change of the file outdates; without a graph, after a change of the frame, what may be deformed."""
    if depsgraph is None:
        outdated = [name for name, arrays in _meshes.items() if arrays["deforms"]]
    else:
        outdated = [u.id.original.name_full for u in depsgraph.updates if u.is_updated_geometry]
        if any(isinstance(u.id, bpy.types.Material) for u in depsgraph.updates):
            outdated = list(_meshes)
    for name in outdated:
        _meshes.pop(name, None)
        _batches.pop(name, None)


def base_color(material):
    """Linear base colour of a material, four numbers."""
    if material is None:
        return (0.8, 0.8, 0.8, 1.0)
    nodes = material.node_tree.nodes if material.node_tree is not None else ()
    found = next((n for n in nodes if n.bl_idname == "ShaderNodeBsdfPrincipled"), None)
    return tuple(found.inputs["Base Color"].default_value if found is not None else material.diffuse_color)


def arrays_of(block):
    """Positions, normals and colours of the corners of an evaluated object's triangles; None without any."""
    mesh = block.to_mesh()
    if mesh is None:
        return None
    mesh.calc_loop_triangles()
    count = len(mesh.loop_triangles)
    corners, vertices, slots = (np.empty(n, dtype=np.int32) for n in (3 * count, 3 * count, count))
    mesh.loop_triangles.foreach_get("loops", corners)
    mesh.loop_triangles.foreach_get("vertices", vertices)
    mesh.loop_triangles.foreach_get("material_index", slots)
    points, normals = (np.empty(3 * n, dtype=np.float32) for n in (len(mesh.vertices), len(mesh.loops)))
    mesh.vertices.foreach_get("co", points)
    if hasattr(mesh, "corner_normals"):  # from Blender 4.1 on
        mesh.corner_normals.foreach_get("vector", normals)
    else:
        mesh.calc_normals_split()
        mesh.loops.foreach_get("normal", normals)
    materials = [slot.material for slot in block.material_slots] or [None]
    colors = np.array([base_color(material) for material in materials], dtype=np.float32)
    block.to_mesh_clear()
    if count == 0:
        return None
    return {
        "pos": points.reshape(-1, 3)[vertices],
        "normal": normals.reshape(-1, 3)[corners],
        "shade": colors[np.minimum(np.repeat(slots, 3), len(colors) - 1)],
    }


def collect(depsgraph, hidden):
    """(name of the object, world matrix) of the meshes to draw; reads those that are new."""
    found = []
    for instance in gather.instances(depsgraph, hidden):
        block, original = instance.object, instance.object.original
        if block.type not in DRAWN or original.pags.kind != "NONE" or original.hide_render:
            continue
        if original.display_type in {"WIRE", "BOUNDS"} or "pags_lidar" in original:
            continue
        name = original.name_full
        if name not in _meshes:
            arrays = arrays_of(block)
            _meshes[name] = {"deforms": len(original.modifiers) > 0, "arrays": arrays}
        if _meshes[name]["arrays"] is not None:
            found.append((name, lens.matrix(instance.matrix_world)))
    return found


def shader():
    if "shader" not in _made:
        inputs, between = [("VEC3", "pos"), ("VEC3", "normal"), ("VEC4", "shade")], [("VEC3", "lit"), ("VEC4", "paint")]
        constants = [("MAT4", "clip"), ("MAT4", "turn")]
        _made["shader"] = draw.compiled("meshes", VERTEX, FRAGMENT, inputs, between, constants)
    return _made["shader"]


def show(context, found):
    """Draws them over a picture of the splats that has written its depth."""
    view, program = context.region_data, shader()
    gpu.state.depth_test_set("LESS_EQUAL")
    gpu.state.depth_mask_set(True)
    program.bind()
    for name, matrix in found:
        if name not in _batches:
            _batches[name] = batch_for_shader(program, "TRIS", _meshes[name]["arrays"])
        turn = np.eye(4)
        turn[:3, :3] = np.linalg.inv(lens.matrix(view.view_matrix)[:3, :3] @ matrix[:3, :3]).T
        program.uniform_float("clip", Matrix((lens.matrix(view.perspective_matrix) @ matrix).tolist()))
        program.uniform_float("turn", Matrix(turn.tolist()))
        _batches[name].draw(program)
    gpu.state.depth_mask_set(False)
    gpu.state.depth_test_set("NONE")
