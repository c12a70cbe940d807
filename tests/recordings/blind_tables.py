# SPDX-License-Identifier: Apache-2.0
"""Writes the synthetic street as raw recordings of PandaSet, Waymo version 2 and KITTI-360, as blind_trees.py does
for nuScenes and Argoverse 2.

The file formats come from these documents. PandaSet: README.md of pandaset-devkit and the docstrings of
python/pandaset. Waymo: src/waymo_open_dataset/v2 of waymo-open-dataset (perception/*.py lists columns and types,
utils/range_image_utils.py defines the geometry of range images). KITTI-360:
cvlibs.net/datasets/kitti-360/documentation.php and kitti360scripts (helpers/annotation.py, helpers/project.py,
devkits/accumuLaser)."""

import gzip
import json
import os
import pathlib
import uuid

import numpy as np
import old_pickle
import pyarrow as pa
import pyarrow.parquet
from blind_trees import Truth, inside, move, quaternion, save, turned
from old_pickle import Named

# ---- PandaSet ---------------------------------------------------------------------------------------------------------------

PANDASET_CLASSES = {"Car": "Car", "Pedestrian": "Pedestrian", "Cyclist": "Bicycle"}
PANDASET_CAMERAS = ["front_camera", "front_left_camera", "front_right_camera"]


def _packed(columns, name):
    """Returns a pickled table of pandas 1.0 with an explicit row index, as the README of pandaset-devkit prints it."""
    table = old_pickle.table(columns)
    manager = table.state["_data"]
    rows = len(next(iter(columns.values())))
    kind = Named(("pandas.core.indexes.numeric", "Int64Index"), None)
    axes = [
        manager.state[0][0],
        Named(("pandas.core.indexes.base", "_new_Index"), (kind, {"data": np.arange(rows), "name": name})),
    ]
    blocks = manager.state[3]["0.14.1"]["blocks"]
    manager.state = (axes, manager.state[1], [], {"0.14.1": {"axes": axes, "blocks": blocks}})
    return gzip.compress(old_pickle.dumps(table), 1)


def _heading(pose, random, keys="wxyz"):
    q = dict(zip("wxyz", quaternion(pose, random)))
    return {"heading": {key: q[key] for key in keys}, "position": dict(zip("xyz", map(float, pose[:3, 3])))}


def _pandaset_sequence(street, root, name, frames, shift, random, truth):
    stamp = 1557539924.49
    lidar = turned(-np.pi / 2, 1.0, 0.0, 1.8)  # Pandar64: y points forward
    poses = [shift @ street.ego[t] @ lidar for t in frames]
    text = lambda path, value: save(root, f"{name}/{path}", json.dumps(value, indent=1).replace("\n", "\r\n").encode())  # noqa: E731
    text("lidar/poses.json", [_heading(pose, random) for pose in poses])
    text("lidar/timestamps.json", [stamp + 0.1 * t for t in frames])
    text("meta/timestamps.json", [stamp + 0.1 * t for t in frames])
    text(
        "meta/gps.json",
        [
            {"lat": 37.776089291519924, "long": -122.39931707791749, "height": 2.9, "xvel": 0.0, "yvel": 0.0}
            for _ in frames
        ],
    )
    save(root, f"{name}/LICENSE.txt", b"CC BY 4.0\r\n")
    for c, camera in enumerate(PANDASET_CAMERAS):
        fx, fy, cx, cy = map(float, street.lens[c][:4])
        text(f"camera/{camera}/intrinsics.json", {"cy": cy, "cx": cx, "fy": fy, "fx": fx})
        text(
            f"camera/{camera}/poses.json",
            [_heading(shift @ street.ego[t] @ street.camera[c], random, "yzwx") for t in frames],
        )
        text(f"camera/{camera}/timestamps.json", [stamp + 0.1 * t + 0.004 * c for t in frames])
        for t in frames:
            digest = save(root, f"{name}/camera/{camera}/{t:02d}.jpg", street.jpeg(t, c, name))
            if truth:
                truth.photographs[digest] = (
                    t,
                    camera,
                    shift @ street.ego[t] @ street.camera[c],
                    [fx, fy, cx, cy, 0, 0, 0, 0, 0],
                )
    for t in frames:
        world = move(shift @ street.ego[t], street.sweep[t][:, :3].astype(float))
        n = len(world)
        sweep = {
            **{axis: world[:, i] for i, axis in enumerate("xyz")},
            "i": street.sweep[t][:, 3].astype(float) * 255,
            "t": stamp + 0.1 * t + np.arange(n) * 1e-6,
            "d": (np.arange(n) >= n * 2 // 3).astype(np.int64),
        }
        save(root, f"{name}/lidar/{t:02d}.pkl.gz", _packed(sweep, "index"))
        save(root, f"{name}/annotations/semseg/{t:02d}.pkl.gz", _packed({"class": np.full(n, 7)}, "index"))
        boxes = {}
        for identity, (kind, pose, size) in street.boxes[t].items():
            boxes[str(uuid.uuid5(uuid.NAMESPACE_URL, identity))] = (PANDASET_CLASSES[kind], shift @ pose, size, -1, "")
        first, second = (
            str(uuid.uuid5(uuid.NAMESPACE_URL, i)) for i in ("moving_car_029", "moving_car_029 by the other LiDAR")
        )
        if first in boxes:  # a moving object that both LiDARs see has two cuboids
            kind, pose, size = boxes[first][:3]
            boxes[first] = (kind, pose, size, 0, second)
            boxes[second] = (kind, pose @ turned(0, 0.4), size, 1, first)
        boxes[str(uuid.uuid5(uuid.NAMESPACE_URL, "sign"))] = (
            "Signs",
            shift @ turned(0.3, 14.0, 6.0, 2.2),
            np.array([0.2, 0.7, 0.7]),
            -1,
            "",
        )
        boxes[str(uuid.uuid5(uuid.NAMESPACE_URL, "cone"))] = (
            "Cones",
            shift @ turned(0.0, 9.0, 5.0, 0.3),
            np.array([0.3, 0.3, 0.6]),
            -1,
            "",
        )
        if truth:
            truth.points[t] = world
            truth.boxes[t] = {i: b[:3] for i, b in boxes.items() if i != second}
            truth.spare[t] = {i: b[:3] for i, b in boxes.items() if i == second}
        order = [list(boxes)[i] for i in random.permutation(len(boxes))]
        of = lambda get: [get(boxes[i]) for i in order]  # noqa: E731
        yaw = lambda b: np.arctan2(b[1][1, 0], b[1][0, 0]) - np.pi / 2  # yaw 0 looks along +y  # noqa: E731
        columns = {
            "uuid": order,
            "label": of(lambda b: b[0]),
            "yaw": np.array(of(yaw)),
            "stationary": np.array(of(lambda b: b[0] in ("Signs", "Cones"))),
            "camera_used": np.array(of(lambda b: -1)),
        }
        columns.update({f"position.{axis}": np.array(of(lambda b, i=i: b[1][i, 3])) for i, axis in enumerate("xyz")})
        columns.update(
            {f"dimensions.{axis}": np.array(of(lambda b, i=i: b[2][i])) for axis, i in zip("xyz", (1, 0, 2))}
        )
        columns.update(
            {
                "attributes.object_motion": of(lambda b: "Moving" if b[0] == "Car" else ""),
                "cuboids.sibling_id": of(lambda b: b[4]),
                "cuboids.sensor_id": np.array(of(lambda b: b[3])),
                "attributes.rider_status": of(lambda b: "With Rider" if b[0] == "Bicycle" else ""),
                "attributes.pedestrian_behavior": of(lambda b: ""),
                "attributes.pedestrian_age": of(lambda b: ""),
            }
        )
        save(root, f"{name}/annotations/cuboids/{t:02d}.pkl.gz", _packed(columns, None))
    text("annotations/semseg/classes.json", {"7": "Road", "13": "Car"})


def pandaset(street, root):
    """Writes two sequences of PandaSet."""
    random = np.random.default_rng(3)
    truth = Truth(str(root), ["--sequence", "057"])
    _pandaset_sequence(street, root, "002", range(2), turned(0.2), random, None)
    _pandaset_sequence(street, root, "057", range(street.count), turned(1.9, -12.0, 33.0, 0.7), random, truth)
    return truth


# ---- Waymo v2 ---------------------------------------------------------------------------------------------------------------

WAYMO_TYPES = {"Car": 1, "Pedestrian": 2, "Cyclist": 4, "Sign": 3}
WAYMO_CLASSES = {1: "vehicle", 2: "pedestrian", 4: "cyclist"}
OPENCV_FROM_WAYMO = np.array(
    [[0.0, -1, 0, 0], [0, 0, -1, 0], [1, 0, 0, 0], [0, 0, 0, 1]]
)  # Waymo's camera axes: x forward, y left, z up


def _parquet(root, tag, segment, rows, types, random):
    """Writes the file of one component: shuffled rows, several row groups, and the segment's name as a dictionary
    column, as in partitioned data sets."""
    path = os.path.join(root, tag, segment + ".parquet")
    os.makedirs(os.path.dirname(path), exist_ok=True)
    rows = [rows[i] for i in random.permutation(len(rows))]
    arrays = {"index": pa.array([f"{segment};{i}" for i in range(len(rows))])}
    arrays["key.segment_context_name"] = pa.array([segment] * len(rows)).dictionary_encode()
    for name, kind in types.items():
        arrays[name] = pa.array([row[name] for row in rows], kind)
    pyarrow.parquet.write_table(pa.table(arrays), path, row_group_size=7)


_F64, _I8, _I64 = pa.float64(), pa.int8(), pa.int64()
_TRANSFORM = pa.list_(_F64, 16)


def _box_columns(component, name):
    return {
        f"[{component}].{name}.{part}": _F64
        for part in ("center.x", "center.y", "center.z", "size.x", "size.y", "size.z", "heading")
    }


def _box_row(component, name, pose, size):
    values = [*pose[:3, 3], *size, np.arctan2(pose[1, 0], pose[0, 0])]
    return dict(zip(_box_columns(component, name), map(float, values)))


def _directions(height, width, inclinations, extrinsic):
    """Returns the unit vectors of a range image's pixels in the sensor's frame; row 0 is the highest. See
    range_image_utils.compute_range_image_polar."""
    azimuth = ((np.arange(width, 0, -1) - 0.5) / width * 2 - 1) * np.pi - np.arctan2(extrinsic[1, 0], extrinsic[0, 0])
    inclination = np.asarray(inclinations)[::-1, None]
    return (
        np.stack(
            [
                np.cos(azimuth) * np.cos(inclination),
                np.sin(azimuth) * np.cos(inclination),
                np.sin(inclination) + 0 * azimuth,
            ],
            -1,
        ),
        azimuth,
        inclination[:, 0],
    )


def _euler(pose):
    """Returns roll, pitch, yaw, x, y and z of a pose whose rotation is Rz(yaw) Ry(pitch) Rx(roll)."""
    r = pose[:3, :3]
    return [np.arctan2(r[2, 1], r[2, 2]), -np.arcsin(r[2, 0]), np.arctan2(r[1, 0], r[0, 0]), *pose[:3, 3]]


def _from_euler(values):
    roll, pitch, yaw = values[:3]
    out = turned(yaw, *values[3:])
    tilt = np.array([[np.cos(pitch), 0, np.sin(pitch)], [0, 1, 0], [-np.sin(pitch), 0, np.cos(pitch)]])
    lean = np.array([[1, 0, 0], [0, np.cos(roll), -np.sin(roll)], [0, np.sin(roll), np.cos(roll)]])
    out[:3, :3] = out[:3, :3] @ tilt @ lean
    return out


def _range_image(world, column_poses, extrinsic, directions):
    """Draws points of the world into a range image in which each column has a pose. Returns the image, and the
    points' positions as the image's geometry gives them."""
    rays, azimuth, inclination = directions
    height, width = rays.shape[:2]
    image = np.full((height, width, 4), -1.0, np.float32)
    column = np.full(len(world), width // 2)
    lasers = np.linalg.inv(np.array(column_poses) @ extrinsic)
    for _ in range(3):  # repeated, as the column's pose moves the point to another column
        laser = lasers[column]
        local = np.einsum("nij,nj->ni", laser[:, :3, :3], world) + laser[:, :3, 3]
        turn = np.mod(azimuth[0] - np.arctan2(local[:, 1], local[:, 0]), 2 * np.pi)
        column = np.rint(turn / (2 * np.pi) * width).astype(int) % width
    up = np.arctan2(local[:, 2], np.hypot(local[:, 0], local[:, 1]))
    row = np.abs(inclination[None] - up[:, None]).argmin(1)
    keep = np.abs(inclination[row] - up) < 0.02
    image[row[keep], column[keep]] = np.stack(
        [np.linalg.norm(local[keep], axis=1), np.full(keep.sum(), 0.4), np.zeros(keep.sum()), np.full(keep.sum(), -1)],
        1,
    )
    there = np.argwhere(image[..., 0] > 0)
    laser = np.array([column_poses[c] @ extrinsic for c in there[:, 1]])
    ray = rays[there[:, 0], there[:, 1]] * image[there[:, 0], there[:, 1], :1]
    return image, np.einsum("nij,nj->ni", laser[:, :3, :3], ray) + laser[:, :3, 3]


def _waymo_segment(street, root, segment, frames, shift, random, truth):
    stamp, write = 1552440195362591, lambda tag, rows, types: _parquet(root, tag, segment, rows, types, random)
    at = {"key.frame_timestamp_micros": _I64}
    of = lambda t: {"key.frame_timestamp_micros": stamp + t * 100011}  # noqa: E731
    ego = [shift @ street.ego[t] for t in range(street.count)]
    flat = lambda pose: np.asarray(pose, float).ravel().tolist()  # noqa: E731
    write(
        "vehicle_pose",
        [{**of(t), "[VehiclePoseComponent].world_from_vehicle.transform": flat(ego[t])} for t in frames],
        {
            **at,
            "[VehiclePoseComponent].world_from_vehicle.transform": pa.list_(pa.float32(), 16)
            if not truth
            else _TRANSFORM,
        },
    )
    write(
        "stats",
        [{**of(t), "[StatsComponent].time_of_day": "Day", "[StatsComponent].weather": "sunny"} for t in frames],
        {**at, "[StatsComponent].time_of_day": pa.string(), "[StatsComponent].weather": pa.string()},
    )
    # Five cameras are calibrated, three have photographs; FRONT_RIGHT has no photograph in frame 4.
    camera, image = "[CameraCalibrationComponent].", "[CameraImageComponent]."
    lens = ["f_u", "f_v", "c_u", "c_v", "k1", "k2", "p1", "p2", "k3"]
    bends = [0.04, -0.3, 0.001, -0.0005, 0.0]
    rows, photographs = [], []
    for c in range(5):
        fx = [*map(float, street.lens[min(c, 2)][:4]), *bends]
        pose = (street.camera[c] if c < 3 else turned(c) @ street.camera[0]) @ OPENCV_FROM_WAYMO
        rows.append(
            {
                "key.camera_name": c + 1,
                **{f"{camera}intrinsic.{key}": value for key, value in zip(lens, fx)},
                camera + "extrinsic.transform": flat(pose),
                camera + "width": street.size[0],
                camera + "height": street.size[1],
                camera + "rolling_shutter_direction": 5,
            }
        )
        for t in frames if c < 3 else ():
            if c == 2 and t == 4:
                continue
            data = street.jpeg(t, c, segment)
            time = (stamp + t * 100011) * 1e-6
            photographs.append(
                {
                    **of(t),
                    "key.camera_name": c + 1,
                    image + "image": data,
                    image + "pose.transform": flat(ego[t]),
                    image + "pose_timestamp": time,
                    **{
                        f"{image}rolling_shutter_params.{key}": v
                        for key, v in (
                            ("shutter", 0.001),
                            ("camera_trigger_time", time - 0.002),
                            ("camera_readout_done_time", time + 0.002),
                        )
                    },
                    **{
                        f"{image}velocity.{kind}.{axis}": 0.1
                        for kind in ("linear_velocity", "angular_velocity")
                        for axis in "xyz"
                    },
                }
            )
            if truth:
                digest = save(root, "scratch", data)
                truth.photographs[digest] = (t, f"camera {c + 1}", ego[t] @ street.camera[c], fx)
                os.remove(os.path.join(root, "scratch"))
    types = {
        "key.camera_name": _I8,
        **{f"{camera}intrinsic.{key}": _F64 for key in lens},
        camera + "extrinsic.transform": _TRANSFORM,
        camera + "width": pa.int32(),
        camera + "height": pa.int32(),
        camera + "rolling_shutter_direction": _I8,
    }
    write("camera_calibration", rows, types)
    types = {
        **at,
        "key.camera_name": _I8,
        image + "image": pa.binary(),
        image + "pose.transform": _TRANSFORM,
        image + "pose_timestamp": _F64,
        **{
            f"{image}rolling_shutter_params.{key}": _F64
            for key in ("shutter", "camera_trigger_time", "camera_readout_done_time")
        },
        **{
            f"{image}velocity.{kind}.{axis}": kind_type
            for kind, kind_type in (("linear_velocity", pa.float32()), ("angular_velocity", _F64))
            for axis in "xyz"
        },
    }
    write("camera_image", photographs, types)
    # The LiDAR TOP has listed inclinations and a pose for each pixel; FRONT has evenly spread inclinations and no
    # poses.
    top, front = turned(2.6, 1.43, 0.0, 2.18), turned(0.05, 4.07, 0.0, 0.69)
    spread = np.sort(np.tan(np.linspace(-0.31, 0.042, 32)))
    limits = (-0.6, 0.5)
    even = limits[0] + (np.arange(12) + 0.5) / 12 * (limits[1] - limits[0])
    lidar = "[LiDARCalibrationComponent]."
    rows = [
        {
            "key.laser_name": 2,
            lidar + "extrinsic.transform": flat(front),
            lidar + "beam_inclination.min": limits[0],
            lidar + "beam_inclination.max": limits[1],
            lidar + "beam_inclination.values": None,
        },
        {
            "key.laser_name": 1,
            lidar + "extrinsic.transform": flat(top),
            lidar + "beam_inclination.min": -0.32,
            lidar + "beam_inclination.max": 0.043,
            lidar + "beam_inclination.values": spread.tolist(),
        },
    ]
    write(
        "lidar_calibration",
        rows,
        {
            "key.laser_name": _I8,
            lidar + "extrinsic.transform": _TRANSFORM,
            lidar + "beam_inclination.min": _F64,
            lidar + "beam_inclination.max": _F64,
            lidar + "beam_inclination.values": pa.list_(_F64),
        },
    )
    views = {1: (top, _directions(32, 360, spread, top)), 2: (front, _directions(12, 90, even, front))}
    sweeps, pixel_poses = [], []
    for t in frames:
        world = move(ego[t], street.sweep[t][:, :3].astype(float))
        ahead = ego[min(t + 1, street.count - 1)][:3, 3] - ego[t][:3, 3]
        points = []
        for laser, (extrinsic, directions) in views.items():
            height, width = directions[0].shape[:2]
            columns = np.array([_euler(ego[t])] * width)
            if laser == 1:  # the car drives on during the scanner's turn of 0.1 s
                columns[:, 3:] += ((np.arange(width) + 0.5) / width - 0.5)[:, None] * ahead
                columns = columns.astype(np.float32)
                values = np.broadcast_to(columns, (height, width, 6)).ravel()
                pixel_poses.append(
                    {
                        **of(t),
                        "key.laser_name": 1,
                        "[LiDARPoseComponent].range_image_return1.values": values,
                        "[LiDARPoseComponent].range_image_return1.shape": [height, width, 6],
                    }
                )
            returns, there = _range_image(
                world[laser - 1 :: 3], [_from_euler(row) for row in columns.astype(float)], extrinsic, directions
            )
            points.append(there)
            second = returns if laser == 1 and t % 2 else np.zeros_like(returns)
            sweeps.append(
                {
                    **of(t),
                    "key.laser_name": laser,
                    "[LiDARComponent].range_image_return1.values": returns.ravel(),
                    "[LiDARComponent].range_image_return1.shape": [height, width, 4],
                    "[LiDARComponent].range_image_return2.values": None if t == 2 else second.ravel() * 0,
                    "[LiDARComponent].range_image_return2.shape": None if t == 2 else [height, width, 4],
                }
            )
        if truth:
            truth.points[t] = np.vstack(points)
    image_type = lambda component, number: {
        f"[{component}].range_image_return{number}.values": pa.list_(pa.float32()),
        f"[{component}].range_image_return{number}.shape": pa.list_(pa.int32(), 3),
    }  # noqa: E731
    write(
        "lidar",
        sweeps,
        {**at, "key.laser_name": _I8, **image_type("LiDARComponent", 1), **image_type("LiDARComponent", 2)},
    )
    write("lidar_pose", pixel_poses, {**at, "key.laser_name": _I8, **image_type("LiDARPoseComponent", 1)})
    # Boxes are in the vehicle's frame; boxes synchronised with the cameras are a separate component.
    boxes, synced = [], []
    for t in frames:
        known = dict(street.boxes[t])
        known["sign"] = ("Sign", turned(0.2, 15.0, 6.0, 2.5), np.array([0.1, 0.6, 0.6]))
        for identity, (kind, pose, size) in known.items():
            name = f"-{identity}_=.q"
            local = np.linalg.inv(street.ego[t]) @ pose
            local[:3, :3] = turned(np.arctan2(local[1, 0], local[0, 0]))[:3, :3]  # upright in the vehicle's frame
            world = ego[t] @ local
            count = inside((kind, pose, size), move(street.ego[t], street.sweep[t][:, :3].astype(float)))
            vector = {
                f"[LiDARBoxComponent].{what}.{axis}": None if identity == "sign" else 0.0
                for what in ("speed", "acceleration")
                for axis in "xyz"
            }
            boxes.append(
                {
                    **of(t),
                    "key.laser_object_id": name,
                    **_box_row("LiDARBoxComponent", "box", local, size),
                    "[LiDARBoxComponent].type": WAYMO_TYPES[kind],
                    "[LiDARBoxComponent].num_lidar_points_in_box": count,
                    "[LiDARBoxComponent].num_top_lidar_points_in_box": count,
                    "[LiDARBoxComponent].difficulty_level.detection": None,
                    **vector,
                }
            )
            if count and identity != "sign":
                synced.append(
                    {
                        **of(t),
                        "key.laser_object_id": name,
                        "[LiDARCameraSyncedBoxComponent].most_visible_camera_name": 1,
                        **_box_row("LiDARCameraSyncedBoxComponent", "camera_synced_box", local, size),
                    }
                )
            if truth:
                (truth.spare if identity == "sign" else truth.boxes).setdefault(t, {})[name] = (
                    WAYMO_CLASSES.get(WAYMO_TYPES[kind], "sign"),
                    world,
                    size,
                )
    of_object = {**at, "key.laser_object_id": pa.string()}
    counts = {
        "[LiDARBoxComponent].type": _I8,
        "[LiDARBoxComponent].num_lidar_points_in_box": _I64,
        "[LiDARBoxComponent].num_top_lidar_points_in_box": _I64,
        "[LiDARBoxComponent].difficulty_level.detection": _I8,
        **{f"[LiDARBoxComponent].{what}.{axis}": _F64 for what in ("speed", "acceleration") for axis in "xyz"},
    }
    write("lidar_box", boxes, {**of_object, **_box_columns("LiDARBoxComponent", "box"), **counts})
    write(
        "lidar_camera_synced_box",
        synced,
        {
            **of_object,
            "[LiDARCameraSyncedBoxComponent].most_visible_camera_name": _I8,
            **_box_columns("LiDARCameraSyncedBoxComponent", "camera_synced_box"),
        },
    )


def waymo2(street, root):
    """Writes two segments of Waymo. The first has 32-bit poses, as has Waymo's test data."""
    random = np.random.default_rng(4)
    segment = "10023947602400723454_1120_000_1140_000"
    truth = Truth(str(root), ["--sequence", segment], point_error=0.02)
    _waymo_segment(
        street, root, "1005081002024129653_5313_150_5333_150", range(2), turned(0.4, 40.0, 7.0, 1.0), random, None
    )
    _waymo_segment(street, root, segment, range(street.count), turned(0.8, 860.6, 15568.7, -651.4), random, truth)
    return truth


# ---- KITTI-360 --------------------------------------------------------------------------------------------------------------

KITTI360_CLASSES = {
    "Car": ("car", 13),
    "Pedestrian": ("person", 19),
    "Cyclist": ("rider", 20),
}  # label, and its number in KITTI-360
CORNERS = np.array(
    [
        [0.5, 0.5, 0.5],
        [0.5, 0.5, -0.5],
        [0.5, -0.5, 0.5],
        [0.5, -0.5, -0.5],
        [-0.5, 0.5, -0.5],
        [-0.5, 0.5, 0.5],
        [-0.5, -0.5, -0.5],
        [-0.5, -0.5, 0.5],
    ]
)


def _rodrigues(vectors):
    """Converts rotation vectors of shape (..., 3) into rotation matrices of shape (..., 3, 3)."""
    theta = np.maximum(np.linalg.norm(vectors, axis=-1), 1e-300)[..., None, None]
    x, y, z = np.moveaxis(np.asarray(vectors, float), -1, 0)
    k = np.stack([np.stack([0 * x, -z, y], -1), np.stack([z, 0 * x, -x], -1), np.stack([-y, x, 0 * x], -1)], -2) / theta
    return np.eye(3) + np.sin(theta) * k + (1 - np.cos(theta)) * k @ k


def uncurl(points, delta):
    """Returns what a turning scanner measures of the points, and a mask of the points that it measures. This
    iterates towards the inverse of helpers/curlVelodyneData_impl.c. A few points straight behind the car, where a
    turn begins and ends, have no inverse, because the scanner passes them outside of the turn."""
    q = np.array(quaternion(delta))
    q *= np.sign(q[0])
    sine = np.linalg.norm(q[1:])
    r = 2 * np.arctan2(sine, q[0]) * q[1:] / sine if sine > 1e-12 else np.zeros(3)
    raw = points.copy()
    for _ in range(8):
        s = 0.5 * np.arctan2(raw[:, 1], raw[:, 0])[:, None] / np.pi
        wrong = points - np.einsum("nij,nj->ni", _rodrigues(s * r), raw) - s * delta[:3, 3]
        raw += wrong
    return raw, np.abs(wrong).max(1) < 1e-6


def _opencv(name, matrix, indent="    "):
    values = " ".join(f"{v:.9g}" for v in np.ravel(matrix))
    return f'{indent}<{name} type_id="opencv-matrix">\r\n{indent}  <rows>{len(matrix)}</rows>\r\n{indent}  <cols>{len(matrix[0])}</cols>\r\n{indent}  <dt>d</dt>\r\n{indent}  <data>\r\n{indent}    {values}</data></{name}>\r\n'


def _kitti360_drive(street, root, drive, frames, shift, random, truth):
    """Writes a drive of KITTI-360 in which frame t of the street is frame t + 1. Frame 6 has no pose, as KITTI-360
    leaves out poses while the car stands; frame 8 has no Velodyne points."""
    sequence = f"2013_05_28_drive_{drive:04d}_sync"
    imu = np.diag([1.0, -1, -1, 1])  # x forward, y right, z down
    imu[:3, 3] = 0.05, 0.32, 0.6
    tilt = turned(0.0)
    tilt[:3, :3] = _rodrigues(np.array([0.004, -0.012, 0.003]))  # rotation by the rectification
    cam_to_imu = [np.linalg.inv(imu) @ street.camera[c] @ tilt for c in range(2)]
    cam_to_velo = np.linalg.inv(turned(0.01, 0.8, 0.0, 1.7)) @ imu @ cam_to_imu[0]
    lines = lambda path, rows: save(root, path, "".join(row + "\r\n" for row in rows).encode())  # noqa: E731
    numbers = lambda values: " ".join(f"{v:.10g}" for v in np.ravel(values))  # noqa: E731
    cameras = [*cam_to_imu, turned(1.5) @ cam_to_imu[0], turned(-1.5) @ cam_to_imu[0]]
    lines(
        "calibration/calib_cam_to_pose.txt", [f"image_{c:02d}: {numbers(pose[:3])}" for c, pose in enumerate(cameras)]
    )
    lines("calibration/calib_cam_to_velo.txt", [numbers(cam_to_velo[:3])])
    lines("calibration/calib_sick_to_velo.txt", [numbers(turned(0.1)[:3])])
    rows = ["calib_time: 28-May-2013 11:04:11"]
    for c in range(2):
        fx, fy, cx, cy = street.lens[c][:4]
        width, height = street.size
        rows += [
            f"S_{c:02d}: 1408.0 376.0",
            f"K_{c:02d}: {numbers([[fx * 1.1, 0, cx + 9], [0, fy * 1.1, cy + 5], [0, 0, 1]])}",
            f"D_{c:02d}: -0.34 0.15 0.0004 0.0002 -0.04",
            f"R_{c:02d}: {numbers(np.eye(3))}",
            f"T_{c:02d}: {-0.6 * c} 0 0",
        ]
        rows += [
            f"S_rect_{c:02d}: {width}.0 {height}.0",
            f"R_rect_{c:02d}: {numbers(tilt[:3, :3])}",
            f"P_rect_{c:02d}: {numbers([[fx, 0, cx, -0.6 * c * fx], [0, fy, cy, 0], [0, 0, 1, 0]])}",
        ]
    lines("calibration/perspective.txt", rows)
    yaml = "%YAML:1.0\r\n---\r\nmodel_type: MEI\r\ncamera_name: image_02\r\nimage_width: 1400\r\nimage_height: 1400\r\nmirror_parameters:\r\n   xi: 2.2134\r\ndistortion_parameters:\r\n   k1: 0.016\r\n   k2: 1.65\r\n   p1: 0.0005\r\n   p2: 0.0\r\nprojection_parameters:\r\n   gamma1: 1336.3\r\n   gamma2: 1335.8\r\n   u0: 716.9\r\n   v0: 705.7\r\n"
    save(root, "calibration/image_02.yaml", yaml.encode())
    save(root, "calibration/image_03.yaml", yaml.replace("_02", "_03").encode())
    pose = {t: shift @ street.ego[t] @ imu for t in frames if t != 5}
    lines(f"data_poses/{sequence}/poses.txt", [f"{t + 1} {numbers(p[:3])} " for t, p in pose.items()])
    lines(
        f"data_poses/{sequence}/cam0_to_world.txt",
        [f"{t + 1} {numbers(p @ cam_to_imu[0] @ np.linalg.inv(tilt))} " for t, p in pose.items()],
    )
    times = [
        "2013-05-28 08:46:02.850000123",
        *(f"2013-05-28 08:{46 + (29 + t) // 600}:{(2.95 + 0.1 * t) % 60:012.9f}" for t in frames),
    ]
    for folder in (
        "data_2d_raw/{}/image_00",
        "data_2d_raw/{}/image_01",
        "data_3d_raw/{}/velodyne_points",
        "data_3d_raw/{}/sick_points",
    ):
        lines(f"{folder.format(sequence)}/timestamps.txt", times)
    velo = np.linalg.inv(cam_to_velo @ np.linalg.inv(cam_to_imu[0]))  # pose of the Velodyne in the frame of the IMU
    for t in frames:
        for c in range(2):
            data = pathlib.Path(street.file(t, c)).read_bytes() + drive.to_bytes(
                2, "big"
            )  # bytes behind the end of a PNG aren't read
            digest = save(root, f"data_2d_raw/{sequence}/image_{c:02d}/data_rect/{t + 1:010d}.png", data)
            if truth and t in pose:
                truth.photographs[digest] = (
                    t,
                    f"image_{c:02d}",
                    shift @ street.ego[t] @ street.camera[c],
                    [*street.lens[c][:4], 0, 0, 0, 0, 0],
                )
        save(
            root,
            f"data_2d_raw/{sequence}/image_02/data_rgb/{t + 1:010d}.png",
            pathlib.Path(street.file(t, 2)).read_bytes(),
        )
        if t == 7:
            continue
        local = move(np.linalg.inv(imu @ velo), street.sweep[t][:, :3].astype(float))
        seen = np.ones(len(local), bool)
        if t in pose and t - 1 in pose:
            local, seen = uncurl(local, np.linalg.inv(velo) @ np.linalg.inv(pose[t]) @ pose[t - 1] @ velo)
        save(
            root,
            f"data_3d_raw/{sequence}/velodyne_points/data/{t + 1:010d}.bin",
            np.hstack([local, street.sweep[t][:, 3:]])[seen].astype("<f4").tobytes(),
        )
        if truth and t in pose:
            truth.points[t] = move(shift @ street.ego[t], street.sweep[t][seen, :3].astype(float))
    # A standing object has one box element, a moving object one per frame. The file also has a building and the ground.
    elements, names = [], sorted({i for t in frames for i in street.boxes[t]})
    for number, identity in enumerate(names):
        there = [t for t in frames if identity in street.boxes[t]]
        label, kind = KITTI360_CLASSES[street.boxes[there[0]][identity][0]]
        moving = identity.startswith("moving")
        for t in there if moving else there[:1]:
            _, box, size = street.boxes[t][identity]
            elements.append(
                (label, kind, number + 1, shift @ box, size, t + 1 if moving else -1, (there[0] + 1, there[-1] + 1))
            )
        for t in there if truth else ():
            box = street.boxes[t][identity]
            truth.boxes.setdefault(t, {})[f"{label} {number + 1}"] = (label, shift @ box[1], box[2])
    elements.append(
        ("building", 11, 1, shift @ turned(0.1, 20.0, 15.0, 5.0), np.array([12.0, 8, 10]), -1, (1, frames[-1] + 1))
    )
    text = '<?xml version="1.0"?>\r\n<opencv_storage>\r\n'
    for i in random.permutation(len(elements)):
        label, kind, number, box, size, time, (first, last) = elements[i]
        scaled = box.copy()
        scaled[:3, :3] = box[:3, :3] * size
        text += f"  <object{i + 1}>\r\n" + "".join(
            f"    <{key}>{value}</{key}>\r\n"
            for key, value in {
                "index": i,
                "label": label,
                "semanticId": kind,
                "instanceId": number,
                "category": 1,
                "timestamp": time,
                "dynamic": int(time >= 0),
                "start_frame": first,
                "end_frame": last,
                "dynamicSeq": -1,
                "level": 0,
            }.items()
        )
        text += (
            _opencv("transform", scaled)
            + _opencv("vertices", CORNERS)
            + _opencv(
                "faces",
                [
                    [0, 1, 3],
                    [0, 3, 2],
                    [4, 5, 7],
                    [4, 7, 6],
                    [0, 5, 4],
                    [0, 4, 1],
                    [2, 3, 6],
                    [2, 6, 7],
                    [0, 2, 7],
                    [0, 7, 5],
                    [1, 4, 6],
                    [1, 6, 3],
                ],
            )
            + f"  </object{i + 1}>\r\n"
        )
    save(root, f"data_3d_bboxes/train/{sequence}.xml", (text + "</opencv_storage>\r\n").encode())


def kitti360(street, root):
    """Writes two drives that share one calibration."""
    random = np.random.default_rng(5)
    truth = Truth(str(root), ["--sequence", "2013_05_28_drive_0002_sync"], point_error=0.005)
    _kitti360_drive(street, root, 0, range(2), turned(0.3, 800.0, 3900.0, 100.0), random, None)
    _kitti360_drive(street, root, 2, range(street.count), turned(1.1, 1021.3, 3811.4, 115.2), random, truth)
    return truth
