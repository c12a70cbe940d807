# SPDX-License-Identifier: Apache-2.0
"""check_photos.py PAGS: imports photographs with the real COLMAP and trains from them. `make check-photos` runs it.

The photographs of ../shared/data/found/colmap4-plush (or below PAGS_SHARED_DATA) and a video made of them are each
imported and trained. Then the photographs are imported once more with pycolmap, if it is installed with the
importer. For each run it prints the number of registered photographs, PSNR of held-out views, and times."""

import json
import os
import shutil
import subprocess
import sys
import tempfile
import time

ROOT = os.path.dirname(os.path.dirname(os.path.dirname(os.path.abspath(__file__))))
PICTURES = os.path.join(
    os.environ.get("PAGS_SHARED_DATA", os.path.join(ROOT, "..", "shared", "data")), "found", "colmap4-plush", "images"
)
PYTHON = os.path.join(ROOT, "tools", "recordings", ".venv", "bin", "python")
PAGS = os.path.abspath(sys.argv[1])
STEPS = "1500"


def run(*command, **more):
    subprocess.run([*map(str, command)], check=True, stdin=subprocess.DEVNULL, **more)


def check(name, raw, importer, folder, of, least):
    """Imports and trains; fails if fewer than `least` of the `of` photographs get cameras."""
    data, scene, report = (os.path.join(folder, f"{name}-{part}") for part in ("data", "scene", "report.json"))
    begun = time.monotonic()
    run(*importer, raw, "-o", data, "--json", report)
    imported = time.monotonic()
    with open(report, encoding="utf-8") as file:
        facts = json.load(file)
    assert facts["photographs"] == of and facts["registered"] >= least, facts
    assert facts["reprojection_error"] < 1.5, facts
    run(PAGS, "train", data, "-o", scene, "--downscale", 2, "--iterations", STEPS, "--quiet")
    found = subprocess.run([PAGS, "eval", scene, "--json", "-", "--quiet"], check=True, capture_output=True, text=True)
    psnr = json.loads(found.stdout)["test"]["psnr"]
    assert psnr > 20, psnr  # a model by pycolmap without pags gives 23 dB after 700 steps
    print(
        f"{name}: {facts['registered']} of {of} with cameras, {facts['reprojection_error']:.2f} px, {imported - begun:.0f} s; {STEPS} steps at half size "
        f"{psnr:.1f} dB, {time.monotonic() - imported:.0f} s",
        flush=True,
    )


def main():
    if not os.path.isdir(PICTURES):
        print(f"skipped: {PICTURES} isn't there")
        return 0
    with tempfile.TemporaryDirectory(prefix="pags-photos-") as folder:
        own = [PAGS, "import", "photos"]
        if shutil.which("colmap"):
            check("photographs", PICTURES, own, folder, 32, 31)
        else:
            print("left out: colmap isn't installed")
        if shutil.which("colmap") and shutil.which("ffmpeg"):
            video = os.path.join(folder, "plush.mp4")
            pattern = ["-pattern_type", "glob", "-framerate", "4", "-i", os.path.join(PICTURES, "*.jpg")]
            run(
                "ffmpeg",
                "-v",
                "error",
                *pattern,
                "-vf",
                "fps=12",
                "-c:v",
                "libx264",
                "-crf",
                "15",
                "-pix_fmt",
                "yuv420p",
                video,
            )
            check("video", video, [*own, "--pictures", "32"], folder, 32, 28)
        module = [PYTHON, "-B", "-m", "pags_recordings", "photos"]
        if subprocess.run([PYTHON, "-c", "import pycolmap"], capture_output=True).returncode:
            print("left out: pycolmap isn't installed in tools/recordings/.venv")
        else:
            os.environ.update(PATH="/nonexistent", PYTHONPATH=os.path.join(ROOT, "tools", "recordings"))
            check("photographs by pycolmap", PICTURES, module, folder, 32, 31)
    return 0


sys.exit(main())
