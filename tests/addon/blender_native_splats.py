# SPDX-License-Identifier: Apache-2.0
"""Tests the add-on in Blender without a window: conversion into Blender's native splats."""

import math
import os
import random
import struct
import sys

import bpy
import numpy as np
from mathutils import Vector

HERE = os.path.dirname(os.path.abspath(__file__))
sys.path[:0] = [HERE, os.path.join(HERE, "..", "cli")]
from blender_case import BlenderCase, addon, main  # noqa: E402
from fixtures import read  # noqa: E402


def ply_with_harmonics(count, degree, seed=5):
    """Returns the bytes of a PLY in INRIA's layout with harmonics."""
    dice = random.Random(seed)
    rest = 3 * ((degree + 1) ** 2 - 1)
    names = ["x", "y", "z", "f_dc_0", "f_dc_1", "f_dc_2", *(f"f_rest_{k}" for k in range(rest)), "opacity"]
    names += ["scale_0", "scale_1", "scale_2", "rot_0", "rot_1", "rot_2", "rot_3"]
    rows = [
        [dice.uniform(-1, 1) for _ in names[:-7]]
        + [dice.uniform(-4, -2) for _ in range(3)]
        + [dice.uniform(0.1, 1) for _ in range(4)]
        for _ in range(count)
    ]
    header = [
        "ply",
        "format binary_little_endian 1.0",
        f"element vertex {count}",
        *(f"property float {n}" for n in names),
        "end_header",
        "",
    ]
    return "\n".join(header).encode() + b"".join(struct.pack(f"<{len(names)}f", *row) for row in rows)


class NativeSplats(BlenderCase):
    """Compares the conversion into native splats with Blender's importer on the same files."""

    KEYS = {"FLOAT_VECTOR": ("vector", 3), "FLOAT4": ("vector", 4), "QUATERNION": ("value", 4), "FLOAT": ("value", 1)}

    def setUp(self):
        super().setUp()
        self.module = sys.modules[addon.__name__ + ".native_splats"]
        self.too_old = self.module.missing()

    def layers(self, cloud):
        """Returns the attributes of a point cloud: type and values by name."""
        found = {}
        for layer in cloud.attributes:
            if layer.data_type not in self.KEYS or layer.name == "radius":
                continue
            key, width = self.KEYS[layer.data_type]
            values = np.zeros((len(cloud.points), width), np.float32)
            layer.data.foreach_get(key, values.reshape(-1))
            found[layer.name] = layer.data_type, values
        return found

    def blender_reads(self, path):
        bpy.ops.wm.ply_import(filepath=path)
        return self.layers(bpy.context.view_layer.objects.active.data)

    def assert_same(self, got, wanted):
        """Checks that both have the same points in any order, up to rounding errors of exp and division in float."""
        self.assertEqual({n: v[0] for n, v in got.items()}, {n: v[0] for n, v in wanted.items()})
        rows = [np.concatenate([layers[name][1] for name in sorted(wanted)], axis=1) for layers in (got, wanted)]
        a, b = (r[np.lexsort(np.round(r[:, :3], 4).T)] for r in rows)
        self.assertEqual(a.shape, b.shape)
        self.assertLess(np.abs(a - b).max(), 1e-5)

    def test_attributes(self):
        """The attributes have the right names, types and values in any version of Blender."""
        from_module = sys.modules[addon.__name__ + ".native"].module
        path = self.write("harmonics.ply", ply_with_harmonics(50, 2))
        found = self.module.attributes(
            {name: np.asarray(values) for name, values in from_module.load(path).arrays().items()}
        )
        self.assertEqual(
            [f[0] for f in found],
            ["position", "scale", "rotation", "radiance:base", *(f"radiance:sh_{k}" for k in range(8))],
        )
        self.assertEqual(
            [f[1] for f in found], ["FLOAT_VECTOR", "FLOAT_VECTOR", "QUATERNION", "FLOAT4", *["FLOAT_VECTOR"] * 8]
        )
        values = {f[0]: f[3] for f in found}
        self.assertLess(np.abs(np.linalg.norm(values["rotation"], axis=1) - 1).max(), 1e-6)
        self.assertTrue((values["radiance:base"][:, 3] > 0).all() and (values["radiance:base"][:, 3] < 1).all())
        self.assertTrue((values["scale"] > 0).all())
        # The expected values of the first row come from the file.
        body = read(path).split(b"end_header\n")[1]
        first = np.frombuffer(body, np.float32).reshape(50, -1)[0]
        at = int(np.argmin(np.abs(values["position"] - first[:3]).sum(axis=1)))
        self.assertLess(np.abs(values["radiance:base"][at, :3] - first[3:6]).max(), 1e-6)
        self.assertLess(np.abs(values["radiance:sh_1"][at] - first[[7, 15, 23]]).max(), 1e-6)
        self.assertAlmostEqual(float(values["scale"][at, 2]), math.exp(first[6 + 24 + 1 + 2]), places=6)

    def test_frames(self):
        """An object's Gaussians and its sample of points have the same places in the object's frame, in any version
        of Blender."""
        entry = sys.modules[addon.__name__ + ".native"].load(self.path("scene"))
        means, owner = np.asarray(entry.scene.arrays()["means"]), np.asarray(entry.scene.object_of)
        for index in (-1, 0, 1):
            frame = np.array(self.module.frame_of(entry, index))
            moved = means[owner == index] @ frame[:3, :3].T + frame[:3, 3]
            wanted = np.asarray(entry.scene.points(index, 9)[0])
            self.assertEqual(moved.shape, wanted.shape)
            self.assertLess(np.abs(moved - wanted).max(), 1e-5)

    def test_too_old(self):
        if not self.too_old:
            self.skipTest("this Blender has splats of its own")
        self.bring_in()
        self.assertFalse(bpy.ops.pags.native_splats.poll())
        self.assertIn("5.3", self.too_old)
        self.raises(["5.3"], bpy.ops.pags.native_splats)

    def test_splat_file(self):
        if self.too_old:
            self.skipTest(self.too_old)
        for degree in (0, 1, 3):
            path = self.write(f"degree{degree}.ply", ply_with_harmonics(200, degree))
            self.bring_in(path)
            root = self.scene.objects[f"degree{degree}.ply"]
            bpy.context.view_layer.objects.active = root
            self.assertEqual(bpy.ops.pags.native_splats(), {"FINISHED"})
            (converted,) = [o for o in self.scene.objects if self.module.MARK in o and o.pags.root == root]
            self.assertEqual(converted.data.type, "GAUSSIAN_SPLAT")
            self.assert_same(self.layers(converted.data), self.blender_reads(path))

    def test_drive(self):
        """Each object becomes a point cloud with the object's pose at every time. A second conversion replaces the
        first."""
        if self.too_old:
            self.skipTest(self.too_old)
        root = self.bring_in()
        for _ in range(2):
            self.assertEqual(bpy.ops.pags.native_splats(), {"FINISHED"})
        converted = {o[self.module.MARK]: o for o in self.scene.objects if self.module.MARK in o}
        self.assertEqual(len([o for o in self.scene.objects if self.module.MARK in o]), 3)
        self.assertEqual(len(bpy.data.pointclouds), 3)
        car, parked = self.part(1), self.part(0)
        self.assertEqual(converted[car.name].parent, self.track(1))
        self.assertEqual(converted["background"].parent, root)
        self.assert_same(
            self.layers(converted[car.name].data), self.blender_reads(self.path("scene", "objects", "car.ply"))
        )
        loaded = sys.modules[addon.__name__ + ".native"].load(self.path("scene")).scene
        root.rotation_euler = (0, 0, 0.3)
        for frame in (1, 2, 3):
            self.scene.frame_set(frame)
            for part, index in ((car, 1), (parked, 0)):
                points = np.asarray(loaded.points(index, 9)[0])
                wanted = [part.matrix_world @ Vector(p) for p in points.tolist()]
                cloud = converted[part.name]
                got = [cloud.matrix_world @ point.co for point in cloud.data.points]
                for a, b in zip(got, wanted):
                    self.assertLess((a - b).length, 1e-4)
            self.assertEqual(
                converted[car.name].evaluated_get(bpy.context.evaluated_depsgraph_get()).hide_render, car.hide_render
            )
        car.animation_data_clear()
        car.hide_render = True
        self.scene.frame_set(2)
        self.assertTrue(converted[car.name].evaluated_get(bpy.context.evaluated_depsgraph_get()).hide_render)


if __name__ == "__main__":
    main()
