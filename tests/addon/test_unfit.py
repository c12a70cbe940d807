# SPDX-License-Identifier: Apache-2.0
"""Tests arguments from Python: unsuitable ones are refused by name, and a camera's lens and rolling shutter take
effect."""

import json
import math
import os
import shutil
import sys

sys.path.insert(0, os.path.dirname(os.path.abspath(__file__)))

from test_module import IDENTITY, ORIGIN, ModuleCase, camera, fixtures, make_camera, pags, pixel, read, write  # noqa: E402

NAN, INF = float("nan"), float("inf")
FISHEYE = {"kind": "fisheye", "k": [-0.06, 0.012, 0, 0, 0, 0], "field": 200}
ROLLING = {"direction": "top_to_bottom", "seconds": 0.05, "velocity": [0, 0.4, 0, 0, 0, 8]}


class Unfit(ModuleCase):
    def refused(self, call, named, *arguments, **more):
        with self.assertRaisesRegex((ValueError, TypeError), named, msg=f"{arguments} {more}"):
            call(*arguments, **more)

    def test_arguments_of_a_picture(self):
        """Every argument of submit and render refuses impossible values and wrong types."""
        numbers = [NAN, INF, -INF, "1", [1], None, 1e300]
        bad = {
            "background": [(NAN, 0, 0), (0, INF, 0), (1, 2), "red", 5, ("a", 0, 0)],
            "exposure": [[NAN] * 6, [1] * 5, [1, 1, 1, 0, 0, INF], 2],
            "near_plane": [*numbers, -5],
            "cut": [*numbers, -1, 1001],
            "depth_scale": numbers,
            "depth_empty": numbers,
            "clips": [[[NAN, 0, 0, 1]], [[0, 0, 1, INF]], [[1, 2, 3]], 5, [["a", 0, 0, 0]]],
            "window": [(0.5, 0, 1.7, 1), (0, 0, NAN, 1), (0, 0, 999, 1), (0, 0, 1), "full"],
            "object_values": [[NAN, 1], [1], 5, ["a", 1]],
            "sh_degree": [4, 1.5, NAN, "3", None],
            "exp_degree": [4, 7, NAN, "5"],
            "antialiased": [2, 0.5, NAN, "yes"],
            "linear": ["False", NAN, 2, None, [0]],
            "flip": ["no", NAN],
            "transparent": ["no", NAN, 7],
            "mode": ["what", 5, None],
            "early_z": ["bounded=nan", "sometimes", 5],
            "outputs": ["rgba", ("what",), 5, (5,)],
            "placements": [5, [5], [(0.5, IDENTITY)], [(0, [NAN] * 12)], [("a", IDENTITY)], [(0,)]],
            "names": [["a"], 5],
            "deadline": [50, "soon"],
            "others": [
                5,
                [5],
                [{"scene": self.scene, "time": INF}],
                [{"scene": self.scene, "world_from_scene": [NAN] * 12}],
            ],
            "threads": [-1, 1.5, NAN, "2", 999],
        }
        for name, values in bad.items():
            for value in values:
                self.refused(pags.render, name, self.scene, make_camera(), **{name: value})
        for good in (
            dict(linear=1, flip=0, window=(0.0, 0, 4, 4)),
            dict(cut=0.5, near_plane=0, sh_degree=2.0, antialiased=True),
        ):
            pags.render(self.scene, make_camera(), **good)

    def test_cameras(self):
        bad = dict(
            width=[1.5, NAN, 0, "8", None],
            height=[70000, INF],
            fx=[NAN, INF, -1, "a", None],
            cx=[NAN, "a"],
            time=[INF, NAN, "now"],
            world_from_camera=[[NAN] * 12, [2] * 12, [1] * 11, None],
            lens=[
                "fisheye",
                {"kind": "what"},
                {},
                {**FISHEYE, "k": [NAN] * 6},
                {**FISHEYE, "k": [0]},
                {**FISHEYE, "k1": 0},
                {**FISHEYE, "field": INF},
                [1],
            ],
            rolling_shutter=[
                "top_to_bottom",
                {},
                {**ROLLING, "direction": "up"},
                {**ROLLING, "seconds": NAN},
                {**ROLLING, "seconds": 5},
                {**ROLLING, "velocity": [INF] * 6},
                {**ROLLING, "speed": 1},
            ],
        )
        for name, values in bad.items():
            for value in values:
                given = {**make_camera(), name: value}
                for call in (
                    lambda c: pags.render(self.scene, c),
                    lambda c: pags.pick(self.scene, c, 1, 1),
                    lambda c: pags.render(self.scene, make_camera(), outputs=("motion",), before=c),
                ):
                    self.refused(call, {"fx": "f[xy]"}.get(name, name), given)
        self.refused(
            pags.render,
            "before: has a lens",
            self.scene,
            make_camera(),
            outputs=("motion",),
            before={**make_camera(), "lens": FISHEYE},
        )
        self.refused(pags.render, "camera: expected a dictionary", self.scene, "camera")
        K, pose = [[50, 0, 32], [0, 50, 24], [0, 0, 1]], [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0]]
        for name, value in [
            ("width", 1.5),
            ("height", "a"),
            ("K", [[NAN, 0, 1], [0, 1, 1], [0, 0, 1]]),
            ("time", NAN),
            ("axes", 5),
            ("world_from_camera", [[NAN, 0, 0, 0], *pose[1:]]),
        ]:
            self.refused(
                pags.camera,
                "focal" if name == "K" else name,
                **{**dict(width=64, height=48, K=K, world_from_camera=pose), name: value},
            )

    def test_arguments_of_other_calls(self):
        scene, view = self.scene, make_camera()
        rgb = [[[0.0] * 3] * view["width"]] * view["height"]
        for named, call, *arguments in [
            ("x", pags.pick, scene, view, 1.5, 0),
            ("y", pags.pick, scene, view, 0, NAN),
            ("x", pags.pick, scene, view, -1, 0),
            ("time", scene.pose, 1, NAN),
            ("object", scene.pose, "a", 0),
            ("sensor", scene.exposure, 0.5, 0),
            ("time", scene.exposure, 0, INF),
            ("object", scene.track, "a"),
            ("budget", scene.points, 0, NAN),
            ("value", pags.heat, NAN),
            ("name", pags.cryptomatte_hash, 5),
            ("path", pags.load, 5),
            ("edits", pags.load, self.path("scene"), 5),
            ("folder", pags.write_edited, "a", "{}", 5),
            ("ms", pags.Deadline, NAN),
            ("ms", pags.Deadline(5).pace, NAN, 5),
            ("wanted", pags.Deadline(5).pace, 5, INF),
            ("threads", pags.Renderer, 1.5),
            ("seconds", pags.Renderer().submit(scene, view).wait, NAN),
            ("rgb", pags.gradients, scene, view, [[[NAN] * 3] * view["width"]] * view["height"]),
        ]:
            self.refused(call, named, *arguments)
        for named, value in [
            ("background", (NAN, 0, 0)),
            ("near_plane", NAN),
            ("sh_degree", 1.5),
            ("threads", NAN),
            ("transparent", "no"),
        ]:
            self.refused(pags.gradients, named, scene, view, rgb, **{named: value})
        one = dict(means=[[0, 0, 3]], quats=[[1, 0, 0, 0]], scales=[[-2] * 3], opacities=[2], sh=[[[1, 1, 1]]])
        self.refused(pags.Scene(**one).save, "path", 5)
        for named, value in [
            ("alpha_min", NAN),
            ("alpha_min", "a"),
            ("background", (0, NAN, 0)),
            ("origin", (0, 0, INF)),
            ("up", 5),
            ("antialiased", "no"),
            ("means", [["a", 0, 0]]),
            ("means", [[INF, 0, 0]]),
            ("priorities", [NAN]),
        ]:
            self.refused(pags.Scene, named, **{**one, named: value})


class Seen(ModuleCase):
    """Tests cameras with a lens or a rolling shutter: pictures match the program, and picks and a scene's views use
    them."""

    def both(self, **more):
        png = self.program_draws({**camera(0.0, time=101.0), **more})
        picture = pags.render(self.scene, make_camera(time=101.0, **more), threads=2)
        self.assert_same(png, picture)
        return picture

    def test_as_the_program(self):
        plain = self.both()
        for more in (
            dict(lens=FISHEYE),
            dict(lens={"kind": "equirectangular"}),
            dict(rolling_shutter=ROLLING),
            dict(lens=FISHEYE, rolling_shutter=ROLLING),
        ):
            self.assertNotEqual(bytes(memoryview(self.both(**more).rgba)), bytes(memoryview(plain.rgba)), more)
        for more in (
            dict(lens=None, rolling_shutter=None),
            dict(lens={"kind": "perspective"}),
            dict(rolling_shutter={**ROLLING, "seconds": 0}),
        ):
            self.assertEqual(
                bytes(memoryview(self.both(**{k: v for k, v in more.items() if v}).rgba)), bytes(memoryview(plain.rgba))
            )
            self.assertEqual(
                bytes(memoryview(pags.render(self.scene, make_camera(time=101.0, **more)).rgba)),
                bytes(memoryview(plain.rgba)),
            )

    def test_views(self):
        facts = json.loads(read(self.path("scene", "scene.json")))
        facts["cameras"][0]["lens"], facts["cameras"][1]["rolling_shutter"] = FISHEYE, ROLLING
        shutil.copytree(self.path("scene"), self.path("wide"))
        write(self.path("wide", "scene.json"), json.dumps(facts))
        scene = pags.load(self.path("wide"))
        wide, rolling, plain = scene.views[:3]
        self.assertEqual(
            (wide["lens"]["kind"], wide["lens"]["field"], list(wide["lens"]["k"])), ("fisheye", 200, FISHEYE["k"])
        )
        self.assertEqual(
            {**rolling["rolling_shutter"], "velocity": list(rolling["rolling_shutter"]["velocity"])}, ROLLING
        )
        self.assertFalse({"lens", "rolling_shutter"} & set(plain))
        self.succeeds("render", self.path("wide"), "--split", "all", "-o", self.path("all"))
        self.assertEqual(len(pags.render(scene, scene.views)), len(scene.views))
        names = sorted(name for name in os.listdir(self.path("all")) if name.endswith(".png"))
        for name, view in zip(names, (wide, rolling, plain)):
            self.assert_same(
                fixtures.read_png(self.path("all", name)),
                pags.render(scene, view, exposure=[*view["gain"], *view["offset"]]),
            )

    def test_pick(self):
        """A pick at a pixel gives the visible Gaussian and the picture's depth."""
        for more in (
            dict(lens=FISHEYE),
            dict(lens={"kind": "fisheye", "k": [0.2, 0, 0, 0, 0, 0]}),
            dict(rolling_shutter=ROLLING),
        ):
            view = make_camera(time=101.0, **more)
            picture = pags.render(self.scene, view, outputs=("id", "depth"))
            ids = memoryview(picture.id).tolist()
            # Gaussian 2 is the car
            shown = [(x, y) for y, row in enumerate(ids) for x, number in enumerate(row) if number == 2]
            x, y = (sorted(along)[len(along) // 2] for along in zip(*shown))
            picked = pags.pick(self.scene, view, x, y)
            self.assertEqual((picked["id"], picked["object"]), (2, 1), more)
            self.assertAlmostEqual(picked["depth"], pixel(picture.depth, x, y, 1)[0], delta=0.1)
            self.assertLess(math.dist(picked["point"], (ORIGIN[0] + 10, ORIGIN[1], ORIGIN[2])), 0.3, more)
        self.assertIsNone(
            pags.pick(self.scene, make_camera(lens={"kind": "fisheye", "field": 20}), 0, 0), "beyond what the lens sees"
        )


if __name__ == "__main__":
    fixtures.main()
