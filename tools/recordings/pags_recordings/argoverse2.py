# SPDX-License-Identifier: Apache-2.0
"""Reads a log of the Argoverse 2 Sensor Dataset (Wilson et al. 2021): feather tables, undistorted photographs, LiDAR at 10 Hz corrected for the car's motion
to its time stamp, boxes at the sweeps' times in the car's frame (x forward, y left, z up).

One time step is one sweep with the nearest photograph of each camera; boxes are interpolated to the photographs' mean time."""

import glob
import os

import numpy as np

from . import poses
from .errors import RecordingError
from .importing import Tracks, chosen, existing, inside, joined, listed, optional, others_reading

CAMERAS = (
    "ring_front_center",
    "ring_front_left",
    "ring_front_right",
    "ring_side_left",
    "ring_side_right",
    "ring_rear_left",
    "ring_rear_right",
)
LARGEST_GAP = (
    0.03  # maximum seconds between a sweep and a photograph of its step: just above half of the cameras' 50 ms
)
LABEL_GAP = 0.25  # maximum seconds between two labels of a track for interpolation; label interval: 0.1 s


def by_sensor(path, columns):
    """A table indexed by sensor name; names are unique."""
    rows = table(path, ["sensor_name", *columns]).set_index("sensor_name")
    if not rows.index.is_unique:
        raise RecordingError(f"{path}: has two rows of {rows.index[rows.index.duplicated()][0]}")
    return rows


TEXTS = ("sensor_name", "track_uuid", "category")


def table(path, columns):
    import pandas
    from pyarrow import feather

    with others_reading(path, "can't be read as feather"):
        content = feather.read_table(existing(path), memory_map=False)
        content.validate(
            full=True
        )  # not memory-mapped: text offsets beyond the end of a damaged file would crash the process
        rows = content.to_pandas()
    lacking = [name for name in columns if list(rows.columns).count(name) != 1]
    if lacking or len(rows) == 0:
        raise RecordingError(
            f"{path}: {f'has no column {lacking[0]!r}' if lacking else 'has no rows'}; expected {', '.join(columns)}"
        )
    for name in columns:
        kind = rows[name].dtype
        right = (
            pandas.api.types.is_integer_dtype(kind)
            if name.endswith("_ns")
            else name in TEXTS
            or pandas.api.types.is_numeric_dtype(kind)
            and not pandas.api.types.is_complex_dtype(kind)
        )
        if not right or rows[name].isna().any() and name not in ("x", "y", "z", "intensity"):
            raise RecordingError(
                f"{path}: column {name!r} is of type {kind}, or lacks values; expected {'whole numbers' if name.endswith('_ns') else 'texts' if name in TEXTS else 'numbers'}"
            )
    return rows.astype({name: str for name in columns if name in TEXTS})


QUATERNION, TRANSLATION = ["qw", "qx", "qy", "qz"], ["tx_m", "ty_m", "tz_m"]


def pose_of(row):
    return poses.pose([row[k] for k in QUATERNION], [row[k] for k in TRANSLATION], order="wxyz")


def stamps(folder, endings, what, account):
    """Files named by their time in nanoseconds, ascending."""
    found = {}
    for name, path in listed(folder, endings, what, account).items():
        if not name.isdigit():
            raise RecordingError(f"{path}: expected the name of a time in nanoseconds")
        found[int(name)] = path
    return dict(sorted(found.items()))


def sequences(raw):
    """The logs in a folder: the folder itself, or its subfolders."""
    if os.path.exists(os.path.join(raw, "city_SE3_egovehicle.feather")):
        return {os.path.basename(os.path.abspath(raw)): raw}
    found = glob.glob(os.path.join(glob.escape(raw), "*", "city_SE3_egovehicle.feather"))
    return {os.path.basename(os.path.dirname(path)): os.path.dirname(path) for path in sorted(found)}


def read(log, cameras, frames, out, progress):
    lenses = by_sensor(
        os.path.join(log, "calibration", "intrinsics.feather"),
        ["fx_px", "fy_px", "cx_px", "cy_px", "width_px", "height_px"],
    )
    mounts = by_sensor(os.path.join(log, "calibration", "egovehicle_SE3_sensor.feather"), [*QUATERNION, *TRANSLATION])
    path = (
        table(os.path.join(log, "city_SE3_egovehicle.feather"), ["timestamp_ns", *QUATERNION, *TRANSLATION])
        .sort_values("timestamp_ns")
        .drop_duplicates("timestamp_ns")
    )
    photographs = os.path.join(log, "sensors", "cameras")
    table_of_lenses = os.path.join(log, "calibration", "intrinsics.feather")
    shots = {
        name: stamps(inside(photographs, name, table_of_lenses), (".jpg", ".jpeg", ".png"), "photographs", None)
        for name in lenses.index
    }
    present = [name for name in CAMERAS if shots.get(name)] + [
        name for name in lenses.index if shots[name] and name not in CAMERAS
    ]
    if not present:
        raise RecordingError(f"{photographs}: has no photographs; expected CAMERA/TIME.jpg")
    names = chosen(present, cameras, "camera") if cameras else [name for name in present if name in CAMERAS] or present
    out.account.leave_out(
        "cameras", "have no photographs", [name for name in CAMERAS if name in lenses.index and name not in present]
    )
    out.account.leave_out(
        "cameras",
        "not ring cameras; select them with --cameras",
        [] if cameras else [name for name in present if name not in names],
    )
    zero = int(path["timestamp_ns"].iloc[0])
    stations = (path["timestamp_ns"].to_numpy() - zero) / 1e9
    ways = [pose_of(row) for _, row in path.iterrows()]
    sweeps = stamps(os.path.join(log, "sensors", "lidar"), (".feather",), "sweeps", out.account)
    anchors = list(sweeps or shots[names[0]])
    times = {name: list(shots[name]) for name in names}
    steps = [
        (anchors[i], {name: times[name][j] for name, j in picked.items()})
        for i, picked in joined(anchors, times, LARGEST_GAP, frames, out.account, 1e9)
    ]
    if not steps:
        raise RecordingError(
            f"{log}: no time step left: none has a photograph of every camera within {LARGEST_GAP} s, or --frames selected none"
        )
    out.account.contains("sweeps", len(steps) if sweeps else 0, os.path.join(log, "sensors", "lidar"))
    out.account.leave_out("sweeps", "of time steps that were left out", count=len(sweeps) - len(steps) if sweeps else 0)
    progress.total = len(steps)
    tracks = read_tracks(log, zero, stations, ways, out.account)
    tracks.within((steps[0][0] - zero) / 1e9, (steps[-1][0] - zero) / 1e9, os.path.join(log, "annotations.feather"))
    for name in names:
        if name not in mounts.index:
            raise RecordingError(
                f"{os.path.join(log, 'calibration', 'egovehicle_SE3_sensor.feather')}: no row for {name}"
            )
        lens = lenses.loc[name]
        k = [[lens["fx_px"], 0, lens["cx_px"]], [0, lens["fy_px"], lens["cy_px"]], [0, 0, 1]]
        out.add_camera(name, (int(lens["width_px"]), int(lens["height_px"])), k)
    for number, (stamp, picked) in enumerate(steps):
        progress.show(number)
        put_step(
            out,
            (stamp - zero) / 1e9,
            {name: ((at - zero) / 1e9, shots[name][at]) for name, at in picked.items()},
            sweeps.get(stamp),
            mounts,
            stations,
            ways,
            tracks,
        )
    tracks.end()


def read_tracks(log, zero, stations, ways, account):
    tracks, name = Tracks(account), optional(log, "annotations.feather", "boxes", account)
    if not name:  # the test split has no labels
        return tracks
    rows = table(
        name, ["timestamp_ns", "track_uuid", "category", "length_m", "width_m", "height_m", *QUATERNION, *TRANSLATION]
    )
    cars = {}
    for _, row in rows.sort_values("timestamp_ns", kind="stable").iterrows():
        at = (int(row["timestamp_ns"]) - zero) / 1e9
        if at not in cars:  # labels and sweeps share time stamps
            cars[at] = poses.interpolate(stations, ways, at)
        box = cars[at] @ pose_of(row)
        tracks.add(row["track_uuid"], row["category"], at, box, [row["length_m"], row["width_m"], row["height_m"]])
    return tracks


def put_step(out, time, photographs, sweep, mounts, stations, ways, tracks):
    world_from_ego = poses.interpolate(stations, ways, time)
    step = out.add_step(time, world_from_ego)
    for name, (at, file) in photographs.items():
        step.photograph(name, file, poses.interpolate(stations, ways, at) @ pose_of(mounts.loc[name]), at)
    if sweep and not step.has_lidar(["intensity"]):
        rows = table(sweep, ["x", "y", "z", "intensity"])
        step.lidar(rows[["x", "y", "z", "intensity"]].to_numpy(np.float64), world_from_ego, ["intensity"])
    tracks.put(step, float(np.mean([at for at, _ in photographs.values()])), LABEL_GAP)
