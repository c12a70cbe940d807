#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""How far edges of road markings lie from where they are, in views from beside the lane (docs/eval.md, docs/lab/lanes.md).

  pags eval SCENE --shift --split test --images PICTURES
  python3 benchmarks/lane_edges.py DATASET PICTURES [right2 ...]

In each row of a true picture, an edge is where the brightness changes most along the row, by at least 0.08 from one side to the other, with only
road on both sides; its place is the vertex of the parabola through the change there and beside. In the row of the rendering it is the nearest
change of the same sign, at least 0.3 times as strong, within 8 pixels; an edge without one is missing.

It is an edge of a marking if the truth is brighter than 0.55 within 2 pixels of it: only paint in the sun is; asphalt in the sun ends at 0.5, paint in
the shade at 0.45. The other edges are those of shadows, of markings in the shade and of far markings that a pixel mixes with asphalt.

Prints per folder, of all edges and of those of markings, their number, the median and the 95th percentile of the distances in pixels, missing ones
counted as 8 pixels, and the shares within 2 pixels and missing."""

import glob
import os
import re
import sys

sys.path.insert(0, os.path.join(os.path.dirname(os.path.abspath(__file__)), "..", "tests", "cli"))
from fixtures import read_png  # noqa: E402

LEAST, AS_STRONG, REACH, ROAD, BESIDE, PAINT, NEAR = 0.08, 0.3, 8, 0, 3, 0.55, 2


def grey(path):
    """Rows of brightness, 0 to 1."""
    width, height, channels, _, pixels = read_png(path)
    weights = (0.299, 0.587, 0.114)
    return [
        [sum(w * pixels[(y * width + x) * channels + k] for k, w in enumerate(weights)) / 255 for x in range(width)] for y in range(height)
    ]


def classes(path):
    width, height, channels, _, pixels = read_png(path)
    return [[pixels[(y * width + x) * channels] for x in range(width)] for y in range(height)]


def edges(row, least):
    """(place, change) of the row's edges: local extremes of the change over two pixels."""
    change = [0.0] + [row[x + 1] - row[x - 1] for x in range(1, len(row) - 1)] + [0.0]
    found = []
    for x in range(2, len(row) - 2):
        here, before, after = abs(change[x]), abs(change[x - 1]), abs(change[x + 1])
        if here >= least and here > before and here >= after:
            bend = before - 2 * here + after
            found.append((x + (0.5 * (before - after) / bend if bend else 0.0), change[x]))
    return found


def distances(truth, render, labels):
    """(of a marking?, distance from the edge of the rendering in pixels; None where there is none) of each edge of the truth."""
    out = []
    for row, drawn, label in zip(truth, render, labels, strict=True):
        candidates = edges(drawn, AS_STRONG * LEAST)
        for place, change in edges(row, LEAST):
            x = round(place)
            if any(c != ROAD for c in label[max(x - BESIDE, 0) : x + BESIDE + 1]):
                continue
            near = [abs(p - place) for p, c in candidates if c * change > 0 and abs(c) >= AS_STRONG * abs(change)]
            out.append((max(row[max(x - NEAR, 0) : x + NEAR + 1]) > PAINT, min((d for d in near if d <= REACH), default=None)))
    return out


def report(name, found):
    if not found:
        print(f"{name}: no edges")
        return
    sizes = sorted(REACH if d is None else d for d in found)
    share = sum(d is not None and d <= 2 for d in found) / len(found)
    print(
        f"{name}: {len(found)} edges, median {sizes[len(sizes) // 2]:.2f} px, 95 % {sizes[int(0.95 * (len(sizes) - 1))]:.2f} px, "
        f"within 2 px {100 * share:.1f} %, missing {100 * sum(d is None for d in found) / len(found):.1f} %"
    )


def main():
    if len(sys.argv) < 3:
        raise SystemExit(__doc__)
    dataset, pictures = sys.argv[1:3]
    folders = sys.argv[3:] or sorted(os.listdir(os.path.join(dataset, "truth", "shift")))
    for name in folders:
        found = []
        for path in sorted(glob.glob(os.path.join(glob.escape(pictures), f"{name}_*_truth.png"))):
            number = re.fullmatch(r".*_(\d+)_truth\.png", path)[1]
            labels = os.path.join(dataset, "truth", "shift", name, f"{number}_semantic.png")
            if not os.path.exists(labels):
                raise SystemExit(f"{labels}: is missing; write the street again by `pags synth street`")
            found += distances(grey(path), grey(path.replace("_truth", "_render")), classes(labels))
        if not found:
            raise SystemExit(f"{pictures}: has no edges of markings in pictures {name}_NNNNN_truth.png; expected what pags eval --shift --images writes")
        for kind, some in (("all", found), ("markings", [pair for pair in found if pair[0]])):
            report(f"{name}, {kind}", [distance for _, distance in some])


if __name__ == "__main__":
    main()
