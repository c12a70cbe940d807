# SPDX-License-Identifier: Apache-2.0
"""fit_picture.py PICTURE.ppm OUT.ply [STEPS]: fits 2,000 Gaussians to a picture by gradients, with Adam in numpy."""

import re
import sys

import numpy as np
import pags

data = open(sys.argv[1], "rb").read()
head = re.match(rb"P6\s+(\d+)\s+(\d+)\s+255\s", data)
width, height = int(head[1]), int(head[2])
target = np.frombuffer(data, np.uint8, 3 * width * height, head.end()).reshape(height, width, 3) / 255
steps = int(sys.argv[3]) if len(sys.argv) > 3 else 300

# The picture lies a metre before the camera, a pixel being 1/width of a metre.
camera = pags.camera(width, height, [[width, 0, width / 2], [0, width, height / 2], [0, 0, 1]], np.eye(4))
random, count = np.random.default_rng(1), 2000
at = random.uniform(0, 1, (count, 2)) * (width, height)
colours = target[at[:, 1].astype(int), at[:, 0].astype(int)]
gaussians = {
    "means": np.column_stack([(at - (width / 2, height / 2)) / width, np.ones(count)]),
    "quats": np.tile([1.0, 0, 0, 0], (count, 1)),
    "scales": np.full((count, 3), np.log(0.4 * (height / width / count) ** 0.5)),  # ln sigma
    "opacities": np.full(count, 1.0),  # logits
    "sh": ((colours - 0.5) / 0.28209479)[:, None, :],
}
rates = {"means": 4e-4, "quats": 0.02, "scales": 0.02, "opacities": 0.05, "sh": 0.03}
first, second = ({name: np.zeros_like(value) for name, value in gaussians.items()} for _ in range(2))
for step in range(1, steps + 1):
    scene = pags.Scene(**gaussians)
    error = np.asarray(pags.render(scene, camera).rgba)[..., :3] - target
    gradients = pags.gradients(scene, camera, 2 * error / error.size)  # of the mean square
    for name, value in gaussians.items():
        gradient = np.asarray(gradients[name])
        first[name] += 0.1 * (gradient - first[name])
        second[name] += 0.01 * (gradient**2 - second[name])
        direction = first[name] / (1 - 0.9**step) / (np.sqrt(second[name] / (1 - 0.99**step)) + 1e-12)
        value -= rates[name] * 0.1 ** (step / steps) * direction
    if step in (1, steps) or step % 50 == 0:
        print(f"step {step}: PSNR {-10 * np.log10(np.mean(error**2)):.2f} dB")
pags.Scene(**gaussians).save(sys.argv[2])
