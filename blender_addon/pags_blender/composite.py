# SPDX-License-Identifier: GPL-3.0-or-later
"""Composites CG objects into the street: a linked second Blender scene renders the splats with PAGS, and Cycles or EEVEE renders Blender's meshes, merged by
depth. Proxies, or a plane for the road, catch shadows; the recording's surroundings light the meshes."""

import json

import bpy
import numpy as np
from bpy.props import BoolProperty, EnumProperty, FloatProperty

from . import cameras, curves, jobs, lens, light, native, sun, whereabouts

SECOND = "PAGS street"
CATCHERS, GREY = "PAGS shadow catchers", "PAGS road"  # names of the collection, and of the plane's material
BEFORE = "pags_before"  # custom property of a scene with a composite: its settings before, as JSON
MINE = "pags_composite"  # marks our nodes in the compositor
SAMPLES = {True: 64, False: 128}  # Cycles samples with and without a denoiser; Blender's 4096 take hours on a CPU
SLACK = 0.15  # fraction of the distance by which a mesh may lie behind the splats; seen from 1.6 m above the road it is 0.25 m in height


def second_scene(scene):
    """Creates a second Blender scene that links the collections of all PAGS scenes, the camera and the timeline, and renders with PAGS."""
    second = bpy.data.scenes.get(SECOND) or bpy.data.scenes.new(SECOND)
    roots = [o.name for o in scene.objects if o.pags.kind == "ROOT"]
    collections = [c for c in bpy.data.collections if any(name in c.objects for name in roots)]
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
    for name in "resolution_x resolution_y resolution_percentage pixel_aspect_x pixel_aspect_y fps fps_base".split():
        setattr(second.render, name, getattr(scene.render, name))
    second.frame_start, second.frame_end = scene.frame_start, scene.frame_end
    second.frame_set(scene.frame_current)
    for name in ("sh_degree", "antialiased", "threads", "hide_noncritical", "use_background", "background"):
        setattr(second.pags, name, getattr(scene.pags, name))


def shadow_plane(scene, root, eyes, z):
    known = next((o for o in scene.objects if o.get("pags_catcher") == "road"), None)
    if known is not None:
        return known
    low, high = (eyes.min(axis=0) - 40, eyes.max(axis=0) + 40) if len(eyes) else (np.full(3, -40), np.full(3, 40))
    mesh = bpy.data.meshes.new("road")
    mesh.from_pydata(
        [(low[0], low[1], z), (high[0], low[1], z), (high[0], high[1], z), (low[0], high[1], z)], [], [(0, 1, 2, 3)]
    )
    grey = bpy.data.materials.get(GREY) or bpy.data.materials.new(GREY)  # a white road would bleach the meshes' sides
    grey.use_nodes = True
    grey.node_tree.nodes["Principled BSDF"].inputs["Base Color"].default_value = (0.15, 0.15, 0.15, 1)
    mesh.materials.append(grey)
    plane = bpy.data.objects.new("road", mesh)
    plane["pags_catcher"] = "road"
    plane.parent = root
    plane.display_type = "WIRE"
    return plane


def use_catchers(scene, root, eyes, z):
    """Collects the shadow catchers (the proxies, else a plane for the road) in a collection of the first scene; returns them."""
    proxies = [o for o in scene.objects if o.get("pags_proxy") and o.type == "MESH"]
    collection = bpy.data.collections.get(CATCHERS) or bpy.data.collections.new(CATCHERS)
    if collection.name not in scene.collection.children:
        scene.collection.children.link(collection)
    catchers = proxies or [shadow_plane(scene, root, eyes, z)]
    for block in catchers:
        if collection.objects.get(block.name) is None:
            collection.objects.link(block)
        block.is_shadow_catcher = True
        block.hide_render = False
        follow_visibility(scene, block)
    return catchers


def follow_visibility(scene, proxy):
    """Copies an object's visibility keyframes to its proxy, so that hidden objects cast no shadow."""
    part = next((o for o in scene.objects if o.pags.kind == "OBJECT" and o.parent == proxy.parent), None)
    if proxy.parent is None or proxy.parent.pags.kind != "TRACK" or part is None:
        return
    proxy.hide_render = part.hide_render
    for curve in (c for c in curves.all_of(part) if c.data_path == "hide_render"):
        keys = [key.co for key in curve.keyframe_points]
        curves.set_curve(proxy, "hide_render", 0, [k[0] for k in keys], [k[1] for k in keys], "CONSTANT")


def show_splats(scene, shown):
    """Shows the preview points in renders of the first scene or not: the second scene renders the splats."""
    for part in scene.objects:
        if part.pags.kind in {"BACKGROUND", "OBJECT"} and len(part.users_collection) > 0:
            part.visible_camera = part.visible_shadow = part.visible_diffuse = part.visible_glossy = shown


def use_samples(scene):
    """Sets samples and denoising so that Cycles ends within minutes. Debian's Blender has no OpenImageDenoise, and Cycles fails if that is selected. Samples
    set by the user stay."""
    try:
        import _cycles

        denoises = bool(getattr(_cycles, "with_openimagedenoise", False))
    except ImportError:
        denoises = False
    if not scene.cycles.is_property_set("samples"):
        scene.cycles.samples = SAMPLES[denoises]
    if not denoises:
        scene.cycles.use_denoising = False


# ---- The compositor ----


def node_tree(scene):
    """The compositor's node tree; created if missing."""
    if hasattr(scene, "compositing_node_group"):  # 5.x
        tree = scene.compositing_node_group
        if tree is None:
            tree = scene.compositing_node_group = bpy.data.node_groups.new("PAGS composite", "CompositorNodeTree")
            tree.interface.new_socket(name="Image", in_out="OUTPUT", socket_type="NodeSocketColor")
        return tree
    scene.use_nodes = True
    return scene.node_tree


def output_of(tree, scene):
    """The tree's output node; created if missing."""
    kind = "NodeGroupOutput" if hasattr(scene, "compositing_node_group") else "CompositorNodeComposite"
    known = [node for node in tree.nodes if node.bl_idname == kind]
    active = [node for node in known if getattr(node, "is_active_output", True)]
    return (active + known or [tree.nodes.new(kind)])[0]


def take_over(tree, scene):
    """Removes the nodes of an earlier call. Returns the inputs to connect to the composite: those of the removed nodes, and those of the scene's own Render
    Layers node. The user's nodes and links stay."""
    mine = [node for node in tree.nodes if MINE in node]
    outputs = [output for node in mine for output in node.outputs]
    outputs += [node.outputs["Image"] for node in layers_of(tree, scene)]
    fed = [link.to_socket for output in outputs for link in output.links if MINE not in link.to_node]
    out = output_of(tree, scene)
    if not out.inputs[0].is_linked and out.inputs[0] not in fed:
        fed.append(out.inputs[0])
    for node in mine:
        tree.nodes.remove(node)
    return fed


def layers_of(tree, scene):
    """The user's Render Layers nodes of the scene."""
    return [n for n in tree.nodes if n.bl_idname == "CompositorNodeRLayers" and MINE not in n and n.scene == scene]


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
    newer = "Background" in node.inputs  # names of 5.x
    tree.links.new(behind, node.inputs["Background" if newer else 1])
    tree.links.new(front, node.inputs["Foreground" if newer else 2])
    return node.outputs[0]


def multiply(tree, share, picture, by):
    """picture * (1 + share (by - 1))"""
    try:
        node = tree.nodes.new("CompositorNodeMixRGB")
        inputs, out = node.inputs, node.outputs[0]
    except RuntimeError:
        node = tree.nodes.new("ShaderNodeMix")  # 5.x; its colour sockets are the last of three types
        node.data_type = "RGBA"
        inputs = [node.inputs[0]] + [socket for socket in node.inputs if socket.type == "RGBA"]
        out = next(socket for socket in node.outputs if socket.type == "RGBA")
    node.blend_type = "MULTIPLY"
    for source, socket in zip((share, picture, by), inputs):
        tree.links.new(source, socket)
    return out


def at_edges(tree, depth):
    """The depths of the meshes, and in empty pixels that of the nearest mesh next to them: the meshes' smooth edges cover a part of those pixels."""
    nearest = tree.nodes.new("CompositorNodeDilateErode")
    if "Size" in nearest.inputs:  # 5.x
        nearest.inputs["Size"].default_value = -1
    else:
        nearest.mode, nearest.distance = "STEP", -1
    tree.links.new(depth, nearest.inputs["Mask"])
    empty = math_node(tree, "GREATER_THAN", depth, 1e9)
    off = math_node(tree, "SUBTRACT", nearest.outputs[0], math_node(tree, "MINIMUM", depth, 1e9))
    return math_node(tree, "ADD", math_node(tree, "MINIMUM", depth, 1e9), math_node(tree, "MULTIPLY", empty, off))


def smooth(tree, mask):
    """A mask without steps at its edges."""
    node = tree.nodes.new("CompositorNodeAntiAliasing")
    tree.links.new(mask, node.inputs[0])
    return node.outputs[0]


def build_nodes(scene, second, layer, tolerance):
    """Builds the compositor's nodes: the street, darkened by the shadows on the catchers, and over it the meshes that are at most `tolerance` metres behind
    the street's surface. A catcher may lie SLACK times the distance further behind: at grazing angles an error of centimetres in height is metres along the
    ray. Objects well in front of the catcher take no shadow from it. The result replaces the scene's Render Layers node, so that the user's own nodes still
    work. Returns false if no output shows it."""
    tree = node_tree(scene)
    fed, users = take_over(tree, scene), set(tree.nodes)
    front, behind = tree.nodes.new("CompositorNodeRLayers"), tree.nodes.new("CompositorNodeRLayers")
    front.scene, behind.scene = scene, second
    front.layer = layer
    excess = math_node(tree, "SUBTRACT", at_edges(tree, front.outputs["Depth"]), behind.outputs["Depth"])
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
    tree.links.new(smooth(tree, math_node(tree, "LESS_THAN", excess, tolerance)), masked.inputs["Alpha"])
    whole = alpha_over(tree, street, masked.outputs[0])
    frame = tree.nodes.new("NodeFrame")
    frame.label = "PAGS composite"
    for x, node in enumerate(node for node in tree.nodes if node not in users):
        node[MINE] = True
        if node != frame:
            node.parent = frame
            node.location = (200 * (x % 4) - 1400, -250 * (x // 4))
    for socket in fed:
        tree.links.new(whole, socket)
    return bool(fed)


class PAGS_OT_composite(jobs.Long, cameras.OnScene, bpy.types.Operator):
    """Set up F12 to render this file's meshes with Cycles or EEVEE into the PAGS scene, with shadows on the road"""

    bl_idname = "pags.composite"
    bl_label = "Composite with Cycles/EEVEE"

    engine: EnumProperty(
        name="Meshes by",
        description="Render engine of this file's meshes",
        items=[
            ("CYCLES", "Cycles", "Shadows on the road and occlusion by depth"),
            ("EEVEE", "EEVEE", "Occlusion by depth; EEVEE supports no shadow catchers"),
        ],
    )
    tolerance: FloatProperty(
        name="Tolerance",
        description="Maximum distance in metres of a visible mesh behind the splats",
        default=0.3,
        min=0,
        unit="LENGTH",
    )

    use_sun: BoolProperty(
        name="Recorded sun",
        description="Light the meshes with a sun as the shadows of parked cars show it, unless the file has a sun",
        default=True,
    )
    use_light: BoolProperty(
        name="Light of the surroundings",
        description="Light the meshes with a world made of the recording's sky and of the static scene around the camera",
        default=True,
    )

    def invoke(self, context, event):
        self.by_hand = True
        return context.window_manager.invoke_props_dialog(self)

    def steps(self, context, root):
        scene, layer, threads = context.scene, context.view_layer, context.scene.pags.threads
        if scene.camera is None:
            raise native.SceneError("there is no camera in the scene")
        if self.engine == "CYCLES" and not hasattr(scene, "cycles"):
            raise native.SceneError("this Blender has no Cycles, or its add-on is not enabled (Preferences > Add-ons)")
        path, engine, tolerance = whereabouts.absolute_path(root), self.engine, self.tolerance
        use_light, use_sun = self.use_light, self.use_sun
        root_from_world = np.linalg.inv(lens.matrix(root.matrix_world))
        eye = (root_from_world @ lens.matrix(scene.camera.matrix_world))[:3, 3]
        turn = lens.rigid(root_from_world)[0][:3, :3]

        def work(job):
            entry = yield jobs.in_thread(native.load, path)
            z = yield jobs.in_thread(light.road_height, entry)
            world = scene.world
            if use_light:
                surroundings = yield jobs.in_thread(light.panorama, entry, eye, turn, threads)
                light.light_up(scene, surroundings)
            shining = None
            if use_sun and not any(o.type == "LIGHT" and o.data.type == "SUN" for o in scene.objects):
                try:
                    shining = yield jobs.in_thread(sun.estimate, entry, threads, job.tell)
                except native.SceneError as error:
                    job.notes.append(str(error))
            job.changes = True
            remember(scene, layer, world)
            if shining is not None:
                light.shine(scene, turn.T @ shining[0], shining[1])
            set_engine(scene, engine)
            scene.render.film_transparent = True
            scene.render.use_compositing = True
            layer.use_pass_z = True
            second = second_scene(scene)
            yield
            show_splats(scene, False)
            if engine == "CYCLES":
                use_catchers(scene, root, light.eyes_of(entry), z)
                layer.cycles.use_pass_shadow_catcher = True
            yield
            if not build_nodes(scene, second, layer.name, tolerance):
                job.notes.append('the compositor\'s output shows something else: link the frame "PAGS composite" to it')
            return "F12 now renders the meshes into the street"

        return work


def remember(scene, layer, world):
    """Stores the settings that a composite changes, unless they are already those of one."""
    if BEFORE in scene:
        return
    render, cycles = scene.render, getattr(scene, "cycles", None)
    found = {"engine": render.engine, "transparent": render.film_transparent, "compositing": render.use_compositing}
    found |= {"z": layer.use_pass_z, "world": world.name if world is not None else ""}
    newer = hasattr(scene, "compositing_node_group")  # 5.x
    found["nodes"] = scene.compositing_node_group is not None if newer else scene.use_nodes
    if cycles is not None:
        found["samples"] = cycles.samples if cycles.is_property_set("samples") else None
        found["denoising"] = cycles.use_denoising
    scene[BEFORE] = json.dumps(found)


def restore(scene, layer):
    """Takes back what a composite has changed; nodes and settings of the user stay."""
    before, render, cycles = json.loads(scene[BEFORE]), scene.render, getattr(scene, "cycles", None)
    del scene[BEFORE]
    tree = node_tree(scene)
    fed = take_over(tree, scene)
    own = layers_of(tree, scene)
    for socket in fed if own else ():
        tree.links.new(own[0].outputs["Image"], socket)
    if not before["nodes"]:
        if hasattr(scene, "compositing_node_group"):
            bpy.data.node_groups.remove(tree)
        else:
            scene.use_nodes = False
    render.engine, render.film_transparent = before["engine"], before["transparent"]
    render.use_compositing, layer.use_pass_z = before["compositing"], before["z"]
    scene.world = bpy.data.worlds.get(before["world"])
    if cycles is not None:
        layer.cycles.use_pass_shadow_catcher, cycles.use_denoising = False, before["denoising"]
        if before["samples"] is None:
            cycles.property_unset("samples")
    show_splats(scene, True)
    if light.SUN in bpy.data.lights:
        bpy.data.lights.remove(bpy.data.lights[light.SUN])  # and its lamp
    collection, second = bpy.data.collections.get(CATCHERS), bpy.data.scenes.get(SECOND)
    for block in list(collection.objects) if collection is not None else ():
        if block.get("pags_catcher") == "road":
            bpy.data.objects.remove(block)
        else:
            block.is_shadow_catcher, block.hide_render = False, True
            curves.remove(block, "hide_render")
    for holder, block in ((bpy.data.collections, collection), (bpy.data.scenes, second)):
        if block is not None:
            holder.remove(block)


class PAGS_OT_remove_composite(bpy.types.Operator):
    """Take back what Composite has set up: nodes, the second scene, shadow catchers, light and render settings"""

    bl_idname = "pags.remove_composite"
    bl_label = "Remove composite"
    bl_options = {"REGISTER", "UNDO"}

    @classmethod
    def poll(cls, context):
        return BEFORE in context.scene

    def execute(self, context):
        restore(context.scene, context.view_layer)
        return {"FINISHED"}


def set_engine(scene, engine):
    if engine == "CYCLES":
        scene.render.engine = "CYCLES"
        use_samples(scene)
        return
    names = {item.identifier for item in bpy.types.RenderSettings.bl_rna.properties["engine"].enum_items}
    scene.render.engine = "BLENDER_EEVEE_NEXT" if "BLENDER_EEVEE_NEXT" in names else "BLENDER_EEVEE"
