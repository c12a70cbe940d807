# SPDX-License-Identifier: Apache-2.0
"""Tests photographs as users have them: other sizes, alpha, masks of all kinds, EXIF orientation, linear light, a
single picture."""

import json
import math
import os
import shutil
import struct
import zlib

import fixtures
from fixtures import read_png, write

WIDTH, HEIGHT, VIEWS = 32, 24, 9


def png(width, height, samples, channels=3, bits=8, orientation=1, chunks=()):
    """Returns the bytes of a PNG file. `samples` are bytes, big-endian if `bits` is 16. `chunks` (name, data) precede
    the pixels."""

    def chunk(kind, data):
        return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))

    step = width * channels * bits // 8
    rows = b"".join(b"\0" + samples[y * step : (y + 1) * step] for y in range(height))
    colour = {1: 0, 2: 4, 3: 2, 4: 6}[channels]
    exif = struct.pack("<2sHIHHHIHHI", b"II", 42, 8, 1, 274, 3, 1, orientation, 0, 0)
    return (
        b"\x89PNG\r\n\x1a\n"
        + chunk(b"IHDR", struct.pack(">IIBBBBB", width, height, bits, colour, 0, 0, 0))
        + (chunk(b"eXIf", exif) if orientation > 1 else b"")
        + b"".join(chunk(*more) for more in chunks)
        + chunk(b"IDAT", zlib.compress(rows))
        + chunk(b"IEND", b"")
    )


def tiff(width, height, samples, extra):
    """Returns the bytes of an 8-bit RGBA TIFF file. If `extra` is 1, the colours are multiplied by alpha; if it is 2,
    they are not."""
    entries = [
        (256, 4, width),
        (257, 4, height),
        (258, 3, 8),
        (259, 3, 1),
        (262, 3, 2),
        (273, 4, 200),
        (277, 3, 4),
        (278, 4, height),
        (279, 4, len(samples)),
        (338, 3, extra),
    ]
    head = b"II*\0" + struct.pack("<IH", 8, len(entries))
    for tag, kind, value in entries:
        head += struct.pack("<HHII", tag, kind, 4, 180) if tag == 258 else struct.pack("<HHII", tag, kind, 1, value)
    return head.ljust(180, b"\0") + struct.pack("<4H", 8, 8, 8, 8).ljust(20, b"\0") + samples


def exr(width, height, rows, channels="BGRA", left=0, top=0, shown=None, aspect=1):
    """Returns the bytes of an uncompressed EXR file of half floats. rows[y][c] is a list of values. The data window
    begins at `left`, `top`; `shown` is the display window."""

    def attribute(name, kind, value):
        return name + b"\0" + kind + b"\0" + struct.pack("<i", len(value)) + value

    given = list(channels[: len(rows[0])])
    names = sorted(given)
    listed = b"".join(name.encode() + b"\0" + struct.pack("<iB3xii", 1, 0, 1, 1) for name in names) + b"\0"
    box = (left, top, left + width - 1, top + height - 1)
    head = (
        struct.pack("<II", 20000630, 2)
        + attribute(b"channels", b"chlist", listed)
        + attribute(b"compression", b"compression", b"\0")
        + attribute(b"dataWindow", b"box2i", struct.pack("<4i", *box))
        + attribute(b"displayWindow", b"box2i", struct.pack("<4i", *(shown or box)))
        + attribute(b"lineOrder", b"lineOrder", b"\0")
        + attribute(b"pixelAspectRatio", b"float", struct.pack("<f", aspect))
        + attribute(b"screenWindowCenter", b"v2f", struct.pack("<2f", 0, 0))
        + attribute(b"screenWindowWidth", b"float", struct.pack("<f", 1))
        + b"\0"
    )
    line = width * 2 * len(names)
    places = b"".join(struct.pack("<Q", len(head) + 8 * height + y * (8 + line)) for y in range(height))
    order = [given.index(name) for name in names]
    data = b"".join(
        struct.pack("<ii", top + y, line) + b"".join(struct.pack(f"<{width}e", *rows[y][c]) for c in order)
        for y in range(height)
    )
    return head + places + data


class Photographs(fixtures.Case):
    @classmethod
    def setUpClass(cls):
        cls.data = fixtures.make_dataset(os.path.join(cls.shared_folder(), "data"), VIEWS, WIDTH, HEIGHT)
        cls.pixels = [read_png(f"{cls.data}/images/{i:03d}.png")[4] for i in range(VIEWS)]

    def setUp(self):
        super().setUp()
        self.set = self.path("set")
        shutil.copytree(self.data, self.set)

    def change(self, **keys):
        with open(f"{self.set}/transforms.json") as file:
            content = json.load(file)
        content.update(keys)
        write(f"{self.set}/transforms.json", json.dumps(content, indent=1))
        return content

    def info(self, *arguments):
        return json.loads(self.succeeds("info", self.set, "--json", "-", *arguments).stdout)

    def train(self, *arguments, steps=1):
        scene = self.path("scene")
        more = ["-o", scene, "-n", steps, "--preview-every", 0, "--overwrite", "--random-points", 200, "--json", "-"]
        done = self.succeeds("train", self.set, *more, *arguments)
        self.said = done.stderr
        return json.loads(done.stdout)

    def eval(self, *arguments):
        done = self.succeeds("eval", self.path("scene"), "--json", "-", "--images", self.path("eval"), *arguments)
        return json.loads(done.stdout)

    def photo(self, name="000"):
        width, height, channels, _, data = read_png(self.path("eval", f"{name}_photo.png"))
        self.assertEqual(channels, 3)
        return width, height, data

    def one_warning(self, found, *words):
        self.assertEqual(len(found["warnings"]), 1, found["warnings"])
        for word in words:
            self.assertIn(word, found["warnings"][0])

    def masks(self, make, folder="masks", ending=".png"):
        """Writes a mask for each view. make(i) returns the bytes of a picture."""
        for i in range(VIEWS):
            write(f"{self.set}/{folder}/{i:03d}{ending}", make(i))

    def left_half(self, value=255, other=0):
        return bytes(value if x < WIDTH // 2 else other for y in range(HEIGHT) for x in range(WIDTH))

    # ---- Sizes and folders ----

    def test_pictures_smaller_than_their_cameras(self):
        self.change(w=2 * WIDTH - 1, h=2 * HEIGHT - 1, fl_x=120, fl_y=119, cx=31, cy=23)
        found = self.info()
        self.assertEqual((found["width"], found["height"]), (WIDTH, HEIGHT))
        self.one_warning(found, "9 of 9 photographs have another size", "000.png", "32 x 24 for a camera of 63 x 47")
        self.one_warning(self.train(), "another size")
        with open(self.path("scene", "scene.json")) as file:
            camera = json.load(file)["cameras"][0]
        for key, value in {"fx": 120 * 32 / 63, "fy": 119 * 24 / 47, "cx": 31 * 32 / 63, "cy": 23 * 24 / 47}.items():
            self.assertAlmostEqual(camera[key], value, places=9)
        self.eval()
        self.fails(["info", self.set, "--strict"], "another size", "--strict")

    def test_another_ratio_is_refused(self):
        self.change(w=HEIGHT, h=WIDTH)
        self.fails(["info", self.set], "000.png has 32 x 24 pixels, expected 24 x 32", "transforms.json:")

    def test_intrinsics_of_another_size(self):
        content = self.change()
        for key in ("w", "h"):
            del content[key]
        write(
            f"{self.set}/transforms.json", json.dumps({**content, "fl_x": 120, "fl_y": 120, "cx": WIDTH, "cy": HEIGHT})
        )
        self.one_warning(
            self.info(), "9 of 9 cameras have their principal point at the edge", "000.png", "32,24 in 32 x 24"
        )

    def test_image_folder(self):
        small = bytes(WIDTH // 2 * HEIGHT // 2 * 3)
        for i in range(VIEWS):
            write(f"{self.set}/images_2/{i:03d}.png", png(WIDTH // 2, HEIGHT // 2, small))
        self.assertEqual(self.info()["warnings"], [])
        found = self.info("--image-folder", "images_2")
        self.assertEqual((found["width"], found["warnings"]), (WIDTH // 2, []))
        self.train("--image-folder", "images_2")
        self.eval()  # the scene remembers the image folder
        self.assertEqual(self.photo()[0], WIDTH // 2)
        self.fails(["info", self.set, "--image-folder", "images_3"], "images_3: no such image folder")
        self.eval("--image-folder", "images")  # the photographs are shrunk to the scene's size
        self.assertEqual(self.photo()[0], WIDTH // 2)

    def test_pictures_in_another_folder(self):
        os.rename(f"{self.set}/images", f"{self.set}/input")
        self.one_warning(self.info(), "9 of 9 are in", "input")
        shutil.rmtree(f"{self.set}/input")
        self.fails(["info", self.set], "no such image", "all 9 images are missing")

    def test_same_names_in_folders(self):
        content = self.change()
        for i, frame in enumerate(content["frames"]):
            name = f"images/cam{i % 3}/{i // 3}.png"
            os.makedirs(f"{self.set}/images/cam{i % 3}", exist_ok=True)
            os.rename(f"{self.set}/{frame['file_path']}", f"{self.set}/{name}")
            frame["file_path"] = name
        self.change(frames=content["frames"])
        self.assertEqual(self.train()["warnings"], [])
        names = [view["name"] for view in self.eval()["train"]["per_view"]]
        self.assertEqual(names, [f"cam{i // 3}/{i % 3}.png" for i in range(9) if i % 8])
        self.assertEqual(self.photo("cam1/2")[2], self.pixels[7])
        self.succeeds("render", self.path("scene"), "--split", "all", "-o", self.path("drawn"))
        self.assertEqual(len(fixtures.files_below(self.path("drawn"))), 9)
        with open(self.path("scene", "scene.json")) as file:
            scene = json.load(file)
        scene["cameras"][0]["name"] = "../../outside.png"
        write(self.path("scene", "scene.json"), json.dumps(scene))
        self.succeeds("render", self.path("scene"), "--split", "all", "-o", self.path("again", "drawn"))
        self.assertIn("outside.png", os.listdir(self.path("again", "drawn")))

    def test_names_that_differ_in_extension_or_case(self):
        """Two views never write pictures of the same name, even if letter case is ignored. A picture's name doesn't
        depend on the chosen views."""
        names = ["a.png", "a.jpg", "A.png", "a.jpeg", "cam/a.png", "cam/a.JPG", "a.png-1.png", "b.c.png", "b.c"]
        content = self.change()
        for frame, name in zip(content["frames"], names, strict=True):
            write(f"{self.set}/images/{name}", fixtures.read(f"{self.set}/{frame['file_path']}"))
            frame["file_path"] = f"images/{name}"
        self.change(frames=content["frames"])
        self.train()
        self.eval()
        self.succeeds("render", self.path("scene"), "--split", "all", "-o", self.path("drawn"))
        drawn = {name[: -len(".png")] for name in fixtures.files_below(self.path("drawn"))}
        compared = {
            name[: -len("_photo.png")]
            for name in fixtures.files_below(self.path("eval"))
            if name.endswith("_photo.png")
        }
        self.assertEqual(drawn, compared)
        self.assertEqual(len({name.lower() for name in drawn}), 9, drawn)
        self.succeeds("render", self.path("scene"), "--split", "test", "-o", self.path("some"))
        self.assertLess({name[: -len(".png")] for name in fixtures.files_below(self.path("some"))}, drawn)

    def test_photographs_of_one_colour(self):
        """Equal pictures have a PSNR of 100 dB, which is a number in every file and in means. No colour depends on the
        view."""
        black = fixtures.png_bytes(WIDTH, HEIGHT, bytes(3 * WIDTH * HEIGHT))
        for i in range(VIEWS):
            write(f"{self.set}/images/{i:03d}.png", black)
        aside = write(self.path("aside.ply"), fixtures.ply_bytes([fixtures.splat(0, 0, 500, (1, 1, 1))]))
        found = json.loads(self.succeeds("eval", aside, "--dataset", self.set, "--json", "-").stdout)
        self.assertEqual([found[part]["psnr"] for part in ("train", "test")], [100, 100])
        self.assertEqual({view["psnr"] for view in found["train"]["per_view"]}, {100})
        more = ["-n", 4, "--preview-every", 2, "--log-every", 1, "--random-points", 200]
        self.succeeds("train", self.set, "-o", self.path("scene"), *more)
        scene = json.loads(fixtures.read(self.path("scene", "scene.json")))
        self.assertEqual((scene["models"][0]["sh_degree"], scene["modelled"]["sh"]["degree"]), (0, 0))
        lines = [json.loads(line) for line in fixtures.read(self.path("scene", "log.jsonl")).splitlines()]
        self.assertNotIn(
            None, [line[key] for line in lines for key in ("psnr", "view_psnr", "held_out_psnr") if key in line]
        )
        self.assertIn("the photographs have one colour", self.succeeds("info", self.path("scene")).stdout)
        write(
            f"{self.set}/images/004.png", fixtures.png_bytes(WIDTH, HEIGHT, bytes([2]) + bytes(3 * WIDTH * HEIGHT - 1))
        )
        self.train()
        scene = json.loads(fixtures.read(self.path("scene", "scene.json")))
        self.assertEqual(scene["config"]["sh_degree"], 3)

    def test_white_photographs(self):
        """A capture that shows nothing but white has no SH."""
        for i in range(VIEWS):
            write(f"{self.set}/images/{i:03d}.png", fixtures.png_bytes(WIDTH, HEIGHT, b"\xff" * 3 * WIDTH * HEIGHT))
        self.train()
        scene = json.loads(fixtures.read(self.path("scene", "scene.json")))
        self.assertEqual([model["sh_degree"] for model in scene["models"]], [0])
        self.assertEqual(scene["modelled"]["sh"]["degree"], 0)

    # ---- Colours ----

    def rgba(self, i, alpha):
        colours = self.pixels[i]
        return b"".join(colours[3 * at : 3 * at + 3] + bytes([alpha[at]]) for at in range(WIDTH * HEIGHT))

    def cut_out(self):
        alpha = bytes(255 if x < 16 else 128 if x < 20 else 0 for y in range(HEIGHT) for x in range(WIDTH))
        for i in range(VIEWS):
            write(f"{self.set}/images/{i:03d}.png", png(WIDTH, HEIGHT, self.rgba(i, alpha), 4))
        return alpha

    def test_alpha_over_the_background(self):
        alpha = self.cut_out()
        said = self.train("--background", "1,0.5,0")
        self.assertEqual(said["warnings"], [])
        self.eval()
        got, want = self.photo()[2], self.pixels[0]
        for at in range(0, WIDTH * HEIGHT, 7):
            for c, behind in enumerate((255, 128, 0)):
                mixed = (want[3 * at + c] * alpha[at] + behind * (255 - alpha[at])) / 255
                self.assertLessEqual(abs(got[3 * at + c] - mixed), 0.51)
        self.eval("--background", "0,0,1")
        self.assertEqual(self.photo()[2][3 * 31 : 3 * 32], bytes([0, 0, 255]))

    def test_messages_are_printed_once(self):
        """eval opens the data set twice if the scene was trained at another size. A message about photographs is
        printed once."""
        self.cut_out()
        self.train("--downscale", "2")
        self.assertEqual(self.succeeds("eval", self.path("scene")).stdout.count("have an alpha channel"), 1)

    def test_alpha_as_mask_or_ignored(self):
        self.cut_out()
        self.train("--image-alpha", "mask")
        masked = self.eval()["train"]["psnr"]
        self.assertEqual(self.photo()[2], self.pixels[0])
        ignored = self.eval("--image-alpha", "ignore")["train"]["psnr"]
        self.assertEqual(self.photo()[2], self.pixels[0])
        self.assertNotAlmostEqual(masked, ignored, places=2)
        write(f"{self.set}/images/002.png", png(WIDTH, HEIGHT, bytes(WIDTH * HEIGHT * 4), 4))
        self.one_warning(self.train("--image-alpha", "mask", steps=12), "left out by its alpha", "002.png")
        self.cut_out()
        self.train("--image-alpha", "mask")
        content = self.change()
        for i, frame in enumerate(content["frames"]):
            frame["mask_path"] = f"masks/{i:03d}.png"
        self.masks(
            lambda i: png(WIDTH, HEIGHT, bytes(255 if x < 20 else 0 for y in range(HEIGHT) for x in range(WIDTH)), 1)
        )
        self.change(frames=content["frames"])
        self.assertAlmostEqual(self.eval("--image-alpha", "ignore")["train"]["psnr"], masked, places=9)

    # ---- Colours ----

    def store_png(self, samples, *chunks):
        """Stores all photographs as PNG files with these chunks. samples(pixels) returns the stored samples."""
        for i in range(VIEWS):
            write(f"{self.set}/images/{i:03d}.png", png(WIDTH, HEIGHT, samples(self.pixels[i]), chunks=chunks))

    def photo_near(self, tolerance):
        self.assertLessEqual(max(abs(a - b) for a, b in zip(self.photo()[2], self.pixels[0])), tolerance)

    def test_colours_of_png(self):
        gamma = lambda g: (b"gAMA", struct.pack(">I", round(100000 * g)))
        grey = [b"cHRM", struct.pack(">8I", 31270, 32900, 64000, 33000, 30000, 60000, 15000, 6000)]
        self.store_png(bytes, gamma(0.45455), grey)  # other programs describe sRGB by these chunks
        self.assertEqual(self.train()["warnings"], [])
        self.assertNotIn("sRGB", self.said)
        self.store_png(lambda p: bytes(p), (b"cICP", bytes([1, 13, 0, 1])), gamma(1))  # cICP takes precedence over gAMA
        self.train()
        self.assertNotIn("sRGB", self.said)
        self.eval()
        self.photo_near(0)

        def linear(p):
            return bytes(round(255 * (v / 255 / 12.92 if v <= 10 else ((v / 255 + 0.055) / 1.055) ** 2.4)) for v in p)

        self.store_png(linear, gamma(1))
        self.assertEqual(self.train()["warnings"], [])
        self.assertIn(
            "9 of 9 photographs have colours that are not sRGB and are converted to it; those of 000.png are gamma 1",
            self.said,
        )
        self.eval()
        self.photo_near(7)  # linear light in 8 bits is coarse in dark colours
        self.store_png(linear, gamma(1), (b"sRGB", b"\0"))  # sRGB takes precedence over gAMA
        self.train()
        self.assertNotIn("not sRGB", self.said)
        self.store_png(bytes, (b"cICP", bytes([9, 16, 0, 1])))
        self.fails(
            ["info", self.set],
            "000.png: its colours are in a space that is not converted here (BT.2020, PQ (HDR))",
            "zscale",
        )

    def test_tiff_multiplied_by_alpha(self):
        """The colours are the same whether the file's colours are multiplied by alpha or not."""
        content = self.change()
        for extra in (1, 2):
            for i, frame in enumerate(content["frames"]):
                frame["file_path"] = f"images/{i:03d}.tif"
                p = self.pixels[i]
                rgba = b"".join(
                    bytes([*(v * 128 // 255 if extra == 1 else v for v in p[at : at + 3]), 128])
                    for at in range(0, len(p), 3)
                )
                write(f"{self.set}/{frame['file_path']}", tiff(WIDTH, HEIGHT, rgba, extra))
            self.change(frames=content["frames"])
            done = fixtures.run("info", self.set)
            if "OpenImageIO reads more" in done.stderr:
                self.skipTest("needs OpenImageIO")
            for alpha, scale in (("ignore", 1), ("composite", 128 / 255)):
                self.train("--image-alpha", alpha)
                self.eval()
                self.assertLessEqual(
                    max(abs(a - b * scale) for a, b in zip(self.photo()[2], self.pixels[0])), 3, (extra, alpha)
                )

    def test_masks_have_no_colours(self):
        profiled = lambda i: png(WIDTH, HEIGHT, self.left_half(), 1, chunks=[(b"cICP", bytes([9, 16, 0, 1]))])
        self.masks(profiled)
        self.assertEqual(self.train()["warnings"], [])

    # ---- EXR ----

    def light(self, i):
        """Returns picture i in linear light, as rows of the channels B, G, R."""
        light = [v / 255 for v in self.pixels[i]]
        light = [v / 12.92 if v <= 0.04045 else ((v + 0.055) / 1.055) ** 2.4 for v in light]
        return [[light[3 * WIDTH * y + c : 3 * WIDTH * (y + 1) : 3] for c in (2, 1, 0)] for y in range(HEIGHT)]

    def store_exr(self, make):
        """Stores all photographs as EXR files. make(i, rows) returns the bytes of one file."""
        content = self.change()
        for i, frame in enumerate(content["frames"]):
            frame["file_path"] = f"images/{i:03d}.exr"
            write(f"{self.set}/{frame['file_path']}", make(i, self.light(i)))
        self.change(frames=content["frames"])

    def photo_is(self, i, inside=lambda x, y: True, outside=0):
        width, height, data = self.photo(f"{i:03d}")
        self.assertEqual((width, height), (WIDTH, HEIGHT))
        for y in range(HEIGHT):
            for x in range(WIDTH):
                at = 3 * (y * WIDTH + x)
                want = self.pixels[i][at : at + 3] if inside(x, y) else [outside] * 3
                self.assertLessEqual(max(abs(a - b) for a, b in zip(data[at : at + 3], want)), 1, (x, y))

    def test_linear_light(self):
        def make(i, rows):
            if i == 0:  # alpha is 0.5, and the colours are multiplied by it
                rows = [[[v / 2 for v in c] for c in row] + [[0.5] * WIDTH] for row in rows]
            return exr(WIDTH, HEIGHT, rows)

        self.store_exr(make)
        self.assertEqual(self.train()["warnings"], [])
        self.eval()
        self.photo_is(1)
        self.assertLessEqual(max(abs(2 * a - b) for a, b in zip(self.photo("000")[2], self.pixels[0])), 3)

    def test_data_window_larger_than_the_picture(self):
        def make(i, rows):
            rows = [
                [c[:1] * 3 + c + c[-1:] for c in row] for row in rows
            ]  # adds three columns on the left and one on the right
            return exr(
                WIDTH + 4,
                HEIGHT + 5,
                rows[:1] * 4 + rows + rows[-1:],
                left=97,
                top=-54,
                shown=(100, -50, 99 + WIDTH, -51 + HEIGHT),
            )

        self.store_exr(make)
        self.assertEqual(self.train()["warnings"], [])
        self.assertIn("9 of 9 photographs are EXR files whose data window is larger", self.said)
        self.eval()
        self.photo_is(0)

    def test_data_window_of_a_part(self):
        def make(i, rows):
            return exr(
                20,
                10,
                [[c[6:26] for c in row] for row in rows[8:18]],
                left=6,
                top=8,
                shown=(0, 0, WIDTH - 1, HEIGHT - 1),
            )

        self.store_exr(make)
        inside = lambda x, y: 6 <= x < 26 and 8 <= y < 18
        self.one_warning(
            self.train("--background", "0.2,0.2,0.2"), "data window covers only a part", "is the background", "000.exr"
        )
        self.eval("--background", "0.2,0.2,0.2")
        self.photo_is(0, inside, 51)
        self.one_warning(self.train("--image-alpha", "mask"), "left out of the loss")
        self.one_warning(self.train("--image-alpha", "ignore"), "is black")
        self.eval()
        self.photo_is(0, inside)

    def test_layers(self):
        grey = [0.9] * WIDTH
        more = lambda rows: [row + [grey] * 5 for row in rows]
        depth = ["V.AO.R", "V.AO.G", "V.AO.B", "V.Depth.Z", "V.Index"]
        names = ["V.Combined.B", "V.Combined.G", "V.Combined.R", *depth]
        self.store_exr(lambda i, rows: exr(WIDTH, HEIGHT, more(rows), names))
        self.assertEqual(self.train()["warnings"], [])
        self.assertIn("9 of 9 photographs are EXR files of several layers; of 000.exr, V.Combined is used", self.said)
        self.eval()
        self.photo_is(0)
        names = [
            "A.Combined.B",
            "A.Combined.G",
            "A.Combined.R",
            "B.Combined.R",
            "B.Combined.G",
            "B.Combined.B",
            "Z",
            "id",
        ]
        self.store_exr(lambda i, rows: exr(WIDTH, HEIGHT, more(rows), names))
        self.one_warning(self.train(), "several layers may be the picture", "of 000.exr, A.Combined is used")
        names = ["gloss.B", "gloss.G", "gloss.R", "diffuse.R", "diffuse.G", "diffuse.B", "Z", "id"]
        self.store_exr(lambda i, rows: exr(WIDTH, HEIGHT, more(rows), names))
        self.fails(["info", self.set], "000.exr: several layers", "diffuse, gloss", "oiiotool")
        self.store_exr(lambda i, rows: exr(WIDTH, HEIGHT, rows, ["N.X", "N.Y", "N.Z"]))
        self.fails(["info", self.set], "000.exr: no colours", "N.X, N.Y, N.Z")

    def test_pixels_that_are_not_square(self):
        self.store_exr(lambda i, rows: exr(WIDTH, HEIGHT, rows, aspect=1.5))
        self.one_warning(
            self.info(), "9 of 9 photographs have pixels that are not square", "000.exr, with pixels of 1.5 times"
        )
        self.change(w=WIDTH * 3 // 2, h=HEIGHT, fl_x=60, fl_y=60, cx=24, cy=12)
        self.assertEqual(self.train()["warnings"], [])
        with open(self.path("scene", "scene.json")) as file:
            camera = json.load(file)["cameras"][0]
        self.assertEqual([camera[k] for k in ("width", "fx", "fy", "cx")], [WIDTH, 40, 60, 16])

    # ---- Orientation ----

    def store(self, orientation):
        """Stores every picture turned, with the EXIF orientation that turns it back."""
        for i in range(VIEWS):
            p = [self.pixels[i][3 * at : 3 * at + 3] for at in range(WIDTH * HEIGHT)]
            at = lambda x, y: p[y * WIDTH + x]
            if orientation == 6:  # the first stored row is the picture's right side, from top to bottom
                rows = [[at(WIDTH - 1 - v, u) for u in range(HEIGHT)] for v in range(WIDTH)]
            elif orientation == 8:  # the first stored row is the picture's left side, from bottom to top
                rows = [[at(v, HEIGHT - 1 - u) for u in range(HEIGHT)] for v in range(WIDTH)]
            else:
                rows = [[at(WIDTH - 1 - u, HEIGHT - 1 - v) for u in range(WIDTH)] for v in range(HEIGHT)]
            data = b"".join(b"".join(row) for row in rows)
            write(f"{self.set}/images/{i:03d}.png", png(len(rows[0]), len(rows), data, orientation=orientation))

    def test_orientation_shown_by_the_size(self):
        for orientation in (6, 8):
            self.store(orientation)
            self.assertEqual(self.train()["warnings"], [])
            self.eval()
            self.assertEqual(self.photo(), (WIDTH, HEIGHT, self.pixels[0]))

    def test_orientation_not_shown_by_the_size(self):
        self.store(3)
        self.one_warning(self.train(), "9 of 9 photographs have an EXIF orientation", "000.png (orientation 3)")
        # If the size of one picture shows that EXIF orientations are valid, they apply to all pictures.
        self.store(6)
        upside_down = self.path("upside")
        shutil.copytree(self.set, upside_down)
        self.store(3)
        shutil.copy(f"{upside_down}/images/008.png", f"{self.set}/images/008.png")
        self.assertEqual(self.train()["warnings"], [])
        self.eval()
        self.assertEqual(self.photo(), (WIDTH, HEIGHT, self.pixels[0]))

    def test_orientation_of_cameras_as_stored(self):
        self.store(6)
        self.change(w=HEIGHT, h=WIDTH, cx=HEIGHT / 2, cy=WIDTH / 2)
        self.assertEqual(self.info()["warnings"], [])

    # ---- Masks ----

    def masked_psnr(self, *arguments):
        self.train(*arguments)
        return self.eval()["train"]["psnr"]

    def test_masks_mean_the_same_in_every_file(self):
        """A mask's name ends in .png or .png.png. The same mask is stored with soft edges, values of 0 and 1, 16 bits,
        alpha, or half the size."""
        whole = self.masked_psnr()
        grey = self.left_half()
        self.masks(lambda i: png(WIDTH, HEIGHT, grey, 1))
        self.assertEqual(self.info()["views_masked"], VIEWS)
        for place in (self.set + "/", f"{self.set}/./", f"{self.set}/transforms.json"):
            found = json.loads(self.succeeds("info", place, "--json", "-").stdout)
            self.assertEqual((found["views_masked"], found["warnings"]), (VIEWS, []), place)
        found = json.loads(self.succeeds("info", ".", "--json", "-", cwd=self.set).stdout)
        self.assertEqual((found["views_masked"], found["warnings"]), (VIEWS, []))
        half = self.masked_psnr()
        self.assertNotAlmostEqual(half, whole, places=4)
        small = bytes(255 if x < WIDTH // 4 else 0 for y in range(HEIGHT // 2) for x in range(WIDTH // 2))
        wide = lambda high, low: b"".join(bytes(high if v else low) for v in grey)
        kinds = {
            "soft": (png(WIDTH, HEIGHT, self.left_half(128, 127), 1), None),
            "ones": (png(WIDTH, HEIGHT, self.left_half(1), 1), "no value over 1"),
            "16 bits": (png(WIDTH, HEIGHT, wide((255, 255), (0, 0)), 1, 16), None),
            "16 bits, ones": (png(WIDTH, HEIGHT, wide((0, 1), (0, 0)), 1, 16), "no value over 1"),
            "16 bits, bytes": (png(WIDTH, HEIGHT, wide((0, 255), (0, 0)), 1, 16), "no value over 255"),
            "alpha": (png(WIDTH, HEIGHT, b"".join(bytes((255, 255, 255, v)) for v in grey), 4), None),
            "half the size": (png(WIDTH // 2, HEIGHT // 2, small, 1), None),
        }
        for name, (data, warning) in kinds.items():
            with self.subTest(name):
                shutil.rmtree(f"{self.set}/masks")
                self.masks(lambda i: data, ending=".png.png" if name == "ones" else ".png")
                found = self.info()
                self.assertEqual(found["views_masked"], VIEWS)
                if warning:
                    self.one_warning(found, warning, "the first is")
                else:
                    self.assertEqual(found["warnings"], [])
                self.assertAlmostEqual(self.masked_psnr(), half, places=9)

    def test_masks_of_some_and_of_none(self):
        self.masks(lambda i: png(WIDTH, HEIGHT, self.left_half(), 1))
        os.rename(f"{self.set}/masks/004.png", f"{self.set}/masks/spare.png")
        found = self.info()
        self.assertEqual(found["views_masked"], VIEWS - 1)
        self.assertEqual(len(found["warnings"]), 2)
        self.assertIn("1 of 9 photographs have no mask there", found["warnings"][0])
        self.assertIn("004.png", found["warnings"][0])
        self.assertIn("1 of 9 files are masks of no photograph, the first is spare.png", found["warnings"][1])
        os.remove(f"{self.set}/masks/spare.png")
        write(f"{self.set}/masks/003.png", png(WIDTH, WIDTH, bytes(WIDTH * WIDTH), 1))
        self.fails(["info", self.set], "masks/003.png: a mask of 32 x 32 pixels", "32 x 24")

    def test_masks_that_leave_no_pixel(self):
        nothing = png(WIDTH, HEIGHT, bytes(WIDTH * HEIGHT), 1)
        some = png(WIDTH, HEIGHT, self.left_half(), 1)
        self.masks(lambda i: nothing if i in (3, 8) else some)
        self.one_warning(self.train(steps=12), "2 of the 9 masks looked at leave no pixel", "003.png")
        found = self.eval()
        self.assertEqual((found["train"]["views"], found["train"]["without_pixels"]), (6, ["003.png"]))
        self.assertEqual((found["test"]["views"], found["test"]["without_pixels"]), (1, ["008.png"]))
        self.assertIn("2 of 9 views are fully masked", found["warnings"][1])
        for split in ("train", "test"):
            for figures in [found[split], *found[split]["per_view"]]:
                self.assertGreater(figures["psnr"], 1)
                self.assertIsNotNone(figures["ssim"])
        self.masks(lambda i: nothing)
        self.one_warning(self.info(), "leave no pixel of any of the 9 photographs, and are ignored")

    def test_a_mask_for_two_photographs(self):
        frames = self.change()["frames"]
        write(f"{self.set}/images/000.jpg", fixtures.read(f"{self.set}/images/001.png"))
        os.remove(f"{self.set}/images/001.png")
        frames[1]["file_path"] = "images/000.jpg"
        self.change(frames=frames)
        some = png(WIDTH, HEIGHT, self.left_half(), 1)
        for i in (0, *range(2, VIEWS)):
            write(f"{self.set}/masks/{i:03d}.png", some)
        self.one_warning(self.info(), "1 photographs share the mask of another", "000.png")
        write(f"{self.set}/masks/000.jpg.png", some)
        self.assertEqual(self.info()["warnings"], [])

    # ---- Extent and view ----

    def point_set(self, jitter, move=0.0):
        """Writes cameras that turn in one place, except for a jitter. The points lie on a cylinder around them with a
        radius of 4 m."""
        frames, spread = [], [((i * 37) % 9 - 4) / 4 for i in range(VIEWS)]
        for i in range(VIEWS):
            pose = fixtures.ring_pose(2 * math.pi * i / VIEWS, height=0.0)
            for k in range(3):
                pose[k][3] = jitter * spread[(i + 3 * k) % VIEWS]
            frames.append({"file_path": f"images/{i:03d}.png", "transform_matrix": pose})
            row = b""
            for x in range(WIDTH):
                u = (x + 0.5 - WIDTH / 2) / 26
                at = math.atan2(u * pose[1][0] - pose[1][2], u * pose[0][0] - pose[0][2])
                row += bytes((int(128 + 90 * math.sin(3 * at)), int(128 + 90 * math.cos(2 * at)), 100))
            wall = row * HEIGHT
            write(f"{self.set}/images/{i:03d}.png", png(WIDTH, HEIGHT, wall))
        head = "ply\nformat ascii 1.0\nelement vertex 600\nproperty float x\nproperty float y\nproperty float z\n"
        head += "property uchar red\nproperty uchar green\nproperty uchar blue\nend_header\n"
        for i in range(600):
            angle = i * 2.399
            place = f"{4 * math.cos(angle) + move:.4f} {4 * math.sin(angle):.4f} {i / 200 - 1.5:.4f}"
            head += place + " 120 120 120\n"
        write(f"{self.set}/points.ply", head)
        self.change(frames=frames, ply_file_path="points.ply", fl_x=26, fl_y=26)

    def test_tripod(self):
        """The extent of a scene comes from its visible points, not from the jitter of the tripod."""
        scores = []
        for jitter in (0, 1e-3):
            self.point_set(jitter)
            self.train("--max-gaussians", 2000, "--split-every", 0, steps=400)
            scores.append(self.eval()["train"]["psnr"])
        self.assertGreater(scores[0], 15)
        self.assertGreater(scores[1], scores[0] - 1)

    def test_camera_far_off(self):
        """A picture whose registration failed is named. The scene keeps its size and its centre."""
        scores = []
        for away in (0, 500, 1e7):
            self.set = self.path(f"away{away:g}")
            shutil.copytree(self.data, self.set)
            frames = self.change()["frames"]
            frames[4]["transform_matrix"][0][3] += away
            self.change(frames=frames)
            warnings = self.train("--max-gaussians", 1000, steps=200)["warnings"]
            self.assertEqual(len(warnings), away > 0, warnings)
            if away:
                self.assertIn("1 of 9 cameras stand far from the others, the first is 004.png", warnings[0])
            views = self.eval()["train"]["per_view"]
            scores.append(sum(v["psnr"] for v in views if v["name"] != "004.png") / (len(views) - 1))
            self.succeeds("render", self.path("scene"), "--path", "orbit", "-n", 4, "-o", self.path("orbit"))
            for i in range(4):
                self.assertGreater(len(set(read_png(self.path("orbit", f"{i:05d}.png"))[4])), 20)
        self.assertGreater(scores[0], 15)
        self.assertGreater(min(scores[1:]), scores[0] - 1.5)
        self.folder = self.path("two")
        make = fixtures.make_dataset(self.path("set"), VIEWS, WIDTH, HEIGHT)
        self.set = make
        frames = self.change()["frames"]
        for frame in frames[:2]:
            frame["transform_matrix"][0][3] += 500
        self.change(frames=frames)
        self.assertEqual(self.info()["warnings"], [])  # two far cameras belong to a second part of the capture

    def test_nothing_in_view(self):
        self.point_set(0, move=-1e6)
        content = self.change()
        self.change(frames=[content["frames"][4]])  # the only camera looks the other way
        beside, unseen = self.info()["warnings"]
        self.assertIn("8 of 9 pictures in the folders of the ones used are not in it", beside)
        self.assertIn("none of the 600 points looked at is in view of any camera", unseen)
        self.assertIn(
            "nothing of the scene is in view of its 1 training views", " ".join(self.train(steps=3)["warnings"])
        )
        self.assertIn("nothing of the scene is in view in any of 1 views", " ".join(self.eval()["warnings"]))
        drawn = self.succeeds("render", self.path("scene"), "--split", "all", "-o", self.path("drawn"), "--json", "-")
        self.one_warning(json.loads(drawn.stdout), "nothing of the scene is in view in any of 1 pictures")

    # ---- Exposure ----

    def exposed(self, change):
        """Trains on photographs that are alternately brighter and darker by `change`. Returns the PSNR with and without
        fitted exposures, and the scene.json with them."""
        for i in range(VIEWS):
            factor = 1 + change if i % 2 else 1 - change
            pixels = bytes(min(255, round(v * factor)) for v in self.pixels[i])
            write(f"{self.set}/images/{i:03d}.png", png(WIDTH, HEIGHT, pixels))
        scene = self.path("scene")
        more = ["-o", scene, "-n", 600, "--preview-every", 0, "--overwrite", "--random-points", 200, "--split-every", 0]
        said = [
            line
            for line in self.succeeds("train", self.set, *more).stdout.splitlines()
            if line.startswith("exposures:")
        ]
        self.assertEqual(len(said), 1, said)
        with open(f"{scene}/scene.json") as file:
            decided = json.load(file)
        fitted = self.eval()["train"]["psnr"]
        self.succeeds("train", self.set, *more, "--no-exposure", "--quiet")
        return fitted, self.eval()["train"]["psnr"], decided

    def test_exposures(self):
        """Exposures are kept if the photographs need them. scene.json has their gain and bytes."""
        fitted, without, scene = self.exposed(0.15)
        entry = scene["modelled"]["exposure"]
        self.assertTrue(entry["modelled"], entry)
        self.assertGreater(entry["gain_db"], max(entry["least_gain_db"], entry["standard_error_db"]))
        self.assertGreater(fitted, without + 1)

        # Its bytes are those of the gains and offsets in scene.json.
        bare = [{k: v for k, v in view.items() if k not in ("gain", "offset")} for view in scene["cameras"]]
        digits = sum(len(repr(x)) for view in scene["cameras"] for k in ("gain", "offset") for x in view.get(k, []))
        self.assertNotEqual(bare, scene["cameras"])
        self.assertGreater(entry["bytes"], 0.8 * digits)
        self.assertLess(entry["bytes"], os.path.getsize(self.path("scene", "scene.json")))

        fitted, without, scene = self.exposed(0)
        entry = scene["modelled"]["exposure"]
        self.assertFalse(entry["modelled"], entry)
        self.assertLess(entry["gain_db"], entry["least_gain_db"])
        self.assertGreater(entry["bytes_saved"], 0)
        self.assertFalse(any("gain" in view for view in scene["cameras"]))
        self.assertLess(abs(fitted - without), 1)

    def test_forced_exposures(self):
        """With 0 or 1 nothing is tested."""
        for value in (0, 1):
            done = self.train("--set", f"exposure={value}", "--overwrite", steps=60)
            with open(self.path("scene", "scene.json")) as file:
                entry = json.load(file)["modelled"]["exposure"]
            self.assertEqual((entry["modelled"], "gain_db" in entry), (bool(value), False), done)

    def test_decisions_are_told(self):
        """info and the report show each decision with its reason and figures, and its time from report.json."""
        parts = ["sky", "exposure", "sh", "camera poses", "light"]
        text = self.succeeds("info", self.set).stdout
        for part, answer in zip(parts, ["no", "open", "degree 3", "no", "no"]):
            self.assertRegex(text, rf"(?m)^  {part} +{answer} ")
        self.train("--overwrite", steps=1000)
        facts = json.loads(self.succeeds("info", self.path("scene"), "--json", "-").stdout)
        text = self.succeeds("info", self.path("scene")).stdout
        with open(self.path("scene", "report.html"), encoding="utf-8") as file:
            page = file.read()
        self.assertNotIn("<tbody>\n</tbody>", page)
        for part in parts:
            entry = facts["modelled"][part.replace(" ", "_")]
            self.assertIsInstance(entry["modelled"], bool)
            self.assertRegex(text, rf"(?m)^  {part} +(yes|no|degree \d) .*{entry['why']}")
            self.assertIn(entry["why"], page)
        self.assertTrue(0 < facts["modelled"]["sky"]["share_of_background"] < 1)
        self.assertTrue(math.isfinite(facts["modelled"]["camera_poses"]["gain_db"]))
        sh = facts["modelled"]["sh"]
        terms = {0: 0, 1: 36, 2: 96, 3: 180}  # bytes per Gaussian
        stored = sum(terms[model["sh_degree"]] * model["gaussians"] for model in facts["models"])
        self.assertEqual(sh["degree"], max(model["sh_degree"] for model in facts["models"]))
        self.assertEqual(
            sh["bytes_saved" if sh["degree"] == 0 else "bytes"], stored if sh["degree"] else 180 * facts["gaussians"]
        )
        self.assertTrue(sh["loss_db"] <= 0.05 and sh["loss_db"] <= sh["gain_db"], sh)
        times = facts["modelled_times"]["exposure"]
        self.assertTrue(times["steps"] >= 300 and times["seconds"] > 0 and times["test_seconds"] > 0, times)
        os.remove(self.path("scene", "report.json"))
        facts = json.loads(self.succeeds("info", self.path("scene"), "--json", "-").stdout)
        self.assertNotIn("modelled_times", facts)

    def test_held_out_exposures(self):
        """A held-out photograph gets the mean exposure of its neighbours. If it has only one neighbour, it gets the
        neighbour's exposure."""
        for i in range(VIEWS):
            write(
                f"{self.set}/images/{i:03d}.png",
                png(WIDTH, HEIGHT, bytes(round(v * (0.5 + 0.06 * i)) for v in self.pixels[i])),
            )
        self.train("--split-every", 4, steps=600)
        with open(self.path("scene", "scene.json")) as file:
            views = json.load(file)["cameras"]
        self.assertEqual([i for i, view in enumerate(views) if view["test"]], [0, 4, 8])
        gains = [view["gain"] for view in views]
        for i, neighbours in ((0, [1, 1]), (4, [3, 5]), (8, [7, 7])):
            for c in range(3):
                self.assertAlmostEqual(gains[i][c], sum(gains[k][c] for k in neighbours) / 2, 9)
        self.assertGreater(gains[5][0], gains[3][0])

    # ---- Evaluation ----

    def test_one_picture(self):
        content = self.change()
        self.change(frames=content["frames"][:1])
        self.assertEqual(self.info()["views_train"], 1)
        for arguments in ([], ["--split-every", "0"], ["--reconstruction"]):
            self.train(*arguments)
            self.assertEqual(self.eval()["train"]["views"], 1)

    def test_picture_options_of_eval(self):
        self.train("--background", "1,1,1", steps=30)
        base = self.eval()["train"]["psnr"]
        for arguments in (["--background", "0,0,0"], ["--antialiased"], ["--near", "2.8"], ["--low-pass", "3"]):
            self.assertNotAlmostEqual(self.eval(*arguments)["train"]["psnr"], base, places=3, msg=arguments)
        self.assertEqual(self.eval("--no-antialiased")["train"]["psnr"], base)


if __name__ == "__main__":
    fixtures.main()
