# SPDX-License-Identifier: Apache-2.0
"""view.py PAGS FOLDER [SCENE]: opens the page of pags view in a headless Chromium. Checks the first picture, orbit,
scrub, play, pick, measure, compare, hide, isolate, a recorded path that pags render draws to the same pictures, and
a phone. SCENE must have access to its photographs; without SCENE a small scene of the synthetic street is trained in
FOLDER. Exits with 1 on errors, with 77 if a program is missing."""

import json
import math
import os
import shutil
import subprocess
import sys

HERE = os.path.dirname(os.path.abspath(__file__))
sys.path.insert(0, os.path.join(HERE, "..", "cli"))

import fixtures
from browser import begin
from view_client import Server

# PSNR in dB between a picture saved from the page and one of pags render. The page's pictures are JPEG files of quality
# 92 with full colour resolution, which differ by 36 to 45 dB from their source. The camera's pose goes through a
# quaternion, which is exact to 1e-15.
SAME = 35
SLOW = 3.0  # largest time to the first picture in seconds, on a busy machine; the aim is 1 s


def trained(folder):
    data, scene = os.path.join(folder, "street"), os.path.join(folder, "scene")
    if not os.path.exists(os.path.join(scene, "report.json")):
        for arguments in [
            (
                "synth",
                "street",
                "-o",
                data,
                "--overwrite",
                "--size",
                "240x136",
                "--frames",
                16,
                "--lidar-points",
                3000,
                "--no-shifts",
                "-q",
            ),
            ("train", data, "-o", scene, "--overwrite", "-n", 500, "--max-gaussians", 60000, "-q"),
        ]:
            done = fixtures.run(*arguments, timeout=3600)
            if done.returncode:
                sys.exit(f"view: pags {arguments[0]}: {done.stderr}")
    return scene


def rgb(path):
    width, height, channels, bits, data = fixtures.read_png(path)
    assert bits == 8 and channels >= 3, path
    return (width, height), bytes(v for i, v in enumerate(data) if i % channels < 3)


def psnr(a, b):
    return 10 * math.log10(255**2 * len(a) / max(sum((p - q) ** 2 for p, q in zip(a, b)), 1e-9))


def main():
    folder, chromium = begin()
    out = os.path.join(folder, "seen")
    shutil.rmtree(out, ignore_errors=True)
    os.makedirs(out)
    scene = os.path.abspath(sys.argv[3]) if len(sys.argv) > 3 else trained(folder)
    server = Server(scene)
    try:
        done = subprocess.run(
            [shutil.which("node"), os.path.join(HERE, "view.mjs"), chromium, server.url, out],
            capture_output=True,
            text=True,
            timeout=1200,
        )
    finally:
        code, errors = server.close()
    if done.returncode:
        print(done.stdout[-2000:], done.stderr[-3000:])
        return 77 if done.returncode == 77 else 1
    seen = json.loads(done.stdout.splitlines()[-1])
    path = os.path.join(out, "path.json")
    os.rename(os.path.join(out, "recorded-path.txt"), path)
    frames = json.loads(fixtures.read(path))["frames"]
    drawn = fixtures.run("render", scene, "--path", path, "-o", os.path.join(out, "rendered"), "-q", timeout=1200)
    ends = {}
    for name, index in [("first", 0), ("last", len(frames) - 1)] if drawn.returncode == 0 else []:
        (size, saved), (other, rendered) = (
            rgb(os.path.join(out, file)) for file in (f"{name}.png", os.path.join("rendered", f"{index:05}.png"))
        )
        ends[name] = psnr(saved, rendered) if size == other else 0
    latencies = sorted(seen["latencies"])
    channels = {
        seen[name] for name in ("color", "depth", "priority", "critical", "object", "size", "photograph", "difference")
    }
    scrubbed, played = (float(seen[name].split()[0]) for name in ("clock", "played"))
    checks = {
        "the server ended well": (code, errors) == (0, ""),
        "no error on the page": not seen["errors"],
        "nothing from elsewhere": not seen["foreign"],
        "no token in the address": "token" not in seen["address"],
        "first picture in time": seen["first"] < 1000 * SLOW,
        "orbit moves": seen["orbited"] != seen["start"],
        "R leads back to the same picture": seen["again"] == seen["start"],
        "scrubbing moves": seen["scrubbed"] != seen["again"],
        "playing goes on": played != scrubbed,
        "pick names a place": "m deep, at" in seen["picked"],
        "measure gives metres": 0.05 < float(seen["measured"].split()[0]) < 50,
        "each channel is another picture": len(channels) == 8,
        "back in colour it is the recorded camera's": seen["color"] == seen["view"],
        "the wipe lays the photograph over the left part alone": seen["wiped"][0][0] != seen["wiped"][1][0]
        and seen["wiped"][0][1] == seen["wiped"][1][1]
        and seen["wiped"][2] == seen["wiped"][0],
        "without Early-Z nothing is hidden, and the picture is the same": seen["without"] == seen["color"]
        and "\n0 hidden" in seen["withoutStats"],
        "photograph is compared": float(seen["psnr"].split()[1]) > 12,
        "hide hides": seen["hidden"] != seen["object"],
        "solo isolates": seen["solo"] not in (seen["object"], seen["hidden"]),
        "show all shows": seen["shown"] == seen["object"],
        "the path is drawn": drawn.returncode == 0 and len(frames) == 61,
        "its first and last picture are those saved": len(ends) == 2 and min(ends.values()) >= SAME,
        "the help opens": seen["help"],
        "a finger turns": seen["touched"],
        "the phone's page is no wider than the phone": seen["overflow"] <= 0,
        "the phone's buttons can be touched": not seen["small"],
    }
    for name, held in checks.items():
        if not held:
            print(f"view: not so: {name}")
    if not all(checks.values()):
        print(json.dumps(seen, indent=1), errors, drawn.stderr, ends)
        return 1
    print(
        f"view: {len(checks)} checks; first picture after {seen['first']:.0f} ms; {latencies[int(0.95 * (len(latencies) - 1))]:.0f} ms from mouse to picture (95 %); "
        f"saved and rendered {min(ends.values()):.1f} dB; {seen['viewName']}: {seen['psnr']}"
    )
    return 0


if __name__ == "__main__":
    sys.exit(main())
