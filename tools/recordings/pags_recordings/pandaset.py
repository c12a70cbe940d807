# SPDX-License-Identifier: Apache-2.0
"""A sequence of PandaSet (Xiao et al. 2021): 80 time steps at 10 Hz, six cameras whose photographs are undistorted by the source, two LiDARs, boxes.

Points and boxes are in the world's frame. Boxes are where the laser saw the object, and cameras fire as the laser passes them: a step's boxes fit its
photographs as they are. The LiDAR's pose is the car's, with y forward."""

import glob
import json
import os
from collections import Counter

import numpy as np
from PIL import Image

from . import poses
from .errors import RecordingError
from .frame_pickle import table
from .importing import chosen, existing

CAMERAS = ("front_camera", "front_left_camera", "front_right_camera", "left_camera", "right_camera", "back_camera")
EGO_FROM_LIDAR = np.array([[0.0, -1, 0, 0], [1, 0, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]])  # x right, y forward becomes x forward, y left
BOX = ["uuid", "label", "yaw", "position.x", "position.y", "position.z", "dimensions.x", "dimensions.y", "dimensions.z", "cuboids.sibling_id", "cuboids.sensor_id"]


def listed(path):
    """A list in a JSON file."""
    try:
        with open(existing(path), encoding="utf-8") as file:
            rows = json.load(file)
    except (OSError, ValueError) as error:
        raise RecordingError(f"{path}: can't be read as JSON: {error}") from None
    if not isinstance(rows, list) or not rows:
        raise RecordingError(f"{path}: expected a list, one entry a time step")
    return rows


def pose_of(row, where):
    try:
        return poses.pose([row["heading"][k] for k in "wxyz"], [row["position"][k] for k in "xyz"], order="wxyz")
    except (KeyError, TypeError):
        raise RecordingError(f"{where}: expected position x y z and heading w x y z, found {str(row)[:100]}") from None


def sequences(raw):
    """The sequences below a folder: itself, or its subfolders."""
    if os.path.exists(os.path.join(raw, "lidar", "poses.json")):
        return {os.path.basename(os.path.abspath(raw)): raw}
    found = glob.glob(os.path.join(glob.escape(raw), "*", "lidar", "poses.json"))
    return {os.path.basename(os.path.dirname(os.path.dirname(path))): os.path.dirname(os.path.dirname(path)) for path in sorted(found)}


class Camera:
    """A camera's calibration, and pose and time of each of its photographs."""

    def __init__(self, folder, steps):
        self.folder, self.poses = folder, listed(os.path.join(folder, "poses.json"))
        self.times = listed(os.path.join(folder, "timestamps.json"))
        path = existing(folder, "intrinsics.json")
        try:
            with open(path, encoding="utf-8") as file:
                k = json.load(file)
            self.k = [[k["fx"], 0, k["cx"]], [0, k["fy"], k["cy"]], [0, 0, 1]]
        except (ValueError, KeyError, TypeError):
            raise RecordingError(f"{path}: expected fx, fy, cx and cy") from None
        for name, rows in (("poses.json", self.poses), ("timestamps.json", self.times)):
            if len(rows) != steps:
                raise RecordingError(f"{os.path.join(folder, name)}: has {len(rows)} entries, but lidar/poses.json {steps}")

    def photograph(self, t):
        return existing(self.folder, f"{t:02d}.jpg")

    def size(self, t):
        try:
            with Image.open(self.photograph(t)) as picture:
                return picture.size
        except (OSError, SyntaxError) as error:
            raise RecordingError(f"{self.photograph(t)}: can't be read as a picture: {error}") from None


def read(sequence, cameras, frames, out, progress):
    ways, stamps = (listed(os.path.join(sequence, "lidar", name)) for name in ("poses.json", "timestamps.json"))
    if len(ways) != len(stamps):
        raise RecordingError(f"{os.path.join(sequence, 'lidar')}: {len(ways)} poses, but {len(stamps)} times")
    present = [name for name in CAMERAS if os.path.isdir(os.path.join(sequence, "camera", name))]
    if not present:
        raise RecordingError(f"{os.path.join(sequence, 'camera')}: has no cameras; expected {', '.join(CAMERAS)}")
    used = {name: Camera(os.path.join(sequence, "camera", name), len(ways)) for name in chosen(present, cameras, "camera")}
    steps = list(range(len(ways)))
    steps = steps if frames is None else steps[frames[0] : frames[1] + 1]
    if not steps:
        raise RecordingError(f"{sequence}: has {len(ways)} time steps, and --frames chose none")
    for name, camera in used.items():
        out.add_camera(name, camera.size(steps[0]), camera.k)
    boxes = read_boxes(sequence, steps)
    progress.total = len(steps)
    for done, t in enumerate(steps):
        progress.show(done)
        world_from_lidar = pose_of(ways[t], f"{os.path.join(sequence, 'lidar', 'poses.json')}, entry {t}")
        step = out.add_step(float(stamps[t]) - float(stamps[0]), world_from_lidar @ EGO_FROM_LIDAR)
        for name, camera in used.items():
            pose = pose_of(camera.poses[t], f"{os.path.join(camera.folder, 'poses.json')}, entry {t}")
            step.photograph(name, camera.photograph(t), pose, float(camera.times[t]) - float(stamps[0]))
        put_sweep(step, sequence, t)
        for track, name, pose, size in boxes.get(t, ()):
            step.box(track, name, pose, size)


def put_sweep(step, sequence, t):
    """Points of both LiDARs, `sensor` 0 the one that turns, 1 the one that looks ahead, with their classes where the sequence has them."""
    sweep, classes = (os.path.join(sequence, *names, f"{t:02d}.pkl.gz") for names in (["lidar"], ["annotations", "semseg"]))
    labelled = os.path.isdir(os.path.dirname(classes))
    columns = ["intensity", "sensor"] + ["label"] * labelled
    if not os.path.exists(sweep) or step.has_lidar(columns):
        return
    rows = table(sweep, ["x", "y", "z", "i", "d"])
    points = [rows[name].astype(np.float64) for name in ("x", "y", "z", "i", "d")]
    if labelled:
        label = table(classes, ["class"])["class"].astype(np.float64)
        if len(label) != len(points[0]):
            raise RecordingError(f"{classes}: has {len(label)} classes, but the sweep {len(points[0])} points")
        points.append(label)
    step.lidar(np.column_stack(points), np.eye(4), columns)


def read_boxes(sequence, steps):
    """Boxes by time step. What both LiDARs saw has two tracks, of which the longer one is taken, or else the one of the LiDAR that turns. A
    track's class is the one that it has most often."""
    rows, names, siblings, turning = {}, {}, {}, set()
    for t in steps:
        path = os.path.join(sequence, "annotations", "cuboids", f"{t:02d}.pkl.gz")
        if not os.path.exists(path):
            continue
        found = table(path, BOX)
        for i, track in enumerate(found["uuid"]):
            track = str(track)
            rows.setdefault(track, []).append((t, [float(found[name][i]) for name in BOX[2:9]]))
            names.setdefault(track, Counter())[str(found["label"][i])] += 1
            if found["cuboids.sensor_id"][i] >= 0:
                siblings[track] = str(found["cuboids.sibling_id"][i])
                if found["cuboids.sensor_id"][i] == 0:
                    turning.add(track)
    out = {}
    for track, marks in rows.items():
        other = siblings.get(track)
        if other in rows and (len(rows[other]), other in turning, other) > (len(marks), track in turning, track):
            continue
        for t, (yaw, x, y, z, *extents) in marks:
            pose = poses.turned_left(yaw, [x, y, z]) @ poses.front_from_box("+y")
            out.setdefault(t, []).append((track, names[track].most_common(1)[0][0], pose, poses.box_size(extents, "+y")))
    return out
