# SPDX-License-Identifier: Apache-2.0
"""What an import of a long recording costs: python3 benchmarks/import_frames.py KIND STEPS FOLDER [PAGS] with KIND nuscenes, argoverse2, pandaset, waymo2 or kitti360.

Writes a raw tree of so many time steps into FOLDER by the writers of tests/recordings (a street without end: parked cars on both sides, seven that move; pictures,
of which there are eight, of the source's size; 30,000 points a sweep), runs `pags import KIND`, and prints minutes, processor time of all processes, their peak
memory together and bytes. The tree and the data set are removed again. It needs numpy, pillow, pandas and pyarrow: tools/recordings/.venv/bin/python."""

import io
import json
import os
import pathlib
import resource
import shutil
import subprocess
import sys
import time

import numpy as np
from PIL import Image

ROOT = pathlib.Path(__file__).resolve().parent.parent
sys.path.insert(0, str(ROOT / "tests" / "recordings"))

import blind_tables  # noqa: E402
import blind_trees  # noqa: E402

SIZES = {"nuscenes": (1600, 900), "argoverse2": (1550, 2048), "pandaset": (1920, 1080), "waymo2": (1920, 1280), "kitti360": (1408, 376)}
POINTS, PICTURES, NEAR = 30_000, 8, 60.0
AXES = np.array([[0.0, 0, 1, 0], [-1, 0, 0, 0], [0, -1, 0, 0], [0, 0, 0, 1]])  # OpenCV's camera axes in the car's frame


class Sink(dict):
    """Forgets what it is given: the writers' truth about points would fill the memory."""

    def __setitem__(self, key, value):
        pass


class Street:
    """A street as blind_trees.Street has it: the car drives a metre a step along an arc."""

    def __init__(self, kind, steps, folder):
        self.count, self.size, self.folder = steps, SIZES[kind], folder
        random = np.random.default_rng(1)
        turn = blind_trees.turned(2e-4, 1.0)
        self.ego = [np.eye(4)]
        for _ in range(1, steps):
            self.ego.append(self.ego[-1] @ turn)
        self.camera = [blind_trees.turned(angle, 1.5, 0.0, 1.5) @ AXES for angle in (0, 0.9, -0.9)]
        width, height = self.size
        self.lens = [np.array([0.7 * width, 0.7 * width, width / 2, height / 2, 0, 0, 0, 0, 0])] * 3
        sweeps = [self.make_sweep(random) for _ in range(PICTURES)]
        self.sweep = [sweeps[t % PICTURES] for t in range(steps)]
        self.boxes = [{} for _ in range(steps)]
        self.park(steps)
        self.pictures = [self.make_picture(random, number) for number in range(PICTURES)]

    @staticmethod
    def make_sweep(random):
        """Ground and two walls in the car's frame."""
        x, y, wall = random.uniform(-70, 70, POINTS), random.uniform(-12, 12, POINTS), random.random(POINTS) < 0.4
        y = np.where(wall, 12 * np.sign(y), y)
        z = np.where(wall, random.uniform(0, 6, POINTS), 0)
        return np.stack([x, y, z, random.random(POINTS)], 1).astype(np.float32)

    def park(self, steps):
        """A car stands every eight metres on either side and is labelled while it is near; seven cars drive in front for a hundred steps each."""
        size = np.array([4.4, 1.8, 1.5])
        for at in range(0, steps, 8):
            for side, y in (("l", 5.0), ("r", -5.0)):
                pose = self.ego[at] @ blind_trees.turned(0, 0, y, 0.75)
                for t in range(max(0, at - int(NEAR)), min(steps, at + int(NEAR) // 2)):
                    self.boxes[t][f"parked_{side}_{at:05d}"] = ("Car", pose, size)
        for t in range(steps):
            for lane in range(7):
                self.boxes[t][f"moving_car_{lane + 100 * (t // 100):05d}"] = ("Car", self.ego[t] @ blind_trees.turned(0, 10.0 + 6 * lane, 3.0 * (lane % 2) - 1.5, 0.75), size)

    def make_picture(self, random, number):
        """Half smooth, half grainy, as photographs are: 0.2 bytes a pixel as JPEG."""
        width, height = self.size
        coarse = Image.fromarray(random.integers(0, 256, (height // 24, width // 24, 3), dtype=np.uint8)).resize(self.size, Image.BICUBIC)
        pixels = np.clip(np.asarray(coarse).astype(int) + random.normal(0, 5, (height, width, 1)), 0, 255).astype(np.uint8)
        image, jpeg, path = Image.fromarray(pixels), io.BytesIO(), os.path.join(self.folder, f"picture{number}.png")
        image.save(jpeg, "JPEG", quality=80)
        image.save(path, compress_level=1)
        return jpeg.getvalue(), path

    def file(self, t, c):
        return self.pictures[(t + c) % PICTURES][1]

    def jpeg(self, t, c, mark=""):
        return self.pictures[(t + c) % PICTURES][0]


def kept(uncurl):
    """The car goes on evenly and there are eight sweeps: what a turning scanner measures of each is computed once."""
    known = {}

    def of(points, delta):
        key = (points[:9].tobytes(), len(points), np.round(delta, 6).tobytes())
        if key not in known:
            known[key] = uncurl(points, delta)
        return known[key]

    return of


def write_tree(kind, steps, folder):
    """The raw tree and the options that choose its recording."""
    for module in (blind_trees, blind_tables):
        module.inside = lambda box, points: 9  # points in a box: no importer asks
        module.Truth = lambda *given, make=blind_trees.Truth, **more: make(*given, **more | {"points": Sink()})
    blind_tables.uncurl = kept(blind_tables.uncurl)
    per_step = 2 if kind == "argoverse2" else 1  # its tree has photographs at twice the rate of its sweeps
    street = Street(kind, steps * per_step, folder)
    raw = os.path.join(folder, "raw")
    write = getattr(blind_trees if kind in ("nuscenes", "argoverse2") else blind_tables, kind)
    return raw, write(street, raw).options


def children(parent):
    """The processes below one, and their resident bytes together."""
    below, sizes = {}, {}
    for name in os.listdir("/proc"):
        if name.isdigit():
            try:
                fields = pathlib.Path("/proc", name, "stat").read_text().rpartition(")")[2].split()
                below.setdefault(int(fields[1]), []).append(int(name))
                sizes[int(name)] = int(fields[21]) * resource.getpagesize()
            except (OSError, IndexError):
                continue
    found, left = [], [parent]
    while left:
        found.append(left.pop())
        left += below.get(found[-1], [])
    return sum(sizes.get(process, 0) for process in found)


def size_of(folder):
    return sum(os.path.getsize(os.path.join(place, name)) for place, _, names in os.walk(folder) for name in names)


def measure(pags, kind, raw, options, out):
    begun, before, peak = time.monotonic(), resource.getrusage(resource.RUSAGE_CHILDREN), 0
    process = subprocess.Popen([pags, "import", kind, raw, "-o", out, "-q", *options])
    while process.poll() is None:
        peak = max(peak, children(process.pid))
        time.sleep(0.05)
    if process.returncode:
        sys.exit(f"import_frames: pags import {kind} ended with code {process.returncode}")
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return time.monotonic() - begun, after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime, peak


def main():
    if len(sys.argv) not in (4, 5) or sys.argv[1] not in SIZES or not sys.argv[2].isdigit():
        sys.exit(__doc__)
    kind, steps, folder = sys.argv[1], int(sys.argv[2]), os.path.join(sys.argv[3], f"import-{sys.argv[1]}-{sys.argv[2]}")
    pags = os.path.abspath(sys.argv[4]) if len(sys.argv) == 5 else str(ROOT / "build" / "pags")
    os.makedirs(folder)  # a folder that is there isn't ours to remove
    try:
        raw, options = write_tree(kind, steps, folder)
        out = os.path.join(folder, "out")
        seconds, processor, peak = measure(pags, kind, raw, options, out)
        told = json.loads(pathlib.Path(out, "timestamps.json").read_text(encoding="utf-8"))
        boxes = json.loads(pathlib.Path(out, "instances", "instances_info.json").read_text(encoding="utf-8"))
        labelled = sum(len(box["frame_annotations"]["frame_idx"]) for box in boxes.values())
        print(f"{kind}: {len(told['frames'])} time steps, {len(os.listdir(os.path.join(out, 'images')))} photographs, {labelled} boxes of {len(boxes)} things; {seconds / 60:.1f} min, "
              f"{processor:.0f} s of processor time, at most {peak / 1e6:.0f} MB, {size_of(raw) / 1e9:.2f} GB read, {size_of(out) / 1e9:.2f} GB written", flush=True)  # fmt: skip
    finally:
        shutil.rmtree(folder)


if __name__ == "__main__":
    main()
