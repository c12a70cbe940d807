# SPDX-License-Identifier: Apache-2.0
"""Extracts pictures from a video with ffmpeg: spread over time and over changes of the picture, choosing the sharpest nearby frame."""

import json
import os
import shutil
import subprocess
import tempfile

import numpy as np

from . import interrupt
from .errors import RecordingError

ENDINGS = (".mp4", ".mov", ".m4v", ".mkv", ".avi", ".webm", ".mts", ".3gp")
WIDTH, HEIGHT = 320, 180  # width at which sharpness is measured


def need():
    for program in ("ffmpeg", "ffprobe"):
        if not shutil.which(program):
            raise RecordingError(f"videos require {program}, which isn't installed: apt-get install ffmpeg")


def length(path):
    """Number of frames from the file, or estimated from its duration."""
    asked = [
        "ffprobe",
        "-v",
        "error",
        "-select_streams",
        "v:0",
        "-show_entries",
        "stream=nb_frames,avg_frame_rate,duration:format=duration",
        "-of",
        "json",
        place(path),
    ]
    done = subprocess.run(asked, capture_output=True, text=True, stdin=subprocess.DEVNULL)
    try:
        facts = json.loads(done.stdout)
        stream = facts["streams"][0]
        if stream.get("nb_frames", "").isdigit():
            return int(stream["nb_frames"])
        over, _, under = stream["avg_frame_rate"].partition("/")
        return max(
            1, round(float(stream.get("duration") or facts["format"]["duration"]) * float(over) / float(under or 1))
        )
    except (ValueError, LookupError, ZeroDivisionError):
        raise RecordingError(
            f"{path}: not a video that ffmpeg can read: {' '.join(done.stderr.split())[:300] or 'it has no pictures'}"
        ) from None


def place(path):
    """A path that ffmpeg interprets only as a file."""
    return "file:" + os.path.abspath(path)


def judged(path, show, before=()):
    """For each frame, after the filters `before`: sharpness (mean square of second differences) and difference from the previous frame (0 to 255). Then
    ffmpeg's messages on damage, or ""."""
    command = [
        "ffmpeg",
        "-v",
        "error",
        "-nostdin",
        "-i",
        place(path),
        "-map",
        "0:v:0",
        "-vf",
        ",".join([*before, f"scale={WIDTH}:{HEIGHT}:flags=area", "format=gray"]),
        "-fps_mode",
        "passthrough",
        "-f",
        "rawvideo",
        "-",
    ]
    sharp, change, before = [], [], None
    with (
        tempfile.TemporaryFile() as said,
        subprocess.Popen(command, stdout=subprocess.PIPE, stderr=said, preexec_fn=interrupt.BEFORE_START) as process,
    ):  # stderr goes to a file: a pipe would fill up
        try:
            while len(data := process.stdout.read(WIDTH * HEIGHT)) == WIDTH * HEIGHT:
                frame = np.frombuffer(data, np.uint8).reshape(HEIGHT, WIDTH).astype(np.float32)
                second = 4 * frame[1:-1, 1:-1] - frame[:-2, 1:-1] - frame[2:, 1:-1] - frame[1:-1, :-2] - frame[1:-1, 2:]
                small = frame.reshape(HEIGHT // 10, 10, WIDTH // 10, 10).mean((1, 3))
                sharp.append(float(np.mean(second**2)))
                change.append(0.0 if before is None else float(np.abs(small - before).mean()))
                before = small
                show(len(sharp))
        finally:
            process.kill()
            process.wait()
        said.seek(0)
        words = " ".join(said.read(4000).decode(errors="replace").split())[:300]
    if not sharp:
        raise RecordingError(f"{path}: ffmpeg can read no picture: {words or 'no message'}")
    return np.array(sharp), np.array(change), words


def choose(sharp, change, wanted):
    """Numbers of at most `wanted` frames, ascending: the sharpest in each of equal parts of the path (less a tenth at their ends). The path is half time and
    half change, so that neither a stationary camera nor a fast turn gets most of the frames."""
    n = len(sharp)
    if n <= wanted:
        return list(range(n))
    way = np.linspace(0, 1, n)
    if change.sum() > 0:
        way = (way + np.cumsum(change) / change.sum()) / 2
    chosen = []
    for part in range(wanted):
        first, last = np.searchsorted(way, [(part + 0.1) / wanted, (part + 0.9) / wanted])
        first = max(int(first), chosen[-1] + 1 if chosen else 0)
        if first < n:
            chosen.append(first + int(np.argmax(sharp[first : max(int(last), first + 1)])))
    return chosen


def extract(path, frames, folder, shown=None):
    """Writes frames as JPEG files frame_000123.jpg, named by number and converted by `shown` (a Display). Returns the names."""
    names = [f"frame_{number:06d}.jpg" for number in frames]
    if all(os.path.exists(os.path.join(folder, name)) for name in names):
        return names
    part = os.path.join(folder, "part")
    shutil.rmtree(part, ignore_errors=True)
    os.makedirs(part)
    if shown and shown.table:
        with open(os.path.join(part, "colours.cube"), "w", encoding="ascii") as file:
            shown.write_table(file)
    chosen = "select='" + "+".join(f"eq(n,{number})" for number in frames) + "'"
    filters = [*shown.before, chosen, *shown.after] if shown else [chosen]
    command = [
        "ffmpeg",
        "-v",
        "error",
        "-nostdin",
        "-i",
        place(path),
        "-map",
        "0:v:0",
        "-vf",
        ",".join(filters),
        "-fps_mode",
        "passthrough",
        "-q:v",
        "2",
        "%06d.jpg",
    ]
    done = subprocess.run(command, capture_output=True, text=True, cwd=part)
    written = sorted(name for name in os.listdir(part) if name.endswith(".jpg"))
    if done.returncode or len(written) != len(names):
        raise RecordingError(
            f"{path}: ffmpeg wrote {len(written)} of {len(names)} pictures: {' '.join(done.stderr.split())[:300] or 'no message'}"
        )
    for name, now in zip(written, names):
        os.replace(os.path.join(part, name), os.path.join(folder, now))
    shutil.rmtree(part)
    return names
