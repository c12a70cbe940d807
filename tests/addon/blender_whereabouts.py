# SPDX-License-Identifier: Apache-2.0
"""Tests which scene file a .blend uses after it was moved, copied, linked or appended, when other files have the
same name. Also tests the data that a .blend stores for render nodes."""

import os
import shutil
import subprocess
import sys
import tempfile

import bpy

HERE = os.path.dirname(os.path.abspath(__file__))
sys.path[:0] = [HERE, os.path.join(HERE, "..", "cli")]
import fixtures  # noqa: E402
from blender_case import BlenderCase, addon, json, main, pixel  # noqa: E402
from fixtures import ply_bytes, splat  # noqa: E402

RED, GREEN, BLUE = (0.9, 0.1, 0.1), (0.1, 0.9, 0.1), (0.1, 0.1, 0.9)
NAMES = {0: "red", 1: "green", 2: "blue"}


class Whereabouts(BlenderCase):
    def setUp(self):
        super().setUp()
        self.module = sys.modules[addon.__name__ + ".whereabouts"]

    def ball(self, *names, colour=RED):
        """Writes a splat file with one ball. Balls of all colours have the same size in bytes."""
        return self.write(os.path.join(*names), ply_bytes([splat(0, 0, 0, colour, sigma=0.6, opacity=12.0)]))

    def new(self):
        """Starts an empty file with a camera that looks at the ball."""
        bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
        scene = self.scene
        scene.render.engine, scene.render.resolution_x, scene.render.resolution_y = "PAGS", 32, 32
        eye = bpy.data.objects.new("eye", bpy.data.cameras.new("eye"))
        scene.collection.objects.link(eye)
        eye.location, scene.camera = (0, 0, 4), eye

    def project(self, *names, colour=RED, **keywords):
        """Saves NAMES.blend and a ball as model.ply next to it; returns the .blend's path."""
        self.ball(*names[:-1], "model.ply", colour=colour)
        self.new()
        bpy.ops.wm.save_as_mainfile(filepath=self.path(*names))
        self.bring_in(os.path.join(*names[:-1], "model.ply"), cameras="NONE", **keywords)
        bpy.ops.wm.save_mainfile()
        return self.path(*names)

    @property
    def root(self):
        return next(o for o in bpy.data.objects if o.pags.kind == "ROOT")

    def drawn(self, blend=None):
        """Returns the colour of the ball that F12 draws for a .blend or for the open file."""
        if blend:
            bpy.ops.wm.open_mainfile(filepath=blend)
        values = pixel(self.f12(), 16, 16)
        return NAMES[max(range(3), key=values.__getitem__)]

    def refuses(self, *words, blend=None):
        if blend:
            bpy.ops.wm.open_mainfile(filepath=blend)
        self.raises(words, bpy.ops.render.render)

    def remark(self):
        return self.module.locate(self.root)[1]

    def test_moved_with_its_scene(self):
        """A moved .blend finds its scene by a relative or absolute path. Another scene of the same name, even of the
        same size, is refused."""
        for relative in (True, False):
            home, new = f"home {relative}", f"new {relative}"
            blend = self.project(home, "one.blend", relative=relative)
            self.assertEqual(self.root.pags.path, "//model.ply" if relative else self.path(home, "model.ply"))
            shutil.move(self.path(home), self.path(new))
            blend = self.path(new, "one.blend")
            self.assertEqual(self.drawn(blend), "red")
            self.assertEqual(bool(self.remark()), not relative)  # an absolute path still names the old place
            os.makedirs(self.path(home))
            if relative:
                self.ball(home, "model.ply", colour=BLUE)
                self.assertEqual(self.drawn(blend), "red")
                os.remove(self.path(home, "model.ply"))
            self.ball(new, "model.ply", colour=BLUE)
            self.refuses(
                self.path(new, "model.ply"), self.path(home, "model.ply"), "choose the path again", blend=blend
            )
            self.root.pags.path = "//model.ply"  # the user chooses the path
            self.assertEqual(self.drawn(), "blue")
            bpy.ops.wm.save_mainfile()
            self.assertEqual(self.drawn(blend), "blue")

    def test_changed_scene(self):
        """A scene may change at its place, even under an open file. A scene next to a copy of the .blend doesn't
        replace it."""
        blend = self.project("home", "one.blend")
        self.ball("home", "model.ply", colour=GREEN)
        self.assertEqual(self.drawn(blend), "green")
        self.assertEqual(self.remark(), "")
        self.ball("other", "model.ply", colour=BLUE)
        shutil.copy(blend, self.path("other", "one.blend"))
        self.assertEqual(self.drawn(self.path("other", "one.blend")), "green")
        self.assertIn("has changed since", self.remark())

    def test_saved_elsewhere(self):
        """Save As and Save Copy keep the scene, even in a folder with another scene of the same name. This holds for
        the saved and the open file."""
        blend = self.project("home", "one.blend")
        self.ball("other", "model.ply", colour=BLUE)
        bpy.ops.wm.save_as_mainfile(filepath=self.path("other", "copy.blend"), copy=True)
        self.assertEqual((self.drawn(), self.root.pags.path), ("red", "//model.ply"))
        bpy.ops.wm.save_as_mainfile(filepath=self.path("other", "two.blend"))
        self.assertEqual((self.drawn(), self.root.pags.path.replace(os.sep, "/")), ("red", "//../home/model.ply"))
        for name in ("copy", "two"):
            self.assertEqual(self.drawn(self.path("other", name + ".blend")), "red")
        os.rename(self.path("home"), self.path("gone"))
        for name in ("copy", "two"):
            self.refuses(self.path("home", "model.ply"), blend=self.path("other", name + ".blend"))
            bpy.ops.wm.save_mainfile()  # saving keeps the path
        os.rename(self.path("gone"), self.path("home"))
        for name in ("copy", "two"):
            self.assertEqual(self.drawn(self.path("other", name + ".blend")), "red")
        self.assertEqual(self.drawn(blend), "red")

    def bring_collection(self, blend, link):
        with bpy.data.libraries.load(blend, link=link) as (there, here):
            here.collections = [name for name in there.collections if "model" in name]
        for collection in here.collections:
            self.scene.collection.children.link(collection)

    def test_appended_and_linked(self):
        """An appended or linked scene keeps its source, also in a folder with another scene of the same name. If the
        source is missing, no other scene replaces it."""
        blend = self.project("home", "one.blend")
        self.ball("other", "model.ply", colour=BLUE)
        os.makedirs(self.path("empty"))
        for folder in ("other", "empty"):
            for link in (False, True):
                self.new()
                bpy.ops.wm.save_as_mainfile(filepath=self.path(folder, f"shot {link}.blend"))
                self.bring_collection(blend, link)
                self.assertEqual(self.drawn(), "red")
                bpy.ops.wm.save_mainfile()
                self.assertEqual(self.drawn(self.path(folder, f"shot {link}.blend")), "red")
        os.remove(self.path("home", "model.ply"))
        for folder in ("other", "empty"):
            for link in (False, True):
                self.refuses(self.path("home", "model.ply"), blend=self.path(folder, f"shot {link}.blend"))

    def test_needs_of_a_linked_scene(self):
        """A linked scene's list of files for render nodes has paths relative to its library."""
        blend, check = self.project("home", "one.blend"), sys.modules[addon.__name__ + ".farm_check"]
        self.new()
        bpy.ops.wm.save_as_mainfile(filepath=self.path("shot.blend"))
        with bpy.data.libraries.load(blend, link=True) as (there, here):
            here.scenes = there.scenes
        self.assertIn("pags_needs", here.scenes[0])
        bpy.ops.wm.save_mainfile()
        self.assertIn("pags_check.py", bpy.data.texts)
        self.assertEqual(check.faults(bpy), [])
        self.ball("home", "model.ply", colour=BLUE)
        self.assertIn(self.path("home", "model.ply"), check.faults(bpy)[0])

    def test_an_override(self):
        """A linked scene uses the library's path. A changed path belongs to the open file and is relative to it."""
        blend = self.project("home", "one.blend")
        self.ball("other", "model.ply", colour=BLUE)
        self.ball("other", "mine.ply", colour=GREEN)
        self.new()
        bpy.ops.wm.save_as_mainfile(filepath=self.path("other", "shot.blend"))
        self.bring_collection(blend, True)
        collection = next(c for c in self.scene.collection.children if "model" in c.name)
        collection.override_hierarchy_create(self.scene, bpy.context.view_layer)
        self.scene.collection.children.unlink(collection)
        self.assertEqual(self.drawn(), "red")
        root = next(o for o in bpy.data.objects if o.pags.kind == "ROOT" and o.override_library)
        root.pags.path = "//mine.ply"
        bpy.ops.wm.save_mainfile()
        self.assertEqual(self.drawn(self.path("other", "shot.blend")), "green")
        os.makedirs(self.path("third"))
        shutil.move(self.path("other", "mine.ply"), self.path("third", "mine.ply"))
        shutil.move(self.path("other", "shot.blend"), self.path("third", "shot.blend"))
        self.assertEqual(self.drawn(self.path("third", "shot.blend")), "green")

    def test_older_file_without_record(self):
        """An older .blend without a record uses the scene at its path, but no scene of the same name elsewhere."""
        blend = self.project("home", "one.blend", relative=False)
        self.root.pags.record = ""
        bpy.app.handlers.save_pre[:], kept = [], list(bpy.app.handlers.save_pre)
        bpy.ops.wm.save_mainfile()
        bpy.app.handlers.save_pre[:] = kept
        self.assertEqual(self.drawn(blend), "red")
        shutil.move(self.path("home"), self.path("new"))
        self.refuses(
            self.path("home", "model.ply"),
            self.path("new", "model.ply"),
            "no record shows",
            blend=self.path("new", "one.blend"),
        )

    def test_a_scene_folder(self):
        """A scene folder is recognised by scene.json and the files named there. Its data set and other training
        files may differ."""
        self.new()
        self.bring_in("scene")
        bpy.ops.wm.save_as_mainfile(filepath=self.path("work.blend"))
        bpy.ops.wm.save_mainfile()
        os.makedirs(self.path("farm"))
        shutil.copy(self.path("work.blend"), self.path("farm"))
        shutil.move(self.path("scene"), self.path("farm", "scene"))
        record = json.loads(fixtures.read(self.path("farm", "scene", "scene.json")))
        self.write("farm/scene/scene.json", json.dumps({**record, "dataset": "/elsewhere"}))
        self.write("farm/scene/log.jsonl", "{}")
        bpy.ops.wm.open_mainfile(filepath=self.path("farm", "work.blend"))
        self.assertGreater(max(self.f12()[4]), 100)
        model = self.path("farm", "scene", record["models"][0]["file"])
        data = bytearray(fixtures.read(model))
        data[-1] ^= 1
        fixtures.write(model, bytes(data))
        self.refuses(
            self.path("farm", "scene"),
            "is not the file that the .blend was saved with",
            blend=self.path("farm", "work.blend"),
        )

    def test_moved_data_set(self):
        """If the training set is gone, the same set next to the scene is used; another set is refused. Photographs
        of two sets are never mixed."""
        from drive_set import make_set

        make_set(self.path("scene"), self.path("there", "set"))
        self.new()
        root = self.bring_in()
        bpy.ops.pags.compare(name="001_0.png", use_exposure=False)
        shutil.move(self.path("there", "set"), self.path("set"))
        bpy.ops.pags.compare(name="001_0.png", use_exposure=False)
        data = fixtures.read(self.path("set", "images", "002_0.png"))
        self.write("set/images/001_0.png", data + b"more")
        self.raises(["there", self.path("set"), "another data set"], bpy.ops.pags.compare, name="001_0.png")
        root.pags.dataset = self.path("set")  # the user chooses the folder
        bpy.ops.pags.compare(name="001_0.png", use_exposure=False)
        os.remove(self.path("set", "images", "001_0.png"))
        shutil.copytree(self.path("set"), self.path("there", "set"))
        self.write("there/set/images/001_0.png", data)
        self.raises(["001_0.png", self.path("set")], bpy.ops.pags.compare, name="001_0.png")

    def node(self, blend, *words, scripts, addons=()):
        """Starts a separate Blender as a render node does; returns its exit code, its files and its output."""
        with tempfile.TemporaryDirectory() as config:
            environment = {**os.environ, "BLENDER_USER_SCRIPTS": scripts, "BLENDER_USER_CONFIG": config}
            switched = ("--addons", ",".join(addons)) if addons else ()
            command = [
                bpy.app.binary_path,
                "-b",
                "--factory-startup",
                "-noaudio",
                *switched,
                blend,
                *words,
                "-o",
                self.path("out", "####"),
                "-f",
                "1",
            ]
            done = subprocess.run(
                command, env=environment, capture_output=True, text=True, errors="replace", stdin=subprocess.DEVNULL
            )
        files = os.listdir(self.path("out")) if os.path.isdir(self.path("out")) else []
        shutil.rmtree(self.path("out"), ignore_errors=True)
        return done.returncode, files, done.stdout + done.stderr

    def test_a_render_node(self):
        """The script in the .blend ends Blender before the first frame if the add-on or the scene is missing.
        Otherwise it does nothing."""
        if not bpy.app.binary_path or addon.__name__.startswith("bl_ext."):
            self.skipTest("needs a Blender that takes an add-on from a folder")
        blend = self.project("home", "one.blend")
        needs = json.loads(self.scene["pags_needs"])
        self.assertEqual([s["path"] for s in needs["scenes"]], ["//model.ply"])
        self.assertEqual(
            bpy.data.texts["pags_check.py"].as_string(),
            fixtures.read(sys.modules[addon.__name__ + ".farm_check"].__file__).decode(),
        )
        mine, check = bpy.utils.user_resource("SCRIPTS"), ("--python-exit-code", "1", "--python-text", "pags_check.py")
        code, files, said = self.node(blend, *check, scripts=mine, addons=[addon.__name__])
        self.assertEqual((code, files), (0, ["0001.png"]), said)
        code, files, said = self.node(blend, *check, scripts=self.path(""))
        self.assertEqual((code, files), (1, []), said)
        self.assertIn("the PAGS add-on, version", said)
        self.ball("home", "model.ply", colour=BLUE)
        code, files, said = self.node(blend, *check, scripts=mine, addons=[addon.__name__])
        self.assertEqual((code, files), (1, []), said)
        self.assertIn(self.path("home", "model.ply"), said)
        os.remove(self.path("home", "model.ply"))
        code, files, said = self.node(blend, scripts=mine, addons=[addon.__name__])
        self.assertEqual(files, [], said)
        self.assertNotEqual(code, 0, said)
        self.scene.render.engine = bpy.types.RenderSettings.bl_rna.properties["engine"].default
        bpy.ops.wm.save_mainfile()
        self.assertNotIn("pags_needs", self.scene)


if __name__ == "__main__":
    main()
