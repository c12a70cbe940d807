# SPDX-License-Identifier: Apache-2.0
"""Makes a small synthetic driving scene: a street with a wall, a parked car, a moving car, an object of three Gaussians
and a flat object."""

import json
import math
import os
import random
import struct

import fixtures

ORIGIN = [1000.0, 2000.0, 30.0]
PLACE = [48.25, 11.5, 520]
SH0 = 0.28209479177387814
IDENTITY = [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0]


def gaussian(x, y, z, rgb, sigma=(0.08, 0.08, 0.08), opacity=4.0):
    dc = [(c - 0.5) / SH0 for c in rgb]
    return [x, y, z, 0, 0, 0, *dc, opacity, *[math.log(s) for s in sigma], 1, 0, 0, 0]


def ply(rows, objects=None):
    """Returns the bytes of a PLY file in INRIA's layout, of degree 0. If `objects` has a number for each row, the
    property object_id holds the numbers."""
    header = ["ply", "format binary_little_endian 1.0", f"element vertex {len(rows)}"]
    header += [f"property float {name}" for name in fixtures.PLY_NAMES]
    if objects is not None:
        header += ["property int object_id"]
    body = b""
    for i, row in enumerate(rows):
        body += struct.pack("<17f", *row) + (struct.pack("<i", objects[i]) if objects is not None else b"")
    return "\n".join(header + ["end_header", ""]).encode() + body


def on_box(count, size, at, rgb, seed):
    """Returns `count` flat Gaussians at random places on the sides of a box."""
    dice, rows = random.Random(seed), []
    for _ in range(count):
        p = [dice.uniform(-0.5, 0.5) * s for s in size]
        axis = dice.choice([0, 1, 1, 2])
        p[axis] = math.copysign(0.5 * size[axis], p[axis])
        sigma = [0.012 if k == axis else 0.09 for k in range(3)]
        rows.append(gaussian(*[at[k] + p[k] for k in range(3)], rgb, sigma))
    return rows


def knot(frame, position, yaw=0.0):
    c, s = math.cos(yaw), math.sin(yaw)
    pose = [c, -s, 0, position[0], s, c, 0, position[1], 0, 0, 1, position[2]]
    for k in range(3):
        pose[4 * k + 3] += ORIGIN[k]
    return {
        "frame": frame,
        "time": 0.1 * frame,
        "trained": True,
        "world_from_object": pose,
        "rotation": [0, 0, 0],
        "translation": [0, 0, 0],
    }


def camera(frame, x, yaw):
    """Returns a camera 1.6 m above the ground that looks along `yaw` and slightly down."""
    c, s = math.cos(yaw), math.sin(yaw)
    cp, sp = math.cos(0.15), math.sin(0.15)
    right, down, forward = [s, -c, 0], [-sp * c, -sp * s, -cp], [cp * c, cp * s, -sp]
    r = [right, down, forward]  # the rotation matrix from world to camera, row by row
    eye = [x + ORIGIN[0], ORIGIN[1], 1.6 + ORIGIN[2]]
    t = [-sum(row[k] * eye[k] for k in range(3)) for row in r]
    return {
        "name": f"{frame:03d}_{yaw:.2f}.png",
        "test": frame % 4 == 3,
        "sensor": 0,
        "frame": frame,
        "width": 160,
        "height": 120,
        "fx": 90,
        "fy": 90,
        "cx": 80,
        "cy": 60,
        "camera_from_world_quaternion_wxyz": quaternion(r),
        "camera_from_world_translation": t,
        "time": 0.1 * frame,
    }


def quaternion(r):
    """Returns the quaternion of a rotation matrix. Computes it from the largest of the four squared components for
    accuracy."""
    squares = [
        1 + r[0][0] + r[1][1] + r[2][2],
        1 + r[0][0] - r[1][1] - r[2][2],
        1 - r[0][0] + r[1][1] - r[2][2],
        1 - r[0][0] - r[1][1] + r[2][2],
    ]
    k = squares.index(max(squares))
    f = 0.5 / math.sqrt(squares[k])
    a, b, c = r[2][1] - r[1][2], r[0][2] - r[2][0], r[1][0] - r[0][1]
    d, e, g = r[1][0] + r[0][1], r[0][2] + r[2][0], r[2][1] + r[1][2]
    rows = [[squares[0], a, b, c], [a, squares[1], d, e], [b, d, squares[2], g], [c, e, g, squares[3]]]
    return [f * v for v in rows[k]]


def make_scene(folder):
    """Writes the scene. Object 0 is a parked car, 1 is a moving car, 2 has three Gaussians, 3 is flat, 4 has no
    Gaussians."""
    size = [4.0, 1.8, 1.5]
    rows, owner = [], []
    for i in range(-20, 60):
        for j in range(-18, 19):
            rows.append(gaussian(0.4 * i, 0.4 * j, 0.0, (0.4, 0.4, 0.42), (0.25, 0.25, 0.01)))
    for i in range(-10, 50):
        for j in range(8):
            rows.append(gaussian(0.5 * i, 7.4, 0.25 + 0.5 * j, (0.6, 0.5, 0.4), (0.3, 0.02, 0.3)))
    owner += [-1] * len(rows)
    parked = on_box(900, size, (6.0, 3.5, 0.75), (0.7, 0.1, 0.1), 1)
    rows, owner = rows + parked, owner + [0] * len(parked)
    flat = [
        gaussian(0, 0.04 * i, 0.04 * j, (0.2, 0.7, 0.2), (0.02, 0.02, 0.02))
        for i in range(-9, 10)
        for j in range(-9, 10)
    ]
    models = {
        "background": (rows, owner),
        "car_1": (on_box(900, size, (0, 0, 0), (0.1, 0.2, 0.8), 2), None),
        "three": ([gaussian(0.1 * i, 0, 0, (0.9, 0.9, 0.1)) for i in range(3)], None),
        "flat": (flat, None),
    }
    os.makedirs(os.path.join(folder, "objects"), exist_ok=True)
    listed = []
    for name, (places, objects) in models.items():
        file = "background.ply" if name == "background" else f"objects/{name}.ply"
        fixtures.write(os.path.join(folder, file), ply(places, objects))
        listed.append({"name": name, "file": file, "gaussians": len(places), "sh_degree": 0})

    def item(name, class_name, category, box, model, knots):
        return {
            "id": name,
            "class": class_name,
            "category": category,
            "critical": category != "other",
            "size": box,
            "moving": len(knots) > 1,
            "rigid": True,
            "model": model,
            "knots": knots,
        }

    person = [0.8, 0.8, 0.8]
    scene = {
        "version": 1,
        "units": "metres",
        "origin": ORIGIN,
        "geographic_origin": PLACE,
        "up": "z",
        "time": [0, 0.9],
        "models": listed,
        "background": [0.5, 0.6, 0.8],
        "antialiased": False,
        "dataset": None,
        "seed": 0,
        "iterations": 0,
        "config": None,
        "fps": 10,
        "objects": [
            item("parked_0", "Car", "vehicle", size, None, [knot(5, (6.0, 3.5, 0.75))]),
            item("car_1", "Car", "vehicle", size, "car_1", [knot(f, (5 + 0.6 * f, -3.0, 0.75)) for f in range(10)]),
            item(
                "three_2",
                "Pedestrian",
                "pedestrian",
                person,
                "three",
                [knot(f, (9 + 0.3 * f, 0, 0.5)) for f in range(10)],
            ),
            item(
                "flat_3",
                "Rolling Container",
                "other",
                person,
                "flat",
                [knot(f, (8 + 0.3 * f, 1.5, 0.5)) for f in range(10)],
            ),
            item("empty_4", "Pedestrian", "pedestrian", person, None, [knot(5, (12.0, -6.0, 0.9))]),
        ],
        "cameras": [camera(f, 0.8 * f, yaw) for f in range(10) for yaw in (0.0, 0.9, -0.9)],
    }
    fixtures.write(os.path.join(folder, "scene.json"), json.dumps(scene))
    return folder


def make_empty_scene(folder):
    """Writes a scene without Gaussians, objects and cameras."""
    fixtures.write(os.path.join(folder, "background.ply"), ply([]))
    scene = {
        "version": 1,
        "units": "metres",
        "origin": [0, 0, 0],
        "up": "z",
        "time": [0, 0],
        "models": [{"name": "background", "file": "background.ply", "gaussians": 0, "sh_degree": 0}],
        "background": [0, 0, 0],
        "antialiased": False,
        "dataset": None,
        "seed": 0,
        "iterations": 0,
        "config": None,
        "cameras": [],
    }
    fixtures.write(os.path.join(folder, "scene.json"), json.dumps(scene))
    return folder
