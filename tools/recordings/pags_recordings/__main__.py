# SPDX-License-Identifier: Apache-2.0
"""python -m pags_recordings KIND RAW -o DATASET: imports a recording for `pags import`. Exit codes as in pags: 1 failure, 2 usage, 3 interrupted."""

import argparse
import importlib
import importlib.util
import io
import json
import os
import shutil
import sys
import time

from . import interrupt, lock
from .account import counted, lines
from .errors import RecordingError
from .importing import Progress, one_of
from .writer import Recording

KINDS = {
    "argoverse2": ("Argoverse 2 Sensor Dataset: a log, or a folder of logs", ("numpy", "PIL", "pandas", "pyarrow")),
    "nuscenes": (
        "nuScenes v1.0: the folder with samples, sweeps and the tables of v1.0-mini or another version",
        ("numpy", "PIL"),
    ),
    "pandaset": ("PandaSet: a sequence, or a folder of sequences", ("numpy", "PIL")),
    "waymo2": (
        "Waymo Open Dataset, version 2: the folder with camera_image, lidar, ... of parquet files",
        ("numpy", "PIL", "pyarrow"),
    ),
    "kitti360": ("KITTI-360: the folder with data_2d_raw, data_poses, calibration, ...", ("numpy", "PIL")),
    "ncore": (
        "NVIDIA NCore, version 4: the folder with NAME.ncore4*.zarr.itar, or a folder of such folders",
        ("numpy", "PIL", "scipy", "zarr", "cbor2", "dataclasses_json", "upath", "ncore"),
    ),
    "photos": ("a folder of photographs without cameras, or a video; COLMAP finds the cameras", ("numpy", "PIL")),
}
PACKAGES = {
    "PIL": "pillow",
    "zarr": "'zarr<3'",
    "dataclasses_json": "dataclasses-json",
    "upath": "universal-pathlib",
}  # kinds whose module has another name
PROGRAM = os.environ.get("PAGS_RECORDINGS_FOR", "pags_recordings")


def frames(text):
    first, dash, last = text.partition("-")
    if not (first.isdigit() and dash and (not last or last.isdigit() and int(first) <= int(last))):
        raise argparse.ArgumentTypeError(f"expected A-B or A-, found {text!r}")
    return int(first), int(last) if last else sys.maxsize - 1


def number(text):
    if not (text.isdigit() and 3 <= int(text) <= 2000):
        raise argparse.ArgumentTypeError(f"expected 3 to 2000, found {text!r}")
    return int(text)


def parser():
    kinds = "; ".join(f"{kind}: {about}" for kind, (about, _) in KINDS.items())
    p = argparse.ArgumentParser(
        prog=PROGRAM,
        description="Imports a recording as a driving set. Run the same command again to resume an interrupted import.",
    )
    p.add_argument("kind", choices=KINDS, metavar="KIND", help=kinds)
    p.add_argument("raw", metavar="RAW", help="folder of the recording; photos: a folder or a video file")
    p.add_argument("-o", "--output", required=True, metavar="DATASET", help="folder to write")
    p.add_argument("--sequence", metavar="NAME", help="name of the recording, if RAW has several")
    p.add_argument(
        "--cameras",
        metavar="LIST",
        help="names separated by commas (default: all, except second cameras of stereo pairs)",
    )
    p.add_argument(
        "--frames", type=frames, metavar="A-B", help="time steps A to B inclusive; A-: to the end (default: all)"
    )
    p.add_argument(
        "--pictures",
        type=number,
        metavar="N",
        help="photos: use at most N, evenly spread (default: 120 for a video, all for a folder)",
    )
    p.add_argument("--overwrite", action="store_true", help="remove DATASET first, if an import wrote it")
    p.add_argument("--json", metavar="FILE|-", help="write the results as JSON to FILE (-: standard output)")
    p.add_argument("-q", "--quiet", action="store_true", help="print only errors")
    return p


def lacking(modules):
    return [name for name in modules if importlib.util.find_spec(name) is None]


def need_room(folder):
    """The first file on the path at which the folder is to be created, or None."""
    place = os.path.abspath(folder)
    while not os.path.lexists(place):
        place = os.path.dirname(place)
    if not os.path.isdir(place):
        raise RecordingError(
            f"{place}: not a folder, but {folder} requires one here; choose another folder, or remove it"
        )


def install(missing):
    """The commands that install modules. NCore's package requires torch, but its reader works without."""
    pip, plain = f"{sys.executable} -m pip install", [PACKAGES.get(name, name) for name in missing if name != "ncore"]
    return " && ".join(
        [f"{pip} {' '.join(plain)}"] * bool(plain) + [f"{pip} --no-deps nvidia-ncore"] * ("ncore" in missing)
    )


def clear(folder):
    """Removes the output of an earlier import; does nothing without its import.json."""
    names = lock.contents(folder)
    if names and "import.json" not in names:
        raise RecordingError(
            f"{folder}: not written by an import (no import.json); choose another folder, or remove it"
        )
    for path in (os.path.join(folder, name) for name in sorted(names, key=lambda name: name == "import.json")):
        shutil.rmtree(path) if os.path.isdir(path) and not os.path.islink(path) else os.remove(path)


def photographs(arguments, people):
    photos = importlib.import_module(".photos", __package__)
    return photos.read(arguments.raw, arguments.output, arguments.pictures, people, arguments.quiet)


def recording(arguments, people):
    if not os.path.isdir(arguments.raw):
        raise RecordingError(f"{arguments.raw}: not a folder")
    reader = importlib.import_module(f".{arguments.kind}", __package__)
    found = reader.sequences(arguments.raw)
    if not found:
        raise RecordingError(f"{arguments.raw}: found no recording of {KINDS[arguments.kind][0].split(':')[0]}")
    name = one_of(list(found), arguments.sequence, "recording", "--sequence")
    cameras = arguments.cameras.split(",") if arguments.cameras else None
    begun_from = {
        "importer": arguments.kind,
        "source": os.path.realpath(found[name]),
        "cameras": cameras,
        "frames": arguments.frames and list(arguments.frames),
    }
    with Recording(arguments.output, begun_from=begun_from) as out:
        if not out.done:
            progress = Progress(arguments.quiet)
            reader.read(found[name], cameras, arguments.frames, out, progress)
            progress.end()
    done = "is already complete; " if out.done else ""
    result = out.result or {"left_out": []}
    if people:
        print(
            f"{arguments.output}: {done}{counted(result)}; check it with: pags info {arguments.output} --overlay FOLDER",
            *lines(result["left_out"]),
            sep="\n",
            file=people,
        )
    return result


def run(arguments):
    missing = lacking(KINDS[arguments.kind][1])
    if missing:
        raise RecordingError(
            f"requires the Python package{'s' if len(missing) > 1 else ''} {', '.join(missing)}: {install(missing)}"
        )
    need_room(arguments.output)
    with lock.FolderLock(arguments.output, f"{PROGRAM} import {arguments.kind}" if PROGRAM == "pags" else PROGRAM):
        write(arguments)


def write(arguments):
    if arguments.overwrite:
        clear(arguments.output)
    begun = time.monotonic()
    people = None if arguments.quiet else sys.stderr if arguments.json == "-" else sys.stdout
    found = photographs(arguments, people) if arguments.kind == "photos" else recording(arguments, people)
    facts = {"kind": arguments.kind, "dataset": arguments.output, "seconds": time.monotonic() - begun}
    if arguments.json:
        text = json.dumps(facts | found, indent=2) + "\n"
        if arguments.json == "-":
            sys.stdout.write(text)
        else:
            with open(arguments.json, "w", encoding="utf-8") as file:
                file.write(text)


def main():
    interrupt.install()
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="surrogateescape")  # print names that are not UTF-8 unchanged
    p = parser()
    arguments = p.parse_args()
    alien = ("cameras", "frames", "sequence") if arguments.kind == "photos" else ("pictures",)
    for name in alien:
        if getattr(arguments, name):
            p.error(f"--{name}: not supported for {arguments.kind}")
    try:
        run(arguments)
        if sys.stdout:
            sys.stdout.flush()
    except KeyboardInterrupt:
        interrupt.ignore()  # pyarrow may raise the signal a second time
        print(f"{PROGRAM}: interrupted; the same command resumes from here", file=sys.stderr)
        return 3
    except (RecordingError, OSError, MemoryError) as error:
        print(f"{PROGRAM}: {' '.join(str(error).split())}", file=sys.stderr)
        return 1
    interrupt.ignore()
    return 0


if __name__ == "__main__":
    sys.exit(main())
