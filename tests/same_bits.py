#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Compares the output of two builds of pags bit by bit: a reference, built from a commit before a change, and the
program built here.

A row is one use of the program (a training, a render, an export, an import). Both programs run each row on the same
input: data sets and scenes are those that the reference wrote. Payloads of files are compared: numbers of PLY rows, sky,
tracks and exposures (of scene.json only these and the cameras), pixels of PNG and EXR, accessors and names of glTF,
unpacked SPZ (of version 4 the bytes), text of USD without comments. Headers, the scene's configuration, reports,
log.jsonl and checkpoints aren't compared.

    tests/same_bits.py --reference COMMIT            builds COMMIT in a git worktree below build/
    tests/same_bits.py --reference-build PROGRAM     takes a build that is there
    --quick                                          a few small rows of the synthetic street, under a minute

Outputs of the reference are kept next to its program, by its hash. Rows with equal results aren't run again. If a data
set in ../shared/data is missing, its rows are skipped with a message. Exit code: 0 no difference, 1 a difference or a
failure, 2 wrong usage. A line for each difference names file, array, index and both values.
"""

import argparse
import fcntl
import gzip
import hashlib
import io
import json
import os
import re
import shutil
import struct
import subprocess
import sys
import time
import zipfile
import zlib
from pathlib import Path


class Program:
    """A build of pags: its path, its hash, and the form of its options."""

    def __init__(self, path):
        path = Path(path).resolve()
        for inside in ("pags", "build/pags"):
            if path.is_dir() and (path / inside).is_file():
                path = path / inside
        if not path.is_file():
            sys.exit(f"same_bits: {path}: no such program; build it first")
        self.path = path
        digest = hashlib.sha256()
        for part in [
            path,
            *sorted(path.parent.glob("pags_*.so")),
        ]:  # the image module is loaded at run time, so it belongs to the program
            digest.update(part.read_bytes())
        self.hash = digest.hexdigest()[:16]
        self.store = path.parent / "same-bits" / self.hash
        self.texts = {}

    def text(self, *arguments):
        if arguments not in self.texts:
            done = subprocess.run(
                [str(self.path), *arguments], stdin=subprocess.DEVNULL, capture_output=True, text=True
            )
            self.texts[arguments] = done.stdout if done.returncode == 0 else ""
        return self.texts[arguments]

    def spell(self, verb, flag, value):
        """Returns the arguments for `flag value` in this program's form; the value True means a switch. An option that
        train no longer has becomes --set of its field."""
        if flag == "--preset" and value in ("plain", "default") and "|plain" not in self.text("train", "--help"):
            if value == "plain":  # defaults of this program
                return []
            raise Failure(f"{self.path}: 'pags train' has no preset {value}; give a later reference")
        if re.search(rf"(?<![\w-]){re.escape(flag)}(?![\w-])", self.text(verb, "--help")):
            return [flag] if value is True else [flag, str(value)]
        if flag == "--size":
            width, height = value.split("x")
            return ["--width", width, "--height", height]
        if verb == "train":
            plain = flag[2:].replace("-", "_")
            known = re.findall(r"^  ([a-z][a-z0-9_]*) ", self.text("train", "--fields"), re.M)
            if plain in known:
                return ["--set", f"{plain}={1 if value is True else value}"]
        raise Failure(f"{self.path}: 'pags {verb}' knows no {flag}, nor a field for it")


class Failure(Exception):
    pass


# ---- Rows ----
class Command:
    """A verb, its input and output paths ({out}, {ref:ROW}, {data}, {kitti}), its options, and environment variables."""

    def __init__(self, verb, *positional, environment=None, **options):
        self.verb, self.positional, self.environment = verb, positional, environment or {}
        self.options = {"--" + name.replace("_", "-"): value for name, value in options.items()}

    def spelled(self, program):
        arguments = [self.verb, *self.positional]
        for flag, value in self.options.items():
            for one in value if isinstance(value, list) else [value]:
                arguments += program.spell(self.verb, flag, one)
        return arguments


class Row:
    def __init__(self, name, *commands, needs=(), quick=False, events=(), reference=None):
        self.name, self.commands, self.quick, self.events = name, commands, quick, events
        self.needs = list(needs)  # files or folders that must exist below {data}
        self.reference = reference or name  # this row is compared with the reference output of that row
        self.slug = re.sub(r"[^a-z0-9]+", "-", name.lower())

    def rows_used(self):
        words = [str(word) for c in self.commands for word in (*c.positional, *c.options.values())]
        return re.findall(r"\{ref:([^}]+)\}", " ".join(words))


# Events that must have occurred in a training, each a test of the reference's log.jsonl and scene.json: a function of (log's lines, scene).
EVENTS = {
    "densify": lambda log, scene: any(line.get("cloned", 0) + line.get("split", 0) > 0 for line in log),
    "prune": lambda log, scene: any(line.get("pruned", 0) > 0 for line in log),
    # An opacity reset has no line of its own in the log. It follows a densify, and the loss of the next view, drawn almost
    # transparent, jumps.
    "reset": lambda log, scene: any(
        after > 1.5 * max(before) for step, before, after in jumps(log) if step in densifies(log)
    ),
    "SH rise": lambda log, scene: len({line["sh_degree"] for line in log if "sh_degree" in line}) > 1,
    "resolution rise": lambda log, scene: len({line["shrink"] for line in log if "shrink" in line}) > 1,
    "object term": lambda log, scene: any(line.get("view_objects", 0) > 0 for line in log),
    "colour over time": lambda log, scene: any(thing.get("fourier") for thing in scene["modelled"]["objects"]),
    "priority prune": lambda log, scene: any(line.get("pruned_by_score", 0) > 0 for line in log),
}


def densifies(log):
    return {line["step"] for line in log if "cloned" in line}


def jumps(log):
    """Yields (step, losses of the step and the five before it, loss of the next step) for each densify."""
    views = [(line["step"], line["view_loss"]) for line in log if "view_loss" in line]
    return [
        (views[i][0], [loss for _, loss in views[max(0, i - 5) : i + 1]], views[i + 1][1])
        for i in range(len(views) - 1)
    ]


MODES = ["off", "lossless", "bounded", "paper"]
SPLATS = [
    "biker.compressed.ply",
    "biker.spz",
    "equinor_banana.ply",
    "fox_31k.ply",
    "lod1_tile_0_0.5x.ply",
    "luma-seal.splat",
]
TRAINED = dict(sh_degree=3, log_every=1, preview_every=0, checkpoint_every=0, quiet=True)
STATIC = ["densify", "prune", "reset", "SH rise", "resolution rise"]
DRIVING = STATIC + ["object term", "colour over time"]


def trainings(name, dataset, needs, events, **options):
    """Rows that train on a data set with the presets plain and default, on two threads and on one, and with the scalar kernels. The
    reference runs on two threads only, as one thread must give the same bits."""
    for preset in ("plain", "default"):
        label = f"train {name}" + (" default" if preset == "default" else "")
        expected = events + ["priority prune"] * (preset == "default")
        for threads in (2, 1):
            yield Row(
                f"{label}, {threads} thread" + "s" * (threads == 2),
                Command(
                    "train",
                    dataset,
                    output="{out}/scene",
                    iterations=300,
                    threads=threads,
                    preset=preset,
                    **TRAINED,
                    **options,
                ),
                needs=needs,
                events=expected if threads == 2 else (),
                reference=f"{label}, 2 threads",
            )
    small = dict(options, downscale=4)
    yield Row(
        f"train {name}, plain C",
        Command(
            "train",
            dataset,
            output="{out}/scene",
            iterations=100,
            threads=2,
            preset="plain",
            environment={"PAGS_CPU": "scalar"},
            **TRAINED,
            **small,
        ),
        needs=needs,
    )


def all_rows():
    street, tiny = "{ref:synth street}/street", "{ref:synth street, tiny}/street"
    scene, tiny_scene = "{ref:train street, 2 threads}/scene", "{ref:train street, tiny}/scene"
    yield Row(
        "synth street, tiny",
        Command(
            "synth",
            "street",
            output="{out}/street",
            size="160x96",
            frames=6,
            cameras=1,
            objects=3,
            lidar_points=1500,
            samples=2,
        ),
        quick=True,
    )
    yield Row(
        "train street, tiny",
        Command(
            "train", tiny, output="{out}/scene", iterations=60, threads=2, fourier_gain=0, preset="plain", **TRAINED
        ),
        quick=True,
    )
    yield Row(
        "train street, tiny, default",
        Command(
            "train", tiny, output="{out}/scene", iterations=60, threads=2, fourier_gain=0, preset="default", **TRAINED
        ),
        quick=True,
    )
    yield Row(
        "train street, tiny, plain C",
        Command(
            "train",
            tiny,
            output="{out}/scene",
            iterations=20,
            threads=2,
            fourier_gain=0,
            preset="plain",
            environment={"PAGS_CPU": "scalar"},
            **TRAINED,
        ),
        quick=True,
    )
    for mode, form in (("lossless", "png"), ("bounded", "exr")):
        yield Row(
            f"render street, tiny, {mode}",
            Command(
                "render",
                tiny_scene,
                output="{out}",
                path="ego",
                early_z=mode,
                format=form,
                channel="color,depth,id,priority",
            ),
            quick=True,
        )
    yield Row(
        "export street, tiny",
        Command("export", tiny_scene, "{out}/hull.glb", proxy="hull", no_background=True),
        Command("export", tiny_scene, "{out}/splats.ply"),
        Command("export", tiny_scene, "{out}/packed.pagsz"),
        quick=True,
    )
    yield Row(
        "synth street",
        Command(
            "synth",
            "street",
            output="{out}/street",
            size="256x144",
            frames=8,
            cameras=2,
            objects=4,
            lidar_points=3000,
            samples=2,
        ),
    )
    yield Row(
        "synth street, noise",
        Command(
            "synth",
            "street",
            output="{out}/street",
            size="128x72",
            frames=3,
            cameras=3,
            objects=4,
            lidar_points=2000,
            samples=1,
            pose_noise=0.1,
            yaw_noise=1,
            no_shifts=True,
            seed=7,
        ),
    )
    yield Row("synth town", Command("synth", "town", output="{out}/town", size="128x72", frames=3, gaussians=20000))
    # Enough views to see each part, but few enough for 300 steps, as an interval isn't shorter than a pass over the views.
    yield from trainings("street", street, [], DRIVING, fourier_gain=0)
    yield from trainings(
        "pandaset-002",
        "{data}/pandaset-002",
        ["pandaset-002"],
        DRIVING,
        cameras="0,1",
        frames="20-27",
        downscale=3,
        split_every=4,
        fourier_gain=0,
    )
    yield from trainings("fox", "{data}/fox", ["fox"], STATIC, downscale=2, split_every=2, no_exposure=True)
    for label, options in {
        "mcmc": dict(strategy="mcmc", preset="plain"),
        "dropout, LiDAR pull": dict(preset="plain", dropout=True, lidar_pull=0.2),
        "antialiased, paper's prunes": dict(antialiased=True, preset="paper", dropout=True),
        "without objects, sky, exposure": dict(preset="plain", no_objects=True, no_sky=True, no_exposure=True),
    }.items():
        yield Row(
            f"train street, {label}",
            Command("train", tiny, output="{out}/scene", iterations=100, threads=2, **TRAINED, **options),
        )

    for file in SPLATS:
        for mode in MODES:
            kind = dict(format="exr") if mode == "off" else {}
            yield Row(
                f"render {file}, {mode}",
                Command(
                    "render",
                    "{data}/splats/" + file,
                    output="{out}",
                    frames=2,
                    downscale=2,
                    channel="color,depth,id",
                    early_z=mode,
                    **kind,
                ),
                needs=["splats/" + file],
            )
    channels = "color,alpha,depth,id,object,priority,normal,heat"
    for mode in MODES:
        yield Row(
            f"render street, {mode}",
            Command("render", scene, output="{out}", split="all", channel=channels, early_z=mode, format="exr"),
        )
    for label, options in {
        "drive": dict(path="ego"),
        "drive aside": dict(path="ego", shift=1, no_exposure=True),
        "orbit, 16 bits": dict(frames=3, bits=16),
        "the paper's order": dict(split="test", order="paper"),
        "packed": dict(split="test", packed=True),
        "antialiased": dict(split="test", antialiased=True),
        "short polynomial": dict(split="test", exp_degree=3),
        "degree 1": dict(split="test", sh_degree=1),
        "without vehicles": dict(split="test", without="class:vehicle"),
    }.items():
        yield Row(f"render street, {label}", Command("render", scene, output="{out}", channel="color,depth", **options))
    yield Row(
        "render street, plain C",
        Command(
            "render",
            scene,
            output="{out}",
            split="test",
            channel=channels,
            format="exr",
            environment={"PAGS_CPU": "scalar"},
        ),
    )
    yield Row(
        "render packed file",
        Command(
            "render",
            "{ref:export street, packed}/packed.pagsz",
            output="{out}",
            channel="color,depth",
            path=street + "/truth/shift/up1/path.json",
        ),
    )
    yield Row(
        "render town", Command("render", "{ref:synth town}/town", output="{out}", split="all", channel="color,depth,id")
    )

    for proxy in ("mesh", "cage", "hull", "box"):
        yield Row(
            f"export street, {proxy}",
            Command(
                "export", scene, "{out}/proxies.glb", proxy=proxy, **{} if proxy == "mesh" else {"no_background": True}
            ),
        )
    yield Row(
        "export street, lod",
        Command("export", tiny_scene, "{out}/proxies.gltf", lod=True, cameras=True, physics=True, no_background=True),
    )
    for label, file, options in (
        ("PLY", "splats.ply", {}),
        ("SPZ 3", "splats.spz", {}),
        ("SPZ 4", "splats.spz", dict(spz_version=4)),
        ("splat", "splats.splat", dict(time=0.3)),
        ("packed", "packed.pagsz", {}),
        ("splats in glTF", "splats.glb", dict(splats=True, tracks=True)),
    ):
        yield Row(f"export street, {label}", Command("export", scene, "{out}/" + file, **options))
    yield Row("export street, USD", Command("export", tiny_scene, "{out}/scene.usda"))
    for file in ("splats.ply", "packed.pagsz"):
        yield Row(
            f"export biker.spz, {file}",
            Command("export", "{data}/splats/biker.spz", "{out}/" + file),
            needs=["splats/biker.spz"],
        )

    yield Row(
        "import waymo",
        Command("import", "waymo", "{data}/waymo/pvps_data_one_frame.tfrecord", output="{out}/set"),
        needs=["waymo/pvps_data_one_frame.tfrecord"],
    )
    yield Row(
        "import kitti",
        Command("import", "kitti", "{kitti}", output="{out}/set"),
        needs=["kitti/raw_2011_09_26", "kitti/tracking"],
    )


# ---- A tree of KITTI's tracking benchmark, made of the available samples ----
def make_kitti(data, folder):
    """Writes four frames of a raw recording, its calibration and the first labels of a sequence to the folders that the importer reads. The
    second camera gets the first camera's pictures; the vehicle drives a metre a frame (oxts is made up)."""
    if folder.exists():
        return
    part = folder.with_name(folder.name + ".part")
    shutil.rmtree(part, ignore_errors=True)
    raw = data / "kitti" / "raw_2011_09_26"
    pictures = sorted(raw.glob("image_02/**/*.png"))
    clouds = sorted(raw.glob("velodyne_points/**/*.bin"))
    for name in ("image_02/0000", "image_03/0000", "velodyne/0000", "calib", "oxts", "label_02"):
        (part / name).mkdir(parents=True)
    for i, (picture, cloud) in enumerate(zip(pictures, clouds)):
        for camera in ("image_02", "image_03"):
            shutil.copyfile(picture, part / camera / "0000" / f"{i:06d}.png")
        shutil.copyfile(cloud, part / "velodyne" / "0000" / f"{i:06d}.bin")
    calibration = (
        (raw / "calib.txt").read_text().replace("R0_rect:", "R_rect").replace("Tr_velo_to_cam:", "Tr_velo_cam")
    )
    calibration = calibration.replace("Tr_imu_to_velo:", "Tr_imu_velo")
    (part / "calib" / "0000.txt").write_text(calibration)
    rows = [f"{49.01 + i * 9e-6:.9f} 8.43 113.0 0.01 0.005 {0.5 + 0.01 * i}" + " 0" * 24 for i in range(len(pictures))]
    (part / "oxts" / "0000.txt").write_text("\n".join(rows) + "\n")
    labels = (data / "kitti" / "tracking" / "label_02" / "0000.txt").read_text().splitlines()
    (part / "label_02" / "0000.txt").write_text(
        "\n".join(line for line in labels if int(line.split()[0]) < len(pictures)) + "\n"
    )
    part.rename(folder)


# ---- Payloads: a file as named arrays ----
# An array is (name, fields, bytes): fields is a list of (name, struct code) of one row, little-endian; or None for a list of words.
PLY_CODES = {
    "char": "b",
    "uchar": "B",
    "int8": "b",
    "uint8": "B",
    "short": "h",
    "ushort": "H",
    "int16": "h",
    "uint16": "H",
    "int": "i",
    "uint": "I",
    "int32": "i",
    "uint32": "I",
    "float": "f",
    "float32": "f",
    "double": "d",
    "float64": "d",
}


def bytes_of(name, data):
    return [(name, [("byte", "B")], data)]


def words_of(name, text):
    return [(name, None, text.split())]


def read_ply(data):
    end = data.index(b"end_header\n") + len(b"end_header\n")
    elements = []
    for line in data[:end].decode("latin-1").splitlines():
        word = line.split()
        if word[:1] == ["element"]:
            elements.append((word[1], int(word[2]), []))
        elif word[:1] == ["property"]:
            elements[-1][2].append((word[-1], PLY_CODES.get(word[1])))
    arrays = [
        ("layout", None, [f"{name}.{field}:{code}" for name, count, fields in elements for field, code in fields])
    ]
    for name, count, fields in elements:
        if any(code is None for _, code in fields) or b"format ascii" in data[:end]:
            return arrays + bytes_of("rest", data[end:])
        size = struct.calcsize("<" + "".join(code for _, code in fields)) * count
        arrays.append((name, fields, data[end : end + size]))
        end += size
    return arrays


def read_npy(data):
    length = struct.unpack_from("<H", data, 8)[0] if data[6] == 1 else struct.unpack_from("<I", data, 8)[0]
    start = (10 if data[6] == 1 else 12) + length
    header = data[10:start].decode("latin-1")
    code = {"f2": "e", "f4": "f", "f8": "d", "u1": "B", "i4": "i"}.get(
        re.search(r"[<|]([a-z]\d)", header).group(1), "B"
    )
    return words_of("shape", header) + [("values", [("value", code)], data[start:])]


def read_npz(data):
    archive = zipfile.ZipFile(io.BytesIO(data))
    return [field for name in archive.namelist() for field in read_npy(archive.read(name))]


def read_png(data):
    position, idat, head = 8, b"", None
    while position < len(data):
        size, kind = struct.unpack_from(">I4s", data, position)
        body = data[position + 8 : position + 8 + size]
        head = struct.unpack(">IIBBBBB", body) if kind == b"IHDR" else head
        idat += body if kind == b"IDAT" else b""
        position += size + 12
    width, height, depth, kind = head[:4]
    channels = {0: 1, 2: 3, 3: 1, 4: 2, 6: 4}[kind]
    bpp, stride = max(1, channels * depth // 8), (width * channels * depth + 7) // 8
    raw, rows, above = zlib.decompress(idat), [], bytearray(stride)
    for y in range(height):
        mode, row = raw[y * (stride + 1)], bytearray(raw[y * (stride + 1) + 1 : (y + 1) * (stride + 1)])
        for x in range(stride) if mode else ():
            a, b, c = (row[x - bpp] if x >= bpp else 0), above[x], (above[x - bpp] if x >= bpp else 0)
            if mode == 4:
                p = a + b - c
                pa, pb, pc = abs(p - a), abs(p - b), abs(p - c)
                guess = a if pa <= pb and pa <= pc else b if pb <= pc else c
            else:
                guess = (a, b, (a + b) // 2)[mode - 1]
            row[x] = (row[x] + guess) & 255
        rows.append(bytes(row))
        above = row
    return words_of("shape", f"{width} {height} {depth} {kind}") + bytes_of(
        f"bytes of {width}x{height}x{channels}", b"".join(rows)
    )


def read_exr(data):
    """Returns the channels of a scan-line EXR, uncompressed or ZIP; for other EXR files the compressed bytes."""
    position, header = 8, {}
    while data[position]:
        name_end = data.index(0, position)
        type_end = data.index(0, name_end + 1)
        size = struct.unpack_from("<i", data, type_end + 1)[0]
        header[data[position:name_end].decode()] = data[type_end + 5 : type_end + 5 + size]
        position = type_end + 5 + size
    channels, at = [], 0
    while header["channels"][at]:
        end = header["channels"].index(0, at)
        channels.append((header["channels"][at:end].decode(), struct.unpack_from("<i", header["channels"], end + 1)[0]))
        at = end + 17
    x0, y0, x1, y1 = struct.unpack("<4i", header["dataWindow"])
    width, height, compression = x1 - x0 + 1, y1 - y0 + 1, header["compression"][0]
    line = sum((4, 2, 4)[kind] for _, kind in channels) * width
    lines = {0: 1, 1: 1, 2: 1, 3: 16}.get(compression)
    shape = words_of("shape", f"{width} {height} {channels}")
    offsets = position + 1 + 8 * -(-height // (lines or 32))
    if compression not in (0, 2, 3):
        return shape + bytes_of("compressed", data[offsets:])
    planes, at = {name: [] for name, _ in channels}, offsets
    while at < len(data):
        y, size = struct.unpack_from("<ii", data, at)
        block, expected = data[at + 8 : at + 8 + size], min(lines, y1 + 1 - y) * line
        at += 8 + size
        if compression and size < expected:
            delta = zlib.decompress(block)
            last, out = delta[0], bytearray([delta[0]])
            for byte in delta[1:]:
                last = (last + byte - 128) & 255
                out.append(last)
            block = bytearray(len(out))
            block[0::2], block[1::2] = out[: (len(out) + 1) // 2], out[(len(out) + 1) // 2 :]
        for row in range(0, len(block), line):
            start = row
            for name, kind in channels:
                planes[name].append(bytes(block[start : start + (4, 2, 4)[kind] * width]))
                start += (4, 2, 4)[kind] * width
    return shape + [
        (f"channel {name}", [("pixel", "IeF"[kind].lower() if kind else "I")], b"".join(planes[name]))
        for name, kind in channels
    ]


def flatten(value, path=""):
    """Returns a JSON value as lines `path=value` with all digits of its numbers."""
    if isinstance(value, dict):
        for key in sorted(value):
            yield from flatten(value[key], f"{path}.{key}")
    elif isinstance(value, list):
        yield f"{path}#{len(value)}"
        for i, item in enumerate(value):
            yield from flatten(item, f"{path}[{i}]")
    else:
        yield f"{path}={json.dumps(value)}".replace(" ", "_")


def read_scene(data):
    """Returns models, tracks, exposures and cameras of a scene.json, without configuration and facts about the training."""
    scene = json.loads(data)
    take = lambda thing, keys: {key: thing.get(key) for key in keys if key in thing}
    return [
        ("models", None, list(flatten(scene.get("models", [])))),
        (
            "tracks",
            None,
            list(flatten([take(o, ("id", "size", "knots", "moving", "model")) for o in scene.get("objects", [])])),
        ),
        ("cameras and exposures", None, list(flatten(scene.get("cameras", [])))),
        (
            "rest",
            None,
            list(flatten(take(scene, ("origin", "time", "fps", "background", "sky", "sensors", "exposures")))),
        ),
    ]


def read_json(data):
    return [("values", None, list(flatten(json.loads(data))))]


def gltf_arrays(document, buffer_of):
    views, arrays = document.get("bufferViews", []), []
    for i, accessor in enumerate(document.get("accessors", [])):
        if "bufferView" not in accessor:
            continue
        code = {5120: "b", 5121: "B", 5122: "h", 5123: "H", 5125: "I", 5126: "f"}[accessor["componentType"]]
        parts = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4, "MAT2": 4, "MAT3": 9, "MAT4": 16}[accessor["type"]]
        view = views[accessor["bufferView"]]
        row = struct.calcsize(code) * parts
        start, stride = view.get("byteOffset", 0) + accessor.get("byteOffset", 0), view.get("byteStride", row)
        source = buffer_of(view["buffer"])
        data = (
            source[start : start + row * accessor["count"]]
            if stride == row
            else b"".join(source[start + k * stride : start + k * stride + row] for k in range(accessor["count"]))
        )
        arrays.append((f"accessor {i}", [(str(k), code) for k in range(parts)], data))
    plain = {key: value for key, value in document.items() if key not in ("asset", "buffers", "bufferViews")}
    return [("document", None, list(flatten(plain)))] + arrays


def read_glb(data):
    length = struct.unpack_from("<I", data, 12)[0]
    binary = data[20 + length + 8 :]
    return gltf_arrays(json.loads(data[20 : 20 + length]), lambda index: binary)


def read_usda(data):
    text = re.sub(r"^\s*(#(?!usda).*|doc = .*)$", "", data.decode(), flags=re.M)
    return words_of("text", text)


def read_spz(data):
    return bytes_of("unpacked", gzip.decompress(data)) if data[:2] == b"\x1f\x8b" else bytes_of("file", data)


def read_text(data):
    return words_of("words", data.decode("utf-8", "replace"))


def read_floats(data):
    return [("values", [("value", "f")], data)] if len(data) % 4 == 0 else bytes_of("file", data)


READERS = {
    ".ply": read_ply,
    ".npy": read_npy,
    ".npz": read_npz,
    ".png": read_png,
    ".exr": read_exr,
    ".json": read_json,
    ".glb": read_glb,
    ".usda": read_usda,
    ".spz": read_spz,
    ".txt": read_text,
    ".bin": read_floats,
}
LEFT_OUT = re.compile(r"(^|/)(report\.(json|html)|log\.jsonl|import\.json|checkpoint\.pags|preview[^/]*\.png)$")


def payload(path):
    data = path.read_bytes()
    if path.suffix == ".gltf":
        document = json.loads(data)
        return gltf_arrays(document, lambda i: (path.parent / document["buffers"][i]["uri"]).read_bytes())
    if path.name == "scene.json":
        return read_scene(data)
    reader = READERS.get(path.suffix)
    if path.suffix == ".bin" and path.with_suffix(".gltf").exists():
        reader = None
    return reader(data) if reader else bytes_of("file", data)


def first_difference(a, b):
    """Returns the first index at which two byte strings differ, or the length of the shorter."""
    size = min(len(a), len(b))
    for start in range(0, size, 65536):
        if a[start : start + 65536] != b[start : start + 65536]:
            return next(i for i in range(start, min(start + 65536, size)) if a[i] != b[i])
    return size


def compare_arrays(was, now):
    names = [array[0] for array in was], [array[0] for array in now]
    if names[0] != names[1]:
        odd = [name for name in names[0] + names[1] if (name in names[0]) != (name in names[1])]
        return f"arrays differ: {', '.join(odd[:4]) or 'their order'}"
    for (name, fields, old), (_, new_fields, new) in zip(was, now):
        if fields != new_fields:
            return f"{name}: rows of {fields} became {new_fields}"
        if old == new:
            continue
        if fields is None:
            i = next((k for k, (x, y) in enumerate(zip(old, new)) if x != y), min(len(old), len(new)))
            values = [x[i] if i < len(x) else "(end)" for x in (old, new)]
            many = sum(x != y for x, y in zip(old, new)) + abs(len(old) - len(new))
            return f"{name}[{i}]: {values[0][:90]} became {values[1][:90]}; {many} of {len(old)} words differ"
        if len(old) != len(new):
            size = struct.calcsize("<" + "".join(code for _, code in fields))
            return f"{name}: {len(old) // size} rows became {len(new) // size}"
        row = struct.Struct("<" + "".join(code for _, code in fields))
        index = first_difference(old, new) // row.size
        pair = row.unpack_from(old, index * row.size), row.unpack_from(new, index * row.size)
        offset = first_difference(old, new) - index * row.size
        field = next(
            k for k in range(len(fields)) if struct.calcsize("<" + "".join(c for _, c in fields[: k + 1])) > offset
        )
        rows = sum(old[k : k + row.size] != new[k : k + row.size] for k in range(0, len(old) - row.size + 1, row.size))
        return (
            f"{name}[{index}].{fields[field][0]}: {pair[0][field]!r} became {pair[1][field]!r}; "
            f"{rows} of {len(old) // row.size} differ"
        )
    return None


def compare_files(was, now):
    if was.read_bytes() == now.read_bytes():
        return None
    try:
        return compare_arrays(payload(was), payload(now))
    except (
        ValueError,
        KeyError,
        IndexError,
        StopIteration,
        struct.error,
        zlib.error,
        OSError,
        EOFError,
        AttributeError,
    ) as error:
        return f"can't be read as {was.suffix[1:] or 'a file'} ({type(error).__name__}: {error}), and the bytes differ"


def files_of(folder):
    paths = [path.relative_to(folder) for path in sorted(folder.rglob("*")) if path.is_file()]
    return [path for path in paths if not LEFT_OUT.search(str(path))]


def compare_folders(was, now):
    """Returns lines for each file that differs between two folders."""
    old, new = files_of(was), files_of(now)
    lines = [f"{path}: only the reference writes it" for path in old if path not in new]
    lines += [f"{path}: the reference doesn't write it" for path in new if path not in old]
    for path in old:
        if path in new:
            found = compare_files(was / path, now / path)
            if found:
                lines.append(f"{path}: {found}")
    if not old:
        lines.append("the reference wrote nothing that is compared")
    return lines


# ---- Running ----
class Bench:
    def __init__(self, reference, program, data, keep):
        self.reference, self.program, self.data, self.keep = reference, program, data, keep
        self.rows = {row.name: row for row in all_rows()}

    def spec(self, row, program):
        return [[sorted(c.environment.items()), *c.spelled(program)] for c in row.commands]

    def run(self, row, program, folder):
        """Runs the row's commands with `folder`, which is emptied first, as {out}."""
        kitti = self.reference.store / "kitti-tree"
        shutil.rmtree(folder, ignore_errors=True)
        folder.mkdir(parents=True)
        for command in row.commands:
            if command.verb == "import" and command.positional[0] == "kitti":
                make_kitti(self.data, kitti)
            words = []
            for word in command.spelled(program):
                word = (
                    word.replace("{out}", str(folder)).replace("{data}", str(self.data)).replace("{kitti}", str(kitti))
                )
                words.append(
                    re.sub(r"\{ref:([^}]+)\}", lambda m: str(self.reference_folder(self.rows[m.group(1)])), word)
                )
            done = subprocess.run(
                [str(program.path), *words],
                stdin=subprocess.DEVNULL,
                stdout=subprocess.DEVNULL,
                stderr=subprocess.PIPE,
                text=True,
                env=dict(os.environ, **command.environment),
            )
            if done.returncode != 0:
                raise Failure(
                    f"exit code {done.returncode} of {program.path.name} {' '.join(words)}: {done.stderr.strip()[-400:]}"
                )

    def reference_folder(self, row):
        """Returns the folder with the reference's output of a row; runs the row first if needed. Several instances of
        this script may do so at the same time."""
        folder = self.reference.store / row.slug
        folder.parent.mkdir(parents=True, exist_ok=True)
        mark = folder.with_suffix(".done")
        spec = json.dumps(self.spec(row, self.reference))
        if mark.exists() and mark.read_text() == spec:
            return folder
        for used in row.rows_used():
            self.reference_folder(self.rows[used])
        with open(folder.with_suffix(".lock"), "w") as lock:
            fcntl.flock(lock, fcntl.LOCK_EX)
            if not (mark.exists() and mark.read_text() == spec):
                mark.unlink(missing_ok=True)
                self.run(row, self.reference, folder)
                for checkpoint in folder.rglob("checkpoint.pags"):
                    checkpoint.unlink()
                mark.write_text(spec)
        return folder

    def check_events(self, row, folder):
        if not row.events:
            return
        log = [json.loads(line) for line in (folder / "scene" / "log.jsonl").read_text().splitlines()]
        scene = json.loads((folder / "scene" / "scene.json").read_text())
        missing = [name for name in row.events if not EVENTS[name](log, scene)]
        if missing:
            raise Failure(
                f"the reference's training shows no {', no '.join(missing)}: its schedule has to be changed, or EVENTS read its log"
            )

    def row(self, row):
        """Runs a row and compares: returns 'same' or the lines of its differences."""
        reference_row = self.rows[row.reference]
        was = self.reference_folder(reference_row)
        self.check_events(reference_row, was)
        mine = self.program.store / f"against-{self.reference.hash}" / row.slug
        spec = json.dumps([self.spec(row, self.program), self.spec(reference_row, self.reference)])
        result = mine.with_suffix(".result")
        if result.exists() and result.read_text() == spec:
            return [], True
        self.run(row, self.program, mine)
        lines = compare_folders(was, mine)
        if not lines:
            result.write_text(spec)
            if not self.keep:
                shutil.rmtree(mine)
        return lines, False


def prove(bench):
    """Tests the comparison itself: flips a byte of one file of each kind, late in the file where its payload is, and expects a
    difference."""
    seen, failed = set(), 0
    scratch = bench.reference.store / "prove"
    for mark in sorted(bench.reference.store.glob("*.done")):
        folder = mark.with_suffix("")
        for path in files_of(folder):
            kind = "scene.json" if path.name == "scene.json" else path.suffix
            if kind in seen:
                continue
            seen.add(kind)
            shutil.rmtree(scratch, ignore_errors=True)
            shutil.copytree(folder, scratch)
            data = bytearray((scratch / path).read_bytes())
            at = len(data) * 3 // 4
            text = kind in (".json", "scene.json", ".txt", ".usda", ".gltf")
            while text and not chr(data[at]).isdigit():
                at += 1
            data[at] = ord("1") + (data[at] == ord("1")) if text else data[at] ^ 1
            (scratch / path).write_bytes(data)
            lines = compare_folders(folder, scratch)
            failed += not lines
            print(
                f"{'found   ' if lines else 'MISSED  '} {kind:11} byte {at} of {folder.name}/{path}"
                + (f": {lines[0].split(': ', 1)[1]}" if lines else "")
            )
    shutil.rmtree(scratch, ignore_errors=True)
    print(f"{len(seen)} kinds of files, {failed} flipped bytes missed")
    return failed == 0 and bool(seen)


def build_reference(commit):
    """Builds the program of a commit in a git worktree below build/; returns its path."""
    git = lambda *words: subprocess.run(["git", *words], capture_output=True, text=True)
    found = git("rev-parse", "--verify", "--quiet", commit + "^{commit}")
    if found.returncode != 0:
        sys.exit(f"same_bits: {commit}: no such commit here")
    commit = found.stdout.strip()
    tree = Path("build/same-bits").resolve() / commit[:12]
    program = tree / "build" / "pags"
    if program.exists():
        return program
    tree.parent.mkdir(parents=True, exist_ok=True)
    if not (tree / "CMakeLists.txt").exists():
        git("worktree", "prune")
        added = git("worktree", "add", "--detach", str(tree), commit)
        if added.returncode != 0:
            sys.exit(f"same_bits: git worktree: {added.stderr.strip()}")
    print(f"building {commit[:12]} in {tree}", flush=True)
    for words in (
        ["cmake", "--preset", "release", "-DPAGS_TESTS=OFF"],
        ["cmake", "--build", "--preset", "release", "--parallel", str(os.cpu_count())],
    ):
        done = subprocess.run(words, cwd=tree, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)
        if done.returncode != 0:
            sys.exit(f"same_bits: {' '.join(words)} in {tree}:\n{done.stdout[-3000:]}")
    return program


def main():
    parser = argparse.ArgumentParser(description="Compares what two builds of pags write, bit by bit.")
    parser.add_argument(
        "--reference", metavar="COMMIT", help="build this commit below build/same-bits and compare with it"
    )
    parser.add_argument(
        "--reference-build", metavar="PATH", help="compare with this program, or the one in this build folder"
    )
    parser.add_argument(
        "--program", metavar="PATH", default="build/pags", help="the program that is tried [default build/pags]"
    )
    parser.add_argument(
        "--data", metavar="FOLDER", default="../shared/data", help="real recordings [default ../shared/data]"
    )
    parser.add_argument("--quick", action="store_true", help="a few small rows of the synthetic street")
    parser.add_argument("--only", metavar="REGEX", help="rows whose name matches")
    parser.add_argument("--list", action="store_true", help="print the rows' names, run nothing")
    parser.add_argument("--keep", action="store_true", help="keep what the program wrote also where it is the same")
    parser.add_argument(
        "--prove",
        action="store_true",
        help="flip a byte of each kind of file that the reference wrote: each must be found",
    )
    options = parser.parse_args()
    rows = [row for row in all_rows() if (row.quick or not options.quick) and re.search(options.only or "", row.name)]
    if options.list:
        for row in rows:
            print(row.name + (" (quick)" if row.quick else ""))
        return 0
    if not rows:
        parser.error("--only matches no row")
    if not options.reference and not options.reference_build:
        parser.error("--reference COMMIT or --reference-build PATH is needed")
    reference = Program(options.reference_build or build_reference(options.reference))
    bench = Bench(reference, Program(options.program), Path(options.data).resolve(), options.keep)
    if options.prove:
        return 0 if prove(bench) else 1
    counts = {"same": 0, "DIFFERS": 0, "FAILED": 0, "skipped": 0}
    for row in rows:
        needs = row.needs + [need for used in row.rows_used() for need in bench.rows[used].needs]
        missing = [need for need in needs if not (bench.data / need).exists()]
        begin, lines, earlier = time.monotonic(), [], False
        if missing:
            word, lines = "skipped", [f"{bench.data / missing[0]} isn't there"]
        else:
            try:
                lines, earlier = bench.row(row)
                word = "DIFFERS" if lines else "same"
            except Failure as failure:
                word, lines = "FAILED", [str(failure)]
        counts[word] += 1
        print(f"{word:8} {row.name}" + ("  (known)" if earlier else f"  {time.monotonic() - begin:.1f} s"), flush=True)
        for line in lines[:8]:
            print(f"         {line}", flush=True)
        if len(lines) > 8:
            print(f"         and {len(lines) - 8} more files", flush=True)
    print(
        ", ".join(f"{count} {word}" for word, count in counts.items())
        + f"; reference {reference.hash}, program {bench.program.hash}"
    )
    return 1 if counts["DIFFERS"] + counts["FAILED"] or not counts["same"] else 0


if __name__ == "__main__":
    sys.exit(main())
