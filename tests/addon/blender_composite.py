# SPDX-License-Identifier: Apache-2.0
"""Tests the add-on in Blender without a window: meshes combined with the street."""

import os
import sys

import bpy

HERE = os.path.dirname(os.path.abspath(__file__))
sys.path[:0] = [HERE, os.path.join(HERE, "..", "cli")]
from blender_case import BlenderCase, addon, main, pixel  # noqa: E402
from fixtures import splat  # noqa: E402
from test_drive import make_drive  # noqa: E402


class Composite(BlenderCase):
    def test_a_cube_in_the_street(self):
        """Draws a cube in front of the parked car, then behind it with the sky in the background."""
        self.bring_in()
        self.scene.frame_set(2)
        names = {item.identifier for item in bpy.types.RenderSettings.bl_rna.properties["engine"].enum_items}
        if "CYCLES" not in names and not hasattr(bpy.types.Scene, "cycles"):
            self.skipTest("this Blender has no Cycles")
        street = self.f12()
        bpy.ops.mesh.primitive_cube_add(size=0.5, location=(7, 1.2, 0))
        cube = bpy.context.object
        material = bpy.data.materials.new("blue")
        material.use_nodes = True
        material.node_tree.nodes.clear()
        glow, out = (
            material.node_tree.nodes.new("ShaderNodeEmission"),
            material.node_tree.nodes.new("ShaderNodeOutputMaterial"),
        )
        glow.inputs[0].default_value = (0, 1, 1, 1)
        material.node_tree.links.new(glow.outputs[0], out.inputs[0])
        cube.data.materials.append(material)
        bpy.ops.pags.composite(engine="CYCLES", tolerance=0.3)
        self.scene.cycles.samples = 4
        picture = self.f12()
        self.assertEqual(pixel(picture, 50, 50), pixel(street, 50, 50))  # the car is unchanged
        x, y = 50 - int(1.2 / 6 * 100), 50
        self.assertGreater(min(pixel(picture, x, y)[1:]), 200)  # the cube is visible
        self.assertLess(pixel(picture, x, y)[0], 60)
        cube.location = (16, 1.2 * 15 / 6, 0)  # the cube is now behind the parked car
        cube.scale = (3, 3, 3)
        behind = self.f12()
        self.assertLess(abs(pixel(behind, 35, 50)[1] - pixel(street, 35, 50)[1]), 12)

    def test_removed_composite(self):
        """Removing a composite brings back the street's picture, the render settings, nodes, light and objects."""
        composite = sys.modules[addon.__name__ + ".composite"]
        self.bring_in()
        self.scene.frame_set(2)
        if not hasattr(bpy.types.Scene, "cycles"):
            self.skipTest("this Blender has no Cycles")
        self.assertFalse(bpy.ops.pags.remove_composite.poll())
        before, world, names = self.f12(), self.scene.world, {o.name for o in bpy.data.objects}
        for engine in ("CYCLES", "EEVEE"):
            bpy.ops.pags.composite(engine=engine)
        self.assertIn(composite.SECOND, bpy.data.scenes)
        self.assertEqual(bpy.ops.pags.remove_composite(), {"FINISHED"})
        self.assertEqual({o.name for o in bpy.data.objects}, names)
        self.assertEqual((self.scene.world, self.scene.render.engine, len(bpy.data.scenes)), (world, "PAGS", 1))
        self.assertFalse(self.scene.cycles.is_property_set("samples"))
        self.assertFalse(self.scene.render.film_transparent or bpy.context.view_layer.use_pass_z)
        self.assertEqual(self.f12(), before)

    def pave(self):
        """Adds a road of Gaussians, 1.6 m below the cameras."""
        rows = []
        for x in range(60):
            for y in range(-20, 21):
                flat = splat(3 + 0.2 * x, 0.2 * y, -1.6, (0.1, 0.1, 0.5), sigma=0.15, opacity=12.0)
                flat[12] = -5.0  # the third scale is a few millimetres
                rows.append(flat)
        make_drive(self.path("scene"), rows)

    def test_shadow_on_the_road(self):
        """A block above the road casts a shadow under a sun straight above. The street around the shadow stays
        unchanged."""
        self.pave()
        self.bring_in()
        self.scene.frame_set(2)
        if not hasattr(bpy.types.Scene, "cycles"):
            self.skipTest("this Blender has no Cycles")
        street = self.f12()
        bpy.ops.object.light_add(type="SUN")
        bpy.context.object.data.energy = 5
        bpy.ops.mesh.primitive_cube_add(size=1, location=(8, -1.5, 0))
        block = bpy.context.object
        bpy.ops.pags.composite(engine="CYCLES", use_light=False)
        self.scene.cycles.samples = 4
        picture = self.f12()
        below, beside = (
            (72, 73),
            (30, 73),
        )  # The road is 1.6 m below the cameras; the block is 7 m ahead and 1.5 m to the right.
        self.assertGreater(pixel(street, *below)[2], 120)
        self.assertLess(pixel(picture, *below)[2], 80)
        self.assertLess(abs(pixel(picture, *beside)[2] - pixel(street, *beside)[2]), 10)
        road = next(o for o in self.scene.objects if o.get("pags_catcher") == "road")
        shade = road.material_slots[0].material.node_tree.nodes["Principled BSDF"].inputs["Base Color"]
        self.assertLess(shade.default_value[0], 0.3)  # the light that a white road sends up bleaches meshes
        # A plane 15 cm too low lies 0.7 m behind the road's Gaussians along the ray; the shadow still has no hole.
        road = next(o for o in self.scene.objects if o.get("pags_catcher") == "road")
        road.location.z -= 0.15
        self.assertLess(pixel(self.f12(), 71, 75)[2], 80)
        # A plane metres behind the visible street gets its shadow there, too; the street hides that shadow.
        road.location.z -= 2
        block.location, block.scale = (15, -3, 1), (4, 4, 1)
        self.assertLess(abs(pixel(self.f12(), 71, 75)[2] - pixel(street, 71, 75)[2]), 10)

    def test_default_settings(self):
        """By default, F12 uses a limited number of samples and the recording's sky as light. A user's number of
        samples is kept."""
        self.bring_in()
        self.scene.frame_set(2)
        if not hasattr(bpy.types.Scene, "cycles"):
            self.skipTest("this Blender has no Cycles")
        bpy.ops.mesh.primitive_uv_sphere_add(radius=0.8, location=(7, 1.2, 0))
        before = self.scene.world
        bpy.ops.pags.composite()
        self.scene.render.resolution_percentage = 40  # The size set in the second scene now differs, but has no effect.
        self.assertIn(self.scene.cycles.samples, (64, 128))
        picture = self.f12()
        ball = pixel(picture, int((50 - 1.2 / 6 * 100) * 0.4), 20)
        self.assertGreater(ball[2], ball[0] + 30)  # the white ball is lit by a blue sky
        self.assertGreater(pixel(picture, 20, 20)[0], 100)  # the street's red car, a few pixels wide
        self.assertTrue(before is None or before.use_fake_user)
        self.scene.cycles.samples = 3
        bpy.ops.pags.composite()
        self.assertEqual(self.scene.cycles.samples, 3)

    def test_direction_of_the_light(self):
        """After the scene is turned, the light's panorama shows a red wall in the direction where Blender's world
        has it."""
        make_drive(
            self.path("scene"),
            [splat(x, 6, z, (1, 0, 0), sigma=0.5, opacity=12.0) for x in range(-4, 5) for z in range(-2, 3)],
        )
        root = self.bring_in()
        root.rotation_euler.z = -1.5707963  # the y axis (left) now points ahead (x)
        bpy.context.view_layer.update()
        bpy.ops.pags.composite(engine="EEVEE")
        image = bpy.data.images[sys.modules[addon.__name__ + ".light"].LIGHT]
        width, height = image.size
        pixels = image.pixels[:]
        at = lambda x, y: pixels[4 * (int(y * height) * width + int(x * width)) :][:3]
        # In Cycles, the x axis is in the middle of an equirectangular picture and the z axis at its top.
        red, sky = at(0.5, 0.5), at(0.5, 0.95)
        self.assertGreater(red[0], 0.8)
        self.assertLess(red[2], 0.1)
        for seen in (sky, at(0.01, 0.5)):
            self.assertAlmostEqual(seen[0], 0, delta=0.01)
            self.assertAlmostEqual(seen[2], 0.2140, delta=0.01)  # linear value of sRGB 0.5

    def test_nodes_of_the_user_stay(self):
        """The user's nodes between Render Layers and the output stay. The composite replaces their input, also when
        repeated."""
        composite = sys.modules[addon.__name__ + ".composite"]
        self.bring_in()
        scene = self.scene
        tree = composite.node_tree(scene)
        out = composite.output_of(tree, scene)
        layers = next((n for n in tree.nodes if n.bl_idname == "CompositorNodeRLayers"), None) or tree.nodes.new(
            "CompositorNodeRLayers"
        )
        layers.scene = scene
        invert = tree.nodes.new("CompositorNodeInvert")
        invert.name = "mine"
        color = lambda node: next(i for i in node.inputs if i.name == "Color")
        tree.links.new(layers.outputs["Image"], color(invert))
        tree.links.new(invert.outputs[0], out.inputs[0])
        other = tree.nodes.new("CompositorNodeViewer")
        tree.links.new(layers.outputs["Image"], other.inputs[0])
        for _ in range(2):
            bpy.ops.pags.composite(engine="EEVEE")
            mine = [n for n in tree.nodes if composite.MINE in n]
            self.assertEqual(len([n for n in tree.nodes if n not in mine]), 4)
            self.assertEqual(len([n for n in mine if n.bl_idname == "CompositorNodeRLayers"]), 2)
            self.assertEqual(out.inputs[0].links[0].from_node.name, "mine")
            for socket in (color(tree.nodes["mine"]), other.inputs[0]):
                self.assertIn(composite.MINE, socket.links[0].from_node)
        image = tree.nodes.new("CompositorNodeImage")
        tree.links.new(image.outputs[0], out.inputs[0])
        tree.links.new(image.outputs[0], color(tree.nodes["mine"]))
        tree.links.new(image.outputs[0], other.inputs[0])
        self.assertFalse(
            composite.build_nodes(scene, bpy.data.scenes[composite.SECOND], bpy.context.view_layer.name, 0.3)
        )


if __name__ == "__main__":
    main()
