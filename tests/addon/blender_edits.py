# SPDX-License-Identifier: Apache-2.0
"""Tests the add-on in Blender without a window: edits saved as a scene."""

import contextlib
import errno
import os
import sys
from unittest import mock

import bpy

HERE = os.path.dirname(os.path.abspath(__file__))
sys.path[:0] = [HERE, os.path.join(HERE, "..", "cli")]
import fixtures  # noqa: E402
from blender_case import BlenderCase, addon, main  # noqa: E402


class Edits(BlenderCase):
    def test_saved_as_a_scene(self):
        """Blender's picture after edits equals the program's picture of the saved scene."""
        root = self.bring_in()
        self.track(0).location.x -= 0.5  # moves the parked car
        self.part(1).location.x += 0.7  # moves the driving car along its track
        bpy.ops.pags.save_edited(directory=self.path("edited"))
        for frame in (1, 2):
            self.scene.frame_set(frame)
            self.assert_close(self.f12(), self.program(scene="edited"))
        self.raises(["already contains a scene"], bpy.ops.pags.save_edited, directory=self.path("edited"))
        self.part(1).scale = (2, 2, 2)
        self.part(0).scale = (1, -1, 1)
        exporter, jobs = (sys.modules[f"{addon.__name__}.{name}"] for name in ("exporter", "jobs"))

        def work(job):
            edited = exporter.Edited(bpy.context, root)
            yield from edited.collect(job)
            yield jobs.in_thread(edited.write, self.path("unscaled"), job)
            return edited.left_out()

        self.assertEqual(jobs.at_once("test", work).notice, "; not exported: the scale of c=2, p,1")
        # the poses stay rigid, so the program accepts them
        self.succeeds("render", self.path("unscaled"), "--path", "ego", "-o", self.path("drawn"))

    def no_links(self, error=PermissionError(errno.EPERM, "Operation not permitted")):
        """Returns a context in which no links can be made, as on a FAT file system."""
        stack = contextlib.ExitStack()
        for name in ("symlink", "link"):
            stack.enter_context(mock.patch.object(os, name, side_effect=error))
        return stack

    def contents(self, folder):
        """Returns the bytes of every file in the folder and its subfolders, by path; None for a link."""
        paths = [os.path.join(at, name) for at, _, names in os.walk(self.path(folder)) for name in names]
        return {p: None if os.path.islink(p) else fixtures.read(p) for p in paths}

    def test_saved_where_links_cannot_be_made(self):
        """Without links, the models are copied. The saved scene is complete and the old scene stays unchanged."""
        self.bring_in()
        before = self.contents("scene")
        self.track(0).location.x -= 0.5
        self.part(1).location.x += 0.7
        shown = self.f12()

        def text_in_place_of_a_link(source, target):
            fixtures.write(target, "XSym\n" + source)

        ways = [
            OSError(errno.EPERM, "x"),
            PermissionError(1314, "privilege"),
            NotImplementedError("no links"),
            text_in_place_of_a_link,
        ]
        for i, way in enumerate(ways):
            with self.no_links(way):
                bpy.ops.pags.save_edited(directory=self.path(f"copied{i}"))
            made = self.contents(f"copied{i}")
            self.assertNotIn(None, made.values())
            self.assertEqual(
                sorted(os.path.basename(p) for p in made), ["background.ply", "car.ply", "scene.json", "sky.npy"]
            )
            self.assertEqual(
                made[self.path(f"copied{i}", "objects", "car.ply")], before[self.path("scene", "objects", "car.ply")]
            )
        self.assertEqual(self.contents("scene"), before)
        with self.no_links():
            bpy.ops.export_scene.pags(filepath=self.path("edited.ply"))  # the export goes through such a folder
        self.assertGreater(os.path.getsize(self.path("edited.ply")), 3 * 56)
        os.rename(self.path("scene"), self.path("away"))
        bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
        self.bring_in("copied0")
        self.assert_close(self.f12(), shown)

    def test_saving_that_fails_leaves_everything_as_it_was(self):
        """Saving fails with the path of the cause: a full disk, files or links in the way, a missing model. Nothing
        is changed."""
        self.bring_in()
        before = self.contents("scene")
        self.track(0).location.x -= 0.5  # forces the background to be written again
        full = mock.patch("shutil.copyfile", side_effect=OSError(errno.ENOSPC, "No space left on device"))
        with self.no_links(), full:
            self.raises(
                [self.path("full", "background.ply"), "No space"],
                bpy.ops.pags.save_edited,
                directory=self.path("full"),
            )
        self.assertFalse(os.path.lexists(self.path("full")))
        self.write(os.path.join("mine", "background.ply"), b"mine")
        self.write(os.path.join("other", "sky.npy"), b"mine")
        self.write("file", b"mine")
        taken = [("mine", "background.ply"), ("other", "sky.npy"), ("file", "")]
        if self.links_can_be_made():
            os.makedirs(self.path("linked"))
            os.symlink(self.path("scene", "background.ply"), self.path("linked", "background.ply"))
            os.makedirs(self.path("nowhere", "objects"))
            os.symlink(self.path("none"), self.path("nowhere", "objects", "car.ply"))
            taken += [("linked", "background.ply"), ("nowhere", "objects/car.ply")]
        for folder, name in taken:
            kept, folders = self.contents(folder), [at for at, _, _ in os.walk(self.path(folder))]
            for links in (contextlib.nullcontext(), self.no_links()):
                with links:
                    self.raises(
                        [os.path.normpath(self.path(folder, name))],
                        bpy.ops.pags.save_edited,
                        directory=self.path(folder),
                    )
                self.assertEqual(self.contents(folder), kept)
                self.assertEqual([at for at, _, _ in os.walk(self.path(folder))], folders)
        self.assertEqual(fixtures.read(self.path("file")), b"mine")
        self.assertEqual(self.contents("scene"), before)
        here = os.listdir(".")
        self.raises(["choose a folder"], bpy.ops.pags.save_edited)
        self.assertEqual(os.listdir("."), here)
        os.rename(self.path("scene", "objects", "car.ply"), self.path("car.ply"))
        self.raises([self.path("scene", "objects", "car.ply")], bpy.ops.pags.save_edited, directory=self.path("gone"))
        self.assertFalse(os.path.lexists(self.path("gone")))
        os.rename(self.path("car.ply"), self.path("scene", "objects", "car.ply"))
        bpy.ops.pags.save_edited(directory=self.path("full"))  # saves into the same folder again
        self.assert_close(self.f12(), self.program(scene="full"))

    def test_deleted_objects_are_left_out(self):
        self.bring_in()
        bpy.data.objects.remove(self.part(0))
        bpy.ops.pags.save_edited(directory=self.path("fewer"))
        self.assert_close(self.f12(), self.program(scene="fewer"))
        bpy.data.objects.remove(self.part(1))
        bpy.ops.pags.save_edited(directory=self.path("none"))
        self.assert_close(self.f12(), self.program(scene="none"))


if __name__ == "__main__":
    main()
