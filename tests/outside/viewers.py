# SPDX-License-Identifier: Apache-2.0
"""viewers.py PAGS FOLDER [SCENE]: exports a scene that was trained with a least alpha to SPZ, SOG and KHR GLB, and
draws the files by Babylon.js and Spark.

Held-out views of two time steps are compared with pictures by pags of the same file. They are also compared with the
photographs, next to pictures by pags of the scene. Other programs cut alpha at 1/255 and show neither skies nor
motion. So each time step has its own file, everything is drawn on black without the sky, and photographs are
compared only where the scene is opaque. Without SCENE a small scene of the synthetic street is trained in FOLDER.
Writes FOLDER/viewers.json. Exits with 1 if a limit is exceeded, with 77 if a program is missing."""

import json
import math
import os
import shutil
import subprocess
import sys

HERE = os.path.dirname(os.path.abspath(__file__))
sys.path.insert(0, os.path.join(HERE, "..", "cli"))

import fixtures
from browser import camera_from_world

FORMATS = ("spz", "sog", "glb")
DRAWN = [("babylon", form) for form in FORMATS] + [("spark", "spz"), ("spark", "sog")]  # Spark doesn't read glTF
BUFFERS = ("bytes", "floats")
TIMES = 2  # number of time steps
MOST = 6  # largest number of views of each time step
NEAREST = 35  # least PSNR in dB against the picture by pags of the same file
LOST = 0.2  # largest loss of PSNR in dB against the photographs, compared with the picture by pags of the scene
# Converts the scene's axes to a file's: SPZ is turned by half a turn about x, glTF has y up.
AXES = {"sog": lambda v: v, "spz": lambda v: [v[0], -v[1], -v[2]], "glb": lambda v: [v[0], v[2], -v[1]]}


def pags(*arguments):
    done = fixtures.run(*arguments, timeout=3600)
    if done.returncode:
        sys.exit(f"viewers: pags {' '.join(str(a) for a in arguments)}: {done.stderr}")


def write(path, value):
    with open(path, "w", encoding="utf-8") as file:
        json.dump(value, file)
    return path


def trained(folder):
    """Trains a small scene of the street with the default configuration, which has a least alpha."""
    data, scene = os.path.join(folder, "street"), os.path.join(folder, "scene")
    if not os.path.exists(os.path.join(scene, "report.json")):
        pags(
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
        )
        pags("train", data, "-o", scene, "--overwrite", "-n", 1500, "--max-gaussians", 60000, "-q")
    return scene


def without_sky(scene, folder):
    """Links the scene's files into a folder with a scene.json that has no sky."""
    shutil.rmtree(folder, ignore_errors=True)
    os.makedirs(folder)
    description = json.loads(fixtures.read(os.path.join(scene, "scene.json")))
    for model in description["models"]:
        os.makedirs(os.path.dirname(os.path.join(folder, model["file"])), exist_ok=True)
        os.symlink(os.path.abspath(os.path.join(scene, model["file"])), os.path.join(folder, model["file"]))
    description.pop("sky", None)
    write(os.path.join(folder, "scene.json"), description)
    return description


def seen(view, turned, origin, near, pictures):
    """Returns a view in the form of viewers.mjs, in a file's axes."""
    rows, t = camera_from_world(view)
    eye = [-sum(rows[i][k] * t[i] for i in range(3)) - origin[k] for k in range(3)]
    right, down, forward = (turned(row) for row in rows)
    lens = {key: view[key] for key in ("width", "height", "fx", "fy", "cx", "cy")}
    return {**lens, "eye": turned(eye), "right": right, "down": down, "forward": forward, "near": near, **pictures}


def colours(path):
    """Returns red, green and blue of all pixels of a PNG, 0 to 255, without alpha."""
    _, _, channels, bits, data = fixtures.read_png(path)
    assert bits == 8, path
    if channels == 1:
        return bytes(v for v in data for _ in range(3))
    return data if channels == 3 else bytes(v for i, v in enumerate(data) if i % channels < 3)


def psnr(a, b, where=None):
    pairs = zip(a, b) if where is None else ((p, q) for p, q, w in zip(a, b, where) if w >= 254)
    total, count = 0, 0
    for p, q in pairs:
        total += (p - q) ** 2
        count += 1
    return 10 * math.log10(255**2 * count / max(total, 1e-9)) if count else math.nan


def draw(chromium, folder, jobs):
    path = write(os.path.join(folder, "jobs.json"), jobs)
    done = subprocess.run(
        [shutil.which("node"), os.path.join(HERE, "viewers.mjs"), chromium, path],
        capture_output=True,
        text=True,
        timeout=7200,
    )
    if done.returncode == 77:
        print(done.stderr.strip())
        sys.exit(77)
    if done.returncode:
        sys.exit(f"viewers: {done.stderr[-3000:]}")
    return json.loads(done.stdout.splitlines()[-1])


def main():
    fixtures.PAGS = os.path.abspath(sys.argv[1])
    folder = os.path.abspath(sys.argv[2])
    chromium = shutil.which("chromium")
    modules = [
        os.path.join(HERE, "node_modules", name)
        for name in ("@babylonjs", "@sparkjsdev", "three", "fflate", "puppeteer-core")
    ]
    if not (chromium and shutil.which("node") and all(os.path.isdir(module) for module in modules)):
        print("skipped: needs node, its modules and chromium: make setup")
        return 77
    os.makedirs(folder, exist_ok=True)
    scene = sys.argv[3] if len(sys.argv) > 3 else trained(folder)
    plain = os.path.join(folder, "without-sky")
    description = without_sky(scene, plain)
    held = [view for view in description["cameras"] if view["test"]]
    begin = description.get("time", [0])[0]
    times = sorted({view.get("time", begin) for view in held})
    times = [times[(2 * i + 1) * len(times) // (2 * TIMES)] for i in range(min(TIMES, len(times)))]
    groups = [[view for view in held if view.get("time", begin) == time][:MOST] for time in times]
    near = description["config"].get("near_plane", 0.01)

    files = {}  # (format, group) -> file
    for group, (time, views) in enumerate(zip(times, groups)):
        path = write(os.path.join(folder, f"path-{group}.json"), {"fps": 1, "frames": views})
        pags(
            "render",
            plain,
            "--path",
            path,
            "-o",
            os.path.join(folder, f"{group}-scene"),
            "--channel",
            "color,alpha",
            "-q",
        )
        for form in FORMATS:
            file = files[form, group] = os.path.join(folder, f"{group}.{form}")
            pags("export", plain, file, "--time", time - begin, *(["--splats"] if form == "glb" else []), "-q")
            pags("render", file, "--path", path, "-o", os.path.join(folder, f"{group}-{form}"), "-q")
    pags("eval", scene, "--split", "test", "--images", os.path.join(folder, "photographs"), "-q")

    jobs, rows = [], []
    for viewer, form in DRAWN:
        for group, views in enumerate(groups):
            job = {"viewer": viewer, "file": files[form, group], "pictures": []}
            for index, view in enumerate(views):
                pictures = {
                    buffer: os.path.join(folder, f"{group}-{form}", f"{index:05}-{viewer}-{buffer}.png")
                    for buffer in BUFFERS
                }
                job["pictures"].append(seen(view, AXES[form], description["origin"], near, pictures))
                rows += [(viewer, form, buffer, group, index, view["name"]) for buffer in BUFFERS]
            jobs.append(job)
    for job, found in zip(jobs, draw(chromium, folder, jobs)):
        print(
            f"{job['viewer']} {found['version']}, {os.path.basename(job['file'])}: {sum(found['splats'])} Gaussians, {found['seconds']:.0f} s"
        )
    results = [compare(folder, *row) for row in rows]
    write(os.path.join(folder, "viewers.json"), results)
    return report(results)


def compare(folder, viewer, form, buffer, group, index, name):
    theirs = colours(os.path.join(folder, f"{group}-{form}", f"{index:05}-{viewer}-{buffer}.png"))
    ours = colours(os.path.join(folder, f"{group}-{form}", f"{index:05}.png"))
    whole = colours(os.path.join(folder, f"{group}-scene", f"{index:05}.png"))
    full = colours(os.path.join(folder, f"{group}-scene", f"{index:05}_alpha.png"))
    photograph = colours(os.path.join(folder, "photographs", f"{os.path.splitext(name)[0]}_photo.png"))
    row = {"viewer": viewer, "format": form, "buffer": buffer, "view": name, "to_ours": psnr(theirs, ours)}
    pictures = {"theirs": theirs, "file": ours, "scene": whole}
    return row | {f"photograph_{key}": psnr(picture, photograph, full) for key, picture in pictures.items()}


def report(results):
    """Prints PSNR of each view in dB; returns 1 if for some format even the most similar viewer exceeds a limit."""
    broken = 0
    print(
        "viewer  format buffer view         to ours   against the photograph: theirs, ours of the file, ours of the scene"
    )
    nearest = {}
    for r in results:
        key = r["format"], r["view"]
        if r["buffer"] == "floats" and (key not in nearest or r["to_ours"] > nearest[key]["to_ours"]):
            nearest[key] = r
    for r in results:
        figures = [r[f"photograph_{key}"] for key in ("theirs", "file", "scene")]
        fault = nearest[r["format"], r["view"]] is r and not (
            r["to_ours"] >= NEAREST and figures[0] >= figures[2] - LOST
        )
        broken += fault
        print(
            f"{r['viewer']:7} {r['format']:6} {r['buffer']:6} {r['view']:12} {r['to_ours']:7.2f}   {figures[0]:6.2f} {figures[1]:6.2f} {figures[2]:6.2f}"
            + ("  below a bound" if fault else "")
        )
    return 1 if broken else 0


if __name__ == "__main__":
    sys.exit(main())
