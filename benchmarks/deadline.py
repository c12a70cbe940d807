#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""deadline.py PAGS SCENE FOLDER [--budget MS,half] [--threads N]: what pags render --budget-ms keeps along a drive, and what it costs.

Draws the recorded views of a driving scene, one sensor's drive after another, without a budget (Early-Z off) and within each budget; `half` is half
of the median time without one. Tells the share of frames that kept it, the steps taken, and PSNR of critical pixels against the photographs beside
that of the full pictures. A pixel is critical where the Gaussian that weighs most has a priority over 0.5 in the full picture. PYTHONPATH names the
folder of the module pags; needs numpy and Pillow. Writes FOLDER/deadline.json; pictures of earlier runs in FOLDER are used again but for those
within a budget."""

import argparse
import json
import math
import os
import shutil
import statistics
import subprocess
import sys

import numpy
import pags
from PIL import Image

STEPS = "budget {ms:.1f} ms: {met} of {frames} frames ({share:.1f} %), median {median:.1f} ms, worst {worst:.1f}; steps {steps}; critical {psnr:.2f} dB, {lost:+.3f} dB to no budget"


def run(program, *arguments):
    done = subprocess.run([program, *map(str, arguments)], stderr=subprocess.PIPE, text=True)
    if done.returncode:
        sys.exit(f"deadline: {done.stderr}")


def read(path):
    with open(path, encoding="utf-8") as file:
        return json.load(file)


def in_order(scene, folder):
    """The scene with its cameras in the order of the sensors' drives."""
    shutil.rmtree(folder, ignore_errors=True)
    shutil.copytree(scene, folder, ignore=shutil.ignore_patterns("checkpoint*", "*.html", "log.jsonl", "previews"))
    description = read(os.path.join(folder, "scene.json"))
    description["cameras"].sort(key=lambda view: (view.get("sensor", 0), view.get("time", 0)))
    with open(os.path.join(folder, "scene.json"), "w", encoding="utf-8") as file:
        json.dump(description, file)
    return [os.path.splitext(view["name"])[0] for view in description["cameras"]]


def masks(folder, names):
    """Of each view, which pixels are critical."""
    scene, out = pags.load(folder), {}
    for view in scene.views:
        priority = pags.render(scene, view, outputs=("priority",)).priority
        out[os.path.splitext(view["name"])[0]] = numpy.asarray(priority) > 0.5
    return [out[name] for name in names]


def picture(path):
    return numpy.asarray(Image.open(path).convert("RGB"), dtype=numpy.float64)


def psnr(names, where, drawn, photographs):
    """Of all critical pixels of all views."""
    squares, count = 0.0, 0
    for name, mask in zip(names, where):
        error = (picture(os.path.join(drawn, name + ".png")) - picture(os.path.join(photographs, name + "_photo.png")))[mask]
        squares, count = squares + float((error**2).sum()), count + error.size
    return 10 * math.log10(255**2 * count / squares)


def main():
    parser = argparse.ArgumentParser(description=__doc__.split(":", 1)[1], formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("pags")
    parser.add_argument("scene")
    parser.add_argument("folder")
    parser.add_argument("--budget", default="33,half", help="milliseconds, separated by commas; default 33,half")
    parser.add_argument("--threads", type=int, default=0)
    arguments = parser.parse_args()
    folder = os.path.abspath(arguments.folder)
    os.makedirs(folder, exist_ok=True)
    scene, full, photographs = (os.path.join(folder, name) for name in ("scene", "full", "photographs"))
    names = in_order(arguments.scene, scene)
    common = ["--split", "all", "-q", "-j", arguments.threads]
    run(arguments.pags, "render", scene, *common, "--early-z", "off", "-o", full, "--json", full + ".json")
    if not os.path.isdir(photographs):
        run(arguments.pags, "eval", scene, "--split", "all", "-q", "--images", photographs)
    where = masks(scene, names)
    off = statistics.median(frame["ms"]["total"] for frame in read(full + ".json")["frames"])
    best = psnr(names, where, full, photographs)
    print(f"no budget: median {off:.1f} ms, critical {best:.2f} dB on {100 * numpy.mean([mask.mean() for mask in where]):.1f} % of the pixels")
    rows = []
    for budget in arguments.budget.split(","):
        ms = off / 2 if budget == "half" else float(budget)
        drawn = os.path.join(folder, f"within-{budget}")
        run(arguments.pags, "render", scene, *common, "--budget-ms", f"{ms:.3f}", "-o", drawn, "--json", drawn + ".json")
        report = read(drawn + ".json")
        times = [frame["budget_ms"] for frame in report["frames"]]
        row = {"budget": budget, "ms": ms, "frames": len(times), "met": sum(frame["met"] for frame in report["frames"]), "median": statistics.median(times)}
        row |= {"worst": max(times), "share": 100 * row["met"] / row["frames"], "steps": [step["frames"] for step in report["budget"]["steps"]]}
        row["psnr"] = psnr(names, where, drawn, photographs)
        row["lost"] = row["psnr"] - best
        print(STEPS.format(**row))
        rows.append(row)
    with open(os.path.join(folder, "deadline.json"), "w", encoding="utf-8") as file:
        json.dump({"off_median_ms": off, "critical_psnr": best, "load": os.getloadavg(), "budgets": rows}, file, indent=1)


if __name__ == "__main__":
    main()
