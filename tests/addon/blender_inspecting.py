# SPDX-License-Identifier: Apache-2.0
"""Tests the add-on in Blender without a window: picks and comparisons with photographs."""

import errno
import os
import sys
from unittest import mock

import bpy

HERE = os.path.dirname(os.path.abspath(__file__))
sys.path[:0] = [HERE, os.path.join(HERE, "..", "cli")]
import fixtures  # noqa: E402
from blender_case import BlenderCase, addon, json, main  # noqa: E402
from test_drive import make_drive  # noqa: E402


class Inspecting(BlenderCase):
    def test_pick(self):
        self.bring_in()
        self.scene.frame_set(2)
        inspector = sys.modules[addon.__name__ + ".inspector"]
        lens = sys.modules[addon.__name__ + ".lens"]
        camera = self.scene.camera
        values, pose = lens.of_camera(camera.data, camera.matrix_world, 101, 101)
        found = inspector.pick(bpy.context, values, pose, 50, 50)
        self.assertEqual((found["object"], found["record"]["class"], found["priority"]), (1, "Car", 1.0))
        self.assertAlmostEqual(found["depth"], 9, delta=0.2)
        inspector.select(bpy.context, found)
        self.assertEqual(bpy.context.view_layer.objects.active, self.part(1))
        self.assertIsNone(inspector.pick(bpy.context, values, pose, 90, 90))

    def test_compare_with_the_photograph(self):
        self.succeeds("render", self.path("scene"), "--split", "all", "-o", self.path("set", "images"), "--no-exposure")
        record = json.loads(fixtures.read(self.path("scene", "scene.json")))
        record["dataset"] = self.path("set")
        for view in record["cameras"]:
            view["name"] = view["name"].replace(".jpg", ".png")
        self.write("scene/scene.json", json.dumps(record))
        self.bring_in()
        bpy.ops.pags.compare(name="001_0.png", use_exposure=False)
        self.assertRegex(self.scene.pags_compared, r"001_0\.png: PSNR [5-9]\d\.")
        self.assertEqual(tuple(bpy.data.images["PAGS comparison"].size), (101, 101))
        image = bpy.data.images["PAGS comparison"]
        photograph, picture = image.pixels[:][4 * (101 * 50 + 10) :][:3], image.pixels[:][4 * (101 * 50 + 90) :][:3]
        self.scene.pags.wipe = 0  # the edge moves at once
        self.assertEqual(image.pixels[:][4 * (101 * 50 + 90) :][:3], picture)
        self.assertNotEqual(image.pixels[:][4 * (101 * 50 + 50) :][:3], [1, 1, 1])
        self.scene.pags.wipe = 1
        self.assertEqual(image.pixels[:][4 * (101 * 50 + 10) :][:3], photograph)
        bpy.ops.pags.compare(name="001_0.png")  # this picture has an exposure factor of 1.1
        self.assertRegex(self.scene.pags_compared, r"PSNR [123]\d\.")
        bpy.ops.pags.photographs()
        background = self.scene.camera.data.background_images[0]
        self.assertEqual((background.image.source, background.image_user.frame_duration), ("SEQUENCE", 3))
        os.remove(self.path("set", "images", "001_0.png"))
        self.raises(["001_0.png"], bpy.ops.pags.compare, name="001_0.png")

    def test_photograph_of_linear_light(self):
        """The linear light of an EXR photograph becomes display values, as in training."""
        undistort = sys.modules[addon.__name__ + ".undistort"]
        image = bpy.data.images.new("light", 4, 4, float_buffer=True)
        image.colorspace_settings.name = "Non-Color"
        image.pixels.foreach_set([0.0331, 0.2159, 4.0, 1] * 16)
        image.file_format, image.filepath_raw = "OPEN_EXR", self.path("light.exr")
        image.save()
        for value, wanted in zip(undistort.read(self.path("light.exr"))[1, 2], (51, 128, 255)):
            self.assertAlmostEqual(255 * value, wanted, delta=0.5)

    def photographed(self, distorted=False):
        """Imports the scene with rendered pictures as its photographs."""
        self.succeeds("render", self.path("scene"), "--split", "all", "-o", self.path("set", "images"), "--no-exposure")
        record = json.loads(fixtures.read(self.path("scene", "scene.json")))
        record["dataset"] = self.path("set")
        for view in record["cameras"]:
            view["name"] = view["name"].replace(".jpg", ".png")
        self.write("scene/scene.json", json.dumps(record))
        if distorted:
            self.write("set/intrinsics/0.txt", "\n".join(map(str, [100, 100, 50.5, 50.5, -0.1, 0, 0, 0, 0])))
        self.scene.render.fps = 2
        self.bring_in(use_rate="NO")  # each photograph lasts two frames of the timeline

    def background(self):
        """Returns a function that gives the path of the photograph shown behind the scene's camera at a frame."""
        image = self.scene.camera.data.background_images[-1].image
        return lambda frame: bpy.path.abspath(image.filepath).replace("00001", f"{frame:05d}")

    def test_photographs_where_links_cannot_be_made(self):
        for distorted in (False, True):
            with self.subTest(distorted=distorted):
                bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
                make_drive(self.path("scene"))
                self.photographed(distorted)
                photographs = {
                    n: fixtures.read(self.path("set", "images", n)) for n in os.listdir(self.path("set", "images"))
                }
                refused = PermissionError(errno.EPERM, "Operation not permitted")
                with (
                    mock.patch.object(os, "symlink", side_effect=refused),
                    mock.patch.object(os, "link", side_effect=refused),
                ):
                    full = mock.patch("shutil.copyfile", side_effect=OSError(errno.ENOSPC, "No space left on device"))
                    with full:
                        self.raises([".png", "No space left"], bpy.ops.pags.photographs)
                    bpy.ops.pags.photographs()
                path = self.background()
                self.assertEqual([os.path.islink(path(i)) for i in range(1, 6)], [False] * 5)
                self.assertEqual(fixtures.read(path(5)) == photographs["002_0.png"], not distorted)
                # between two photographs, the earlier one is shown
                self.assertEqual(fixtures.read(path(2)), fixtures.read(path(1)))
                self.assertEqual([n for n in os.listdir(os.path.dirname(path(1))) if not n.startswith("0000")], [])
                again = {n: fixtures.read(self.path("set", "images", n)) for n in photographs}
                self.assertEqual(again, photographs)
                if not distorted:
                    self.write("set/images/002_0.png", photographs["001_0.png"])  # the photograph is replaced
                    os.utime(self.path("set", "images", "002_0.png"), (4e9, 4e9))
                    bpy.ops.pags.photographs()
                    self.assertEqual(fixtures.read(path(5)), photographs["001_0.png"])
                os.rename(
                    self.path("set"), self.path(f"before {distorted}")
                )  # A second set has the same names and is older than the files made of the first.
                for name in photographs:
                    self.write(f"set/images/{name}", photographs["002_0.png"])
                    os.utime(self.path("set", "images", name), (1e9, 1e9))
                bpy.ops.pags.photographs()
                self.assertEqual(fixtures.read(self.background()(1)), photographs["002_0.png"])
                # repeated calls add no further pictures
                self.assertEqual(len(self.scene.camera.data.background_images), 1)

    def test_a_scene_of_another_machine(self):
        """A scene from another machine opens completely. Features that need photographs name the folders searched.
        The scene's field "Data set folder" sets it."""
        self.photographed()
        record = json.loads(fixtures.read(self.path("scene", "scene.json")))
        self.write("scene/scene.json", json.dumps({**record, "dataset": "/home/else/recordings/street 7/"}))
        os.rename(self.path("set"), self.path("here"))
        bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
        root = self.bring_in()
        looked = [
            "000_0.png",
            os.path.normpath("/home/else/recordings/street 7"),
            self.path("street 7"),
            "Data set folder",
        ]
        self.raises(looked, bpy.ops.pags.photographs)
        self.raises(["001_0.png", *looked[1:]], bpy.ops.pags.compare, name="001_0.png")
        self.f12()
        os.rename(self.path("here"), self.path("street 7"))  # a set next to the scene is found without that field
        bpy.ops.pags.photographs()
        os.rename(self.path("street 7"), self.path("here"))
        root.pags.dataset = self.path("nowhere")
        self.raises([self.path("nowhere"), *looked], bpy.ops.pags.photographs)
        root.pags.dataset = self.path("here")
        bpy.ops.pags.photographs()
        bpy.ops.pags.compare(name="001_0.png", use_exposure=False)
        self.assertRegex(self.scene.pags_compared, r"001_0\.png: PSNR [5-9]\d\.")
        bpy.ops.pags.save_edited(directory=self.path("edited"))
        self.assertEqual(json.loads(fixtures.read(self.path("edited", "scene.json")))["dataset"], self.path("here"))
        bpy.ops.wm.save_as_mainfile(filepath=self.path("work.blend"))
        bpy.ops.wm.save_mainfile()
        bpy.ops.wm.open_mainfile(filepath=self.path("work.blend"))
        kept = [o.pags.dataset for o in self.scene.objects if o.pags.kind == "ROOT"]
        self.assertIn(self.path("here"), kept)

    def test_links_to_photographs_that_were_moved(self):
        if not self.links_can_be_made():
            self.skipTest("no links can be made here")
        self.photographed()
        bpy.ops.pags.photographs()
        path = self.background()
        self.assertTrue(os.path.islink(path(1)))
        os.remove(path(1))
        os.symlink(self.path("nowhere.png"), path(1))
        bpy.ops.pags.photographs()
        self.assertTrue(os.path.samefile(path(1), self.path("set", "images", "000_0.png")))


if __name__ == "__main__":
    main()
