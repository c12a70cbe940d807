# SPDX-License-Identifier: Apache-2.0
"""Exports of pags are read by other tools: Babylon.js in Chromium, Godot 4, Blender and OpenUSD print what they read,
which is compared with scene.json; in Godot's and Blender's physics bodies fall on collision shapes.

test_tools.py PAGS [SCENE [PICTURES]]: uses SCENE and writes pictures, or makes a small street. The variable GODOT
names Godot's program. Tests of missing tools are skipped; exits with 77 if all are missing."""

import json
import os
import re
import shutil
import subprocess
import sys
import unittest
import zipfile

HERE = os.path.dirname(os.path.abspath(__file__))
sys.path[:0] = [os.path.join(HERE, "..", "cli"), os.path.join(HERE, "..", "addon")]

import fixtures
import run_blender
import scenes
from fixtures import Case

SCENE, PICTURES = (sys.argv[2:4] + [None, None])[:2]
NODE, CHROMIUM, GODOT = shutil.which("node"), shutil.which("chromium"), os.environ.get("GODOT")
BLENDER = shutil.which("blender")
MODULES = os.path.join(HERE, "node_modules")
USD = os.path.join(HERE, ".venv", "bin", "python")
has_babylon = bool(NODE and CHROMIUM) and all(
    os.path.isdir(os.path.join(MODULES, m)) for m in ("@babylonjs", "puppeteer-core")
)
ABOVE = 20.0  # height in metres above an object from which rays are cast down
DROPS = [(2.0 * (i % 4) - 4, -1.0 - 1.5 * (i // 4), 0.0) for i in range(12)]  # where boxes and wheels fall, in turn


def turned(v):
    """Turns a vector with z up into glTF's axes with y up."""
    return [v[0], v[2], -v[1]]


class Street:
    """The data of scene.json, read without the program pags."""

    def __init__(self, folder):
        with open(os.path.join(folder, "scene.json")) as file:
            self.facts = json.load(file)
        self.objects = self.facts["objects"]
        for number, item in enumerate(self.objects):
            item["name"] = re.sub("[^a-z0-9]", "_", item["class"].lower()) + f"_{number:04d}"
        self.zero = min([self.facts["time"][0], *(item["knots"][0]["time"] for item in self.objects)])

    def place(self, knot):
        """Returns an object's position at a label, relative to the origin: the label's pose and the correction by
        training."""
        pose = knot["world_from_object"]
        return [
            sum(pose[4 * row + k] * knot["translation"][k] for k in range(3))
            + pose[4 * row + 3]
            - self.facts["origin"][row]
            for row in range(3)
        ]

    def mover(self):
        """Returns the vehicle that moves farthest, and the label at its farthest position."""

        def way(item, knot):
            return sum((a - b) ** 2 for a, b in zip(self.place(item["knots"][0]), self.place(knot)))

        pairs = [
            (way(o, k), n, i)
            for n, o in enumerate(self.objects)
            if o["moving"] and o["category"] == "vehicle"
            for i, k in enumerate(o["knots"])
        ]
        _, number, index = max(pairs)
        return self.objects[number], self.objects[number]["knots"][index]


class Tool(Case):
    def setUp(self):
        super().setUp()
        self.scene = SCENE or scenes.make_scene(self.path("scene"))
        self.street = Street(self.scene)
        self.quick = [] if SCENE else ["--range", 15, "--chunk", 40, "--voxel", 0.4]
        self.car, self.knot = self.street.mover()
        self.seconds = self.knot["time"] - self.street.zero

    def job(self, **more):
        """Returns the job for a tool: rays cast down onto the car at self.seconds, onto the car's first position,
        and onto the recording car's first position."""
        here, there = self.street.place(self.knot), self.street.place(self.car["knots"][0])
        down = lambda at, up: {"from": turned([at[0], at[1], at[2] + up]), "along": [0, -1, 0]}
        behind = [here[0] - 9, here[1] - 6, here[2] + 4]
        return {
            "seconds": self.seconds,
            "rays": {
                **{"car": down(here, ABOVE), "before": down(there, ABOVE), "ground": down([0, 0, 0], 5)},
                **{f"drop {i}": down(place, 2) for i, place in enumerate(DROPS)},
            },
            "drops": {f"drop {i}": {**down(place, 1), "wheel": i % 2 == 1} for i, place in enumerate(DROPS)},
            "eye": turned(behind),
            "target": turned(here),
            **more,
        }

    def check_nodes(self, nodes):
        """Checks that the nodes are exactly the scene's objects, with class, id and other properties in their
        extras."""
        told = {
            n["name"]: n["extras"]
            for n in nodes
            if n["extras"] and "track" in n["extras"] and re.fullmatch(r".*_\d{4}", n["name"])
        }
        self.assertEqual(sorted(told), sorted(item["name"] for item in self.street.objects))
        for item in self.street.objects:
            extras = told[item["name"]]
            wanted = (item["class"], item["id"], item["category"], item["critical"], item["moving"])
            self.assertEqual(tuple(extras[k] for k in ("class", "track", "category", "critical", "moving")), wanted)
            for got, want in zip(extras["size"], item["size"]):
                self.assertAlmostEqual(got, want, 4)

    def check_moved(self, nodes):
        at = next(n["at"] for n in nodes if n["name"] == self.car["name"])
        for got, want in zip(at, turned(self.street.place(self.knot))):
            self.assertAlmostEqual(got, want, 3)

    def check_hits(self, hits, ending):
        """The ray hits the car's roof, in the upper half of its labelled box or up to a tenth above it. At the car's
        first position no ray hits the car any more."""
        self.assertRegex(hits["car"]["name"], self.car["name"] + ending)
        half = 0.5 * self.car["size"][2]
        self.assertGreater(hits["car"]["distance"], ABOVE - 1.2 * half)
        self.assertLess(hits["car"]["distance"], ABOVE)
        self.assertNotIn(self.car["name"], (hits["before"] or {"name": ""})["name"])


@unittest.skipUnless(has_babylon, "needs node, Babylon.js and Debian's chromium: make setup")
class Babylon(Tool):
    def read(self, name, **more):
        job = self.write("job.json", json.dumps(self.job(**more)))
        script = os.path.join(HERE, "tools.mjs")
        done = subprocess.run(
            [NODE, script, CHROMIUM, self.path(name), job], capture_output=True, text=True, timeout=900
        )
        if done.returncode == 77:
            self.skipTest(done.stderr.strip())
        self.assertEqual(done.returncode, 0, done.stdout + done.stderr)
        return json.loads(done.stdout)

    def test_surfaces(self):
        self.succeeds("export", self.scene, self.path("web.glb"), *self.quick)
        found = self.read("web.glb", **({"picture": os.path.join(PICTURES, "use-in-web.jpg")} if PICTURES else {}))
        self.check_nodes(found["nodes"])
        self.check_moved(found["nodes"])
        self.check_hits(found["hits"], "$")
        self.assertRegex(found["hits"]["ground"]["name"], "^ground")
        self.assertEqual(found["animations"], ["tracks"])
        print(
            f"Babylon.js {found['version']}: {len(found['nodes'])} nodes, {len(self.street.objects)} objects with class and id; {found['hits']['car']}"
        )

    def test_convex_parts(self):
        self.succeeds("export", self.scene, self.path("convex.glb"), "--proxy", "convex", "--no-background")
        found = self.read("convex.glb")
        self.check_nodes(found["nodes"])
        self.check_moved(found["nodes"])
        self.check_hits(found["hits"], r"_part\d\d$")


@unittest.skipUnless(GODOT, "needs Godot 4: GODOT=PROGRAM, which scripts/setup_godot.sh makes")
class Godot(Tool):
    def run_godot(self, *arguments, window=False):
        """Runs Godot; opens a window under Xvfb, drawn by the processor, only if pictures are requested."""
        how = (
            ["xvfb-run", "-a", GODOT, "--rendering-driver", "opengl3", "--audio-driver", "Dummy"]
            if window
            else [GODOT, "--headless"]
        )
        done = subprocess.run(
            [*how, "--path", self.path("project"), *arguments], capture_output=True, text=True, timeout=300
        )
        self.assertEqual(done.returncode, 0, done.stdout + done.stderr)
        self.assertNotRegex(done.stdout + done.stderr, "SCRIPT ERROR|Parse Error")

    def read(self, *options, **more):
        self.write("project/project.godot", 'config_version=5\n[application]\nconfig/name="street"\n')
        shutil.copy(os.path.join(HERE, "tools.gd"), self.path("project"))
        self.succeeds("export", self.scene, self.path("project", "scene.glb"), "--naming", "godot", *options)
        self.write("project/job.json", json.dumps(self.job(**more)))
        self.run_godot("--import")
        self.run_godot("-s", "tools.gd", window="picture" in more)
        with open(self.path("project", "found.json")) as file:
            return json.load(file)

    def test_surfaces(self):
        wanted = PICTURES and shutil.which("xvfb-run")
        found = self.read(*self.quick, **({"picture": os.path.join(PICTURES, "use-in-godot.jpg")} if wanted else {}))
        self.check_nodes(found["nodes"])
        self.check_moved(found["nodes"])
        self.check_hits(found["hits"], "_mesh$")
        self.assertRegex(found["hits"]["ground"]["name"], "^ground")
        self.assertEqual(found["animations"], ["tracks"])
        self.check_rests(found)
        solid = [n["parent"] for n in found["nodes"] if n["kind"] == "StaticBody3D"]
        self.assertEqual(len([name for name in solid if name.endswith("_mesh")]), len(self.street.objects))
        print(
            f"Godot {found['version']}: {len(found['nodes'])} nodes, {len(self.street.objects)} objects with class and id, {len(solid)} bodies; "
            f"{found['hits']['car']}"
        )

    def check_rests(self, found):
        """Boxes and wheels rest on the ground that a ray finds there."""
        self.assertEqual(len(found["rests"]), len(DROPS))
        for i in range(len(DROPS)):
            ground = 2 - found["hits"][f"drop {i}"]["distance"]
            self.assertAlmostEqual(found["rests"][f"drop {i}"], ground + (0.3 if i % 2 else 0.2), delta=0.03, msg=i)

    def test_collision_shapes(self):
        """There are bodies without visible meshes, which carry what falls onto them."""
        found = self.read("--collision", *self.quick)
        self.check_nodes(found["nodes"])
        self.check_moved(found["nodes"])
        self.check_hits(found["hits"], r"(_part\d\d)?$")
        self.assertEqual([n["name"] for n in found["nodes"] if n["kind"] == "MeshInstance3D"], [])
        shapes = {n["name"]: n["shapes"] for n in found["nodes"] if n["kind"] == "StaticBody3D"}
        self.assertEqual(shapes["ground"], ["ConcavePolygonShape3D"])
        parts = [name for name in shapes if "_part" in name]
        self.assertGreaterEqual(len(parts), len(self.street.objects))
        self.assertTrue(all(shapes[name] == ["ConvexPolygonShape3D"] for name in parts))
        self.check_rests(found)

    def test_convex_parts_next_to_surfaces(self):
        found = self.read("--no-background", "--proxy", "convex")
        self.check_nodes(found["nodes"])
        self.check_moved(found["nodes"])
        self.check_hits(found["hits"], "$")
        seen = {n["name"] for n in found["nodes"] if n["kind"] == "MeshInstance3D"}
        self.assertEqual(seen, {item["name"] for item in self.street.objects})
        bodies = [n for n in found["nodes"] if n["kind"] == "StaticBody3D"]
        self.assertEqual({n["parent"] for n in bodies}, seen)
        self.assertEqual({shape for n in bodies for shape in n["shapes"]}, {"ConvexPolygonShape3D"})


@unittest.skipUnless(BLENDER, "needs Blender: make setup")
class Blender(Tool):
    def test_bodies_rest_on_collision_shapes(self):
        """Boxes and wheels that fall from 1 m rest on the ground."""
        self.succeeds("export", self.scene, self.path("scene.glb"), "--collision", *self.quick)
        job = self.write("job.json", json.dumps(self.job()))
        script = os.path.join(HERE, "drops.py")
        command = [BLENDER, "-b", "--factory-startup", "-noaudio", "--python-exit-code", "3", "-P", script, "--"]
        done = subprocess.run(
            [*command, self.path("scene.glb"), job, self.path("found.json")],
            capture_output=True,
            text=True,
            timeout=900,
            env=run_blender.environment(self.path("blender")),
        )
        self.assertEqual(done.returncode, 0, done.stdout + done.stderr)
        with open(self.path("found.json")) as file:
            found = json.load(file)
        self.assertEqual(len(found["drops"]), len(DROPS))
        for i in range(len(DROPS)):
            drop = found["drops"][f"drop {i}"]
            self.assertIsNotNone(drop["ground"], i)
            self.assertAlmostEqual(drop["lowest"], drop["ground"], delta=0.03, msg=i)
        print(f"Blender {found['version']}: {len(DROPS)} bodies rest on the ground")


@unittest.skipUnless(os.path.exists(USD), "needs usd-core: make setup")
class Usd(Tool):
    def read(self, name, seconds):
        script, code = os.path.join(HERE, "check_usd.py"), seconds * (self.street.facts.get("fps") or 24)
        done = subprocess.run([USD, script, self.path(name), str(code)], capture_output=True, text=True, timeout=900)
        self.assertEqual(done.returncode, 0, done.stderr)
        return json.loads(done.stdout)

    def export(self, name, *options):
        self.succeeds("export", self.scene, self.path(name), "--sh-degree", 0, "--triangles", 600, *options)

    def test_bodies_and_labels(self):
        self.export("street.usda", *self.quick)
        found = self.read("street.usda", self.seconds)
        self.assertEqual((found["errors"], found["up"], found["metres"], found["default"]), ([], "Z", 1, "/scene"))
        prims = found["prims"]
        bodies = {path.split("/")[2]: prim for path, prim in prims.items() if "kinematic" in prim}
        self.assertEqual(sorted(bodies), sorted(item["name"] for item in self.street.objects))
        for number, item in enumerate(self.street.objects):
            body, proxy = bodies[item["name"]], prims[f"/scene/{item['name']}/proxy"]
            label = [re.sub("[^a-z0-9]", "_", item["class"].lower())]
            self.assertEqual((body["kinematic"], body["label"], body["number"]), (True, label, number))
            self.assertEqual((proxy["label"], proxy["visible"]), (label, "invisible"))
            self.assertIn("PhysicsCollisionAPI", proxy["schemas"])
        ground = prims["/scene/background/ground_000"]
        self.assertEqual((ground["collides"], ground["label"]), (True, ["ground"]))
        for got, want in zip(bodies[self.car["name"]]["last"], self.street.place(self.knot)):
            self.assertAlmostEqual(got, want, 4)
        half = 0.5 * self.car["size"][2]
        height = prims[f"/scene/{self.car['name']}/proxy"]["height"]
        self.assertTrue(0 < height < 1.2 * half, height)
        print(
            f"usd-core: {len(prims)} prims, {len(bodies)} kinematic bodies with labels; the car's roof is {height:.2f} m over its middle"
        )

    def test_archive(self):
        """A .usdz file holds the same stage without compression, and its data begin at a multiple of 64 bytes."""
        self.export("street.usda", "--no-background")
        self.export("street.usdz", "--no-background")
        self.assertEqual(self.read("street.usdz", self.seconds), self.read("street.usda", self.seconds))
        with zipfile.ZipFile(self.path("street.usdz")) as archive:
            self.assertIsNone(archive.testzip())
            (member,) = archive.infolist()
            self.assertEqual((member.filename, member.compress_type), ("scene.usda", zipfile.ZIP_STORED))
            self.assertEqual(archive.read(member), fixtures.read(self.path("street.usda")))
        data = fixtures.read(self.path("street.usdz"))
        name, extra = int.from_bytes(data[26:28], "little"), int.from_bytes(data[28:30], "little")
        self.assertEqual((30 + name + extra) % 64, 0)

    def test_convex_parts(self):
        self.export("street.usda", "--no-background", "--proxy", "convex")
        found = self.read("street.usda", self.seconds)
        self.assertEqual(found["errors"], [])
        parts = {
            path: prim for path, prim in found["prims"].items() if path.startswith(f"/scene/{self.car['name']}/proxy_")
        }
        self.assertTrue(1 <= len(parts) <= 8, parts)
        self.assertEqual({prim["shape"] for prim in parts.values()}, {"convexHull"})
        self.assertTrue(any(prim["height"] and prim["height"] > 0.2 * self.car["size"][2] for prim in parts.values()))

    @unittest.skipIf(SCENE, "of the small street")
    def test_objects_come_and_go(self):
        """A car whose track begins at 0.5 s is neither visible nor solid before."""
        with open(self.path("scene", "scene.json")) as file:
            facts = json.load(file)
        item = next(o for o in facts["objects"] if o["id"] == self.car["id"])
        item["knots"] = [knot for knot in item["knots"] if knot["frame"] >= 5]
        self.write("scene/scene.json", json.dumps(facts))
        self.export("late.usda", "--no-background")
        path = f"/scene/{self.car['name']}"
        for seconds, seen in ((0.2, False), (0.6, True)):
            prims = self.read("late.usda", seconds)["prims"]
            self.assertEqual(prims[path]["seen"], "inherited" if seen else "invisible", seconds)
            self.assertEqual(prims[path + "/splats"]["seen"], "inherited" if seen else "invisible", seconds)
            self.assertEqual(prims[path + "/proxy"]["collides"], seen, seconds)


def main():
    fixtures.PAGS = os.path.abspath(sys.argv[1])
    del sys.argv[1:4]
    if not (has_babylon or GODOT or BLENDER or os.path.exists(USD)):
        print("skipped: neither Babylon.js with Chromium nor Godot, Blender or usd-core is here: make setup")
        return 77
    unittest.main(verbosity=2)


if __name__ == "__main__":
    sys.exit(main())
