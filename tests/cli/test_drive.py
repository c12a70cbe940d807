# SPDX-License-Identifier: Apache-2.0
"""Tests pags render and pags info on a scene made by hand, with moving and parked objects and a sky."""

import json
import os
import struct

import fixtures
from fixtures import Case, files_below, ply_bytes, read, read_png, splat, write

# In the world, x points ahead, y left and z up. A point (10, y, 0) in front of the camera at the origin is drawn in
# column 50.5 - 10 y.
ORIGIN = [500000.0, 2000.0, 10.0]
AHEAD = [0.5, 0.5, -0.5, 0.5]  # the camera's axes in the world: right = -y, down = -z, forward = x


def camera(x=0.0, **more):
    """Returns a camera (OpenCV axes) at ORIGIN + (x, 0, 0) that looks along the world's x axis."""
    eye = [ORIGIN[0] + x, ORIGIN[1], ORIGIN[2]]
    lens = {"width": 101, "height": 101, "fx": 100.0, "fy": 100.0, "cx": 50.5, "cy": 50.5}
    pose = {
        "camera_from_world_quaternion_wxyz": AHEAD,
        "camera_from_world_translation": [eye[1], eye[2], -eye[0]],
    }
    return {**lens, **pose, **more}


def knot(frame, y, yaw_right):
    rotation = [[0, 1, 0], [-1, 0, 0], [0, 0, 1]] if yaw_right else [[1, 0, 0], [0, 1, 0], [0, 0, 1]]
    position = [ORIGIN[0] + 10, ORIGIN[1] + y, ORIGIN[2]]
    pose = [v for row, p in zip(rotation, position) for v in [*row, p]]
    return {
        "frame": frame,
        "time": 100.0 + frame,
        "trained": True,
        "world_from_object": pose,
        "rotation": [0, 0, 0],
        "translation": [0, 0, 0],
    }


def with_object_id(rows, ids):
    """Returns the bytes of ply_bytes with the property object_id added."""
    plain = ply_bytes(rows)
    head, body = plain.split(b"end_header\n", 1)
    size = len(body) // len(rows)
    packed = b"".join(body[i * size : (i + 1) * size] + struct.pack("<i", n) for i, n in enumerate(ids))
    return head + b"property int object_id\nend_header\n" + packed


def sky_npy(rgb):
    header = "{'descr': '<f2', 'fortran_order': False, 'shape': (6, 1, 1, 3), }"
    text = header.ljust(128 - 11) + "\n"
    return b"\x93NUMPY\x01\x00" + struct.pack("<H", len(text)) + text.encode() + struct.pack("<18e", *rgb * 6)


def make_drive(folder, more=()):
    """Writes a drive. A red car drives from left to right within 2 s, a green car is parked, and a white wall is far
    ahead and above. The recording car drives forward by 2 m. No path may follow its side camera (sensor 1). `more`
    holds further rows of the background."""
    solid = {"sigma": 0.1, "opacity": 12.0}
    rows = [splat(10, 0, 3, (1, 1, 1), **solid), splat(10, 1.5, 0, (0, 1, 0), **solid), *more]
    write(os.path.join(folder, "background.ply"), with_object_id(rows, [-1, 0] + [-1] * len(more)))
    write(os.path.join(folder, "objects", "car.ply"), ply_bytes([splat(0, 0, 0, (1, 0, 0), **solid)]))
    write(os.path.join(folder, "sky.npy"), sky_npy([0.0, 0.0, 0.5]))
    record = {"class": "Car", "category": "vehicle", "size": [4.0, 2.0, 1.5]}
    views = []
    for t in range(3):
        front = {"name": f"{t:03d}_0.jpg", "sensor": 0, "frame": t, "test": t == 1}
        views.append({**front, **camera(x=float(t), time=100.0 + t), "gain": [1 + 0.1 * t] * 3, "offset": [0, 0, 0]})
        views.append({"name": f"{t:03d}_1.jpg", "sensor": 1, "frame": t, **camera(x=50.0, time=100.0 + t)})
    scene = {
        "version": 1,
        "units": "metres",
        "origin": ORIGIN,
        "up": "z",
        "time": [100.0, 102.0],
        "fps": 1,
        "background": [0, 0, 0],
        "models": [
            {"name": "background", "file": "background.ply", "gaussians": len(rows), "sh_degree": 0},
            {"name": "car", "file": "objects/car.ply", "gaussians": 1, "sh_degree": 0},
        ],
        "sky": "sky.npy",
        "modelled": {
            "sky": "seen in 40 % of the pixels",
            "fourier": {"kept": 0, "why": ["no gain"]},
            "objects": [{"id": "c=2", "modelled": True, "why": "moves"}],
        },
        "objects": [
            {**record, "id": "p,1", "moving": False, "model": None, "knots": [knot(0, 1, False)]},
            {
                **record,
                "id": "c=2",
                "moving": True,
                "model": "car",
                "knots": [knot(i, 4 - 4 * i, True) for i in range(3)],
            },
        ],
        "cameras": views,
    }
    write(os.path.join(folder, "scene.json"), json.dumps(scene))
    return folder


def column(path, channel):
    """Returns the column of the picture's middle row at which a channel is brightest. Returns None if the row is dark
    there or has another colour."""
    width, height, _, _, rows = read_png(path)
    row = rows[height // 2 * width * 3 :][: width * 3]
    best = max(range(width), key=lambda x: row[3 * x + channel])
    others = max(row[3 * best + c] for c in range(2) if c != channel)
    return best if row[3 * best + channel] > 150 and others < 100 else None


class Drive(Case):
    def setUp(self):
        super().setUp()
        self.scene = make_drive(self.path("scene"))
        self.front = self.write("front.json", json.dumps(camera()))
        self.count = 0

    def render(self, *options):
        self.count += 1
        out = self.path(f"out{self.count}")
        self.succeeds("render", self.scene, "-o", out, *options)
        return out

    def columns(self, *options):
        """Returns the columns of the red and the green object in the picture of the camera at the origin."""
        picture = os.path.join(self.render("--camera", self.front, *options), "00000.png")
        return column(picture, 0), column(picture, 1)

    def test_time(self):
        self.assertEqual(self.columns(), (10, 35))  # by default, the time is the scene's begin
        self.assertEqual(self.columns("--time", 1), (50, 35))
        self.assertEqual(self.columns("--time", 0.5), (30, 35))
        self.assertEqual(self.columns("--time", 2.25), (90, 35))
        late = self.write("late.json", json.dumps(camera(time=101.25)))
        self.assertEqual(column(os.path.join(self.render("--camera", late), "00000.png"), 0), 60)
        self.assertEqual(column(os.path.join(self.render("--camera", late, "--time", 0), "00000.png"), 0), 10)
        self.fails(["render", self.scene, "-o", self.path("x"), "--time", 9], "--time", "from 0 to 2 s")

    def test_sky(self):
        out = self.render("--camera", self.front)
        _, _, _, _, rows = read_png(os.path.join(out, "00000.png"))
        self.assertEqual(tuple(rows[:3]), (0, 0, 128))
        out = self.render("--camera", self.front, "--background", "1,0,0")
        _, _, _, _, rows = read_png(os.path.join(out, "00000.png"))
        self.assertEqual(tuple(rows[:3]), (255, 0, 0))

    def test_option_without(self):
        self.assertEqual(self.columns("--time", 1, "--without", "c=2"), (None, 35))
        self.assertEqual(self.columns("--time", 1, "--without", "class:Vehicle"), (None, None))
        self.assertEqual(self.columns("--time", 1, "--without", "class:car,c=2"), (None, None))
        message = self.fails(
            ["render", self.scene, "-o", self.path("x"), "--without", "cc"], "--without", "2 objects", "'cc'"
        )
        self.assertNotIn("\n", message)
        self.fails(["render", self.scene, "-o", self.path("x"), "--without", "class:cyclist"], "class:cyclist")

    def test_option_move(self):
        # The parked car faces right, so a move ahead is a move to the right. The id of the red car has a '='.
        self.assertEqual(self.columns("--time", 1, "--move", "c=2=1,0,0,0"), (60, 35))
        self.assertEqual(self.columns("--time", 1, "--move", "p,1", "0,1,0,0"), (50, 25))
        self.assertEqual(self.columns("--time", 1, "--move", "p,1=0,0,0,180", "--without", "c=2"), (None, 45))
        both = ["--move", "p,1", "0,-1,0,0", "--move=c=2=-3,0,0,0"]
        self.assertEqual(self.columns("--time", 1, *both), (20, 45))
        self.assertEqual(self.columns("--time", 1, "--add", "p,1", "0,-1,0,0", "--without", "p,1"), (50, 45))
        self.fails(
            ["render", self.scene, "-o", self.path("x"), "--move", "p,1", "0,1,0"], "X,Y,Z,YAW", "'0,1,0'", code=2
        )
        self.fails(["render", self.scene, "-o", self.path("x"), "--move", "q", "0,1,0,0"], "--move", "'q'")

    def test_path_of_the_recording_car(self):
        out = self.render("--path", "ego")
        self.assertEqual(files_below(out), ["00000.png", "00001.png", "00002.png"])
        # The red car drives from (10, 4) to (10, -4) while the camera drives forward by 2 m.
        self.assertEqual([column(os.path.join(out, f"{i:05d}.png"), 0) for i in (0, 1)], [10, 50])
        out = self.render("--path", "ego", "--fps", 2)
        self.assertEqual(len(files_below(out)), 5)
        # At 100.5 s the camera has moved by 0.5 m: column 50.5 - 100 * 2 / 9.5.
        middle = column(os.path.join(out, "00001.png"), 0)
        self.assertEqual(middle, int(50.5 - 200 / 9.5))
        self.assertEqual(len(files_below(self.render("--path", "ego", "-n", 7))), 7)
        out = self.render("--path", "ego", "-n", 2, "--shift", 1, "--time", 1)
        self.assertEqual(column(os.path.join(out, "00000.png"), 0), 40)
        out = self.render("--path", "ego", "-n", 2, "--shift", -1, "--time", 1)
        self.assertEqual(column(os.path.join(out, "00000.png"), 0), 60)
        self.fails(["render", self.scene, "-o", self.path("x"), "--shift", 1], "--path ego", code=2)

    def test_views_have_their_times(self):
        out = self.render("--split", "train")
        self.assertIn("002_0.png", files_below(out))
        self.assertEqual(column(os.path.join(out, "000_0.png"), 0), 10)
        out = self.render("--split", "test")
        self.assertEqual(files_below(out), ["001_0.png"])
        self.assertEqual(column(os.path.join(out, "001_0.png"), 0), 50)

    def test_same_bits_on_any_number_of_threads(self):
        outs = [
            self.render("--path", "ego", "--fps", 3, "-j", n, "--bits", 16, "--add", "c=2", "1,1,0,5")
            for n in (1, 2, 3)
        ]
        for name in files_below(outs[0]):
            for other in outs[1:]:
                self.assertEqual(read(os.path.join(outs[0], name)), read(os.path.join(other, name)))

    def test_channels(self):
        out = self.render("--camera", self.front, "--time", 1, "--channel", "color,object,priority,normal,heat")
        names = [
            "00000.png",
            "00000_heat.png",
            "00000_normal.exr",
            "00000_object.exr",
            "00000_priority.exr",
            "objects.json",
        ]
        self.assertEqual(files_below(out), names)
        table = json.loads(read(os.path.join(out, "objects.json")))
        self.assertEqual((table["version"], table["channel"], table["background"]), (1, "object", -1))
        listed = [(o["number"], o["name"], o["id"], o["class"], o["category"], o["moving"]) for o in table["objects"]]
        self.assertEqual(
            listed, [(0, "car_0000", "p,1", "Car", "vehicle", False), (1, "car_0001", "c=2", "Car", "vehicle", True)]
        )
        width, _, _, _, rows = read_png(os.path.join(out, "00000_heat.png"))
        at = (50 * width + 50) * 3
        self.assertGreater(rows[at], 240)  # critical objects are bright in the heat picture
        at = (20 * width + 50) * 3
        self.assertLess(rows[at], 30)  # the wall is dark in the heat picture
        self.assertGreater(rows[at + 2], 30)

    def test_info(self):
        facts = json.loads(self.succeeds("info", self.scene, "--json", "-", "--memory").stdout)
        self.assertEqual((facts["gaussians"], facts["time"], facts["sky_texels_a_side"]), (3, [100, 102], 1))
        vehicles = facts["objects"][0]
        wanted = {"name": "vehicle", "count": 2, "moving": 1, "parked": 1, "own_models": 1, "rigid_models": 1}
        self.assertEqual({key: vehicles[key] for key in wanted}, wanted)
        self.assertEqual(facts["models"][1]["object"], "c=2")
        self.assertEqual(facts["modelled"]["fourier"], {"kept": 0, "why": ["no gain"]})
        self.assertEqual((facts["tracks"]["knots"], facts["exposure"]["views"]), (3, 2))
        self.assertNotIn("every_object", facts)
        listed = json.loads(self.succeeds("info", self.scene, "--objects", "--json", "-").stdout)["every_object"]
        self.assertEqual(
            [(o["name"], o["model"], o["gaussians"]) for o in listed], [("p,1", "background", 1), ("c=2", "car", 1)]
        )
        text = self.succeeds("info", self.scene).stdout
        self.assertRegex(text, r"(?m)^  sky +seen in 40 % of the pixels$")
        self.assertRegex(text, r"(?m)^    c=2 +modelled yes, why moves$")
        self.assertRegex(text, r"(?m)^  car +Car, 1 Gaussians of SH degree 0, ")

    def test_names_that_options_accept(self):
        text = read(os.path.join(self.scene, "scene.json")).decode()
        write(os.path.join(self.scene, "scene.json"), text.replace('"c=2"', '"a_car_2"'))
        text = self.succeeds("info", self.scene, "--objects").stdout
        self.assertRegex(text, r"(?m)^    a_car_2 +modelled yes, why moves$")
        self.assertRegex(text, r"(?m)^  a_car_2$")
        self.assertEqual(self.columns("--time", 1, "--without", "a_car_2"), (None, 35))

    def test_bad_scene(self):
        text = read(os.path.join(self.scene, "scene.json")).decode()
        write(os.path.join(self.scene, "scene.json"), text.replace('"model": "car"', '"model": "bus"'))
        self.fails(["info", self.scene], "scene.json:1", '"bus"')


if __name__ == "__main__":
    fixtures.main()
