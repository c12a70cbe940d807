# SPDX-License-Identifier: Apache-2.0
"""Tests SOG and glTF (read and written), the output folders of other trainers, and their cameras."""

import json
import math
import os
import random
import struct
import zipfile

import fixtures
from fixtures import Case, ply_bytes, run, splat


def many_splats(count=300):
    """Returns rows for ply_bytes with various sizes, colours, opacities and rotations."""
    dice = random.Random(1)
    rows = []
    for _ in range(count):
        row = splat(*[dice.gauss(0, 3) for _ in range(3)], [dice.random() for _ in range(3)], opacity=dice.gauss(0, 3))
        row[10:13] = [dice.gauss(-3, 1) for _ in range(3)]
        row[13:17] = [dice.gauss(0, 1) for _ in range(4)]
        rows.append(row)
    return rows


def ply_rows(path):
    """Returns the rows of a PLY file that PAGS wrote. Each row is a dictionary of its floats."""
    with open(path, "rb") as file:
        head, body = file.read().split(b"end_header\n", 1)
    names = [line.split()[2].decode() for line in head.splitlines() if line.startswith(b"property float")]
    count = int(head.split(b"element vertex ", 1)[1].split()[0])
    return [dict(zip(names, struct.unpack_from(f"<{len(names)}f", body, i * 4 * len(names)))) for i in range(count)]


def sigmoid(x):
    return 1 / (1 + math.exp(-x))


class Written(Case):
    def setUp(self):
        super().setUp()
        self.rows = many_splats()
        self.ply = self.write("in.ply", ply_bytes(self.rows))

    def assert_near(self, found):
        """Asserts that each Gaussian of `found` is near a written row, up to SOG's rounding."""
        self.assertEqual(len(found), len(self.rows))
        left = [list(row) for row in self.rows]
        for g in found:
            row = min(left, key=lambda r: sum((r[k] - g["xyz"[k]]) ** 2 for k in range(3)))
            left.remove(row)
            for k in range(3):
                self.assertAlmostEqual(row[k], g["xyz"[k]], delta=1e-3)
                self.assertAlmostEqual(row[6 + k], g[f"f_dc_{k}"], delta=0.05)
                self.assertAlmostEqual(row[10 + k], g[f"scale_{k}"], delta=0.05)
            self.assertAlmostEqual(sigmoid(row[9]), sigmoid(g["opacity"]), delta=0.003)
            length = math.sqrt(sum(q * q for q in row[13:17]))
            dot = sum(row[13 + k] * g[f"rot_{k}"] for k in range(4)) / length
            self.assertGreater(abs(dot), 0.9999)

    def export_sog(self, ply, name, *more):
        """Exports the file. Skips the test in a build without libwebp."""
        done = run("export", ply, self.path(name), *more)
        if "has no libwebp" in done.stderr:
            self.skipTest("this build has no libwebp")
        self.assertEqual(done.returncode, 0, done.stderr)

    def test_sog_is_read_back(self):
        self.export_sog(self.ply, "a.sog")
        os.makedirs(self.path("folder"))
        self.export_sog(self.ply, "folder/meta.json")
        for name, kind in [("a.sog", "SOG v2"), ("folder/meta.json", "SOG v2"), ("folder", "SOG")]:
            done = self.succeeds("info", self.path(name), "--strict", "--json", "-")
            facts = json.loads(done.stdout)
            self.assertEqual((facts["kind"], facts["gaussians"], facts["warnings"]), (kind, 300, []))
            self.succeeds("export", self.path(name), self.path("back.ply"))
            self.assert_near(ply_rows(self.path("back.ply")))
        sizes = sum(os.path.getsize(self.path("folder", name)) for name in os.listdir(self.path("folder")))
        self.assertEqual(facts["bytes"], sizes)

    def test_sog_has_the_same_bits_for_any_threads(self):
        for threads in ["1", "3"]:
            self.export_sog(self.ply, f"{threads}.sog", "--threads", threads)
        with open(self.path("1.sog"), "rb") as one, open(self.path("3.sog"), "rb") as three:
            self.assertEqual(one.read(), three.read())

    def test_equal_rotations(self):
        rows = [splat(i % 71 * 0.37, i // 71 * 0.53, 1.0, [0.5, 0.5, 0.5]) for i in range(5000)]
        flat = self.write("flat.ply", ply_bytes(rows))
        self.export_sog(flat, "flat.sog")
        self.assertEqual(
            json.loads(self.succeeds("info", self.path("flat.sog"), "--json", "-").stdout)["gaussians"], 5000
        )

    def test_gltf_is_read_back(self):
        for name in ["a.glb", "a.gltf"]:
            self.succeeds("export", self.ply, self.path(name), "--splats")
            facts = json.loads(self.succeeds("info", self.path(name), "--strict", "--json", "-").stdout)
            self.assertEqual((facts["kind"], facts["up"]), ("glTF", "-y"))
            self.succeeds("export", self.path(name), self.path("back.ply"))
            self.assert_near(ply_rows(self.path("back.ply")))


class Facts(Case):
    """Tests a scene's data other than its Gaussians, and the axes."""

    def setUp(self):
        super().setUp()
        os.makedirs(self.path("new"))
        self.ply = self.write("in.ply", ply_bytes([splat(1, 2, 3, [1, 0, 0]), splat(4, 2, 0, [0, 1, 0])]))

    def facts(self, *arguments):
        return json.loads(self.succeeds("info", *arguments, "--json", "-").stdout)

    def positions(self, name, *options):
        self.succeeds("export", name, self.path("back.ply"), *options)
        return sorted(tuple(round(g[axis], 2) + 0.0 for axis in "xyz") for g in ply_rows(self.path("back.ply")))

    def export(self, source, name, *more):
        done = run("export", source, self.path(name), *more)
        if "has no libwebp" in done.stderr:
            self.skipTest("this build has no libwebp")
        self.assertEqual(done.returncode, 0, done.stderr)
        return self.path(name), done.stderr

    def test_facts_are_read_back(self):
        with open(self.ply, "rb") as file:
            head, body = file.read().split(b"end_header\n", 1)
        for axis, up in [("z", "+z"), ("0 1 0", "+y"), ("", "-y")]:
            comments = "comment SplatRenderMode: mip\ncomment offset 500000 4600000 100\n" + (
                f"comment Vertical axis: {axis}\n" if axis else ""
            )
            source = self.write("said.ply", head + comments.encode() + b"end_header\n" + body)
            for name, more in [("a.glb", ["--splats"]), ("a.SOG", []), ("new/META.json", [])]:
                written, said = self.export(source, name, *more)
                self.assertNotIn("can't hold", said)
                found = self.facts(written)
                self.assertEqual(
                    (found["antialiased"], found["origin"], found["up"]), (True, [500000, 4600000, 100], up), name
                )

    def test_axes(self):
        self.export(self.ply, "a.sog")
        self.assertEqual(self.positions(self.path("a.sog")), [(1, 2, 3), (4, 2, 0)])
        self.assertEqual(self.positions(self.path("a.sog"), "--axes", "rub"), [(1, -2, -3), (4, -2, 0)])
        glb = self.export(self.ply, "a.glb", "--splats")[0]
        self.assertIn("a glTF's axes are known", run("info", glb, "--axes", "rub").stderr)

    def test_archives_are_distinguished(self):
        self.export(self.ply, "a.sog")
        os.rename(self.path("a.sog"), self.path("a.zip"))
        self.assertEqual(self.facts(self.path("a.zip"))["kind"], "SOG v2")
        with zipfile.ZipFile(self.path("b.zip"), "w") as archive:
            archive.writestr("meta.json", "{}")
            archive.writestr("images/0.png", "")
        self.assertIn("an archive (zip); unpack it first", run("info", self.path("b.zip")).stderr)


POINTER = b"version https://git-lfs.github.com/spec/v1\noid sha256:81c6\nsize 115570275\n"


class TrainingOutputs(Case):
    """Tests the output of INRIA's train.py: point_cloud/iteration_N/point_cloud.ply, cameras.json, cfg_args."""

    def setUp(self):
        super().setUp()
        for count, iteration in [(3, 7000), (5, 30000)]:
            os.makedirs(self.path("out", "point_cloud", f"iteration_{iteration}"))
            rows = [splat(0.1 * i, 0, 4, [1, 0, 0]) for i in range(count)]
            self.write(f"out/point_cloud/iteration_{iteration}/point_cloud.ply", ply_bytes(rows))
        cameras = [
            {
                "id": i,
                "img_name": f"view{i}",
                "width": 64,
                "height": 48,
                "position": [0.1 * i, 0, 0],
                "rotation": [[1, 0, 0], [0, 1, 0], [0, 0, 1]],
                "fy": 60.0,
                "fx": 61.0,
            }
            for i in range(3)
        ]
        self.cameras = self.write("out/cameras.json", json.dumps(cameras).encode())
        self.write("out/cfg_args", b"Namespace(sh_degree=3, white_background=True)")

    def test_newest_iteration_and_views(self):
        done = self.succeeds("info", self.path("out"), "--strict", "--json", "-")
        facts = json.loads(done.stdout)
        self.assertEqual((facts["kind"], facts["gaussians"], facts["warnings"]), ("training output", 5, []))
        self.assertEqual(facts["models"][0]["file"], "point_cloud/iteration_30000/point_cloud.ply")
        self.succeeds("render", self.path("out"), "--split", "train", "-o", self.path("drawn"))
        self.assertEqual(sorted(os.listdir(self.path("drawn"))), ["view0.png", "view1.png", "view2.png"])
        width, height, _, _, pixels = fixtures.read_png(self.path("drawn/view0.png"))
        self.assertEqual((width, height, set(pixels[:3])), (64, 48, {255}))  # the background is white, as cfg_args says
        self.succeeds("info", self.path("out", "point_cloud", "iteration_7000"))
        self.succeeds("export", self.path("out"), self.path("turned.ply"), "--axes", "rub")
        self.assertEqual({row["z"] for row in ply_rows(self.path("turned.ply"))}, {-4})

    def test_output_in_a_data_set(self):
        fixtures.make_dataset(self.path("out"))
        done = self.succeeds("info", self.path("out"), "--json", self.path("facts.json"))
        self.assertIn("render and export take that one", done.stdout)
        self.assertEqual(json.loads(fixtures.read(self.path("facts.json")))["kind"], "data set")
        self.succeeds("export", self.path("out"), self.path("x.ply"))

    def test_iterations_without_a_file(self):
        os.makedirs(self.path("out", "point_cloud", "iteration_40000"))
        done = self.succeeds("info", self.path("out"), "--json", "-")
        self.assertEqual(json.loads(done.stdout)["gaussians"], 5)
        self.assertIn(
            "iteration_40000, the newest, has no point_cloud.ply; iteration_30000 is taken",
            json.loads(done.stdout)["warnings"][0],
        )
        self.assertEqual(run("info", self.path("out"), "--strict").returncode, 1)

    def test_lfs_pointers_are_named(self):
        self.write("out/point_cloud/iteration_30000/point_cloud.ply", POINTER)
        for verb in [["info", self.path("out")], ["export", self.path("out"), self.path("x.ply")]]:
            done = run(*verb)
            self.assertEqual(done.returncode, 1)
            self.assertIn("iteration_30000/point_cloud.ply: a Git LFS pointer", done.stderr)
        self.assertRegex(
            run("info", self.write("out/cameras.json", POINTER)).stderr, "cameras.json: .*pointer.*git lfs pull"
        )

    def test_cameras_as_paths(self):
        facts = json.loads(self.succeeds("info", self.cameras, "--json", "-").stdout)
        self.assertEqual((facts["kind"], facts["frames"], facts["width"]), ("path", 3, 64))
        self.assertEqual(facts["fx_fy_cx_cy"], [61, 60, 32, 24])
        ply = self.path("out/point_cloud/iteration_7000/point_cloud.ply")
        self.succeeds("render", ply, "--path", self.cameras, "-o", self.path("drawn"))
        self.assertEqual(len(os.listdir(self.path("drawn"))), 3)

    def test_nerfstudio_paths(self):
        path = {
            "camera_type": "perspective",
            "render_width": 64,
            "render_height": 48,
            "fps": 24,
            "crop": None,
            "camera_path": [
                {"camera_to_world": [1, 0, 0, 2, 0, 1, 0, 3, 0, 0, 1, 4, 0, 0, 0, 1], "fov": 90, "aspect": 1}
            ],
        }
        name = self.write("path.json", json.dumps(path).encode())
        facts = json.loads(self.succeeds("info", name, "--strict", "--json", "-").stdout)
        self.assertEqual((facts["kind"], facts["fps"], facts["position"]), ("path", 24, [2, 3, 4]))
        self.assertAlmostEqual(facts["fx_fy_cx_cy"][0], 24)
        ply = self.write(
            "behind.ply", ply_bytes([splat(2, 3, 0, [1, 0, 0], sigma=0.5)])
        )  # the Gaussian is 4 m ahead, as the camera looks along -z
        done = self.succeeds("render", ply, "--camera", name, "-o", self.path("drawn"), "--json", "-")
        self.assertEqual(json.loads(done.stdout)["frames"][0]["in_view"], 1)
        views = self.write("transforms.json", json.dumps({"frames": [{"transform_matrix": []}]}).encode())
        self.assertIn(
            "--split all --dataset FOLDER", run("render", ply, "--path", views, "-o", self.path("none")).stderr
        )
        path["crop"] = {"crop_center": [0, 0, 0]}
        name = self.write("path.json", json.dumps(path).encode())
        self.assertIn(
            "its 'crop' is ignored", json.loads(self.succeeds("info", name, "--json", "-").stdout)["warnings"][0]
        )
        path["camera_type"] = "equirectangular"
        self.assertIn("which PAGS can't draw", run("info", self.write("path.json", json.dumps(path).encode())).stderr)


if __name__ == "__main__":
    fixtures.main()
