# SPDX-License-Identifier: GPL-3.0-or-later
"""Light for meshes in the street: the recording's surroundings as a world; and the height of its road."""

import bpy
import numpy as np
from mathutils import Vector

from . import gather, native

LIGHT, SUN = "PAGS surroundings", "PAGS sun"  # names of the world and its picture, and of the lamp


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


def panorama(entry, eye, turn, threads, width=512):
    """Environment picture around a point (relative to the scene's origin), without objects: linear RGB (width / 2, width, 3), row 0 at the bottom, in Cycles'
    equirectangular mapping. `turn`: 3x3, from Blender's world to the scene's axes."""
    height = width // 2
    axes = turn @ np.array([[0, 0, 1], [-1, 0, 0], [0, -1, 0]])  # columns: right, down, forward
    pose = np.hstack([axes, (eye + np.array(entry.info["origin"]))[:, None]])
    camera = {"width": width, "height": height, "cx": width / 2, "cy": height / 2, "lens": {"kind": "equirectangular"}}
    camera.update(fx=width / (2 * np.pi), fy=height / np.pi, world_from_camera=pose, time=entry.info["time_begin"])
    options = {"placements": [(-1, gather.IDENTITY)], "linear": True, "flip": True}
    picture = native.renderer("cube", threads).submit(entry.scene, camera, **options).take()
    return np.asarray(picture.rgba)[..., :3]


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


def shine(scene, towards, color):
    """Adds the sun as a lamp. towards: unit vector in Blender's world; color: linear, of a white surface that faces it, which is 1 / pi of the lamp's strength."""
    data = bpy.data.lights.new(SUN, "SUN")
    data.energy, data.color = np.pi * max(color), color / max(color)
    data.angle = np.radians(0.53)
    lamp = bpy.data.objects.new(SUN, data)
    lamp.rotation_euler = Vector(towards).to_track_quat("Z", "Y").to_euler()
    scene.collection.objects.link(lamp)
