#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""size_tables.py pandaset|street SCENE: prints the quantile tables of engine/synth/size_tables.h, computed from the
sizes and opacities of the Gaussians of a trained street.

pandaset: SCENE is the result of `pags train pandaset-002 --iterations 10000 --set sh_loss=0`, which keeps the
background in one file (regions ground and fronts). street: the same on `pags synth street` (region things). Regions are boxes (u, d, z) in metres: u along the
street, d to the left of the ego vehicle; in pandaset-002's world the street runs at 45 degrees. Standard library
only.
"""

import array
import math
import sys

SHARES = (1, 5, 15, 30, 50, 70, 85, 95, 99)

# By data set: the street's direction in degrees, and its regions as lists of boxes: lower corner, upper corner, and
# the area in square metres for the density, or None
SETS = {
    "pandaset": (
        45,
        {
            "ground": [((12, -2, -0.6), (34, 6, 0.4), 22 * 8)],
            "fronts": [((-4, 26.5, 1), (10, 31.5, 5), 14 * 4), ((20, 20, 1), (26, 23.5, 4), 6 * 3)],
        },
    ),
    "street": (0, {"things": [((8, 3.2, 0.35), (45, 8.7, 8), None), ((8, -12.1, 0.35), (45, -6.5, 8), None)]}),
}


def read_ply(path):
    """Reads a binary PLY file whose properties are all floats; returns a dict of columns."""
    with open(path, "rb") as stream:
        names = []
        while True:
            words = stream.readline().decode("ascii").split()
            if words[0] == "property":
                names.append(words[2])
            if words[0] == "end_header":
                break
        values = array.array("f")
        values.frombytes(stream.read())
    return {name: values[k :: len(names)] for k, name in enumerate(names)}


def inside(row, boxes):
    return any(all(a < v < b for a, v, b in zip(box[0], row, box[1])) for box in boxes)


def quantiles(values):
    values = sorted(values)
    return [values[min(len(values) - 1, int(len(values) * share / 100))] for share in SHARES]


def ranks(values):
    out = [0] * len(values)
    for place, i in enumerate(sorted(range(len(values)), key=values.__getitem__)):
        out[i] = place
    return out


def correlation(a, b):
    """Spearman's rank correlation of two columns."""
    a, b = ranks(a), ranks(b)
    middle = (len(a) - 1) / 2
    return sum((x - middle) * (y - middle) for x, y in zip(a, b)) / sum((x - middle) ** 2 for x in a)


def main():
    degrees, regions = SETS[sys.argv[1]]
    ply = read_ply(sys.argv[2] + "/background.ply")
    c, s = math.cos(math.radians(degrees)), math.sin(math.radians(degrees))
    places = [(c * x + s * y, c * y - s * x, z) for x, y, z in zip(ply["x"], ply["y"], ply["z"])]
    print("/* quantiles at", ", ".join(map(str, SHARES)), "per cent */")
    for name, boxes in regions.items():
        keys = ("ln_long", "ln_middle_by_long", "ln_short_by_middle", "logit_opacity")
        rows = {key: [] for key in keys}
        for i, place in enumerate(places):
            if inside(place, boxes):
                long, middle, short = sorted((max(ply[f"scale_{k}"][i], -12.0) for k in range(3)), reverse=True)
                for key, value in zip(keys, (long, middle - long, short - middle, ply["opacity"][i])):
                    rows[key].append(value)
        count = len(rows["ln_long"])
        print(f"/* {name}: {count} Gaussians */")
        for key, values in rows.items():
            print(f".{key} = {{" + ", ".join(f"{v:.3f}f" for v in quantiles(values)) + "},")
        print(" ".join(f"{a} {b} {correlation(rows[a], rows[b]):.2f};" for n, a in enumerate(keys) for b in keys[:n]))
        if boxes[0][2]:
            print(f"/* {count / sum(box[2] for box in boxes):.1f} per square metre */")
    rest = [v for name, column in ply.items() if name.startswith("f_rest_") for v in column[::16]]
    print(f"/* degree 1: standard deviation {math.sqrt(sum(v * v for v in rest) / max(len(rest), 1)):.4f} */")


if __name__ == "__main__":
    main()
