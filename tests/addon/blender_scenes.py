# SPDX-License-Identifier: Apache-2.0
"""Tests the add-on in Blender without a window: several scenes in one frame."""

import math
import os
import random
import struct
import sys

import bpy
from mathutils import Matrix

HERE = os.path.dirname(os.path.abspath(__file__))
sys.path[:0] = [HERE, os.path.join(HERE, "..", "cli")]
from blender_case import BlenderCase, addon, main, pixel  # noqa: E402
from fixtures import ply_bytes, some_splats, splat  # noqa: E402


def pose_rows(m):
    return [[m[i][k] for k in range(3)] for i in range(3)], [m[i][3] for i in range(3)]


class SeveralScenes(BlenderCase):
    def merged(self, rows, *instances):
        """Writes several instances of round Gaussians into one file. Each instance is (scale, 3 x 3 rotation,
        place)."""
        out = []
        for scale, turn, place in instances:
            for r in rows:
                at = [scale * sum(turn[i][k] * r[k] for k in range(3)) + place[i] for i in range(3)]
                out.append([*at, *r[3:10], *(v + math.log(scale) for v in r[10:13]), *r[13:]])
        self.write("merged.ply", ply_bytes(out))

    def splats_before_a_camera(self, count=1):
        self.write("some.ply", ply_bytes(some_splats()))
        bpy.ops.object.camera_add(location=(0.5, -4, 0), rotation=(1.5707963, 0, 0))
        self.scene.camera = bpy.context.object
        self.scene.camera.name = "mine"  # differs from the start-up file's camera
        self.scene.render.resolution_x, self.scene.render.resolution_y = 96, 64
        return [self.bring_in("some.ply") for _ in range(count)]

    def test_scaled_and_turned_second_scene(self):
        """Two scenes in one frame are sorted together by depth, as the program draws one file with both."""
        first, second = self.splats_before_a_camera(2)
        self.assertNotEqual(first.name, second.name)
        second.scale = (0.5, 0.5, 0.5)
        second.rotation_euler = (0.3, 0.4, 0.5)
        second.location = (0.6, 0.2, 0.1)
        together = self.f12()
        relative = first.matrix_world.inverted() @ second.matrix_world
        turn, place = pose_rows(relative)
        self.merged(
            some_splats(),
            (1, [[1, 0, 0], [0, 1, 0], [0, 0, 1]], [0, 0, 0]),
            (0.5, [[2 * v for v in row] for row in turn], place),
        )
        bpy.context.view_layer.objects.active = first
        self.assert_close(together, self.program(scene="merged.ply"))
        second.hide_viewport = second.hide_render = True
        for part in second.children:
            part.hide_render = True
        self.assertGreater(self.difference(together, self.f12()), 100)

    def test_scenes_of_one_map(self):
        """Splat files with map coordinates and different origins keep their distances on the map. Other files lie at
        zero."""
        names = [
            "f_dc_0",
            "f_dc_1",
            "f_dc_2",
            "opacity",
            "scale_0",
            "scale_1",
            "scale_2",
            "rot_0",
            "rot_1",
            "rot_2",
            "rot_3",
        ]
        head = "".join(f"property double {k}\n" for k in "xyz") + "".join(f"property float {k}\n" for k in names)

        def far(name, x, y):
            row = struct.pack("<3d11f", x, y, 0.5, 1, 0, 0, 3, -2, -2, -2, 1, 0, 0, 0)
            self.write(
                name, f"ply\nformat binary_little_endian 1.0\nelement vertex 1\n{head}end_header\n".encode() + row
            )
            return self.bring_in(name)

        roots = [far("a.ply", 500000.25, 4600000.5), far("b.ply", 500040.5, 4599990.25), far("c.ply", 900000, 4600000)]
        self.write("some.ply", ply_bytes(some_splats()))
        roots.append(self.bring_in("some.ply"))
        places = [
            root.matrix_world @ next(p for p in root.children if p.type == "MESH").data.vertices[0].co
            for root in roots[:3]
        ]
        apart = places[1] - places[0]  # the y axis points down in the files
        for found, wanted in zip(apart, (40.25, 0, 10.25)):
            self.assertAlmostEqual(found, wanted, places=4)
        for root in (roots[0], *roots[2:]):
            self.assertEqual(tuple(root.location), (0, 0, 0))

    def test_duplicates_and_instances(self):
        """A duplicated scene has a separate root. An instance of the scene's collection is drawn at the instance's
        pose."""
        (root,) = self.splats_before_a_camera()
        alone = self.f12()
        for other in bpy.context.selected_objects:
            other.select_set(False)
        for block in (root, self.part(-1)):
            block.select_set(True)
        bpy.ops.object.duplicate()
        twin = next(o for o in self.scene.objects if o.pags.kind == "ROOT" and o != root)
        child = next(o for o in self.scene.objects if o.pags.kind == "BACKGROUND" and o.parent == twin)
        self.assertEqual(child.pags.root, twin)
        twin.location.x += 0.8
        twin.scale = (0.5, 0.5, 0.5)
        doubled = self.f12()
        self.assertGreater(self.difference(alone, doubled), 100)
        bpy.data.objects.remove(child)
        bpy.data.objects.remove(twin)
        self.assertEqual(self.f12()[4], alone[4])
        instance = bpy.data.objects.new("instance", None)
        instance.instance_type, instance.instance_collection = "COLLECTION", root.users_collection[0]
        instance.location.x, instance.scale = 0.8, (0.5, 0.5, 0.5)
        self.scene.collection.objects.link(instance)
        self.assert_close(self.f12(), doubled)

    def test_stretched_and_mirrored(self):
        """A stretched or mirrored scene is drawn exactly: mirroring scene and camera mirrors the picture."""
        (root,) = self.splats_before_a_camera()
        plain = self.f12()
        root.matrix_world = Matrix.Diagonal((-1, 1, 1, 1)) @ root.matrix_world
        self.scene.camera.location.x *= -1
        mirrored = self.f12()
        width, height = plain[:2]
        for y in range(0, height, 3):
            for x in range(width):
                for a, b in zip(pixel(plain, x, y), pixel(mirrored, width - 1 - x, y)):
                    self.assertLessEqual(abs(a - b), 1)
        root.scale.x *= 2
        self.assertGreater(self.difference(mirrored, self.f12()), 50)
        self.scene.camera = next(
            o for o in self.scene.objects if o.pags.kind == "CAMERA"
        )  # This camera is a child of the mirrored root and so mirrored, too.
        self.assertGreater(max(self.f12()[4]), 100)

    def test_scaled_objects(self):
        """Draws the driving and the parked car at double size. Flattened objects are left out and named."""
        self.bring_in()
        self.scene.frame_set(2)
        for index, x in ((1, 50), (0, 35)):
            before = sum(pixel(self.f12(), x + k, 50)[1 - index] > 150 for k in range(-6, 7))
            self.part(index).scale = (2, 2, 2)
            if index == 0:  # the Gaussian lies half a metre from the middle of its box
                self.part(index).location.y = -0.5
            self.assertGreater(sum(pixel(self.f12(), x + k, 50)[1 - index] > 150 for k in range(-6, 7)), 1.5 * before)
        self.part(1).scale = (1, 0, 1)
        flat = self.f12()
        self.part(1).scale = (1, 1, 1)
        self.part(1).hide_render = True
        self.assertEqual(flat[4], self.f12()[4])
        gather = sys.modules[f"{addon.__name__}.gather"]
        self.part(1).scale = (1, 0, 1)
        state = gather.gather(bpy.context.evaluated_depsgraph_get())
        self.assertEqual(state.flat, [self.part(1).name])
        self.assertIn(self.part(1).name, state.load(True).remarks(self.scene.pags))

    def test_sky_and_times(self):
        """With a street and splats in one frame, the street provides the sky for any camera. Each scene starts at
        its first frame."""
        street = self.bring_in()
        self.scene.frame_set(2)
        alone = self.f12()
        self.write("some.ply", ply_bytes(some_splats()))
        for other in ("a splat", "z splat"):
            os.rename(self.path("some.ply"), self.path(other + ".ply"))
            splats = self.bring_in(other + ".ply")
            splats.location = (12, 0.2, -2.5)
            both = self.f12()
            self.assertEqual(pixel(both, 90, 10), pixel(alone, 90, 10))
            self.assertGreater(self.difference(both, alone), 100)
            os.rename(self.path(other + ".ply"), self.path("some.ply"))
            for block in (*splats.children, splats):
                bpy.data.objects.remove(block)
        self.scene.frame_start = 2
        twin = self.bring_in()  # the second street starts one second later
        twin.location.z = 1.0
        self.part_of(twin, -1).hide_render = True
        both = self.f12()
        self.assertGreater(pixel(both, 50, 50)[0], 200)  # the pixel shows the first street's car at its second label
        self.assertEqual(street.pags.frame_start, 1)
        self.scene.frame_set(3)
        late = self.f12()
        # the pixel shows the second street's car, a metre higher, 8 m in front of the camera
        self.assertGreater(pixel(late, 50, 50 - 12)[0], 200)

    def part_of(self, root, index):
        return next(
            o
            for o in self.scene.objects
            if o.pags.kind in {"OBJECT", "BACKGROUND"} and o.pags.index == index and o.pags.root == root
        )

    def test_picks_name_the_scene(self):
        first, second = self.splats_before_a_camera(2)
        second.location.x, second.scale = 2.0, (0.5, 0.5, 0.5)
        inspector, lens = (sys.modules[f"{addon.__name__}.{name}"] for name in ("inspector", "lens"))
        bpy.context.view_layer.update()
        values, pose = lens.of_camera(self.scene.camera.data, self.scene.camera.matrix_world, 96, 64)
        seen = {}
        for x in range(0, 96, 4):
            for y in range(0, 64, 4):
                found = inspector.pick(bpy.context, values, pose, x, y)
                if found:
                    seen.setdefault(found["root"], []).append((found, x))
        self.assertEqual(set(seen), {first.name, second.name})
        self.assertGreater(min(x for _, x in seen[second.name]), max(x for _, x in seen[first.name]) - 30)
        found = seen[second.name][0][0]
        self.assertIn(f"background of {second.name}", inspector.describe(found))
        inspector.select(bpy.context, found)
        self.assertEqual(bpy.context.object.pags.root, second)

    def test_two_of_250_000(self):
        """Two copies, one of them halved and turned, match the program's picture of both in one file. PAGS_SCENES
        sets the number of Gaussians (2,000 by default)."""
        count = int(os.environ.get("PAGS_SCENES", "2000"))
        dice = random.Random(5)
        size = 0.35 * count ** (-1 / 3)
        rows = [
            splat(
                *(dice.uniform(-1, 1) for _ in range(3)),
                [dice.random() for _ in range(3)],
                sigma=size,
                opacity=dice.uniform(-2, 3),
            )
            for _ in range(count)
        ]
        self.write("many.ply", ply_bytes(rows))
        bpy.ops.object.camera_add(location=(0.3, -3.5, 0.4), rotation=(1.5, 0, 0))
        self.scene.camera = bpy.context.object
        self.scene.camera.name = "mine"
        first, second = self.bring_in("many.ply"), self.bring_in("many.ply")
        second.scale, second.rotation_euler, second.location = (0.5,) * 3, (0.3, 0.9, -0.4), (0.9, -0.5, 0.6)
        self.scene.render.resolution_x, self.scene.render.resolution_y = (640, 360) if count > 100000 else (160, 90)
        together = self.f12()
        turn, place = pose_rows(first.matrix_world.inverted() @ second.matrix_world)
        self.merged(
            rows,
            (1, [[1, 0, 0], [0, 1, 0], [0, 0, 1]], [0, 0, 0]),
            (0.5, [[2 * v for v in row] for row in turn], place),
        )
        bpy.context.view_layer.objects.active = first
        merged = self.program(scene="merged.ply")
        apart = [abs(a - b) for a, b in zip(together[4], merged[4])]
        print(
            f"two scenes of {count} Gaussians: at most {max(apart)} grey levels apart, {sum(map(bool, apart))} of {len(apart)} samples differ"
        )
        self.assert_close(together, merged)


if __name__ == "__main__":
    main()
