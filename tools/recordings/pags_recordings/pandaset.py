# SPDX-License-Identifier: Apache-2.0
"""Reads a sequence of PandaSet (Xiao et al. 2021): 80 time steps at 10 Hz, six cameras with undistorted photographs, two LiDARs, boxes.

Points and boxes are in the world frame. Boxes refer to the time when the LiDAR saw the object, and cameras fire when the LiDAR passes them, so a step's boxes
fit its photographs. The LiDAR's pose is the car's, with y forward."""

import glob
import json
import os
from collections import Counter

import numpy as np
from PIL import Image

from . import poses
from .errors import RecordingError
from .frame_pickle import table
from .importing import TWICE, choose_steps, chosen, complete, existing, listed

CAMERAS = ("front_camera", "front_left_camera", "front_right_camera", "left_camera", "right_camera", "back_camera")
EGO_FROM_LIDAR = np.array(
    [[0.0, -1, 0, 0], [1, 0, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]
)  # x right, y forward becomes x forward, y left
PHOTOGRAPHS = ".jpg", ".jpeg", ".png"
SWEEP = ["x", "y", "z", "i", "d"]
PICKLES = ".pkl.gz", ".pkl"
BOX = [
    "uuid",
    "label",
    "yaw",
    "position.x",
    "position.y",
    "position.z",
    "dimensions.x",
    "dimensions.y",
    "dimensions.z",
    "cuboids.sibling_id",
    "cuboids.sensor_id",
]


def rows_of(path):
    """A list from a JSON file."""
    try:
        with open(existing(path), encoding="utf-8") as file:
            rows = json.load(file)
    except (OSError, ValueError) as error:
        raise RecordingError(f"{path}: can't be read as JSON: {error}") from None
    if not isinstance(rows, list) or not rows:
        raise RecordingError(f"{path}: expected a list with one entry per time step")
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
    return {
        os.path.basename(os.path.dirname(os.path.dirname(path))): os.path.dirname(os.path.dirname(path))
        for path in sorted(found)
    }


def numbered(sequence, folder, endings, what, account):
    """The files of time steps, by number."""
    return {
        int(name): path
        for name, path in listed(os.path.join(sequence, *folder), endings, what, account).items()
        if name.isdigit()
    }


class Camera:
    """A camera's calibration, and pose and time of each photograph."""

    def __init__(self, folder, steps, files):
        self.folder, self.files, self.poses = folder, files, rows_of(os.path.join(folder, "poses.json"))
        self.times = rows_of(os.path.join(folder, "timestamps.json"))
        path = existing(folder, "intrinsics.json")
        try:
            with open(path, encoding="utf-8") as file:
                k = json.load(file)
            self.k = [[k["fx"], 0, k["cx"]], [0, k["fy"], k["cy"]], [0, 0, 1]]
        except (ValueError, KeyError, TypeError):
            raise RecordingError(f"{path}: expected fx, fy, cx and cy") from None
        for name, rows in (("poses.json", self.poses), ("timestamps.json", self.times)):
            if len(rows) != steps:
                raise RecordingError(
                    f"{os.path.join(folder, name)}: has {len(rows)} entries, but lidar/poses.json {steps}"
                )

    def size(self, t):
        try:
            with Image.open(self.files[t]) as picture:
                return picture.size
        except (OSError, SyntaxError) as error:
            raise RecordingError(f"{self.files[t]}: can't be read as a picture: {error}") from None


def read(sequence, cameras, frames, out, progress):
    ways, stamps = (rows_of(os.path.join(sequence, "lidar", name)) for name in ("poses.json", "timestamps.json"))
    if len(ways) != len(stamps):
        raise RecordingError(f"{os.path.join(sequence, 'lidar')}: {len(ways)} poses, but {len(stamps)} times")
    account = out.account
    present = [name for name in CAMERAS if os.path.isdir(os.path.join(sequence, "camera", name))]
    names = chosen(present, cameras, "camera")
    shots = {name: numbered(sequence, ["camera", name], PHOTOGRAPHS, "photographs", None) for name in names}
    names = [name for name in names if shots[name] or cameras]
    if not names:
        raise RecordingError(
            f"{os.path.join(sequence, 'camera')}: has no photographs; expected {', '.join(CAMERAS)} with 00.jpg and so on"
        )
    account.leave_out(
        "cameras", "have no photographs", [] if cameras else [name for name in CAMERAS if name not in names]
    )
    steps = complete(
        choose_steps(list(range(len(ways))), frames, account), {name: shots[name] for name in names}, account
    )
    if not steps:
        raise RecordingError(
            f"{sequence}: no time step left of {len(ways)}: none has a photograph of every camera, or --frames selected none"
        )
    used = {name: Camera(os.path.join(sequence, "camera", name), len(ways), shots[name]) for name in names}
    for name, camera in used.items():
        out.add_camera(name, camera.size(steps[0]), camera.k)
    boxes = read_boxes(numbered(sequence, ["annotations", "cuboids"], PICKLES, "boxes", account), steps, account)
    sweeps = numbered(sequence, ["lidar"], PICKLES, "sweeps", account)
    classes = numbered(sequence, ["annotations", "semseg"], PICKLES, "classes of LiDAR points", account)
    account.contains("sweeps", sum(t in sweeps for t in steps), os.path.join(sequence, "lidar"))
    account.leave_out(
        "sweeps", "the files are missing", [f"time step {t}" for t in steps if sweeps and t not in sweeps]
    )
    progress.total = len(steps)
    for done, t in enumerate(steps):
        progress.show(done)
        world_from_lidar = pose_of(ways[t], f"{os.path.join(sequence, 'lidar', 'poses.json')}, entry {t}")
        step = out.add_step(float(stamps[t]) - float(stamps[0]), world_from_lidar @ EGO_FROM_LIDAR)
        for name, camera in used.items():
            pose = pose_of(camera.poses[t], f"{os.path.join(camera.folder, 'poses.json')}, entry {t}")
            step.photograph(name, camera.files[t], pose, float(camera.times[t]) - float(stamps[0]))
        put_sweep(step, t, sweeps, classes)
        for track, name, pose, size in boxes.get(t, ()):
            step.box(track, name, pose, size)


def put_sweep(step, t, sweeps, classes):
    """Points of both LiDARs (`sensor` 0 rotates, 1 faces forward), with their classes if the sequence has them."""
    columns = ["intensity", "sensor"] + ["label"] * bool(classes)
    if t not in sweeps or step.has_lidar(columns):
        return
    points = numbers(table(sweeps[t], SWEEP), sweeps[t], SWEEP)
    if classes:
        if t not in classes:
            raise RecordingError(
                f"{sweeps[t]}: has no classes in annotations/semseg, but other sweeps do; move semseg elsewhere to import without classes"
            )
        (label,) = numbers(table(classes[t], ["class"]), classes[t], ["class"])
        if len(label) != len(points[0]):
            raise RecordingError(f"{classes[t]}: {len(label)} classes for {len(points[0])} points")
        points.append(label)
    step.lidar(np.column_stack(points), np.eye(4), columns)


def numbers(rows, path, columns):
    """Columns of a table as numbers."""
    try:
        return [rows[name].astype(np.float64) for name in columns]
    except (ValueError, TypeError, OverflowError):
        raise RecordingError(f"{path}: expected numbers in the columns {', '.join(columns)}") from None


def read_boxes(files, steps, account):
    """Boxes by time step. Objects seen by both LiDARs have two tracks: the longer one is used, or that of the rotating LiDAR. A track's class is its most
    frequent one."""
    rows, names, siblings, turning = {}, {}, {}, set()
    for t in steps:
        if t not in files:
            account.leave_out("files of boxes", "are missing", [f"time step {t}"] if files else [])
            continue
        found = table(files[t], BOX)
        (sensors,), sizes = numbers(found, files[t], BOX[-1:]), numbers(found, files[t], BOX[2:9])
        for i, track in enumerate(found["uuid"]):
            track = str(track)
            if rows.get(track, [(None,)])[-1][0] == t:
                account.leave_out("boxes", TWICE, [f"{track} at time step {t}"])
                continue
            rows.setdefault(track, []).append((t, [float(column[i]) for column in sizes]))
            names.setdefault(track, Counter())[str(found["label"][i])] += 1
            if sensors[i] >= 0:
                siblings[track] = str(found["cuboids.sibling_id"][i])
                if sensors[i] == 0:
                    turning.add(track)
    account.contains(
        "boxes", sum(len(marks) for marks in rows.values()), os.path.dirname(next(iter(files.values()), ""))
    )
    out = {}
    for track, marks in rows.items():
        other = siblings.get(track)
        if other in rows and (len(rows[other]), other in turning, other) > (len(marks), track in turning, track):
            account.leave_out("boxes", "of objects that the other LiDAR saw, too", [track], len(marks))
            continue
        for t, (yaw, x, y, z, *extents) in marks:
            pose = poses.turned_left(yaw, [x, y, z]) @ poses.front_from_box("+y")
            out.setdefault(t, []).append(
                (track, names[track].most_common(1)[0][0], pose, poses.box_size(extents, "+y"))
            )
    return out
