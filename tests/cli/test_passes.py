# SPDX-License-Identifier: Apache-2.0
"""Tests the passes of pags render --channel (crypto-object, crypto-class, expected-normal, motion, count, overdraw) on
the drive of test_drive.py."""

import json
import os
import struct
import zlib

import fixtures
import test_drive
from fixtures import Case, files_below, read
from test_drive import camera


def read_exr(path):
    """Reads an EXR file of scan lines, floats and ZIP compression. Returns its string attributes, its size, and its
    planes by name."""
    data = read(path)
    at, texts, names = 8, {}, []
    while data[at]:
        name, kind = data[at:].split(b"\0", 2)[:2]
        at += len(name) + len(kind) + 2
        size = struct.unpack_from("<i", data, at)[0]
        value = data[at + 4 : at + 4 + size]
        at += 4 + size
        if kind == b"string":
            texts[name.decode()] = value.decode()
        elif name == b"dataWindow":
            width, height = [v + 1 for v in struct.unpack("<4i", value)[2:]]
        elif name == b"channels":
            while value[0]:
                names.append(value.split(b"\0", 1)[0].decode())
                value = value[len(names[-1]) + 17 :]
    at += 1
    planes = {name: [] for name in names}
    for block in range((height + 15) // 16):
        place = struct.unpack_from("<Q", data, at + 8 * block)[0]
        first, size = struct.unpack_from("<2i", data, place)
        raw = data[place + 8 : place + 8 + size]
        rows = min(16, height - first)
        if size < 4 * rows * width * len(names):
            mixed = bytearray(zlib.decompress(raw))
            for i in range(1, len(mixed)):
                mixed[i] = (mixed[i] + mixed[i - 1] - 128) & 255
            half = (len(mixed) + 1) // 2
            raw = bytes(mixed[half + i // 2] if i % 2 else mixed[i // 2] for i in range(len(mixed)))
        for row in range(rows):
            for k, name in enumerate(names):
                planes[name].append(struct.unpack_from(f"<{width}f", raw, 4 * width * (row * len(names) + k)))
    return texts, (width, height), planes


def murmur(text):
    """Returns MurmurHash3 of a text (32 bits, seed 0). This code is independent of the engine's."""
    data, h, mask = text.encode(), 0, 0xFFFFFFFF

    def turn(x, n):
        return (x << n | x >> (32 - n)) & mask

    for i in range(0, len(data), 4):
        word = data[i : i + 4]
        k = turn(int.from_bytes(word, "little") * 0xCC9E2D51 & mask, 15) * 0x1B873593 & mask
        h ^= k
        if len(word) == 4:
            h = (turn(h, 13) * 5 + 0xE6546B64) & mask
    h ^= len(data)
    for shift, factor in ((16, 0x85EBCA6B), (13, 0xC2B2AE35), (16, 1)):
        h = (h ^ h >> shift) * factor & mask
    return h


def value(text):
    """Returns the float that has the bits of a name's hash. No name here has a float exponent of 0 or 255."""
    return struct.unpack("<f", struct.pack("<I", murmur(text)))[0]


class Passes(Case):
    render = test_drive.Drive.render

    def setUp(self):
        super().setUp()
        self.scene = test_drive.make_drive(self.path("scene"))
        self.front = self.write("front.json", json.dumps(camera()))
        self.count = 0

    def path_file(self):
        """Writes three cameras that stand still, at intervals of 1 s."""
        frames = [camera(time=100.0 + t) for t in range(3)]
        return self.write("path.json", json.dumps({"fps": 1, "frames": frames}))

    def ranks(self, planes, layer, x, y):
        """Returns the names in a pixel (as floats of their hashes) with their weights."""
        flat = [planes[f"{layer}{k:02d}.{c}"][y][x] for k in range(3) for c in "RGBA"]
        return [pair for pair in zip(flat[::2], flat[1::2]) if pair[1] > 0]

    def test_numbers_of_objects(self):
        out = self.render("--camera", self.front, "--time", 1, "--channel", "object")
        self.assertEqual(files_below(out), ["00000_object.exr", "objects.json"])
        numbers = {o["id"]: o["number"] for o in json.loads(read(os.path.join(out, "objects.json")))["objects"]}
        plane = read_exr(os.path.join(out, "00000_object.exr"))[2]["object"]
        self.assertEqual((plane[50][50], plane[50][35], plane[2][2]), (numbers["c=2"], numbers["p,1"], -1))

    def test_cryptomatte(self):
        out = self.render("--camera", self.front, "--time", 1, "--channel", "crypto-object,crypto-class")
        self.assertEqual(files_below(out), ["00000_crypto-class.exr", "00000_crypto-object.exr"])
        names_of = {"object": ["background", "c=2", "p,1"], "class": ["Car", "background"]}
        for kind, names in names_of.items():
            layer = "Crypto" + kind.capitalize()
            texts, size, planes = read_exr(os.path.join(out, f"00000_crypto-{kind}.exr"))
            key = f"cryptomatte/{murmur(layer):08x}"[: len("cryptomatte/") + 7]
            self.assertEqual(texts[key + "/name"], layer)
            self.assertEqual(texts[key + "/hash"], "MurmurHash3_32")
            self.assertEqual(texts[key + "/conversion"], "uint32_to_float32")
            self.assertEqual(json.loads(texts[key + "/manifest"]), {name: f"{murmur(name):08x}" for name in names})
            self.assertEqual((size, len(planes)), ((101, 101), 12))
        # At 1 s the car is in the middle, the parked car at y = 1.5 m.
        middle = self.ranks(planes, "CryptoClass", 50, 50)
        self.assertAlmostEqual(middle[0][1], 0.99, delta=1e-3)
        self.assertEqual(middle[0][0], value("Car"))
        self.assertEqual(self.ranks(planes, "CryptoClass", 35, 50)[0][0], value("Car"))
        self.assertEqual(self.ranks(planes, "CryptoClass", 50, 20)[0][0], value("background"))
        planes = read_exr(os.path.join(out, "00000_crypto-object.exr"))[2]
        self.assertEqual(self.ranks(planes, "CryptoObject", 50, 50)[0][0], value("c=2"))
        self.assertEqual(self.ranks(planes, "CryptoObject", 35, 50)[0][0], value("p,1"))
        self.assertEqual(self.ranks(planes, "CryptoObject", 0, 99), [])  # the sky has no name

    def test_count_and_overdraw(self):
        """One Gaussian is in the middle, one is left of it and one above it. The space below is empty."""
        out = self.render("--camera", self.front, "--time", 1, "--channel", "count,overdraw")
        self.assertEqual(files_below(out), ["00000_count.exr", "00000_overdraw.exr"])
        count = read_exr(os.path.join(out, "00000_count.exr"))[2]["count"]
        overdraw = read_exr(os.path.join(out, "00000_overdraw.exr"))[2]["overdraw"]
        for x, y, wanted in ((50, 50, 1), (35, 50, 1), (50, 20, 1), (90, 90, 0)):
            self.assertEqual((count[y][x], overdraw[y][x]), (wanted, wanted))
        edge = sum(map(sum, overdraw)) - sum(map(sum, count))
        # Overdraw also counts pixels of a block that a Gaussian reaches into but doesn't cover.
        self.assertGreater(edge, 0)

    def test_added_and_removed_objects(self):
        options = ["--camera", self.front, "--time", 1, "--channel", "crypto-object"]
        planes = read_exr(os.path.join(self.render(*options, "--without", "c=2"), "00000_crypto-object.exr"))[2]
        self.assertNotIn(value("c=2"), [pair[0] for pair in self.ranks(planes, "CryptoObject", 50, 50)])
        planes = read_exr(os.path.join(self.render(*options, "--add", "c=2", "1,0,0,0"), "00000_crypto-object.exr"))[2]
        self.assertEqual(self.ranks(planes, "CryptoObject", 50, 50)[0][0], value("c=2"))
        self.assertEqual(
            self.ranks(planes, "CryptoObject", 60, 50)[0][0], value("c=2")
        )  # the object is added 1 m ahead, which is to the camera's right

    def test_expected_normal(self):
        out = self.render("--camera", self.front, "--time", 1, "--channel", "expected-normal")
        planes = read_exr(os.path.join(out, "00000_expected-normal.exr"))[2]
        x, y, z = [planes[c][50][50] for c in "XYZ"]
        self.assertAlmostEqual(x * x + y * y + z * z, 1, delta=1e-3)
        self.assertLessEqual(x, 1e-6)  # the normal points towards the camera, which looks along x
        self.assertEqual([planes[c][99][0] for c in "XYZ"], [0, 0, 0])

    def test_motion(self):
        """The red car moves 40 pixels to the right per frame. The parked car doesn't move."""
        out = self.render("--path", self.path_file(), "--channel", "motion")
        planes = read_exr(os.path.join(out, "00001_motion.exr"))[2]
        for channel, wanted in (("X", -40 * 0.99), ("Y", 0), ("Z", -40 * 0.99), ("W", 0)):
            self.assertAlmostEqual(planes[channel][50][50], wanted, delta=0.05)
            self.assertEqual(planes[channel][50][35], 0)
        # The first frame has no frame before it, so nothing moves.
        first = read_exr(os.path.join(out, "00000_motion.exr"))[2]
        self.assertEqual(max(max(map(abs, row)) for c in "XY" for row in first[c]), 0)

    def test_same_bytes(self):
        channels = "color,crypto-object,crypto-class,expected-normal,motion,count,overdraw"
        outs = [self.render("--path", "ego", "--channel", channels, "-j", n) for n in (1, 2, 5)]
        plain = self.render("--path", "ego")
        for name in files_below(outs[0]):
            for other in outs[1:] + [plain] * name.endswith(".png"):
                self.assertEqual(read(os.path.join(outs[0], name)), read(os.path.join(other, name)), name)
        packed = self.render("--path", "ego", "--channel", channels, "--packed")
        self.assertEqual(files_below(packed), files_below(outs[0]))

    def test_options_that_exclude_passes(self):
        common = ["render", self.scene, "-o", self.path("out"), "--channel"]
        self.fails(
            [*common, "motion", "--camera", self.front], "--channel motion", "--path instead of --camera", code=2
        )
        self.fails([*common, "motion", "--split", "all"], "--path instead of --split", code=2)
        self.fails([*common, "color,crypto-class", "--budget-ms", 5], "--budget-ms", code=2)
        self.fails([*common, "expected-normal", "--early-z", "paper"], "--early-z paper", code=2)
        self.fails([*common, "crypto"], "crypto-object", "'crypto'", code=2)


if __name__ == "__main__":
    fixtures.main()
