# SPDX-License-Identifier: Apache-2.0
"""Tests output paths that are devices, FIFOs or links. They stay what they are with every verb and option."""

import json
import os
import pwd
import stat
import subprocess
import threading

import fixtures
import test_import
from fixtures import FRONT, SMALL, DataCase, ply_bytes, read, run, some_splats


def kind(path):
    return stat.S_IFMT(os.lstat(path).st_mode)


def make_device(path):
    """Makes a null device for the test, so that no device of the machine is touched. Returns the reason if that isn't
    permitted."""
    try:
        os.mknod(path, stat.S_IFCHR | 0o666, os.makedev(1, 3))
        os.chmod(path, 0o666)
        os.close(os.open(path, os.O_WRONLY))
    except OSError as error:
        return str(error)
    return None


class Reader:
    """A thread that reads a FIFO to its end. If `most` is given, it reads that many bytes and closes the FIFO."""

    def __init__(self, path, most=-1):
        self.path, self.most, self.got = path, most, b""
        self.thread = threading.Thread(target=self.work, daemon=True)
        self.thread.start()

    def work(self):
        with open(self.path, "rb", buffering=0) as file:
            self.got = file.read(self.most)

    def end(self):
        self.thread.join(10)
        return self.got


class Writes(DataCase):
    @classmethod
    def setUpClass(cls):
        super().setUpClass()
        shared = cls.shared_folder()
        cls.scene = os.path.join(shared, "scene")
        cls.splats = fixtures.write(os.path.join(shared, "a.ply"), ply_bytes(some_splats()))
        camera = {**FRONT, "camera_from_world_translation": [0, 0, 5]}
        cls.camera = fixtures.write(os.path.join(shared, "camera.json"), json.dumps(camera))
        done = run("train", cls.data, "-o", cls.scene, "-n", 3, "-j", 1, *SMALL)
        assert done.returncode == 0, done.stderr
        cls.no_device = make_device(os.path.join(shared, "device"))
        if cls.no_device:
            print(f"devices are left out: mknod isn't permitted here ({cls.no_device})")

    def table(self):
        """Yields each command up to its output path, and the extension of that path."""
        ring = ["pags-bench", "render", self.splats, "-n", 1, "-r", 1, "--sizes", "32x24", "--modes", "off"]
        many = self.write("many.ply", ply_bytes(3 * some_splats()))
        scale = ["pags-bench", "scale", many, "--camera", self.camera, "--millions", "0.001", "--spacing", 3]
        scale += ["-n", 1, "-r", 1, "--scratch", self.path()]
        curve = ["pags-bench", "curve", self.splats, "-n", 1, "-r", 1, "--modes", "off", "--limits", "none"]
        train = ["train", self.data, "-n", 2, "-j", 1, *SMALL, "--overwrite", "-o", self.path("trained")]
        yield ["info", self.splats, "--json"], ".json"
        yield ["info", self.data, "--json"], ".json"
        yield [*train, "--json"], ".json"
        yield ["render", self.splats, "--camera", self.camera, "-o", self.path("pictures"), "--json"], ".json"
        yield ["eval", self.scene, "--views", 1, "--json"], ".json"
        yield ["export", self.splats, self.path("b.ply"), "--json"], ".json"
        for ending in [".ply", ".spz", ".splat", ".pagsz", ".usda", ".glb", ".gltf"]:
            yield ["export", self.splats, *(["--splats"] if ending in (".glb", ".gltf") else [])], ending
        if self.has("import"):
            test_import.make_tree(self.path("tree"), 2)
            yield ["import", "kitti", self.path("tree"), "-o", self.path("imported"), "--overwrite", "--json"], ".json"
        if self.has("synth"):
            street = ["synth", "street", "--size", "32x18", "--frames", 2, "--cameras", 1]
            yield [*street, "-o", self.path("street"), "--overwrite", "--json"], ".json"
        yield [*ring, "--csv"], ".csv"
        yield [*ring, "--json"], ".json"
        yield [*scale, "--csv"], ".csv"
        yield [*scale, "--json"], ".json"
        yield [*curve, "--json"], ".json"

    def has(self, verb):
        return run(verb, "--help").returncode == 0

    def test_every_verb(self):
        for number, (command, ending) in enumerate(self.table()):
            with self.subTest(command=" ".join(map(str, command[:2] + command[-1:])), ending=ending):
                self.check(command, lambda name: self.path(f"{number}_{name}{ending}"))

    def check(self, command, at, **more):
        target, link, fifo, device, beside = map(at, ["target", "link", "fifo", "device", "other"])
        fixtures.write(target, "old")
        os.chmod(target, 0o666)
        os.symlink(os.path.basename(target), link)
        self.succeeds(*command, link, **more)
        self.assertEqual((kind(link), kind(target)), (stat.S_IFLNK, stat.S_IFREG))
        self.assertGreater(len(read(target)), 3)

        os.mkfifo(fifo)
        os.chmod(fifo, 0o666)
        reader = Reader(fifo)
        self.succeeds(*command, fifo, **more)
        self.assertEqual(kind(fifo), stat.S_IFIFO)
        got = reader.end()
        self.assertGreater(len(got), 3)
        if command[0] in ("info", "export"):  # the output of other verbs contains times
            named = lambda data: data.replace(b"_fifo", b"_link")
            self.assertEqual(named(got), read(target))

        if not self.no_device:
            make_device(device)
            self.succeeds(*command, device, **more)
            self.assertEqual(kind(device), stat.S_IFCHR)

        # A read-only target is refused. Most verbs refuse it before they do any work.
        os.chmod(target, 0o444)
        before = read(target)
        self.fails([*command, link], "is read-only (mode 0444)", link, **more)
        self.assertEqual((kind(link), read(target)), (stat.S_IFLNK, before))
        os.symlink(os.path.basename(beside), beside)
        self.fails([*command, beside], "links lead in a loop", beside, **more)
        self.assertEqual(kind(beside), stat.S_IFLNK)
        os.mkdir(at("folder"))
        self.fails([*command, at("folder")], "a folder of that name exists", **more)
        left = [name for name in os.listdir(self.folder) if name.endswith(".part")]
        self.assertEqual(left, [])

    def test_folder_does_not_replace_a_file_or_fifo(self):
        test_import.make_tree(self.path("tree"), 2)
        commands = [["train", self.data, "-n", 2, *SMALL, "--overwrite"]]
        commands += [["render", self.splats, "--camera", self.camera]]
        commands += [["import", "kitti", self.path("tree"), "--overwrite"]] if self.has("import") else []
        commands += [["synth", "street", "--overwrite"]] if self.has("synth") else []
        os.mkfifo(self.path("fifo"))
        os.symlink("nowhere", self.path("link"))
        places = [("fifo", stat.S_IFIFO), ("link", stat.S_IFLNK)]
        if not self.no_device:
            make_device(self.path("device"))
            places.append(("device", stat.S_IFCHR))
        for command in commands:
            for name, before in places:
                with self.subTest(command=command[0], place=name):
                    self.fails([*command, "-o", self.path(name)], self.path(name))
                    self.assertEqual(kind(self.path(name)), before)
        self.fails(["eval", self.scene, "--views", 1, "--images", self.path("fifo")], self.path("fifo"))

    def test_dangling_link_creates_its_target(self):
        os.mkdir(self.path("there"))
        os.symlink("there/made.json", self.path("link.json"))
        self.succeeds("info", self.splats, "--json", self.path("link.json"))
        self.assertEqual(kind(self.path("link.json")), stat.S_IFLNK)
        self.assertEqual(json.loads(read(self.path("there/made.json")))["gaussians"], 40)

    def test_without_root_rights(self):
        if os.geteuid() != 0:
            return print("left out: only root can become nobody; the other tests ran as a user")
        nobody = pwd.getpwuid(65534).pw_uid
        for folder in [self.folder, os.path.dirname(self.splats)]:
            os.chmod(folder, 0o777)
        try:
            tried = run("info", self.splats, user=nobody, group=nobody, extra_groups=[])
        except (OSError, subprocess.SubprocessError) as error:
            return print(f"left out: the program can't be run as nobody ({error})")
        self.assertEqual(tried.returncode, 0, tried.stderr)
        user = {"user": nobody, "group": nobody, "extra_groups": []}
        self.check(["info", self.splats, "--json"], lambda name: self.path(f"user_{name}.json"), **user)
        self.fails(
            ["info", self.splats, "--json", self.write("roots.json", "kept")], "Permission denied", "roots.json", **user
        )
        self.assertEqual(read(self.path("roots.json")), b"kept")
        os.mkdir(self.path("shut"))
        self.fails(
            ["info", self.splats, "--json", self.path("shut/a.json")], "Permission denied", "shut/a.json", **user
        )

    def test_reader_that_closes_early(self):
        many = self.write("many.ply", ply_bytes(50 * some_splats()))
        os.mkfifo(self.path("fifo.ply"))
        reader = Reader(self.path("fifo.ply"), 1)
        self.fails(["export", many, self.path("fifo.ply")], "fifo.ply: can't write: Broken pipe")
        reader.end()
        self.assertEqual(kind(self.path("fifo.ply")), stat.S_IFIFO)

    def test_pictures(self):
        pictures = self.path("pictures")
        os.mkdir(pictures)
        target = self.write("target.png", "old")
        view = ["render", self.splats, "--camera", self.camera, "-o", pictures]
        self.succeeds(*view)
        (name,) = os.listdir(pictures)
        path = os.path.join(pictures, name)
        plain = read(path)
        os.remove(path)
        os.symlink(target, path)
        self.succeeds(*view)
        self.assertEqual((kind(path), read(target)), (stat.S_IFLNK, plain))
        os.chmod(target, 0o444)
        self.fails(view, "is read-only", path)
        os.remove(path)
        os.mkfifo(path)
        reader = Reader(path)
        self.succeeds(*view)
        self.assertEqual((kind(path), reader.end()), (stat.S_IFIFO, plain))
        if not self.no_device:
            os.remove(path)
            make_device(path)
            self.succeeds(*view)
            self.assertEqual(kind(path), stat.S_IFCHR)

    def train(self, *more):
        return ["train", self.data, "-o", self.path("s"), "-n", 12, "-j", 1, *SMALL, *more]

    def test_files_of_a_run(self):
        names = ["log.jsonl", "report.json", "scene.json", "checkpoint.pags", "background.ply"]
        for name in names:
            self.write(f"far/{name}", "old")
            os.makedirs(self.path("s"), exist_ok=True)
            os.symlink(f"../far/{name}", self.path("s", name))
        self.succeeds(*self.train("--overwrite"))
        for name in names:
            self.assertEqual(kind(self.path("s", name)), stat.S_IFLNK, name)
            self.assertFalse(read(self.path("far", name)).startswith(b"old"), name)
        lines = read(self.path("far/log.jsonl")).splitlines()
        self.succeeds(*self.train("--resume", "-n", 24))
        self.assertEqual(kind(self.path("s/log.jsonl")), stat.S_IFLNK)
        self.assertEqual(read(self.path("far/log.jsonl")).splitlines()[: len(lines)], lines)

    def test_log_of_a_run(self):
        self.succeeds(*self.train())
        plain = read(self.path("s/log.jsonl"))
        os.remove(self.path("s/log.jsonl"))
        os.mkfifo(self.path("s/log.jsonl"))
        reader = Reader(self.path("s/log.jsonl"))
        self.succeeds(*self.train("--overwrite"))
        self.assertEqual((kind(self.path("s/log.jsonl")), reader.end()), (stat.S_IFIFO, plain))
        if not self.no_device:
            os.remove(self.path("s/log.jsonl"))
            make_device(self.path("s/log.jsonl"))
            self.succeeds(*self.train("--overwrite"))
            self.assertEqual(kind(self.path("s/log.jsonl")), stat.S_IFCHR)


if __name__ == "__main__":
    fixtures.main()
