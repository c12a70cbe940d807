# SPDX-License-Identifier: Apache-2.0
"""Runs COLMAP step by step, as the program or the Python package pycolmap, and reads its database and models. CPU only."""

import importlib.util
import json
import os
import re
import shutil
import sqlite3
import struct
import subprocess
import sys
import urllib.parse

import numpy as np

from . import interrupt
from .errors import RecordingError

INSTALL = (
    "apt-get install colmap" if os.path.exists("/etc/debian_version") else f"{sys.executable} -m pip install pycolmap"
)
SIDE, FEATURES = (
    1600,
    4096,
)  # largest image side and maximum number of features: the time of matching grows with its square
INLIERS = 15  # inliers of one camera motion; COLMAP discards pairs with fewer


def find():
    """The installed step runner."""
    program = shutil.which("colmap")
    if program:
        return Program(program)
    if importlib.util.find_spec("pycolmap"):
        return Module()
    raise RecordingError(f"COLMAP, which finds the cameras, isn't installed: {INSTALL}")


class Program:
    """The colmap program: Debian's 3.8, or version 4."""

    def __init__(self, path):
        self.path = path
        shown = self.help("feature_extractor")
        self.extraction, self.matching = (
            ("FeatureExtraction", "FeatureMatching")
            if "FeatureExtraction.use_gpu" in shown
            else ("SiftExtraction", "SiftMatching")
        )

    def help(self, step):
        return subprocess.run([self.path, step, "--help"], capture_output=True, text=True, env=quiet_screen()).stdout

    def extract(self, database, images, names):
        size = f"--{self.extraction}.max_image_size"
        return [
            self.path,
            "feature_extractor",
            "--database_path",
            database,
            "--image_path",
            images,
            "--image_list_path",
            names,
            "--ImageReader.single_camera",
            "1",
            "--ImageReader.camera_model",
            "OPENCV",
            f"--{self.extraction}.use_gpu",
            "0",
            size,
            str(SIDE),
            "--SiftExtraction.max_num_features",
            str(FEATURES),
        ]

    def match(self, database, pairs):
        return [
            self.path,
            "matches_importer",
            "--database_path",
            database,
            "--match_list_path",
            pairs,
            "--match_type",
            "pairs",
            f"--{self.matching}.use_gpu",
            "0",
        ]

    def map(self, database, images, models):
        return [self.path, "mapper", "--database_path", database, "--image_path", images, "--output_path", models]


class Module:
    """The Python package pycolmap, in a separate process (pycolmap_step.py)."""

    def command(self, **step):
        return [
            sys.executable,
            "-B",
            os.path.join(os.path.dirname(os.path.abspath(__file__)), "pycolmap_step.py"),
            json.dumps(step),
        ]

    def extract(self, database, images, names):
        return self.command(step="extract", database=database, images=images, names=names, side=SIDE, features=FEATURES)

    def match(self, database, pairs):
        return self.command(step="match", database=database, pairs=pairs)

    def map(self, database, images, models):
        return self.command(step="map", database=database, images=images, models=models)


def quiet_screen():
    return os.environ | {"QT_QPA_PLATFORM": "offscreen"}


def run(command, log, count, show):
    """Runs a step to its end with its output in a file; passes the result of `count` to `show` twice a second."""
    with open(log, "ab") as words:
        process = subprocess.Popen(
            command,
            stdin=subprocess.DEVNULL,
            stdout=words,
            stderr=words,
            env=quiet_screen(),
            preexec_fn=interrupt.BEFORE_START,
        )
    try:
        while True:
            try:
                code = process.wait(0.5)
                break
            except subprocess.TimeoutExpired:
                show(count())
    finally:
        if process.poll() is None:
            process.kill()
            process.wait()
    return code


def last_words(log):
    """The last non-empty line of a log, without glog's prefix."""
    with open(log, "rb") as file:
        lines = [
            re.sub(r"^[EFIW]\d{8} \S+ +\d+ \S+\] ", "", line).strip(" =\t")
            for line in file.read().decode(errors="replace").splitlines()
        ]
    return next((line for line in reversed(lines) if line), "no message")


class Database:
    """Progress from COLMAP's database. Counts are 0 while COLMAP creates or locks the file."""

    def __init__(self, path):
        self.path = path

    def rows(self, query):
        if not os.path.exists(self.path):
            return []
        try:
            connection = sqlite3.connect(
                f"file:{urllib.parse.quote(os.fsencode(self.path))}?mode=ro", uri=True, timeout=5
            )
            try:
                return connection.execute(query).fetchall()
            finally:
                connection.close()
        except sqlite3.Error:
            return []

    def features(self):
        """Number of features by photograph, for processed photographs."""
        return dict(self.rows("select name, rows from images join keypoints using (image_id)"))

    def pairs(self):
        """For each matched pair, the two names (in any order) and the number of inlier matches."""
        names = dict(self.rows("select image_id, name from images"))
        return [
            (names[pair // 2147483647], names[pair % 2147483647], fit)
            for pair, fit in self.rows("select pair_id, rows from two_view_geometries")
        ]

    def count(self, table):
        found = self.rows(f"select count(*) from {table}")
        return found[0][0] if found else 0


def registered(model):
    """Names of the photographs that a model has cameras for."""
    path = os.path.join(model, "images.bin")
    try:
        with open(path, "rb") as file:
            data = file.read()
        (count,), at, names = struct.unpack_from("<Q", data), 8, []
        for _ in range(count):
            at += 4 + 7 * 8 + 4
            end = data.index(b"\0", at)
            names.append(os.fsdecode(data[at:end]))
            (points,) = struct.unpack_from("<Q", data, end + 1)
            at = end + 9 + 24 * points
    except (OSError, struct.error, ValueError) as error:
        raise RecordingError(f"{path}: isn't a model of COLMAP that can be read: {error}") from None
    return names


def points(model):
    """Number of a model's points and their mean reprojection error in pixels, weighted by observations."""
    path = os.path.join(model, "points3D.bin")
    try:
        with open(path, "rb") as file:
            data = file.read()
        (count,), at, errors, tracks = struct.unpack_from("<Q", data), 8, [], []
        for _ in range(count):
            error, length = struct.unpack_from("<dQ", data, at + 35)
            errors.append(error)
            tracks.append(length)
            at += 51 + 8 * length
    except (OSError, struct.error) as error:
        raise RecordingError(f"{path}: isn't a model of COLMAP that can be read: {error}") from None
    return count, float(np.average(errors, weights=tracks)) if count else 0.0


def models(folder):
    """The models from mapping, sorted by number of photographs, largest first."""
    there = (
        [
            os.path.join(folder, name)
            for name in sorted(os.listdir(folder))
            if os.path.exists(os.path.join(folder, name, "images.bin"))
        ]
        if os.path.isdir(folder)
        else []
    )
    return sorted(there, key=lambda model: -len(registered(model)))
