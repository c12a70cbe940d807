# SPDX-License-Identifier: Apache-2.0
"""report.py PAGS FOLDER: opens the pages of pags report, of one scene and of two, in a headless Chromium without
network and scripts: on a desktop, in dark mode, on a phone and in print. Uses the scene that view.py made in FOLDER.
Exits with 1 on errors, with 77 if a program is missing."""

import json
import os
import shutil
import subprocess
import sys

HERE = os.path.dirname(os.path.abspath(__file__))
sys.path.insert(0, os.path.join(HERE, "..", "cli"))

import fixtures
from browser import begin
from view import trained

TEXT = 4.5  # least contrast of text (WCAG 2.1, level AA)
CURVE = 3.0  # least contrast of curves and other graphics


def other(folder):
    """Trains a worse scene of the same street."""
    out = os.path.join(folder, "other")
    if not os.path.exists(os.path.join(out, "report.json")):
        done = fixtures.run(
            "train",
            os.path.join(folder, "street"),
            "-o",
            out,
            "--overwrite",
            "-n",
            100,
            "--max-gaussians",
            20000,
            "-q",
            timeout=3600,
        )
        assert done.returncode == 0, done.stderr
    return out


def look(page, out):
    """Runs report.mjs for a page; returns its output, or exits if it fails."""
    shutil.rmtree(out, ignore_errors=True)
    os.makedirs(out)
    done = subprocess.run(
        [shutil.which("node"), os.path.join(HERE, "report.mjs"), shutil.which("chromium"), page, out],
        capture_output=True,
        text=True,
        timeout=600,
    )
    if done.returncode:
        print(done.stdout[-2000:], done.stderr[-3000:])
        sys.exit(77 if done.returncode == 77 else 1)
    return json.loads(done.stdout.splitlines()[-1])


def main():
    folder, _ = begin()
    os.makedirs(folder, exist_ok=True)
    scene = trained(folder)
    pages = {"one": [scene], "two": [scene, other(folder)]}
    faults, count = [], 0
    for name, scenes in pages.items():
        page = os.path.join(folder, f"{name}.html")
        done = fixtures.run("report", *scenes, "-o", page, "--json", "-", timeout=1200)
        assert done.returncode == 0, done.stderr
        shown = json.loads(done.stdout)["scenes"][0]["pictures"]
        seen = look(page, os.path.join(folder, f"report-{name}"))
        checks = {"no error on the page": not seen["errors"], "nothing from elsewhere": not seen["foreign"]}
        for kind, show in seen["shows"].items():
            checks |= {
                f"{kind}: no wider than the window": show["overflow"] <= 0,
                f"{kind}: every picture is there": show["pictures"] == (3 if name == "one" else 5) * shown > 0
                and not show["broken"],
                f"{kind}: curves, dots and bars": show["charts"] > 10,
                f"{kind}: the text of charts has a size": show["text"] >= 10,
                f"{kind}: text stands out": show["contrast"] >= TEXT,
                f"{kind}: curves stand out": show["curves"] >= CURVE,
            }
        papers = {kind: show["paper"] for kind, show in seen["shows"].items()}
        checks["dark in the dark, white on paper"] = papers == {
            "desktop": "rgb(255, 255, 255)",
            "dark": "rgb(21, 24, 28)",
            "phone": "rgb(255, 255, 255)",
            "paper": "rgb(255, 255, 255)",
        }
        faults += [f"{name}: {what}" for what, held in checks.items() if not held]
        count += len(checks)
        if not all(checks.values()):
            print(json.dumps(seen, indent=1))
    for fault in faults:
        print(f"report: not so: {fault}")
    print(f"report: {count - len(faults)} of {count} checks")
    return 1 if faults else 0


if __name__ == "__main__":
    sys.exit(main())
