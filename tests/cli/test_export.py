# SPDX-License-Identifier: Apache-2.0
"""Tests pags export: it keeps size limits, its report is true, unusual objects become boxes, unusual scenes give a
message or a file."""

import collections
import json
import math
import os
import struct

import fixtures
import scenes
from fixtures import Case, main

QUICK = ["--range", 15, "--chunk", 40, "--voxel", 0.4]  # options that make the background mesh coarse


class Glb:
    """Reads a GLB file that has one buffer, with Python's JSON parser."""

    def __init__(self, path):
        data = fixtures.read(path)
        magic, version, size, json_size, kind = struct.unpack("<IIIII", data[:20])
        assert (magic, version, size, kind) == (0x46546C67, 2, len(data), 0x4E4F534A), path
        self.json = json.loads(data[20 : 20 + json_size])
        self.bytes = data[28 + json_size :]

    def accessor(self, number):
        item = self.json["accessors"][number]
        view = self.json["bufferViews"][item["bufferView"]]
        code = {5126: "f", 5123: "H", 5125: "I"}[item["componentType"]]
        count = item["count"] * {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4}[item["type"]]
        return struct.unpack_from(f"<{count}{code}", self.bytes, view.get("byteOffset", 0) + item.get("byteOffset", 0))

    def nodes(self):
        return {node["name"]: node for node in self.json["nodes"]}

    def triangles(self, node):
        primitive = self.json["meshes"][node["mesh"]]["primitives"][0]
        corners = self.accessor(primitive["indices"])
        return [corners[i : i + 3] for i in range(0, len(corners), 3)]

    def positions(self, node):
        values = self.accessor(self.json["meshes"][node["mesh"]]["primitives"][0]["attributes"]["POSITION"])
        return [values[i : i + 3] for i in range(0, len(values), 3)]

    def children(self, node):
        return [self.json["nodes"][i]["name"] for i in node.get("children", [])]


def open_edges(triangles):
    """Counts edges that aren't shared by exactly two faces in opposite directions."""
    edges = collections.Counter()
    for t in triangles:
        for k in range(3):
            edges[t[k], t[(k + 1) % 3]] += 1
    return sum(1 for (a, b), n in edges.items() if n != 1 or edges[b, a] != 1)


def volume(positions, triangles):
    total = 0.0
    for a, b, c in triangles:
        (ax, ay, az), (bx, by, bz), (cx, cy, cz) = positions[a], positions[b], positions[c]
        total += ax * (by * cz - bz * cy) - ay * (bx * cz - bz * cx) + az * (bx * cy - by * cx)
    return total / 6


class Proxies(Case):
    names = ["car_0000", "car_0001", "pedestrian_0002", "rolling_container_0003", "pedestrian_0004"]

    def setUp(self):
        super().setUp()
        self.scene = scenes.make_scene(self.path("scene"))

    def export(self, name, *options):
        facts = self.path("facts.json")
        done = self.succeeds("export", self.scene, self.path(name), "--json", facts, *options)
        with open(facts) as file:
            self.told = json.load(file)
        return Glb(self.path(name)), {p["name"]: p for p in self.told["proxies"]}, done

    def check_objects(self, glb, facts, level, budget):
        for number, name in enumerate(self.names):
            node, said = glb.nodes()[name], facts[name]
            triangles, positions = glb.triangles(node), glb.positions(node)
            self.assertLessEqual(len(triangles), budget, name)
            self.assertEqual(len(triangles), said["triangles"], name)
            self.assertEqual(open_edges(triangles), 0, name)
            self.assertGreater(volume(positions, triangles), 0.01, name)
            self.assertTrue(said["watertight"], name)
            self.assertEqual(node["extras"]["watertight"], said["watertight"])
            self.assertEqual(
                node["extras"]["class"], ["Car", "Car", "Pedestrian", "Rolling Container", "Pedestrian"][number]
            )
            self.assertTrue(all(math.isfinite(v) for p in positions for v in p))
        for name in self.names[:2]:
            self.assertEqual(facts[name]["level"], level)
        for name in ("pedestrian_0002", "pedestrian_0004"):
            self.assertEqual(facts[name]["level"], "box", name)
            if level != "box":
                self.assertIn("too few Gaussians", facts[name]["note"])

    def test_levels(self):
        for level, budget in (("mesh", 600), ("mesh", 40), ("cage", 600), ("cage", 100), ("hull", 60), ("box", 12)):
            with self.subTest(level=level, budget=budget):
                glb, facts, _ = self.export("proxy.glb", "--proxy", level, "--triangles", budget, "--no-background")
                self.check_objects(glb, facts, level, budget)
                self.assertNotIn("extensionsRequired", glb.json)
                if level == "mesh" and budget == 600:
                    for name in self.names[:2]:
                        self.assertGreater(facts[name]["error"]["silhouette_iou"], 0.85, name)

    def test_background_budgets(self):
        glb, facts, _ = self.export("proxy.glb", *QUICK, "--ground-triangles", 300, "--chunk-triangles", 500)
        stages = self.told["stages"]
        self.assertTrue({"objects", "background: ground", "background: surface", "writing"} <= set(stages), stages)
        self.assertAlmostEqual(sum(stages.values()), self.told["seconds"], delta=0.05 + 0.1 * self.told["seconds"])
        nodes = glb.nodes()
        self.assertLessEqual(len(glb.triangles(nodes["ground"])), 300)
        chunks = [f for f in facts.values() if f["class"] not in ("Car", "Pedestrian", "Rolling Container", "ground")]
        self.assertGreater(len(chunks), 0)
        self.assertLessEqual(sum(f["triangles"] for f in chunks), 500)
        self.assertEqual(glb.json["asset"]["extras"]["origin"], scenes.ORIGIN)
        self.assertEqual(glb.json["asset"]["extras"]["geographic_origin"], scenes.PLACE)

    def test_ground_is_level(self):
        glb, _, _ = self.export("proxy.glb", *QUICK, "--only", "car_1")
        nodes = glb.nodes()
        heights = [p[2] for p in glb.positions(nodes["ground"])]
        self.assertLess(max(map(abs, heights)), 0.06)  # the street is level, at height 0 relative to the origin

    def test_groups_and_tracks(self):
        glb, _, _ = self.export("proxy.glb", "--no-background")
        nodes = glb.nodes()
        self.assertEqual(glb.children(nodes["scene"]), ["critical", "background"])
        self.assertEqual(glb.children(nodes["critical"]), ["car", "pedestrian"])
        self.assertEqual(glb.children(nodes["car"]), ["car_0000", "car_0001"])
        channels = glb.json["animations"][0]["channels"]
        moved = {glb.json["nodes"][c["target"]["node"]]["name"] for c in channels}
        self.assertEqual(moved, {"car_0001", "pedestrian_0002", "rolling_container_0003"})
        samplers = glb.json["animations"][0]["samplers"]
        times = glb.accessor(samplers[channels[0]["sampler"]]["input"])
        self.assertEqual(len(times), 10)
        for i, time in enumerate(times):
            self.assertAlmostEqual(time, 0.1 * i, 5)
        places = glb.accessor(samplers[channels[0]["sampler"]]["output"])
        self.assertAlmostEqual(places[27], 5 + 0.6 * 9, 4)

    def test_several_extensions_in_one_file(self):
        glb, facts, _ = self.export("proxy.glb", "--lod", "--physics", "--invisible", "--no-background")
        node = glb.nodes()["car_0001_lod0"]
        levels = [glb.json["nodes"][i] for i in node["extensions"]["MSFT_lod"]["ids"]]
        self.assertEqual([len(glb.triangles(levels[-1]))], [12])
        self.assertEqual(len(node["extras"]["MSFT_screencoverage"]), len(levels) + 1)
        for name in ("MSFT_lod", "KHR_physics_rigid_bodies", "KHR_node_visibility"):
            self.assertIn(name, glb.json["extensionsUsed"])
        self.assertNotIn("extensionsRequired", glb.json)

    def test_names_for_unreal_and_godot(self):
        """Colliders lie below the moving node, which has the visible mesh. Unreal recognises colliders by the name of
        their mesh."""
        options = ["--no-background", "--triangles", 200]
        for naming, level, car, person in (
            ("unreal", "hull", ["UCX_car_0001_00"], ["UBX_pedestrian_0002_00"]),
            ("unreal", "mesh", [], []),
            ("godot", "hull", ["car_0001_part00-convcolonly"], ["pedestrian_0002_part00-convcolonly"]),
            ("godot", "mesh", ["car_0001_mesh-col"], ["pedestrian_0002_mesh-col"]),
        ):
            with self.subTest(naming=naming, level=level):
                glb, _, _ = self.export("proxy.glb", "--proxy", level, "--naming", naming, *options)
                nodes = glb.nodes()
                self.assertEqual(glb.children(nodes["car_0001"]), car)
                self.assertEqual(glb.children(nodes["pedestrian_0002"]), person)
                self.assertEqual("mesh" in nodes["car_0001"], (naming, level) != ("godot", "mesh"))
                if naming == "unreal":
                    self.assertEqual(glb.json["meshes"][nodes["car_0001"]["mesh"]]["name"], "car_0001")
        glb, _, _ = self.export("proxy.glb", *QUICK, "--naming", "godot", "--proxy", "box")
        self.assertIn("ground-col", glb.nodes())

    def test_convex_parts(self):
        glb, facts, _ = self.export("proxy.glb", "--proxy", "convex", "--no-background", "--physics")
        nodes = glb.nodes()
        for name in self.names[:2]:
            parts = glb.children(nodes[name])
            self.assertTrue(1 <= len(parts) <= 8, parts)
            self.assertNotIn("mesh", nodes[name])
            self.assertEqual(nodes[name]["extensions"]["KHR_physics_rigid_bodies"], {"motion": {"isKinematic": True}})
            total = 0
            for part in parts:
                collider = nodes[part]["extensions"]["KHR_physics_rigid_bodies"]["collider"]["geometry"]
                self.assertEqual(collider, {"mesh": nodes[part]["mesh"], "convexHull": True})
                triangles = glb.triangles(nodes[part])
                self.assertLessEqual(len(triangles), 124)
                self.assertEqual(open_edges(triangles), 0)
                self.assertGreater(volume(glb.positions(nodes[part]), triangles), 0)
                total += len(triangles)
            self.assertEqual((facts[name]["level"], facts[name]["triangles"]), ("convex", total))
            self.assertGreater(facts[name]["error"]["silhouette_iou"], 0.85)
        self.assertEqual(facts["pedestrian_0002"]["level"], "box")

    def test_collision_shapes(self):
        """Everything is closed and without colours; Godot makes shapes of all nodes with a mesh, and shows none."""
        for options in ((), ("--naming", "godot"), ("--naming", "godot", "--proxy", "hull")):
            with self.subTest(options=options):
                glb, facts, done = self.export("proxy.glb", *QUICK, "--collision", *options)
                meshes = {name: node for name, node in glb.nodes().items() if "mesh" in node}
                self.assertTrue(any(name.startswith("ground") for name in meshes))
                self.assertTrue(any(name.startswith("car_0000") for name in meshes))
                self.assertTrue(all(said["watertight"] for said in facts.values()))
                for name, node in meshes.items():
                    attributes = glb.json["meshes"][node["mesh"]]["primitives"][0]["attributes"]
                    self.assertEqual(set(attributes), {"POSITION"}, name)
                    self.assertEqual(open_edges(glb.triangles(node)), 0, name)
                    self.assertGreater(volume(glb.positions(node), glb.triangles(node)), 0, name)
                    if options:
                        self.assertRegex(name, "-convcolonly$" if "track" in node["extras"] else "-colonly$")
                heights = [p[2] for name in meshes if name.startswith("ground") for p in glb.positions(meshes[name])]
                self.assertTrue(-0.6 < min(heights) < -0.4 and max(heights) < 0.1)
                self.assertIn("open surfaces", done.stderr)

    def test_same_bytes_on_any_number_of_threads(self):
        options = ["--proxy", "convex", "--naming", "godot", "--texture", 256, *QUICK]
        for threads in (1, 3):
            self.succeeds("export", self.scene, self.path(f"{threads}.glb"), *options, "-j", threads)
        self.assertEqual(fixtures.read(self.path("1.glb")), fixtures.read(self.path("3.glb")))

    def test_textures(self):
        """All objects and chunks share one picture, each in a place of its own. Its places are in proportion
        to the surface. (tests/unit/exporters/test_texture.c checks the picture.)"""
        glb, _, _ = self.export("proxy.glb", *QUICK, "--texture", 512, "--triangles", 200)
        self.assertEqual(len(glb.json["images"]), 1)
        self.assertEqual(len(glb.json["textures"]), 1)
        view = glb.json["bufferViews"][glb.json["images"][0]["bufferView"]]
        begin = view.get("byteOffset", 0)
        picture = glb.bytes[begin : begin + view["byteLength"]]
        self.assertEqual(picture[:2] + picture[-2:], b"\xff\xd8\xff\xd9")
        nodes, taken = glb.nodes(), set()
        for name in ("car_0000", "car_0001", "ground"):
            primitive = glb.json["meshes"][nodes[name]["mesh"]]["primitives"][0]
            self.assertEqual(set(primitive["attributes"]), {"POSITION", "NORMAL", "TEXCOORD_0"})
            material = glb.json["materials"][primitive["material"]]
            self.assertEqual(material["pbrMetallicRoughness"]["baseColorTexture"]["index"], 0)
            self.assertEqual(material.get("doubleSided", False), name == "ground")
            places = glb.accessor(primitive["attributes"]["TEXCOORD_0"])
            cells = {(u // 1024, v // 1024) for u, v in zip(places[::2], places[1::2])}
            self.assertGreater(len(cells), 3, name)
            own = glb.triangles(nodes[name])
            self.assertLess(len(places) // 2, 2 * len(own), name)
            middles = {tuple(sum(places[2 * c + k] for c in t) // 3 for k in range(2)) for t in own}
            self.assertGreater(len(middles), 0.9 * len(own), name)
            self.assertFalse(middles & taken, name)
            taken |= middles
            if name != "ground":
                merged = glb.json["meshes"][nodes[name]["mesh"]]["extensions"]["EXT_mesh_manifold"]
                corners = glb.accessor(merged["manifoldPrimitive"]["indices"])
                self.assertEqual(open_edges([corners[i : i + 3] for i in range(0, len(corners), 3)]), 0)

    def test_cameras(self):
        glb, _, _ = self.export("proxy.glb", "--cameras", "--no-background", "--only", "car_1")
        cameras = [node for node in glb.json["nodes"] if "camera" in node]
        self.assertEqual(len(cameras), 30)
        self.assertEqual(len(glb.json["cameras"]), 1)  # all views have the same intrinsics
        nodes = glb.nodes()
        first = nodes["000_0.00"]
        for got, wanted in zip(first["translation"], (0, 0, 1.6)):
            self.assertAlmostEqual(got, wanted, 5)
        x, y, z, w = first["rotation"]  # a glTF camera looks along its -z axis
        looked = [-2 * (x * z + w * y), -2 * (y * z - w * x), -(1 - 2 * (x * x + y * y))]
        for got, wanted in zip(looked, (math.cos(0.15), 0, -math.sin(0.15))):
            self.assertAlmostEqual(got, wanted, 5)
        self.assertIn("ego", nodes)
        targets = [c["target"]["node"] for c in glb.json["animations"][0]["channels"]]
        self.assertIn(glb.json["nodes"].index(nodes["ego"]), targets)

    def test_one_object(self):
        glb, facts, _ = self.export("proxy.glb", "--only", "car_1", "--no-background")
        self.assertEqual(list(facts), ["car_0001"])


class Odd(Case):
    def test_empty_scene(self):
        scene = scenes.make_empty_scene(self.path("scene"))
        done = self.succeeds("export", scene, self.path("proxy.glb"))
        self.assertIn("0 proxies", done.stdout + done.stderr)
        self.assertEqual(Glb(self.path("proxy.glb")).json["nodes"][0]["name"], "scene")
        self.fails(["export", scene, self.path("splats.glb"), "--splats"], "no Gaussian")

    def test_bare_file(self):
        path = self.write("three.ply", fixtures.ply_bytes(fixtures.some_splats()[:3]))
        self.succeeds("export", path, self.path("proxy.glb"))
        self.succeeds("export", path, self.path("splats.glb"), "--splats")
        done = self.succeeds("export", path, self.path("proxy.glb"), "--proxy", "convex")
        self.assertIn("of labelled objects alone: its hull", done.stdout)
        self.assertEqual(len(Glb(self.path("splats.glb")).json["meshes"]), 1)

    def test_bad_calls(self):
        path = self.write("some.ply", fixtures.ply_bytes(fixtures.some_splats()))
        self.fails(["export", path, self.path("proxy.obj")], ".glb", code=2)
        self.fails(["export", path, self.path("proxy.glb"), "--triangles", "3"], "--triangles", code=2)
        self.fails(["export", path, self.path("nowhere", "deep", "proxy.glb")], "nowhere")
        for file, options in (
            ("x.usda", ["--naming", "godot"]),
            ("x.glb", ["--naming", "unreal", "--lod"]),
            ("x.glb", ["--collision", "--lod"]),
            ("x.glb", ["--collision", "--naming", "unreal"]),
            ("x.ply", ["--collision"]),
            ("x.ply", ["--texture", 256]),
            ("x.usdz", ["--texture", 256]),
        ):
            self.fails(["export", path, self.path(file), *options], options[0], code=2)
        self.fails(["export", self.path("missing"), self.path("proxy.glb")], "missing")


class Usdz(Case):
    def test_pipe_is_refused(self):
        """The head of a USDZ archive is written last, and a pipe can't be rewound."""
        path = self.write("three.ply", fixtures.ply_bytes(fixtures.some_splats()[:3]))
        os.symlink("/dev/stdout", self.path("x.usdz"))
        self.fails(["export", path, self.path("x.usdz")], "x.usdz", "expected a regular file")


class Splats(Case):
    def test_formats(self):
        scene = scenes.make_scene(self.path("scene"))
        for name in ("all.ply", "all.spz", "all.splat"):
            self.succeeds("export", scene, self.path(name), "--time", "0.3")
            info = self.path("info.json")
            self.succeeds("info", self.path(name), "--json", info)
            with open(info) as file:
                self.assertGreater(json.load(file)["gaussians"], 5000, name)

    def test_moving_objects_depend_on_time(self):
        scene = scenes.make_scene(self.path("scene"))
        for time in (0.0, 0.9):
            self.succeeds("export", scene, self.path(f"{time}.ply"), "--time", time)
        self.assertNotEqual(fixtures.read(self.path("0.0.ply")), fixtures.read(self.path("0.9.ply")))


if __name__ == "__main__":
    main()
