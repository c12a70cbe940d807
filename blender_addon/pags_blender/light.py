# SPDX-License-Identifier: GPL-3.0-or-later
"""Light for meshes in the street: the recording's surroundings as a world; and the height of its road."""

import bpy
import numpy as np

from . import gather, undistort
from .sweeps import cube, face_of

LIGHT = "PAGS surroundings"  # name of the world and of its picture


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


def panorama(entry, eye, turn, threads, width=512, side=192):
    """Environment picture around a point (relative to the scene's origin), without objects: linear RGB (height, width, 3), row 0 at the bottom, in Cycles'
    equirectangular mapping. `turn`: 3x3, from Blender's world to the scene's axes. Rendered as the six faces of a cube."""
    height = width // 2
    longitude = 2 * np.pi * (0.5 - (np.arange(width) + 0.5) / width)
    latitude = np.pi * ((np.arange(height) + 0.5) / height - 0.5)
    flat = np.cos(latitude)[:, None] * np.stack([np.cos(longitude), np.sin(longitude)])[:, None]
    up = np.broadcast_to(np.sin(latitude)[:, None], (height, width))
    directions = np.stack([*flat, up], axis=2) @ turn.T
    face, out = face_of(directions), np.zeros((height, width, 3), dtype=np.float32)
    begin = entry.info["time_begin"]
    options = {"placements": [(-1, gather.IDENTITY)], "linear": True}
    for number, axes, drawn in cube(entry, eye, begin, threads, ("rgba",), side, **options):
        picture, here = np.asarray(drawn.rgba)[..., :3], face == number
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
