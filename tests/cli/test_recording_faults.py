# SPDX-License-Identifier: Apache-2.0
"""Tests recordings whose faults aren't refused. Missing or impossible entries are reported with their numbers and do no
harm."""

import array
import json
import math
import os
import random
import shutil

import fixtures
from fixtures import Case, read, run, write
from test_recordings import FRAMES, Street


class Frames(Street):
    """Held-out frames are chosen by the count of time steps, not by the numbers of the frames."""

    def number(self, first, step):
        """Gives the frames the numbers first, first + step and so on."""
        names = sorted(
            os.path.join(folder, name)
            for folder, _, files in os.walk(self.set)
            for name in files
            if name[:3].isdigit() and "truth" not in folder
        )
        for name in reversed(names):
            folder, file = os.path.split(name)
            os.rename(name, os.path.join(folder, f"{first + step * int(file[:3]):03d}{file[3:]}"))
        for v in self.instances.values():
            at = v["frame_annotations"]
            at["frame_idx"] = [first + step * t for t in at["frame_idx"]]
        self.save()
        listing = os.path.join(self.set, "instances/frame_instances.json")
        write(listing, json.dumps({str(first + step * int(k)): v for k, v in json.loads(read(listing)).items()}))
        os.remove(os.path.join(self.set, "timestamps.json"))

    def test_numbers_with_gaps(self):
        for first, step in ((0, 4), (3, 8)):
            with self.subTest(first=first, step=step):
                shutil.rmtree(self.set)
                shutil.copytree(self.street, self.set)
                self.instances = json.loads(read(self.file))
                self.number(first, step)
                said = self.info()
                self.assertEqual((said["views_train"], said["views_test"]), (FRAMES - 2, 2))
                said = self.info("--overlay", self.path(f"overlay{first}"), "--sheet", self.path(f"sheet{first}.png"))
                self.assertEqual(said["overlay"]["pictures"], FRAMES)

    def test_a_part_has_the_steps_of_the_whole(self):
        said = self.info("--frames", "3-8")
        self.assertEqual((said["views_train"], said["views_test"]), (4, 2))


class Sweeps(Street):
    def sweep(self, frame, change):
        """Rewrites a sweep. change() gets a list of its rows and returns the new list."""
        path = os.path.join(self.set, f"lidar/{frame:03d}.bin")
        values = array.array("f", read(path))
        rows = change([list(values[i : i + 4]) for i in range(0, len(values), 4)])
        write(path, array.array("f", [v for row in rows for v in row]).tobytes())
        return len(rows)

    def test_rows_that_are_not_points(self):
        beams = lambda value: lambda rows: [r for row in rows for r in (row, value)]
        count = [
            self.sweep(3, beams([0, 0, 0, 0])),
            self.sweep(4, beams([math.nan] * 4)),
            self.sweep(5, beams([1.5, 0, 1.875, 0])),
            self.sweep(6, lambda rows: rows + [[1e7, 0, 0, 0]]),
        ]
        left_out = [n // 2 for n in count[:3]]
        self.warned(
            f"lidar: {sum(left_out) + 1} of ",
            f"in {FRAMES} sweeps are no points and left out: {left_out[1]} not finite, "
            f"{left_out[0] + left_out[2]} without a return",
            "1 beyond 1000 m",
            "the first such sweep is 003.bin",
        )
        clean = self.path("clean")
        shutil.copytree(self.street, clean)
        for source, scene in ((clean, "a"), (self.set, "b")):  # rows that aren't points change nothing in a training
            self.succeeds("train", source, "-o", self.path(scene), "--iterations", "2")
        self.assertEqual(read(self.path("a/background.ply")), read(self.path("b/background.ply")))

    def test_sweeps_without_a_point(self):
        for frame in (FRAMES // 2, FRAMES // 2 + 1):  # info checks the form of all sweeps in the middle one
            self.sweep(frame, lambda rows: [[0.0] * 4 for _ in rows])
        warnings = self.info()["warnings"]
        self.assertEqual(len(warnings), 2, warnings)
        self.assertIn(f"2 of {FRAMES} sweeps have no points, the first is 006.bin", warnings[1])

    def test_sweeps_with_few_returns(self):
        for frame in range(FRAMES):
            self.sweep(frame, lambda rows: [r for row in rows for r in (row, [0] * 4, [0] * 4, [0] * 4)])
        self.warned("without a return")


class Boxes(Street):
    def test_files_without_objects(self):
        """The files list no objects. Moving objects are then left out of the loss, as in a set without these files."""
        listing = os.path.join(self.set, "instances/frame_instances.json")
        for instances, listed in (({}, {}), (self.instances, {str(t): [] for t in range(FRAMES)})):
            write(self.file, json.dumps(instances))
            write(listing, json.dumps(listed))
            said = self.info()
            self.assertTrue([w for w in said["warnings"] if "has a box at a time step used" in w], said["warnings"])
            self.assertTrue([n for n in said["notes"] if "left out of the loss" in n], said["notes"])

    def test_steps_without_a_box(self):
        """Some time steps have no boxes. Nothing models moving objects there, as in a set without boxes."""
        for v in self.instances.values():
            at = v["frame_annotations"]
            for key in list(at):
                at[key] = [x for f, x in zip(at["frame_idx"], at[key]) if f < 7] if key != "frame_idx" else at[key]
            at["frame_idx"] = [f for f in at["frame_idx"] if f < 7]
        self.save()
        said = self.info()
        self.assertTrue(
            [n for n in said["notes"] if "no boxes at 5 of 12 time steps, the first is 007" in n], said["notes"]
        )

    def test_boxes_of_no_size(self):
        name, at = self.cyclist()
        for i in (2, 3):
            at["box_size"][i] = [1e-6, 1e-6, 1e-6]
        self.save()
        self.warned(
            "instances_info.json: 2 of ",
            "a side is shorter than 0.01 m",
            f"Cyclist '{name}' in frame {at['frame_idx'][2]}",
        )

    def test_two_boxes_in_one_frame(self):
        at = self.annotations("moving_car_027")
        true = at["obj_to_world"][6]
        wrong = [[v + (9 if i == 1 and k == 3 else 0) for k, v in enumerate(row)] for i, row in enumerate(true)]
        for key, value in (("frame_idx", at["frame_idx"][6]), ("obj_to_world", wrong), ("box_size", at["box_size"][6])):
            at[key].insert(6, value)
        self.save()
        self.warned(
            "instances_info.json: 1 of ",
            "another in the same frame",
            f"Car 'moving_car_027' in frame {at['frame_idx'][6]}",
        )
        self.succeeds("train", self.set, "-o", self.path("scene"), "--iterations", "1")
        car = next(o for o in json.loads(read(self.path("scene/scene.json")))["objects"] if o["id"] == "moving_car_027")
        self.assertAlmostEqual(car["knots"][6]["world_from_object"][7], true[1][3], 9)

    def objects(self):
        self.succeeds("train", self.set, "-o", self.path("scene"), "--iterations", "1", "--overwrite")
        return {o["id"]: o for o in json.loads(read(self.path("scene/scene.json")))["objects"]}

    def test_id_given_to_another_car(self):
        """A second car gets the id of the first. Each car becomes a separate object with its labels."""
        a, b = self.annotations("moving_car_027"), self.annotations("moving_car_030")
        for key in ("obj_to_world", "box_size", "frame_idx"):
            both = [[v for f, v in zip(at["frame_idx"], at[key]) if (f < 6) == (at is a)] for at in (a, b)]
            a[key + "_"] = both[0] + both[1]
        for key in ("obj_to_world", "box_size", "frame_idx"):
            a[key] = a.pop(key + "_")
        true = dict(zip(a["frame_idx"], a["obj_to_world"]))
        self.save()
        self.warned(
            "instances_info.json: 1 of ", "ids go from one thing to another", "Car 'moving_car_027', to 2 things"
        )
        objects = self.objects()
        for name, frames in (("moving_car_027", range(6)), ("moving_car_027-part2", range(6, FRAMES))):
            knots = {k["frame"]: k["world_from_object"] for k in objects[name]["knots"]}
            self.assertEqual(sorted(knots), list(frames))
            for frame in frames:
                self.assertLess(math.dist(knots[frame][3::4], [row[3] for row in true[frame][:3]]), 1e-9)

    def parked(self):
        """Returns the labels of a parked car that is labelled in all frames, and the number of moving cars."""
        moving = self.info()["objects_moving"]["vehicle"]
        return next(
            v["frame_annotations"]
            for v in self.instances.values()
            if "parked_car" in v["id"] and len(v["frame_annotations"]["frame_idx"]) == FRAMES
        ), moving

    def test_parked_cars_stay_parked(self):
        at, moving = self.parked()
        places = [[row[3] for row in m[:2]] for m in at["obj_to_world"]]
        draw = random.Random(3)
        white = [[draw.gauss(0, 0.8) for _ in range(2)] for _ in range(FRAMES)]
        ends = [
            [draw.gauss(0, 0.1) + (2.6 if i in (0, FRAMES - 2, FRAMES - 1) and k == 0 else 0) for k in range(2)]
            for i in range(FRAMES)
        ]
        slow = [[0.9 * math.sin(i * 1.1 + k) for k in range(2)] for i in range(FRAMES)]  # the box swings to and fro
        for what, error in (("white", white), ("ends", ends), ("slow", slow)):
            with self.subTest(what):
                for m, place, e in zip(at["obj_to_world"], places, error):
                    m[0][3], m[1][3] = place[0] + e[0], place[1] + e[1]
                self.save()
                said = self.info()
                self.assertEqual(said["objects_moving"]["vehicle"], moving, said["warnings"])
                self.assertTrue(said["warnings"])

    def test_slow_cars_move(self):
        at, moving = self.parked()
        for i, m in enumerate(at["obj_to_world"]):
            m[0][3] += 0.2 * i + 0.05 * (-1) ** i
        self.save()
        said = self.info()
        self.assertEqual((said["objects_moving"]["vehicle"], said["warnings"]), (moving + 1, []))


class Drive(Case):
    """Tests a street with two cameras, wide enough to check the content of its photographs."""

    @classmethod
    def setUpClass(cls):
        super().setUpClass()
        cls.street = os.path.join(cls.shared_folder(), "drive")
        size = [
            "--frames",
            FRAMES,
            "--size",
            "160x90",
            "--cameras",
            "2",
            "--no-shifts",
            "--samples",
            "4",
            "--lidar-points",
            "8000",
        ]
        made = run("synth", "street", "-q", "-o", cls.street, *size)
        assert made.returncode == 0, made.stderr

    def setUp(self):
        super().setUp()
        self.set = self.path("set")
        shutil.copytree(self.street, self.set)

    def warns(self, *parts):
        warnings = json.loads(self.succeeds("info", self.set, *self.options, "--json", "-").stdout)["warnings"]
        self.assertEqual(len(warnings), 1 if parts else 0, warnings)
        for part in parts:
            self.assertIn(part, warnings[0])

    options = ()

    def photograph(self, frame, camera):
        return os.path.join(self.set, f"images/{frame:03d}_{camera}.png")

    def matrices(self, change, *folders):
        """Rewrites the poses in folders. change() gets 4 rows and returns 4 rows."""
        for folder in folders:
            for name in os.listdir(os.path.join(self.set, folder)):
                path = os.path.join(self.set, folder, name)
                rows = change([[float(x) for x in line.split()] for line in read(path).decode().splitlines()])
                write(path, "".join(" ".join(map(repr, row)) + "\n" for row in rows))

    def boxes(self, change):
        file = os.path.join(self.set, "instances/instances_info.json")
        instances = json.loads(read(file))
        for v in instances.values():
            at = v["frame_annotations"]
            at["obj_to_world"] = [change(m) for m in at["obj_to_world"]]
        write(file, json.dumps(instances))

    def test_good_drive_gives_no_warning(self):
        self.warns()

    def test_camera_that_repeats_a_photograph(self):
        for frame in range(5, 9):
            shutil.copy(self.photograph(4, 1), self.photograph(frame, 1))
        self.warns(
            "images: 4 of 24 photographs looked at repeat an earlier one though the camera moved",
            "the first is 005_1.png, which shows what 004_1.png does",
            "--allow-missing",
        )
        self.assertIn(
            "repeat an earlier one", self.succeeds("train", self.set, "-o", self.path("s"), "--iterations", "1").stderr
        )

    def test_black_photographs(self):
        # The photographs are black with some noise.
        black = fixtures.png_bytes(160, 90, bytes(3 + i * 7 % 5 for i in range(3 * 160 * 90)))
        for frame in (3, 4, 10):
            write(self.photograph(frame, 0), black)
        self.warns("images: 3 of 24 photographs looked at show nothing", "the first is 003_0.png (mean ")

    def test_photographs_of_another_camera(self):
        for frame in range(FRAMES):
            shutil.copy(self.photograph(frame, 0), self.photograph(frame, 1))
        warnings = json.loads(self.succeeds("info", self.set, "--json", "-").stdout)["warnings"]
        self.assertIn(
            "12 of 24 photographs looked at are those of another camera; the first is 000_1.png", "\n".join(warnings)
        )

    def test_camera_with_held_out_photographs_only(self):
        for frame in range(FRAMES):
            if frame % 4:
                os.remove(self.photograph(frame, 1))
        self.fails(["info", self.set], "9 of 24 images are missing")
        said = json.loads(self.succeeds("info", self.set, "--allow-missing", "--json", "-").stdout)
        self.assertEqual((said["views_train"], said["views_test"], said["views_missing"]), (11, 4, 9))
        self.assertIn(
            "1 of 2 cameras are held out, the first is camera 1, 2 of whose 3 photographs are",
            "\n".join(said["warnings"]),
        )

    def test_mirrored(self):
        """Poses, boxes and sweeps are mirrored to left-handed axes. Only the photographs show this."""
        flip = lambda m: [[v if (i == 1) == (k == 1) else -v for k, v in enumerate(row)] for i, row in enumerate(m)]
        mount = lambda m: [[-m[0][0], *m[0][1:]], [m[1][0], *[-v for v in m[1][1:]]], [-m[2][0], *m[2][1:]], m[3]]
        self.matrices(flip, "ego_pose")
        self.matrices(mount, "extrinsics")
        self.boxes(flip)
        for name in os.listdir(os.path.join(self.set, "lidar")):
            path = os.path.join(self.set, "lidar", name)
            values = array.array("f", read(path))
            for i in range(1, len(values), 4):
                values[i] = -values[i]
            write(path, values.tobytes())
        self.warns("pairs of photographs fit their cameras' poses better mirrored", "left-handed", "negate y")
        shutil.rmtree(os.path.join(self.set, "lidar"))
        self.warns("left-handed")

    def turned(self, turn, offset):
        product = lambda m: (
            [
                [sum(turn[i][k] * m[k][j] for k in range(3)) + (offset[i] if j == 3 else 0) for j in range(4)]
                for i in range(3)
            ]
            + [m[3]]
        )
        self.matrices(product, "ego_pose")
        self.boxes(product)

    def test_earth_fixed_axes(self):
        a, b = math.radians(49), math.radians(8.4)
        east, north = (
            [-math.sin(b), math.cos(b), 0],
            [-math.sin(a) * math.cos(b), -math.sin(a) * math.sin(b), math.cos(a)],
        )
        up = [math.cos(a) * math.cos(b), math.cos(a) * math.sin(b), math.sin(a)]
        self.turned([list(row) for row in zip(east, north, up)], [6378137 * v for v in up])
        self.warns("ego_pose: positions are 63", "41 degrees off the world's z", "ECEF", "east, north, up")

    def test_world_that_leans(self):
        c, s = math.cos(0.5), math.sin(0.5)
        self.turned([[1, 0, 0], [0, c, -s], [0, s, c]], [0, 0, 0])
        self.warns("upward direction is 28 degrees off its z", "expected z up")

    def test_hill_gives_no_warning(self):
        c, s = math.cos(0.2), math.sin(0.2)
        self.turned(
            [[c, 0, -s], [0, 1, 0], [s, 0, c]], [5e5, 6.3e6, 300]
        )  # UTM coordinates, as far from zero as the earth's centre
        self.warns()

    def test_boxes_of_other_axes(self):
        self.boxes(lambda m: [[row[0], -row[2], row[1], row[3]] for row in m[:3]] + [m[3]])
        self.warns("boxes stand 9", " degrees off the cameras' upward direction")

    def test_repeated_poses(self):
        for frame in (4, 8):
            shutil.copy(
                os.path.join(self.set, f"ego_pose/{frame - 1:03d}.txt"),
                os.path.join(self.set, f"ego_pose/{frame:03d}.txt"),
            )
        warnings = json.loads(self.succeeds("info", self.set, "--json", "-").stdout)["warnings"]
        self.assertIn(
            "ego_pose: 2 of 11 poses repeat the one before though the car drives on; the first is of frame 004",
            "\n".join(warnings),
        )


if __name__ == "__main__":
    fixtures.main()
