# SPDX-License-Identifier: Apache-2.0
"""Tests pags export SCENE scene.html. The page is one file without outside references. Its data, unpacked here without
the program, is the scene's. `make check-scene-html` checks its pictures in a browser."""

import base64
import gzip
import hashlib
import html
import json
import math
import os
import random
import re
import struct

import fixtures
import scenes
from fixtures import Case

CELL = 16  # size of a cell in metres
HOSTILE = [
    "</script><script>window.injected=1</script>",
    '"><img src=x onerror="window.injected=1">',
    "&lt;b&gt; \\u2028 ]]>--><!--",
]


class Page:
    """The content of a page: its text, its header, and planes[name], a list of the rows of each plane."""

    def __init__(self, path):
        self.text = fixtures.read(path).decode()
        self.chunks = re.findall(r'<script type="text/plain" class="data">([^<]*)</script>', self.text)
        data = gzip.decompress(b"".join(base64.b64decode(chunk, validate=True) for chunk in self.chunks))
        size = struct.unpack_from("<I", data)[0]
        self.header = json.loads(data[4 : 4 + size])
        self.planes, at = {}, 4 + size
        for item in self.header["planes"]:
            rows = item["rows"]
            self.planes[item["name"]] = [data[at + k * rows : at + (k + 1) * rows] for k in range(item["planes"])]
            at += item["planes"] * rows
        assert at == len(data), (at, len(data))

    def book(self, name):
        return struct.unpack("<256f", b"".join(self.planes[name]))

    def values(self, name, book):
        table = self.book(book)
        return [[table[v] for v in plane] for plane in self.planes[name]]

    def rows(self):
        """Returns all Gaussians as (model, mean, scale, rotation, opacity, colour, harmonics, colours over time)."""
        count = self.header["gaussians"]
        cells = [struct.unpack("<6f", cell) for cell in self.planes["cells"]]
        cell_rows = [struct.unpack("<I", rows)[0] for rows in self.planes["cellRows"]]
        scale, opacity = self.values("scale", "scaleBook"), self.values("opacity", "opacityBook")[0]
        color, fourier = self.values("color", "colorBook"), self.values("fourier", "fourierBook")
        palette = self.values("palette", "paletteBook") if self.header["shDegree"] else []
        mean, out, i, cell = self.planes["mean"], [], 0, 0
        for m, model in enumerate(self.header["models"]):
            for _ in range(model["cells"]):
                at = [0, 0, 0]
                for _ in range(cell_rows[cell]):
                    for k in range(3):
                        folded = mean[k][i] << 8 | mean[3 + k][i]
                        at[k] = (at[k] + (-((folded + 1) >> 1) if folded & 1 else folded >> 1)) & 0xFFFF
                    place = [cells[cell][k] + at[k] * cells[cell][3 + k] for k in range(3)]
                    label = self.planes["label"][0][i] << 8 | self.planes["label"][1][i] if palette else 0
                    out.append(
                        (
                            m,
                            place,
                            [plane[i] for plane in scale],
                            self.rotation(i),
                            opacity[i],
                            [plane[i] for plane in color],
                            [plane[label] for plane in palette],
                            [plane[i] for plane in fourier] if i < self.header["fourierRows"] else [],
                        )
                    )
                    i += 1
                cell += 1
        assert i == count, (i, count)
        return out

    def rotation(self, i):
        bits = sum(plane[i] << 8 * k for k, plane in enumerate(self.planes["rotation"]))
        small = [((bits >> 10 * k & 1023) / 1023 * 2 - 1) * math.sqrt(0.5) for k in range(3)]
        small.insert(bits >> 30, math.sqrt(max(0, 1 - sum(v * v for v in small))))
        return small

    def sky(self):
        """Returns the sky's texels [face][row][column] of 3 values."""
        size, book = self.header["skySize"], self.book("skyBook")
        faces = [[[[0, 0, 0] for _ in range(size)] for _ in range(size)] for _ in range(6)]
        for plane, bytes_ in enumerate(self.planes["sky"]):
            face, c = faces[plane // 3], plane % 3
            for y in range(size):
                for x in range(size):
                    left, above = face[y][x - 1][c] if x else 0, face[y - 1][x][c] if y else 0
                    corner = face[y - 1][x - 1][c] if x and y else 0
                    face[y][x][c] = (bytes_[y * size + x] + left + above - corner) & 255
        return [[[[book[v] for v in texel] for texel in row] for row in face] for face in faces]


def make_rows(count, spread, seed):
    """Returns random Gaussians: x, y, z, scales, rotation, opacity (logit), dc, 45 harmonics, 48 Fourier terms of
    the first four coefficients."""
    dice = random.Random(seed)
    return [
        [
            *[dice.gauss(0, spread) for _ in range(3)],
            *[dice.gauss(-2, 1) for _ in range(3)],
            *[dice.gauss(0, 1) for _ in range(4)],
            dice.uniform(-2, 6),
            *[dice.gauss(0, 1) for _ in range(3)],
            *[dice.gauss(0, 0.2) for _ in range(45)],
            *[dice.gauss(0, 0.3) for _ in range(48)],
        ]
        for _ in range(count)
    ]


def ply(rows, objects=None, fourier=False):
    names = [
        "x",
        "y",
        "z",
        *[f"scale_{k}" for k in range(3)],
        *[f"rot_{k}" for k in range(4)],
        "opacity",
        *[f"f_dc_{k}" for k in range(3)],
    ]
    names += [f"f_rest_{c * 15 + k}" for k in range(15) for c in range(3)]
    series = ["f_dc", "f_sh1", "f_sh2", "f_sh3"] if fourier else []
    names += [f"{name}_t{k}_{c}" for name in series for k in range(1, 5) for c in range(3)]
    head = [
        "ply",
        "format binary_little_endian 1.0",
        f"element vertex {len(rows)}",
        *[f"property float {name}" for name in names],
    ]
    head += ["property int object_id"] if objects else []
    body = b"".join(
        struct.pack(f"<{len(names)}f", *row[: len(names)]) + (struct.pack("<i", objects[i]) if objects else b"")
        for i, row in enumerate(rows)
    )
    return "\n".join([*head, "end_header", ""]).encode() + body


def sigmoid(x):
    return 1 / (1 + math.exp(-x))


def rich_scene(folder, antialiased=False):
    """Writes the street of scenes.py with all kinds of Gaussians, a least alpha, a sky with values below 0 and above 1,
    and hostile names. Returns the scene's description, the rows of each model and the sky's values."""
    scene = scenes.make_scene(folder)
    models = {"background": make_rows(700, 12, 1), "car_1": make_rows(300, 1, 2)}
    for row in models["background"][:20]:
        row[10] = -6  # this opacity is 0.0025, which no picture shows
    fixtures.write(
        os.path.join(scene, "background.ply"), ply(models["background"], [0 if i >= 650 else -1 for i in range(700)])
    )
    fixtures.write(os.path.join(scene, "objects", "car_1.ply"), ply(models["car_1"], fourier=True))
    path = os.path.join(scene, "scene.json")
    description = json.loads(fixtures.read(path))
    for model in description["models"]:
        if model["name"] in models:
            model |= {"gaussians": len(models[model["name"]]), "sh_degree": 3}
            model |= {"fourier_degree": 1} if model["name"] == "car_1" else {}
    description["models"][0]["alpha_min"] = 0.0157
    for item, name in zip(description["objects"], HOSTILE):
        item["id"] = item["class"] = name
    dice = random.Random(3)
    sky = [dice.randrange(256) / 100 - 0.5 for _ in range(6 * 4 * 4 * 3)]
    head = b"{'descr': '<f2', 'fortran_order': False, 'shape': (6, 4, 4, 3), }"
    head += b" " * (117 - len(head)) + b"\n"
    fixtures.write(
        os.path.join(scene, "sky.npy"),
        b"\x93NUMPY\x01\x00" + struct.pack("<H", len(head)) + head + struct.pack("<288e", *sky),
    )
    description |= {"sky": "sky.npy", "antialiased": antialiased}
    fixtures.write(path, json.dumps(description))
    return description, models, sky


class SceneHtml(Case):
    @classmethod
    def setUpClass(cls):
        cls.shared = cls.shared_folder()
        cls.scene = os.path.join(cls.shared, "a <b> scene")
        cls.description, cls.models, cls.sky = rich_scene(cls.scene)
        cls.file = os.path.join(cls.shared, "scene.html")
        done = fixtures.run("export", cls.scene, cls.file, "--json", os.path.join(cls.shared, "said.json"))
        assert done.returncode == 0, done.stderr
        cls.said = json.loads(fixtures.read(os.path.join(cls.shared, "said.json")))
        cls.page = Page(cls.file)

    def test_one_file_that_refers_to_nothing(self):
        text = re.sub(r'<script type="text/plain".*?</script>', "", self.page.text, flags=re.S)
        self.assertNotRegex(text, r"https?:|//[a-z0-9-]+\.[a-z]{2,}/|\bimport\b *[({'\"]|@import|url\(")
        self.assertEqual(re.findall(r'\b(?:src|href|action)="([^"]*)"', text), ["data:,"])

    def test_policy_allows_no_foreign_script_or_style(self):
        policy = html.unescape(
            re.search(r'http-equiv="Content-Security-Policy" content="([^"]*)"', self.page.text).group(1)
        )
        rules = dict(rule.strip().split(" ", 1) for rule in policy.split(";"))
        self.assertEqual(rules["default-src"], "'none'")
        for rule, pattern in [
            ("script-src", r'<script type="module">(.*?)</script>\n</body>'),
            ("style-src", r"<style>(.*?)</style>"),
        ]:
            found = re.search(pattern, self.page.text, re.S).group(1).encode()
            self.assertEqual(rules[rule], f"'sha256-{base64.b64encode(hashlib.sha256(found).digest()).decode()}'")
        self.assertNotRegex(policy, r"unsafe|https?:|\*")
        self.assertNotIn("connect-src", rules)

    def test_names_are_text_and_nothing_else(self):
        for name in [*HOSTILE, "a <b> scene"]:
            self.assertNotIn(name, self.page.text)
        self.assertEqual([item["id"] for item in self.page.header["scene"]["objects"][:3]], HOSTILE)
        self.assertEqual(self.page.header["scene"]["name"], "a <b> scene")
        self.assertRegex("".join(self.page.chunks), r"\A[A-Za-z0-9+/=]+\Z")

    def test_gaussians_are_stored(self):
        rows, left = (
            self.page.rows(),
            {
                name: [r for r in all_rows if sigmoid(r[10]) >= (0.0157 if name == "background" else 1 / 255)]
                for name, all_rows in self.models.items()
            },
        )
        self.assertEqual(
            len(left["background"]),
            680 - sum(-6 < r[10] and sigmoid(r[10]) < 0.0157 for r in self.models["background"]),
        )
        self.assertEqual(self.page.header["shDegree"], 3)
        self.assertEqual(self.said["gaussians"], len(rows))
        errors = {"scale": [], "opacity": [], "colour": [], "harmonics": [], "fourier": []}
        for model, mean, scale, rotation, opacity, colour, harmonics, fourier in rows:
            object_ = self.page.header["models"][model]["object"]
            if object_ > 1:
                continue  # skips the small objects of the street
            name = "car_1" if object_ == 1 else "background"
            self.assertAlmostEqual(
                self.page.header["models"][model]["alphaMin"], 0.0157 if name == "background" else 0, delta=1e-6
            )
            row = min(left[name], key=lambda r: sum((r[k] - mean[k]) ** 2 for k in range(3)))
            left[name].remove(row)
            for k in range(3):
                self.assertAlmostEqual(
                    row[k], mean[k], delta=CELL / 65535 / 2 + 2e-5
                )  # the tolerance includes the rounding of a float of 100 m
            length = math.sqrt(sum(q * q for q in row[6:10]))
            turn = 2 * math.acos(min(1, abs(sum(row[6 + k] * rotation[k] for k in range(4))) / length))
            self.assertLess(math.degrees(turn), 0.25)
            errors["scale"] += [scale[k] - row[3 + k] for k in range(3)]
            errors["opacity"].append(opacity - sigmoid(row[10]))
            errors["colour"] += [colour[k] - row[11 + k] for k in range(3)]
            errors["harmonics"] += [harmonics[k] - row[14 + k] for k in range(45)]
            self.assertEqual(len(fourier), 48 if name == "car_1" else 0)
            errors["fourier"] += [fourier[k] - row[59 + k] for k in range(len(fourier))]
        self.assertEqual(left, {"background": [], "car_1": []})
        # With 256 values for numbers of this spread, the best choice has a root mean square error of about 3.5 sigma /
        # 256. The test allows twice this error.
        for name, spread in [("scale", 1), ("opacity", 0.3), ("colour", 1), ("harmonics", 0.2), ("fourier", 0.3)]:
            rms = math.sqrt(sum(e * e for e in errors[name]) / len(errors[name]))
            self.assertLess(rms, 7 * spread / 256, name)

    def test_cells_are_small(self):
        for cell in self.page.planes["cells"]:
            self.assertLessEqual(max(struct.unpack("<6f", cell)[3:]) * 65535, CELL + 1e-4)

    def test_tracks(self):
        car = next(model for model in self.page.header["models"] if model["object"] == 1)
        knots = self.description["objects"][1]["knots"]
        self.assertEqual(car["span"], [knots[0]["time"], knots[-1]["time"]])
        (times,), (poses,) = car["times"], car["poses"]
        for knot in knots:
            i = min(range(len(times)), key=lambda k: abs(times[k] - knot["time"]))
            self.assertAlmostEqual(times[i], knot["time"], delta=1e-6)
            for k in range(3):
                self.assertAlmostEqual(poses[i][k], knot["world_from_object"][4 * k + 3] - scenes.ORIGIN[k], delta=1e-4)
            self.assertAlmostEqual(abs(poses[i][3]), 1, delta=1e-6)
        # Poses are stored at intervals of at most half the time between two labels, also before the first label and after
        # the last one.
        self.assertLess(max(b - a for a, b in zip(times, times[1:])), 0.051)
        # The object 0 is parked, so it has no times.
        self.assertNotIn("times", next(model for model in self.page.header["models"] if model["object"] == 0))

    def test_sky_and_options(self):
        texels = [v for face in self.page.sky() for row in face for texel in row for v in texel]
        self.assertEqual(len(texels), len(self.sky))
        for found, value in zip(texels, self.sky):
            self.assertAlmostEqual(found, value, delta=0.01)  # 256 values cover a range of 2.55, so a step is 0.01
        self.assertEqual(
            [self.page.header[key] for key in ("origin", "antialiased", "lowPass")],
            [scenes.ORIGIN, False, self.page.header["lowPass"]],
        )
        self.assertAlmostEqual(self.page.header["lowPass"], 0.3, delta=1e-6)
        self.assertEqual(len(self.page.header["scene"]["views"]), 30)

    def test_same_bytes_for_any_threads(self):
        for threads in (1, 3):
            again = self.path(f"{threads}.html")
            self.succeeds("export", self.scene, again, "--target-size", "110K", "--threads", threads)
            self.assertEqual(fixtures.read(again), fixtures.read(self.path("1.html")))

    def export(self, size, *more):
        file = self.path("small.html")
        done = self.succeeds("export", self.scene, file, "--target-size", size, "--json", self.path("said.json"), *more)
        said = json.loads(fixtures.read(self.path("said.json")))
        self.assertEqual(said["bytes"], os.path.getsize(file))
        self.assertLessEqual(said["bytes"], size)
        return done.stdout, said, Page(file)

    def test_target_size_drops_harmonics_first(self):
        whole = os.path.getsize(self.file)
        self.assertEqual(self.said["bytes"], whole)
        out, said, page = self.export(whole)
        self.assertEqual((said["sh_degree"], said["left_out"]), (3, 0))
        self.assertNotIn("left out", out)
        out, said, page = self.export(whole - 5000)
        self.assertLess(said["sh_degree"], 3)
        self.assertEqual((said["gaussians"], said["left_out"]), (self.said["gaussians"], 0))
        self.assertEqual(page.header["shDegree"], said["sh_degree"])
        self.assertIn(f"left out for --target-size: view-dependent colour above degree {said['sh_degree']}", out)

    def test_target_size_then_drops_faint_gaussians(self):
        plain = self.path("plain.html")
        self.succeeds("export", self.scene, plain, "--sh-degree", 0)
        out, said, page = self.export(os.path.getsize(plain) - 4000)
        self.assertEqual(said["sh_degree"], 0)
        self.assertGreater(said["left_out"], 0)
        self.assertEqual(said["gaussians"], self.said["gaussians"] - said["left_out"])
        self.assertLess(
            said["left_out_share"], 0.5 * said["left_out"] / self.said["gaussians"]
        )  # the faintest Gaussians contribute much less than their number suggests
        self.assertIn(f"the {said['left_out']} faintest Gaussians", out)

    def test_target_size_that_is_too_small(self):
        self.fails(
            ["export", self.scene, self.path("no.html"), "--target-size", "1000"],
            "--target-size 1000",
            "expected at least",
        )
        self.assertFalse(os.path.exists(self.path("no.html")))
        self.fails(["export", self.scene, self.path("no.ply"), "--target-size", "1M"], "--target-size", ".html", code=2)

    def test_a_splat_file_without_cameras(self):
        ply_file = self.write("bare.ply", ply(make_rows(60, 1, 5)))
        self.succeeds("export", ply_file, self.path("bare.html"))
        page = Page(self.path("bare.html"))
        self.assertEqual([model["object"] for model in page.header["models"]], [-1])
        self.assertEqual(page.header["scene"]["views"], [])
        self.succeeds(
            "export", ply_file, self.path("bare.html"), "--target-size", os.path.getsize(self.path("bare.html")) - 2500
        )


if __name__ == "__main__":
    fixtures.main()
