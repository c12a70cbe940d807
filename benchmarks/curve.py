#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""curve.py: speed against error, as a table, a picture and JSON (docs/speed-against-error.md).

frame: time of a frame against PSNR to the exact frame and to the photographs, by drawing mode and time limit, for a
scene or several. training: time of training against PSNR on held-out photographs, by preset and number of steps."""

import argparse
import json
import math
import os
import platform
import re
import shutil
import signal
import subprocess
import sys
import tempfile
import time

import plots
from ablation import PASSED, Parser, duration, read_json, whole
from ablation_tables import cell, markdown_table, write

HERE = os.path.dirname(os.path.abspath(__file__))
CAMERAS = "set:camera_poses=1+set:light=1"  # presets plain and paper don't correct the cameras otherwise
PROBE_STEPS = 100
BOUNDED = "error bound (bounded=EPS)"
# Drawing modes and limits by what they change: title, pattern of the names, what labels call the rest of a name.
FAMILIES = [
    ("full quality", r"off|lossless", {}),
    ("exp of degree 3", r"exp3", {"exp3": ""}),
    (BOUNDED, r"bounded(?:=(.*))?", {"bounded": "1/255"}),
    ("Early-Z of the paper", r"paper.*", {"paper": "by depth", "paper-order": "paper's order"}),
    ("SH degree at most", r"sh(\d)", {}),
    ("level of time limits", r"level (.*)", {}),
    ("time limit", r"limit (.*)", {}),
]
EXACT, PHOTO = "PSNR to the exact frame, dB", "PSNR to held-out photographs, dB"


class Failure(Exception):
    pass


def machine():
    """Name of this machine's processor, and how many of them there are."""
    name = platform.processor() or platform.machine()
    if os.path.exists("/proc/cpuinfo"):
        with open("/proc/cpuinfo", encoding="utf-8") as file:
            name = dict(line.split("\t: ", 1) for line in file if "\t: " in line).get("model name", name).strip()
    return f"{name}, {os.cpu_count()} processors"


class Child:
    """Runs programs. A first SIGINT or SIGTERM reaches the program that runs, which stops with its state saved."""

    def __init__(self):
        self.process, self.stopped = None, False
        for number in [signal.SIGINT, signal.SIGTERM]:
            signal.signal(number, self.stop)

    def stop(self, number, _):
        self.stopped = True
        if self.process and number == signal.SIGTERM:  # the terminal sends Ctrl-C to both
            self.process.terminate()

    def run(self, words, **more):
        """Ends this program with the exit code of the other one where that isn't 0; its message was printed."""
        self.process = subprocess.Popen([str(word) for word in words], **more)
        code, self.process = self.process.wait(), None
        if code or self.stopped:
            raise SystemExit(3 if self.stopped else abs(code))


# ---- Pictures ----


def place_label(axes, text, at, colour, taken):
    """Writes a label next to a point where it covers no other label, line or point, if there is such a place; `taken`: boxes in pixels."""
    renderer = axes.figure.canvas.get_renderer()
    sides = [(7, 0, "left", "center"), (-7, 0, "right", "center"), (0, 7, "center", "bottom"), (0, -7, "center", "top")]
    for distance in (1, 1.6, 2.2):  # further away it would be another point's label
        for dx, dy, horizontal, vertical in sides:
            offset = (distance * dx, distance * dy)
            note = axes.annotate(
                text, at, offset, textcoords="offset points", ha=horizontal, va=vertical, fontsize=8, color=colour
            )
            box = note.get_window_extent(renderer)
            inside = axes.bbox.x0 <= box.x0 and box.x1 <= axes.bbox.x1 and box.y1 <= axes.bbox.y1
            if inside and not any(box.overlaps(other) for other in taken):
                taken.append(box)
                return
            note.remove()


def draw_points(axes, groups):
    """Draws groups of points, {name: [(x, y, y of critical pixels, label), ...]}: filled for all pixels, hollow for
    critical ones. Returns a line of each group and one of critical pixels, by name, for the legend; names that begin with
    _ are not in it."""
    shown = {}
    for index, (name, points) in enumerate(groups.items()):
        colour, marker = plots.COLOURS[index % len(plots.COLOURS)], plots.MARKERS[index % len(plots.MARKERS)]
        for k, dashes in [(1, "-"), (2, ":")]:
            at = [(p[0], p[k]) for p in points if p[k] is not None and math.isfinite(p[k])]
            if not at:
                continue
            style = {"color": colour, "marker": marker, "markerfacecolor": colour if k == 1 else "white"}
            (line,) = axes.plot(*zip(*at), linestyle=dashes, markersize=6, **style)
            if k == 1 and not name.startswith("_"):
                shown[name] = line
            elif k == 2:
                (shown["critical pixels"],) = axes.plot([], [], "o:", color="#555555", markerfacecolor="white")
    axes.margins(0.12, 0.15)
    return shown


def label_points(axes, groups):
    """Labels the points; the figure must have been laid out, so that their places are known."""
    from matplotlib.transforms import Bbox

    taken = []
    for line in axes.get_lines():
        at = [tuple(xy) for xy in axes.transData.transform(line.get_xydata())]
        taken += [Bbox.from_extents(x - 4, y - 4, x + 4, y + 4) for x, y in at]
        for (x0, y0), (x1, y1) in zip(at, at[1:]):  # what lies on the line between two points
            steps = [k / 32 for k in range(1, 32)]
            taken += [Bbox.from_bounds(x0 + (x1 - x0) * t, y0 + (y1 - y0) * t, 1, 1) for t in steps]
    for index, points in enumerate(groups.values()):
        for x, y, _, text in points:
            if text and y is not None:
                place_label(axes, text, (x, y), plots.COLOURS[index % len(plots.COLOURS)], taken)


def save_picture(path, panels, title):
    """Draws panels, (title, x, y, groups), from left to right below the title, with one legend, which presumes that
    equal groups have equal names. Without matplotlib it writes nothing and says so."""
    plot, shown = plots.pyplot(), {}
    if not plot:
        print(f"no {path}: {plots.MISSING}")
        return False
    figure, axes = plot.subplots(1, len(panels), figsize=(5 * len(panels), 4.6), squeeze=False, dpi=100)
    figure.suptitle(title, fontsize="medium")
    for at, (name, x, y, groups) in zip(axes[0], panels):
        at.set(title=name, xlabel=x, ylabel=y)
        shown.update(draw_points(at, groups))
    figure.legend(shown.values(), shown.keys(), loc="outside lower center", ncols=4, fontsize="small")
    figure.canvas.draw()
    for at, panel in zip(axes[0], panels):
        label_points(at, panel[3])
    write(path, plots.svg(figure))
    return True


# ---- Frames ----


def family_of(name):
    """Index of the family of a mode or limit, and its label in the picture."""
    for index, (_, pattern, names) in enumerate(FAMILIES):
        found = re.fullmatch(pattern, name)
        if found:
            return index, names.get(name, (found.groups() or (None,))[0] or name)
    raise Failure(f"'{name}': expected a mode of pags-bench curve")


def groups_of(points, key):
    """Points by family, each as (milliseconds, decibels, of critical pixels, label). The time is the first point's median
    by the speed-up, from which changes of the machine's speed cancel. Equal frames have no PSNR; they are drawn above
    all others."""
    known = [p[region][key] for p in points for region in ("all", "critical") if p[region][key] is not None]
    if not known:
        return {}
    same = max(known) + 10 if key == "psnr_exact" else None
    groups, first = {}, points[0]["ms"]
    for point in points:
        index, label = family_of(point["point"])
        values = [point[region][key] for region in ("all", "critical")]
        if point["all"][key] is None:
            values = [same, same if point["critical"]["changed"] is not None else None]
        groups.setdefault(FAMILIES[index][0], []).append((first / point["speed_up"], *values, label))
    return groups


def scene_table(scene):
    heads = ["mode or limit", "ms", "ms, 95 %", "speed-up", "in time", "exact, dB", "critical", "largest error"]
    heads += ["changed", "photographs, dB", "critical"]
    rows = []
    for p in scene["points"]:
        whole_, critical = p["all"], p["critical"]
        value = lambda number, decimals: "-" if number is None else cell(number, decimals)  # noqa: E731
        exact = "same" if whole_["psnr_exact"] is None else value(whole_["psnr_exact"], 2)
        rows.append([f"`{p['point']}`", value(p["ms"], 2), value(p["ms_p95"], 2), value(p["speed_up"], 2)])
        rows[-1] += ["-" if p["met"] is None else f"{100 * p['met']:.0f} %", exact, value(critical["psnr_exact"], 2)]
        rows[-1] += [value(whole_["max_error"], 4), f"{100 * whole_['changed']:.2f} %"]
        rows[-1] += [value(whole_["psnr_photo"], 2), value(critical["psnr_photo"], 2)]
    return (
        f"\n## {scene['name']}\n\n{scene['gaussians']} Gaussians, {scene['views']} views of {scene['width']}x"
        f"{scene['height']}, {scene['repetitions']} frames each, {scene['threads']} threads. Exact frames: "
        f"{scene['exact']}.\n\n{markdown_table(heads, rows)}"
    )


def draw_frames(path, results):
    """The first scene's curves, and with several scenes the best modes of each. Returns whether it could be drawn."""
    scenes, panels = results["scenes"], []
    first = scenes[0]
    for title, key, y in [("Error of drawing", "psnr_exact", EXACT), ("Error of the scene", "psnr_photo", PHOTO)]:
        groups = groups_of(first["points"], key)
        if groups:
            panels.append((title, "milliseconds per frame", y, groups))
    if len(scenes) > 1 and len(panels) > 1:
        groups = {}
        for scene in scenes:
            families = groups_of(scene["points"], "psnr_photo")
            points = [p[:3] for name in (FAMILIES[0][0], BOUNDED) for p in families.get(name, [])]
            groups[f"_{scene['name']}"] = [(*p, "" if k else scene["name"]) for k, p in enumerate(points)]
        panels.append(("Scenes: full quality and error bounds", "milliseconds per frame", PHOTO, groups))
    title = (
        f"{first['name']}: {first['gaussians']} Gaussians, {first['width']}x{first['height']}, "
        f"{first['threads']} thread{'s' if first['threads'] > 1 else ''} of {results['machine'].split(', ')[0]}"
    )
    return save_picture(path, panels, title)


def frame_curve(given, rest):
    child, scenes, began = Child(), [], time.monotonic()
    for text in given.scenes:
        name, _, path = text.partition("=") if "=" in text and not os.path.exists(text) else ("", "", text)
        with tempfile.TemporaryDirectory() as folder:
            found = os.path.join(folder, "found.json")
            child.run([given.bench, "curve", path, "--json", found, "--threads", given.threads, *rest])
            scenes.append({"name": name or os.path.basename(os.path.normpath(path)), **read_json(found)})
    seconds = time.monotonic() - began
    results = {"machine": machine(), "seconds": seconds, "scenes": scenes}
    write(f"{given.output}.json", json.dumps(results, indent=1) + "\n")
    page = (
        f"# Frame time against error\n\n{results['machine']}; measured in {duration(seconds)}. Times: median and 95 per "
        "cent quantile; modes take turns, and speed-ups are to the first one. Errors are of values in 0..1; changed: "
        "pixels of another colour in 8 bits. Photographs: held-out ones, with the exposures found in training.\n"
    )
    write(f"{given.output}.md", page + "".join(map(scene_table, scenes)))

    drawn = draw_frames(f"{given.output}.svg", results)
    print(f"{given.output}.json, .md{', .svg' if drawn else ''}: {duration(seconds)}")


# ---- Training ----


def runs_of(output, steps):
    """States of the trainings of a number of steps that have begun."""
    folder = f"{output}.runs/{steps}.runs"
    names = sorted(os.listdir(folder)) if os.path.isdir(folder) else []
    paths = [os.path.join(folder, name, "run.json") for name in names]
    return [read_json(path) for path in paths if os.path.exists(path)]


def estimate(given, child, left, trainings, states, options):
    """Seconds for `left` steps of this number of trainings, by the states of earlier ones, else by a short one."""
    steps = sum(state["step"] for state in states)
    if steps:
        return left * sum(state["seconds"] for state in states) / steps
    print(f"training {PROBE_STEPS} steps to estimate the time", flush=True)
    with tempfile.TemporaryDirectory(dir=f"{given.output}.runs") as folder:
        report = os.path.join(folder, "train.json")
        words = ["train", given.dataset, "-o", os.path.join(folder, "scene"), "-n", PROBE_STEPS, "--json", report, "-q"]
        words += ["--preview-every", 0, "--checkpoint-every", 0, "--threads", given.threads]
        with open(os.path.join(folder, "errors"), "w+", encoding="utf-8") as errors:
            try:
                child.run([given.pags, *words, *options], stderr=errors)
            finally:
                errors.seek(0)
                stopped = "curve.py: interrupted; nothing was trained yet\n"
                print(stopped if child.stopped else errors.read(), end="", file=sys.stderr)
        found = read_json(report)
    start = max(0, found["seconds"] - PROBE_STEPS / found["iterations_per_second"])
    return left / found["iterations_per_second"] + trainings * start


def training_table(given, rows):
    heads = ["row", "steps", "processor s", "wall s", "PSNR", "critical", "other", "Gaussians", "MB", "ms a frame"]
    lines = []
    for row in rows:
        values = [row["training_cpu_seconds"], row["training_seconds"], row["psnr"], row["psnr_critical"]]
        values += [row["psnr_noncritical"], row["gaussians"], 1e-6 * row["bytes"], row["render_ms"]]
        decimals = [0, 0, 2, 2, 2, 0, 1, 2]
        numbers = ["-" if v is None else cell(v, d) for v, d in zip(values, decimals)]
        lines.append([f"`{row['row']}`", str(row["steps"]), *numbers])
    return markdown_table(heads, lines)


def training_curve(given, rest):
    own = rest[: rest.index("--")] if "--" in rest else rest
    train = rest[rest.index("--") + 1 :] if "--" in rest else []
    names, child, began = given.rows.split(","), Child(), time.monotonic()
    rows_text = ",".join(f"{name}+{CAMERAS}" for name in names)

    def command(steps, *more):
        words = [
            sys.executable,
            "-B",
            os.path.join(HERE, "ablation.py"),
            given.dataset,
            "-o",
            f"{given.output}.runs/{steps}",
        ]
        words += ["-n", steps, "--rows", rows_text, "--moments", 1, "--pags", given.pags]
        return [*words, "--threads", given.threads, *own, *more, "--", *train]

    os.makedirs(f"{given.output}.runs", exist_ok=True)
    for steps in given.steps:
        child.run(command(steps, "--check-options"))
    states = [state for steps in given.steps for state in runs_of(given.output, steps)]
    left = len(names) * sum(given.steps) - sum(state["step"] for state in states)
    if left > 0:
        shared = [word for k in range(0, len(own) - 1, 2) if own[k][2:] in PASSED for word in own[k : k + 2]]
        wait = estimate(given, child, left, len(names) * len(given.steps), states, [*shared, *train])
        print(
            f"{left} steps to train: about {duration(wait)}, without evaluations; Ctrl-C saves and the same command resumes"
        )
    rows = []
    with tempfile.TemporaryDirectory() as folder:
        for steps in given.steps:
            print(f"{steps} steps:", flush=True)
            found = os.path.join(folder, "found.json")
            child.run(command(steps, "--json", found))
            rows += [{**row, "row": names[i], "steps": steps} for i, row in enumerate(read_json(found)["rows"])]
    states = [state for steps in given.steps for state in runs_of(given.output, steps)]
    spent = [sum(state[key] for state in states) for key in ("seconds", "cpu_seconds")]
    results = {"machine": machine(), "seconds": spent[0], "cpu_seconds": spent[1], "rows": rows}
    write(f"{given.output}.json", json.dumps(results, indent=1) + "\n")
    dataset = "/".join(os.path.abspath(given.dataset).split("/")[-2:])
    took = f"{duration(spent[0])} of training, {duration(spent[1])} of processor time"
    page = (
        f"# Training time against error on {dataset}\n\n{results['machine']}; {took}. PSNR in dB on held-out photographs; "
        "critical: vehicles, pedestrians and cyclists. All rows correct the cameras "
        f"(`--set camera_poses=1 --set light=1`).\n\n{training_table(given, rows)}"
    )
    write(f"{given.output}.md", page)

    panels = []
    for title, key in [("All pixels", "psnr"), ("Critical pixels", "psnr_critical")]:
        groups = {}
        for name in names:
            ends = [row for row in rows if row["row"] == name]
            points = [(r["training_cpu_seconds"], r[key], None, f"{r['steps']}") for r in ends if r[key] is not None]
            if points:
                groups[name] = points
        if groups:
            panels.append((title, "seconds of processor time", PHOTO, groups))
    drawn = save_picture(f"{given.output}.svg", panels, f"Training on {dataset}, {results['machine'].split(', ')[0]}")
    print(f"{given.output}.json, .md{', .svg' if drawn else ''}: {took}; {duration(time.monotonic() - began)} now")


# ---- Command line ----


def steps_list(text):
    try:
        steps = sorted({int(word) for word in text.split(",")})
    except ValueError:
        steps = [0]
    if steps[0] < 1:
        raise argparse.ArgumentTypeError(f"expected numbers of steps separated by commas, got '{text}'")
    return steps


def parse_arguments(words):
    build = os.path.normpath(os.path.join(HERE, "../build"))
    p = Parser(
        "curve.py", allow_abbrev=False, description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    verbs = p.add_subparsers(dest="verb", required=True, metavar="frame|training", parser_class=Parser)
    frame = verbs.add_parser(
        "frame",
        allow_abbrev=False,
        help="time of a frame against its error",
        epilog="Options of pags-bench curve follow --, at the end: views, repetitions, modes, limits.",
    )
    frame.add_argument(
        "scenes",
        metavar="[NAME=]SCENE",
        nargs="+",
        help="scene folders or splat files, with their names in the picture",
    )
    frame.add_argument("--bench", default=f"{build}/pags-bench", metavar="PROGRAM", help="[default build/pags-bench]")
    training = verbs.add_parser(
        "training",
        allow_abbrev=False,
        help="time of training against held-out error",
        epilog="Ctrl-C saves; the same command resumes. Options of ablation.py follow --, such as -- --downscale 2, then those "
        "of pags train behind another --.",
    )
    training.add_argument("dataset", metavar="DATASET", help="as for pags train")
    training.add_argument(
        "--steps",
        type=steps_list,
        default=[1000, 3000, 6000],
        metavar="N,...",
        help="train once for each number of steps [default 1000,3000,6000]",
    )
    training.add_argument(
        "--rows",
        default="default,plain,paper",
        metavar="NAME,...",
        help="presets, or other rows of ablation.py [default %(default)s]",
    )
    training.add_argument("--pags", default=f"{build}/pags", metavar="PROGRAM", help="[default build/pags]")
    for verb in (frame, training):
        verb.add_argument(
            "-o", "--output", metavar="CURVE", required=True, help="write CURVE.md, CURVE.json and CURVE.svg"
        )
        verb.add_argument("-j", "--threads", type=whole(0, 256), default=0, metavar="N", help="threads [default: all]")
    at = words.index("--") if "--" in words else len(words)
    return p.parse_args(words[:at]), words[at + 1 :]


def main():
    given, rest = parse_arguments(sys.argv[1:])
    program = given.bench if given.verb == "frame" else given.pags
    try:
        if not shutil.which(program):
            raise Failure(f"{program}: is no program; expected a build ('make')")
        {"frame": frame_curve, "training": training_curve}[given.verb](given, rest)
    except (Failure, OSError) as error:
        sys.exit(f"curve.py: {error}")


if __name__ == "__main__":
    main()
