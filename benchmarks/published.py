#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Trains and evaluates PAGS by the protocol of published figures, from raw recordings to the row of a table
(docs/compare.md). Finished parts are kept in OUT; the same command continues.

    published.py pandaset RAW -o OUT     RAW: folder of PandaSet's sequences (001, 011, ...)
    published.py waymo RAW -o OUT        RAW: folder of segments of the Waymo Open Dataset v1 (*.tfrecord)
    ... [--sequences 001,011] [--iterations N] [--pags PROGRAM] [--prepare] [-- OPTIONS OF pags train]

pandaset: SplatAD, novel views (arXiv:2411.16816; georghess/neurad-studio, pandaset_dataparser.py and ad_dataparser.py):
ten sequences, six cameras, 1920x1080, the lower 260 rows of the back camera cut off, half of the time steps trained:
those of numpy.linspace(0, 79, 40, dtype=int), which are 0, 2, ..., 76 and 79.

waymo: BezierGS (arXiv:2506.22099; fudan-zvg/BezierGS, configs/ and scene/drivex_waymo_loader.py), also the source of its
rows of Street Gaussians, PVG and OmniRe: twelve segments of which the first and last time step are given, three cameras,
960x640 (half), every fourth time step held out: the 4th, 8th, ... of the chosen ones.

Cut photographs are written as PNG. It needs Pillow, from tools/recordings/.venv (make setup)."""

import argparse
import glob
import json
import os
import subprocess
import sys

ROOT = os.path.dirname(os.path.dirname(os.path.abspath(__file__)))
try:
    from PIL import Image
except ImportError:
    other = os.path.join(ROOT, "tools", "recordings", ".venv", "bin", "python")
    if not os.path.exists(other) or sys.executable == other:
        sys.exit(f"published: needs Pillow; 'make setup' puts it into {other}")
    os.execv(other, [other, "-B", *sys.argv])

PANDASET = "001 011 016 028 053 063 084 106 123 158".split()
PANDASET_CAMERAS = [f"{name}_camera" for name in "front front_left front_right left right back".split()]
CUT, OF_ROWS = 260, 1080
# The number of a segment in the list of Waymo's training set that EmerNeRF made, with its name and time steps.
WAYMO = {
    "006": ("10075870402459732738", 0, 85),
    "017": ("10235335145367115211", 61, 109),
    "026": ("10500357041547037089", 0, 100),
    "090": ("11940460932056521663", 0, 102),
    "105": ("12281202743097872109", 20, 186),
    "108": ("1231623110026745648", 20, 115),
    "134": ("13005562150845909564", 106, 198),
    "145": ("13186511704021307558", 26, 74),
    "147": ("13207915841618107559", 6, 54),
    "150": ("13258835835415292197", 96, 197),
    "158": ("13506499849906169066", 126, 174),
    "181": ("14004546003548947884", 0, 160),
}


class Failure(Exception):
    pass


def half_held_out(count):
    """Those of `count` time steps that are not in numpy.linspace(0, count - 1, ceil(count / 2), dtype=int)."""
    trained = (count + 1) // 2
    kept = {i * (count - 1) // (trained - 1) for i in range(trained)} if trained > 1 else {0}
    return [t for t in range(count) if t not in kept]


def fourth_held_out(count):
    return [t for t in range(count) if (t + 1) % 4 == 0]


def cut_back_camera(raw, out):
    """Makes a sequence of links whose back camera's photographs are cut."""
    for camera in PANDASET_CAMERAS:
        if not os.path.isdir(os.path.join(raw, "camera", camera)):
            raise Failure(f"{raw}/camera/{camera}: is missing; expected PandaSet's six cameras")
    back = os.path.join(out, "camera", "back_camera")
    os.makedirs(back, exist_ok=True)
    for folder, names in [("", ["annotations", "lidar"]), ("camera", PANDASET_CAMERAS[:-1])]:
        for name in names:
            link, target = os.path.join(out, folder, name), os.path.join(raw, folder, name)
            if os.path.exists(target) and not os.path.lexists(link):
                os.symlink(os.path.abspath(target), link)
    for path in sorted(glob.glob(os.path.join(glob.escape(raw), "camera", "back_camera", "*"))):
        name, ending = os.path.splitext(os.path.basename(path))
        if ending == ".json":
            with open(path, "rb") as file, open(os.path.join(back, name + ending), "wb") as copy:
                copy.write(file.read())
            continue
        cut = os.path.join(back, f"{name}.png")
        if os.path.exists(cut):
            continue
        try:
            with Image.open(path) as picture:
                width, height = picture.size
                rows = height - round(height * CUT / OF_ROWS)
                picture.crop((0, 0, width, rows)).save(f"{cut}.part", "PNG", compress_level=1)
        except OSError as error:
            raise Failure(f"{path}: can't be read as a picture ({error}); download this sequence again") from error
        os.replace(f"{cut}.part", cut)


class Sequence:
    """One sequence: its data set, scene and scores in a folder of its own."""

    def __init__(self, name, given):
        self.name, self.given, self.out = name, given, os.path.join(given.output, name)
        self.dataset, self.scene = os.path.join(self.out, "data"), os.path.join(self.out, "scene")
        os.makedirs(self.out, exist_ok=True)

    def pags(self, *words):
        code = subprocess.run([self.given.pags, *map(str, words)], stdout=sys.stderr).returncode
        if code == 3 or code < 0:
            raise Failure(f"{self.name}: interrupted; the same command continues")
        if code:
            raise Failure(f"{self.name}: pags {words[0]} failed, as it says above; the same command continues")

    def import_recording(self):
        if self.given.protocol == "pandaset":
            raw = os.path.join(self.given.raw, self.name)
            if not os.path.isdir(raw):
                raise Failure(f"{raw}: is missing; expected the sequence, or --sequences without it")
            cut = os.path.join(self.out, "raw", self.name)
            cut_back_camera(raw, cut)
            self.pags("import", "pandaset", cut, "-o", self.dataset, "-q")
            return
        segment, first, last = WAYMO[self.name]
        found = glob.glob(os.path.join(glob.escape(self.given.raw), f"*{segment}_*.tfrecord"))
        if len(found) != 1:
            raise Failure(
                f"{self.given.raw}: expected one segment-{segment}_*.tfrecord (number {self.name}), found {len(found)}; "
                "download it, or name other --sequences"
            )
        words = ["--cameras", "0,1,2", "--frames", f"{first}-{last}"]
        self.pags("import", "waymo", found[0], "-o", self.dataset, "-q", *words)

    def state_split(self):
        """Writes held_out into dataset.json; returns the number of time steps that are trained and held out."""
        path = os.path.join(self.dataset, "dataset.json")
        with open(path, encoding="utf-8") as file:
            told = json.load(file)
        pictures = [name.split(".")[0].split("_") for name in os.listdir(os.path.join(self.dataset, "images"))]
        steps = sorted({int(frame) for frame, _ in pictures})
        cameras = sorted({int(camera) for _, camera in pictures})
        expected = len(PANDASET_CAMERAS) if self.given.protocol == "pandaset" else 3
        if len(cameras) != expected or len(pictures) != len(steps) * expected:
            raise Failure(
                f"{self.dataset}/images: {len(pictures)} photographs of {len(cameras)} cameras at {len(steps)} time steps; "
                f"expected {expected} cameras at each. The recording is incomplete"
            )
        held_out = (half_held_out if self.given.protocol == "pandaset" else fourth_held_out)(len(steps))
        told["held_out"] = [steps[i] for i in held_out]
        with open(f"{path}.part", "w", encoding="utf-8") as file:
            json.dump(told, file, indent=1)
        os.replace(f"{path}.part", path)
        return (len(steps) - len(held_out)) * expected, len(held_out) * expected

    def scores(self):
        """Returns the means of pags eval over the held-out views."""
        path = os.path.join(self.out, "eval.json")
        if not os.path.exists(path):
            if not os.path.exists(os.path.join(self.dataset, "dataset.json")):
                self.import_recording()
            trained, held_out = self.state_split()
            say(f"{self.name}: {trained} photographs to train, {held_out} held out")
            if self.given.prepare:
                return None
            half = ["--downscale", 2] if self.given.protocol == "waymo" else []
            words = ["train", self.dataset, "-o", self.scene, "-n", self.given.iterations, *half, *self.given.options]
            self.pags(*words, "--resume")
            self.pags("eval", self.scene, "--split", "test", "-q", "--json", f"{path}.part")
            with open(f"{path}.part", encoding="utf-8") as file:
                views = json.load(file)["test"]["views"]
            if views != held_out:
                raise Failure(
                    f"{self.scene}: {views} views were compared, expected {held_out}; remove it and start again"
                )
            os.replace(f"{path}.part", path)
        with open(path, encoding="utf-8") as file:
            told = json.load(file)
        return {**told["test"], "network": told["lpips_network"]}


def say(line):
    print(line, file=sys.stderr, flush=True)


def table(results):
    """Rows of the sequences and of their mean, each sequence weighing the same."""
    lines = ["| sequence | views | PSNR | SSIM | LPIPS | critical |", "|---|---|---|---|---|---|"]

    def row(name, views, values):
        cells = ["" if v is None else f"{v:.{digits}f}" for v, digits in zip(values, (2, 3, 3, 2))]
        lines.append(f"| {name} | {views} | {' | '.join(cells)} |")

    columns = []
    for name, r in results.items():
        columns.append([r["psnr"], r["ssim"], r["lpips"], r["psnr_critical"]])
        row(name, r["views"], columns[-1])
    means = [None if None in column else sum(column) / len(column) for column in zip(*columns)]
    row(f"mean of {len(results)}", sum(r["views"] for r in results.values()), means)
    networks = sorted({r["network"] or "none" for r in results.values()})
    return "\n".join([*lines, "", f"LPIPS network: {', '.join(networks)}."])


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("protocol", choices=["pandaset", "waymo"])
    parser.add_argument("raw")
    parser.add_argument("-o", "--output", required=True, metavar="OUT")
    parser.add_argument("--sequences", metavar="LIST", help="only these [default: all of the protocol]")
    parser.add_argument("--iterations", type=int, default=30000, metavar="N", help="steps [default: 30000]")
    parser.add_argument("--pags", default=os.path.join(ROOT, "build", "pags"), metavar="PROGRAM")
    parser.add_argument("--prepare", action="store_true", help="import and split; train nothing")
    words = sys.argv[1:]
    at = words.index("--") if "--" in words else len(words)
    given = parser.parse_args(words[:at])
    given.options = words[at + 1 :]
    known = PANDASET if given.protocol == "pandaset" else list(WAYMO)
    names = given.sequences.split(",") if given.sequences else known
    try:
        for name in names:
            if name not in known:
                raise Failure(f"--sequences {name}: expected some of {','.join(known)}")
        results = {}
        for number, name in enumerate(names, 1):
            say(f"sequence {number} of {len(names)}: {name}")
            results[name] = Sequence(name, given).scores()
    except Failure as failure:
        sys.exit(f"published: {failure}")
    except KeyboardInterrupt:
        sys.exit("published: interrupted; the same command continues")
    if given.prepare:
        return
    text = table(results)
    with open(os.path.join(given.output, "table.md"), "w", encoding="utf-8") as file:
        file.write(text + "\n")
    print(text)


if __name__ == "__main__":
    main()
