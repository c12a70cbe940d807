# SPDX-License-Identifier: Apache-2.0
"""Makes the small synthetic street from which tests write raw recordings, reads it by numpy, and converts its poses
to other notations."""

import json
import os

import fixtures
import numpy as np
from fixtures import read


def make_street(folder, frames=8):
    """Writes a street with two cameras of 160 x 96 pixels."""
    done = fixtures.run(
        "synth",
        "street",
        "-o",
        folder,
        "--size",
        "160x96",
        "--frames",
        frames,
        "--cameras",
        "2",
        "--lidar-points",
        "3000",
        "--no-shifts",
    )
    assert done.returncode == 0, done.stderr
    return folder


def load(folder, *names):
    return json.loads(read(os.path.join(folder, *names)))


def matrix(folder, *names):
    return np.loadtxt(os.path.join(folder, *names)).reshape(4, 4)


def sweep(folder, name):
    return np.fromfile(os.path.join(folder, "lidar", name), "<f4").reshape(-1, 4)


def world_points(folder, step):
    """Returns the sweep of a step in world coordinates, or None if there is none."""
    told = load(folder, "dataset.json")
    digits = len(os.listdir(os.path.join(folder, "ego_pose"))[0].split(".")[0])
    path = os.path.join(folder, "lidar", f"{step:0{digits}d}.bin")
    if not os.path.exists(path):
        return None
    names = told["lidar_columns"]
    rows = np.fromfile(path, "<f4").reshape(-1, len(names)).astype(float)
    frame = (
        matrix(folder, "lidar_pose" if told["lidar_frame"] == "laser" else "ego_pose", f"{step:0{digits}d}.txt")
        if told["lidar_frame"] != "world"
        else np.eye(4)
    )
    return rows[:, [names.index(axis) for axis in "xyz"]] @ frame[:3, :3].T + frame[:3, 3]


def labels(folder):
    """Returns the boxes of a data set: (frame, id) -> class, pose, size."""
    out = {}
    for box in load(folder, "instances", "instances_info.json").values():
        marks = box["frame_annotations"]
        for frame, pose, size in zip(marks["frame_idx"], marks["obj_to_world"], marks["box_size"]):
            out[frame, box["id"]] = (box["class_name"], np.array(pose), np.array(size))
    return out


def about(axis, angle):
    """Returns the rotation about an axis by Rodrigues' formula."""
    x, y, z = np.asarray(axis, float) / np.linalg.norm(axis)
    k = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return np.eye(3) + np.sin(angle) * k + (1 - np.cos(angle)) * k @ k


def half_angle(axis, angle):
    """Returns the quaternion x y z w of the rotation about an axis."""
    return [*(np.sin(angle / 2) * np.asarray(axis, float) / np.linalg.norm(axis)), np.cos(angle / 2)]


def parts(pose):
    """Returns the quaternion x y z w and the translation of a pose; the rotation's eigenvector is the axis."""
    r = pose[:3, :3]
    values, vectors = np.linalg.eig(r)
    axis = np.real(vectors[:, np.argmin(np.abs(values - 1))])
    skew = np.array([r[2, 1] - r[1, 2], r[0, 2] - r[2, 0], r[1, 0] - r[0, 1]])
    return half_angle(axis, np.arctan2(axis @ skew, np.trace(r) - 1)), pose[:3, 3].tolist()
