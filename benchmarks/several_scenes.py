# SPDX-License-Identifier: Apache-2.0
"""What a second scene in the frame costs: PYTHONPATH=build/python python3 benchmarks/several_scenes.py [GAUSSIANS] [SIZE] [THREADS]

Draws a ball of Gaussians (250,000 unless said) alone, beside a copy that is halved, turned and moved, and from one file that holds both, in turn,
1280 x 720 unless said, without Early-Z, so that all work is counted. Prints pictures a second (median of the rounds) and each one's share of the
first."""

import array
import math
import os
import random
import statistics
import sys
import tempfile

import pags

COUNT = int(sys.argv[1]) if len(sys.argv) > 1 else 250000
WIDTH, HEIGHT = (int(v) for v in (sys.argv[2] if len(sys.argv) > 2 else "1280x720").split("x"))
THREADS = int(sys.argv[3]) if len(sys.argv) > 3 else 0
ROUNDS = 15
NAMES = ("x y z nx ny nz f_dc_0 f_dc_1 f_dc_2 opacity scale_0 scale_1 scale_2 rot_0 rot_1 rot_2 rot_3").split()
TURN, PLACE = [[0, -1, 0], [0.8, 0, -0.6], [0.6, 0, 0.8]], [0.9, -0.5, 0.6]
POSE = [v for row, p in zip(TURN, PLACE) for v in (*(0.5 * t for t in row), p)]


def rows(scale, turn, place):
    """The ball as the map scale * turn * p + place leaves it; its Gaussians are round."""
    dice = random.Random(5)
    size = math.log(scale * 0.35 * COUNT ** (-1 / 3))
    for _ in range(COUNT):
        p, colour, opacity = [dice.uniform(-1, 1) for _ in range(3)], [dice.uniform(-1.5, 1.5) for _ in range(3)], dice.uniform(-2, 3)
        at = [scale * sum(t * v for t, v in zip(line, p)) + o for line, o in zip(turn, place)]
        yield [*at, 0, 0, 0, *colour, opacity, size, size, size, 1, 0, 0, 0]


def write(path, *balls):
    head = ["ply", "format binary_little_endian 1.0", f"element vertex {COUNT * len(balls)}"]
    head += [f"property float {name}" for name in NAMES] + ["end_header", ""]
    with open(path, "wb") as file:
        file.write("\n".join(head).encode())
        for ball in balls:
            values = array.array("f")
            for row in rows(*ball):
                values.extend(row)
            file.write(values.tobytes())


def main():
    plain, moved = (1, [[1, 0, 0], [0, 1, 0], [0, 0, 1]], [0, 0, 0]), (0.5, TURN, PLACE)
    with tempfile.TemporaryDirectory() as folder:
        write(os.path.join(folder, "one.ply"), plain)
        write(os.path.join(folder, "both.ply"), plain, moved)
        one, both = (pags.load(os.path.join(folder, name)) for name in ("one.ply", "both.ply"))
    view = {"width": WIDTH, "height": HEIGHT, "fx": 0.9 * WIDTH, "fy": 0.9 * WIDTH, "cx": WIDTH / 2, "cy": HEIGHT / 2}
    view["world_from_camera"] = [1, 0, 0, 0.2, 0, 1, 0, -0.1, 0, 0, 1, -3.5]
    renderer = pags.Renderer(threads=THREADS)
    kinds = {"one scene": (one, []), "two scenes": (one, [{"scene": one, "world_from_scene": POSE}]), "merged file": (both, [])}
    times = {name: [] for name in kinds}
    for turn in range(ROUNDS + 2):
        for name, (scene, others) in kinds.items():
            took = renderer.submit(scene, view, others=others, early_z="off").take().stats["ms_job"]
            if turn >= 2:  # the first grow the frame's memory
                times[name].append(took)
    first = statistics.median(times["one scene"])
    for name, values in times.items():
        print(f"{name}: {1e3 / statistics.median(values):.1f} pictures a second ({statistics.median(values) / first:.2f} of the time)")


main()
