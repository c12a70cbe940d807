# SPDX-License-Identifier: Apache-2.0
"""check_sources.py PAGS: reads the tests' raw recordings by the development kits nuscenes-devkit, av2 and
kitti360Scripts, and by our importers. Poses, intrinsics, boxes and LiDAR points must be equal. Run it by a Python
that has these kits (make check-recordings makes one). It prints the largest differences."""

import os
import shutil
import sys
import tempfile

HERE = os.path.dirname(os.path.abspath(__file__))
sys.path[:0] = [HERE, os.path.dirname(HERE), os.path.join(os.path.dirname(HERE), "cli")]

import fixtures  # noqa: E402
import numpy as np  # noqa: E402
import test_importers  # noqa: E402
from street import labels, matrix, world_points  # noqa: E402

TOLERANCE = {
    "pose": 1e-6,
    "K": 1e-9,
    "box": 1e-6,
    "size": 1e-9,
    "LiDAR": 1e-3,
}  # tolerances in metres and pixels; LiDAR points are half floats, or float32 at 100 m


class Differences:
    def __init__(self, name):
        self.name, self.largest, self.counted = name, dict.fromkeys(TOLERANCE, 0.0), dict.fromkeys(TOLERANCE, 0)

    def note(self, what, ours, theirs):
        ours, theirs = np.asarray(ours, np.float64), np.asarray(theirs, np.float64)
        assert ours.shape == theirs.shape, (what, ours.shape, theirs.shape)
        self.largest[what] = max(self.largest[what], float(np.abs(ours - theirs).max()))
        self.counted[what] += 1

    def end(self):
        print(
            self.name
            + ": "
            + ", ".join(f"{what} {self.largest[what]:.2g} ({self.counted[what]})" for what in TOLERANCE)
        )
        return all(self.counted[what] and self.largest[what] <= TOLERANCE[what] for what in TOLERANCE)


def intrinsics(folder, n):
    fx, fy, cx, cy = np.loadtxt(os.path.join(folder, "intrinsics", f"{n}.txt"))[:4]
    return [[fx, 0, cx - 0.5], [0, fy, cy - 0.5], [0, 0, 1]]


def imported(case, out, *more):
    done = test_importers.run(case.kind, case.raw, "-o", out, "-q", *more)
    assert done.returncode == 0, done.stderr
    return labels(out)


def check_nuscenes(folder):
    from nuscenes.nuscenes import NuScenes
    from nuscenes.utils.data_classes import LidarPointCloud

    case, found = test_importers.NuScenes, Differences("nuscenes-devkit")
    out = os.path.join(folder, "nuscenes")
    boxes = imported(case, out, "--sequence", "scene-0061")
    theirs = NuScenes(version="v1.0-mini", dataroot=case.raw, verbose=False)

    def pose(row):
        from nuscenes.utils.geometry_utils import transform_matrix
        from pyquaternion import Quaternion

        return transform_matrix(row["translation"], Quaternion(row["rotation"]))

    for t in range(test_importers.FRAMES):
        for n in range(2):
            data = theirs.get("sample_data", f"d{t}_{n}")
            mount = theirs.get("calibrated_sensor", data["calibrated_sensor_token"])
            found.note(
                "pose",
                matrix(out, "extrinsics", f"{t:06d}_{n}.txt"),
                pose(theirs.get("ego_pose", data["ego_pose_token"])) @ pose(mount),
            )
            found.note("K", intrinsics(out, n), mount["camera_intrinsic"])
        data = theirs.get("sample_data", f"d{t}_2")
        cloud = LidarPointCloud.from_file(theirs.get_sample_data_path(data["token"]))
        cloud.points = cloud.points.astype(np.float64)
        cloud.transform(
            pose(theirs.get("ego_pose", data["ego_pose_token"]))
            @ pose(theirs.get("calibrated_sensor", data["calibrated_sensor_token"]))
        )
        found.note("LiDAR", world_points(out, t), cloud.points[:3].T)
        for box in theirs.get_boxes(data["token"]):  # nuscenes-devkit interpolates boxes between key frames
            annotation = theirs.get("sample_annotation", box.token)
            key = (t, annotation["instance_token"])
            before = max((k for k in case.KEYS if k < t), default=None)
            if (
                t in case.KEYS or (before, key[1]) in boxes
            ):  # without a label before, nuscenes-devkit doesn't interpolate the later label
                found.note("box", boxes[key][1][:3, 3], box.center)
                found.note("box", boxes[key][1][:3, :3], box.rotation_matrix)
                found.note("size", boxes[key][2], box.wlh[[1, 0, 2]])
    return found.end()


def check_argoverse2(folder):
    from pathlib import Path

    from av2.geometry.camera.pinhole_camera import PinholeCamera
    from av2.structures.cuboid import CuboidList
    from av2.utils.io import read_city_SE3_ego, read_lidar_sweep

    case, found = test_importers.Argoverse2, Differences("av2")
    out, log = os.path.join(folder, "argoverse2"), Path(case.raw)
    boxes = imported(case, out)
    cameras = [PinholeCamera.from_feather(log, name) for name in case.NAMES]
    egos = read_city_SE3_ego(log)
    cuboids = CuboidList.from_feather(log / "annotations.feather").cuboids
    for t, stamp in enumerate(sorted(egos)):
        world_from_ego = egos[stamp].transform_matrix
        for n, camera in enumerate(cameras):
            found.note(
                "pose",
                matrix(out, "extrinsics", f"{t:06d}_{n}.txt"),
                world_from_ego @ camera.ego_SE3_cam.transform_matrix,
            )
            found.note("K", intrinsics(out, n), camera.intrinsics.K)
        points = read_lidar_sweep(log / "sensors" / "lidar" / f"{stamp}.feather", attrib_spec="xyz").astype(np.float64)
        found.note("LiDAR", world_points(out, t), points @ world_from_ego[:3, :3].T + world_from_ego[:3, 3])
        now = [cuboid for cuboid in cuboids if cuboid.timestamp_ns == stamp]
        assert len(now) == len([key for key in boxes if key[0] == t])
        for cuboid in now:
            true = world_from_ego @ cuboid.dst_SE3_object.transform_matrix
            near = min(
                (pose for (at, _), (_, pose, _) in boxes.items() if at == t), key=lambda pose: np.abs(pose - true).max()
            )
            found.note("box", near, true)
            found.note(
                "size",
                [cuboid.length_m, cuboid.width_m, cuboid.height_m],
                next(size for _, pose, size in boxes.values() if pose is near),
            )
    return found.end()


def check_kitti360(folder):
    import types
    import xml.etree.ElementTree as ET

    import cv2

    for name in ("skimage", "matplotlib"):  # kitti360Scripts imports these for drawing; the check draws nothing
        sys.modules[name] = types.ModuleType(name)
    sys.modules["skimage"].io = sys.modules["skimage"].filters = None
    sys.modules["matplotlib"].cm = types.SimpleNamespace(get_cmap=lambda name: None)
    from kitti360scripts.devkits.commons.loadCalibration import loadCalibrationCameraToPose, loadCalibrationRigid
    from kitti360scripts.helpers.annotation import KITTI360Bbox3D
    from kitti360scripts.helpers.project import CameraPerspective

    case, found = test_importers.Kitti360, Differences("kitti360Scripts")
    out, first = os.path.join(folder, "kitti360"), case.FIRST
    boxes = imported(case, out)
    cameras = [CameraPerspective(case.raw, case.DRIVE, n) for n in range(2)]
    calibration = os.path.join(case.raw, "calibration")
    pose_from_velo = loadCalibrationCameraToPose(os.path.join(calibration, "calib_cam_to_pose.txt"))[
        "image_00"
    ] @ np.linalg.inv(loadCalibrationRigid(os.path.join(calibration, "calib_cam_to_velo.txt")))
    poses = {
        int(row[0]): np.vstack([row[1:].reshape(3, 4), [0, 0, 0, 1]])
        for row in np.loadtxt(os.path.join(case.raw, "data_poses", case.DRIVE, "poses.txt"))
    }
    for t in range(test_importers.FRAMES):
        for n, camera in enumerate(cameras):
            found.note("pose", matrix(out, "extrinsics", f"{t:06d}_{n}.txt"), camera.cam2world[first + t])
            found.note("K", intrinsics(out, n), camera.K[:, :3])
        rows = (
            np.fromfile(
                os.path.join(case.raw, "data_3d_raw", case.DRIVE, "velodyne_points", "data", f"{first + t:010d}.bin"),
                "<f4",
            )
            .reshape(-1, 4)
            .astype(np.float64)
        )
        world_from_velo = poses[first + t] @ pose_from_velo
        if t:  # pip doesn't build helpers/curlVelodyneData: its formula, with the motion of devkits/accumuLaser
            motion = np.linalg.inv(world_from_velo) @ poses[first + t - 1] @ pose_from_velo
            turn = cv2.Rodrigues(motion[:3, :3])[0][:, 0]
            share = 0.5 * np.arctan2(rows[:, 1], rows[:, 0]) / np.pi
            rows = np.array([cv2.Rodrigues(s * turn)[0] @ row[:3] + s * motion[:3, 3] for s, row in zip(share, rows)])
        found.note("LiDAR", world_points(out, t), rows[:, :3] @ world_from_velo[:3, :3].T + world_from_velo[:3, 3])
    for child in ET.parse(os.path.join(case.raw, "data_3d_bboxes", "train", f"{case.DRIVE}.xml")).getroot():
        theirs = KITTI360Bbox3D()
        theirs.parseBbox(child)
        for t in [theirs.timestamp - first] if theirs.timestamp >= 0 else range(2, 5):
            if theirs.name != "building":
                _, pose, size = boxes[t, f"{theirs.name} {theirs.instanceId}"]
                corners = (
                    np.array([[x, y, z] for x in (-0.5, 0.5) for y in (-0.5, 0.5) for z in (-0.5, 0.5)])
                    * size
                    @ pose[:3, :3].T
                    + pose[:3, 3]
                )
                order = [int(np.argmin(np.linalg.norm(corners - vertex, axis=1))) for vertex in theirs.vertices]
                assert sorted(order) == list(range(8))
                found.note("box", corners[order], theirs.vertices)
                found.note("size", size[2], np.ptp(theirs.vertices @ pose[:3, 2]))
    return found.end()


def main():
    fixtures.PAGS = os.path.abspath(sys.argv[1])
    right, folder = True, tempfile.mkdtemp(prefix="pags-sources-")
    try:
        for case, check in (
            (test_importers.NuScenes, check_nuscenes),
            (test_importers.Argoverse2, check_argoverse2),
            (test_importers.Kitti360, check_kitti360),
        ):
            case.setUpClass()
            right &= check(folder)
            case.doClassCleanups()
    finally:
        shutil.rmtree(folder)
    sys.exit(0 if right else "check_sources: a difference is larger than its tolerance")


if __name__ == "__main__":
    main()
