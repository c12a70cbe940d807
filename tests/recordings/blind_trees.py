# SPDX-License-Identifier: Apache-2.0
"""Writes the synthetic street as raw recordings of nuScenes v1.0 and Argoverse 2. The author used only the
documentation of these data sets and hadn't read our importers.

Each writer uses variants that the documentation allows and that other test data leave out. It returns the
recording's contents (Truth). PandaSet, Waymo version 2 and KITTI-360 are in blind_tables.py. Documentation: the
schema page of nuscenes-devkit; the README of src/av2/datasets/sensor in av2-api."""

import dataclasses
import hashlib
import io
import json
import os
import pathlib
import uuid

import numpy as np
import pyarrow as pa
import pyarrow.feather
from PIL import Image


@dataclasses.dataclass
class Truth:
    """The contents of a raw recording. Frame numbers are those of the street; poses map OpenCV's camera axes to the
    recording's world; boxes face +x."""

    raw: str  # the folder to import
    options: list  # further options of pags import, such as --sequence
    # SHA-1 of the file -> frame, name, world_from_camera, fx fy cx cy k1 k2 p1 p2 k3
    photographs: dict = dataclasses.field(default_factory=dict)
    boxes: dict = dataclasses.field(default_factory=dict)  # frame -> {id: (class, world_from_box, length width height)}
    spare: dict = dataclasses.field(default_factory=dict)  # boxes that an import may leave out, as in boxes
    points: dict = dataclasses.field(default_factory=dict)  # frame -> points in the world
    rows: dict = dataclasses.field(default_factory=dict)  # frame -> intensities
    point_error: float = 1e-3  # tolerance in metres, set by the file's number type
    box_error: float = 1e-3  # tolerance in metres, set by the interpolation between labels


class Street:
    """A data set of `pags synth street`, read by numpy: poses, boxes and sweeps, and photographs converted to JPEG."""

    def __init__(self, folder, count=None):
        self.folder = str(folder)
        load = lambda *names: json.loads(pathlib.Path(self.folder, *names).read_text(encoding="utf-8"))  # noqa: E731
        matrix = lambda *names: np.loadtxt(os.path.join(self.folder, *names)).reshape(4, 4)  # noqa: E731
        self.count = count or len(load("timestamps.json")["frames"])
        self.ego = [matrix("ego_pose", f"{t:03d}.txt") for t in range(self.count)]
        self.camera = [matrix("extrinsics", f"{c}.txt") for c in range(3)]
        self.lens = [np.loadtxt(os.path.join(self.folder, "intrinsics", f"{c}.txt")) for c in range(3)]
        self.sweep = [
            np.fromfile(os.path.join(self.folder, "lidar", f"{t:03d}.bin"), "<f4").reshape(-1, 4)
            for t in range(self.count)
        ]
        self.boxes = [{} for _ in range(self.count)]
        for box in load("instances", "instances_info.json").values():
            marks = box["frame_annotations"]
            for t, pose, size in zip(marks["frame_idx"], marks["obj_to_world"], marks["box_size"]):
                if t < self.count:
                    self.boxes[t][box["id"]] = (box["class_name"], np.array(pose), np.array(size))
        with Image.open(self.file(0, 0)) as first:
            self.size = first.size

    def file(self, t, c):
        return os.path.join(self.folder, "images", f"{t:03d}_{c}.png")

    def jpeg(self, t, c, mark=""):
        """Returns the photograph as JPEG. A comment with the mark makes every file different."""
        out = io.BytesIO()
        with Image.open(self.file(t, c)) as picture:
            picture.save(out, "JPEG", quality=92, comment=f"{t} {c} {mark}".encode())
        return out.getvalue()


def quaternion(pose, random=None):
    """Returns the quaternion w x y z of a pose's rotation; with a random generator, its sign is random."""
    r = pose[:3, :3]
    k = np.array(
        [
            [r[0, 0] - r[1, 1] - r[2, 2], 0, 0, 0],
            [r[1, 0] + r[0, 1], r[1, 1] - r[0, 0] - r[2, 2], 0, 0],
            [r[2, 0] + r[0, 2], r[2, 1] + r[1, 2], r[2, 2] - r[0, 0] - r[1, 1], 0],
            [r[2, 1] - r[1, 2], r[0, 2] - r[2, 0], r[1, 0] - r[0, 1], np.trace(r)],
        ]
    )
    x, y, z, w = np.linalg.eigh(k)[1][
        :, -1
    ]  # Bar-Itzhack 2000: the eigenvector of the greatest eigenvalue; eigh reads only the lower triangle
    sign = random.choice([-1.0, 1.0]) if random is not None else 1.0
    return [float(sign * v) for v in (w, x, y, z)]


def turned(angle, x=0.0, y=0.0, z=0.0):
    """Returns a pose turned about z by the angle and moved to x, y, z."""
    out = np.eye(4)
    out[:2, :2] = [[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]]
    out[:3, 3] = x, y, z
    return out


def move(pose, points):
    return points @ pose[:3, :3].T + pose[:3, 3]


def save(root, name, data):
    path = os.path.join(root, *name.split("/"))
    os.makedirs(os.path.dirname(path), exist_ok=True)
    with open(path, "wb") as file:
        file.write(data)
    return hashlib.sha1(data).hexdigest()


def inside(box, world_points):
    """Returns the number of points in a box."""
    local = move(np.linalg.inv(box[1]), world_points)
    return int(np.all(np.abs(local) <= box[2] / 2, axis=1).sum())


# ---- nuScenes ---------------------------------------------------------------------------------------------------------------

NUSCENES_CLASSES = {"Car": "vehicle.car", "Pedestrian": "human.pedestrian.adult", "Cyclist": "vehicle.bicycle"}
UNUSED_CLASSES = [
    "vehicle.emergency.police",
    "human.pedestrian.stroller",
    "static_object.bicycle_rack",
    "movable_object.trafficcone",
    "animal",
]
CHANNELS = ["CAM_FRONT", "CAM_FRONT_LEFT", "CAM_FRONT_RIGHT"]


class _Tables:
    """Tables of rows by name. The schema allows any unique text as token, so these tokens have blanks, slashes and
    letters outside of ASCII."""

    def __init__(self):
        self.rows = {}

    def add(self, table, **row):
        rows = self.rows.setdefault(table, [])
        rows.append({"token": f'{table[:3]}/{len(rows)} é\\"{table}', **row})
        return rows[-1]["token"]


def _nuscenes_scene(tables, street, root, truth, name, frames, stamp, random, shift):
    """Writes a scene: even frames are samples, odd frames are sweeps. Frame 5 has no photograph of CAM_FRONT_RIGHT;
    sample 4 has no label of moving_car_030."""
    log = tables.add(
        "log",
        logfile="n015-2018-07-24-11-22-45+0800",
        vehicle="n015",
        date_captured="2018-07-24",
        location="singapore-onenorth",
    )
    tables.add("map", log_tokens=[log], category="semantic_prior", filename="maps/53992ee3023e5494b90c316c183be829.png")
    save(root, "maps/53992ee3023e5494b90c316c183be829.png", pathlib.Path(street.file(0, 0)).read_bytes())
    samples = {
        t: tables.add("sample", timestamp=stamp + t * 100000, prev="", next="", scene_token="")
        for t in frames
        if t % 2 == 0
    }
    row = {r["token"]: r for rows in tables.rows.values() for r in rows}
    keys = sorted(samples)
    scene = tables.add(
        "scene",
        log_token=log,
        name=name,
        description="Wait at “lights”, 直行; parked cars",
        nbr_samples=len(keys),
        first_sample_token=samples[keys[0]],
        last_sample_token=samples[keys[-1]],
    )
    for i, t in enumerate(keys):
        row[samples[t]].update(
            scene_token=scene,
            prev=samples[keys[i - 1]] if i else "",
            next=samples[keys[i + 1]] if i + 1 < len(keys) else "",
        )
    lidar_pose = turned(-np.pi / 2, 0.9, 0.0, 1.84)  # LIDAR_TOP: x right, y forward
    sensor_pose = {
        **{channel: street.camera[c] for c, channel in enumerate(CHANNELS)},
        "LIDAR_TOP": lidar_pose,
        "RADAR_FRONT": turned(0.01, 3.4, 0.0, 0.5),
    }
    late = {
        "CAM_FRONT": -1951,
        "CAM_FRONT_LEFT": -951,
        "CAM_FRONT_RIGHT": 1549,
        "LIDAR_TOP": 0,
        "RADAR_FRONT": -16951,
    }  # delay after the sample's timestamp in microseconds
    for channel, pose in sensor_pose.items():
        camera = CHANNELS.index(channel) if channel in CHANNELS else -1
        token = next((s["token"] for s in tables.rows.get("sensor", []) if s["channel"] == channel), None)
        token = token or tables.add(
            "sensor", channel=channel, modality={"L": "lidar", "R": "radar"}.get(channel[0], "camera")
        )
        fx, fy, cx, cy = street.lens[max(camera, 0)][:4]
        k = [[fx, 0, cx], [0, fy, cy], [0, 0, 1]] if camera >= 0 else []
        calibrated = tables.add(
            "calibrated_sensor",
            sensor_token=token,
            translation=pose[:3, 3].tolist(),
            rotation=quaternion(pose, random),
            camera_intrinsic=k,
        )
        last = None
        for t in frames:
            if channel == "CAM_FRONT_RIGHT" and t == 5:
                continue
            time, key = stamp + t * 100000 + late[channel], t % 2 == 0
            ego = shift @ street.ego[t]
            at = tables.add(
                "ego_pose", timestamp=time, rotation=quaternion(ego, random), translation=ego[:3, 3].tolist()
            )
            end = "jpg" if camera >= 0 else "pcd.bin" if channel == "LIDAR_TOP" else "pcd"
            path = f"{'samples' if key else 'sweeps'}/{channel}/n015-2018-07-24-11-22-45+0800__{channel}__{time}.{end}"
            if camera >= 0:
                digest = save(root, path, street.jpeg(t, camera, name))
                if truth:
                    truth.photographs[digest] = (t, channel, ego @ pose, [fx, fy, cx, cy, 0, 0, 0, 0, 0])
            elif channel == "LIDAR_TOP":
                points = move(np.linalg.inv(pose), street.sweep[t][:, :3].astype(float)).astype("<f4")
                ring = (np.arange(len(points)) % 32)[:, None]
                save(root, path, np.hstack([points, street.sweep[t][:, 3:], ring]).astype("<f4").tobytes())
                if truth:
                    truth.points[t] = move(ego @ pose, points.astype(float))
            else:
                save(
                    root,
                    path,
                    b"# .PCD v0.7 - Point Cloud Data file format\nVERSION 0.7\nFIELDS x y z dyn_prop id rcs vx vy vx_comp vy_comp\nWIDTH 0\nHEIGHT 1\nPOINTS 0\nDATA binary\n",
                )
            after = samples[min(t + t % 2, keys[-1])]  # a sweep refers to the sample after it
            token = tables.add(
                "sample_data",
                sample_token=after,
                ego_pose_token=at,
                calibrated_sensor_token=calibrated,
                timestamp=time,
                fileformat=end.split(".")[0],
                is_key_frame=key,
                height=street.size[1] if camera >= 0 else 0,
                width=street.size[0] if camera >= 0 else 0,
                filename=path,
                prev=last or "",
                next="",
            )
            row[token] = tables.rows["sample_data"][-1]
            if last:
                row[last]["next"] = token
            last = token
            if channel == "LIDAR_TOP" and key:
                tables.add("lidarseg", sample_data_token=token, filename=f"lidarseg/v1.0-mini/{name}_{t}_lidarseg.bin")
                save(root, f"lidarseg/v1.0-mini/{name}_{t}_lidarseg.bin", np.full(len(points), 24, np.uint8).tobytes())
    for identity in sorted({i for t in keys for i in street.boxes[t]}):
        there = [t for t in keys if identity in street.boxes[t] and not (identity == "moving_car_030" and t == 4)]
        kind = NUSCENES_CLASSES[street.boxes[there[0]][identity][0]]
        category = next(c["token"] for c in tables.rows["category"] if c["name"] == kind)
        instance = tables.add(
            "instance",
            category_token=category,
            nbr_annotations=len(there),
            first_annotation_token="",
            last_annotation_token="",
        )
        last, known = None, tables.rows["instance"][-1]
        for t in there:
            _, pose, (length, width, height) = street.boxes[t][identity]
            count = inside(street.boxes[t][identity], move(street.ego[t], street.sweep[t][:, :3].astype(float)))
            rider = [tables.rows["attribute"][0]["token"]] if kind == "vehicle.bicycle" else []
            world = shift @ pose
            token = tables.add(
                "sample_annotation",
                sample_token=samples[t],
                instance_token=instance,
                visibility_token=str(1 + t % 4) if t % 3 else "",
                attribute_tokens=rider,
                translation=world[:3, 3].tolist(),
                size=[width, length, height],
                rotation=quaternion(world, random),
                prev=last or "",
                next="",
                num_lidar_pts=count,
                num_radar_pts=0,
            )
            row[token] = tables.rows["sample_annotation"][-1]
            if last:
                row[last]["next"] = token
            else:
                known["first_annotation_token"] = token
            last = known["last_annotation_token"] = token
        for t in frames if truth else []:
            if identity in street.boxes[t]:
                labelled = t in there or (t - 1 in there and t + 1 in there)
                box = street.boxes[t][identity]
                (truth.boxes if labelled else truth.spare).setdefault(t, {})[instance] = (kind, shift @ box[1], box[2])
            elif t - 1 in there or t + 1 in there:  # labelled on one side only
                truth.spare.setdefault(t, {})[instance] = (kind, None, None)


def nuscenes(street, root):
    """Writes v1.0-mini with two scenes. Tables have shuffled rows, Windows line ends, and columns that aren't in the
    schema."""
    random, tables = np.random.default_rng(1), _Tables()
    truth = Truth(str(root), ["--sequence", "scene-0103"], box_error=0.05)
    for name in [*UNUSED_CLASSES[:2], *NUSCENES_CLASSES.values(), *UNUSED_CLASSES[2:]]:
        tables.add("category", name=name, description="", index=len(tables.rows.get("category", [])))
    for name in ("cycle.with_rider", "cycle.without_rider", "vehicle.parked"):
        tables.add("attribute", name=name, description="")
    tables.rows["visibility"] = [
        {"token": str(i + 1), "level": level, "description": ""}
        for i, level in enumerate(["v0-40", "v40-60", "v60-80", "v80-100"])
    ]
    _nuscenes_scene(
        tables, street, root, None, "scene-0061", range(3), 1532402900000000, random, turned(0.3, 411.3, 1180.9)
    )
    _nuscenes_scene(
        tables,
        street,
        root,
        truth,
        "scene-0103",
        range(9 if street.count == 10 else street.count),
        1532402927647951,
        random,
        turned(-2.1, 601.2, 1646.5),
    )
    for name, rows in tables.rows.items():
        order = random.permutation(len(rows)) if name != "visibility" else range(len(rows))
        text = json.dumps([{**rows[i], "remark": None} for i in order], indent=0, ensure_ascii=False)
        save(root, f"v1.0-mini/{name}.json", text.replace("\n", "\r\n").encode())
    return truth


# ---- Argoverse 2 ------------------------------------------------------------------------------------------------------------

ARGOVERSE_CLASSES = {"Car": "REGULAR_VEHICLE", "Pedestrian": "PEDESTRIAN", "Cyclist": "BICYCLIST"}
RING = ["ring_front_center", "ring_front_left", "ring_front_right"]
OTHERS = [
    "ring_rear_left",
    "ring_rear_right",
    "ring_side_left",
    "ring_side_right",
    "stereo_front_left",
    "stereo_front_right",
]


def _feather(root, name, columns):
    path = os.path.join(root, *name.split("/"))
    os.makedirs(os.path.dirname(path), exist_ok=True)
    pyarrow.feather.write_feather(pa.table(columns), path, compression="zstd" if "lidar" in name else "uncompressed")


def _poses(rows, random, first):
    """Returns the columns qw qx qy qz tx_m ty_m tz_m of Argoverse 2's pose tables, with the rows shuffled."""
    order = random.permutation(len(rows))
    q = np.array([quaternion(rows[i][1], random) for i in order])
    out = {first: [rows[i][0] for i in order]}
    out.update({f"q{axis}": q[:, i] for i, axis in enumerate("wxyz")})
    out.update({f"t{axis}_m": [rows[i][1][i_axis, 3] for i in order] for i_axis, axis in enumerate("xyz")})
    return out


def _argoverse_log(street, root, log, frames, random, shift, truth):
    """Writes a log with cameras at 20 Hz, and LiDAR and labels at 10 Hz. Each sensor has different timestamps; the
    pose table has all of them, and times in between."""
    start, step = 315966265259836000, 50_000_000
    stamps = {
        name: start + np.arange(len(frames)) * step + late for name, late in zip(RING, (0, 3_500_001, -2_750_003))
    }
    poses = [
        (int(start + t * step + late), shift @ street.ego[t]) for t in frames for late in (0, 3_500_001, -2_750_003)
    ]
    for a, b in zip(frames[:-1], frames[1:]):  # poses between frames make the pose table denser than the sensors
        middle = np.array(street.ego[a])
        middle[:3, 3] = (street.ego[a][:3, 3] + street.ego[b][:3, 3]) / 2
        poses.append((int(start + a * step + step // 2), shift @ middle))
    _feather(root, f"{log}/city_SE3_egovehicle.feather", _poses(poses, random, "timestamp_ns"))
    lidar = turned(0.002, 1.35, 0.0, 1.64)
    sensors = [
        *zip(RING, street.camera),
        *((name, turned(0.5 * i, 1.1, 0.1, 1.4) @ street.camera[0]) for i, name in enumerate(OTHERS)),
        ("up_lidar", lidar),
        ("down_lidar", lidar),
    ]
    _feather(root, f"{log}/calibration/egovehicle_SE3_sensor.feather", _poses(sensors, random, "sensor_name"))
    names = [*OTHERS, *RING]
    lens = np.array([street.lens[RING.index(name) if name in RING else 0] for name in names])
    k = {"k1": np.full(9, -0.02), "k2": np.full(9, 0.003), "k3": np.full(9, -0.0004)}
    _feather(
        root,
        f"{log}/calibration/intrinsics.feather",
        {
            "sensor_name": names,
            **{key: lens[:, i] for i, key in enumerate(("fx_px", "fy_px", "cx_px", "cy_px"))},
            **k,
            "height_px": np.full(9, street.size[1], np.uint16),
            "width_px": np.full(9, street.size[0], np.uint16),
        },
    )
    save(root, f"{log}/map/log_map_archive_{log}____PIT_city_31785.json", b"{}")
    labels = []
    for t in frames:
        for c, name in enumerate(RING):
            if c == 2 and t == 3:
                continue  # this photograph is missing
            digest = save(root, f"{log}/sensors/cameras/{name}/{stamps[name][t]}.jpg", street.jpeg(t, c, log))
            if truth:
                fx, fy, cx, cy = street.lens[c][:4]
                truth.photographs[digest] = (
                    t,
                    name,
                    shift @ street.ego[t] @ street.camera[c],
                    [fx, fy, cx, cy, 0, 0, 0, 0, 0],
                )  # Argoverse 2's photographs are undistorted, so k1, k2 and k3 don't count
        save(
            root, f"{log}/sensors/cameras/stereo_front_left/{start + t * step}.jpg", street.jpeg(t, 0, log + " stereo")
        )
        boxes = {
            str(uuid.uuid5(uuid.NAMESPACE_OID, i)): (ARGOVERSE_CLASSES[b[0]], shift @ b[1], b[2])
            for i, b in street.boxes[t].items()
        }
        if t % 2:
            if truth:  # no labels at odd frames
                truth.boxes[t] = (
                    {i: b for i, b in boxes.items() if i in truth.boxes[t - 1]} if t + 1 < len(frames) else {}
                )
                truth.spare[t] = {i: b for i, b in boxes.items() if i not in truth.boxes[t]}
            continue
        cone = shift @ turned(0.4, 12.0, 5.0, 0.4)
        boxes[str(uuid.uuid5(uuid.NAMESPACE_OID, "cone"))] = ("CONSTRUCTION_CONE", cone, np.array([0.4, 0.3, 0.8]))
        points = street.sweep[t][:, :3].astype(np.float16)
        order = random.permutation(len(points))
        intensity = np.clip(street.sweep[t][:, 3] * 255, 0, 255).astype(np.uint8)
        sweep = {
            **{axis: points[order, i] for i, axis in enumerate("xyz")},
            "intensity": intensity[order],
            "laser_number": (order % 64).astype(np.uint8),
            "offset_ns": (order * 1000).astype(np.int32),
        }
        _feather(root, f"{log}/sensors/lidar/{start + t * step}.feather", sweep)
        world = move(shift @ street.ego[t], points.astype(float))
        if truth:
            truth.points[t], truth.boxes[t] = world, boxes
        for identity, (kind, pose, size) in boxes.items():
            labels.append(
                (
                    start + t * step,
                    identity,
                    kind,
                    size,
                    np.linalg.inv(shift @ street.ego[t]) @ pose,
                    inside((kind, pose, size), world),
                )
            )
    labels = [labels[i] for i in random.permutation(len(labels))]
    columns = {
        "timestamp_ns": [r[0] for r in labels],
        "track_uuid": [r[1] for r in labels],
        "category": [r[2] for r in labels],
    }
    columns.update({f"{key}_m": [r[3][i] for r in labels] for i, key in enumerate(("length", "width", "height"))})
    q = np.array([quaternion(r[4], random) for r in labels])
    columns.update({f"q{axis}": q[:, i] for i, axis in enumerate("wxyz")})
    columns.update({f"t{axis}_m": [r[4][i, 3] for r in labels] for i, axis in enumerate("xyz")})
    _feather(root, f"{log}/annotations.feather", {**columns, "num_interior_pts": [r[5] for r in labels]})


def argoverse2(street, root):
    """Writes a split of two logs."""
    random = np.random.default_rng(2)
    log = "54bc6dbc-ebfb-3fba-b5b3-57f88b4b79ca"
    truth = Truth(str(root), ["--sequence", log], point_error=0.004, box_error=0.06)
    _argoverse_log(
        street, root, "00a6ffc1-6ce9-3bc3-a060-6006e9893a1a", range(3), random, turned(1.0, 5000.0, -300.0, 10.0), None
    )
    _argoverse_log(street, root, log, range(street.count), random, turned(2.5, 747.4, 1275.3, -24.2), truth)
    return truth
