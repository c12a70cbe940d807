#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""What the error of held-out views consists of: shares of the squared error by camera, class, region and spatial frequency (docs/lab/residual.md).

  pags eval SCENE --split test --images PICTURES
  python3 benchmarks/residual.py DATASET PICTURES [OTHER]

DATASET is a driving set with semantic/ (Cityscapes' train ids) and dynamic_masks/all; pictures may be smaller than its photographs. Exposures that a
view lacks are not made up for. OTHER: pictures of a second training, which has seen other photographs; then the parts of the error that both have in common, and that each
has by itself, are told: with errors a and b, the common part is the mean of a * b. It needs numpy and Pillow (tools/recordings/.venv)."""

import glob
import os
import sys

import numpy
from PIL import Image

CLASSES = ("road", "sidewalk", "building", "wall", "fence", "pole", "traffic light", "traffic sign", "vegetation", "terrain", "sky", "person", "rider", "car",
           "truck", "bus", "train", "motorcycle", "bicycle")
SIGMAS = (1.0, 2.0, 4.0, 8.0)  # px, of the blurs between which a band lies


def blurred(image, sigma):
    """The image under a Gaussian of sigma, edges repeated."""
    reach = int(3 * sigma + 1)
    weights = numpy.exp(-0.5 * (numpy.arange(-reach, reach + 1) / sigma) ** 2)
    weights /= weights.sum()
    for axis in (0, 1):
        padded = numpy.pad(image, [(reach, reach) if a == axis else (0, 0) for a in range(3)], mode="edge")
        image = sum(w * numpy.take(padded, range(k, k + image.shape[axis]), axis) for k, w in enumerate(weights))
    return image


def bands(error):
    """The error, cut into bands of frequency whose sum it is."""
    levels = [error] + [blurred(error, sigma) for sigma in SIGMAS]
    return [a - b for a, b in zip(levels, levels[1:], strict=False)] + [levels[-1]]


def names_of_bands():
    return ([f"finer than {SIGMAS[0]:g} px"] + [f"{a:g} to {b:g} px" for a, b in zip(SIGMAS, SIGMAS[1:], strict=False)] + [f"coarser than {SIGMAS[-1]:g} px"])


def read(path, size=None):
    image = Image.open(path)
    return numpy.asarray(image.resize(size, Image.NEAREST) if size else image)


class Sums:
    """Squared errors and pixels by what they belong to."""

    def __init__(self):
        self.parts, self.total, self.pixels, self.common, self.other = {}, 0.0, 0, 0.0, 0.0

    def add(self, group, name, squares, shared, where=True):
        part = self.parts.setdefault(group, {}).setdefault(name, [0.0, 0, 0.0])
        part[0] += float(squares.sum(where=where))
        part[1] += int(numpy.sum(numpy.broadcast_to(where, squares.shape)))
        part[2] += float(shared.sum(where=where))

    def print(self):
        print(f"all {self.pixels} pixels: {psnr(self.total / self.pixels):.2f} dB of the mean square")
        for group, parts in self.parts.items():
            print(f"\n| {group} | share of the squared error | share of the pixels | dB |{' in common |' if self.other else ''}\n|---|---|---|---|{'---|' if self.other else ''}")
            for name, (squares, pixels, shared) in sorted(parts.items(), key=lambda item: -item[1][0]) if group != "frequency" else parts.items():
                if pixels:
                    print(f"| {name} | {squares / self.total:.1%} | {pixels / self.pixels:.1%} | {psnr(squares / pixels):.1f} |{f' {shared / squares:.0%} |' if self.other else ''}")
        if self.other:
            print(f"\nin common with the other training: {self.common / self.total:.1%} of the squared error ({psnr(self.common / self.pixels):.2f} dB if nothing else "
                  f"were left); the other's is {psnr(self.other / self.pixels):.2f} dB")


def psnr(mean_square):
    return -10 * numpy.log10(max(mean_square, 1e-12))


def main(dataset, pictures, other=None):
    sums = Sums()
    for path in sorted(glob.glob(os.path.join(pictures, "*_render.png"))):
        name = os.path.basename(path)[: -len("_render.png")]
        render, photo = read(path).astype(float) / 255, read(path.replace("_render", "_photo")).astype(float) / 255
        size = (render.shape[1], render.shape[0])
        error = render - photo
        squares = (error**2).mean(axis=2)
        label, moves = read(os.path.join(dataset, "semantic", name + ".png"), size), read(os.path.join(dataset, "dynamic_masks", "all", name + ".png"), size) > 0
        beside = read(os.path.join(other, os.path.basename(path))).astype(float) / 255 - photo if other else numpy.zeros_like(error)
        shared = (error * beside).mean(axis=2)
        sums.total += float(squares.sum())
        sums.pixels += squares.size
        sums.common += float(shared.sum())
        sums.other += float((beside**2).mean(axis=2).sum())
        sums.add("camera", name.rsplit("_", 1)[1], squares, shared)
        for number in numpy.unique(label):
            sums.add("class", CLASSES[number] if number < len(CLASSES) else "other", squares, shared, label == number)
        for region, where in (("moves", moves), ("stands", ~moves)):
            sums.add("region", region, squares, shared, where)
        for band, part in zip(names_of_bands(), bands(error), strict=True):
            sums.add("frequency", band, (error * part).mean(axis=2), (beside * part).mean(axis=2))  # the shares add up to 1
    if not sums.pixels:
        sys.exit(f"{pictures}: no pictures NAME_render.png; pags eval --images writes them")
    sums.print()


if __name__ == "__main__":
    if len(sys.argv) not in (3, 4):
        sys.exit(__doc__)
    main(*sys.argv[1:])
