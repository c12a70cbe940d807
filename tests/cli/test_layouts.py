# SPDX-License-Identifier: Apache-2.0
"""Tests driving sets as users have them. Unread files and impossible values are reported."""

import array
import json
import math
import os
import shutil
import struct
import zlib

import fixtures
from fixtures import Case, read, write


def grey_png(width, height, pixels, bits=8):
    """Returns the bytes of a grey PNG file. `pixels` holds one number per pixel, row by row."""

    def chunk(kind, data):
        return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))

    step = bits // 8
    raw = b"".join(int(p).to_bytes(step, "big") for p in pixels)
    rows = b"".join(b"\0" + raw[y * width * step : (y + 1) * width * step] for y in range(height))
    header = struct.pack(">IIBBBBB", width, height, bits, 0, 0, 0, 0)
    return b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", header) + chunk(b"IDAT", zlib.compress(rows)) + chunk(b"IEND", b"")


class StreetCase(Case):
    """Tests that change a small street. self.street is a fresh copy."""

    @classmethod
    def setUpClass(cls):
        cls.origin = os.path.join(cls.shared_folder(), "street")
        done = fixtures.run(
            *[
                "synth",
                "street",
                "-q",
                "-o",
                cls.origin,
                "--frames",
                "6",
                "--size",
                "96x54",
                "--cameras",
                "2",
                "--no-shifts",
            ]
        )
        assert done.returncode == 0, done.stderr

    def setUp(self):
        super().setUp()
        self.street = self.path("street")
        shutil.copytree(self.origin, self.street)

    def at(self, *names):
        return os.path.join(self.street, *names)

    def names(self, folder):
        return sorted(os.listdir(self.at(folder)))

    def rename_all(self, folder, change):
        for name in self.names(folder):
            os.rename(self.at(folder, name), self.at(folder, change(name)))

    def warnings(self, *more):
        """Returns the warnings of pags info. Its --json holds the same warnings."""
        done = self.succeeds("info", self.street, "--json", "-", *more)
        said = json.loads(done.stdout)["warnings"]
        for line in said:
            self.assertIn(f"warning: {line}", done.stderr)
        return said

    def warns(self, *words):
        """Asserts that there is one warning with each of the words, and that --strict makes it an error."""
        said = self.warnings()
        self.assertEqual(len(said), 1, said)
        for word in words:
            self.assertIn(word, said[0])
        self.fails(["info", self.street, "--strict"], *words)

    def refused(self, *words):
        return self.fails(["info", self.street], *words)

    def repaint(self, folder, change):
        """Rewrites the masks of a folder. change(value, y, height) returns the new value of a pixel."""
        for name in self.names(folder):
            width, height, channels, bits, pixels = fixtures.read_png(self.at(folder, name))
            assert channels == 1 and bits == 8
            new = [change(value, i // width, height) for i, value in enumerate(pixels)]
            write(self.at(folder, name), grey_png(width, height, new))


class UnreadTest(StreetCase):
    def test_a_good_set_gives_none(self):
        self.assertEqual(self.warnings(), [])
        self.assertEqual(self.warnings("--frames", "0-2", "--cameras", "1"), [])

    def test_masks_of_another_name(self):
        self.rename_all("sky_masks", lambda name: name.replace(".png", ".PNG"))
        self.warns("sky_masks: 12 of 12 files aren't read", "the first is 000_0.PNG", "names like 000_0.png")

    def test_masks_with_other_digits(self):
        self.rename_all("semantic", lambda name: "000" + name)
        self.warns("semantic: 12 of 12 files aren't read", "000000_0.png", "names like 000_0.png")

    def test_some_masks_only(self):
        os.rename(self.at("dynamic_masks/all/003_1.png"), self.at("dynamic_masks/all/003-1.png"))
        self.warns("dynamic_masks/all: 1 of 12 files", "003-1.png")

    def test_masks_outside_their_folder(self):
        shutil.copytree(self.at("dynamic_masks/all"), self.at("dynamic_masks/car"))
        shutil.copy(self.at("dynamic_masks/all/000_0.png"), self.at("dynamic_masks/000_0.png"))
        self.warns("dynamic_masks: 2 of 5 entries aren't read", "000_0.png", "all, vehicle and human")

    def test_sweeps_of_another_form(self):
        self.rename_all("lidar", lambda name: name.replace(".bin", ".npy"))
        self.warns("lidar: 6 of 6 files aren't read", "000.npy", "names like 000.bin")

    def test_sweeps_without_photographs(self):
        shutil.copy(self.at("lidar/000.bin"), self.at("lidar/017.bin"))
        self.warns("lidar: 1 of 7 files", "no photograph of their number", "017.bin")

    def test_photographs_of_another_name(self):
        os.rename(self.at("images/002_1.png"), self.at("images/front_002.png"))
        shutil.rmtree(self.at("truth"))
        lines = [line for line in self.warnings("--allow-missing") if "images:" in line]
        self.assertIn("1 of 12 files aren't read, the first is front_002.png", lines[0])

    def test_folders_of_another_name(self):
        os.rename(self.at("sky_masks"), self.at("Sky"))
        self.warns("1 folders aren't read", "Sky with 12 files, expected as sky_masks")

    def test_folders_of_no_known_name(self):
        shutil.copytree(self.at("lidar"), self.at("top_scanner"))
        self.warns("top_scanner with 6 files")

    def test_sweeps_and_times_beside_the_folders(self):
        shutil.rmtree(self.at("lidar"))
        os.rename(self.at("timestamps.json"), self.at("times_and_timestamps.json"))
        write(self.at("pointcloud.npz"), b"PK")
        self.warns("2 files aren't read", "pointcloud.npz")

    def test_labels_of_another_name(self):
        os.rename(self.at("instances/instances_info.json"), self.at("instances/info.json"))
        os.remove(self.at("instances/frame_instances.json"))
        self.warns("instances: 1 of 1 entries aren't read", "info.json", "expected instances_info.json")

    def test_masks_in_a_folder_for_each_camera(self):
        os.makedirs(self.at("sky_masks/0"))
        for name in self.names("sky_masks"):
            if name.endswith("_0.png"):
                os.rename(self.at("sky_masks", name), self.at("sky_masks/0", name))
        self.warns("sky_masks: 1 of 7 files aren't read, the first is 0")

    def test_files_of_other_tools_are_ignored(self):
        write(self.at("semantic/segment.json"), "{}")
        write(self.at("README.md"), "a street")
        write(self.at("lidar/.DS_Store"), b"")
        shutil.copytree(self.at("images"), self.at("truth/images"))
        self.assertEqual(self.warnings(), [])

    def test_the_folders_of_street_gaussians_are_read(self):
        os.rename(self.at("sky_masks"), self.at("sky_mask"))
        os.rename(self.at("dynamic_masks/all"), self.at("dynamic_mask"))
        shutil.rmtree(self.at("dynamic_masks"))
        done = self.succeeds("info", self.street)
        self.assertIn("12 have sky_masks, 12 semantic, 12 dynamic_masks", done.stdout)
        self.assertEqual(self.warnings(), [])


class MaskTest(StreetCase):
    def test_masks_of_0_and_1_are_masks(self):
        self.repaint("sky_masks", lambda value, y, height: value // 255)
        self.warns("sky_masks: masks of 0 and 1, as 003_0.png is", "1 is taken as white", "12 masks")
        shutil.rmtree(self.at("lidar"))
        done = self.succeeds("train", self.street, "-o", self.path("scene"), "--iterations", "1", *fixtures.SMALL)
        self.assertIn("sky modelled", done.stdout)
        self.assertIn("warning: ", done.stderr)

    def test_empty_mask_among_others(self):
        self.repaint("dynamic_masks/all", lambda value, y, height: 1 if y > 40 else 0)
        name = self.at("dynamic_masks/all/003_0.png")
        write(name, grey_png(96, 54, [0] * 96 * 54))
        self.warns("dynamic_masks/all: masks of 0 and 1")

    def test_masks_without_white(self):
        self.repaint("sky_masks", lambda value, y, height: 70 if value else 0)
        self.warns("sky_masks: no pixel of 003_0.png is white", "up to 70", "expected 0 and 255")

    def test_pictures_in_place_of_masks(self):
        self.repaint("dynamic_masks/all", lambda value, y, height: (7 * y) % 251)
        self.warns("dynamic_masks/all:", "are grey")

    def test_inverted_sky(self):
        self.repaint("sky_masks", lambda value, y, height: 255 - value)
        self.warns("sky_masks: masks look inverted: the lower quarter is white", "expected white for the sky")

    def test_inverted_dynamic_masks(self):
        self.repaint("dynamic_masks/all", lambda value, y, height: 255 - value)
        self.warns("dynamic_masks/all: masks look inverted: more than half is white")

    def test_masks_of_another_size(self):
        for name in self.names("sky_masks"):
            write(self.at("sky_masks", name), grey_png(48, 27, [0] * 48 * 27))
        self.refused("sky_masks/003_0.png: 48 x 27 pixels", "expected 96 x 54")

    def test_ego_masks(self):
        pixels = [1 if i // 96 > 45 else 0 for i in range(96 * 54)]
        write(self.at("ego_masks/0.png"), grey_png(96, 54, pixels))
        write(self.at("ego_masks/1.png"), grey_png(96, 54, [255 * p for p in pixels]))
        self.warns("1 of 2 ego masks are of 0 and 1, the first is camera 0's")
        write(self.at("ego_masks/0.png"), grey_png(96, 54, [255 - 255 * p for p in pixels]))
        self.warns("1 of 2 ego masks leave out more than half", "camera 0's", "inverted")

    def test_ego_masks_that_hide_everything(self):
        """Training and eval name the ego mask as the reason. They don't name alpha, which the photographs lack."""
        for camera in (0, 1):
            write(self.at(f"ego_masks/{camera}.png"), grey_png(96, 54, [255] * (96 * 54)))
        train = ["train", self.street, "-o", self.path("scene"), "-n", 2, "--preview-every", 0, *fixtures.SMALL]
        done = self.succeeds(*train)
        self.assertRegex(
            done.stdout + done.stderr, "2 steps taught nothing.* left out by the ego mask of camera [01]\n"
        )
        done = fixtures.run("eval", self.path("scene"))
        self.assertIn("left out by the ego mask of camera", done.stdout + done.stderr)


class LabelTest(StreetCase):
    COLOURS = {10: (70, 130, 180), 13: (0, 0, 142), 11: (220, 20, 60)}

    def test_colours_in_place_of_classes(self):
        for name in self.names("semantic"):
            width, height, _, _, pixels = fixtures.read_png(self.at("semantic", name))
            colours = b"".join(bytes(self.COLOURS.get(p, (128, 64, 128))) for p in pixels)
            write(self.at("semantic", name), fixtures.png_bytes(width, height, colours))
        self.refused("semantic/000_0.png: the pixel at", "has the colour", "expected the id of its class", "8 bits")

    def test_one_picture_of_colours(self):
        write(self.at("semantic/001_1.png"), fixtures.png_bytes(96, 54, bytes([128, 64, 128]) * 96 * 54))
        self.refused("semantic/001_1.png: the pixel at 0, 0 has the colour 128 64 128")

    def test_classes_saved_in_three_channels(self):
        for name in self.names("semantic"):
            width, height, _, _, pixels = fixtures.read_png(self.at("semantic", name))
            write(
                self.at("semantic", name), fixtures.png_bytes(width, height, b"".join(bytes([p] * 3) for p in pixels))
            )
        self.assertEqual(self.warnings(), [])

    def test_classes_of_16_bits(self):
        for name in self.names("semantic"):
            width, height, _, _, pixels = fixtures.read_png(self.at("semantic", name))
            write(self.at("semantic", name), grey_png(width, height, pixels, 16))
        self.assertEqual(self.warnings(), [])
        name = self.at("semantic/003_0.png")
        write(name, grey_png(96, 54, [26001] * 96 * 54, 16))
        self.refused("semantic/003_0.png: values up to 26001", "up to 255")

    def test_classes_of_another_set(self):
        self.repaint("semantic", lambda value, y, height: {10: 23, 13: 26, 0: 7}.get(value, 11))
        self.warns(
            "semantic:", "that cityscapes labels don't have", "such as cityscapes-ids", "'labels' of dataset.json"
        )


def numbers(path):
    return [float(v) for v in read(path).split()]


def inverse(m):
    """Returns the inverse of a rigid motion, as 16 numbers."""
    rows = [[m[k], m[4 + k], m[8 + k], -sum(m[4 * i + k] * m[4 * i + 3] for i in range(3))] for k in range(3)]
    return [v for row in rows for v in row] + [0, 0, 0, 1]


def matrix_text(m):
    return "\n".join(" ".join(repr(float(v)) for v in m[4 * k : 4 * k + 4]) for k in range(4))


class CalibrationTest(StreetCase):
    def intrinsics(self, change):
        """Rewrites intrinsics/C.txt of each camera C. change(fx, fy, cx, cy) returns the new text."""
        for name in self.names("intrinsics"):
            write(self.at("intrinsics", name), change(*numbers(self.at("intrinsics", name))[:4]))

    def without_masks(self):
        for name in ("sky_masks", "semantic", "dynamic_masks"):
            shutil.rmtree(self.at(name))

    def halve(self, name):
        """Makes a photograph half as wide and half as high. Keeps every second pixel."""
        width, height, _, _, pixels = fixtures.read_png(self.at("images", name))
        half = b"".join(
            pixels[3 * (y * width + x) : 3 * (y * width + x) + 3]
            for y in range(0, height, 2)
            for x in range(0, width, 2)
        )
        write(self.at("images", name), fixtures.png_bytes(width // 2, height // 2, half))

    def test_one_photograph_of_another_size(self):
        self.without_masks()
        self.halve("003_1.png")
        self.refused(
            "images/003_1.png: 48 x 27 pixels", "expected 96 x 54 as 5 photographs of camera 1 have", "000_1.png"
        )

    def test_the_first_photograph_of_another_size(self):
        self.without_masks()
        self.halve("000_0.png")
        self.refused("images/000_0.png: 48 x 27 pixels", "expected 96 x 54", "(001_0.png)")

    def test_all_photographs_of_another_size(self):
        self.without_masks()
        for name in self.names("images"):
            self.halve(name)
        self.warns(
            "2 of 2 cameras have intrinsics of photographs of another size", "of about 96 x 54 pixels", "have 48 x 27"
        )

    def test_intrinsics_of_smaller_photographs(self):
        self.intrinsics(lambda fx, fy, cx, cy: f"{fx / 2} {fy / 2} {cx / 2} {cy / 2} 0 0 0 0 0")
        self.warns("of another size", "of about 48 x 27 pixels")

    def test_intrinsics_by_the_size_of_the_picture(self):
        self.intrinsics(lambda fx, fy, cx, cy: f"{fx / 96} {fy / 54} {cx / 96} {cy / 54} 0 0 0 0 0")
        self.refused("intrinsics/0.txt:1: focal lengths", "expected pixels", "to be multiplied by it")

    def test_principal_point_off_the_middle(self):
        self.intrinsics(lambda fx, fy, cx, cy: f"{fx} {fy} 5 {cy} 0 0 0 0 0")
        self.warns("principal point far from the middle", "camera 0: 5 ")

    def test_focal_lengths_that_differ(self):
        self.intrinsics(lambda fx, fy, cx, cy: f"{fx} {2 * fy} {cx} {cy} 0 0 0 0 0")
        self.warns("focal lengths that differ by more than a quarter")

    def test_every_form_of_intrinsics(self):
        self.succeeds("train", self.street, "-o", self.path("nine"), "--iterations", "1", *fixtures.SMALL)
        forms = [
            lambda fx, fy, cx, cy: f"{fx}\n{fy}\n{cx}\n{cy}\n",
            lambda fx, fy, cx, cy: f"{fx} {fy} {cx} {cy} 0 0 0 0",
            lambda fx, fy, cx, cy: f"{fx} 0 {cx}\n0 {fy} {cy}\n0 0 1",
            lambda fx, fy, cx, cy: f"{fx} 0 {cx} 0\n0 {fy} {cy} 0\n0 0 1 0",
            lambda fx, fy, cx, cy: f"{fx} 0 {cx} 0\n0 {fy} {cy} 0\n0 0 1 0\n0 0 0 1",
        ]
        files = [[form(*numbers(self.at("intrinsics", name))[:4]) for name in ("0.txt", "1.txt")] for form in forms]
        for number, (left, right) in enumerate(files):
            write(self.at("intrinsics/0.txt"), left)
            write(self.at("intrinsics/1.txt"), right)
            scene = self.path(f"scene{number}")
            if number == 0:
                self.succeeds("train", self.street, "-o", scene, "--iterations", "1", *fixtures.SMALL)
                self.assertEqual(read(os.path.join(scene, "background.ply")), read(self.path("nine", "background.ply")))
            self.assertEqual(self.warnings(), [])
        write(self.at("intrinsics/0.txt"), "80 1.5 48\n0 80 27\n0 0 1")
        self.refused("intrinsics/0.txt: 9 numbers", "fx fy cx cy", "without skew")
        write(self.at("intrinsics/0.txt"), "80 80 48")
        self.refused("intrinsics/0.txt: 3 numbers", "fx fy cx cy")

    def test_inverted_extrinsics(self):
        for name in self.names("extrinsics"):
            write(self.at("extrinsics", name), matrix_text(inverse(numbers(self.at("extrinsics", name)))))
        self.warns(
            "extrinsics: 2 of 2 cameras don't stand upright", "extrinsics or camera_axes may be wrong", "inverted they"
        )

    def test_inverted_extrinsics_of_each_exposure(self):
        cameras = {c: numbers(self.at("extrinsics", f"{c}.txt")) for c in range(2)}
        described = json.loads(read(self.at("dataset.json")))
        write(self.at("dataset.json"), json.dumps({**described, "extrinsics": "per-frame"}))
        for turn in (0, 1, 2, 3):  # the car's heading in the world, in quarter turns
            cos, sin = ((1, 0), (0, 1), (-1, 0), (0, -1))[turn]
            world = [cos, -sin, 0, 0, sin, cos, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1]
            for t in range(6):
                ego = product(world, numbers(self.at("ego_pose", f"{t:03d}.txt")))
                for c, camera in cameras.items():
                    write(self.at("extrinsics", f"{t:03d}_{c}.txt"), matrix_text(inverse(product(ego, camera))))
            lines = "\n".join(self.warnings())
            self.assertTrue("don't stand upright" in lines or "move up or down" in lines, lines)

    def test_extrinsics_of_other_axes(self):
        described = json.loads(read(self.at("dataset.json")))
        write(self.at("dataset.json"), json.dumps({**described, "camera_axes": "waymo"}))
        self.warns("extrinsics: 2 of 2 cameras", "with the other camera_axes")

    def test_world_whose_z_is_not_up(self):
        shutil.rmtree(self.at("lidar"))
        for name in self.names("ego_pose"):
            m = numbers(self.at("ego_pose", name))
            write(self.at("ego_pose", name), matrix_text(m[0:4] + [-v for v in m[8:12]] + m[4:8] + m[12:]))
        self.warns(
            "ego_pose: cameras don't stand upright in the world: their upward direction is 90 degrees off its z",
            "expected z up",
        )


class SplitTest(StreetCase):
    def split(self, *more):
        done = self.succeeds(
            "train", self.street, "-o", self.path("s"), "-n", 1, "--overwrite", "-q", *fixtures.SMALL, *more
        )
        views = json.loads(read(self.path("s", "scene.json")))["cameras"]
        return sorted({int(view["name"].split("_")[0]) for view in views if view["test"]}), done

    def test_stated_split(self):
        described = json.loads(read(self.at("dataset.json")))
        self.assertEqual(self.split()[0], [4])
        write(self.at("dataset.json"), json.dumps({**described, "held_out": [1, 3, 5]}))
        self.assertEqual(self.split()[0], [1, 3, 5])
        self.assertEqual(self.split("--frames", "2-5")[0], [3, 5])
        self.assertEqual(self.split("--split-every", 2)[0], [2, 4])
        self.assertEqual(self.split("--reconstruction")[0], [])
        write(self.at("dataset.json"), json.dumps({**described, "held_out": [1, 60]}))
        self.fails(
            ["train", self.street, "-o", self.path("s"), "--overwrite"], "dataset.json:1", "held_out", "found 60"
        )


class TimeTest(StreetCase):
    def times(self, change, **more):
        """Rewrites timestamps.json. change(seconds) returns the new value of a time. Removes fps from dataset.json."""
        old = json.loads(read(self.at("timestamps.json")))
        new = {"frames": [change(t) for t in old["frames"]], **more}
        write(self.at("timestamps.json"), json.dumps(new))
        described = json.loads(read(self.at("dataset.json")))
        write(self.at("dataset.json"), json.dumps({key: v for key, v in described.items() if key != "fps"}))

    def fps(self):
        return json.loads(self.succeeds("info", self.street, "--json", "-").stdout)["fps"]

    def test_other_units_are_turned_into_seconds(self):
        start = read(self.at("timestamps.json"))
        for unit, name in ((1e9, "nanoseconds"), (1e6, "microseconds"), (1e3, "milliseconds")):
            self.times(lambda t: int((1315967811 + t) * unit))
            self.warns(f"timestamps.json: times are taken as {name}", "expected seconds")
            self.assertAlmostEqual(self.fps(), 10, places=3)
            write(self.at("timestamps.json"), start)
        self.times(lambda t: 1000 * t)
        self.warns("times are taken as milliseconds, since the interval of frames is 100")

    def test_one_frame_in_nanoseconds(self):
        self.times(lambda t: int((1315967811 + t) * 1e9))
        lines = self.warnings("--frames", "2-2")
        self.assertIn("taken as nanoseconds", lines[0])

    def test_exposures_of_another_unit(self):
        old = json.loads(read(self.at("timestamps.json")))["frames"]
        self.times(lambda t: 1315967811 + t, cameras={"0": [(1315967811 + t) * 1e6 for t in old]})
        self.warns("timestamps.json: times of exposures are taken as microseconds")
        self.times(lambda t: t, cameras={"0": [t + 500 for t in range(6)]})
        self.warns("6 of 6 exposures are far from the time of their frame")

    def test_times_that_no_unit_explains(self):
        self.times(lambda t: 86400 * t)
        self.warns("the times may not be seconds")

    def test_rate_that_contradicts_the_times(self):
        described = json.loads(read(self.at("dataset.json")))
        write(self.at("dataset.json"), json.dumps({**described, "fps": 2}))
        self.warns("timestamps.json: the interval of frames is 0.1 s, 10 per second, but dataset.json has fps 2")

    def test_times_as_street_gaussians_writes_them(self):
        old = json.loads(read(self.at("timestamps.json")))["frames"]
        keyed = {f"{i:06d}": 1315967811 + t for i, t in enumerate(old)}
        write(self.at("timestamps.json"), json.dumps({"FRAME": keyed, "FRONT": keyed, "SIDE_LEFT": keyed}))
        self.assertEqual(self.warnings(), [])
        del keyed["000004"]
        write(self.at("timestamps.json"), json.dumps({"FRAME": keyed}))
        self.refused("timestamps.json:1: 'FRAME' has 5 times", "frame 4 has none")

    def test_nan_in_a_pose(self):
        info = json.loads(read(self.at("instances/instances_info.json")))
        info["4"]["frame_annotations"]["obj_to_world"][2][0][3] = float("nan")
        write(self.at("instances/instances_info.json"), json.dumps(info))
        self.refused(
            "instances_info.json:1: expected a number for 4.frame_annotations.obj_to_world[2][0][3], found NaN"
        )


def product(a, b):
    return [sum(a[4 * i + k] * b[4 * k + j] for k in range(4)) for i in range(4) for j in range(4)]


class StreetGaussiansTest(StreetCase):
    """Tests the street in the layout that Street Gaussians' converter writes."""

    def setUp(self):
        super().setUp()
        self.facts = json.loads(self.succeeds("info", self.street, "--json", "-").stdout)
        for folder in ("images", "sky_masks", "dynamic_masks/all"):
            self.rename_all(folder, lambda name: "000" + name)
        os.rename(self.at("sky_masks"), self.at("sky_mask"))
        os.rename(self.at("dynamic_masks/all"), self.at("dynamic_mask"))
        info = json.loads(read(self.at("instances/instances_info.json")))
        for name in ("dynamic_masks", "semantic", "lidar", "instances", "truth"):
            shutil.rmtree(self.at(name))
        os.remove(self.at("dataset.json"))
        poses = [numbers(self.at("ego_pose", f"{t:03d}.txt")) for t in range(6)]
        self.lines = ["frame_id track_id object_class alpha box_height box_width box_length box_center_x ..."]
        for key, item in info.items():
            notes = item["frame_annotations"]
            kind = {"Pedestrian": "pedestrian", "Cyclist": "cyclist"}.get(item["class_name"], "vehicle")
            for t, pose, size in zip(notes["frame_idx"], notes["obj_to_world"], notes["box_size"]):
                m = product(inverse(poses[t]), [v for row in pose for v in row])
                numbers_ = [size[2], size[1], size[0], m[3], m[7], m[11], math.atan2(m[4], m[0]), 0]
                self.lines.append(f"{t} {key} {kind} -10 " + " ".join(repr(v) for v in numbers_) + " ")
        self.write_tracks(self.lines)
        times = json.loads(read(self.at("timestamps.json")))["frames"]
        keyed = {f"{i:06d}": t for i, t in enumerate(times)}
        write(self.at("timestamps.json"), json.dumps({"FRAME": keyed, "FRONT": keyed, "FRONT_LEFT": keyed}))
        self.rename_all("ego_pose", lambda name: "000" + name)
        for t, pose in enumerate(poses):
            for camera in range(2):
                write(self.at("ego_pose", f"{t:06d}_{camera}.txt"), matrix_text(pose))

    def write_tracks(self, lines):
        write(self.at("track/track_info.txt"), "\n".join(lines) + "\n")

    def test_layout_is_recognised_and_read(self):
        found = json.loads(self.succeeds("info", self.street, "--json", "-").stdout)
        self.assertEqual(found["warnings"], [])
        self.assertEqual(found["format"], "street-gaussians")
        for key in ("views_train", "views_test", "objects_moving", "objects_parked", "fps"):
            self.assertEqual(found[key], self.facts[key], key)
        notes = "\n".join(found["notes"])
        self.assertIn("12 have sky_masks, 0 semantic, 12 dynamic_masks", notes)
        self.assertIn("ego_pose/TTT_C.txt", notes)

    def test_boxes_keep_their_places(self):
        done = self.succeeds("info", self.street, "--overlay", self.path("look"), "--json", "-")
        overlay = json.loads(done.stdout)["overlay"]
        self.assertGreater(overlay["outline_mask_overlap"], 0.3)
        self.assertGreater(overlay["front_cosine"], 0.99)

    def test_poses_at_exposures_are_used(self):
        for t in range(6):
            path = self.at("ego_pose", f"{t:06d}_1.txt")
            moved = numbers(path)
            moved[3] += 5000  # moves the origin of the data set
            write(path, matrix_text(moved))
        origin = json.loads(self.succeeds("info", self.street, "--json", "-").stdout)["origin"]
        self.assertGreater(origin[0], 2000)

    def test_unread_files_are_named(self):
        write(self.at("pointcloud.npz"), b"PK")
        write(self.at("lidar_depth/000000_0.npy"), b"NUMPY")
        lines = "\n".join(self.warnings())
        self.assertIn("pointcloud.npz", lines)
        self.assertIn("lidar_depth with 1 files", lines)

    def test_faults_name_the_line(self):
        self.write_tracks(self.lines[:3] + ["0 7 vehicle"])
        self.refused("track_info.txt:4: 3 words, expected at least 11")
        self.write_tracks(self.lines[:3] + ["0 7 vehicle -10 1 1 nan 0 0 0 0 0"])
        self.refused("track_info.txt:4: expected a number, found 'nan'")
        self.write_tracks(self.lines[:3] + ["0 7 vehicle -10 1 1 5000 0 0 0 0 0"])
        self.refused("track_info.txt:4: expected extents above 0")

    def test_labels_are_repaired_like_those_of_instances(self):
        self.write_tracks(self.lines + ["0 700 vehicle -10 1 1 0 0 0 0 0 0"])
        self.assertIn(
            "a side is shorter than 0.01 m; the first is vehicle '700' in frame 0", "\n".join(self.warnings())
        )
        self.write_tracks(self.lines + [self.lines[2]])
        self.assertIn("another in the same frame", "\n".join(self.warnings()))


class SweepTest(StreetCase):
    def rewrite(self, change):
        """Rewrites every sweep. change(points, frame) gets lists of x, y, z, intensity and returns bytes."""
        for name in self.names("lidar"):
            values = array.array("f", read(self.at("lidar", name)))
            points = [list(values[i : i + 4]) for i in range(0, len(values), 4)]
            write(self.at("lidar", name), change(points, name[:3]))

    def columns(self, count):
        """Rewrites the sweeps with another number of columns. The number of rows is a multiple of 4, so that file sizes
        stay multiples of 16 bytes."""

        def change(points, frame):
            rows = [(p + [float(i % 32), 0.0, 1.0, 2.0])[:count] for i, p in enumerate(points)]
            rows = rows[: len(rows) // 4 * 4]
            return array.array("f", [v for row in rows for v in row]).tobytes()

        self.rewrite(change)

    def flat(self, points, kind="f"):
        return array.array(kind, [v for p in points for v in p])

    def test_float64(self):
        self.rewrite(lambda points, frame: self.flat(points, "d").tobytes())
        self.refused("lidar/003.bin", "farther than 1000 m", "rows of 4 float32", "read as float64 they would be")

    def test_millimetres_and_centimetres(self):
        self.rewrite(lambda points, frame: self.flat([[1000 * v for v in p] for p in points]).tobytes())
        self.refused("lidar/003.bin", "taken as millimetres", "divide them by 1000")
        self.rewrite(lambda points, frame: self.flat([[v / 10 for v in p] for p in points]).tobytes())
        self.refused("lidar/003.bin", "taken as centimetres", "divide them by 100")

    def test_big_endian(self):
        def change(points, frame):
            values = self.flat(points)
            values.byteswap()
            return values.tobytes()

        self.rewrite(change)
        self.refused("lidar/003.bin", "read as big-endian")

    def test_files_of_other_formats(self):
        write(self.at("lidar/003.bin"), b"\x93NUMPY\x01\0" + b" " * 120 + read(self.at("lidar/003.bin")))
        self.refused("lidar/003.bin: is a .npy file", "tofile")
        write(self.at("lidar/003.bin"), b"version https://git-lfs.github.com/spec/v1\noid sha256:12 ")
        self.refused("lidar/003.bin", "Git LFS", "git lfs pull")

    def test_five_columns(self):
        self.columns(5)
        self.refused(
            "lidar/003.bin: by its values it has 5 floats a row, expected 4", "'lidar_columns' of dataset.json"
        )

    def test_three_columns(self):
        self.columns(3)
        self.refused("lidar/003.bin: by its values it has 3 floats a row")

    def test_eight_columns(self):
        self.columns(8)
        self.refused("lidar/003.bin: by its values it has 8 floats a row")

    def test_columns_one_after_the_other(self):
        self.rewrite(lambda points, frame: array.array("f", [p[k] for k in range(4) for p in points]).tobytes())
        lines = self.warnings()
        self.assertIn("lidar/003.bin: its 4 columns hold the same kind of values", lines[0])

    def test_the_world_frame(self):
        def change(points, frame):
            m = numbers(self.at("ego_pose", f"{frame}.txt"))
            for p in points:
                p[:3] = [sum(m[4 * k + i] * p[i] for i in range(3)) + m[4 * k + 3] for k in range(3)]
            return self.flat(points).tobytes()

        self.rewrite(change)
        self.warns("lidar: ", "of the points of two sweeps meet without ego_pose", "lidar_frame may be wrong")
        described = json.loads(read(self.at("dataset.json")))
        write(self.at("dataset.json"), json.dumps({**described, "lidar_frame": "world"}))
        self.assertEqual(self.warnings(), [])
        self.assertIn("sweeps in the world's frame", self.succeeds("info", self.street).stdout)

    def test_axes_of_a_camera(self):
        self.rewrite(lambda points, frame: self.flat([[-p[1], -p[2], p[0], p[3]] for p in points]).tobytes())
        lines = self.warnings()
        self.assertIn("lidar/003.bin: its points spread by", lines[0])
        self.assertIn("expected z to point up", lines[0])

    def test_x_to_the_right(self):
        self.rewrite(lambda points, frame: self.flat([[-p[1], p[0], p[2], p[3]] for p in points]).tobytes())
        self.warns("meet if they are turned by 270 degrees about z", "axes may be wrong")

    def test_empty_sweeps(self):
        write(self.at("lidar/001.bin"), b"")
        self.warns("lidar: 1 of 6 sweeps have no points, the first is 001.bin")

    def test_inverse_poses(self):
        for name in self.names("ego_pose"):
            write(self.at("ego_pose", name), matrix_text(inverse(numbers(self.at("ego_pose", name)))))
        lines = self.warnings()
        self.assertTrue(any("ego_pose: " in line and "meet with the inverse poses" in line for line in lines), lines)


if __name__ == "__main__":
    fixtures.main()
