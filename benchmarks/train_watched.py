#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""train_watched.py PAGS DATASET FOLDER [--share S] [-- OPTIONS of pags train]: trains a data set three times: alone; with a page of --view that looks
at the scene from another place whenever it has a picture; and so again, stopped by the page half way and gone on from. Compares the bits of what
the runs wrote, and prints the share of the time that pictures took, pictures a second and milliseconds from a look to its picture, as JSON."""

import argparse
import json
import math
import os
import sys
import threading
import time

sys.path.insert(0, os.path.join(os.path.dirname(os.path.abspath(__file__)), "..", "tests", "cli"))

import fixtures
from view_client import Page, Run


def payload(folder):
    """Every file but the reports, which have times, and previews: name and bytes."""
    names = [name for name in fixtures.files_below(folder) if name not in ("report.json", "report.html") and not name.startswith("preview")]
    return {name: fixtures.read(os.path.join(folder, name)) for name in names}


def look_on(run, facts, stop_at):
    """Looks until the run is over; asks it to stop after so many steps."""
    start = run.description()
    camera, span = start["start"], start["time"]
    page, number, asked = Page(run), 0, False
    try:
        while True:
            number += 1
            pose = list(camera["pose"])
            pose[3] += 0.5 * math.sin(0.2 * number)
            begun = time.monotonic()
            page.look({**camera, "pose": pose, "width": 960, "height": 540, "fx": camera["fx"] * 960 / camera["width"],
                       "fy": camera["fy"] * 960 / camera["width"], "cx": 480, "cy": 270, "time": span[0] + (span[1] - span[0]) * (number % 100) / 100})
            drawn, _ = page.picture(timeout=600)
            facts.append((1000 * (time.monotonic() - begun), drawn["drawMs"]))
            if stop_at and not asked and number % 5 == 0:
                page.say(type="run", serial=number, edition=0, **{"from": 1 << 40})
                if page.answer()["step"] >= stop_at:
                    page.say(type="stop", serial=number)
                    asked = bool(page.answer())
    except (EOFError, OSError):
        page.close()


def watched(data, out, options, stop_at=0):
    """The run's --json and what the page saw."""
    report, facts = out + ".json", []
    run = Run(data, "-o", out, "--json", report, *options)
    watcher = threading.Thread(target=look_on, args=(run, facts, stop_at))
    watcher.start()
    code = run.wait()
    watcher.join()
    if code not in (0, 3):
        sys.exit(f"train_watched: {run.output[-2000:]}")
    return json.loads(fixtures.read(report)), facts


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    for name in ("pags", "dataset", "folder"):
        parser.add_argument(name)
    parser.add_argument("--share", type=float, default=0.2)
    parser.add_argument("options", nargs="*", help="of pags train, after --")
    arguments = parser.parse_args()
    fixtures.PAGS = os.path.abspath(arguments.pags)
    folders = {name: os.path.join(os.path.abspath(arguments.folder), name) for name in ("alone", "watched", "resumed")}
    options = [*arguments.options, "--preview-every", "1000"]
    view = [*options, "--view-share", str(arguments.share)]
    os.makedirs(arguments.folder, exist_ok=True)
    alone = fixtures.run("train", arguments.dataset, "-o", folders["alone"], "--overwrite", "--json", folders["alone"] + ".json", *options, timeout=None)
    if alone.returncode:
        sys.exit(f"train_watched: {alone.stderr}")
    whole = json.loads(fixtures.read(folders["alone"] + ".json"))
    report, facts = watched(arguments.dataset, folders["watched"], [*view, "--overwrite"])
    half = whole["iterations"] // 2
    first, _ = watched(arguments.dataset, folders["resumed"], [*view, "--overwrite"], stop_at=half)
    watched(arguments.dataset, folders["resumed"], [*view, "--resume"])
    bits = {name: payload(folder) for name, folder in folders.items()}
    latencies = sorted(latency for latency, _ in facts)
    print(json.dumps({
        "same": bits["alone"] == bits["watched"] == bits["resumed"], "files": len(bits["alone"]), "stopped_at": first["iterations"],
        "seconds_alone": whole["seconds"], "seconds": report["seconds"], "seconds_watched": report["seconds_watched"],
        "share": report["seconds_watched"] / (report["seconds"] + report["seconds_watched"]), "pictures": len(facts),
        "pictures_a_second": len(facts) / (report["seconds"] + report["seconds_watched"]),
        "latency_ms_95": latencies[int(0.95 * (len(latencies) - 1))], "drawn_ms_mean": sum(drawn for _, drawn in facts) / len(facts)}, indent=1))
    return 0 if bits["alone"] == bits["watched"] == bits["resumed"] else 1


if __name__ == "__main__":
    sys.exit(main())
