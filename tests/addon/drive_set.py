# SPDX-License-Identifier: Apache-2.0
"""Makes a data set in the driving layout for the drive of test_drive.py. Rendered pictures without exposure serve as
photographs."""

import json
import os
import struct

import fixtures
from fixtures import write
from test_drive import ORIGIN


def rows(matrix):
    return "\n".join(" ".join(map(repr, map(float, row))) for row in matrix)


def make_set(scene, folder):
    """Renders the photographs and stores the set's folder in the scene."""
    done = fixtures.run("render", scene, "--split", "all", "-o", os.path.join(folder, "images"), "--no-exposure")
    assert done.returncode == 0, done.stderr
    path = os.path.join(scene, "scene.json")
    record = json.loads(fixtures.read(path))
    record["dataset"] = folder
    for view in record["cameras"]:
        view["name"] = view["name"].replace(".jpg", ".png")
    write(path, json.dumps(record))
    for sensor in range(2):
        write(os.path.join(folder, "intrinsics", f"{sensor}.txt"), "100 100 50.5 50.5")
        for t in range(3):
            x, y, z = ORIGIN
            pose = [[0, 0, 1, x + (50 if sensor else t)], [-1, 0, 0, y], [0, -1, 0, z], [0, 0, 0, 1]]
            write(os.path.join(folder, "extrinsics", f"{t:03d}_{sensor}.txt"), rows(pose))
    write(os.path.join(folder, "timestamps.json"), json.dumps({"frames": [100.0, 101.0, 102.0]}))
    stated = {
        "kind": "pags",
        "camera_axes": "opencv",
        "extrinsics": "per-frame camera-to-world (TTT_C.txt)",
        "object_forward": "+x",
    }
    write(os.path.join(folder, "dataset.json"), json.dumps({**stated, "fps": 1}))


def make_sweeps(folder, points, places):
    """Writes sweep t with points(t), rows of x y z intensity in the car's frame. The car stands at places(t) from
    the origin."""
    for t in range(3):
        data = b"".join(struct.pack("<4f", *row) for row in points(t))
        write(os.path.join(folder, "lidar", f"{t:03d}.bin"), data)
        place = [o + d for o, d in zip(ORIGIN, places(t))]
        write(
            os.path.join(folder, "ego_pose", f"{t:03d}.txt"),
            rows([[1, 0, 0, place[0]], [0, 1, 0, place[1]], [0, 0, 1, place[2]], [0, 0, 0, 1]]),
        )
