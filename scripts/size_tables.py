#!/usr/bin/env python3
"""size_tables.py SCENE: the quantile tables of engine/synth/size_tables.h from a trained synthetic street.

SCENE is what `pags train` made of a `pags synth street` data set; its geometry is known, so regions are boxes in the world. Taken are the
background's Gaussians in the stretch 8 m < x < 45 m, which the recording car drove along. Standard library only.
"""

import math
import struct
import sys

SHARES = (1, 5, 15, 30, 50, 70, 85, 95, 99)
SPAN = (8.0, 45.0)


def read_ply(path):
    """A dict of columns."""
    with open(path, "rb") as stream:
        names, kinds, count = [], "", 0
        while True:
            words = stream.readline().decode("ascii").split()
            if words[0] == "element":
                count = int(words[2])
            if words[0] == "property":
                names.append(words[2])
                kinds += {"float": "f", "int": "i"}[words[1]]
            if words[0] == "end_header":
                break
        row = struct.Struct("<" + kinds)
        columns = list(zip(*row.iter_unpack(stream.read(count * row.size))))
    return dict(zip(names, columns))


def on_ground(y, z):
    return -8.6 < y < 5.3 and abs(z) < 0.3


def on_fronts(y, z):
    return 0.5 < z < 9 and (8.7 < y < 10.8 or -14.2 < y < -12.1)


def on_things(y, z):
    """Parked cars and trees between the lanes and the fronts."""
    return 0.35 < z < 8 and (3.2 < y < 8.7 or -12.1 < y < -6.5)


def quantiles(values):
    values = sorted(values)
    return [values[min(len(values) - 1, int(len(values) * share / 100))] for share in SHARES]


def main():
    ply = read_ply(sys.argv[1] + "/background.ply")
    print("/* quantiles at", ", ".join(map(str, SHARES)), "per cent */")
    for name, inside in (("ground", on_ground), ("fronts", on_fronts), ("things", on_things)):
        rows = {"ln_long": [], "ln_middle_by_long": [], "ln_short_by_middle": [], "logit_opacity": []}
        for i, (x, y, z) in enumerate(zip(ply["x"], ply["y"], ply["z"])):
            if SPAN[0] < x < SPAN[1] and inside(y, z):
                long, middle, short = sorted((max(ply[f"scale_{k}"][i], -12.0) for k in range(3)), reverse=True)
                rows["ln_long"].append(long)
                rows["ln_middle_by_long"].append(middle - long)
                rows["ln_short_by_middle"].append(short - middle)
                rows["logit_opacity"].append(ply["opacity"][i])
        count = len(rows["ln_long"])
        print(f"/* {name}: {count} Gaussians */")
        for key, values in rows.items():
            print(f".{key} = {{" + ", ".join(f"{v:.3f}f" for v in quantiles(values)) + "},")
        if name == "ground":
            print(f"/* {count / (13.9 * (SPAN[1] - SPAN[0])):.1f} per square metre */")
    rest = [v for name, column in ply.items() if name.startswith("f_rest_") for v in column]
    print(f"/* degree 1: standard deviation {math.sqrt(sum(v * v for v in rest) / max(len(rest), 1)):.4f} */")


if __name__ == "__main__":
    main()
