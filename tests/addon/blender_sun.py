# SPDX-License-Identifier: Apache-2.0
"""Tests the add-on in Blender without a window: the sun of a recording, found by the shadows of parked cars."""

import json
import os
import sys

import bpy
import numpy as np

HERE = os.path.dirname(os.path.abspath(__file__))
sys.path[:0] = [HERE, os.path.join(HERE, "..", "cli")]
import fixtures  # noqa: E402
from blender_case import BlenderCase, addon, main  # noqa: E402
from fixtures import splat  # noqa: E402
from test_drive import ORIGIN, make_drive, with_object_id  # noqa: E402

SUN = np.array([-0.42, 0.5, 0.757]) / np.linalg.norm([-0.42, 0.5, 0.757])
CARS = [(-5, -4), (1, 5), (6, -1)]
SIZE = np.array([4.0, 2.0, 1.5])
SKY, LIGHT, GREY = 0.5, 1.2, 0.2  # linear light of the sky and the sun, and the road's reflectance


def encoded(linear):
    return 1.055 * linear ** (1 / 2.4) - 0.055


class Sun(BlenderCase):
    def street(self, sunny):
        """Writes a grey road with three parked cars, seen from above, in the sun or under an overcast sky."""
        make_drive(self.path("scene"))
        grid = np.stack(np.meshgrid(*[np.arange(-11, 11, 0.2)] * 2), axis=-1).reshape(-1, 2)
        light = np.where(self.shaded(grid), 0, LIGHT * SUN[2]) if sunny else np.zeros(len(grid))
        colors = encoded(GREY * (SKY + light))
        rows = [splat(x, y, 0, (c,) * 3, sigma=0.12, opacity=6.0) for (x, y), c in zip(grid, colors)]
        ids = [-1] * len(rows)
        inner = SIZE - [0.3, 0.3, 0]  # the Gaussians' centres lie within the surface
        side = [np.arange(-s / 2, s / 2 + 0.01, s / round(s / 0.2)) for s in inner]
        box = np.stack(np.meshgrid(*side, indexing="ij"), axis=-1).reshape(-1, 3)
        box = box[(np.abs(np.abs(box) - inner / 2) < 0.01).any(axis=1)] - [0, 0, 0.15]
        for number, car in enumerate(CARS):
            rows += [splat(*(p + [*car, SIZE[2] / 2]), (0.3, 0.3, 0.6), sigma=0.12, opacity=6.0) for p in box]
            ids += [number] * len(box)
        fixtures.write(self.path("scene", "background.ply"), with_object_id(rows, ids))
        scene = json.loads(fixtures.read(self.path("scene", "scene.json")))
        parked = scene["objects"][0]
        scene["models"] = [{**scene["models"][0], "gaussians": len(rows)}]
        scene["objects"] = []
        for number, (x, y) in enumerate(CARS):
            at = [ORIGIN[0] + x, ORIGIN[1] + y, ORIGIN[2] + SIZE[2] / 2]
            pose = [1, 0, 0, at[0], 0, 1, 0, at[1], 0, 0, 1, at[2]]
            knots = [{**parked["knots"][0], "world_from_object": pose}]
            scene["objects"].append({**parked, "id": f"p{number}", "size": SIZE.tolist(), "knots": knots})
        down = {"camera_from_world_quaternion_wxyz": [0, 1, 0, 0], "width": 440, "height": 440}
        down["camera_from_world_translation"] = [-ORIGIN[0], ORIGIN[1], ORIGIN[2] + 14]
        down |= {"fx": 280.0, "fy": 280.0, "cx": 220.0, "cy": 220.0}
        scene["cameras"] = [{**scene["cameras"][0], **down}]
        del scene["modelled"]
        fixtures.write(self.path("scene", "scene.json"), json.dumps(scene))

    def shaded(self, places):
        """Which points (n, 2) of the road are below a car or in its shadow."""
        out = np.zeros(len(places), dtype=bool)
        for height in np.arange(0, SIZE[2] + 0.01, 0.1):
            for car in CARS:
                out |= (np.abs(places + SUN[:2] / SUN[2] * height - car) <= SIZE[:2] / 2).all(axis=1)
        return out

    def test_a_sun_by_the_shadows_of_cars(self):
        """Direction within 5 degrees and strength within 20 %; the composite's lamp shines from there."""
        self.street(sunny=True)
        self.bring_in()
        sun, native = (sys.modules[f"{addon.__name__}.{name}"] for name in ("sun", "native"))
        towards, color = sun.estimate(native.load(self.path("scene")), 1)
        self.assertLess(np.degrees(np.arccos(min(1, towards @ SUN))), 5)
        self.assertGreater(color.min(), 0)
        if hasattr(bpy.types.Scene, "cycles"):
            bpy.ops.pags.composite(engine="CYCLES")
            lamp = bpy.data.objects["PAGS sun"]
            bpy.context.view_layer.update()
            self.assertLess(np.degrees(np.arccos(min(1, np.array(lamp.matrix_world)[:3, 2] @ SUN))), 5)
            bpy.ops.pags.remove_composite()
            self.assertNotIn("PAGS sun", bpy.data.objects)

    def test_no_sun_without_shadows(self):
        """Under an overcast sky, and without parked cars, no sun is made up."""
        self.street(sunny=False)
        self.bring_in()
        sun, native = (sys.modules[f"{addon.__name__}.{name}"] for name in ("sun", "native"))
        with self.assertRaisesRegex(native.SceneError, "no sun visible: the road"):
            sun.estimate(native.load(self.path("scene")), 1)
        make_drive(self.path("other"))
        with self.assertRaisesRegex(native.SceneError, "no sun visible: there are no parked"):
            sun.estimate(native.load(self.path("other")), 1)


if __name__ == "__main__":
    main()
