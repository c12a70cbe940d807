# SPDX-License-Identifier: Apache-2.0
"""train_view.py PAGS FOLDER: opens the page of pags train --view in a headless Chromium. Checks growing curves,
pictures of the training scene, the worst view next to its photograph, a checkpoint, stopping, and the page's last
message. Exits with 1 on errors, with 77 if a program is missing."""

import json
import os
import shutil
import subprocess
import sys

HERE = os.path.dirname(os.path.abspath(__file__))
sys.path.insert(0, os.path.join(HERE, "..", "cli"))

import fixtures
from browser import begin
from view_client import Run


def main():
    folder, chromium = begin()
    data, scene, out = (os.path.join(folder, name) for name in ("street", "run", "seen"))
    os.makedirs(out, exist_ok=True)
    if not os.path.exists(data):
        done = fixtures.run(
            "synth",
            "street",
            "-o",
            data,
            "--size",
            "240x136",
            "--frames",
            16,
            "--lidar-points",
            3000,
            "--no-shifts",
            "-q",
            timeout=600,
        )
        if done.returncode:
            sys.exit(f"train_view: pags synth: {done.stderr}")
    run = Run(
        data,
        "-o",
        scene,
        "--overwrite",
        "-n",
        100000,
        "--max-gaussians",
        60000,
        "--preview-every",
        100,
        "--checkpoint-every",
        0,
    )
    try:
        done = subprocess.run(
            [shutil.which("node"), os.path.join(HERE, "train_view.mjs"), chromium, run.url, out],
            capture_output=True,
            text=True,
            timeout=900,
        )
        code = run.wait() if done.returncode == 0 else None
    finally:
        if run.process.poll() is None:
            run.process.kill()
    if done.returncode:
        print(done.stdout[-2000:], done.stderr[-3000:])
        return 77 if done.returncode == 77 else 1
    seen = json.loads(done.stdout.splitlines()[-1])
    saved = int(seen["said"].split()[3])
    checks = {
        "the run was stopped as by Ctrl-C": code == 3 and "--resume" in run.output,
        "no error on the page": not seen["errors"],
        "nothing from elsewhere": not seen["foreign"],
        "a still picture learns": seen["changed"],
        "five curves": len(seen["curves"]) == 5 and min(seen["curves"]) > 50,
        # A full curve drops every other point, so that on a fast machine it may have fewer points later.
        "that go on": all(a != b for a, b in zip(seen["curves"], seen["grown"])),
        "figures": "held-out PSNR" in seen["facts"] and "left" in seen["head"],
        "it moves while it trains": seen["moving"] > 5,
        "the worst views are named": len(seen["worst"]) == 6 and all(line.endswith(" dB") for line in seen["worst"]),
        "and compared": float(seen["psnr"].split()[1]) > 5,
        "the checkpoint's step": saved > 0,
        "stop asks first": "again" in seen["asked"] and seen["running"],
        "the farewell stays": "was stopped" in seen["end"] and seen["end"] == seen["notice"],
        "the phone's page is no wider than the phone": seen["overflow"] <= 0,
    }
    for name, held in checks.items():
        if not held:
            print(f"train_view: not so: {name}")
    if not all(checks.values()):
        print(json.dumps(seen, indent=1), run.output[-2000:])
        return 1
    share = next(line for line in seen["facts"].splitlines() if "pages took" in line)
    print(f"train_view: {len(checks)} checks; {seen['moving']} pictures in 2 s of dragging; {share}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
