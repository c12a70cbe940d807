# SPDX-License-Identifier: Apache-2.0
"""check_blind.py PAGS: reads the raw recordings of blind_trees.py by the data sets' development kits and compares
the results with Truth, by which test_blind.py checks our importers. Run it by a Python that has these kits (make
check-recordings makes one). It prints the largest differences."""

import hashlib
import os
import pathlib
import shutil
import sys
import tempfile
import types

HERE = os.path.dirname(os.path.abspath(__file__))
sys.path[:0] = [HERE, os.path.dirname(HERE), os.path.join(os.path.dirname(HERE), "cli")]

import blind_tables  # noqa: E402
import blind_trees  # noqa: E402
import fixtures  # noqa: E402
import numpy as np  # noqa: E402
from blind_trees import move  # noqa: E402

LARGEST = {"pose": 1e-6, "K": 1e-9, "box": 1e-5, "LiDAR": 1e-5}


def digest(path):
    return hashlib.sha1(pathlib.Path(path).read_bytes()).hexdigest()


def rigid(rotation, translation):
    out = np.eye(4)
    out[:3, :3], out[:3, 3] = rotation, translation
    return out


def nuscenes(truth, note):
    from nuscenes.nuscenes import NuScenes
    from nuscenes.utils.data_classes import LidarPointCloud
    from pyquaternion import Quaternion

    theirs = NuScenes(version="v1.0-mini", dataroot=truth.raw, verbose=False)
    pose = lambda row: rigid(Quaternion(row["rotation"]).rotation_matrix, row["translation"])  # noqa: E731
    zero = min(
        sample["timestamp"]
        for sample in theirs.sample
        if theirs.get("scene", sample["scene_token"])["name"] == "scene-0103"
    )
    for data in theirs.sample_data:
        frame, path = round((data["timestamp"] - zero) / 1e5), theirs.get_sample_data_path(data["token"])
        mount = theirs.get("calibrated_sensor", data["calibrated_sensor_token"])
        world_from_sensor = pose(theirs.get("ego_pose", data["ego_pose_token"])) @ pose(mount)
        if data["sensor_modality"] == "camera" and digest(path) in truth.photographs:
            at, _, true, lens = truth.photographs[digest(path)]
            note("pose", world_from_sensor, true)
            note(
                "K",
                [mount["camera_intrinsic"][0][0], mount["camera_intrinsic"][1][1], mount["camera_intrinsic"][0][2]],
                lens[:3],
            )
        elif data["channel"] == "LIDAR_TOP" and data["is_key_frame"] and 0 <= data["timestamp"] - zero < 1e8:
            note(
                "LiDAR",
                move(world_from_sensor, LidarPointCloud.from_file(path).points[:3].T.astype(float)),
                truth.points[frame],
            )
            for box in theirs.get_boxes(data["token"]):
                _, true, size = truth.boxes[frame][theirs.get("sample_annotation", box.token)["instance_token"]]
                note("box", rigid(box.rotation_matrix, box.center), true)
                note("box", box.wlh[[1, 0, 2]], size)


def argoverse2(truth, note):
    from av2.geometry.camera.pinhole_camera import PinholeCamera
    from av2.structures.cuboid import CuboidList
    from av2.utils.io import read_city_SE3_ego, read_lidar_sweep

    log = pathlib.Path(truth.raw, truth.options[1])
    egos = read_city_SE3_ego(log)
    for name in blind_trees.RING:
        camera = PinholeCamera.from_feather(log, name)
        for path in (log / "sensors" / "cameras" / name).iterdir():
            _, _, true, lens = truth.photographs[digest(path)]
            note("pose", egos[int(path.stem)].transform_matrix @ camera.ego_SE3_cam.transform_matrix, true)
            note("K", camera.intrinsics.K[[0, 1, 0, 1], [0, 1, 2, 2]], lens[:4])
    sweeps = sorted((log / "sensors" / "lidar").iterdir())
    for number, path in enumerate(sweeps):
        points = read_lidar_sweep(path, attrib_spec="xyz").astype(float)
        world = move(egos[int(path.stem)].transform_matrix, points)
        note("LiDAR", np.sort(world, axis=0), np.sort(truth.points[2 * number], axis=0))
    for cuboid in CuboidList.from_feather(log / "annotations.feather").cuboids:
        frame = 2 * [int(path.stem) for path in sweeps].index(cuboid.timestamp_ns)
        found = egos[cuboid.timestamp_ns].transform_matrix @ cuboid.dst_SE3_object.transform_matrix
        note("box", min(np.abs(found - true).max() for _, true, _ in truth.boxes[frame].values()), 0)


def kitti360(truth, note):
    for name in ("skimage", "matplotlib"):  # kitti360Scripts imports these for drawing; the check draws nothing
        sys.modules[name] = types.ModuleType(name)
    sys.modules["skimage"].io = sys.modules["skimage"].filters = sys.modules["skimage"].morphology = None
    sys.modules["matplotlib"].cm = types.SimpleNamespace(get_cmap=lambda name: None)
    import xml.etree.ElementTree as ET

    from kitti360scripts.helpers.annotation import KITTI360Bbox3D
    from kitti360scripts.helpers.project import CameraPerspective

    drive = truth.options[1]
    for n in range(2):
        camera = CameraPerspective(truth.raw, drive, n)
        for path in pathlib.Path(truth.raw, "data_2d_raw", drive, f"image_{n:02d}", "data_rect").iterdir():
            if digest(path) in truth.photographs:
                _, _, true, lens = truth.photographs[digest(path)]
                note("pose", camera.cam2world[int(path.stem)], true)
                note("K", camera.K[[0, 1, 0, 1], [0, 1, 2, 2]], lens[:4])
    for child in ET.parse(os.path.join(truth.raw, "data_3d_bboxes", "train", f"{drive}.xml")).getroot():
        box = KITTI360Bbox3D()
        box.parseBbox(child)
        if box.name != "building":
            frame = box.timestamp - 1 if box.timestamp >= 0 else box.start_frame - 1
            _, pose, size = truth.boxes[frame][f"{box.name} {box.instanceId}"]
            note("box", np.sort(box.vertices, axis=0), np.sort(move(pose, blind_tables.CORNERS * size), axis=0))


def main():
    fixtures.PAGS = os.path.abspath(sys.argv[1])
    folder, right = tempfile.mkdtemp(prefix="pags-blind-"), True
    try:
        street = os.path.join(folder, "street")
        done = fixtures.run(
            "synth",
            "street",
            "-o",
            street,
            "--size",
            "160x90",
            "--frames",
            "10",
            "--lidar-points",
            "2400",
            "--samples",
            "1",
            "--no-shifts",
        )
        assert done.returncode == 0, done.stderr
        for tree, check in (
            (blind_trees.nuscenes, nuscenes),
            (blind_trees.argoverse2, argoverse2),
            (blind_tables.kitti360, kitti360),
        ):
            largest, counted = {}, {}

            def note(what, theirs, true, largest=largest, counted=counted):
                largest[what] = max(largest.get(what, 0.0), float(np.abs(np.asarray(theirs, float) - true).max()))
                counted[what] = counted.get(what, 0) + 1

            check(tree(blind_trees.Street(street), os.path.join(folder, tree.__name__)), note)
            print(
                f"blind tree of {tree.__name__}: "
                + ", ".join(f"{what} {value:.2g} ({counted[what]})" for what, value in largest.items())
            )
            right &= {"pose", "K", "box"} <= set(largest) and all(
                value <= LARGEST[what] for what, value in largest.items()
            )
    finally:
        shutil.rmtree(folder)
    sys.exit(0 if right else "check_blind: a tree says something else to the source's package than to us")


if __name__ == "__main__":
    main()
