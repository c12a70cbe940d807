# SPDX-License-Identifier: Apache-2.0
import sys

import pags

scene = pags.load(sys.argv[1])  # a scene folder
view = scene.views[0]  # a dictionary: width, height, fx, ..., world_from_camera, time
picture = pags.render(scene, view, outputs=("rgba", "depth"))
depth = memoryview(picture.depth)  # (height, width) float32, without a copy; numpy.asarray() takes it, too
print(view["name"], depth.shape[::-1], "farthest:", round(max(map(max, depth.tolist())), 1), "m")
print(pags.pick(scene, view, view["width"] // 2, view["height"] // 2))
