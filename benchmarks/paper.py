#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""The paper's tables (arXiv:2510.12282), each made by one command that can be interrupted and resumed (docs/paper-tables.md).

All tables of a folder share their trainings, so that spr of Table 3 is also alpha 0.4 of Table 4 and the centre of
figure 5. Every row corrects the cameras, which presets plain and paper don't do otherwise."""

import argparse
import json
import math
import os
import shutil
import sys

import ablation
import plots
from ablation_tables import Layout, over_alpha, over_figure, over_rates, over_time

CAMERAS = ["--set", "camera_poses=1", "--set", "light=1"]
QUALITY = ["psnr", "psnr_critical", "psnr_noncritical", "psnr_moving", "ssim", "lpips"]
SIZE = ["gaussians", "bytes"]
COST = ["peak_rss_bytes", "training_seconds", "training_cpu_seconds", "fps"]
FRAMES = over_figure("fps", "frames per second")

# Plain has the paper's objects, so that the rows of Table 3 differ in their components alone.
PLAIN = "plain+set:fourier=2"

# Rows of each table by their title, and how the results are shown.
TABLES = {
    "table3": (
        {
            "plain": PLAIN,
            "SP": "sp",
            "SD": "sd+set:fourier=2",
            "SP + SD": "sp+sd",
            "SPR": "spr",
            "PDR": PLAIN + "+pdr",
            "SPR + PDR": "spr+pdr",
            "default": "default",
        },
        Layout("Table 3, components,", figures=[*QUALITY, *SIZE, *COST], panels=[over_time, FRAMES]),
    ),
    "table4": (
        {
            "gradient, alpha 0": "alpha=0",
            "alpha 0.2": "alpha=0.2",
            "hybrid, alpha 0.4": "alpha=0.4",
            "semantic, alpha 1": "alpha=1",
            "default, alpha 0": "default+alpha=0",
            "default, alpha 0.4": "default",
            "default, alpha 1": "default+alpha=1",
        },
        Layout("Table 4, the hybrid score,", figures=[*QUALITY, *SIZE, *COST[1:]], panels=[over_alpha]),
    ),
    "figure5": (
        {f"{e} %, {f} %": f"rate={e}/{f}" for e in (45, 60, 75) for f in (15, 30, 45)},
        Layout("Figure 5, pruning rates while densifying and afterwards,", figures=[*QUALITY, *SIZE, *COST[1:]], panels=[over_rates]),
    ),
    "order": (
        {
            f"{title}{', PDR' if pdr else ''}{', order of the paper' if order else ''}": row + pdr + order
            for title, row in [("plain", PLAIN), ("SPR", "spr"), ("default", "default")]
            for pdr in ("", "+pdr")
            for order in ("", "+paper-order")
        },
        Layout("Priority-driven rendering and the order of the paper", figures=[*QUALITY, "render_ms", "fps"], panels=[FRAMES]),
    ),
    "start": ({}, Layout("Initial points", figures=[*QUALITY, "depth", *SIZE, *COST[1:]], panels=[over_time])),
    "object": ({}, Layout("Equal size limit", figures=[*QUALITY, *SIZE, *COST], panels=[over_time])),
}  # fmt: skip


def rows_of_start(given):
    """Rows for the points that the data set has and those of the COLMAP model --sfm."""
    if given.sfm and any(c in given.sfm for c in "+,*"):
        raise ablation.Failure(f"--sfm: {given.sfm}: expected a path without '+', ',' and '*'")
    lines = []
    code, message, _ = ablation.Program(given.pags).run(["info", given.dataset, "--json", "-"], lines.append)
    if code:
        raise ablation.Failure(message)
    found, sfm = json.loads("".join(lines)), given.sfm and os.path.realpath(given.sfm)
    if found.get("lidar_sweeps"):
        rows = {"LiDAR": "default", "matched": "no-lidar-start"}
        more = {"SfM": f"no-lidar-start+--sfm={sfm}", "LiDAR and SfM": f"--sfm={sfm}"}
    elif found.get("points_random"):
        rows, more = {"matched": "default"}, {"SfM": f"--colmap={sfm}"}
    else:
        raise ablation.Failure(
            f"{given.dataset}: has no LiDAR, but points; expected LiDAR, or no points and those of a COLMAP model with --sfm"
        )
    given.sfm = None
    return {**rows, **(more if sfm else {})}


# ---- The figure of an object ----


def box_in(camera, knot, size):
    """The object's box in the picture: left, top, right, bottom in pixels; None unless the whole box is in it."""
    w, x, y, z = camera["camera_from_world_quaternion_wxyz"]
    turn = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
        [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
        [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
    ]
    pose, pixels = knot["world_from_object"], []
    for corner in range(8):
        local = [size[k] * ((corner >> k & 1) - 0.5) for k in range(3)]
        world = [sum(pose[4 * r + k] * local[k] for k in range(3)) + pose[4 * r + 3] for r in range(3)]
        p = [
            sum(turn[r][k] * world[k] for k in range(3)) + camera["camera_from_world_translation"][r] for r in range(3)
        ]
        if p[2] < 1:
            return None
        pixels.append([camera["fx"] * p[0] / p[2] + camera["cx"], camera["fy"] * p[1] / p[2] + camera["cy"]])
    box = [min(u for u, _ in pixels), min(v for _, v in pixels), max(u for u, _ in pixels), max(v for _, v in pixels)]
    inside = box[0] > 0 and box[1] > 0 and box[2] < camera["width"] and box[3] < camera["height"]
    return box if inside else None


def largest_object(scene):
    """The held-out camera and the box of the moving critical object that is largest in a held-out view."""
    found = [
        (camera, box)
        for camera in scene["cameras"]
        if camera["test"]
        for thing in scene["objects"]
        if thing["critical"] and thing["moving"]
        for knot in thing["knots"]
        if knot["frame"] == camera["frame"]
        for box in [box_in(camera, knot, thing["size"])]
        if box
    ]
    if not found:
        raise ablation.Failure("no object.png: no held-out view shows the whole of a moving critical object")
    return max(found, key=lambda pair: (pair[1][2] - pair[1][0]) * (pair[1][3] - pair[1][1]))


def draw_object(table, path):
    """Writes the picture of the object: its photograph and its held-out render by each row of the table."""
    plot = plots.pyplot()
    if not plot:
        table.progress.say(f"no {path}: {plots.MISSING}")
        return
    pictures, camera, box = {}, None, None
    for row in table.rows:
        run = ablation.Run(table, row, 0)
        if not camera:
            camera, box = largest_object(ablation.read_json(os.path.join(run.scene, "scene.json")))
        os.makedirs(run.path("pictures"), exist_ok=True)
        run.measure("eval", run.path("pictures/eval.json"), ["--images", run.path("pictures"), *table.eval])
        for kind, title in [("photo", "photograph"), ("render", table.layout.names[row.name])]:
            name = f"{os.path.splitext(camera['name'])[0]}_{kind}.png"
            pictures[title] = plot.imread(run.path(f"pictures/{name}"))[..., :3]
        shutil.rmtree(run.path("pictures"))

    margin = 0.15 * max(box[2] - box[0], box[3] - box[1])
    left, top = (max(0, int(box[k] - margin)) for k in (0, 1))
    right, bottom = math.ceil(box[2] + margin), math.ceil(box[3] + margin)
    cut = {title: picture[top:bottom, left:right] for title, picture in pictures.items()}
    figure, panels = plot.subplots(1, len(cut), figsize=(2.6 * len(cut), 2.9))
    for axes, (title, picture) in zip(panels, cut.items()):
        error = float(((picture - cut["photograph"]) ** 2).mean())
        axes.imshow(picture, interpolation="nearest")
        axes.set_title(f"{title}, {-10 * math.log10(error):.2f} dB" if error else title)
        axes.set_axis_off()
    figure.savefig(path, dpi=100)
    plot.close(figure)
    table.progress.say(path)


# ---- Command line ----


def parse_arguments(words):
    p = ablation.Parser(
        ablation.PROGRAM,
        allow_abbrev=False,
        parents=[ablation.common_options()],
        formatter_class=argparse.RawDescriptionHelpFormatter,
        description="The paper's tables (docs/paper-tables.md):\n"
        "  table3   components: pruning, dropout, their semantics, priority-driven rendering\n"
        "  table4   weight of semantics in the pruning score, alpha\n"
        "  figure5  pruning rates\n"
        "  order    priority-driven rendering, and blending in the order of the paper\n"
        "  start    initial points: LiDAR, structure from motion (--sfm), both, matched\n"
        "  object   a critical object at an equal size limit (--target-size), and its picture",
        epilog=ablation.RESUMED,
    )
    p.add_argument("table", metavar="TABLE", choices=TABLES, help=", ".join(TABLES))
    p.add_argument("dataset", metavar="DATASET", help="as for pags train")
    p.add_argument(
        "-o",
        "--output",
        metavar="FOLDER",
        required=True,
        help="write NAME.md, NAME.csv, NAME_curve.csv and NAME.svg of table NAME; trainings are kept in FOLDER/runs",
    )
    p.add_argument(
        "--target-size",
        type=float,
        default=20,
        metavar="MB",
        help="object: size limit of each scene [default %(default)s]",
    )
    p.set_defaults(downscale="2", iterations=12000, equal_count=False, beside=None)
    return ablation.parse_words(p, words)


def main():
    given, rest = parse_arguments(sys.argv[1:])
    rows, layout = TABLES[given.table]
    if given.table == "start":
        rows = rows_of_start(given)
    if given.table == "object":
        limit = f"+--target-size={given.target_size:g}"
        rows = {"plain": "plain" + limit, "paper": "spr" + limit, "default": "default" + limit}
    given.rows, given.runs = ",".join(rows.values()), os.path.join(given.output, "runs")
    folder, given.output = given.output, os.path.join(given.output, given.table)
    names = {name: title for title, name in rows.items()}
    table = ablation.make_table(given, [*CAMERAS, *rest], layout._replace(names=names))
    if given.table == "object" and not given.check_options:
        draw_object(table, os.path.join(folder, "object.png"))


if __name__ == "__main__":
    sys.exit(ablation.exit_code_of(main))
