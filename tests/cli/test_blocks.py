# SPDX-License-Identifier: Apache-2.0
"""Tests pags split and pags merge. Blocks made by hand check the merging row by row. A small street is split, trained
and merged."""

import json
import os
import shutil
import signal
import struct
import subprocess

import fixtures
from fixtures import Case, files_below, ply_bytes, read, splat, write
from test_drive import AHEAD, with_object_id

ID = "0123456789abcdef"


def ply_rows(path):
    """Returns the rows of a PLY file written by pags. Each row is a dictionary of its properties."""
    head, body = read(path).split(b"end_header\n", 1)
    names = [line.split()[1:] for line in head.decode().splitlines() if line.startswith("property ")]
    form = "<" + "".join({"float": "f", "int": "i"}[kind] for kind, _ in names)
    return [dict(zip([name for _, name in names], row)) for row in struct.iter_unpack(form, body)]


def load(*names):
    with open(os.path.join(*names)) as file:
        return json.load(file)


# ---- Blocks made by hand ----


def camera(x, origin=0.0):
    """Returns a camera at (x, 0, 0) that looks along the world's x axis. The scene's origin doesn't change the
    camera."""
    lens = {"width": 101, "height": 101, "fx": 100.0, "fy": 100.0, "cx": 50.5, "cy": 50.5}
    return {**lens, "camera_from_world_quaternion_wxyz": AHEAD, "camera_from_world_translation": [0, 0, -x]}


def knot(frame, x, trained, shift=0.0):
    pose = [1, 0, 0, x, 0, 1, 0, 0, 0, 0, 1, 0]
    return {
        "frame": frame,
        "time": float(frame),
        "trained": trained,
        "world_from_object": pose,
        "rotation": [0, 0, 0],
        "translation": [shift, 0, 0],
    }


def record(name, moving, knots, model=None):
    return {
        "id": name,
        "class": "Car",
        "category": "vehicle",
        "size": [4.0, 2.0, 1.5],
        "moving": moving,
        "model": model,
        "knots": knots,
    }


RANGES = [
    ((0, 5), (0, 3)),
    ((2, 9), (4, 7)),
    ((6, 11), (8, 11)),
]  # first and last trained time step, first and last own time step; the rig is at x = 10 m * time step


def make_blocks(folder):
    """Writes three blocks of a drive along x, with seams at x = 35 and 75 m."""
    blocks = [{"frames": list(used), "own": list(own)} for used, own in RANGES]
    write(
        os.path.join(folder, "split.json"),
        json.dumps(
            {
                "version": 1,
                "split": ID,
                "recording": "/no/such/drive",
                "length": 110.0,
                "block_length": 36.7,
                "overlap": 20.0,
                "blocks": blocks,
                "path": [[frame, 10.0 * frame, 0, 0] for frame in range(12)],
            }
        ),
    )
    for b in range(3):
        make_block(os.path.join(folder, f"{b:03d}"), b)
    return folder


def make_block(folder, b):
    (first, last), own = RANGES[b]
    write(
        os.path.join(folder, "block.json"),
        json.dumps(
            {
                "version": 1,
                "split": ID,
                "block": b,
                "blocks": 3,
                "recording": "/no/such/drive",
                "whole": None,
                "frames": [first, last],
                "own": list(own),
                "options": {},
            }
        ),
    )
    origin = [0.0, 0.0, 0.0] if b < 2 else [100.0, 0.0, 0.0]
    # Every block has rows at all places. The red value of a row is its block's number, the green value is the row's
    # number.
    places = [0, 30, 34, 36, 60, 74, 76, 110, 500]
    rows = [splat(x - origin[0], 0, 0, (0.1 * (b + 1), 0.05 * i, 0)) for i, x in enumerate(places)]
    ids = [-1] * len(rows)
    # The box of the parked car is at x = 34 m and reaches over the seam. The car belongs to block 0 only. Block 1 lists
    # it as its second object.
    objects = [record("parked", False, [knot(3, 34, True)])] if b < 2 else []
    if b < 2:
        rows += [splat(33, 1, 0, (0.1 * (b + 1), 0.5, 0)), splat(36, 1, 0, (0.1 * (b + 1), 0.55, 0))]
        ids += [1 if b else 0] * 2
    # The moving car is 30 m ahead of the rig at first and comes nearer. Block 1 sees more of it than block 0.
    models = [{"name": "background", "file": "background.ply", "gaussians": len(rows), "sh_degree": 0}]
    if b < 2:
        moving = record(
            "car", True, [knot(f, 10 * f + 30 - 3 * f, first <= f <= last, 0.25 * b) for f in range(10)], "car"
        )
        objects.insert(0 if b else 1, moving)
        models.append({"name": "car", "file": "objects/car.ply", "gaussians": 1, "sh_degree": 0})
        write(os.path.join(folder, "scene", "objects", "car.ply"), ply_bytes([splat(0, 0, 0, (0.1 * (b + 1), 0.9, 0))]))
    scene = {
        "version": 1,
        "units": "metres",
        "origin": origin,
        "up": "z",
        "time": [float(first), float(last)],
        "fps": 1,
        "models": models,
        "background": [0, 0, 0],
        "dataset": folder,
        "iterations": 30,
        "config": {"iterations": 30, "sh_degree": 0, "half_until": 0.1 * b},
        "block": {"split": ID, "number": b, "count": 3},
        "objects": objects,
        "cameras": [
            {
                "name": f"{f:03d}_0.png",
                "sensor": 0,
                "frame": f,
                "test": f == 4,
                **camera(10.0 * f),
                "time": float(f),
                "gain": [1 + 0.1 * b] * 3,
                "offset": [0, 0, 0],
            }
            for f in range(first, last + 1)
        ],
    }
    write(os.path.join(folder, "scene", "background.ply"), with_object_id(rows, ids))
    write(os.path.join(folder, "scene", "scene.json"), json.dumps(scene))


class Merge(Case):
    def setUp(self):
        super().setUp()
        self.blocks = make_blocks(self.path("blocks"))

    def change(self, b, **more):
        path = os.path.join(self.blocks, f"{b:03d}", "scene", "scene.json")
        write(path, json.dumps({**load(path), **more}))

    def refused(self, *words):
        said = self.fails(["merge", self.blocks, "-o", self.path("out")], *words)
        self.assertFalse(os.path.exists(self.path("out")))
        return said

    def test_rows(self):
        out = self.path("out")
        facts = json.loads(self.succeeds("merge", self.blocks, "-o", out, "--json", "-").stdout)
        scene = load(out, "scene.json")
        self.assertEqual(scene["dataset"], "/no/such/drive")
        self.assertNotIn("block", scene)
        self.assertEqual(scene["origin"], [33.0, 0, 0])
        self.assertEqual(scene["time"], [0, 11])

        # Each place occurs once, from the block whose cell holds it. The parked car comes whole from block 0.
        rows = ply_rows(os.path.join(out, "background.ply"))
        got = sorted(
            (round(row["x"] + 33, 3), round((row["f_dc_0"] * 0.28209479177387814 + 0.5) * 10) - 1, row["object_id"])
            for row in rows
        )
        parked = [o["id"] for o in scene["objects"]].index("parked")
        self.assertEqual(
            got,
            sorted(
                [
                    (0, 0, -1),
                    (30, 0, -1),
                    (34, 0, -1),
                    (36, 1, -1),
                    (60, 1, -1),
                    (74, 1, -1),
                    (76, 2, -1),
                    (110, 2, -1),
                    (500, 2, -1),
                    (33, 0, parked),
                    (36, 0, parked),
                ]
            ),
        )
        self.assertEqual(facts["gaussians"], 12)
        self.assertEqual(facts["ghosts"], 9 * 3 + 4 - 11)

        # The moving car occurs once, with the model and the track of block 1, whose rig comes nearer to the car.
        self.assertEqual([m["file"] for m in scene["models"]], ["background.ply", "objects/car.ply"])
        (car,) = ply_rows(os.path.join(out, "objects", "car.ply"))
        self.assertAlmostEqual(car["f_dc_0"] * 0.28209479177387814 + 0.5, 0.2, 5)
        (track,) = [o for o in scene["objects"] if o["id"] == "car"]
        self.assertEqual(track["model"], "car")
        self.assertEqual([k["translation"][0] for k in track["knots"]], [0.25] * 10)

        # Each view occurs once, with the exposure of the block that owns it.
        self.assertEqual([v["frame"] for v in scene["cameras"]], list(range(12)))
        self.assertEqual([round(v.get("gain", [1])[0], 3) for v in scene["cameras"]], [1.0] * 4 + [1.1] * 4 + [1.2] * 4)
        self.assertEqual([v["frame"] for v in scene["cameras"] if v["test"]], [4])
        self.succeeds("info", out, "--objects")

    def test_drive_that_comes_back(self):
        """The last block leads back, at a distance of 30 m from the second block's path. Objects along the outbound
        path stay in the second block."""
        path = os.path.join(self.blocks, "split.json")
        split = load(path)
        split["path"] = [[f, 10.0 * f if f < 8 else 150 - 10.0 * f, 0 if f < 8 else 30, 0] for f in range(12)]
        write(path, json.dumps(split))
        self.succeeds("merge", self.blocks, "-o", self.path("out"))
        rows = ply_rows(self.path("out", "background.ply"))
        owners = {
            round(row["x"] + 33): round((row["f_dc_0"] * 0.28209479177387814 + 0.5) * 10) - 1
            for row in rows
            if row["y"] == 0
        }
        self.assertEqual(owners, {0: 0, 30: 0, 34: 0, 36: 1, 60: 1, 74: 1, 76: 1, 110: 1, 500: 1})

    def test_threads(self):
        for threads in (1, 4):
            self.succeeds("merge", self.blocks, "-o", self.path(f"out{threads}"), "-j", threads)
        names = files_below(self.path("out1"))
        self.assertEqual(names, files_below(self.path("out4")))
        for name in names:
            self.assertEqual(read(self.path("out1", name)), read(self.path("out4", name)), name)

    def test_degrees_of_colour(self):
        """A trained background is several files, one for each SH degree. Merging keeps rows of one degree together."""
        path = os.path.join(self.blocks, "001", "scene", "background.ply")
        plain = read(path)
        head, body = plain.split(b"end_header\n", 1)
        rest = b"".join(b"property float f_rest_%d\n" % i for i in range(9))
        head = head.replace(b"property float opacity", rest + b"property float opacity")
        count, size = int(head.split(b"element vertex ")[1].split()[0]), 0
        size = len(body) // count
        packed = b"".join(
            body[i * size : i * size + 36] + struct.pack("<9f", *range(1, 10)) + body[i * size + 36 : (i + 1) * size]
            for i in range(count)
        )
        write(path, head + b"end_header\n" + packed)
        models = load(self.blocks, "001", "scene", "scene.json")["models"]
        models[0]["sh_degree"] = 1
        self.change(1, models=models)
        out = self.path("out")
        self.succeeds("merge", self.blocks, "-o", out)
        self.assertEqual(
            [(m["name"], m["sh_degree"], m["gaussians"]) for m in load(out, "scene.json")["models"]],
            [("background", 1, 3), ("background-sh0", 0, 8), ("car", 0, 1)],
        )
        row = ply_rows(os.path.join(out, "background.ply"))[0]
        self.assertEqual([row[f"f_rest_{i}"] for i in range(9)], list(range(1, 10)))

    def test_blocks_that_do_not_match(self):
        scene1 = os.path.join(self.blocks, "001", "scene")
        self.change(1, iterations=12)
        self.refused(scene1, "stopped after step 12 of 30", "--resume")
        self.change(1, iterations=30, config={"iterations": 30, "sh_degree": 1, "half_until": 0.5})
        self.refused(scene1, "sh_degree 1", "000/scene with 0", "same options")
        self.change(
            1,
            config={"iterations": 30, "sh_degree": 0, "half_until": 0.5},
            block={"split": "77", "number": 1, "count": 3},
        )
        self.refused(scene1, "another split (77", ID)
        self.change(1, block={"split": ID, "number": 2, "count": 3})
        self.refused(scene1, "the scene of block 2", "block 1")
        self.change(1, block=None)
        self.refused(scene1, "not on a block", "/no/such/drive")
        self.change(1, block={"split": ID, "number": 1, "count": 3})
        views = load(scene1, "scene.json")["cameras"]
        self.change(1, cameras=[{**view, "width": 50} for view in views])
        self.refused(scene1, "camera 0 has 50 x 101 pixels, but 101 x 101", "--downscale")

    def test_missing_blocks(self):
        shutil.rmtree(os.path.join(self.blocks, "001", "scene"))
        shutil.rmtree(os.path.join(self.blocks, "002", "scene"))
        self.refused(
            "2 of 3 blocks aren't trained", "the first is 001", "pags train", os.path.join(self.blocks, "001", "scene")
        )
        shutil.rmtree(os.path.join(self.blocks, "002"))
        self.refused("002: block 2 of 3 is missing", "pags split")
        self.fails(["merge", self.folder, "-o", self.path("out")], self.folder, "split.json", "pags split")

    def test_a_scene_is_not_overwritten(self):
        done = self.path("done")
        self.succeeds("merge", self.blocks, "-o", done)
        before = read(os.path.join(done, "scene.json"))
        self.fails(["merge", self.blocks, "-o", done], done, "holds a scene already")
        self.assertEqual(read(os.path.join(done, "scene.json")), before)

    def test_missing_recording(self):
        block = os.path.join(self.blocks, "000")
        self.fails(["info", block], "block.json", "/no/such/drive", "recording")
        self.fails(["info", self.blocks], "split into blocks", "000")


# ---- A street ----


class Street(Case):
    @classmethod
    def setUpClass(cls):
        shared = cls.shared_folder()
        cls.street, cls.blocks, cls.scene = (os.path.join(shared, name) for name in ("street", "blocks", "scene"))
        cls.call(
            "synth",
            "street",
            "-o",
            cls.street,
            "--size",
            "96x56",
            "--frames",
            "24",
            "--cameras",
            "1",
            "--lidar-points",
            "3000",
            "--no-shifts",
        )
        # Photographs get darker along the drive, as with a camera's automatic exposure.
        for frame in range(24):
            darken(os.path.join(cls.street, "images", f"{frame:03d}_0.png"), 1 - 0.01 * frame)
        cls.small = ["-n", "60", "--max-gaussians", "4000", "--set", "lidar_points=2000"]
        cls.call(
            "train",
            cls.street,
            "-o",
            os.path.join(cls.blocks, "whole"),
            "-n",
            "200",
            "--max-gaussians",
            "4000",
            "--set",
            "exposure_rate=0.02",
        )
        cls.split = json.loads(
            cls.call("split", cls.street, "-o", cls.blocks, "--length", "9", "--overlap", "4", "--json", "-").stdout
        )
        for b in range(3):
            cls.call("train", f"{cls.blocks}/{b:03d}", "-o", f"{cls.blocks}/{b:03d}/scene", *cls.small)
        cls.call("merge", cls.blocks, "-o", cls.scene)

    @classmethod
    def call(cls, *arguments):
        done = fixtures.run(*arguments)
        assert done.returncode == 0, f"{arguments}: {done.stderr}"
        return done

    def block(self, b, *names):
        return os.path.join(self.blocks, f"{b:03d}", *names)

    def test_time_steps_of_blocks(self):
        self.assertEqual(len(self.split["blocks"]), 3)
        own = [
            frame for block in self.split["blocks"] for frame in range(int(block["own"][0]), int(block["own"][1]) + 1)
        ]
        self.assertEqual(own, list(range(24)))
        for before, after in zip(self.split["blocks"], self.split["blocks"][1:]):
            self.assertAlmostEqual(before["frames"][1] - before["own"][1], 4, delta=1)
            self.assertAlmostEqual(after["own"][0] - after["frames"][0], 4, delta=1)
        self.assertEqual(self.split["blocks"][0]["frames"][0], 0)
        self.assertEqual(self.split["blocks"][2]["frames"][1], 23)

    def test_block_is_a_data_set_without_copies(self):
        self.assertEqual([name for name in files_below(self.block(1)) if not name.startswith("scene/")], ["block.json"])
        frames = self.split["blocks"][1]["frames"]
        facts = json.loads(self.succeeds("info", self.block(1), "--json", "-").stdout)
        self.assertEqual(facts["views_train"] + facts["views_test"], frames[1] - frames[0] + 1)
        self.assertEqual(facts["lidar_sweeps"], frames[1] - frames[0] + 1)
        self.assertTrue(any("block 1 of 3" in note for note in facts["notes"]), facts["notes"])
        # A block holds out the same time steps as the whole drive. eval finds the photographs through the block.
        whole = {v["name"]: v["test"] for v in load(self.blocks, "whole", "scene.json")["cameras"]}
        for view in load(self.block(1), "scene", "scene.json")["cameras"]:
            self.assertEqual(view["test"], whole[view["name"]])
        self.succeeds("eval", self.block(1, "scene"), "--split", "test")

    def test_tracks_are_whole(self):
        whole = {o["id"]: o for o in load(self.blocks, "whole", "scene.json")["objects"]}
        first, last = self.split["blocks"][1]["frames"]
        beyond = 0
        for o in load(self.block(1), "scene", "scene.json")["objects"]:
            self.assertEqual([k["frame"] for k in o["knots"]], [k["frame"] for k in whole[o["id"]]["knots"]])
            self.assertEqual(o["moving"], whole[o["id"]]["moving"])
            outside = [k for k in o["knots"] if not first <= k["frame"] <= last]
            self.assertLess(len(outside), len(o["knots"]))
            self.assertFalse(any(k["trained"] for k in outside))
            beyond += len(outside)
        self.assertGreater(beyond, 0)

    def test_one_sky_and_one_exposure(self):
        sky = read(os.path.join(self.blocks, "whole", "sky.npz"))
        for folder in [self.block(0, "scene"), self.block(1, "scene"), self.block(2, "scene"), self.scene]:
            self.assertEqual(read(os.path.join(folder, "sky.npz")), sky)
        whole = {v["name"]: v for v in load(self.blocks, "whole", "scene.json")["cameras"]}
        means = []
        for b in range(3):
            views = [v for v in load(self.block(b), "scene", "scene.json")["cameras"] if not v["test"]]
            mean = [sum(v["gain"][c] for v in views) / len(views) for c in range(3)]
            for c in range(3):
                self.assertAlmostEqual(mean[c], sum(whole[v["name"]]["gain"][c] for v in views) / len(views), 9)
            self.assertTrue(
                any(abs(v["gain"][0] - whole[v["name"]]["gain"][0]) > 1e-4 for v in views)
            )  # training a block changes the exposures of its photographs
            means.append(mean[0])
        # The exposures decrease along the drive, as the photographs get darker.
        self.assertGreater(means[0] - means[2], 0.02)

    def test_the_merged_scene(self):
        facts = json.loads(self.succeeds("eval", self.scene, "--split", "test", "--json", "-").stdout)
        self.assertEqual(
            sorted(v["name"] for v in facts["test"]["per_view"]), [f"{f:03d}_0.png" for f in range(4, 24, 4)]
        )
        self.assertGreater(facts["test"]["psnr"], 15)
        self.assertEqual(load(self.scene, "scene.json")["dataset"], os.path.realpath(self.street))
        ids = {o["id"] for o in load(self.scene, "scene.json")["objects"]}
        self.assertEqual(ids, {o["id"] for o in load(self.blocks, "whole", "scene.json")["objects"]})

    def test_resumed_to_the_same_bits(self):
        again = self.path("again")
        progress = subprocess.Popen(
            fixtures.program(["train", self.block(1), "-o", again, *self.small, "--checkpoint-every", "1"]),
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
        )
        while progress.poll() is None and not os.path.exists(os.path.join(again, "checkpoint.pags")):
            pass
        progress.send_signal(signal.SIGKILL)
        progress.wait()
        self.succeeds("train", self.block(1), "-o", again, *self.small, "--resume")
        for name in ["scene.json", "background.ply", "sky.npz"]:
            self.assertEqual(read(os.path.join(again, name)), read(self.block(1, "scene", name)), name)

    def test_batches(self):
        """Blocks can be trained with several photographs per step. Any number of threads gives the same bits."""
        for threads in (1, 3):
            self.succeeds(
                "train", self.block(1), "-o", self.path(f"s{threads}"), *self.small, "--batch", "4", "-j", threads
            )
        for name in ["scene.json", "background.ply", "sky.npz"]:
            self.assertEqual(read(self.path("s1", name)), read(self.path("s3", name)), name)
        self.assertNotEqual(read(self.path("s1", "background.ply")), read(self.block(1, "scene", "background.ply")))
        # A block keeps the sky of the whole drive.
        self.assertEqual(read(self.path("s1", "sky.npz")), read(self.block(1, "scene", "sky.npz")))

    def test_options_that_only_split_takes(self):
        train = ["train", self.block(0), "-o", self.path("x")]
        self.fails([*train, "--cameras", "0"], "block.json", "--cameras 0", "split with none given")
        self.fails([*train, "--reconstruction"], "block.json", "--split-every 0")
        self.fails([*train, "--frames", "0-3"], "block.json", "--frames", "0 to")

    def test_scene_of_the_whole_drive_lacks_a_photograph(self):
        blocks = self.path("blocks")
        shutil.copytree(self.blocks, blocks, ignore=shutil.ignore_patterns("scene"))
        path = os.path.join(blocks, "whole", "scene.json")
        scene = load(path)
        scene["cameras"] = [view for view in scene["cameras"] if view["frame"] != 1]
        write(path, json.dumps(scene))
        self.fails(["train", os.path.join(blocks, "000"), "-o", self.path("x"), "-n", "5"], "whole", "001_0.png")

    def test_repeated_split(self):
        before = read(self.block(1, "block.json"))
        shutil.copytree(self.blocks, self.path("b"), ignore=shutil.ignore_patterns("scene"))
        shutil.rmtree(self.path("b", "001"))
        again = ["split", self.street, "-o", self.path("b"), "--overlap", "4", "--length"]
        self.succeeds(*again, "9")
        self.assertEqual(read(self.path("b", "001", "block.json")), before)
        self.fails([*again, "13"], self.path("b"), "another split: 3 blocks")

    def test_data_sets_that_cannot_be_split(self):
        static = fixtures.make_dataset(self.path("static"), views=3)
        self.fails(["split", static, "-o", self.path("b"), "--length", "5"], static, "static set")
        self.fails(["split", self.block(1), "-o", self.path("b"), "--length", "5"], "a block itself", self.street)
        self.fails(
            ["split", self.street, "-o", self.path("b"), "--length", "1", "--split-every", "2"],
            "no photograph of its own",
            "longer blocks",
        )
        self.assertFalse(os.path.exists(self.path("b")))
        self.write("full/notes.txt", "mine")
        self.fails(["split", self.street, "-o", self.path("full"), "--length", "9"], "not empty")
        self.assertEqual(files_below(self.path("full")), ["notes.txt"])

    def test_ctrl_c(self):
        """Ctrl-C saves the scene of the whole drive. The same command continues from it."""
        words = ["split", self.street, "-o", self.path("b"), "--length", "9", "-j", "1"]
        run = subprocess.Popen(fixtures.program(words), stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
        for line in run.stdout:
            if "the whole drive: step" in line:
                run.send_signal(signal.SIGINT)
                break
        _, said = run.communicate(timeout=300)
        self.assertEqual(run.returncode, 3, said)
        self.assertIn("the same command resumes", said)
        self.assertTrue(os.path.exists(self.path("b", "whole", "checkpoint.pags")))
        self.assertFalse(os.path.exists(self.path("b", "000")))
        self.fails(["train", self.path("b"), "-o", self.path("x")], "split into blocks")


def darken(path, factor):
    width, height, _, _, pixels = fixtures.read_png(path)
    table = bytes(min(255, int(factor * value + 0.5)) for value in range(256))
    write(path, fixtures.png_bytes(width, height, pixels.translate(table)))


if __name__ == "__main__":
    fixtures.main()
