# SPDX-License-Identifier: Apache-2.0
"""Tests the rules of "Clean up and look" in the module and the program: each rule's numbers, the sky, frames of
objects, errors."""

import json
import math
import os
import sys

HERE = os.path.dirname(os.path.abspath(__file__))
sys.path.insert(0, os.path.join(HERE, "..", "cli"))
MODULE = sys.argv.pop(2) if len(sys.argv) > 2 else os.environ.get("PAGS_MODULE", "build/python")
sys.path.insert(0, MODULE)

import fixtures  # noqa: E402
import pags  # noqa: E402
from fixtures import Case, read, read_png  # noqa: E402
from test_drive import make_drive  # noqa: E402

MATRIX = [0.5, 0.1, 0, 0.05, 0, 0.8, 0.1, 0.02, 0.2, 0, 0.6, -0.01]
C0 = 0.28209479177387814
unit_from = lambda middle, radius: [
    v for k in range(3) for v in ([1 / radius if j == k else 0 for j in range(3)] + [-middle[k] / radius])
]


class Rules(Case):
    def setUp(self):
        super().setUp()
        sh = [[0.3 * math.sin(7 * i + k) for k in range(12)] for i in range(4)]
        self.before = {
            "means": [[i, 0, 5] for i in range(4)],
            "quats": [[1, 0, 0, 0]] * 4,
            "scales": [[math.log(0.1 * (i + 1)), -4, -4] for i in range(4)],
            "opacities": [math.log(o / (1 - o)) for o in (0.1, 0.3, 0.5, 0.9)],
            "sh": [[row[3 * k : 3 * k + 3] for k in range(4)] for row in sh],
        }
        pags.Scene(**self.before).save(self.path("some.ply"))

    def after(self, *rules):
        arrays = pags.load(self.path("some.ply"), json.dumps(rules)).arrays()
        return {name: memoryview(values).tolist() for name, values in arrays.items()}

    def left(self, *rules):
        return [round(mean[0]) for mean in sorted(self.after(*rules)["means"])]

    def near(self, a, b):
        self.assertLess(max(abs(x - y) for x, y in zip(a, b)), 1e-5)

    def test_colour(self):
        """A colour rule multiplies each harmonic's colour by M and adds t to the constant one: a colour c becomes M
        c + t in every direction."""
        after = self.after({"matrix": MATRIX, "sh": 0.5})
        for was, now in zip(self.before["sh"], after["sh"]):
            for k in range(4):
                wanted = [sum(MATRIX[4 * r + c] * was[k][c] for c in range(3)) * (0.5 if k else 1) for r in range(3)]
                if k == 0:
                    wanted = [
                        v + (0.5 * sum(MATRIX[4 * r : 4 * r + 3]) + MATRIX[4 * r + 3] - 0.5) / C0
                        for r, v in enumerate(wanted)
                    ]
                self.near(now[k], wanted)
        self.near(after["opacities"], self.before["opacities"])

    def test_opacity(self):
        odds = [1 / (1 + math.exp(-v)) for v in self.after({"opacity": 1.5})["opacities"]]
        self.near(odds, [0.15, 0.45, 0.75, 1 - 1e-6])

    def test_limits(self):
        self.assertEqual(self.left({"least_opacity": 0.2}), [1, 2, 3])
        self.assertEqual(self.left({"least_size": 0.25}), [2, 3])
        self.assertEqual(self.left({"greatest_size": 0.25}), [0, 1])
        self.assertEqual(self.left({"least_size": 0.15}, {"greatest_size": 0.35}), [1, 2])

    def test_crops(self):
        ball = lambda x, keep: {"shape": "sphere", "keep": keep, "unit_from_frame": unit_from((x, 0, 5), 0.6)}
        box = {"shape": "box", "unit_from_frame": unit_from((1.5, 0.7, 5), 0.8)}
        self.assertEqual(self.left({"crops": [ball(1, False)]}), [0, 2, 3])
        self.assertEqual(self.left({"crops": [ball(0, True), ball(3, True)]}), [0, 3])
        self.assertEqual(self.left({"crops": [box]}), [1, 2])  # a ball of that radius would contain none of them
        self.assertEqual(self.left({"crops": [box, ball(1, False)]}), [2])

    def test_errors(self):
        for rules, words in (
            ("{}", "array of rules"),
            ('[{"opactiy": 1}]', "'opactiy'"),
            ('[{"opacity": -1}]', "'opacity' from 0"),
            ('[{"object": 3}]', "object"),
            ('[{"crops": [{"shape": "cone", "unit_from_frame": []}]}]', "'cone'"),
            ('[{"matrix": [1, 2]}]', "matrix"),
            ('[{"least_opacity": 1}]', "none of the 4"),
            ('[{"least_views": 2}]', "training views"),
        ):
            with self.assertRaises(pags.Error) as caught:
                pags.load(self.path("some.ply"), rules)
            self.assertIn(words, str(caught.exception))

    def test_program(self):
        """The program exports the same Gaussians that the module loads. Empty rules change nothing."""
        rules = [{"matrix": MATRIX, "opacity": 0.7, "greatest_size": 0.35}]
        self.write("rules.json", json.dumps(rules))
        said = self.succeeds(
            "export", self.path("some.ply"), self.path("out.ply"), "--edits", self.path("rules.json")
        ).stdout
        self.assertIn("3 of 4", said)
        again = {name: memoryview(v).tolist() for name, v in pags.load(self.path("out.ply")).arrays().items()}
        order = lambda arrays: sorted(zip(arrays["means"], arrays["opacities"], arrays["sh"]))
        self.assertEqual(order(again), order(self.after(*rules)))
        self.write("rules.json", "[]")
        self.succeeds("export", self.path("some.ply"), self.path("same.ply"), "--edits", self.path("rules.json"))
        self.succeeds("export", self.path("some.ply"), self.path("plain.ply"))
        self.assertEqual(read(self.path("same.ply")), read(self.path("plain.ply")))


class Drive(Case):
    """Tests rules on a drive: a red car that follows a track, a green parked car, a white wall, a sky of (0, 0,
    0.5)."""

    def setUp(self):
        super().setUp()
        make_drive(self.path("scene"))

    def colours(self, *rules):
        """Returns whether the first view shows bright red, green and white, and its blue value in the sky."""
        scene = pags.load(self.path("scene"), json.dumps(rules))
        picture = pags.render(scene, scene.views[0], outputs=("rgb8",))
        pixels = memoryview(picture.rgb8).tolist()
        pixels = [p for row in pixels for p in row]
        red = any(r > 150 and g < 100 and b < 100 for r, g, b in pixels)
        green = any(g > 150 and r < 100 and b < 100 for r, g, b in pixels)
        white = any(min(p) > 150 for p in pixels)
        return red, green, white, pixels[0][2]

    def test_motion(self):
        """A parked object is moved with its harmonics and its label; a tracked one can't be."""
        turned = [0, -1, 0, 3, 1, 0, 0, -2, 0, 0, 1, 0.5]  # about z by 90 degrees, and an offset
        before, after = (pags.load(self.path("scene"), json.dumps(r)) for r in ([], [{"object": 0, "motion": turned}]))
        places = [memoryview(scene.arrays()["means"]).tolist() for scene in (before, after)]
        origin = before.info["origin"]
        for number, (was, now) in enumerate(zip(*places)):
            x, y, z = (a + b for a, b in zip(was, origin))
            mine = memoryview(before.object_of).tolist()[number] == 0
            wanted = (3 - y, x - 2, z + 0.5) if mine else (x, y, z)
            self.near([a + b for a, b in zip(now, origin)] if mine else [*now], wanted if mine else was)
        was, now = (scene.pose(0, 100.0) for scene in (before, after))
        self.near(now[:3:2] + now[3::4], [-was[4], -was[6], 3 - was[7], was[3] - 2, was[11] + 0.5])
        with self.assertRaises(pags.Error) as caught:
            pags.load(self.path("scene"), json.dumps([{"object": 1, "motion": turned}]))
        self.assertIn("parked", str(caught.exception))

    def near(self, a, b):
        self.assertLess(max(abs(x - y) for x, y in zip(a, b, strict=True)), 1e-3)

    def test_objects(self):
        self.assertEqual(self.colours()[:3], (True, True, True))
        self.assertEqual(self.colours({"object": 1, "opacity": 0})[:3], (False, True, True))
        self.assertEqual(self.colours({"object": 0, "opacity": 0})[:3], (True, False, True))
        self.assertEqual(self.colours({"object": -1, "opacity": 0})[:3], (True, True, False))

    def test_frames(self):
        """An object's crop is in the object's frame at any pose. The scene's crop doesn't change objects that follow
        tracks."""
        near = {"shape": "sphere", "keep": False, "unit_from_frame": unit_from((0, 0, 0), 1)}
        for number in range(2):
            seen = self.colours({"object": number, "crops": [near]})
            self.assertEqual(seen[:3], (number == 0, number == 1, True))
        far = {"shape": "sphere", "keep": True, "unit_from_frame": unit_from((1000, 0, 0), 1)}
        self.assertEqual(self.colours({"crops": [far]})[:3], (True, False, False))

    def test_sky(self):
        """The look of the whole scene also changes the sky; an object's look doesn't."""
        half = [0.5, 0, 0, 0, 0, 0.5, 0, 0, 0, 0, 0.5, 0]
        self.assertEqual(self.colours()[3], 128)
        self.assertEqual(self.colours({"matrix": half})[3], 64)
        self.assertEqual(self.colours({"object": -1, "matrix": half})[3], 128)

    def test_saved_scene(self):
        """The saved scene folder gives the same picture."""
        rules = json.dumps([{"matrix": MATRIX}, {"object": 1, "opacity": 0.5}])
        pags.write_edited(self.path("scene"), rules, self.path("edited"))
        pictures = [pags.load(self.path("scene"), rules), pags.load(self.path("edited"))]
        pictures = [bytes(pags.render(s, s.views[0], outputs=("rgb8",)).rgb8) for s in pictures]
        self.assertLessEqual(max(abs(x - y) for x, y in zip(*pictures)), 1)  # the sky is stored in half floats
        self.write("rules.json", rules)
        self.succeeds(
            "render", self.path("scene"), "-o", self.path("out"), "--split", "test", "--edits", self.path("rules.json")
        )
        self.succeeds("render", self.path("edited"), "-o", self.path("out2"), "--split", "test")
        names = [n for n in os.listdir(self.path("out")) if n.endswith(".png")]
        a, b = (read_png(self.path(folder, names[0]))[4] for folder in ("out", "out2"))
        self.assertLessEqual(max(abs(x - y) for x, y in zip(a, b)), 1)


if __name__ == "__main__":
    fixtures.main()
