# SPDX-License-Identifier: Apache-2.0
"""Helpers of the command-line tests: they run the program and make small files (PLY, PNG, a data set)."""

import json
import math
import os
import struct
import subprocess
import sys
import tempfile
import unittest
import zlib

PAGS = os.environ.get("PAGS", "build/pags")
# The weights of LPIPS that this user has installed must not change any test.
os.environ["XDG_DATA_HOME"] = os.path.join(tempfile.gettempdir(), "pags-tests-without-data")

PLY_NAMES = ["x", "y", "z", "nx", "ny", "nz", "f_dc_0", "f_dc_1", "f_dc_2"] + [
    "opacity",
    "scale_0",
    "scale_1",
    "scale_2",
    "rot_0",
    "rot_1",
    "rot_2",
    "rot_3",
]


# This camera stands at the origin and looks along z.
FRONT = {
    "width": 65,
    "height": 49,
    "fx": 60.0,
    "fy": 60.0,
    "cx": 32.5,
    "cy": 24.5,
    "camera_from_world_quaternion_wxyz": [1, 0, 0, 0],
    "camera_from_world_translation": [0, 0, 0],
}

# Few Gaussians keep the trainings short.
SMALL = ["--random-points", "500", "--max-gaussians", "1500"]


def program(arguments):
    """Returns the command line for `arguments`. If the first word is pags-bench, runs pags-bench from the folder of the
    program under test."""
    words = [str(word) for word in arguments]
    return (
        [os.path.join(os.path.dirname(PAGS), *words[:1]), *words[1:]] if words[:1] == ["pags-bench"] else [PAGS, *words]
    )


def run(*arguments, timeout=300, **more):
    """Runs the program under test to its end. The result has returncode, stdout and stderr as text."""
    return subprocess.run(program(arguments), capture_output=True, text=True, timeout=timeout, **more)


def numpy_python():
    """Returns a Python interpreter that has numpy: the running one or the system's. Returns None if both lack numpy."""
    for python in (sys.executable, "/usr/bin/python3"):
        if (
            os.path.exists(python)
            and subprocess.run([python, "-c", "import numpy"], capture_output=True).returncode == 0
        ):
            return python
    return None


def ply_bytes(rows):
    """Returns the bytes of a PLY file in INRIA's layout, of degree 0. Each row holds the 17 values of PLY_NAMES."""
    header = ["ply", "format binary_little_endian 1.0", f"element vertex {len(rows)}"]
    header += [f"property float {name}" for name in PLY_NAMES] + ["end_header", ""]
    return "\n".join(header).encode() + b"".join(struct.pack("<17f", *row) for row in rows)


def splat(x, y, z, rgb, sigma=0.1, opacity=4.0):
    """Returns a row for ply_bytes: a round Gaussian of the given display colour. `opacity` is a logit."""
    dc = [(c - 0.5) / 0.28209479177387814 for c in rgb]
    return [x, y, z, 0, 0, 0, *dc, opacity, *[math.log(sigma)] * 3, 1, 0, 0, 0]


def some_splats():
    colours = [(0.9, 0.1, 0.1), (0.1, 0.9, 0.1), (0.1, 0.1, 0.9), (0.8, 0.8, 0.1)]
    return [splat(math.cos(i), 0.5 * math.sin(2 * i), math.sin(i), colours[i % 4]) for i in range(40)]


def png_bytes(width, height, pixels):
    """Returns the bytes of an 8-bit RGB PNG file. `pixels` holds width * height * 3 bytes."""

    def chunk(kind, data):
        return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))

    rows = b"".join(b"\0" + pixels[y * width * 3 : (y + 1) * width * 3] for y in range(height))
    header = struct.pack(">IIBBBBB", width, height, 8, 2, 0, 0, 0)
    return b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", header) + chunk(b"IDAT", zlib.compress(rows)) + chunk(b"IEND", b"")


def read_png(path):
    """Reads a PNG file without interlace. Returns width, height, channels, bits and the samples after its filters are
    undone."""
    data = read(path)
    assert data[:8] == b"\x89PNG\r\n\x1a\n", path
    at, packed = 8, b""
    while at < len(data):
        (length,) = struct.unpack(">I", data[at : at + 4])
        kind, body = data[at + 4 : at + 8], data[at + 8 : at + 8 + length]
        if kind == b"IHDR":
            width, height, bits, colour = struct.unpack(">IIBB", body[:10])
        elif kind == b"IDAT":
            packed += body
        at += 12 + length
    channels = {0: 1, 2: 3, 4: 2, 6: 4}[colour]
    step = channels * bits // 8
    raw, rows, before = zlib.decompress(packed), [], bytearray(width * step)
    for y in range(height):
        start = y * (width * step + 1)
        row = bytearray(raw[start + 1 : start + 1 + width * step])
        undo_filter(raw[start], row, before, step)
        rows.append(bytes(row))
        before = row
    return width, height, channels, bits, b"".join(rows)


def undo_filter(kind, row, before, step):
    for i in range(len(row)):
        left = row[i - step] if i >= step else 0
        corner = before[i - step] if i >= step else 0
        up = before[i]
        if kind == 1:
            add = left
        elif kind == 2:
            add = up
        elif kind == 3:
            add = (left + up) // 2
        elif kind == 4:
            guess = left + up - corner
            add = min((left, up, corner), key=lambda v: abs(guess - v))
        else:
            add = 0
        row[i] = (row[i] + add) & 255


def ring_pose(angle, radius=3.0, height=0.8):
    """Returns a camera-to-world pose in OpenGL axes. The camera stands on a ring around the origin and looks at the
    origin; world z is up."""
    eye = [radius * math.cos(angle), radius * math.sin(angle), height]
    size = math.sqrt(sum(e * e for e in eye))
    back = [e / size for e in eye]
    right = [-math.sin(angle), math.cos(angle), 0.0]
    up = [
        back[1] * right[2] - back[2] * right[1],
        back[2] * right[0] - back[0] * right[2],
        back[0] * right[1] - back[1] * right[0],
    ]
    return [[right[i], up[i], back[i], eye[i]] for i in range(3)] + [[0, 0, 0, 1]]


# Each entry is the centre, radius and colour of a sphere.
SPHERES = [
    ((0.0, 0.0, 0.0), 0.5, (220, 60, 40)),
    ((0.6, 0.3, 0.2), 0.3, (40, 180, 60)),
    ((-0.5, 0.5, -0.1), 0.35, (50, 80, 230)),
]


def sphere_picture(pose, width, height, focal):
    """Renders shaded spheres in front of a grey wall with one ray per pixel."""
    pixels = bytearray()
    eye = [pose[i][3] for i in range(3)]
    for v in range(height):
        for u in range(width):
            ray = ((u + 0.5 - width / 2) / focal, -(v + 0.5 - height / 2) / focal, -1.0)
            d = [sum(pose[i][k] * ray[k] for k in range(3)) for i in range(3)]
            size = math.sqrt(sum(c * c for c in d))
            pixels += bytes(shade(eye, [c / size for c in d]))
    return bytes(pixels)


def shade(eye, d):
    best, colour = math.inf, (90, 90, 90)
    for centre, radius, rgb in SPHERES:
        o = [eye[i] - centre[i] for i in range(3)]
        b = sum(o[i] * d[i] for i in range(3))
        root = b * b - sum(c * c for c in o) + radius * radius
        if root > 0 and 0 < -b - math.sqrt(root) < best:
            best = -b - math.sqrt(root)
            light = 0.6 + 0.4 * (eye[2] + best * d[2] - centre[2]) / radius
            colour = tuple(int(c * light) for c in rgb)
    return colour


def write(path, data):
    os.makedirs(os.path.dirname(path), exist_ok=True)
    with open(path, "wb" if isinstance(data, bytes) else "w") as file:
        file.write(data)
    return path


def read(path):
    with open(path, "rb") as file:
        return file.read()


def make_dataset(folder, views=9, width=64, height=48):
    """Writes a transforms.json data set of three spheres."""
    focal, frames = 60.0, []
    for i in range(views):
        pose = ring_pose(2 * math.pi * i / views)
        name = f"images/{i:03d}.png"
        write(os.path.join(folder, name), png_bytes(width, height, sphere_picture(pose, width, height, focal)))
        frames.append({"file_path": name, "transform_matrix": pose})
    head = {"fl_x": focal, "fl_y": focal, "cx": width / 2, "cy": height / 2, "w": width, "h": height}
    write(os.path.join(folder, "transforms.json"), json.dumps({**head, "frames": frames}, indent=1))
    return folder


def files_below(folder):
    return sorted(
        os.path.relpath(os.path.join(where, name), folder) for where, _, names in os.walk(folder) for name in names
    )


class Case(unittest.TestCase):
    """A test case that has a temporary folder."""

    def setUp(self):
        holder = tempfile.TemporaryDirectory(prefix="pags-cli-")
        self.addCleanup(holder.cleanup)
        self.folder = holder.name

    @classmethod
    def shared_folder(cls):
        """Makes a folder that all tests of the class share. Call it in setUpClass."""
        holder = tempfile.TemporaryDirectory(prefix="pags-cli-")
        cls.addClassCleanup(holder.cleanup)
        return holder.name

    def path(self, *names):
        return os.path.join(self.folder, *names)

    def write(self, name, data):
        return write(self.path(name), data)

    def succeeds(self, *arguments, **more):
        done = run(*arguments, **more)
        self.assertEqual(done.returncode, 0, f"{arguments}: {done.stderr}")
        return done

    def fails(self, arguments, *words, code=1, **more):
        """Asserts that the program fails with one line on stderr. The line begins with the program's name and holds
        each of `words`. Warnings and lines that libpng prints aren't counted."""
        done = run(*arguments, **more)
        self.assertEqual(done.returncode, code, f"{arguments}: {done.stdout}{done.stderr}")
        lines = [line for line in done.stderr.splitlines() if not line.startswith(("libpng ", "warning: "))]
        self.assertEqual(len(lines), 1, f"{arguments}: expected one line, got {done.stderr!r}")
        name = os.path.basename(program(arguments)[0])
        self.assertTrue(lines[0].startswith(f"{name}: " if code == 1 else name), lines[0])
        for word in words:
            self.assertIn(str(word), lines[0])
        return lines[0]


class DataCase(Case):
    """The base class of tests that train on one small data set."""

    @classmethod
    def setUpClass(cls):
        cls.data = make_dataset(os.path.join(cls.shared_folder(), "data"), views=9)


def main():
    if len(sys.argv) > 1 and not sys.argv[1].startswith("-"):
        global PAGS
        PAGS = os.path.abspath(sys.argv.pop(1))
        sys.modules["fixtures"].PAGS = PAGS
    unittest.main(module="__main__", verbosity=2)
