# SPDX-License-Identifier: Apache-2.0
"""Reads a drive of KITTI-360 (Liao et al. 2022): the rectified stereo pair, a Velodyne, poses of the car, boxes in the world frame.

A time step is a frame with a pose; poses refer to the cameras' times. The car's axes in these poses are x forward, y right, z down."""

import datetime
import glob
import os
import xml.etree.ElementTree as ET
from bisect import bisect_left, bisect_right

import numpy as np

from . import poses
from .errors import RecordingError
from .importing import TWICE, chosen, complete, existing, listed, optional

CAMERAS = ("image_00", "image_01")
EGO_FROM_POSE = np.diag([1.0, -1, -1, 1])
# Classes of movable objects, by their numbers in the files of boxes.
CLASSES = {
    13: "car",
    14: "truck",
    15: "trailer",
    16: "caravan",
    17: "motorcycle",
    18: "bicycle",
    19: "person",
    20: "rider",
    33: "train",
    34: "bus",
    36: "unknown vehicle",
}
LEAST_WAY = 1.0  # minimum metres of motion that determine an object's front


def sequences(raw):
    found = glob.glob(os.path.join(glob.escape(raw), "data_2d_raw", "*_sync"))
    return {os.path.basename(path): path for path in sorted(found)}


def numbers(text, count, where):
    try:
        values = [float(word) for word in text.split()]
    except ValueError:
        values = []
    if len(values) != count or not np.isfinite(values).all():
        raise RecordingError(f"{where}: expected {count} numbers, found {text.strip()[:100]!r}")
    return np.array(values)


def lines_of(*names):
    path = existing(*names)
    try:
        with open(path, encoding="utf-8") as file:
            return path, file.read().splitlines()
    except (OSError, UnicodeDecodeError) as error:
        raise RecordingError(f"{path}: can't be read as text: {error}") from None


def named(lines, path, name, count):
    """The numbers after NAME: in a calibration file."""
    for line in lines:
        if line.startswith(name + ":"):
            return numbers(line[len(name) + 1 :], count, f"{path}, {name}")
    raise RecordingError(f"{path}: has no line {name}:")


def rigid(values):
    return np.vstack([np.reshape(values, (3, 4)), [0, 0, 0, 1]])


class Calibration:
    def __init__(self, raw, names):
        mounts_path, mounts = lines_of(raw, "calibration", "calib_cam_to_pose.txt")
        lens_path, lenses = lines_of(raw, "calibration", "perspective.txt")
        self.k, self.mounts, self.sizes = {}, {}, {}
        for name in names:
            number = name[-2:]
            turned = np.eye(4)
            turned[:3, :3] = named(lenses, lens_path, f"R_rect_{number}", 9).reshape(3, 3)
            k = named(lenses, lens_path, f"P_rect_{number}", 12).reshape(3, 4)
            self.k[name], self.sizes[name] = (
                k[:, :3],
                tuple(int(v) for v in named(lenses, lens_path, f"S_rect_{number}", 2)),
            )
            self.mounts[name] = poses.check(
                rigid(named(mounts, mounts_path, name, 12)) @ np.linalg.inv(turned), f"{mounts_path}, {name}"
            )
        self.first = poses.check(rigid(named(mounts, mounts_path, "image_00", 12)), mounts_path)
        velo_path, velo = lines_of(raw, "calibration", "calib_cam_to_velo.txt")
        self.pose_from_velo = self.first @ poses.inverse(rigid(numbers(" ".join(velo), 12, velo_path)))


def read_poses(raw, sequence):
    """World-from-car poses by frame."""
    path, lines = lines_of(raw, "data_poses", sequence, "poses.txt")
    out = {}
    for n, line in enumerate(lines):
        if line.strip():
            values = numbers(line, 13, f"{path}:{n + 1}")
            out[int(values[0])] = poses.check(rigid(values[1:]), f"{path}:{n + 1}")
    if not out:
        raise RecordingError(f"{path}: has no poses")
    return dict(sorted(out.items()))


def read_times(folder):
    """Seconds since the first line, one line per frame; dates have nine decimals."""
    path, lines = lines_of(folder, "timestamps.txt")
    stamps = []
    for n, line in enumerate(line for line in lines if line.strip()):
        whole, _, part = line.strip().partition(".")
        try:
            date = datetime.datetime.strptime(whole, "%Y-%m-%d %H:%M:%S").replace(tzinfo=datetime.timezone.utc)
            stamps.append(int(date.timestamp()) * 10**9 + int((part or "0").ljust(9, "0")[:9]))
        except ValueError:
            raise RecordingError(
                f"{path}:{n + 1}: expected a date such as 2013-05-28 08:46:02.904302080, found {line.strip()[:60]!r}"
            ) from None
    return [(stamp - stamps[0]) / 1e9 for stamp in stamps]


def read(drive, cameras, frames, out, progress):
    raw, sequence = os.path.dirname(os.path.dirname(drive)), os.path.basename(drive)
    present = [name for name in CAMERAS if os.path.isdir(os.path.join(drive, name, "data_rect"))]
    if not present:
        raise RecordingError(f"{drive}: has no photographs; expected {CAMERAS[0]}/data_rect/0000000000.png")
    names = chosen(present, cameras, "camera")
    out.account.leave_out(
        "cameras", "have no photographs", [] if cameras else [name for name in CAMERAS if name not in names]
    )
    calibration, ways, times = (
        Calibration(raw, names),
        read_poses(raw, sequence),
        read_times(os.path.join(drive, names[0])),
    )
    shots = {
        name: numbered(os.path.join(drive, name, "data_rect"), (".png", ".jpg", ".jpeg"), "photographs", None, frames)
        for name in names
    }
    steps = complete([frame for frame in ways if frame < len(times) and in_frames(frame, frames)], shots, out.account)
    if not steps:
        raise RecordingError(
            f"{drive}: no frame is left that has a pose, a time and a photograph of each camera, or --frames selected none"
        )
    for name in names:
        out.add_camera(name, calibration.sizes[name], calibration.k[name])
    boxes, scans = (
        read_boxes(raw, sequence, steps, out.account),
        os.path.join(raw, "data_3d_raw", sequence, "velodyne_points", "data"),
    )
    sweeps = numbered(scans, (".bin",), "sweeps", out.account, frames)
    out.account.contains("sweeps", sum(frame in sweeps for frame in steps), scans)
    out.account.leave_out(
        "sweeps", "the files are missing", [f"frame {frame}" for frame in steps if sweeps and frame not in sweeps]
    )
    out.account.leave_out(
        "sweeps", "of frames that are left out", count=sum(frame not in set(steps) for frame in sweeps)
    )
    progress.total = len(steps)
    for done, frame in enumerate(steps):
        progress.show(done)
        step = out.add_step(times[frame], ways[frame] @ EGO_FROM_POSE)
        for name in names:
            step.photograph(name, shots[name][frame], ways[frame] @ calibration.mounts[name], times[frame])
        if frame in sweeps and not step.has_lidar(["intensity"]):
            put_sweep(step, sweeps[frame], frame, ways, calibration.pose_from_velo)
        for track, kind, pose, size in boxes.get(frame, ()):
            step.box(track, kind, pose, size)


def in_frames(frame, frames):
    return frames is None or frames[0] <= frame <= frames[1]


def numbered(folder, endings, what, account, frames):
    """The files of a folder by frame number, for frames selected by --frames."""
    found = {int(name): path for name, path in listed(folder, endings, what, account).items() if name.isdigit()}
    return {frame: path for frame, path in found.items() if in_frames(frame, frames)}


def put_sweep(step, path, frame, ways, pose_from_velo):
    values = np.fromfile(path, "<f4")
    if len(values) % 4 or os.path.getsize(path) % 16:
        raise RecordingError(
            f"{path}: has {os.path.getsize(path)} bytes, which aren't rows of 4 float32 x y z intensity"
        )
    rows = values.reshape(-1, 4).astype(np.float64)
    now = ways[frame] @ pose_from_velo
    if frame - 1 in ways:
        rows[:, :3] = untwisted(rows[:, :3], poses.inverse(now) @ ways[frame - 1] @ pose_from_velo)
    step.lidar(rows, now, ["intensity"])


def untwisted(points, before):
    """Corrects the points of a turn to the car's pose at the moment when the scanner faces forward. `before`: the scanner's previous pose relative to its
    current one. The scanner turns clockwise from behind, so a point is earlier by azimuth / 2 pi of a turn; rotation vector and translation are proportional
    to it, as in KITTI-360's accumuLaser. Rotations by Rodrigues' formula."""
    cosine = float(np.clip((np.trace(before[:3, :3]) - 1) / 2, -1, 1))
    vector = np.array(
        [before[2, 1] - before[1, 2], before[0, 2] - before[2, 0], before[1, 0] - before[0, 1]]
    )  # twice the sine, times the axis
    length = float(np.linalg.norm(vector))
    axis, angle = (vector / length, np.arctan2(length / 2, cosine)) if length > 1e-12 else (np.array([0.0, 0, 1]), 0.0)
    share = np.arctan2(points[:, 1], points[:, 0])[:, None] / (2 * np.pi)
    sine, rest = np.sin(share * angle), 1 - np.cos(share * angle)
    turned = points + sine * np.cross(axis, points) + rest * np.cross(axis, np.cross(axis, points))
    return turned + share * before[:3, 3]


# ---- Boxes ----


def matrix_of(element, where):
    try:
        rows, columns = int(element.find("rows").text), int(element.find("cols").text)
        return numbers(element.find("data").text, rows * columns, where).reshape(rows, columns)
    except (AttributeError, ValueError, TypeError):
        raise RecordingError(f"{where}: expected a matrix with rows, cols and data") from None


class Box:
    """One entry: a unit box, mapped to the world by `transform`."""

    def __init__(self, element, path):
        where = f"{path}, {element.tag}"
        try:
            self.frame, self.first, self.last = (
                int(element.find(name).text) for name in ("timestamp", "start_frame", "end_frame")
            )
            self.kind, self.instance = (int(element.find(name).text) for name in ("semanticId", "instanceId"))
        except (AttributeError, ValueError, TypeError):
            raise RecordingError(
                f"{where}: expected whole numbers timestamp, start_frame, end_frame, semanticId and instanceId"
            ) from None
        self.name = CLASSES.get(self.kind)
        if self.name:
            transform, corners = matrix_of(element.find("transform"), where), matrix_of(element.find("vertices"), where)
            if transform.shape != (4, 4) or corners.shape[1] != 3:
                raise RecordingError(f"{where}: expected a transform of 4 x 4 and vertices of 3 columns")
            stretch = np.linalg.norm(transform[:3, :3], axis=0)
            if not (stretch > 0).all():
                raise RecordingError(f"{where}: its transform is flat")
            axes, low, high = transform[:3, :3] / stretch, corners.min(0), corners.max(0)
            if np.linalg.det(axes) < 0:  # mirrored, as the vertices are
                axes[:, 1] *= -1
                low[1], high[1] = -high[1], -low[1]
            self.size = (high - low) * stretch
            self.pose = poses.pose(axes, transform[:3, 3] + axes @ (stretch * (low + high) / 2))


def read_boxes(raw, sequence, steps, account):
    """Boxes of movable objects by frame, of ascending `steps`. A static object has one box for all frames from its first to its last."""
    place = optional(raw, "data_3d_bboxes", "boxes", account)
    found = [
        path
        for part in ("train", "train_full")
        for path in [place and optional(os.path.join(place, part), f"{sequence}.xml", "boxes", None)]
        if path
    ]
    tracks, out = {}, {}
    if not found:
        if place:
            account.lacks("boxes", f"{place} has neither train/{sequence}.xml nor train_full/{sequence}.xml")
        return out
    try:
        for _, element in ET.iterparse(found[0]):
            if element.find("transform") is not None:
                box = Box(element, found[0])
                if box.name:
                    tracks.setdefault((box.name, box.instance), []).append(box)
                else:
                    account.leave_out("labels", "of static classes", count=1)
                element.clear()
    except ET.ParseError as error:
        raise RecordingError(f"{found[0]}: can't be read as XML: {error}") from None
    wanted, own = set(steps), 0
    for (name, instance), marks in tracks.items():
        turn = to_front(sorted((box for box in marks if box.frame >= 0), key=lambda box: box.frame))
        moving, given = {}, set()
        for box in marks:
            entry = (
                f"{name} {instance}",
                name,
                box.pose @ turn,
                np.abs(turn[:3, :3].T @ box.size),
            )  # one box for all frames
            for frame in (
                [box.frame] if box.frame >= 0 else steps[bisect_left(steps, box.first) : bisect_right(steps, box.last)]
            ):
                if frame in wanted:
                    own += 1
                    if box.frame >= 0 and frame in given:
                        account.leave_out("boxes", TWICE, [f"{name} {instance} in frame {frame}"])
                        continue
                    given |= {frame} if box.frame >= 0 else set()
                    moving[frame] = entry
        for frame, entry in moving.items():
            out.setdefault(frame, []).append(entry)
    account.contains("boxes", own, found[0])
    return out


def to_front(marks):
    """Rotation about z, multiplied to the boxes of a track, that makes x the front: the horizontal axis closest to the direction of motion."""
    turns = {front: poses.front_from_box(front) for front in ("+x", "-x", "+y", "-y")}
    score = dict.fromkeys(turns, 0.0)
    for a, b in zip(marks, marks[1:]):
        way = b.pose[:3, 3] - a.pose[:3, 3]
        for front, turn in turns.items():
            score[front] += float(way @ (a.pose @ turn)[:3, 0])
    best = max(score, key=score.get)
    return turns[best] if score[best] > LEAST_WAY else np.eye(4)
