#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""train.py DATA OUT: trains a static 3D Gaussian scene by gsplat on the output of prepare.py, with four settings in turn, and prints time,
count and held-out PSNR over all and over static pixels as JSON; OUT/gsplat.json has the rows. Requires gsplat 1.5, PyTorch with CUDA, Pillow.

Environment: STEPS (30,000 per setting), BUDGET (260 seconds in all; a setting stops at its share), PLY=1 (write OUT/NAME.ply)."""

import json
import math
import os
import sys
import time

import numpy as np
import torch
import torch.nn.functional as F
from gsplat import DefaultStrategy, MCMCStrategy, rasterization
from PIL import Image

SH_C0 = 0.28209479
DEVICE = "cuda"
SKY_POINTS, SKY_DISTANCE = 20000, 200.0  # metres


def rotation(quaternion):
    w, x, y, z = np.array(quaternion) / np.linalg.norm(quaternion)
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
        ]
    )


class Capture:
    """Photographs (uint8), masks of static pixels, cameras and initial points, on the GPU."""

    def __init__(self, folder):
        with open(f"{folder}/cameras.json", encoding="utf-8") as file:
            self.cameras = json.load(file)
        poses, photographs, static = [], [], []
        for camera in self.cameras:
            pose = np.eye(4)
            pose[:3, :3] = rotation(camera["camera_from_world_quaternion_wxyz"])
            pose[:3, 3] = camera["camera_from_world_translation"]
            poses.append(pose)
            photographs.append(np.asarray(Image.open(f"{folder}/images/{camera['name']}")))
            static.append(np.asarray(Image.open(f"{folder}/masks/{os.path.splitext(camera['name'])[0]}.png")) == 0)
        self.poses = torch.tensor(np.array(poses), dtype=torch.float32, device=DEVICE)
        self.photographs = torch.tensor(np.array(photographs), device=DEVICE)
        self.static = torch.tensor(np.array(static), device=DEVICE)
        intrinsics = [[[c["fx"], 0, c["cx"]], [0, c["fy"], c["cy"]], [0, 0, 1]] for c in self.cameras]
        self.intrinsics = torch.tensor(intrinsics, dtype=torch.float32, device=DEVICE)
        self.test = [i for i, c in enumerate(self.cameras) if c["test"]]
        self.train = [i for i, c in enumerate(self.cameras) if not c["test"]]
        self.height, self.width = self.photographs.shape[1:3]
        centres = torch.linalg.inv(self.poses)[:, :3, 3]
        self.middle = centres.mean(0)
        self.extent = float((centres - self.middle).norm(dim=1).max()) * 1.1
        points = np.load(f"{folder}/start.npz")
        self.points = torch.tensor(points["xyz"], dtype=torch.float32, device=DEVICE)
        self.colours = torch.tensor(points["rgb"], dtype=torch.float32, device=DEVICE)

    def neighbours(self, index):
        """Photographs of the same camera one time step before and after."""
        wanted = self.cameras[index]
        near = [(wanted["sensor"], wanted["frame"] + step) for step in (-1, 1)]
        return [i for i, c in enumerate(self.cameras) if (c["sensor"], c["frame"]) in near]


def spacing(points, count=4):
    """Root mean square distance to the nearest three points."""
    parts = [torch.cdist(points[i : i + 2000], points) for i in range(0, len(points), 2000)]
    return torch.cat([p.topk(count, largest=False).values[:, 1:].pow(2).mean(1).sqrt() for p in parts])


def initial_parameters(capture):
    """3DGS' start from the points, and a shell of far points as sky."""
    sky = F.normalize(torch.randn(SKY_POINTS, 3, device=DEVICE), dim=1)
    sky = capture.middle + SKY_DISTANCE * sky[sky[:, 2] > -0.05]
    means = torch.cat([capture.points, sky])
    sizes = torch.cat([spacing(capture.points).clamp(1e-4, 10), torch.full((len(sky),), 4.0, device=DEVICE)])
    sh0 = torch.cat([(capture.colours - 0.5) / SH_C0, torch.full((len(sky), 3), 0.8, device=DEVICE)])[:, None]
    count = len(means)
    values = {
        "means": means,
        "scales": torch.log(sizes)[:, None].repeat(1, 3),
        "quats": F.normalize(torch.randn(count, 4, device=DEVICE), dim=1),
        "opacities": torch.logit(torch.full((count,), 0.1, device=DEVICE)),
        "sh0": sh0,
        "shN": torch.zeros(count, 15, 3, device=DEVICE),
    }
    return torch.nn.ParameterDict({name: torch.nn.Parameter(value.contiguous()) for name, value in values.items()})


def ssim(a, b):
    """Mean SSIM with a Gaussian window of 11 pixels (Wang et al. 2004)."""
    line = torch.exp(-((torch.arange(11, device=DEVICE) - 5.0) ** 2) / (2 * 1.5**2))
    line = line / line.sum()
    window = (line[:, None] * line[None])[None, None].repeat(3, 1, 1, 1)

    def blur(x):
        return F.conv2d(x, window, groups=3)

    ma, mb = blur(a), blur(b)
    va, vb, cov = blur(a * a) - ma * ma, blur(b * b) - mb * mb, blur(a * b) - ma * mb
    return ((2 * ma * mb + 1e-4) * (2 * cov + 9e-4) / ((ma * ma + mb * mb + 1e-4) * (va + vb + 9e-4))).mean()


class Run:
    def __init__(self, capture, name, strategy, masked, fit_poses):
        self.capture, self.name, self.strategy, self.masked, self.fit_poses = capture, name, strategy, masked, fit_poses
        self.parameters = initial_parameters(capture)
        rates = {
            "means": 1.6e-4 * capture.extent,
            "scales": 5e-3,
            "quats": 1e-3,
            "opacities": 5e-2,
            "sh0": 2.5e-3,
            "shN": 2.5e-3 / 20,
        }
        self.optimisers = {
            name: torch.optim.Adam([{"params": self.parameters[name], "lr": rate, "name": name}], eps=1e-15)
            for name, rate in rates.items()
        }
        views = len(capture.cameras)
        self.turns = torch.zeros(views, 6, device=DEVICE, requires_grad=True)  # rotation and translation of each pose
        self.gains = torch.zeros(views, 3, device=DEVICE, requires_grad=True)  # ln
        groups = [{"params": [self.turns], "lr": 1e-4}, {"params": [self.gains], "lr": 1e-3}]
        self.camera_optimiser = torch.optim.Adam(groups)

    def pose(self, index):
        if not self.fit_poses:
            return self.capture.poses[index][None]
        w, t = self.turns[index, :3], self.turns[index, 3:]
        zero = torch.zeros((), device=DEVICE)
        rows = [(zero, -w[2], w[1], t[0]), (w[2], zero, -w[0], t[1]), (-w[1], w[0], zero, t[2]), (zero,) * 4]
        twist = torch.stack([torch.stack(row) for row in rows])
        return (torch.linalg.matrix_exp(twist) @ self.capture.poses[index])[None]

    def draw(self, index, degree):
        p = self.parameters
        picture, _, info = rasterization(
            p["means"],
            p["quats"],
            torch.exp(p["scales"]),
            torch.sigmoid(p["opacities"]),
            torch.cat([p["sh0"], p["shN"]], 1),
            self.pose(index),
            self.capture.intrinsics[index : index + 1],
            self.capture.width,
            self.capture.height,
            sh_degree=degree,
            packed=False,
        )
        return (picture * torch.exp(self.gains[index]) if self.fit_poses else picture), info

    def step(self, number, index):
        p, capture = self.parameters, self.capture
        picture, info = self.draw(index, min(3, number // 1000))
        self.strategy.step_pre_backward(p, self.optimisers, self.state, number, info)
        photograph = capture.photographs[index].float()[None] / 255
        weight = capture.static[index][None, ..., None].float() if self.masked else 1.0
        a, b = ((x * weight).permute(0, 3, 1, 2) for x in (picture, photograph))
        loss = 0.8 * (a - b).abs().mean() + 0.2 * (1 - ssim(a, b))
        mcmc = isinstance(self.strategy, MCMCStrategy)
        if mcmc:
            loss = loss + 0.01 * (torch.sigmoid(p["opacities"]).mean() + torch.exp(p["scales"]).mean())
        loss.backward()
        for optimiser in [*self.optimisers.values(), *[self.camera_optimiser] * self.fit_poses]:
            optimiser.step()
            optimiser.zero_grad(set_to_none=True)
        rest = {"lr": self.optimisers["means"].param_groups[0]["lr"]} if mcmc else {"packed": False}
        self.strategy.step_post_backward(p, self.optimisers, self.state, number, info, **rest)

    def train(self, steps, seconds):
        """Returns the number of steps done and their seconds."""
        default = isinstance(self.strategy, DefaultStrategy)
        self.strategy.check_sanity(self.parameters, self.optimisers)
        self.state = self.strategy.initialize_state(**({"scene_scale": self.capture.extent} if default else {}))
        random, order, number = np.random.default_rng(0), [], 0
        torch.cuda.synchronize()
        begin = time.time()
        for number in range(1, steps + 1):
            order = order or list(random.permutation(self.capture.train))
            self.step(number - 1, int(order.pop()))
            self.optimisers["means"].param_groups[0]["lr"] *= 0.01 ** (1 / steps)
            if number % 200 == 0 and time.time() - begin > seconds:
                break
        torch.cuda.synchronize()
        return number, time.time() - begin

    @torch.no_grad()
    def evaluate(self):
        capture, whole, static, times = self.capture, [], [], []
        for index in capture.test:
            if self.fit_poses:  # a held-out pose has the mean correction of its neighbours, as in PAGS
                near = capture.neighbours(index)
                self.turns[index], self.gains[index] = self.turns[near].mean(0), self.gains[near].mean(0)
            torch.cuda.synchronize()
            begin = time.time()
            picture, _ = self.draw(index, 3)
            torch.cuda.synchronize()
            times.append(time.time() - begin)
            error = (picture[0].clamp(0, 1) - capture.photographs[index].float() / 255) ** 2
            whole.append(-10 * math.log10(error.mean()))
            static.append(-10 * math.log10(error[capture.static[index]].mean()))
        return float(np.mean(whole)), float(np.mean(static)), 1e3 * float(np.median(times))

    def write_ply(self, path):
        p, count = self.parameters, len(self.parameters["means"])
        columns = [p["means"], p["sh0"][:, 0], p["shN"].permute(0, 2, 1).reshape(count, -1), p["opacities"][:, None]]
        columns += [p["scales"], F.normalize(p["quats"], dim=1)]
        names = ["x", "y", "z", *[f"f_dc_{k}" for k in range(3)], *[f"f_rest_{k}" for k in range(45)], "opacity"]
        names += [*[f"scale_{k}" for k in range(3)], *[f"rot_{k}" for k in range(4)]]
        head = f"ply\nformat binary_little_endian 1.0\nelement vertex {count}\n"
        head += "".join(f"property float {name}\n" for name in names) + "end_header\n"
        with open(path, "wb") as file:
            file.write(head.encode() + torch.cat(columns, 1).detach().cpu().numpy().astype("<f4").tobytes())


def main():
    if len(sys.argv) != 3:
        sys.exit(__doc__)
    capture, out = Capture(sys.argv[1]), sys.argv[2]
    os.makedirs(out, exist_ok=True)
    steps, budget = int(os.environ.get("STEPS", "30000")), float(os.environ.get("BUDGET", "260"))

    def default():
        return DefaultStrategy(verbose=False, refine_stop_iter=steps // 2)

    plan = [
        ("default_masked", default(), True, False),
        ("default_masked_poses", default(), True, True),
        ("mcmc_masked_poses", MCMCStrategy(cap_max=300000, refine_stop_iter=steps * 4 // 5, verbose=False), True, True),
        ("default_all_poses", default(), False, True),
    ]
    Run(capture, "warm-up", default(), True, False).train(100, 20)  # the first steps compile and allocate
    begin, rows = time.time(), []
    for done, (name, strategy, masked, fit_poses) in enumerate(plan):
        torch.manual_seed(0)
        run = Run(capture, name, strategy, masked, fit_poses)
        number, seconds = run.train(steps, (budget - (time.time() - begin)) / (len(plan) - done))
        psnr, static, ms = run.evaluate()
        count = len(run.parameters["means"])
        row = {"name": name, "steps": number, "seconds": seconds, "gaussians": count}
        rows.append(row | {"psnr": psnr, "psnr_static": static, "frame_ms": ms})
        print(json.dumps(rows[-1]), flush=True)
        with open(f"{out}/gsplat.json", "w", encoding="utf-8") as file:
            json.dump(rows, file, indent=1)
        if os.environ.get("PLY"):
            run.write_ply(f"{out}/{name}.ply")


if __name__ == "__main__":
    main()
