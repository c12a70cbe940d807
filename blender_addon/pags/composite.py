# SPDX-License-Identifier: GPL-3.0-or-later
"""A CG object in the street: the PAGS scene drawn in a linked second scene, Blender's meshes by Cycles or EEVEE over it
by depth, with proxies (or a plane for the road) that catch their shadows."""

import bpy
import numpy as np
from bpy.props import EnumProperty, FloatProperty

from . import cameras, curves, native

SECOND = "PAGS behind"
SLACK = 0.15  # share of the distance by which a mesh may lie behind the splats; 1.6 m above the road it is 0.25 m in height


def second_scene(scene, root):
    """A second Blender scene that links the PAGS collection, the camera and the timeline, and renders with PAGS."""
    second = bpy.data.scenes.get(SECOND) or bpy.data.scenes.new(SECOND)
    collections = [c for c in bpy.data.collections if root.name in c.objects]
    for collection in collections:
        if collection.name not in second.collection.children:
            second.collection.children.link(collection)
    second.camera = scene.camera
    if scene.camera is not None and second.objects.get(scene.camera.name) is None:
        second.collection.objects.link(scene.camera)
    copy_settings(scene, second)
    second.render.engine = "PAGS"
    second.view_layers[0].use_pass_z = True
    return second


def copy_settings(scene, second):
    for name in (
        "resolution_x",
        "resolution_y",
        "resolution_percentage",
        "pixel_aspect_x",
        "pixel_aspect_y",
        "fps",
        "fps_base",
    ):
        setattr(second.render, name, getattr(scene.render, name))
    second.frame_start, second.frame_end = scene.frame_start, scene.frame_end
    second.frame_set(scene.frame_current)
    for name in ("sh_degree", "antialiased", "threads", "hide_noncritical"):
        setattr(second.pags, name, getattr(scene.pags, name))


def eyes_of(entry):
    """Positions (n, 3) of the recording's cameras relative to the scene's origin, metres."""
    poses = np.array([v["world_from_camera"] for v in entry.scene.views]).reshape(-1, 3, 4)
    return poses[:, :, 3] - np.array(entry.info["origin"])


def road_height(entry):
    """Height of the road below the drive, relative to the scene's origin, metres: the mode of the heights of background Gaussians near and
    below the cameras. (A low percentile would lie under the road: 0.1 m in height at 9 m distance is 0.5 m along the ray.)"""
    points, eyes = np.array(entry.scene.points(-1, 200000)[0]).reshape(-1, 3), eyes_of(entry)
    if not len(eyes) or not len(points):
        return 0.0
    middle = np.median(eyes, axis=0)
    near = np.linalg.norm(points[:, :2] - middle[:2], axis=1) < 15
    below = points[near & (points[:, 2] < middle[2]), 2]
    if len(below) <= 10:
        return float(middle[2] - 1.6)
    counts, edges = np.histogram(below, bins=np.arange(below.min(), middle[2] + 0.05, 0.05))
    level = edges[np.argmax(counts)] + 0.025
    return float(np.median(below[np.abs(below - level) < 0.1]))


def shadow_plane(scene, root, entry):
    known = next((o for o in scene.objects if o.get("pags_catcher") == "road"), None)
    if known is not None:
        return known
    eyes = eyes_of(entry)
    low, high = (eyes.min(axis=0) - 40, eyes.max(axis=0) + 40) if len(eyes) else (np.full(3, -40), np.full(3, 40))
    z = road_height(entry)
    mesh = bpy.data.meshes.new("road")
    mesh.from_pydata(
        [(low[0], low[1], z), (high[0], low[1], z), (high[0], high[1], z), (low[0], high[1], z)], [], [(0, 1, 2, 3)]
    )
    plane = bpy.data.objects.new("road", mesh)
    plane["pags_catcher"] = "road"
    plane.parent = root
    plane.display_type = "WIRE"
    return plane


def use_catchers(scene, root, entry):
    """Puts the meshes that catch shadows (proxies where there are any, else a plane for the road) into a collection of the first scene; returns them."""
    proxies = [o for o in scene.objects if o.get("pags_proxy") and o.type == "MESH"]
    collection = bpy.data.collections.get("PAGS shadow catchers") or bpy.data.collections.new("PAGS shadow catchers")
    if collection.name not in scene.collection.children:
        scene.collection.children.link(collection)
    catchers = proxies or [shadow_plane(scene, root, entry)]
    for block in catchers:
        if collection.objects.get(block.name) is None:
            collection.objects.link(block)
        block.is_shadow_catcher = True
        block.hide_render = False
        follow_visibility(scene, block)
    return catchers


def follow_visibility(scene, proxy):
    """Gives an object's proxy the visibility keyframes of its object, so that it catches no shadow where the object isn't drawn."""
    part = next((o for o in scene.objects if o.pags.kind == "OBJECT" and o.parent == proxy.parent), None)
    if proxy.parent is None or proxy.parent.pags.kind != "TRACK" or part is None:
        return
    proxy.hide_render = part.hide_render
    if part.animation_data is None or part.animation_data.action is None:
        return
    curve = curves.fcurve_owner(part).find("hide_render")
    if curve is not None:
        keys = [key.co for key in curve.keyframe_points]
        curves.set_curve(proxy, "hide_render", 0, [k[0] for k in keys], [k[1] for k in keys], "CONSTANT")


def hide_splats(scene, root):
    """Hides the splats' preview points from the renders of the first scene: the second scene renders the splats."""
    for part in scene.objects:
        if part.pags.kind in {"BACKGROUND", "OBJECT"} and part.pags.root == root and len(part.users_collection) > 0:
            part.visible_camera = part.visible_shadow = part.visible_diffuse = part.visible_glossy = False


def node_tree(scene):
    """The compositor's node tree, emptied, and its output node."""
    if hasattr(scene, "compositing_node_group"):  # 5.x
        tree = bpy.data.node_groups.new("PAGS composite", "CompositorNodeTree")
        scene.compositing_node_group = tree
        tree.interface.new_socket(name="Image", in_out="OUTPUT", socket_type="NodeSocketColor")
        return tree, tree.nodes.new("NodeGroupOutput")
    scene.use_nodes = True
    tree = scene.node_tree
    tree.nodes.clear()
    return tree, tree.nodes.new("CompositorNodeComposite")


def math_node(tree, operation, first, second):
    try:
        node = tree.nodes.new("CompositorNodeMath")
    except RuntimeError:
        node = tree.nodes.new("ShaderNodeMath")  # 5.x
    node.operation = operation
    for socket, value in zip(node.inputs, (first, second)):
        if hasattr(value, "links"):
            tree.links.new(value, socket)
        else:
            socket.default_value = value
    return node.outputs[0]


def alpha_over(tree, behind, front):
    node = tree.nodes.new("CompositorNodeAlphaOver")
    if "Background" in node.inputs:  # 5.x names them
        tree.links.new(behind, node.inputs["Background"])
        tree.links.new(front, node.inputs["Foreground"])
    else:
        tree.links.new(behind, node.inputs[1])
        tree.links.new(front, node.inputs[2])
    return node.outputs[0]


def multiply(tree, share, picture, by):
    """picture * (1 + share (by - 1))"""
    try:
        node = tree.nodes.new("CompositorNodeMixRGB")
        inputs, out = node.inputs, node.outputs[0]
    except RuntimeError:
        node = tree.nodes.new("ShaderNodeMix")  # 5.x; its sockets for colours are the last of three kinds
        node.data_type = "RGBA"
        inputs = [node.inputs[0]] + [socket for socket in node.inputs if socket.type == "RGBA"]
        out = next(socket for socket in node.outputs if socket.type == "RGBA")
    node.blend_type = "MULTIPLY"
    for source, socket in zip((share, picture, by), inputs):
        tree.links.new(source, socket)
    return out


def build_nodes(scene, second, tolerance):
    """Builds the compositor's nodes: the street, darkened by the shadows on the catchers, and over it the meshes wherever they are no more than
    `tolerance` metres behind the street's surface. A catcher may lie further behind, by SLACK of the distance: what is seen at grazing angles and off by
    centimetres in height is off by metres along the ray. Anything that stands well before the catcher takes no shadow from it."""
    tree, out = node_tree(scene)
    front, behind = tree.nodes.new("CompositorNodeRLayers"), tree.nodes.new("CompositorNodeRLayers")
    front.scene, behind.scene = scene, second
    excess = math_node(tree, "SUBTRACT", front.outputs["Depth"], behind.outputs["Depth"])
    street = behind.outputs["Image"]
    shadow = next((o for o in front.outputs if o.name == "Shadow Catcher" and o.enabled), None)
    if shadow is not None:
        reach = math_node(tree, "ADD", math_node(tree, "MULTIPLY", behind.outputs["Depth"], SLACK), tolerance)
        street = multiply(tree, math_node(tree, "LESS_THAN", excess, reach), street, shadow)
    masked = tree.nodes.new("CompositorNodeSetAlpha")
    mode = masked.inputs.get("Type")
    if mode is not None:
        mode.default_value = "Apply Mask"
    else:
        masked.mode = "APPLY"
    tree.links.new(front.outputs["Image"], masked.inputs["Image"])
    tree.links.new(math_node(tree, "LESS_THAN", excess, tolerance), masked.inputs["Alpha"])
    tree.links.new(alpha_over(tree, street, masked.outputs[0]), out.inputs[0])
    for x, node in enumerate(tree.nodes):
        node.location = (200 * (x % 4), -250 * (x // 4))
    return tree


class PAGS_OT_composite(cameras.OnScene, bpy.types.Operator):
    """Set up F12 so that this file's meshes, rendered by Cycles or EEVEE, stand in the PAGS scene with their shadows on the road"""

    bl_idname = "pags.composite"
    bl_label = "Composite with Cycles/EEVEE"
    bl_options = {"REGISTER", "UNDO"}

    engine: EnumProperty(
        name="Meshes by",
        description="What renders this file's meshes",
        items=[
            ("CYCLES", "Cycles", "Catches shadows and hides by depth"),
            ("EEVEE", "EEVEE", "Hides by depth; EEVEE catches no shadows"),
        ],
    )
    tolerance: FloatProperty(
        name="Tolerance",
        description="Metres that a mesh may be behind the splats and still be seen",
        default=0.3,
        min=0,
        unit="LENGTH",
    )

    errors = (native.SceneError, TypeError, AttributeError)

    def work(self, context, root):
        scene = context.scene
        if scene.camera is None:
            raise native.SceneError("there is no camera in the scene")
        entry = native.load(native.absolute_path(root))
        if self.engine == "CYCLES":
            scene.render.engine = "CYCLES"
        else:
            names = {item.identifier for item in bpy.types.RenderSettings.bl_rna.properties["engine"].enum_items}
            scene.render.engine = "BLENDER_EEVEE_NEXT" if "BLENDER_EEVEE_NEXT" in names else "BLENDER_EEVEE"
        scene.render.film_transparent = True
        scene.render.use_compositing = True
        context.view_layer.use_pass_z = True
        second = second_scene(scene, root)
        hide_splats(scene, root)
        if self.engine == "CYCLES":
            use_catchers(scene, root, entry)
            context.view_layer.cycles.use_pass_shadow_catcher = True
        build_nodes(scene, second, self.tolerance)


CLASSES = (PAGS_OT_composite,)

register, unregister = bpy.utils.register_classes_factory(CLASSES)
