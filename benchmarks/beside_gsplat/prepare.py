#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""prepare.py DATASET SCENE OUT: writes what a GPU trainer needs of a driving set, from a scene that PAGS trained on it for a few steps at
half size (`pags train DATASET --downscale 2 -n 10 --set sh_loss=0 -o SCENE`): cameras with their split (cameras.json), photographs at half size (images/),
masks of moving objects (masks/), and PAGS' initial points with colours (start.npz). Requires numpy and Pillow."""

import json
import os
import sys

import numpy as np
from PIL import Image

SH_C0 = 0.28209479
KINDS = {"float": "<f4", "uchar": "u1", "int": "<i4", "uint": "<u4"}


def halve(picture):
    """Means of 2x2 pixels."""
    height, width = (side // 2 * 2 for side in picture.shape[:2])
    pairs = picture[:height, :width].astype(np.float32).reshape(height // 2, 2, width // 2, 2, -1)
    return pairs.mean((1, 3))


def read_ply(path):
    with open(path, "rb") as file:
        head, body = file.read().split(b"end_header\n", 1)
    lines = [line.decode().split() for line in head.splitlines()]
    columns = [(words[2], KINDS[words[1]]) for words in lines if words[0] == "property"]
    count = next(int(words[2]) for words in lines if words[:2] == ["element", "vertex"])
    return np.frombuffer(body, np.dtype(columns), count)


def main():
    if len(sys.argv) != 4:
        sys.exit(__doc__)
    dataset, scene, out = sys.argv[1:]
    with open(f"{scene}/scene.json", encoding="utf-8") as file:
        cameras = json.load(file)["cameras"]
    for folder in ("images", "masks"):
        os.makedirs(f"{out}/{folder}", exist_ok=True)
    for camera in cameras:
        name = camera["name"]
        picture = halve(np.asarray(Image.open(f"{dataset}/images/{name}").convert("RGB")))
        Image.fromarray(np.uint8(picture + 0.5)).save(f"{out}/images/{name}", quality=96, subsampling=0)
        mask = f"{dataset}/dynamic_masks/all/{os.path.splitext(name)[0]}.png"
        moving = np.zeros(picture.shape[:2])
        if os.path.exists(mask):
            moving = halve(np.asarray(Image.open(mask).convert("L")))[..., 0]
        Image.fromarray(np.uint8(255 * (moving > 0))).save(f"{out}/masks/{os.path.splitext(name)[0]}.png")
    with open(f"{out}/cameras.json", "w", encoding="utf-8") as file:
        json.dump(cameras, file)
    rows = read_ply(f"{scene}/background.ply")
    colours = np.stack([rows[f"f_dc_{k}"] for k in range(3)], 1) * SH_C0 + 0.5
    np.savez(f"{out}/start.npz", xyz=np.stack([rows[axis] for axis in "xyz"], 1), rgb=colours)
    print(f"{len(cameras)} cameras, {len(rows)} points")


if __name__ == "__main__":
    main()
