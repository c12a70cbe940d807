# SPDX-License-Identifier: Apache-2.0
"""Reads a segment of the Waymo Open Dataset, version 2 (Sun et al. 2020): one folder per component (camera_image, lidar_box, ...), with one parquet file per
segment. The selections are those of version 1, which `pags import waymo` reads: see docs/import.md.

A time step is a frame; its photographs have poses of their own, extrapolated to the middle of their exposure; boxes are those of the frame, in the car's
frame (x forward, y left, z up)."""

import glob
import os

import numpy as np

from . import poses
from .errors import RecordingError
from .importing import TWICE, choose_steps, chosen, complete, existing, optional, others_reading

NAMES = {1: "front", 2: "front_left", 3: "front_right", 4: "side_left", 5: "side_right"}
USUAL = ("front", "front_left", "front_right")
CLASSES = {0: "Unknown", 1: "Vehicle", 2: "Pedestrian", 3: "Sign", 4: "Cyclist"}
FRAME, CAMERA, LASER, THING = "key.frame_timestamp_micros", "key.camera_name", "key.laser_name", "key.laser_object_id"
ROWS = 8  # rows in memory: a row of the roof's LiDAR takes 5 MB
MOST_ROWS = 10_000_000  # maximum rows of a file; the largest tables, the boxes, have some 100,000
FARTHEST_POSE = 0.1  # maximum seconds between a photograph's pose and the middle of its exposure for extrapolation with its velocity


class Component:
    """A parquet file, read a few rows at a time, fastest in file order. `prefix` is removed from the columns' names."""

    def __init__(self, raw, folder, segment, prefix, columns, keys):
        from pyarrow import parquet

        self.path = existing(raw, folder, f"{segment}.parquet")
        self.prefix, self.columns = f"[{prefix}].", columns
        with self.reading():
            self.file = parquet.ParquetFile(self.path)
            self.check_counts()
            there = set(self.file.schema_arrow.names)
            lacking = [name for name in [*keys, *(self.prefix + column for column in columns)] if name not in there]
            if lacking:
                raise RecordingError(f"{self.path}: has no column {lacking[0]!r}")
            for name in [*keys, *(self.prefix + column for column in columns)]:
                kind = self.file.schema_arrow.field(name).type
                if not fits(kind, name):
                    raise RecordingError(f"{self.path}: column {name!r} has the unsupported type {kind}")
            rows = self.file.read(columns=keys).to_pylist()
        self.places, self.twice = {}, []  # row number by key; keys of further rows
        for number, row in enumerate(rows):
            key = tuple(row[name] for name in keys)
            if None in key[: len(keys) - (THING in keys)]:
                raise RecordingError(f"{self.path}: row {number} has no {keys[key.index(None)]}")
            if self.places.setdefault(key, number) != number:
                self.twice.append(key)
        groups = self.file.metadata
        self.begins = np.cumsum([0, *(groups.row_group(i).num_rows for i in range(groups.num_row_groups))])
        self.group = None

    def check_counts(self):
        """Rejects row groups that claim more rows than the file: allocating for them could take terabytes. (Columns are not checked: pyarrow ends the process
        on a damaged one.)"""
        about = self.file.metadata
        rows = [about.row_group(i).num_rows for i in range(about.num_row_groups)]
        if sum(rows) != about.num_rows or min(rows, default=0) < 0 or about.num_rows > MOST_ROWS:
            raise RecordingError(
                f"{self.path}: its row groups have {sum(rows)} rows, the file {about.num_rows}; expected the same number, at most {MOST_ROWS}"
            )

    def reading(self):
        return others_reading(self.path, "can't be read as parquet")

    def enter(self, group):
        """Starts a row group from its beginning; in random access this limits reading to the group's rows."""
        self.batches = self.file.iter_batches(
            batch_size=ROWS, row_groups=[group], columns=[self.prefix + column for column in self.columns]
        )
        self.group, self.first, self.batch = group, int(self.begins[group]), None

    def at(self, *key):
        """The row of a key, columns without the prefix, lists as arrays; None if missing."""
        if key not in self.places:
            return None
        number = self.places[key]
        group = int(np.searchsorted(self.begins, number, "right")) - 1
        if group != self.group or number < self.first:
            self.enter(group)
        with self.reading():
            while self.batch is None or number >= self.first + self.batch.num_rows:
                self.first += self.batch.num_rows if self.batch else 0
                self.batch = next(self.batches, None)
                if self.batch is None:
                    raise RecordingError(f"{self.path}: has fewer rows than its header states")
                self.batch.validate(full=True)
            return {
                column: plain(self.batch.column(self.prefix + column)[number - self.first]) for column in self.columns
            }

    def whole(self, *key):
        """The complete row of a key; raises if a value is missing."""
        row = self.at(*key)
        lacking = next((column for column, value in (row or {"": None}).items() if value is None), None)
        if lacking is not None:
            raise RecordingError(f"{self.path}: {', '.join(map(str, key))} has no {lacking or 'row'}")
        return row


def fits(kind, name):
    """Whether an arrow type is valid for a column: keys are integers, except ids; lists have numbers; a picture has bytes."""
    from pyarrow import types

    number = lambda kind: types.is_integer(kind) or types.is_floating(kind)  # noqa: E731
    inner = getattr(kind, "value_type", None)
    if name == THING:
        return types.is_string(kind) or types.is_large_string(kind)
    if name.startswith("key."):
        return types.is_integer(kind)
    if name.endswith("].image"):
        return types.is_binary(kind) or types.is_large_binary(kind)
    if name.endswith((".transform", ".values", ".shape")):
        return (
            types.is_null(kind)
            or (types.is_list(kind) or types.is_large_list(kind) or types.is_fixed_size_list(kind))
            and (number(inner) or types.is_null(inner))
        )
    return number(kind) or types.is_null(kind)


def plain(value):
    values = getattr(value, "values", None)
    return value.as_py() if values is None else values.to_numpy(zero_copy_only=False)


def transform(values, what):
    """A pose of 16 numbers, some rounded to float32: its rotation is orthonormalised."""
    m = np.array(values if values is not None else [], np.float64)
    if m.size != 16:
        raise RecordingError(f"{what}: expected 16 numbers, found {m.size}")
    m = m.reshape(4, 4)
    if not np.isfinite(m).all() or np.abs(m[:3, :3] @ m[:3, :3].T - np.eye(3)).max() > 1e-4:
        return poses.check(m, what)
    u, _, v = np.linalg.svd(m[:3, :3])
    m[:3, :3] = u @ v
    return poses.check(m, what)


def sequences(raw):
    found = glob.glob(os.path.join(glob.escape(raw), "camera_image", "*.parquet"))
    return {os.path.basename(path)[: -len(".parquet")]: path for path in sorted(found)}


def read(path, cameras, frames, out, progress):
    raw, segment = os.path.dirname(os.path.dirname(path)), os.path.basename(path)[: -len(".parquet")]
    vector = lambda name: [f"{name}.{axis}" for axis in "xyz"]  # noqa: E731
    images = Component(
        raw,
        "camera_image",
        segment,
        "CameraImageComponent",
        [
            "image",
            "pose.transform",
            "pose_timestamp",
            *vector("velocity.linear_velocity"),
            *vector("velocity.angular_velocity"),
            "rolling_shutter_params.camera_trigger_time",
            "rolling_shutter_params.camera_readout_done_time",
        ],
        [FRAME, CAMERA],
    )
    lenses = Component(
        raw,
        "camera_calibration",
        segment,
        "CameraCalibrationComponent",
        [
            *(f"intrinsic.{k}" for k in ("f_u", "f_v", "c_u", "c_v", "k1", "k2", "p1", "p2", "k3")),
            "extrinsic.transform",
            "width",
            "height",
        ],
        [CAMERA],
    )
    ways = Component(raw, "vehicle_pose", segment, "VehiclePoseComponent", ["world_from_vehicle.transform"], [FRAME])
    present = [
        NAMES[number]
        for number in sorted(NAMES)
        if (number,) in lenses.places and any(key[1] == number for key in images.places)
    ]
    if not present:
        raise RecordingError(f"{images.path}: no photographs of a camera in {lenses.path}")
    names = chosen(present, cameras, "camera") if cameras else [name for name in present if name in USUAL] or present
    out.account.leave_out(
        "cameras",
        "not front cameras; select them with --cameras",
        [] if cameras else [name for name in present if name not in names],
    )
    out.account.leave_out("rows", "duplicates of the same frame and camera in camera_image", images.twice)
    numbers = {name: number for number, name in NAMES.items() if name in names}
    shots = {name: {stamp for stamp, camera in images.places if camera == number} for name, number in numbers.items()}
    steps = choose_steps(
        complete(sorted(stamp for (stamp,) in ways.places if stamp is not None), shots, out.account),
        frames,
        out.account,
    )
    if not steps:
        raise RecordingError(
            f"{raw}: no frame of {segment} left: none has a photograph of every camera, or --frames selected none"
        )
    mounts = {}
    for name, number in numbers.items():
        lens = lenses.whole(number)
        k = [
            [lens["intrinsic.f_u"], 0, lens["intrinsic.c_u"]],
            [0, lens["intrinsic.f_v"], lens["intrinsic.c_v"]],
            [0, 0, 1],
        ]
        out.add_camera(
            name,
            (lens["width"], lens["height"]),
            k,
            [lens[f"intrinsic.{key}"] for key in ("k1", "k2", "p1", "p2", "k3")],
            pixel_centre=0.5,
        )
        mounts[name] = transform(
            lens["extrinsic.transform"], f"{lenses.path}: the extrinsic of camera {name}"
        ) @ poses.axes_from_opencv("waymo")
    boxes, lidar = boxes_of(raw, segment, steps, out.account), Lidar.of(raw, segment, out.account)
    out.account.contains(
        "sweeps",
        len(set(steps) & {stamp for stamp, _ in lidar.images.places}) if lidar else 0,
        os.path.join(raw, "lidar", f"{segment}.parquet"),
    )
    progress.total = len(steps)
    for done, stamp in enumerate(steps):
        progress.show(done)
        where = f"{ways.path}, frame {stamp}"
        world_from_ego = transform(ways.whole(stamp)["world_from_vehicle.transform"], where)
        step = out.add_step((stamp - steps[0]) / 1e6, world_from_ego)
        for name, number in numbers.items():
            put_photograph(
                step,
                images.at(stamp, number),
                name,
                world_from_ego,
                mounts[name],
                steps[0] / 1e6,
                f"{images.path}, frame {stamp}, camera {name}",
            )
        if lidar and not step.has_lidar(["intensity"]):
            points = lidar.points(stamp, world_from_ego)
            if len(points):
                step.lidar(points, world_from_ego, ["intensity"])
            else:
                out.account.leave_out("sweeps", "no range image has returns", [f"frame {stamp}"])
        for track, name, pose, size in boxes.get(stamp, ()):
            step.box(track, name, world_from_ego @ pose, size)


def put_photograph(step, row, name, world_from_ego, mount, zero, where):
    """A photograph; its pose is the car's at its pose_timestamp, extrapolated with its velocities to the middle of trigger and read-out."""
    if not row["image"]:
        raise RecordingError(f"{where}: no photograph")
    trigger, readout = (
        row[f"rolling_shutter_params.{key}"] for key in ("camera_trigger_time", "camera_readout_done_time")
    )
    known = trigger is not None and readout is not None and readout >= trigger
    middle = 0.5 * (trigger + readout) if known else row["pose_timestamp"]
    pose = world_from_ego if row["pose.transform"] is None else transform(row["pose.transform"], where)
    linear, angular = (
        np.array([row[f"velocity.{kind}_velocity.{axis}"] for axis in "xyz"], object) for kind in ("linear", "angular")
    )
    lag = middle - row["pose_timestamp"] if known and row["pose_timestamp"] is not None else 0.0
    if (
        row["pose.transform"] is not None
        and abs(lag) < FARTHEST_POSE
        and not any(v is None or not np.isfinite(v) for v in [*linear, *angular])
    ):
        pose = moved(pose, linear.astype(float) * lag, angular.astype(float) * lag)
    step.photograph(name, row["image"], pose @ mount, None if middle is None else middle - zero)


def moved(pose, way, turn):
    """A pose moved by a translation and a rotation vector in the world's axes (Rodrigues 1840)."""
    angle = float(np.linalg.norm(turn))
    x, y, z = turn / angle if angle > 0 else (0.0, 0.0, 0.0)
    k = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    out = pose.copy()
    out[:3, :3] = (np.eye(3) + np.sin(angle) * k + (1 - np.cos(angle)) * k @ k) @ pose[:3, :3]
    out[:3, 3] += way
    return out


def boxes_of(raw, segment, steps, account):
    """Boxes by frame, in the car's frame. Drops labels without id or size or with non-finite numbers; an id with two classes becomes two objects."""
    if not optional_component(raw, "lidar_box", segment, "boxes", account):  # the test split has no labels
        return {}
    numbers = ["box.center.x", "box.center.y", "box.center.z", "box.heading", "box.size.x", "box.size.y", "box.size.z"]
    rows, out, classes = (
        Component(raw, "lidar_box", segment, "LiDARBoxComponent", [*numbers, "type"], [FRAME, THING]),
        {},
        {},
    )
    read = set(steps)
    account.contains("boxes", sum(stamp in read for stamp, _ in rows.places), rows.path)
    account.leave_out("boxes", TWICE, [f"{track} in frame {stamp}" for stamp, track in rows.twice])
    for stamp, track in rows.places:
        row = rows.at(stamp, track)
        values = np.array([np.nan if row[name] is None else row[name] for name in numbers], np.float64)
        if not track or not np.isfinite(values).all() or (values[4:] <= 0).any():
            account.leave_out("boxes", "no id, no size or non-finite numbers", [f"{track} in frame {stamp}"])
            continue
        name = CLASSES.get(row["type"], "Unknown")
        first = classes.setdefault(track, name)
        out.setdefault(stamp, []).append(
            (track if first == name else f"{track} {name}", name, poses.turned_left(values[3], values[:3]), values[4:])
        )
    return out


def optional_component(raw, folder, segment, what, account):
    """Whether an optional folder has a file of the segment."""
    place = optional(raw, folder, what, account)
    return place and optional(place, f"{segment}.parquet", what, account)


class Lidar:
    """Points of all LiDARs and both returns, from their range images."""

    def __init__(self, raw, segment, account):
        returns = [f"range_image_return{n}.{part}" for n in (1, 2) for part in ("values", "shape")]
        self.images = Component(raw, "lidar", segment, "LiDARComponent", returns, [FRAME, LASER])
        self.scanners = Component(
            raw,
            "lidar_calibration",
            segment,
            "LiDARCalibrationComponent",
            ["extrinsic.transform", "beam_inclination.min", "beam_inclination.max", "beam_inclination.values"],
            [LASER],
        )
        turning = optional_component(raw, "lidar_pose", segment, "poses of the LiDAR's pixels", account)
        self.turns = (
            Component(raw, "lidar_pose", segment, "LiDARPoseComponent", returns[:2], [FRAME, LASER])
            if turning
            else None
        )

    @classmethod
    def of(cls, raw, segment, account):
        return cls(raw, segment, account) if optional_component(raw, "lidar", segment, "sweeps", account) else None

    def points(self, stamp, world_from_ego):
        """x y z intensity in the car's frame at the frame's time, by LiDAR, return, row and column."""
        found = [np.zeros((0, 4))]
        for (laser,) in sorted(self.scanners.places):
            row = self.images.at(stamp, laser)
            turn = self.turns.at(stamp, laser) if self.turns else None
            for n in (1, 2):
                if row and filled(row[f"range_image_return{n}.values"]):
                    where = f"{self.images.path}, frame {stamp}, LiDAR {laser}"
                    image = shaped(row, f"range_image_return{n}", 4, where)
                    pose = (
                        shaped(turn, "range_image_return1", 6, where)
                        if turn and filled(turn["range_image_return1.values"])
                        else None
                    )
                    found.append(self.decode(laser, image, pose, world_from_ego, where))
        return np.concatenate(found)

    def decode(self, laser, image, pose, world_from_ego, where):
        """Row r of H has the inclination of beam H - 1 - r, beams ascending: listed, or uniform with half steps at the ends. Column c of W has the azimuth (1
        - (2 c + 1) / W) pi minus the LiDAR's own yaw. The roof's LiDAR has a car pose per pixel, which corrects for motion."""
        scanner, (height, width) = self.scanners.at(laser), image.shape[:2]
        mount = transform(scanner["extrinsic.transform"], f"{self.scanners.path}: the extrinsic of LiDAR {laser}")
        low, high = (
            np.nan if value is None else value
            for value in (scanner["beam_inclination.min"], scanner["beam_inclination.max"])
        )
        listed = scanner["beam_inclination.values"]
        beams = (
            np.asarray(listed, np.float64)
            if filled(listed)
            else low + (np.arange(height) + 0.5) / height * (high - low)
        )
        if len(beams) != height or not np.isfinite(beams).all():
            raise RecordingError(
                f"{where}: {len(beams)} beam inclinations for a range image of {height} rows, or non-finite values"
            )
        if pose is not None and pose.shape[:2] != (height, width):
            raise RecordingError(
                f"{where}: poses of {pose.shape[0]} x {pose.shape[1]} pixels for a range image of {height} x {width}"
            )
        seen = (image[..., 0] > 0) & np.isfinite(image[..., :2]).all(-1)
        r, c = np.nonzero(seen)
        distance, up = image[r, c, 0].astype(np.float64), beams[::-1][r]
        around = (1 - (2 * c + 1) / width) * np.pi - np.arctan2(mount[1, 0], mount[0, 0])
        points = (
            distance[:, None]
            * np.stack([np.cos(up) * np.cos(around), np.cos(up) * np.sin(around), np.sin(up)], -1)
            @ mount[:3, :3].T
            + mount[:3, 3]
        )
        if pose is not None:
            world = turned(pose[r, c].astype(np.float64), points)
            points = (world - world_from_ego[:3, 3]) @ world_from_ego[:3, :3]
        rows = np.column_stack([points, image[r, c, 1]])
        return rows[np.isfinite(rows).all(1)]


def turned(pixels, points):
    """Points transformed each by its own pose: roll, pitch, yaw (R = Rz Ry Rx), x, y, z."""
    (cr, cp, cy), (sr, sp, sy) = np.cos(pixels[:, :3].T), np.sin(pixels[:, :3].T)
    x, y, z = points.T
    y, z = cr * y - sr * z, sr * y + cr * z
    x, z = cp * x + sp * z, cp * z - sp * x
    x, y = cy * x - sy * y, sy * x + cy * y
    return np.stack([x, y, z], -1) + pixels[:, 3:]


def filled(values):
    return values is not None and len(values) > 0


def shaped(row, name, depth, where):
    values, shape = np.asarray(row[f"{name}.values"], np.float32), row[f"{name}.shape"]
    if (
        shape is None
        or len(shape) != 3
        or shape[2] != depth
        or min(shape) < 1
        or int(np.prod(shape, dtype=np.int64)) != len(values)
    ):
        raise RecordingError(
            f"{where}: {name} has {len(values)} numbers and the shape {None if shape is None else [int(n) for n in shape]}; expected rows x columns x {depth}"
        )
    return values.reshape(shape)
