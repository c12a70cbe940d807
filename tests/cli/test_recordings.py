# SPDX-License-Identifier: Apache-2.0
"""Tests recordings and labels as users have them: boxes and poses with faults, odd forms of KITTI's and Waymo's
files."""

import json
import math
import os
import shutil
import struct

import fixtures
from fixtures import Case, read, run, write
from test_import import make_tree

FRAMES = 12


class Street(Case):
    """Makes a short synthetic street. Each test changes one thing in a copy."""

    @classmethod
    def setUpClass(cls):
        super().setUpClass()
        cls.street = os.path.join(cls.shared_folder(), "street")
        size = ["--frames", FRAMES, "--size", "80x45", "--cameras", "1", "--no-shifts"]
        made = run("synth", "street", "-q", "-o", cls.street, *size)
        assert made.returncode == 0, made.stderr

    def setUp(self):
        super().setUp()
        self.set = self.path("set")
        shutil.copytree(self.street, self.set)
        self.file = os.path.join(self.set, "instances/instances_info.json")
        self.instances = json.loads(read(self.file))

    def annotations(self, name):
        return next(v for v in self.instances.values() if v["id"] == name)["frame_annotations"]

    def cyclist(self):
        return next((v["id"], v["frame_annotations"]) for v in self.instances.values() if v["class_name"] == "Cyclist")

    def save(self):
        write(self.file, json.dumps(self.instances))

    def info(self, *options):
        """Returns the JSON that info writes about the set."""
        return json.loads(self.succeeds("info", self.set, *options, "--json", "-").stdout)

    def warned(self, *parts):
        """Asserts that info gives one warning, which contains all `parts`, and that --strict makes it an error."""
        warnings = self.info()["warnings"]
        self.assertEqual(len(warnings), 1, warnings)
        for part in parts:
            self.assertIn(part, warnings[0])
        self.fails(["info", self.set, "--strict"], parts[0])


class Labels(Street):
    def test_good_street_gives_no_warning(self):
        said = self.info()
        self.assertEqual(said["warnings"], [])
        self.assertEqual(said["objects_moving"]["all"] + said["objects_parked"]["all"], len(self.instances))

    def test_removed_object(self):
        gone = self.instances.pop("3")
        self.save()
        listing = os.path.join(self.set, "instances/frame_instances.json")
        frames = len(gone["frame_annotations"]["frame_idx"])
        self.warned(f"frame_instances.json: {frames} entries name instances", "the first is 3 in frame")
        listed = json.loads(read(listing))
        write(listing, json.dumps({k: [n for n in v if n != 3] for k, v in listed.items()}))
        said = self.info()
        self.assertEqual(said["warnings"], [])
        self.assertEqual(said["objects_moving"]["all"] + said["objects_parked"]["all"], len(self.instances))
        os.remove(listing)
        self.assertEqual(self.info()["objects_moving"], said["objects_moving"])

    def test_box_without_width(self):
        name, at = self.cyclist()
        at["box_size"][2][1] = 0
        self.save()
        self.warned("boxes are left out", f"Cyclist '{name}' in frame {at['frame_idx'][2]}")

    def test_bad_box_is_named(self):
        name, at = self.cyclist()
        at["box_size"][2][1] = 5000
        self.save()
        self.fails(["info", self.set], f"Cyclist '{name}' in frame", "below 1000 m, found 5000")
        at["box_size"][2][1] = 0.6
        at["obj_to_world"][3][0][0] = 7
        self.save()
        self.fails(["info", self.set], f"obj_to_world of Cyclist '{name}' in frame", "not a rotation")

    def knots(self):
        """Returns the car's labels as training uses them. Reads them from the scene of a training of one step."""
        self.succeeds("train", self.set, "-o", self.path("scene"), "--iterations", "1", "--overwrite")
        objects = json.loads(read(self.path("scene/scene.json")))["objects"]
        car = next(o for o in objects if o["id"] == "moving_car_027")
        return {k["frame"]: k["world_from_object"] for k in car["knots"]}

    def aside(self, frames, axis, metres):
        at = self.annotations("moving_car_027")
        true = {f: [x for row in m[:3] for x in row] for f, m in zip(at["frame_idx"], at["obj_to_world"])}
        for frame in frames:
            at["obj_to_world"][at["frame_idx"].index(frame)][axis][3] += metres
        self.save()
        return true

    def test_boxes_beside_the_car(self):
        for frames in [[5], [5, 6], [5, 6, 7], [0]]:
            self.instances = json.loads(read(os.path.join(self.street, "instances/instances_info.json")))
            true = self.aside(frames, 1, 3)
            self.warned(
                f"instances_info.json: {len(frames)} of ", "lie aside", f"Car 'moving_car_027' in frame {frames[0]}"
            )
            for frame, m in self.knots().items():
                far = math.dist(m[3::4], true[frame][3::4])
                self.assertLess(far, 0.7 if frame in frames else 1e-9, frame)

    def test_boxes_that_leap_often(self):
        self.aside([1, 3, 5, 7, 9], 1, 3)
        self.warned("the boxes of 1 of ", "leap", "Car 'moving_car_027' from frame 0 to 1, ", " m off in 0.10 s")

    def test_box_of_another_size(self):
        name, at = self.cyclist()
        at["box_size"][2][0] *= 10
        self.save()
        self.warned(
            "instances_info.json: 1 of ", "three times as large", f"Cyclist '{name}' in frame {at['frame_idx'][2]}"
        )

    def test_boxes_in_other_axes(self):
        at = self.annotations("moving_car_027")
        for m in at["obj_to_world"]:
            m[0][3] += 4e5
        self.save()
        self.warned(
            f"instances_info.json: {FRAMES} of ", "more than 500 m from the cameras", "Car 'moving_car_027' in frame 0"
        )

    def test_classes_that_are_no_road_users_are_named(self):
        self.instances["0"]["class_name"] = "Autobus"
        self.save()
        said = self.info()
        self.assertIn("neither vehicles nor pedestrians nor cyclists: Autobus", said["notes"])
        self.assertEqual(said["warnings"], [])

    def test_unlisted_boxes(self):
        listing = os.path.join(self.set, "instances/frame_instances.json")
        listed = json.loads(read(listing))
        lost, listed["4"] = len(listed["4"]), []
        write(listing, json.dumps(listed))
        self.warned(f"instances_info.json: {lost} of ", "frame_instances.json doesn't list them", "in frame 4")

    def test_recording_that_was_paused(self):
        file = os.path.join(self.set, "timestamps.json")
        times = json.loads(read(file))
        times["frames"] = [t if i < 6 else t + 2 for i, t in enumerate(times["frames"])]
        write(file, json.dumps({"frames": times["frames"]}))
        for v in self.instances.values():  # all objects keep moving while the recording is paused
            at = v["frame_annotations"]
            first, last = at["obj_to_world"][0], at["obj_to_world"][-1]
            for frame, m in zip(at["frame_idx"], at["obj_to_world"]):
                for k in range(3):
                    m[k][3] += 20 / 11 * (last[k][3] - first[k][3]) if frame >= 6 else 0
        self.save()
        self.assertEqual([w for w in self.info()["warnings"] if "instances_info" in w], [])

    def test_parked_car_with_one_wrong_box_stays_parked(self):
        parked = self.info()["objects_parked"]["vehicle"]
        name = next(
            v["id"]
            for v in self.instances.values()
            if "parked" in v["id"] and len(v["frame_annotations"]["frame_idx"]) > 6
        )
        self.annotations(name)["obj_to_world"][3][0][3] += 3
        self.save()
        self.assertEqual(self.info()["objects_parked"]["vehicle"], parked)

    def test_turned_headings(self):
        at = self.annotations("moving_car_027")
        true = {f: [x for row in m[:3] for x in row] for f, m in zip(at["frame_idx"], at["obj_to_world"])}
        for frame in [5, 6]:
            for row in at["obj_to_world"][at["frame_idx"].index(frame)][:3]:
                row[0], row[1] = -row[0], -row[1]
        self.save()
        self.warned("instances_info.json: 2 of ", "turned", "Car 'moving_car_027' in frame 5")
        for frame, m in self.knots().items():
            for a, b in zip(m, true[frame]):
                self.assertAlmostEqual(a, b, 9)

    def test_one_heading_across(self):
        m = self.annotations("moving_car_027")["obj_to_world"][6]
        for row in m[:3]:
            row[0], row[1] = row[1], -row[0]
        self.save()
        self.warned("instances_info.json: 1 of ", "turned", "Car 'moving_car_027' in frame 6")

    def test_ids_unique_within_a_class(self):
        person = next(v for v in self.instances.values() if v["class_name"] == "Pedestrian")
        person["id"] = "moving_car_027"
        self.save()
        self.warned("ids are used in several classes", "'moving_car_027', of a ")
        other = next(v for v in self.instances.values() if v["class_name"] == "Car" and v["id"] != "moving_car_027")
        other["id"] = "moving_car_027"
        self.save()
        self.fails(["info", self.set], "the id 'moving_car_027' occurs twice", "of a Car")

    def test_walkers_of_a_short_clip_move(self):
        self.assertEqual(self.info()["objects_moving"]["pedestrian"], 3)


class Poses(Street):
    def pose(self, frame, change):
        path = os.path.join(self.set, f"ego_pose/{frame:03d}.txt")
        rows = [[float(x) for x in line.split()] for line in read(path).decode().splitlines()]
        change(rows)
        write(path, "".join(" ".join(map(repr, row)) + "\n" for row in rows))

    def test_leaps(self):
        def off(rows):
            rows[1][3] += 8

        def turned(rows):
            c, s = math.cos(0.35), math.sin(0.35)
            for row in rows[:3]:
                row[0], row[1] = c * row[0] + s * row[1], c * row[1] - s * row[0]

        self.pose(9, off)
        self.warned("ego_pose: 2 of 11 steps between poses leap", "from frame 008 to 009, 8.", "in 0.10 s")
        self.pose(6, turned)
        self.warned("4 of 11 steps", "from frame 005 to 006", "20.")

    def test_small_leaps(self):
        """Among smooth poses, an error of 0.7 m is enough for a warning."""

        def off(rows):
            rows[1][3] += 0.7

        self.pose(5, off)
        self.warned("ego_pose: 2 of 11 steps between poses leap", "from frame 004 to 005, 0.7")

    def test_missing_poses(self):
        os.remove(os.path.join(self.set, "ego_pose/005.txt"))

        def unknown(rows):
            rows[0][3] = math.nan

        self.pose(7, unknown)
        self.fails(
            ["info", self.set], "no such pose", "ego_pose/005.txt", "2 of 12 poses are missing", "--allow-missing"
        )
        said = self.info("--allow-missing")
        self.assertEqual((said["views_missing"], said["lidar_sweeps"]), (2, 10))
        self.assertEqual(len(said["warnings"]), 1)
        self.assertIn("2 of 12 poses are missing and left out", said["warnings"][0])
        self.succeeds("train", self.set, "--allow-missing", "-o", self.path("scene"), "--iterations", "2")
        write(os.path.join(self.set, "ego_pose/005.txt"), "1 2 x\n")
        self.fails(["info", self.set, "--allow-missing"], "ego_pose/005.txt:1: expected a number, found 'x'")

    def per_frame(self):
        """Gives each photograph a separate pose, as in PandaSet."""
        file = os.path.join(self.set, "dataset.json")
        write(file, json.dumps({**json.loads(read(file)), "extrinsics": "per-frame"}))
        load = lambda name: [
            [float(x) for x in line.split()] for line in read(os.path.join(self.set, name)).decode().splitlines()
        ]
        camera = load("extrinsics/0.txt")
        for frame in range(FRAMES):
            ego = load(f"ego_pose/{frame:03d}.txt")
            rows = [[sum(ego[i][k] * camera[k][j] for k in range(4)) for j in range(4)] for i in range(4)]
            write(
                os.path.join(self.set, f"extrinsics/{frame:03d}_0.txt"),
                "".join(" ".join(map(repr, row)) + "\n" for row in rows),
            )

    def test_missing_poses_of_photographs_and_sweeps(self):
        self.per_frame()
        os.remove(os.path.join(self.set, "ego_pose/005.txt"))
        self.warned("1 of 12 sweeps have no pose and are left out; the first pose is ", "ego_pose/005.txt")
        write(os.path.join(self.set, "extrinsics/007_0.txt"), "")
        self.fails(["info", self.set], "no such pose", "extrinsics/007_0.txt", "1 of 12 poses are missing")
        said = self.info("--allow-missing")
        self.assertEqual((said["views_missing"], said["lidar_sweeps"], len(said["warnings"])), (1, 11, 2))


class Kitti(Case):
    """Makes a tree of KITTI's tracking benchmark. Each test changes one thing."""

    def setUp(self):
        super().setUp()
        if run("import", "--help").returncode:
            self.skipTest("this build has no pags import")
        self.raw = make_tree(self.path("raw"), 6)
        self.labels = os.path.join(self.raw, "label_02/0000.txt")

    def imports(self, *parts, options=()):
        """Imports the tree and asserts that the import gives exactly these warnings."""
        out = self.path("out")
        shutil.rmtree(out, ignore_errors=True)
        said = json.loads(self.succeeds("import", "kitti", self.raw, "-o", out, "--json", "-", *options).stdout)
        self.assertEqual(len(said["warnings"]), len(parts), said["warnings"])
        for part, warning in zip(parts, said["warnings"]):
            self.assertIn(part, warning)
        file = os.path.join(out, "instances/instances_info.json")
        return json.loads(read(file)) if os.path.exists(file) else None

    def rewrite(self, change):
        """Replaces each label (a list of words) by the result of `change`."""
        rows = [line.split() for line in read(self.labels).decode().splitlines()]
        write(self.labels, "".join(" ".join(row) + "\n" for row in map(change, rows) if row))

    def frames_of(self, instances):
        return {v["id"]: (v["class_name"], v["frame_annotations"]["frame_idx"]) for v in instances.values()}

    def test_good_tree(self):
        self.assertEqual(self.frames_of(self.imports()), {"0": ("Car", [0, 1, 2, 3, 4, 5])})

    def test_labels_past_the_photographs(self):
        for camera in ["image_02", "image_03"]:
            for frame in [4, 5]:
                os.remove(os.path.join(self.raw, f"{camera}/0000/{frame:06d}.png"))
        found = self.imports(
            "2 of 6 labels are left out, as there are photographs of frames 0 to 3 only; the first is a Car of track 0 in frame 4"
        )
        self.assertEqual(self.frames_of(found), {"0": ("Car", [0, 1, 2, 3])})

    def test_one_camera(self):
        shutil.rmtree(os.path.join(self.raw, "image_03"))
        self.imports("camera 1 is left out: image_03 has no photographs")
        self.assertFalse(os.path.exists(self.path("out/images/000_1.png")))
        self.imports(options=["--cameras", "0"])
        self.fails(
            ["import", "kitti", self.raw, "-o", self.path("no"), "--cameras", "0,1"], "lacks image_03/0000", "--cameras"
        )
        os.rename(os.path.join(self.raw, "image_02"), os.path.join(self.raw, "image_00"))
        self.fails(["import", "kitti", self.raw, "-o", self.path("no")], "image_00 and image_01 are grey")

    def test_jpeg(self):
        jpeg = bytes.fromhex(
            "ffd8ffc0000b080018004001011100ffda0008010100003f00ffd9"
        )  # only the header is read; its size is 64 x 24 pixels
        folder = os.path.join(self.raw, "image_02/0000")
        for name in os.listdir(folder):
            write(os.path.join(folder, name[:-4] + ".jpg"), jpeg)
            os.remove(os.path.join(folder, name))
        self.imports(options=["--cameras", "0"])
        self.assertEqual(read(self.path("out/images/005_0.jpg")), jpeg)

    def test_pictures_of_another_size(self):
        picture = fixtures.png_bytes(32, 12, bytes(32 * 12 * 3))
        write(os.path.join(self.raw, "image_03/0000/000002.png"), picture)
        self.fails(
            ["import", "kitti", self.raw, "-o", self.path("no")],
            "image_03/0000/000002.png: has 32 x 12 pixels",
            "64 x 24",
        )
        for frame in range(6):
            write(os.path.join(self.raw, f"image_03/0000/{frame:06d}.png"), picture)
        self.fails(
            ["import", "kitti", self.raw, "-o", self.path("no")],
            "image_03/0000/000000.png",
            "principal point",
            "original ones",
        )

    def test_scores(self):
        self.rewrite(lambda row: row + ["0.5"])
        self.imports("the scores of 6 labels are ignored, all boxes count alike; the first is 0.5 in line 1")

    def test_labels_without_a_place(self):
        self.rewrite(lambda row: row[:10] + "-1 -1 -1 -1000 -1000 -1000 -10".split() if row[0] == "2" else row)
        found = self.imports(
            "1 of 6 labels are left out, having no height, width, length or place in space; the first is a Car of track 0 in frame 2"
        )
        self.assertEqual(self.frames_of(found), {"0": ("Car", [0, 1, 3, 4, 5])})

    def test_angles_in_degrees(self):
        self.rewrite(lambda row: row[:16] + ["-90"])
        self.fails(
            ["import", "kitti", self.raw, "-o", self.path("no")],
            "0000.txt:1: Car of track 0 in frame 0: expected rotation_y in radians",
        )

    def test_numbers_unique_within_a_class(self):
        person = [line.replace("Car", "Pedestrian") for line in read(self.labels).decode().splitlines()]
        write(self.labels, read(self.labels).decode() + "\n".join(person) + "\n")
        found = self.frames_of(self.imports("1 track numbers belong to things of several classes"))
        self.assertEqual({id: c for id, (c, _) in found.items()}, {"0": "Car", "0-Pedestrian": "Pedestrian"})
        self.assertEqual([len(frames) for _, frames in found.values()], [6, 6])

    def test_class_that_changes(self):
        self.rewrite(lambda row: row[:2] + ["Van"] + row[3:] if row[0] in "14" else row)
        found = self.imports("the class of 1 tracks changes")
        self.assertEqual(self.frames_of(found), {"0": ("Car", [0, 1, 2, 3, 4, 5])})
        self.rewrite(
            lambda row: row[:13] + ["300"] + row[14:] if row[2] == "Van" else row
        )  # the two objects with one track number are far from each other
        self.assertEqual(len(self.imports("track numbers belong to things of several classes")), 2)

    def test_leap_of_oxts(self):
        file = os.path.join(self.raw, "oxts/0000.txt")
        rows = [line.split() for line in read(file).decode().splitlines()]
        rows[3][2] = "140"
        rows[3][23] = "25"
        write(file, "".join(" ".join(row) + "\n" for row in rows))
        self.imports("2 of 5 steps between poses leap", "position is known to 5 m or worse; the first is frame 3, 25 m")

    def test_sweeps_of_another_form(self):
        for frame in range(6):
            file = os.path.join(self.raw, f"velodyne/0000/{frame:06d}.bin")
            data = read(file)
            values = struct.unpack(f"<{len(data) // 4}f", data)
            write(file, b"".join(struct.pack("<d", 1000 * v if i % 4 < 3 else v) for i, v in enumerate(values)))
            if frame == 0:
                self.first = data
        self.imports("taken for rows of 4 doubles in millimetres")
        got, true = (
            struct.unpack(f"<{len(self.first) // 4}f", data)
            for data in [read(self.path("out/lidar/000.bin")), self.first]
        )
        self.assertLess(max(abs(a - b) for a, b in zip(got, true)), 1e-5)
        write(os.path.join(self.raw, "velodyne/0000/000005.bin"), self.first)
        self.fails(["import", "kitti", self.raw, "-o", self.path("no")], "000005.bin: has rows of another form than")


def crc32c(data):
    crc = 0xFFFFFFFF
    for byte in data:
        crc ^= byte
        for _ in range(8):
            crc = crc >> 1 ^ (0x82F63B78 if crc & 1 else 0)
    crc ^= 0xFFFFFFFF
    return struct.pack("<I", ((crc >> 15 | crc << 17) + 0xA282EAD8) & 0xFFFFFFFF)


def record(data):
    length = struct.pack("<Q", len(data))
    return length + crc32c(length) + data + crc32c(data)


def varint(value):
    out = b""
    while value > 127:
        out, value = out + bytes([value & 127 | 128]), value >> 7
    return out + bytes([value])


def field(number, value):
    """Returns a field of a protobuf message. The value is an int, a float (stored as double), or the bytes of a text or
    message."""
    if isinstance(value, float):
        return varint(number << 3 | 1) + struct.pack("<d", value)
    if isinstance(value, int):
        return varint(number << 3) + varint(value)
    data = value.encode() if isinstance(value, str) else value
    return varint(number << 3 | 2) + varint(len(data)) + data


def transform(number, x=0.0, y=0.0):
    m = [1, 0, 0, x, 0, 1, 0, y, 0, 0, 1, 0, 0, 0, 0, 1]
    return field(number, b"".join(field(1, float(v)) for v in m))


class Waymo(Case):
    """Imports segments with one camera and boxes, which the tests make."""

    def segment(self, labels, offsets=(0,) * 6):
        """Writes a segment. labels[t] lists (id, type, x) of each box of frame t. The recording car drives at 10 m/s;
        `offsets` move it sideways."""
        lens = b"".join(field(2, v) for v in [40.0, 40.0, 32.0, 12.0] + [0.0] * 5)
        camera = field(1, 1) + lens + transform(3) + field(4, 64) + field(5, 24) + field(6, 2)
        jpeg = bytes.fromhex("ffd8ffc0000b080018004001011100ffda0008010100003f00ffd9")
        out = b""
        for t, boxes in enumerate(labels):
            frame = (
                field(1, field(1, "a") + field(2, camera)) + field(2, 10**15 + 100000 * t) + transform(3, t, offsets[t])
            )
            frame += field(4, field(1, 1) + field(2, jpeg) + transform(3, t, offsets[t]))
            for name, kind, x in boxes:
                box = b"".join(field(i + 1, float(v)) for i, v in enumerate([x, 2, 0, 1.8, 4, 1.5, 0]))
                frame += field(6, field(1, box) + field(3, kind) + field(4, name))
            out += record(frame)
        return self.write("segment.tfrecord", out)

    def imports(self, *arguments):
        if run("import", "--help").returncode:
            self.skipTest("this build has no pags import")
        file = self.segment(*arguments)
        said = json.loads(
            self.succeeds("import", "waymo", file, "-o", self.path("out"), "--cameras", "0", "--json", "-").stdout
        )
        file = self.path("out/instances/instances_info.json")
        objects = {v["id"]: len(v["frame_annotations"]["frame_idx"]) for v in json.loads(read(file)).values()}
        return objects, [w for w in said["warnings"] if "have no LiDAR" not in w]

    def test_ids_unique_within_a_class(self):
        objects, warnings = self.imports([[("7", 1, 20), ("7", 2, 10)]] * 3)
        self.assertEqual(objects, {"7": 3, "7-Pedestrian": 3})
        self.assertEqual(len(warnings), 1)
        self.assertIn("1 ids belong to things of several classes", warnings[0])
        self.assertIn("the first is '7', of a Vehicle and a Pedestrian", warnings[0])

    def test_odd_labels(self):
        objects, warnings = self.imports(
            [[("7", 1, 20), ("8", 2, math.nan)], [("7", 1, 20), ("", 1, 30)], [("7", 1, 20)]]
        )
        self.assertEqual(objects, {"7": 3})
        self.assertEqual(len(warnings), 1)
        self.assertIn(
            "2 boxes without id, size or finite numbers were left out; the first is Pedestrian '8' in frame 0",
            warnings[0],
        )

    def test_leap(self):
        _, warnings = self.imports([[("7", 1, 20)]] * 6, (0, 0, 0, 5, 0, 0))
        self.assertEqual(len(warnings), 1)
        self.assertIn("2 of 5 steps between poses leap; the first is from frame 2 to 3, 5.00 m", warnings[0])


class Foreign(Case):
    def test_other_layouts_are_named_with_the_remedy(self):
        self.write("av2/city_SE3_egovehicle.feather", b"ARROW1\0\0")
        self.write("v2/vehicle_pose/1.parquet", b"PAR1" + bytes(60))
        for component in ("camera_image", "camera_calibration", "vehicle_pose"):
            self.write(f"v2whole/{component}/1.parquet", b"PAR1" + bytes(60))
        self.write("panda/lidar/poses.json", "[]")
        self.write("panda/camera/front_camera/poses.json", "[]")
        self.write("nusc/samples/a", "")
        self.write("nusc/sweeps/a", "")
        self.write("k360/data_2d_raw/a", "")
        self.write("object/image_2/000000.png", "")
        self.write("object/label_2/000000.txt", "")
        self.write("drive/image_02/data/0.png", "")
        self.write("drive/oxts/data/0.txt", "")
        self.write("bag/x.bag", b"#ROSBAG V2.0\n")
        self.write("w/segment.tfrecord", bytes(20))
        for name, words in {
            "av2": ["Argoverse 2", "pags import argoverse2"],
            "v2": ["parquet", "Waymo Open v2", "pags import waymo2"],
            "v2/vehicle_pose/1.parquet": ["parquet", "pags import waymo2"],
            "v2whole": ["Waymo Open v2", "pags import waymo2"],
            "panda": ["PandaSet", "pags import pandaset"],
            "av2/city_SE3_egovehicle.feather": ["feather", "pags import argoverse2"],
            "nusc": ["nuScenes", "pags import nuscenes"],
            "k360": ["KITTI-360", "pags import kitti360"],
            "object": ["object benchmark", "raw recording is needed"],
            "drive": ["raw recording of KITTI", "pags import kitti"],
            "bag": ["ROS bags"],
            "bag/x.bag": ["ROS bag"],
            "w": ["Waymo Open v1", "pags import waymo"],
            "w/segment.tfrecord": ["Waymo Open", "pags import waymo"],
        }.items():
            self.fails(["info", self.path(name)], self.path(name), *words)
            self.fails(["train", self.path(name), "-o", self.path("scene")], self.path(name), *words)

    def test_kind_with_another_layout(self):
        """--kind with data that isn't in drivestudio's layout reports what was found and expected."""
        out = ["-o", self.path("scene"), "--kind"]
        self.write("av2/city_SE3_egovehicle.feather", b"ARROW1\0\0")
        self.fails(
            ["train", self.path("av2"), *out, "argoverse2"], "a log of Argoverse 2; pags import argoverse2 reads it"
        )
        self.write("static/transforms.json", "{}")
        words = ["static: not in drivestudio's layout", "--kind waymo", "expected the folders images"]
        self.fails(["train", self.path("static"), *out, "waymo"], *words, "found no folder images", "without --kind")
        self.write("static/images/0_0.png", "")
        self.fails(["info", self.path("static"), "--kind", "waymo"], *words, "neither extrinsics nor ego_pose")

    def test_importers_name_other_formats(self):
        if run("import", "--help").returncode:
            self.skipTest("this build has no pags import")
        out = self.path("out")
        self.fails(["import", "waymo", self.write("a.parquet", b"PAR1" + bytes(60)), "-o", out], "parquet", "TFRecord")
        self.fails(["import", "waymo", self.write("a.tfrecord", b"\x1f\x8b" + bytes(60)), "-o", out], "gunzip")
        self.fails(
            ["import", "waymo", self.write("b.tfrecord", b"<!DOCTYPE html>" + bytes(60)), "-o", out], "download failed"
        )
        self.fails(["import", "waymo", os.path.dirname(self.write("w/a.tfrecord", b"")), "-o", out], "is a folder")
        self.write("av2/city_SE3_egovehicle.feather", b"ARROW1\0\0")
        self.fails(["import", "kitti", self.path("av2"), "-o", out], "Argoverse 2")
        self.assertFalse(os.path.exists(out))


if __name__ == "__main__":
    fixtures.main()
