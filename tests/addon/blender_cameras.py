# SPDX-License-Identifier: Apache-2.0
"""Tests the add-on in Blender without a window: cameras and camera paths."""

import os
import stat
import sys
import threading

import bpy

HERE = os.path.dirname(os.path.abspath(__file__))
sys.path[:0] = [HERE, os.path.join(HERE, "..", "cli")]
import fixtures  # noqa: E402
from blender_case import BlenderCase, json, main  # noqa: E402
from fixtures import read_png  # noqa: E402


class Cameras(BlenderCase):
    def test_path_there_and_back(self):
        self.bring_in()
        bpy.ops.export_scene.pags_path(filepath=self.path("path.json"))
        path = json.loads(fixtures.read(self.path("path.json")))
        self.assertEqual([c["time"] for c in path["frames"]], [100.0, 101.0, 102.0])
        self.succeeds("render", self.path("scene"), "--path", self.path("path.json"), "-o", self.path("drive"))
        recorded = self.scene.camera
        bpy.ops.import_scene.pags_path(filepath=self.path("path.json"))
        self.assertIsNot(self.scene.camera, recorded)
        for frame in (1, 3):
            self.scene.frame_set(frame)
            self.assert_close(self.f12(), read_png(self.path("drive", f"{frame - 1:05d}.png")))

    def test_folders_and_read_only_files_are_refused(self):
        self.bring_in()
        self.write("kept.json", "mine")
        os.chmod(self.path("kept.json"), 0o444)
        os.mkdir(self.path("folder.json"))
        for name in ("folder.json", "kept.json"):
            self.raises([name], bpy.ops.export_scene.pags_path, filepath=self.path(name), check_existing=False)
        self.assertEqual(fixtures.read(self.path("kept.json")), b"mine")
        os.chmod(self.path("kept.json"), 0o644)  # Windows can't remove a read-only file

    def test_paths_are_written_to_links_and_devices(self):
        """Writing a path keeps links, FIFOs and device files as they are. A read-only file behind a link is refused."""
        if not hasattr(os, "mkfifo"):
            self.skipTest("Windows has no FIFOs and no device files in folders")
        self.bring_in()
        kind = lambda name: stat.S_IFMT(os.lstat(self.path(name)).st_mode)
        write = lambda name: bpy.ops.export_scene.pags_path(filepath=self.path(name), check_existing=False)
        os.symlink("made.json", self.path("link.json"))
        write("link.json")
        made = fixtures.read(self.path("made.json"))
        self.assertEqual((kind("link.json"), len(json.loads(made)["frames"])), (stat.S_IFLNK, 3))
        os.mkfifo(self.path("fifo.json"))
        got = []
        reader = threading.Thread(target=lambda: got.append(fixtures.read(self.path("fifo.json"))), daemon=True)
        reader.start()
        write("fifo.json")
        reader.join(60)
        self.assertEqual((kind("fifo.json"), got), (stat.S_IFIFO, [made]))
        os.chmod(self.path("made.json"), 0o444)
        self.raises(
            ["link.json"], bpy.ops.export_scene.pags_path, filepath=self.path("link.json"), check_existing=False
        )
        self.assertEqual((kind("link.json"), fixtures.read(self.path("made.json"))), (stat.S_IFLNK, made))
        try:
            os.mknod(self.path("device.json"), stat.S_IFCHR | 0o666, os.makedev(1, 3))
            os.close(os.open(self.path("device.json"), os.O_WRONLY))
        except OSError as error:
            return print(f"devices are left out: mknod isn't permitted here ({error})")
        write("device.json")
        self.assertEqual(kind("device.json"), stat.S_IFCHR)

    def test_cameras_equal_recorded_views(self):
        """The camera of each sensor shows the same picture that the program draws for the recorded view."""
        self.bring_in()
        self.succeeds("render", self.path("scene"), "--split", "all", "--no-exposure", "-o", self.path("views"))
        for name, frame in (("001_0", 2), ("002_0", 3)):
            self.scene.frame_set(frame)
            self.assert_close(self.f12(), read_png(self.path("views", name + ".png")))

    def test_jump(self):
        self.bring_in()
        bpy.ops.pags.jump(name="002_1.jpg")
        self.assertEqual(self.scene.camera.data.pags.sensor, 1)
        self.assertEqual(self.scene.frame_current, 3)
        bpy.ops.pags.jump(step=-1)
        self.assertEqual(self.scene.frame_current, 2)
        self.raises(["none.jpg"], bpy.ops.pags.jump, name="none.jpg")

    def test_lane_shift(self):
        self.bring_in()
        bpy.ops.pags.ego_path(lane=0.5, sensor=0)
        self.scene.frame_set(2)
        self.assertAlmostEqual(self.scene.camera.matrix_world.translation.y, -0.5, places=4)
        self.succeeds(
            "render", self.path("scene"), "--path", "ego", "--shift", "0.5", "--no-exposure", "-o", self.path("shifted")
        )
        self.assert_close(self.f12(), read_png(self.path("shifted", "00001.png")))

    def test_bad_paths(self):
        self.raises(["PAGS scene"], bpy.ops.import_scene.pags_path, filepath=self.path("none.json"))
        self.bring_in()
        self.raises(["none.json"], bpy.ops.import_scene.pags_path, filepath=self.path("none.json"))
        self.write("bad.json", '{"frames": [{}]}')
        self.raises(["bad.json"], bpy.ops.import_scene.pags_path, filepath=self.path("bad.json"))
        bpy.context.object.scale = (1, -1, 1)
        self.raises(["stretched or mirrored"], bpy.ops.export_scene.pags_path, filepath=self.path("made.json"))
        self.assertFalse(os.path.exists(self.path("made.json")))


if __name__ == "__main__":
    main()
