# SPDX-License-Identifier: Apache-2.0
"""Recordings and labels as people bring them: boxes and poses with faults, odd forms of KITTI's and Waymo's files."""

import json
import math
import os
import re
import shutil

import fixtures
from fixtures import Case, read, run, write

FRAMES = 12


class Street(Case):
    """A short synthetic street, to which a test does one thing."""

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
        """What info says about the set, as JSON."""
        return json.loads(self.succeeds("info", self.set, *options, "--json", "-").stdout)

    def warned(self, *parts):
        """The one warning of info, which has all these parts; --strict makes it an error."""
        warnings = self.info()["warnings"]
        self.assertEqual(len(warnings), 1, warnings)
        for part in parts:
            self.assertIn(part, warnings[0])
        self.fails(["info", self.set, "--strict"], parts[0])


class Labels(Street):
    def test_good_ones_give_no_warning(self):
        said = self.info()
        self.assertEqual(said["warnings"], [])
        self.assertEqual(said["objects_moving"]["all"] + said["objects_parked"]["all"], len(self.instances))

    def test_removed_object(self):
        gone = self.instances.pop("3")
        self.save()
        listing = os.path.join(self.set, "instances/frame_instances.json")
        frames = len(gone["frame_annotations"]["frame_idx"])
        self.warned("frame_instances.json: %d entries name instances" % frames, "the first is 3 in frame")
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
        """The labels of the car as training uses them, written to a scene by the shortest of trainings."""
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

    def test_box_aside(self):
        for frames in [[5], [5, 6], [0]]:
            self.instances = json.loads(read(os.path.join(self.street, "instances/instances_info.json")))
            true = self.aside(frames, 1, 3)
            self.warned(f"instances_info.json: {len(frames)} of ", "lie aside", f"Car 'moving_car_027' in frame {frames[0]}")
            for frame, m in self.knots().items():
                far = math.dist(m[3::4], true[frame][3::4])
                self.assertLess(far, 0.6 if frame in frames else 1e-9, frame)

    def test_parked_car_with_a_box_aside_is_parked(self):
        parked = self.info()["objects_parked"]["vehicle"]
        name = next(v["id"] for v in self.instances.values() if "parked" in v["id"] and len(v["frame_annotations"]["frame_idx"]) > 6)
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

    def test_missing(self):
        os.remove(os.path.join(self.set, "ego_pose/005.txt"))

        def unknown(rows):
            rows[0][3] = math.nan

        self.pose(7, unknown)
        self.fails(["info", self.set], "no such pose", "ego_pose/005.txt", "2 of 12 poses are missing", "--allow-missing")
        said = self.info("--allow-missing")
        self.assertEqual((said["views_missing"], said["lidar_sweeps"]), (2, 10))
        self.assertEqual(len(said["warnings"]), 1)
        self.assertIn("2 of 12 poses are missing and left out", said["warnings"][0])
        self.succeeds("train", self.set, "--allow-missing", "-o", self.path("scene"), "--iterations", "2")
        write(os.path.join(self.set, "ego_pose/005.txt"), "1 2 x\n")
        self.fails(["info", self.set, "--allow-missing"], "ego_pose/005.txt:1: expected a number, found 'x'")


if __name__ == "__main__":
    fixtures.main()
