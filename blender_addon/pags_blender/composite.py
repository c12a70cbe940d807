# SPDX-License-Identifier: GPL-3.0-or-later
"""Composites CG objects into the street: a linked second Blender scene renders the splats with PAGS, and Cycles or EEVEE renders Blender's meshes, merged by
depth. Proxies, or a plane for the road, catch shadows; the recording's surroundings light the meshes."""

import bpy
import numpy as np
from bpy.props import BoolProperty, EnumProperty, FloatProperty

from . import cameras, curves, gather, jobs, lens, native, undistort, whereabouts

SECOND = "PAGS behind"
LIGHT = "PAGS surroundings"  # name of the world and of its picture
MINE = "pags_composite"  # marks our nodes in the compositor
SAMPLES = {
    True: 64,
    False: 128,
}  # Cycles samples with and without a denoiser; Blender's default of 4096 takes hours on a CPU
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
    for name in ("sh_degree", "antialiased", "threads", "hide_noncritical", "use_background", "background"):
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


def shadow_plane(scene, root, eyes, z):
    known = next((o for o in scene.objects if o.get("pags_catcher") == "road"), None)
    if known is not None:
        return known
    low, high = (eyes.min(axis=0) - 40, eyes.max(axis=0) + 40) if len(eyes) else (np.full(3, -40), np.full(3, 40))
    mesh = bpy.data.meshes.new("road")
    mesh.from_pydata(
        [(low[0], low[1], z), (high[0], low[1], z), (high[0], high[1], z), (low[0], high[1], z)], [], [(0, 1, 2, 3)]
    )
    plane = bpy.data.objects.new("road", mesh)
    plane["pags_catcher"] = "road"
    plane.parent = root
    plane.display_type = "WIRE"
    return plane


def use_catchers(scene, root, eyes, z):
    """Collects the shadow catchers (the proxies, else a plane for the road) in a collection of the first scene; returns them."""
    proxies = [o for o in scene.objects if o.get("pags_proxy") and o.type == "MESH"]
    collection = bpy.data.collections.get("PAGS shadow catchers") or bpy.data.collections.new("PAGS shadow catchers")
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
    if part.animation_data is None or part.animation_data.action is None:
        return
    curve = curves.fcurve_owner(part).find("hide_render")
    if curve is not None:
        keys = [key.co for key in curve.keyframe_points]
        curves.set_curve(proxy, "hide_render", 0, [k[0] for k in keys], [k[1] for k in keys], "CONSTANT")


def hide_splats(scene):
    """Hides the preview points from renders of the first scene: the second scene renders the splats."""
    for part in scene.objects:
        if part.pags.kind in {"BACKGROUND", "OBJECT"} and len(part.users_collection) > 0:
            part.visible_camera = part.visible_shadow = part.visible_diffuse = part.visible_glossy = False


# ---- The light ----


def panorama(entry, eye, turn, threads, width=512, side=192):
    """Environment picture around a point (relative to the scene's origin), without objects: linear RGB (height, width, 3), row 0 at the bottom, in Cycles'
    equirectangular mapping. `turn`: 3x3, from Blender's world to the scene's axes. Rendered as the six faces of a cube."""
    height = width // 2
    longitude = 2 * np.pi * (0.5 - (np.arange(width) + 0.5) / width)
    latitude = np.pi * ((np.arange(height) + 0.5) / height - 0.5)
    flat = np.cos(latitude)[:, None] * np.stack([np.cos(longitude), np.sin(longitude)])[:, None]
    up = np.broadcast_to(np.sin(latitude)[:, None], (height, width))
    directions = np.stack([*flat, up], axis=2) @ turn.T
    largest = np.abs(directions).argmax(axis=2)
    face = 2 * largest + (np.take_along_axis(directions, largest[..., None], 2)[..., 0] < 0)
    out = np.zeros((height, width, 3), dtype=np.float32)
    for number in range(6):
        forward = np.eye(3)[number // 2] * (1 - 2 * (number % 2))
        right = np.eye(3)[(number // 2 + 1) % 3]
        axes = np.stack([right, np.cross(forward, right), forward], axis=1)  # columns: right, down, forward
        pose = np.hstack([axes, (eye + np.array(entry.info["origin"]))[:, None]])
        camera = {"width": side, "height": side, "fx": side / 2, "fy": side / 2, "cx": side / 2, "cy": side / 2}
        camera.update(world_from_camera=[float(v) for v in pose.ravel()], time=entry.info["time_begin"])
        job = native.renderer("final", threads).submit(
            entry.scene, camera, placements=[(-1, gather.IDENTITY)], linear=True
        )
        picture, here = np.asarray(job.take().rgba)[..., :3], face == number
        seen = directions[here] @ axes
        out[here] = undistort.sample(
            picture, side / 2 * (1 + seen[:, 0] / seen[:, 2]), side / 2 * (1 + seen[:, 1] / seen[:, 2])
        )
    return out


def light_up(scene, picture):
    """Sets the picture as the scene's world. The previous world stays in the file."""
    height, width = picture.shape[:2]
    image = bpy.data.images.get(LIGHT) or bpy.data.images.new(LIGHT, width, height, float_buffer=True)
    rgba = np.ones((height, width, 4), dtype=np.float32)
    rgba[..., :3] = picture
    image.pixels.foreach_set(rgba.reshape(-1))
    image.update()
    image.pack()
    world = bpy.data.worlds.get(LIGHT) or bpy.data.worlds.new(LIGHT)
    world.use_nodes = True
    nodes = world.node_tree.nodes
    texture = next((n for n in nodes if n.bl_idname == "ShaderNodeTexEnvironment"), None) or nodes.new(
        "ShaderNodeTexEnvironment"
    )
    texture.image, texture.location = image, (-300, 300)
    background = next(n for n in nodes if n.bl_idname == "ShaderNodeBackground")
    world.node_tree.links.new(texture.outputs["Color"], background.inputs["Color"])
    if scene.world not in (None, world):
        scene.world.use_fake_user = True
    scene.world = world


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
    return (
        next((node for node in known if getattr(node, "is_active_output", True)), None)
        or next(iter(known), None)
        or tree.nodes.new(kind)
    )


def take_over(tree, scene):
    """Removes the nodes of an earlier call. Returns the inputs to connect to the composite: those of the removed nodes, and those of the scene's own Render
    Layers node. The user's nodes and links stay."""
    mine = [node for node in tree.nodes if MINE in node]
    sources = mine + [
        node
        for node in tree.nodes
        if node.bl_idname == "CompositorNodeRLayers" and MINE not in node and node.scene == scene
    ]
    links = [
        link
        for node in sources
        for output in node.outputs
        if node in mine or output.name == "Image"
        for link in output.links
    ]
    fed = [(link.to_node, link.to_socket) for link in links if MINE not in link.to_node]
    out = output_of(tree, scene)
    if not out.inputs[0].is_linked and out.inputs[0] not in [socket for _, socket in fed]:
        fed.append((out, out.inputs[0]))
    for node in mine:
        tree.nodes.remove(node)
    return [socket for _, socket in fed]


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
    if "Background" in node.inputs:  # names of 5.x
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
        node = tree.nodes.new("ShaderNodeMix")  # 5.x; its colour sockets are the last of three types
        node.data_type = "RGBA"
        inputs = [node.inputs[0]] + [socket for socket in node.inputs if socket.type == "RGBA"]
        out = next(socket for socket in node.outputs if socket.type == "RGBA")
    node.blend_type = "MULTIPLY"
    for source, socket in zip((share, picture, by), inputs):
        tree.links.new(source, socket)
    return out


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
        path, engine, tolerance, use_light = (
            whereabouts.absolute_path(root),
            self.engine,
            self.tolerance,
            self.use_light,
        )
        root_from_world = np.linalg.inv(lens.matrix(root.matrix_world))
        eye = (root_from_world @ lens.matrix(scene.camera.matrix_world))[:3, 3]
        turn = lens.rigid(root_from_world)[0][:3, :3]

        def work(job):
            entry = yield jobs.in_thread(native.load, path)
            z = yield jobs.in_thread(road_height, entry)
            if use_light:
                light_up(scene, (yield jobs.in_thread(panorama, entry, eye, turn, threads)))
            job.changes = True
            set_engine(scene, engine)
            scene.render.film_transparent = True
            scene.render.use_compositing = True
            layer.use_pass_z = True
            second = second_scene(scene)
            yield
            hide_splats(scene)
            if engine == "CYCLES":
                use_catchers(scene, root, eyes_of(entry), z)
                layer.cycles.use_pass_shadow_catcher = True
            yield
            if not build_nodes(scene, second, layer.name, tolerance):
                job.notes.append('the compositor\'s output shows something else: link the frame "PAGS composite" to it')
            return "F12 now renders the meshes into the street"

        return work


def set_engine(scene, engine):
    if engine == "CYCLES":
        scene.render.engine = "CYCLES"
        use_samples(scene)
        return
    names = {item.identifier for item in bpy.types.RenderSettings.bl_rna.properties["engine"].enum_items}
    scene.render.engine = "BLENDER_EEVEE_NEXT" if "BLENDER_EEVEE_NEXT" in names else "BLENDER_EEVEE"


CLASSES = (PAGS_OT_composite,)

register, unregister = bpy.utils.register_classes_factory(CLASSES)
