# SPDX-License-Identifier: Apache-2.0
"""check_damage.py PAGS: damages files of each kind in the raw recordings of blind_trees.py: removes, cuts or empties
them, or fills them with other bytes. The import must fail with one line and exit code 1, or, where that file may be
missing, write a data set. It must never write outside of its folder."""

import contextlib
import io
import os
import shutil
import sys
import tempfile

HERE = os.path.dirname(os.path.abspath(__file__))
sys.path[:0] = [
    os.path.dirname(HERE),
    os.path.join(os.path.dirname(HERE), "cli"),
    os.path.join(os.path.dirname(os.path.dirname(HERE)), "tools", "recordings"),
]

import blind_tables  # noqa: E402
import blind_trees  # noqa: E402
import fixtures  # noqa: E402
from blind_trees import Street  # noqa: E402
from fixtures import files_below, read, write  # noqa: E402
from pags_recordings import __main__ as importer  # noqa: E402

DAMAGE = {
    "taken away": lambda path, content: os.remove(path),
    "cut": lambda path, content: write(path, content[: len(content) // 2]),
    "cut at its end": lambda path, content: write(path, content[:-1]),
    "empty": lambda path, content: write(path, b""),
    "other bytes": lambda path, content: write(path, bytes((37 * i) % 256 for i in range(len(content)))),
    "zeros": lambda path, content: write(path, bytes(len(content))),
}


def run(kind, truth, out):
    """Runs the importer's main function in this process; returns its exit code and standard error."""
    words, was = io.StringIO(), sys.argv
    sys.argv = ["pags import", kind, truth.raw, "-o", out, *truth.options, "--quiet"]
    try:
        with contextlib.redirect_stderr(words):
            return importer.main(), words.getvalue()
    finally:
        sys.argv = was


OTHERS = (
    "00a6ffc1-",
    "002" + os.sep,
    "1005081002024129653_",
    "drive_0000_",
    "stereo_",
    "image_02",
    "RADAR",
)  # sequences and sensors that the check doesn't import


def sorts(raw):
    """Returns one file, the middle one, for each folder and file ending that is imported; and every table."""
    found = {}
    for name in files_below(raw):
        if any(name.startswith(other) or other in name for other in OTHERS):
            continue
        folder, file = os.path.split(name)
        numbered = any(c.isdigit() for c in file)
        found.setdefault((folder, file.split(".")[-1] if numbered else file), []).append(name)
    return [names[len(names) // 2] for names in found.values()]


def check(kind, truth, folder):
    counts, wrong = {0: 0, 1: 0}, []
    before = set(files_below(folder))
    for name in sorts(truth.raw):
        path = os.path.join(truth.raw, name)
        content = read(path)
        for what, damage in DAMAGE.items():
            damage(path, content)
            out = os.path.join(folder, "out")
            try:
                code, words = run(kind, truth, out)
                counts[code] += 1
                if code == 0 and "--list" in sys.argv:
                    print(f"{kind}: {name} {what}: read on")
                right = (
                    words.count("\n") == 1 and words.startswith(importer.PROGRAM)
                    if code
                    else words == "" and os.path.exists(os.path.join(out, "dataset.json"))
                )
                if not right or (code and os.path.exists(os.path.join(out, "dataset.json"))):
                    wrong.append(f"{kind}: {name} {what}: code {code}, {words!r}")
            except Exception as error:  # noqa: BLE001  what no line names is what is looked for
                wrong.append(f"{kind}: {name} {what}: {type(error).__name__}: {error}")
            shutil.rmtree(out, ignore_errors=True)
            write(path, content)
    if set(files_below(folder)) != before:
        wrong.append(f"{kind}: wrote outside of its folder: {sorted(set(files_below(folder)) - before)[:5]}")
    print(f"{kind}: {counts[1]} refused, {counts[0]} read without what was damaged", *wrong[:40], sep="\n  ")
    return not wrong


def main():
    fixtures.PAGS = os.path.abspath(sys.argv[1])
    holder, right = tempfile.mkdtemp(prefix="pags-damage-"), True
    try:
        street = os.path.join(holder, "street")
        done = fixtures.run(
            "synth",
            "street",
            "-o",
            street,
            "--size",
            "160x90",
            "--frames",
            "4",
            "--lidar-points",
            "600",
            "--samples",
            "1",
            "--no-shifts",
        )
        assert done.returncode == 0, done.stderr
        for write_tree in (
            blind_trees.nuscenes,
            blind_trees.argoverse2,
            blind_tables.pandaset,
            blind_tables.waymo2,
            blind_tables.kitti360,
        ):
            folder = os.path.join(holder, write_tree.__name__)
            right &= check(write_tree.__name__, write_tree(Street(street), os.path.join(folder, "raw")), folder)
    finally:
        shutil.rmtree(holder)
    sys.exit(0 if right else "check_damage: an import did something else than end with one line or read on")


if __name__ == "__main__":
    main()
