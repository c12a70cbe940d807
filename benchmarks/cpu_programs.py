#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""cpu_programs.py BUILD SCENE -o TABLE [options]: one view of a scene drawn by PAGS and by programs of others, on the processor alone.

BUILD is the folder of pags and pags-bench. SCENE is a scene folder, whose view --view NAME is drawn as it was then, or a .ply with --camera FILE. All
programs get the same .ply without a sky, on black, and the view's camera with square pixels and its principal point in the middle, since not all know
others. Errors are taken against the picture in double precision (pags-bench reference). Rows: PAGS by mode and threads; OpenSplat (--opensplat);
Babylon.js, Spark and PlayCanvas of tests/outside/node_modules and GaussianSplats3D of --modules, in a headless Chromium by SwiftShader and by Mesa's
llvmpipe. Omits and names programs that are missing or fail. Rows take turns for --rounds. Writes TABLE.md and TABLE.json, and what programs read
and drew to TABLE.work. Python 3.9, no packages; docs/compare.md explains how fair each row is."""

import argparse
import array
import json
import math
import os
import platform
import re
import shutil
import statistics
import subprocess
import sys
import time

HERE = os.path.dirname(os.path.abspath(__file__))
OUTSIDE = os.path.join(HERE, "..", "tests", "outside")
sys.path[:0] = [os.path.join(HERE, "..", "tests", "cli"), OUTSIDE]

import fixtures  # noqa: E402 (the path has to be set first)
from browser import camera_from_world  # noqa: E402

LENS = ("width", "height", "fx", "fy", "cx", "cy")
POSE = ("camera_from_world_quaternion_wxyz", "camera_from_world_translation")
MOVED = 2.0  # metres, or the file's units: how far a camera comes from in the column "camera moved"
NEAR = 0.01


class Missing(Exception):
    """A row whose program isn't there, or doesn't run here."""


def run(*command, environment=None, stdin=None, timeout=3600):
    """Standard output of a program that must succeed."""
    done = subprocess.run(
        [str(c) for c in command],
        capture_output=True,
        text=True,
        timeout=timeout,
        input=stdin,
        env={**os.environ, **(environment or {})},
    )
    if done.returncode:
        told = (done.stderr.strip() or done.stdout.strip()).splitlines()[-3:]
        raise Missing(f"{os.path.basename(str(command[0]))} ended with {done.returncode}: {' / '.join(told)[:300]}")
    return done.stdout


def write(path, value):
    with open(path, "w", encoding="utf-8") as file:
        json.dump(value, file)
    return path


# ---- Scene, camera, reference ----


def prepare(args, folder):
    """The .ply, its camera file, one that looks from elsewhere, and the camera's description."""
    pags, ply = os.path.join(args.build, "pags"), os.path.join(folder, "scene.ply")
    if os.path.isdir(args.scene):
        with open(os.path.join(args.scene, "scene.json"), encoding="utf-8") as file:
            scene = json.load(file)
        views = [v for v in scene["cameras"] if args.view in (None, v["name"])]
        if not views:
            sys.exit(
                f"cpu_programs: {args.scene}: no view is named {args.view}; there are {scene['cameras'][0]['name']} and others"
            )
        view, begin = views[len(views) // 2], scene.get("time", [0])[0]
        run(pags, "export", args.scene, ply, "--time", view.get("time", begin) - begin, "-q")
        origin = scene.get("origin", [0, 0, 0])
    else:
        if not args.camera:
            sys.exit("cpu_programs: a splat file needs --camera FILE")
        with open(args.camera, encoding="utf-8") as file:
            view, origin = json.load(file), [0, 0, 0]
        shutil.copyfile(args.scene, ply)
    width, height = (int(view[key] / args.downscale) for key in ("width", "height"))
    lens = {
        "width": width,
        "height": height,
        "fx": view["fx"] / args.downscale,
        "fy": view["fx"] / args.downscale,
        "cx": width / 2,
        "cy": height / 2,
    }
    camera = {**lens, **{key: view[key] for key in POSE}}
    rows, t = camera_from_world(camera)
    camera[POSE[1]] = [
        t[i] + sum(rows[i][k] * origin[k] for k in range(3)) for i in range(3)
    ]  # in the file's coordinates
    moved = {**camera, POSE[1]: [v + (MOVED if i == 2 else 0) for i, v in enumerate(camera[POSE[1]])]}
    paths = [
        write(os.path.join(folder, name), value) for name, value in (("camera.json", camera), ("moved.json", moved))
    ]
    return ply, paths[0], camera, moved


def read_pfm(path):
    """Width, height and the floats of a PFM of three channels, rows from above."""
    with open(path, "rb") as file:
        assert file.readline() == b"PF\n", path
        width, height = map(int, file.readline().split())
        little = float(file.readline()) < 0
        values = array.array("f", file.read())
    if little != (sys.byteorder == "little"):
        values.byteswap()
    return width, height, [v for y in reversed(range(height)) for v in values[3 * width * y : 3 * width * (y + 1)]]


def read_picture(path):
    """Width, height and values, 0 to 1, of a PFM or of a PNG of 8 or 16 bits, whose alpha is left out."""
    if path.endswith(".pfm"):
        return read_pfm(path)
    width, height, channels, bits, data = fixtures.read_png(path)
    values = data if bits == 8 else [256 * data[i] + data[i + 1] for i in range(0, len(data), 2)]
    colours = min(channels, 3)
    return (
        width,
        height,
        [values[channels * i + c] / (2**bits - 1) for i in range(width * height) for c in range(colours)],
    )


def errors(path, exact):
    """PSNR in dB, and mean and largest error in 255ths, of a picture against the exact one, both cut to 0 to 1."""
    width, height, values = read_picture(path)
    if (width, height) != exact[:2] or len(values) != len(exact[2]):
        raise Missing(f"it drew {width}x{height} in place of {exact[0]}x{exact[1]}")
    cut = lambda v: min(1.0, max(0.0, v))  # noqa: E731
    apart = [abs(cut(a) - cut(b)) for a, b in zip(values, exact[2])]
    square = sum(d * d for d in apart) / len(apart)
    return {
        "psnr": 10 * math.log10(1 / max(square, 1e-20)),
        "mean": 255 * sum(apart) / len(apart),
        "largest": 255 * max(apart),
    }


# ---- Rows: each measures once and returns ms, of every frame, and what else it knows ----


def pags_row(mode, threads):
    def measure(job):
        bench = os.path.join(job["build"], "pags-bench")
        told = run(
            bench,
            "render",
            job["ply"],
            "--path",
            job["camera_file"],
            "-n",
            1,
            "-r",
            job["frames"],
            "--modes",
            mode,
            "-j",
            threads,
            "--json",
            "-",
            "-q",
        )
        found = json.loads(told)
        picked = next(m for m in found["sizes"][0]["modes"] if m["mode"].split("=")[0] == mode)
        run(
            os.path.join(job["build"], "pags"),
            "render",
            job["ply"],
            "--camera",
            job["camera_file"],
            "-o",
            os.path.join(job["folder"], mode),
            "--bits",
            16,
            "--early-z",
            mode,
            "-q",
        )
        return {
            "ms": [picked["ms"]["frame"]["median"]],
            "picture": os.path.join(job["folder"], mode, "00000.png"),
            "version": run(os.path.join(job["build"], "pags"), "--version").split()[1],
        }

    return measure


PURPLE = (0.6130, 0.0101, 0.3984)  # OpenSplat's background
STEP = 30009  # OpenSplat begins with the next step, at which it knows all degrees of colour and draws; no density control is due
STEPS = re.compile(r"Step (\d+):")


def with_step(ply, out):
    """The .ply with the comment and normals that OpenSplat requires to resume from it, and its SH degree."""
    with open(ply, "rb") as file:
        head, names, count = [], [], 0
        while not head or head[-1] != "end_header":
            head.append(file.readline().decode("ascii").strip())
            if head[-1].startswith("element vertex"):
                count = int(head[-1].split()[-1])
            if head[-1].startswith("property float"):
                names.append(head[-1].split()[-1])
        rows = file.read(4 * len(names) * count)
    rest = [n for n in names if n.startswith("f_rest_")]
    wanted = ["x", "y", "z", "nx", "ny", "nz", "f_dc_0", "f_dc_1", "f_dc_2", *rest]
    wanted += ["opacity", *(f"scale_{i}" for i in range(3)), *(f"rot_{i}" for i in range(4))]
    if head[1] != "format binary_little_endian 1.0" or len(names) != sum(line.startswith("property") for line in head):
        raise Missing(f"{ply} isn't of floats in little-endian order")
    values, columns = array.array("f", rows), [names.index(n) if n in names else -1 for n in wanted]
    lines = ["ply", head[1], f"comment Generated by opensplat at iteration {STEP}", f"element vertex {count}"]
    lines += [*(f"property float {n}" for n in wanted), "end_header"]
    made, size = array.array("f", bytes(4 * len(wanted) * count)), len(names)
    for at, column in enumerate(columns):
        if column >= 0:
            made[at :: len(wanted)] = values[column::size]
    with open(out, "wb") as file:
        file.write(("\n".join(lines) + "\n").encode("ascii") + made.tobytes())
    return math.isqrt(len(rest) // 3 + 1) - 1


def opensplat_data(job, folder):
    """A data set in the layout of nerfstudio: three cameras, a metre left and right of the held-out one, so that the middle is its place and the scale 1."""
    shutil.rmtree(folder, ignore_errors=True)
    os.makedirs(os.path.join(folder, "images"))
    camera = job["camera"]
    rows, t = camera_from_world(camera)
    eye = [-sum(rows[i][k] * t[i] for i in range(3)) for k in range(3)]
    frames = []
    for name, aside in (("held.png", 0), ("left.png", -1), ("right.png", 1)):
        shutil.copyfile(os.path.join(job["folder"], "lossless-8", "00000.png"), os.path.join(folder, "images", name))
        place = [eye[0] + aside, eye[1], eye[2]]
        pose = [[rows[0][k], -rows[1][k], -rows[2][k], place[k]] for k in range(3)] + [
            [0, 0, 0, 1]
        ]  # OpenGL's axes: right, up, back
        frames.append({"file_path": f"images/{name}", "transform_matrix": pose})
    lens = {
        "w": camera["width"],
        "h": camera["height"],
        "fl_x": camera["fx"],
        "fl_y": camera["fy"],
        "cx": camera["cx"],
        "cy": camera["cy"],
    }
    write(
        os.path.join(folder, "transforms.json"),
        {**lens, "camera_model": "OPENCV", "ply_file_path": "points.ply", "frames": frames},
    )
    points = "".join(f"{eye[0] + i % 3} {eye[1] + i // 3} {eye[2] + i % 2} 128 128 128\n" for i in range(9))
    with open(os.path.join(folder, "points.ply"), "w", encoding="ascii") as file:
        file.write(
            "ply\nformat ascii 1.0\nelement vertex 9\n"
            + "".join(f"property float {c}\n" for c in "xyz")
            + "".join(f"property uchar {c}\n" for c in ("red", "green", "blue"))
            + "end_header\n"
            + points
        )


def opensplat_row(job):
    """Its program draws only while it trains: the held-out view every ten steps. A step after which it drew, less one after which it didn't, is a frame."""
    program = job["opensplat"] and shutil.which(job["opensplat"])
    if not program:
        raise Missing("no program (--opensplat)")
    folder, drawn = os.path.join(job["folder"], "opensplat"), min(2, job["frames"])
    opensplat_data(job, folder)
    degree = with_step(job["ply"], os.path.join(folder, "begin.ply"))
    command = [
        program,
        folder,
        "--cpu",
        "--keep-crs",
        "--resume",
        os.path.join(folder, "begin.ply"),
        "-o",
        os.path.join(folder, "end.ply"),
        "-n",
        STEP + 10 * drawn - 8,
        "--num-downscales",
        0,
        "--sh-degree",
        max(1, degree),
        "--val-image",
        "held.png",
        "--val-render",
        os.path.join(folder, "drawn"),
    ]
    began, told = {}, []
    with subprocess.Popen(
        [str(c) for c in command], stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True
    ) as process:
        for line in process.stdout:
            now = time.perf_counter()
            told.append(line.strip())
            step = STEPS.match(line)
            if step:
                began[int(step.group(1))] = now
    if process.returncode or len(began) < 3:
        raise Missing(f"opensplat ended with {process.returncode}: {' / '.join(told[-3:])[:300]}")
    lasted = {step: began[step + 1] - began[step] for step in began if step + 1 in began}
    usual = statistics.median(t for step, t in lasted.items() if step % 10)
    frames = [1000 * (t - usual) for step, t in lasted.items() if step % 10 == 0]
    picture = os.path.join(folder, "drawn", f"{STEP + 1}.png")
    version = run(program, "--version").split()[0]
    return {"ms": frames, "picture": picture, "version": version, "background": PURPLE, "step_ms": 1000 * usual}


def browser_row(viewer, driver):
    def measure(job):
        chromium, node = shutil.which("chromium"), shutil.which("node")
        if not (chromium and node and os.path.isdir(os.path.join(OUTSIDE, "node_modules", "puppeteer-core"))):
            raise Missing("needs chromium, node and tests/outside/node_modules: make setup")
        modules, package = os.path.join(OUTSIDE, "node_modules"), PACKAGES[viewer]
        if viewer == "splats3d":
            modules = job["modules"] or ""
        if not os.path.isfile(os.path.join(modules, package, "package.json")):
            raise Missing(f"no {package} ({'--modules' if viewer == 'splats3d' else 'make setup'})")
        picture = os.path.join(job["folder"], f"{viewer}-{driver}.png")
        path = write(
            os.path.join(job["folder"], f"{viewer}-{driver}.json"),
            {
                "viewer": viewer,
                "driver": driver,
                "file": job["ply"],
                "modules": job["modules"] or "",
                "frames": job["frames"],
                "camera": seen(job["camera"]),
                "moved": seen(job["moved"]),
                "picture": picture,
            },
        )
        software = {"LIBGL_ALWAYS_SOFTWARE": "1", "GALLIUM_DRIVER": "llvmpipe"} if driver == "llvmpipe" else {}
        found = json.loads(
            run(node, os.path.join(HERE, "cpu_programs.mjs"), chromium, path, environment=software).splitlines()[-1]
        )
        with open(os.path.join(modules, package, "package.json"), encoding="utf-8") as file:
            version = json.load(file)["version"]
        return {
            "ms": found["ms"],
            "moved": found["moved"],
            "picture": picture,
            "version": version,
            "on": found["driver"],
            "browser": found["browser"],
        }

    return measure


PACKAGES = {
    "babylon": "@babylonjs/core",
    "spark": "@sparkjsdev/spark",
    "playcanvas": "playcanvas",
    "splats3d": "@mkkellogg/gaussian-splats-3d",
}


def seen(camera):
    """A camera as tests/outside/viewers.mjs takes it."""
    rows, t = camera_from_world(camera)
    eye = [-sum(rows[i][k] * t[i] for i in range(3)) for k in range(3)]
    return {
        **{key: camera[key] for key in LENS},
        "eye": eye,
        "right": rows[0],
        "down": rows[1],
        "forward": rows[2],
        "near": NEAR,
    }


# ---- The table ----


def rows_of(args):
    """(program, how, threads, measure), in the table's order."""
    both = sorted({1, args.threads})
    listed = [("PAGS", mode, n, pags_row(mode, n)) for mode in ("lossless", "bounded") for n in both]
    listed.append(("OpenSplat", "a held-out view", args.threads, opensplat_row))
    for viewer, name in (
        ("babylon", "Babylon.js"),
        ("spark", "Spark"),
        ("playcanvas", "PlayCanvas"),
        ("splats3d", "GaussianSplats3D"),
    ):
        listed += [(name, driver, args.threads, browser_row(viewer, driver)) for driver in ("swiftshader", "llvmpipe")]
    return [
        row
        for row in listed
        if not args.only or any(word.lower() in f"{row[0]} {row[1]}".lower() for word in args.only.split(","))
    ]


def measure_all(args, job):
    """The rounds of every row by turns; a row that fails once is left out."""
    listed, rounds, missing = rows_of(args), {}, {}
    for number in range(args.rounds):
        for at, (program, how, threads, measure) in enumerate(listed):
            if at in missing:
                continue
            print(
                f"round {number + 1}: {program}, {how}, {threads} thread{'s' if threads > 1 else ''}",
                file=sys.stderr,
                flush=True,
            )
            try:
                rounds.setdefault(at, []).append(measure(job))
            except (Missing, OSError, ValueError, KeyError, IndexError, subprocess.TimeoutExpired) as error:
                missing[at] = str(error) or type(error).__name__
                rounds.pop(at, None)
    found = []
    for at, measured in sorted(rounds.items()):
        program, how, threads, _ = listed[at]
        last, exact = measured[-1], job["exact"]
        if "background" in last:
            exact = reference(job, "reference-purple.pfm", last["background"])
        try:
            error = errors(last["picture"], exact)
        except (Missing, OSError) as problem:
            missing[at] = str(problem)
            continue
        middle = lambda key: statistics.median(statistics.median(m[key]) for m in measured)  # noqa: E731
        found.append(
            {
                "program": program,
                "how": how,
                "threads": threads,
                **{key: last.get(key, "") for key in ("version", "on", "browser")},
                "ms": middle("ms"),
                "moved_ms": middle("moved") if "moved" in last else None,
                **error,
                "step_ms": last.get("step_ms"),
                "rounds_ms": [statistics.median(m["ms"]) for m in measured],
            }
        )
    return found, [{"program": listed[at][0], "how": listed[at][1], "why": why} for at, why in sorted(missing.items())]


def reference(job, name, background):
    path = os.path.join(job["folder"], name)
    run(
        os.path.join(job["build"], "pags-bench"),
        "reference",
        job["ply"],
        "--camera",
        job["camera_file"],
        "-o",
        path,
        "-q",
        "--background",
        ",".join(map(str, background)),
    )
    return read_pfm(path)


def processor():
    with open("/proc/cpuinfo", encoding="utf-8") as file:
        return next((line.split(":")[1].strip() for line in file if line.startswith("model name")), platform.machine())


def markdown(found, missing, job, args):
    camera = job["camera"]
    name = os.path.basename(os.path.normpath(args.scene))
    lines = [
        f"{name}: {job['count']:,} Gaussians, {camera['width']}x{camera['height']}; {processor()}, {args.threads} threads, "
        f"load {job['load']:.1f} before, {os.getloadavg()[0]:.1f} after; medians of {job['frames']} frames, {args.rounds} rounds by turns. Command: "
        f"`{' '.join(os.path.basename(word.rstrip('/')) for word in sys.argv)}`",
        "",
        "| program | version | by | threads | ms a frame | after the camera moved, ms | PSNR, dB | mean error, 1/255 | largest |",
        "|---|---|---|---|---|---|---|---|---|",
    ]
    for row in found:
        moved = "the same" if row["moved_ms"] is None else f"{row['moved_ms']:.0f}"
        ms = f"{row['ms']:.1f}" if row["ms"] < 100 else f"{row['ms']:,.0f}"
        lines.append(
            f"| {row['program']} | {row['version']} | {row['how']} | {row['threads']} | {ms} | {moved} "
            f"| {row['psnr']:.1f} | {row['mean']:.3f} | {row['largest']:.1f} |"
        )
    drivers = sorted({f"{row['how']} is {row['on']} in {row['browser']}" for row in found if row["on"]})
    left_out = "; ".join(f"{row['program']}, {row['how']}: {row['why']}" for row in missing) or "none"
    lines += ["", *([f"By: {'; '.join(drivers)}.", ""] if drivers else []), f"Left out: {left_out}."]
    return "\n".join(lines) + "\n"


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("build", metavar="BUILD")
    parser.add_argument("scene", metavar="SCENE")
    parser.add_argument("-o", "--output", metavar="TABLE", required=True)
    parser.add_argument("--view", metavar="NAME", help="of a scene folder [default: the middle one]")
    parser.add_argument("--camera", metavar="FILE", help="of a splat file")
    parser.add_argument(
        "--downscale", type=float, default=1.0, metavar="F", help="shrink the picture [times; default 1]"
    )
    parser.add_argument(
        "--frames",
        type=int,
        default=20,
        metavar="N",
        help="timed in a round, fewer where they take more than 20 s [default 20]",
    )
    parser.add_argument("--rounds", type=int, default=2, metavar="N", help="of all rows by turns [default 2]")
    parser.add_argument(
        "--threads",
        type=int,
        default=len(os.sched_getaffinity(0)),
        metavar="N",
        help="of the machine, as the table says [default: all]",
    )
    parser.add_argument("--only", metavar="WORD,...", help="rows whose name has one of these words")
    parser.add_argument("--opensplat", metavar="PROGRAM")
    parser.add_argument("--modules", metavar="FOLDER", help="node modules beside those of tests/outside")
    args = parser.parse_args()
    folder = os.path.abspath(args.output + ".work")
    os.makedirs(folder, exist_ok=True)
    job = {
        "build": os.path.abspath(args.build),
        "folder": folder,
        "frames": args.frames,
        "opensplat": args.opensplat,
        "modules": args.modules and os.path.abspath(args.modules),
        "load": os.getloadavg()[0],
    }
    try:
        job["ply"], job["camera_file"], job["camera"], job["moved"] = prepare(args, folder)
        job["exact"] = reference(job, "reference.pfm", (0, 0, 0))
        run(
            os.path.join(job["build"], "pags"),
            "render",
            job["ply"],
            "--camera",
            job["camera_file"],
            "-o",
            os.path.join(folder, "lossless-8"),
            "-q",
        )
    except Missing as error:
        sys.exit(f"cpu_programs: {error}")
    with open(job["ply"], "rb") as file:
        job["count"] = next(int(line.split()[-1]) for line in file if line.startswith(b"element vertex"))
    found, missing = measure_all(args, job)
    write(
        args.output + ".json", {"rows": found, "left_out": missing, "camera": job["camera"], "gaussians": job["count"]}
    )
    text = markdown(found, missing, job, args)
    with open(args.output + ".md", "w", encoding="utf-8") as file:
        file.write(text)
    print(text, end="")
    return 0 if found else 1


if __name__ == "__main__":
    sys.exit(main())
