# SPDX-License-Identifier: Apache-2.0
"""Tests meshes and views of splat files without photographs. In exports, tests names, repeated triangles, objects that
appear and disappear, and cropping."""

import collections
import json
import math
import os
import re

import fixtures
import scenes
from fixtures import Case, read
from test_export import Glb, open_edges, volume

SIZE = [1.0, 0.5, 0.4]


def body(size=SIZE, count=600):
    """Returns a box filled with shells of Gaussians, like a trained object."""
    rows = []
    for shell in range(5):
        side = [s * (5 - shell) / 5 for s in size]
        rows += scenes.on_box(count if shell else 4 * count, side, (0, 0, 0), (0.8, 0.3, 0.2), shell)
    for row in rows:
        for k in range(10, 13):
            row[k] = math.log(0.004 if row[k] < math.log(0.02) else 0.03 * max(size))
    return rows


def room():
    """Returns a room of 6 x 5 x 2.6 m with a table; z is up."""
    rows = scenes.on_box(5000, (6, 5, 2.6), (0, 0, 1.3), (0.6, 0.6, 0.5), 1)
    return rows + scenes.on_box(900, (1.6, 1, 0.7), (0, 0, 0.4), (0.5, 0.3, 0.1), 2)


def off_box(p, size):
    """Returns the distance of a point from the surface of a box around the origin."""
    d = [abs(p[k]) - 0.5 * size[k] for k in range(3)]
    outside = math.sqrt(sum(max(v, 0) ** 2 for v in d))
    return outside if outside > 0 else -max(d)


class Bare(Case):
    def export(self, rows, name, *options):
        model = self.write("model.ply", scenes.ply(rows))
        done = self.succeeds("export", model, self.path(name), "--json", self.path("facts.json"), *options)
        return json.loads(read(self.path("facts.json"))), done

    def test_object_becomes_a_closed_mesh(self):
        facts, done = self.export(body(), "mesh.glb", "--chunk-triangles", 4000, "--voxel", 0.02)
        self.assertEqual([p["name"] for p in facts["proxies"]], ["surface_000"])
        self.assertEqual(facts["warnings"], [])
        proxy = facts["proxies"][0]
        self.assertTrue(proxy["watertight"])
        self.assertIn("views made up round it", proxy["note"])
        self.assertLess(proxy["error"]["proxy_to_gaussians"]["mean"], 0.01)
        self.assertLess(proxy["error"]["gaussians_to_proxy"]["mean"], 0.01)
        self.assertAlmostEqual(proxy["volume"], 0.2, delta=0.04)
        glb = Glb(self.path("mesh.glb"))
        node = glb.nodes()["surface_000"]
        positions, triangles = glb.positions(node), glb.triangles(node)
        self.assertLessEqual(len(triangles), 4000)
        self.assertEqual(open_edges(triangles), 0)
        self.assertAlmostEqual(volume(positions, triangles), 0.2, delta=0.04)
        self.assertLess(sum(off_box(p, SIZE) for p in positions) / len(positions), 0.03)

    def test_small_units_have_small_steps(self):
        rows = [
            [v * 0.01 for v in row[:3]] + row[3:10] + [v + math.log(0.01) for v in row[10:13]] + row[13:]
            for row in body()
        ]
        facts, _ = self.export(rows, "mesh.glb", "--voxel", 0.0002, "--chunk-triangles", 4000)
        self.assertAlmostEqual(facts["proxies"][0]["volume"] * 1e6, 0.2, delta=0.05)

    def test_nothing_to_mesh_is_reported(self):
        faint = [scenes.gaussian(0.1 * i, 0, 0, (0.5, 0.5, 0.5), opacity=-4) for i in range(50)]
        cases = [
            (faint, [], "opaque enough"),
            ([], [], "no Gaussians"),
            (body(count=9), ["--no-background"], "neither"),
        ]
        for rows, options, words in cases:
            facts, _ = self.export(rows, "mesh.glb", *options)
            self.assertEqual(len(facts["warnings"]), 1)
            self.assertIn(words, facts["warnings"][0])

    def test_a_single_gaussian_has_an_extent(self):
        facts, _ = self.export([scenes.gaussian(5, 0, 0, (0.5, 0.5, 0.5))], "mesh.glb", "--chunk-triangles", 2000)
        self.assertLess(abs(facts["proxies"][0]["volume"] - 4 / 3 * math.pi * 0.1**3), 0.01)

    def test_levels_and_usd(self):
        quick = ["--voxel", 0.04]
        hull, _ = self.export(body(), "hull.glb", "--proxy", "hull", *quick)
        self.assertEqual(hull["proxies"][0]["level"], "hull")
        self.assertLessEqual(hull["proxies"][0]["triangles"], 252)
        box, _ = self.export(body(), "box.glb", "--proxy", "box", *quick)
        self.assertEqual((box["proxies"][0]["level"], box["proxies"][0]["triangles"]), ("box", 12))
        self.assertAlmostEqual(box["proxies"][0]["volume"], 0.2, delta=0.1)
        self.export(body(), "stage.usda", *quick)
        stage = read(self.path("stage.usda")).decode()
        self.assertIn('def Mesh "surface_000"', stage)

    def test_room_is_meshed_from_within(self):
        facts, _ = self.export(room(), "mesh.glb", "--voxel", 0.1, "--chunk", 10)
        self.assertIn("views made up within it", facts["proxies"][0]["note"])
        around, _ = self.export(room(), "around.glb", "--voxel", 0.15, "--stand", "around")
        self.assertIn("views made up round it", around["proxies"][0]["note"])
        glb, far = Glb(self.path("mesh.glb")), []
        for node in glb.nodes().values():
            if "mesh" in node:
                for p in glb.positions(node):
                    walls = off_box((p[0], p[1], p[2] - 1.3), (6, 5, 2.6))
                    far.append(min(walls, off_box((p[0], p[1], p[2] - 0.4), (1.6, 1, 0.7))))
        self.assertGreater(len(far), 2000)
        self.assertLess(sum(far) / len(far), 0.05)

    def test_no_cameras_are_invented_in_the_file(self):
        facts, _ = self.export(body(), "mesh.glb", "--cameras", "--voxel", 0.04)
        self.assertEqual(facts["warnings"], ["there are no photographs, so no cameras are written"])
        self.assertNotIn("cameras", Glb(self.path("mesh.glb")).json)


class Photographed(Case):
    """An object that stands on a table, photographed from above its middle. Its lower side has no Gaussians."""

    def capture(self, views, turn):
        scenes.make_empty_scene(self.path("scene"))
        rows = [row for row in body() if row[2] > -0.17]
        self.write("scene/background.ply", scenes.ply(rows))
        with open(self.path("scene", "scene.json")) as file:
            facts = json.load(file)
        facts["models"][0]["gaussians"] = len(rows)
        for i in range(views):
            pose = fixtures.ring_pose(turn * i / views, radius=2.0, height=0.3 if i % 2 else 1.2)
            rows_of = [[pose[k][0], -pose[k][1], -pose[k][2]] for k in range(3)]  # from OpenGL's axes to OpenCV's
            rotation = [[rows_of[k][row] for k in range(3)] for row in range(3)]
            camera = {"name": f"{i}.png", "test": False, "sensor": -1, "frame": -1, "width": 160, "height": 120}
            camera |= {"fx": 200, "fy": 200, "cx": 80, "cy": 60, "time": 0}
            camera["camera_from_world_quaternion_wxyz"] = scenes.quaternion(rotation)
            camera["camera_from_world_translation"] = [-sum(row[k] * pose[k][3] for k in range(3)) for row in rotation]
            facts["cameras"].append(camera)
        self.write("scene/scene.json", json.dumps(facts))

    def export(self, *options):
        facts = self.path("facts.json")
        self.succeeds("export", self.path("scene"), self.path("mesh.glb"), "--voxel", 0.02, "--json", facts, *options)
        return json.loads(read(facts))["proxies"]

    def test_object_from_all_round_becomes_a_closed_mesh(self):
        self.capture(24, 2 * math.pi)
        (proxy,) = self.export()
        self.assertEqual(proxy["name"], "surface_000")
        self.assertTrue(proxy["watertight"])
        self.assertIn("photographed from all round", proxy["note"])
        self.assertAlmostEqual(proxy["volume"], 0.2, delta=0.04)
        glb = Glb(self.path("mesh.glb"))
        node = glb.nodes()["surface_000"]
        self.assertEqual(open_edges(glb.triangles(node)), 0)
        positions = glb.positions(node)
        self.assertLess(sum(off_box(p, SIZE) for p in positions) / len(positions), 0.03)

    def test_one_side_stays_open(self):
        self.capture(12, 0.5 * math.pi)
        self.assertFalse(any(proxy["watertight"] for proxy in self.export()))
        (proxy,) = self.export("--stand", "around")
        self.assertTrue(proxy["watertight"])


class Files(Case):
    """Tests exports of the street of scenes.py with changed classes of objects."""

    def setUp(self):
        super().setUp()
        self.scene = scenes.make_scene(self.path("scene"))
        with open(self.path("scene", "scene.json")) as file:
            self.facts = json.load(file)

    def save(self):
        self.write("scene/scene.json", json.dumps(self.facts))

    def test_names_are_unique_and_not_empty(self):
        classes = ["", "轿车", "critical", "Ca/r", "Ca r"]
        for item, name in zip(self.facts["objects"], classes):
            item["class"] = name
        self.facts["objects"][1]["critical"] = False
        self.save()
        for options in [["--proxy", "box"], ["--lod"], ["--proxy", "box", "--naming", "unreal"]]:
            self.succeeds("export", self.scene, self.path("x.glb"), "--no-background", *options)
            for kind in ["nodes", "meshes"]:
                names = [thing.get("name") for thing in Glb(self.path("x.glb")).json[kind]]
                self.assertTrue(all(names), names)
                self.assertEqual(len(set(names)), len(names), names)

    def test_objects_appear_and_disappear(self):
        """car_1 appears at 0.5 s, three_2 disappears after 0.3 s, flat_3 is missing from 0.4 s to 0.7 s."""
        keep = {"car_1": range(5, 10), "three_2": range(4), "flat_3": [0, 1, 2, 3, 8, 9]}
        for item in self.facts["objects"]:
            if item["id"] in keep:
                item["knots"] = [knot for knot in item["knots"] if knot["frame"] in keep[item["id"]]]
        self.save()
        self.succeeds("export", self.scene, self.path("x.usda"), "--proxy", "box", "--no-background", "--sh-degree", 0)
        stage = read(self.path("x.usda")).decode()
        found = {}
        for part in re.split(r"def Xform ", stage)[1:]:
            samples = re.search(r"visibility.timeSamples = \{(.*?)\}", part, re.DOTALL)
            found[part.split('"')[1]] = samples and re.findall(r'([\d.]+): "(\w+)"', samples.group(1))
        seen, gone = "inherited", "invisible"
        self.assertEqual(found["car_0001"], [("0", gone), ("4.5", seen), ("9.5", gone)])
        self.assertEqual(found["pedestrian_0002"], [("0", seen), ("3.5", gone)])
        self.assertEqual(found["rolling_container_0003"], [("0", seen), ("3.5", gone), ("7.5", seen), ("9.5", gone)])
        self.assertIsNone(found["car_0000"])
        self.assertEqual(stage.count("bool physics:collisionEnabled.timeSamples"), 3)
        done = self.succeeds("export", self.scene, self.path("x.glb"), "--proxy", "box", "--no-background", "--strict")
        self.assertIn("3 of 5 objects come late or leave, the first is car_1", done.stdout)

    def test_no_empty_or_repeated_triangles(self):
        self.succeeds("export", self.scene, self.path("x.glb"), "--range", 15, "--chunk", 40, "--voxel", 0.4)
        glb = Glb(self.path("x.glb"))
        for name, node in glb.nodes().items():
            if "mesh" not in node:
                continue
            positions, seen, edges = glb.positions(node), set(), collections.Counter()
            for t in glb.triangles(node):
                a, b, c = (tuple(round(v, 6) for v in positions[i]) for i in t)
                u, v = [b[k] - a[k] for k in range(3)], [c[k] - a[k] for k in range(3)]
                cross = [u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2], u[0] * v[1] - u[1] * v[0]]
                self.assertGreater(0.5 * math.sqrt(sum(x * x for x in cross)), 1e-11, name)
                self.assertNotIn(frozenset((a, b, c)), seen, name)
                seen.add(frozenset((a, b, c)))
                edges.update(frozenset(e) for e in [(a, b), (b, c), (c, a)])
            self.assertLessEqual(max(edges.values()), 2, name)

    def test_crop(self):
        box = ["--crop-box=4,2,-1,8,5,3"]  # the box holds the parked car
        done = self.succeeds("export", self.scene, self.path("car.glb"), "--proxy", "box", "--voxel", 0.4, *box)
        names = Glb(self.path("car.glb")).nodes()
        self.assertIn("car_0000", names)
        self.assertNotIn("car_0001", names)
        glb = Glb(self.path("car.glb"))
        for p in glb.positions(names["ground"]) if "ground" in names else []:
            self.assertTrue(3 < p[0] < 9 and 1 < p[1] < 6, p)
        self.assertRegex(done.stdout, r"\d+ of \d+ Gaussians are left")
        self.succeeds(
            "export", self.scene, self.path("few.ply"), "--max-size", 0.1, "--min-opacity", 0.5, "--min-views", 2
        )
        few = int(re.search(rb"element vertex (\d+)", read(self.path("few.ply"))).group(1))
        self.succeeds("export", self.scene, self.path("all.ply"))
        everything = int(re.search(rb"element vertex (\d+)", read(self.path("all.ply"))).group(1))
        self.assertTrue(0 < few < everything)
        self.succeeds(
            "render",
            self.path("all.ply"),
            "-n",
            1,
            "--downscale",
            8,
            "-o",
            self.path("r"),
            "--crop-sphere",
            "6,3.5,1,3",
        )
        self.fails(["export", self.scene, self.path("x.ply"), "--crop-box", "1,2,3"], "X,Y,Z,X,Y,Z", code=2)
        self.fails(["render", self.scene, "-o", self.path("q"), "--crop-sphere", "1,2,3,0"], "R > 0", code=2)
        self.fails(["export", self.scene, self.path("x.ply"), "--crop-sphere", "500,2,3,1"], "none of the")
        self.fails(["export", self.path("all.ply"), self.path("x.ply"), "--min-views", 2], "no training views")
        self.assertFalse(os.path.exists(self.path("x.ply")))


if __name__ == "__main__":
    fixtures.main()
