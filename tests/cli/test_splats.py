# SPDX-License-Identifier: Apache-2.0
"""Tests splat files as other programs write them, and the data of a scene that each format stores and returns."""

import json
import math
import os
import struct

from fixtures import Case, main, ply_bytes, png_bytes, read, run, some_splats, splat

FACTS = ("antialiased", "up", "origin")


def with_comments(rows, *comments):
    lines = "".join(f"comment {comment}\n" for comment in comments)
    return ply_bytes(rows).replace(b"element vertex", lines.encode() + b"element vertex")


def renamed(data, *pairs):
    """Returns the bytes of a PLY file with renamed properties."""
    for old, new in pairs:
        data = data.replace(f"float {old}\n".encode(), f"float {new}\n".encode())
    return data


class Splats(Case):
    def info(self, name, *options):
        """Returns the facts that pags info writes about a file."""
        self.works("info", self.path(name), "--json", self.path("info.json"), *options)
        return json.loads(read(self.path("info.json")))

    def works(self, *arguments):
        done = self.succeeds(*arguments)
        return done.stdout + done.stderr

    def refuses(self, name, *words):
        self.fails(["info", self.path(name)], *words)


class Reading(Splats):
    def test_infinite_values_are_limits(self):
        rows = some_splats()
        rows[3][9], rows[4][9], rows[5][12] = math.inf, -math.inf, -math.inf
        self.write("inf.ply", ply_bytes(rows))
        facts = self.info("inf.ply", "--strict")
        self.assertEqual((facts["gaussians"], facts["warnings"]), (40, []))

    def test_rows_that_are_not_finite_are_left_out(self):
        rows = some_splats()
        rows[7][0], rows[9][13], rows[11][10] = math.nan, math.nan, math.inf
        self.write("nan.ply", ply_bytes(rows))
        facts = self.info("nan.ply")
        self.assertEqual(facts["gaussians"], 37)
        self.assertEqual(len(facts["warnings"]), 1)
        self.assertIn(
            "3 of 40 Gaussians are left out, since a value isn't finite; the first is 7 (its position)",
            facts["warnings"][0],
        )
        self.fails(["info", self.path("nan.ply"), "--strict"], "left out")
        for row in rows:
            row[2] = math.nan
        self.write("all.ply", ply_bytes(rows))
        self.refuses("all.ply", "none in any of 40 Gaussians")

    def test_reduced_kinds(self):
        whole = ply_bytes(some_splats())
        flat = renamed(whole, ("scale_2", "unused"))
        self.write("flat.ply", flat)
        self.assertEqual(self.info("flat.ply")["warnings"], [])
        self.assertIn("2D Gaussian splats", self.works("info", self.path("flat.ply")))
        self.write("round.ply", renamed(flat, ("scale_1", "unused2")))
        self.assertIn("taken as round", self.info("round.ply")["warnings"][0])
        self.write("solid.ply", renamed(whole, ("opacity", "unused")))
        self.assertIn("taken as opaque", self.info("solid.ply")["warnings"][0])
        self.write("level.ply", renamed(whole, *[(f"rot_{k}", f"unused{k}") for k in range(4)]))
        self.assertIn("not rotated", self.info("level.ply")["warnings"][0])
        points = renamed(whole, ("scale_0", "unused"))
        self.write("points.ply", points)
        self.refuses("points.ply", "no property 'scale_0'", "points")

    def test_colours_as_bytes(self):
        rows = [splat(0, 0, 2, (1, 0.5, 0)), splat(1, 0, 2, (0.2, 0.4, 0.6))]
        head = ["ply", "format binary_little_endian 1.0", "element vertex 2"]
        names = ["x", "y", "z", "opacity", "scale_0", "scale_1", "scale_2", "rot_0", "rot_1", "rot_2", "rot_3"]
        head += [f"property float {name}" for name in names] + [
            f"property uchar {name}" for name in ("red", "green", "blue")
        ]
        body = b"".join(
            struct.pack("<11f3B", *row[:3], *row[9:], *rgb) for row, rgb in zip(rows, [(255, 128, 0), (51, 102, 153)])
        )
        self.write("rgb.ply", "\n".join(head + ["end_header", ""]).encode() + body)
        self.works("export", self.path("rgb.ply"), self.path("rgb.splat"))
        self.works("export", self.write("dc.ply", ply_bytes(rows)), self.path("dc.splat"))
        rgb, dc = read(self.path("rgb.splat")), read(self.path("dc.splat"))
        self.assertEqual(rgb[24:27], bytes([255, 128, 0]))
        self.assertEqual(rgb[56:59], dc[56:59])

    def test_degree_four(self):
        def ply(per_channel):
            count = 3 * per_channel
            head = ply_bytes(some_splats()[:2]).split(b"property float opacity")[0]
            head += b"".join(b"property float f_rest_%d\n" % i for i in range(count))
            head += b"".join(
                f"property float {n}\n".encode()
                for n in ("opacity", "scale_0", "scale_1", "scale_2", "rot_0", "rot_1", "rot_2", "rot_3")
            )
            rest = [channel + k / 100 if k < 15 else 99 for channel in range(3) for k in range(per_channel)]
            return (
                head
                + b"end_header\n"
                + b"".join(struct.pack(f"<{17 + count}f", *row[:9], *rest, *row[9:]) for row in some_splats()[:2])
            )

        self.write("four.ply", ply(24))
        self.write("three.ply", ply(15))
        facts = self.info("four.ply")
        self.assertIn("degree 4 are dropped", facts["warnings"][0])
        self.works("export", self.path("four.ply"), self.path("a.ply"))
        self.works("export", self.path("three.ply"), self.path("b.ply"))
        self.assertEqual(read(self.path("a.ply")), read(self.path("b.ply")))

    def test_flags_of_all_writers(self):
        for comment, antialiased in [
            ("SplatRenderMode: mip", True),
            ("splatrendermode:  MIP ", True),
            ("SplatRenderMode: default", False),
            ("antialiased 1", True),
            ("antialiased 0", False),
            ("antialiased: true", True),
            ("train_flags antialiasing", True),
        ]:
            self.write("flag.ply", with_comments(some_splats(), comment))
            self.assertEqual(self.info("flag.ply")["antialiased"], antialiased, comment)
        for comment, up in [
            ("Vertical Axis: z", "+z"),
            ("Vertical axis: y", "-y"),
            ("vertical axis: 0 1 0", "+y"),
            ("Vertical axis: 0 -1 0", "-y"),
        ]:
            self.write("up.ply", with_comments(some_splats(), comment))
            self.assertEqual(self.info("up.ply")["up"], up, comment)

    def test_foreign_files_are_named(self):
        self.write("a.ply", "version https://git-lfs.github.com/spec/v1\noid sha256:0\nsize 5\n")
        self.refuses("a.ply", "Git LFS pointer", "git lfs pull")
        self.write("b.splat", "version https://git-lfs.github.com/spec/v1\noid sha256:00\nsize 9\n")
        self.refuses("b.splat", "Git LFS pointer")
        self.write("c.ksplat", bytes(4096))
        self.refuses("c.ksplat", ".ksplat", "splat-transform")
        self.write("e.json", "version https://git-lfs.github.com/spec/v1\noid sha256:00\nsize 9\n")
        self.refuses("e.json", "Git LFS", "git lfs pull")
        self.write("f.ply", "<!DOCTYPE html><html></html>")
        self.refuses("f.ply", "a web page")
        foreign = self.write("d.json", '{"nodes": []}')
        self.refuses("d.json", "not a data set: expected 'frames'")
        self.fails(["render", foreign, "-o", self.path("out")], "a JSON file of another program")

    def test_formats_that_are_not_read_are_named(self):
        """The message names the format found in the content, or else in the file's name. All verbs do this, also for a
        folder."""
        lcc = '{"version": "5.0", "totalSplats": 3, "cellLengthX": 30, "encoding": "COMPRESS"}'
        tiles = '{"asset": {"version": "1.1"}, "geometricError": 9, "root": {}}'
        levels = '{"version": 1, "lodLevels": 2, "filenames": []}'
        for name, data, *words in [
            ("meta.lcc", lcc, "XGRIDS", "splat-transform"),
            ("renamed.json", lcc, "XGRIDS"),
            ("a.ksplat", bytes(4096), ".ksplat", "splat-transform"),
            ("b.rad", b"RAD0" + bytes(60), "Spark", "export a .ply"),
            ("c.bin", b"RAD0" + bytes(60), "Spark"),
            ("d.spx", b"spx\1" + bytes(124), "Reall3D", "gsbox"),
            ("tileset.json", tiles, "3D Tiles", ".glb"),
            ("other.json", tiles, "3D Tiles"),
            ("lod-meta.json", levels, "streamed SOG", "meta.json"),
            ("e.ssproj", b"PK\5\6" + bytes(18), "SuperSplat"),
            ("f.usdc", b"PXR-USDC" + bytes(80), "USD"),
        ]:
            with self.subTest(name):
                path = self.write(f"{name.split('.')[0]}/{name}", data)
                self.fails(["info", path], path, *words)
                self.fails(["export", path, self.path("out.ply")], path, *words)
                if name != "c.bin":
                    self.fails(["train", path, "-o", self.path("x")], path, *words)
                if name in ("meta.lcc", "tileset.json", "b.rad"):
                    self.fails(["render", os.path.dirname(path), "-o", self.path("x")], f"holds {name}", *words)
                    self.fails(["info", os.path.dirname(path)], f"holds {name}", *words)

    def test_name_of_a_compressed_ply(self):
        """Other programs expect a compressed form in a file whose name ends in .compressed.ply. PAGS doesn't write this
        form and refuses the name."""
        plain = self.write("a.ply", ply_bytes(some_splats()))
        for name in ("b.compressed.ply", "B.Compressed.PLY"):
            self.fails(["export", plain, self.path(name)], name, "compressed", ".sog")
            self.assertFalse(os.path.exists(self.path(name)))
        self.works("export", plain, self.path("compressed.ply"))

    def test_header_variants(self):
        whole = ply_bytes(some_splats())
        self.write("blank.ply", whole.replace(b"end_header\n", b"end_header \n"))
        self.write("early.ply", whole.replace(b"ply\n", b"ply\ncomment " + b"x" * 400 + b"\n", 1))
        for name in ("blank.ply", "early.ply"):
            self.assertEqual(self.info(name)["gaussians"], 40)


class Axes(Splats):
    """The axes of an SPZ file come from its record of axes, or else are RUB. An option overrides both."""

    def setUp(self):
        super().setUp()
        self.write("a.ply", ply_bytes([splat(1, 2, 3, (0.5, 0.5, 0.5)), splat(0, 0, 0, (0.5, 0.5, 0.5))]))

    def without_record(self, name):
        """Removes the record of axes from a version 4 file."""
        data = bytearray(read(self.path(name)))
        self.assertEqual(struct.unpack("<II", data[32:40]), (0xADBE0003, 4))
        table = struct.unpack("<I", data[16:20])[0]
        data[14] &= ~2
        data[16:20] = struct.pack("<I", 32)
        return self.write("plain.spz", bytes(data[:32] + data[table:]))

    def test_record_specification_and_option(self):
        for axes, as_rub in [("rub", ([0, 0, 0], [1, 2, 3])), ("rdf", ([0, -2, -3], [1, 0, 0]))]:
            self.works("export", self.path("a.ply"), self.path("b.spz"), "--spz-version", "4", "--spz-axes", axes)
            facts = self.info("b.spz", "--strict")
            self.assertEqual(facts["axes"], axes.upper() + ", by the record")
            self.assertEqual(facts["bounds_hi"], [1, 2, 3])
            self.without_record("b.spz")
            facts = self.info("plain.spz", "--strict")
            self.assertEqual(facts["axes"], "RUB, by the specification")
            self.assertEqual((facts["bounds_lo"], facts["bounds_hi"]), as_rub)
            facts = self.info("plain.spz", "--axes", axes.upper())
            self.assertEqual(facts["axes"], axes.upper() + ", by the option")
            self.assertEqual(facts["bounds_hi"], [1, 2, 3])

    def test_other_files_take_the_option(self):
        facts = self.info("a.ply", "--axes", "rub")
        self.assertEqual((facts["bounds_lo"], facts["bounds_hi"]), ([0, -2, -3], [1, 0, 0]))
        facts = self.info("a.ply", "--axes", "rfu")
        self.assertEqual((facts["bounds_lo"], facts["bounds_hi"]), ([0, -3, 0], [1, 0, 2]))
        self.works("export", self.path("a.ply"), self.path("a.pagsz"))
        self.fails(["info", self.path("a.pagsz"), "--axes", "rub"], "a packed file's axes are known")


class RoundTrips(Splats):
    """Tests the antialiased flag, origin and up axis of a scene in each format."""

    def setUp(self):
        super().setUp()
        self.write(
            "a.ply",
            with_comments(some_splats(), "SplatRenderMode: mip", "Vertical axis: z", "offset 500000.5 4600000 -100"),
        )
        facts = self.info("a.ply")
        self.wanted = [facts[key] for key in FACTS]
        self.assertEqual(self.wanted, [True, "+z", [500000.5, 4600000, -100]])

    def test_formats_that_store_the_facts(self):
        for name, options in [
            ("b.ply", ()),
            ("b.pagsz", ()),
            ("b.spz", ()),
            ("c.spz", ("--spz-version", "4")),
            ("D.SPZ", ()),
            ("E.Ply", ()),
        ]:
            self.works("export", self.path("a.ply"), self.path(name), "--strict", *options)
            facts = self.info(name, "--strict")
            self.assertEqual([facts[key] for key in FACTS], self.wanted, name)

    def test_the_least_alpha(self):
        self.write("cut.ply", with_comments(some_splats(), "alpha_min 0.0157"))
        self.assertAlmostEqual(self.info("cut.ply")["alpha_min"], 0.0157, 6)
        self.works("export", self.path("cut.ply"), self.path("cut.pagsz"))
        self.assertAlmostEqual(self.info("cut.pagsz")["alpha_min"], 0.0157, 6)
        done = run("export", self.path("cut.ply"), self.path("plain.ply"))
        self.assertEqual(done.returncode, 0, done.stderr)
        self.assertIn("other programs cut alpha at 1/255", done.stdout + done.stderr)
        self.assertIn("PAGS changes this file's back", done.stdout + done.stderr)
        self.write("bad.ply", with_comments(some_splats(), "alpha_min 1.5"))
        self.fails(["info", self.path("bad.ply"), "--strict"], "its alpha_min, 1.5, isn't from 1/255 to 1")

    def test_converted_gaussians_are_changed_back(self):
        """Other programs don't know a Gaussian's least alpha. So .ply, .spz and .glb store changed Gaussians, which are
        changed back when they are read."""
        self.write("cut.ply", with_comments(some_splats(), "alpha_min 0.0157"))
        self.works("export", self.path("cut.ply"), self.path("cut.pagsz"))
        wanted = self.values("cut.ply")
        for name, bound in (("plain.ply", 1e-5), ("plain.spz", 0.1), ("plain.glb", 1e-4)):
            done = run("export", self.path("cut.ply"), self.path(name), *(["--splats"] if name.endswith("glb") else []))
            if "this build writes" in done.stderr:
                continue
            self.assertEqual(done.returncode, 0, done.stderr)
            self.assertAlmostEqual(self.info(name)["alpha_min"], 0.0157, 6)
            self.works("export", self.path(name), self.path("again.pagsz"))
            self.assertAlmostEqual(self.info("again.pagsz")["alpha_min"], 0.0157, 6)
            self.works("export", self.path(name), self.path("again.ply"))
            for row, true in zip(self.values("again.ply"), self.values("plain.ply")):
                for k in (9, 10, 11, 12):  # the logit of the opacity, the logarithms of the scales
                    self.assertAlmostEqual(row[k], true[k], delta=bound)
        changed = self.values("plain.ply")
        for row, true in zip(changed, wanted):
            o, x = 1 / (1 + math.exp(-true[9])), 1 / (1 + math.exp(-true[9])) / 0.0157
            seen = (o - 0.0157) / (1 - 0.0157)
            self.assertAlmostEqual(row[9], math.log(seen / (1 - seen)), 4)
            self.assertAlmostEqual(row[10] - true[10], 0.5 * math.log(1 - math.log(x) / (x - 1)), 4)
        for text in ("7", "1e-9", "-0.02"):
            self.write("bad.ply", with_comments(some_splats(), f"converted_from_alpha_min {text}"))
            self.fails(["info", self.path("bad.ply"), "--strict"], "had the alpha_min", "not used")

    def values(self, name):
        """Returns the rows of a PLY file as they are stored."""
        head, body = read(self.path(name)).split(b"end_header\n", 1)
        return list(struct.iter_unpack(f"<{head.count(b'property float')}f", body))

    def test_gltf_stores_facts_as_extras(self):
        done = run("export", self.path("a.ply"), self.path("B.GLB"), "--splats", "--strict")
        if "this build writes" in done.stderr:
            self.skipTest("a build without glTF")
        self.assertEqual(done.returncode, 0, done.stderr)
        data = read(self.path("B.GLB"))
        extras = json.loads(data[20 : 20 + struct.unpack("<I", data[12:16])[0]])["asset"]["extras"]
        self.assertEqual(extras, {"antialiased": True, "origin": [500000.5, 4600000, -100], "up": "z"})

    def test_splat_warns_of_lost_facts(self):
        self.works("export", self.path("a.ply"), self.path("b.splat"), "--json", self.path("x.json"))
        warnings = json.loads(read(self.path("x.json")))["warnings"]
        self.assertEqual(len(warnings), 1)
        for word in ("antialiased", "500000.5 4600000 -100", "up axis z"):
            self.assertIn(word, warnings[0])
        self.fails(["export", self.path("a.ply"), self.path("b.splat"), "--strict"], "can't hold")

    def test_option_up(self):
        self.assertEqual(self.info("a.ply", "--up", "y")["up"], "+y")
        self.write("bare.ply", ply_bytes(some_splats()))
        self.assertEqual(self.info("bare.ply")["up"], "-y")
        self.works("export", self.path("bare.ply"), self.path("z.ply"), "--up", "z")
        self.assertEqual(self.info("z.ply")["up"], "+z")
        said = [self.info("a.ply", "--up", "y"), self.info("bare.ply"), self.info("z.ply")]
        self.assertEqual([facts["up_from"] for facts in said], ["option", "default", "file"])
        self.assertIn("-y, assumed; --up overrides", self.works("info", self.path("bare.ply")))
        self.assertNotIn("assumed", self.works("info", self.path("z.ply")))
        self.works(
            "render", self.path("bare.ply"), "--up", "z", "-n", "2", "--downscale", "16", "-o", self.path("pictures")
        )

    def test_spz_beyond_its_range(self):
        rows = some_splats()
        rows[0][0], rows[1][10] = 2500, 8
        self.write("far.ply", ply_bytes(rows))
        said = self.works("export", self.path("far.ply"), self.path("far.spz"))
        self.assertIn("in steps of 0.000488281 m", said)
        self.assertIn("1 Gaussians beyond SPZ's range of sigma", said)
        self.assertAlmostEqual(self.info("far.spz")["bounds_hi"][0], 2500, delta=0.001)
        rows[0][1] = 4.6e6
        self.write("utm.ply", ply_bytes(rows))
        self.fails(["export", self.path("utm.ply"), self.path("utm.spz"), "--strict"], "in steps of 1 m")
        self.assertAlmostEqual(self.info("utm.spz")["bounds_hi"][1], 4.6e6, delta=1)


class Points(Splats):
    """Tests the ply_file_path of a transforms.json."""

    def dataset(self, ply):
        frame = {"file_path": "a.png", "transform_matrix": [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 2], [0, 0, 0, 1]]}
        head = {
            "w": 16,
            "h": 16,
            "fl_x": 16,
            "fl_y": 16,
            "cx": 8,
            "cy": 8,
            "ply_file_path": "points.ply",
            "frames": [frame],
        }
        self.write("d/transforms.json", json.dumps(head))
        self.write("d/points.ply", ply)
        self.write("d/a.png", png_bytes(16, 16, bytes(768)))
        return self.info("d", "--split-every", "0")

    def points(self, form, values, types="float", before="", comment=""):
        order = ">" if form == "binary_big_endian" else "<"
        head = f"ply\n{comment}format {form} 1.0\n{before}element vertex {len(values)}\n"
        head += "".join(f"property {types} {axis}\n" for axis in "xyz") + "end_header\n"
        code = {"float": "f", "double": "d"}[types]
        return (
            head.encode() + (bytes(4) if before else b"") + b"".join(struct.pack(f"{order}3{code}", *v) for v in values)
        )

    def test_points_of_other_programs(self):
        values = [(i / 7, i / 9, i / 11) for i in range(60)]
        one = "element camera 1\nproperty float f\n"
        for ply in [
            self.points("binary_little_endian", values),
            self.points("binary_big_endian", values),
            self.points("binary_little_endian", values, "double"),
            self.points("binary_little_endian", values, comment="comment " + "x" * 400 + "\n"),
            self.points("binary_little_endian", values, before=one),
            ply_bytes([splat(*v, (0.5, 0.5, 0.5)) for v in values]),
        ]:
            facts = self.dataset(ply)
            self.assertEqual((facts["points"], facts["points_random"], facts["warnings"]), (60, False, []))

    def test_points_that_are_not_finite(self):
        values = [(i / 7, i / 9, i / 11) for i in range(60)]
        values[5] = (math.nan, 0, 0)
        facts = self.dataset(self.points("binary_little_endian", values))
        self.assertEqual(facts["points"], 59)
        self.assertIn("1 of 60 points are left out", facts["warnings"][0])
        self.assertIn("vertex 5", facts["warnings"][0])


if __name__ == "__main__":
    main()
