# SPDX-License-Identifier: Apache-2.0
"""Reads a scene of nuScenes v1.0 (Caesar et al. 2020): JSON tables with tokens, undistorted photographs at 12 Hz, LiDAR at 20 Hz in the sensor's frame, boxes
at key frames (2 Hz) in the world (x forward, y left, z up; size is width, length, height), times in microseconds.

One time step is one photograph of the first camera, with the nearest photograph of each other camera and the nearest sweep; boxes are interpolated between
key frames to the photographs' mean time."""

import glob
import json
import os

import numpy as np

from . import poses
from .errors import RecordingError
from .importing import Tracks, chosen, existing, inside, joined, optional, sweeps_of_steps

CAMERAS = ("CAM_FRONT", "CAM_FRONT_LEFT", "CAM_FRONT_RIGHT", "CAM_BACK_LEFT", "CAM_BACK_RIGHT", "CAM_BACK")
LIDAR = "LIDAR_TOP"
LARGEST_GAP = 0.05  # maximum seconds between the photographs of a step: just above half of their 83 ms
SWEEP_GAP = 0.03  # maximum seconds between a step and its sweep: just above half of 50 ms
LABEL_GAP = 0.75  # maximum seconds between two labels of a track for interpolation; key frame interval: 0.5 s


def load(folder, name, *keys):
    """The rows of a table, each with these keys."""
    path = existing(folder, name + ".json")
    try:
        with open(path, encoding="utf-8") as file:
            rows = json.load(file)
    except ValueError as error:
        raise RecordingError(f"{path}: not JSON: {error}") from None
    if not isinstance(rows, list) or not all(isinstance(row, dict) for row in rows):
        raise RecordingError(f"{path}: expected a list of objects")
    for number, row in enumerate(rows):
        for key in keys:
            if key not in row:
                raise RecordingError(f"{path}: row {number} has no {key!r}")
    return rows


def by_token(rows):
    return {row["token"]: row for row in rows}


def look_up(table, token, path, what):
    if token not in table:
        raise RecordingError(f"{path}: {what} names {str(token)[:80]!r}, which doesn't exist")
    return table[token]


def pose_of(row):
    return poses.pose(row["rotation"], row["translation"], order="wxyz")


def versions(raw):
    return sorted(
        path
        for path in glob.glob(os.path.join(glob.escape(raw), "v1.0-*"))
        if os.path.exists(os.path.join(path, "scene.json"))
    )


def sequences(raw):
    """The scenes of all versions in the folder, by name."""
    found = {}
    for folder in versions(raw):
        for scene in load(folder, "scene", "token", "name", "first_sample_token"):
            found.setdefault(scene["name"], os.path.join(folder, scene["name"]))
    return found


class Scene:
    """The rows of one scene. `source`: folder of its version, and its name."""

    def __init__(self, source, account):
        self.account = account
        self.folder, name = os.path.split(source)
        self.root = os.path.dirname(self.folder)
        self.scene = next(
            row for row in load(self.folder, "scene", "token", "name", "first_sample_token") if row["name"] == name
        )
        self.samples = {
            row["token"]: row
            for row in load(self.folder, "sample", "token", "timestamp", "scene_token")
            if row["scene_token"] == self.scene["token"]
        }
        if not self.samples:
            raise RecordingError(f"{self.folder}/sample.json: no sample of {name}")
        self.zero = min(row["timestamp"] for row in self.samples.values())
        self.mounts = by_token(
            load(
                self.folder, "calibrated_sensor", "token", "sensor_token", "translation", "rotation", "camera_intrinsic"
            )
        )
        sensors = by_token(load(self.folder, "sensor", "token", "channel"))
        data = [
            row
            for row in load(
                self.folder,
                "sample_data",
                "token",
                "sample_token",
                "ego_pose_token",
                "calibrated_sensor_token",
                "timestamp",
                "filename",
            )
            if row["sample_token"] in self.samples
        ]
        self.channels = {}
        for row in data:
            mount = look_up(
                self.mounts,
                row["calibrated_sensor_token"],
                f"{self.folder}/calibrated_sensor.json",
                f"sample_data {row['token']}",
            )
            channel = look_up(
                sensors, mount["sensor_token"], f"{self.folder}/sensor.json", f"calibrated_sensor {mount['token']}"
            )["channel"]
            self.channels.setdefault(channel, []).append(row)
        for channel, rows in self.channels.items():
            self.channels[channel] = self.present(channel, sorted(rows, key=lambda row: row["timestamp"]))
        wanted = {row["ego_pose_token"] for row in data}
        self.egos = {
            row["token"]: row
            for row in load(self.folder, "ego_pose", "token", "translation", "rotation")
            if row["token"] in wanted
        }

    def present(self, channel, rows):
        """The rows whose files exist, each file once."""
        what, there, missing = "sweeps" if channel == LIDAR else "photographs", {}, []
        for row in rows if channel == LIDAR or channel.startswith("CAM") else ():
            path = self.file(row)
            if not os.path.exists(path):
                if not missing:  # all files have the same format
                    optional(*os.path.split(path), what, None)
                missing.append(row["filename"])
            elif path in there:
                self.account.leave_out(
                    "rows", f"sample_data.json names the file of {channel} in another row, too", [row["filename"]]
                )
            else:
                there[path] = row
        self.account.leave_out(what, f"{channel}: the files are missing", missing)
        return list(there.values())

    def time(self, row):
        return (row["timestamp"] - self.zero) / 1e6

    def ego(self, row):
        return pose_of(
            look_up(self.egos, row["ego_pose_token"], f"{self.folder}/ego_pose.json", f"sample_data {row['token']}")
        )

    def mount(self, row):
        return self.mounts[row["calibrated_sensor_token"]]

    def file(self, row):
        return inside(self.root, row["filename"], f"{self.folder}/sample_data.json: {row['token']}")

    def tracks(self):
        """Boxes at key frames; empty if the version has none (v1.0-test)."""
        tracks = Tracks(self.account)
        if not optional(self.folder, "sample_annotation.json", "boxes", self.account):
            return tracks
        rows = load(
            self.folder,
            "sample_annotation",
            "token",
            "sample_token",
            "instance_token",
            "translation",
            "rotation",
            "size",
        )
        instances = by_token(load(self.folder, "instance", "token", "category_token"))
        categories = by_token(load(self.folder, "category", "token", "name"))
        mine = [row for row in rows if row["sample_token"] in self.samples]
        for row in sorted(mine, key=lambda row: self.samples[row["sample_token"]]["timestamp"]):
            instance = look_up(
                instances, row["instance_token"], f"{self.folder}/instance.json", f"sample_annotation {row['token']}"
            )
            category = look_up(
                categories, instance["category_token"], f"{self.folder}/category.json", f"instance {instance['token']}"
            )
            width, length, height = row["size"]
            tracks.add(
                row["instance_token"],
                category["name"],
                self.time(self.samples[row["sample_token"]]),
                pose_of(row),
                [length, width, height],
            )
        return tracks

    def labels(self):
        """LiDAR labels of key frames (nuScenes-lidarseg), files by the sweep's token; None without them."""
        if not os.path.exists(os.path.join(self.folder, "lidarseg.json")):
            return None
        return {
            row["sample_data_token"]: inside(self.root, row["filename"], f"{self.folder}/lidarseg.json: {row['token']}")
            for row in load(self.folder, "lidarseg", "token", "sample_data_token", "filename")
        }


def read(source, cameras, frames, out, progress):
    scene = Scene(source, out.account)
    out.account.leave_out(
        "sensors",
        f"neither cameras nor {LIDAR}",
        sorted(name for name in scene.channels if name != LIDAR and not name.startswith("CAM")),
    )
    for name in [name for name in scene.channels if name.startswith("CAM") and not scene.channels[name]]:
        del scene.channels[name]
        out.account.leave_out("cameras", "no photographs", [name])
    present = [name for name in CAMERAS if name in scene.channels] + [
        name for name in scene.channels if name.startswith("CAM") and name not in CAMERAS
    ]
    if not present:
        raise RecordingError(f"{scene.folder}/sample_data.json: {scene.scene['name']} has no camera")
    names = chosen(present, cameras, "camera")
    shots = {name: [row["timestamp"] for row in scene.channels[name]] for name in names}
    steps = [
        {name: scene.channels[name][i] for name, i in picked.items()}
        for _, picked in joined(shots[names[0]], shots, LARGEST_GAP, frames, out.account, 1e6)
    ]
    if not steps:
        raise RecordingError(
            f"{source}: no time step left: none has a photograph of every camera within {LARGEST_GAP} s, or --frames selected none"
        )
    progress.total = len(steps)
    for name in names:
        first = steps[0][name]
        k = np.asarray(scene.mount(first)["camera_intrinsic"], np.float64)
        if not first.get("width") or not first.get("height"):
            raise RecordingError(f"{scene.folder}/sample_data.json: {first['token']} has no width and height")
        out.add_camera(name, (first["width"], first["height"]), k)
    tracks, labels = scene.tracks(), scene.labels()
    sweeps = scene.channels.get(LIDAR, [])
    middles = [float(np.mean([scene.time(row) for row in picked.values()])) for picked in steps]
    swept = sweeps_of_steps(
        [scene.time(row) for row in sweeps], middles, SWEEP_GAP, f"{scene.folder}/sample_data.json", out.account
    )
    tracks.within(middles[0], middles[-1], f"{scene.folder}/sample_annotation.json")
    for number, picked in enumerate(steps):
        progress.show(number)
        put_step(
            scene, out, picked, middles[number], sweeps[swept[number]] if swept[number] >= 0 else None, labels, tracks
        )
    tracks.end()


def put_step(scene, out, picked, middle, sweep, labels, tracks):
    first = next(iter(picked.values()))
    step = out.add_step(middle, scene.ego(sweep or first))
    for name, row in picked.items():
        step.photograph(name, scene.file(row), scene.ego(row) @ pose_of(scene.mount(row)), scene.time(row))
    columns = ["intensity"] if labels is None else ["intensity", "label"]
    if sweep and not step.has_lidar(columns):
        points = points_of(scene.file(sweep))
        if labels is not None:
            points = np.column_stack([points, labels_of(labels.get(sweep["token"]), len(points))])
        step.lidar(points, scene.ego(sweep) @ pose_of(scene.mount(sweep)), columns)
    tracks.put(step, middle, LABEL_GAP)


def points_of(path):
    """x, y, z, intensity of a sweep; a row in the file also has the ring number."""
    values = np.fromfile(existing(path), "<f4")
    if values.size == 0 or values.size % 5:
        raise RecordingError(f"{path}: {values.size} numbers are not rows of 5; expected x, y, z, intensity, ring")
    return values.reshape(-1, 5)[:, :4]


def labels_of(path, count):
    """The label of each point; 0 (noise) if the sweep has none."""
    if path is None:
        return np.zeros(count)
    found = np.fromfile(existing(path), np.uint8)
    if len(found) != count:
        raise RecordingError(f"{path}: has {len(found)} labels for {count} points")
    return found
