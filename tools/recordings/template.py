# SPDX-License-Identifier: Apache-2.0
"""A recording of your own as a data set of pags: copy this file and change what reads RAW (docs/own-recording.md).

usage: PYTHONPATH=tools/recordings python template.py RAW DATASET

This example reads RAW/index.json with awkward conventions: nanoseconds, quaternions x y z w, world-to-camera poses, LiDAR in the sensor's
frame, boxes in LiDAR's axes. Leave out whatever your recording lacks (boxes, LiDAR, masks, the car's poses).
"""

import json
import pathlib
import sys

import numpy as np
from pags_recordings import Recording, RecordingError, poses


def write(raw, dataset):
    index = json.loads((raw / "index.json").read_text())
    ego_from_lidar = poses.pose(index["lidar"]["xyzw"], index["lidar"]["translation"], order="xyzw")
    times = poses.seconds([frame["time"] for frame in index["frames"]], "ns")
    with Recording(dataset) as out:
        for name, camera in index["cameras"].items():
            out.add_camera(name, (camera["width"], camera["height"]), camera["K"], camera["distortion"], pixel_centre=0)
        for frame, time in zip(index["frames"], times):
            world_from_ego = poses.pose(frame["ego"]["xyzw"], frame["ego"]["translation"], order="xyzw")
            step = out.add_step(time, world_from_ego)
            for name, shot in frame["photographs"].items():
                camera_from_world = poses.pose(shot["xyzw"], shot["translation"], order="xyzw")
                world_from_camera = poses.inverse(camera_from_world) @ poses.axes_from_opencv("opencv")
                step.photograph(name, raw / shot["file"], world_from_camera)
            world_from_lidar = world_from_ego @ ego_from_lidar
            points = np.fromfile(raw / frame["lidar"], "<f4").reshape(-1, 4)  # x y z intensity
            step.lidar(points, world_from_lidar, ["intensity"])
            for box in frame["boxes"]:
                lidar_from_front = poses.pose(box["xyzw"], box["centre"], order="xyzw")
                front = index["front"]  # the front in the box's own axes: "+x", "-x", "+y" or "-y"
                step.box(
                    box["track"],
                    box["class"],
                    world_from_lidar @ lidar_from_front @ poses.front_from_box(front),
                    poses.box_size(box["extents"], front),
                )


if __name__ == "__main__":
    if len(sys.argv) != 3:
        sys.exit(__doc__)
    try:
        write(pathlib.Path(sys.argv[1]), sys.argv[2])
    except (RecordingError, OSError, KeyError) as error:
        sys.exit(f"template: {error}")
