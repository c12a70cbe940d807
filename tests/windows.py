# SPDX-License-Identifier: Apache-2.0
"""windows.py PAGS.EXE PAGS: runs the program for Windows under wine and compares its outputs with those of the
program for Linux: they must have the same bits. Also checks special paths of Windows, folders without write access,
and Ctrl-C.

Splat files and the data set fox are read from PAGS_SHARED_DATA, or from ../shared/data next to the sources, if
present."""

import glob
import json
import os
import pty
import pwd
import shutil
import subprocess
import sys
import tempfile
import threading
import unittest

HERE = os.path.dirname(os.path.abspath(__file__))
ROOT = os.path.dirname(HERE)
sys.path.insert(0, os.path.join(HERE, "cli"))

import fixtures  # noqa: E402
import scenes  # noqa: E402
from fixtures import files_below, ply_bytes, read, some_splats, write  # noqa: E402

SHARED = os.environ.get("PAGS_SHARED_DATA") or os.path.join(os.path.dirname(ROOT), "shared", "data")
WINDOWS, LINUX = "", ""
JAPANESE = "日本語 と Ümläüte"


def run_windows(*arguments, program=None, **more):
    command = ["wine", program or WINDOWS, *[str(word) for word in arguments]]
    return subprocess.run(
        command, capture_output=True, timeout=600, **{"env": {**os.environ, "WINEDEBUG": "-all"}, **more}
    )


def run_linux(*arguments, **more):
    return subprocess.run([LINUX, *[str(word) for word in arguments]], capture_output=True, timeout=600, **more)


def drive(path):
    """Returns the path in Windows' form: wine shows the root folder as drive Z."""
    return "Z:" + path.replace("/", "\\")


def has_pictures():
    return (
        b"reads no pictures" not in run_windows("train", "--help").stdout
        and os.path.exists(PICTURES)
        and not run_windows("info", PICTURES).returncode
    )


def writes_gltf():
    out = os.path.join(tempfile.gettempdir(), f"pags-windows-{os.getpid()}.glb")
    said = run_windows("export", PICTURES[:-4] + ".ply", out, "--splats")
    if not said.returncode:
        os.remove(out)
    return not said.returncode


PICTURES = ""  # a small PNG, next to a small PLY


class Case(unittest.TestCase):
    maxDiff = None

    def setUp(self):
        self.folder = tempfile.mkdtemp(prefix="pags-windows-")
        self.addCleanup(shutil.rmtree, self.folder, True)

    def path(self, name):
        return os.path.join(self.folder, name)

    def succeeds(self, *arguments, **more):
        said = run_windows(*arguments, **more)
        self.assertEqual(said.returncode, 0, said.stderr.decode(errors="replace"))
        return said

    def fails(self, arguments, *words, **more):
        said = run_windows(*arguments, **more)
        self.assertEqual(said.returncode, 1, said.stdout)
        for word in words:
            self.assertIn(word, said.stderr.decode())
        return said

    def same_files(self, a, b):
        self.assertEqual(files_below(a), files_below(b))
        for name in files_below(a):
            windows = read(os.path.join(a, name))
            if name.endswith(
                ".json"
            ):  # the file states the absolute path of its source, which has a drive letter there
                windows = windows.replace(b"Z:/", b"/")
            self.assertEqual(windows, read(os.path.join(b, name)), name)


class Bits(Case):
    """Compares the outputs of both programs."""

    kinds = [
        ("out.ply",),
        ("out.spz", "--spz-version", "3"),
        ("out.spz", "--spz-version", "4"),
        ("out.splat",),
        ("out.pagsz",),
    ]

    def inputs(self):
        found = [
            path
            for path in sorted(glob.glob(os.path.join(SHARED, "splats", "*")))
            if path.endswith((".ply", ".spz", ".splat"))
        ]
        if not found:
            print(
                f"no splat files in {SHARED}/splats (PAGS_SHARED_DATA says where they are): the small ones alone",
                file=sys.stderr,
            )
        scenes.make_scene(self.path("scene"))
        return [self.path("scene"), write(self.path("small.ply"), ply_bytes(some_splats()))] + found

    def test_info(self):
        for path in self.inputs():
            for options in [["--json", "-"], ["--memory", "--threads", "1"], ["--objects"]]:
                with self.subTest(path=path, options=options):
                    ours, theirs = run_windows("info", path, *options), run_linux("info", path, *options)
                    self.assertEqual(ours.returncode, theirs.returncode, ours.stderr)
                    if "--memory" not in options:  # measured times differ
                        self.assertEqual(ours.stdout, theirs.stdout)

    def test_export(self):
        kinds = list(self.kinds)
        if writes_gltf():
            kinds += [("out.glb", "--splats"), ("out.gltf", "--splats")]
        else:
            print("glTF is left out: this build writes none", file=sys.stderr)
        for path in self.inputs():
            for kind in kinds:
                with self.subTest(path=path, kind=kind):
                    for name, run in [("windows", run_windows), ("linux", run_linux)]:
                        os.makedirs(self.path(name))
                        said = run("export", path, os.path.join(self.path(name), kind[0]), *kind[1:], "--quiet")
                        self.assertEqual(said.returncode, 0, said.stderr)
                    self.assertTrue(files_below(self.path("linux")))
                    self.same_files(self.path("windows"), self.path("linux"))
                for name in ["windows", "linux"]:
                    shutil.rmtree(self.path(name), True)

    def test_import_kitti(self):
        import test_import

        raw = test_import.make_tree(self.path("raw"), 4)
        said = run_windows("import", "kitti", raw, "-o", self.path("windows"))
        if b"reads no pictures" in said.stderr:
            self.skipTest("this build reads no pictures")
        self.assertEqual(said.returncode, 0, said.stderr)
        self.assertEqual(run_linux("import", "kitti", raw, "-o", self.path("linux")).returncode, 0)
        self.same_files(self.path("windows"), self.path("linux"))
        self.succeeds("import", "kitti", drive(raw), "-o", drive(self.path("drive")))
        self.same_files(self.path("drive"), self.path("linux"))

    def test_train_render_eval(self):
        if not has_pictures():
            self.skipTest("this build reads no pictures")
        fixtures.make_dataset(self.path("data"))
        for name, run in [("windows", run_windows), ("linux", run_linux)]:
            options = ["--iterations", "60", "--threads", "2", *fixtures.SMALL]
            said = run("train", self.path("data"), "-o", self.path(name), *options)
            self.assertEqual(said.returncode, 0, said.stderr)
        for name in ["background.ply"]:
            self.assertEqual(read(self.path("windows/" + name)), read(self.path("linux/" + name)))
        for name, run in [("windows", run_windows), ("linux", run_linux)]:
            said = run("render", self.path("linux"), "-o", self.path(name + "-pictures"))
            self.assertEqual(said.returncode, 0, said.stderr)
        self.same_files(self.path("windows-pictures"), self.path("linux-pictures"))
        self.succeeds("eval", self.path("linux"), "--dataset", self.path("data"))

    def test_train_a_capture(self):
        """Trains from the JPEG photographs of the data set fox, with COLMAP's poses."""
        if not has_pictures():
            self.skipTest("this build reads no pictures")
        capture = os.path.join(SHARED, "fox")
        if not os.path.isdir(capture):
            self.skipTest(f"there is no capture {capture} (PAGS_SHARED_DATA says where it is)")
        for name, run in [("windows", run_windows), ("linux", run_linux)]:
            said = run("train", capture, "-o", self.path(name), "--iterations", "200")
            self.assertEqual(said.returncode, 0, said.stderr)
        self.assertEqual(read(self.path("windows/background.ply")), read(self.path("linux/background.ply")))


class Places(Case):
    """Tests paths, folders and files that Windows treats differently."""

    def setUp(self):
        super().setUp()
        self.ply = write(self.path("small.ply"), ply_bytes(some_splats()))

    def expected(self):
        out = self.path("expected.spz")
        self.assertEqual(run_linux("export", self.ply, out).returncode, 0)
        return read(out)

    def goes_both_ways(self, folder):
        os.makedirs(folder)
        source = os.path.join(folder, "in.ply")
        shutil.copyfile(self.ply, source)
        expected = self.expected()
        for form in [str, drive]:
            out = os.path.join(folder, "out.spz")
            self.succeeds("export", form(source), form(out))
            self.assertEqual(read(out), expected)
            self.assertEqual(files_below(folder), ["in.ply", "out.spz"])
            os.remove(out)

    def test_characters_beyond_ascii(self):
        self.goes_both_ways(self.path(JAPANESE))
        said = self.fails(["info", self.path(JAPANESE + "/none.ply")], JAPANESE + "/none.ply")
        self.assertIn("No such file", said.stderr.decode())

    def test_over_260_characters(self):
        folder = self.folder
        while len(folder) < 400:
            folder = os.path.join(folder, "a folder whose name is long " + "x" * 40)
        self.goes_both_ways(folder)

    def test_mixed_separators_and_relative_paths(self):
        os.makedirs(self.path("a/b"))
        self.succeeds("export", "small.ply", "a\\b/out.spz", cwd=self.folder)
        self.assertEqual(read(self.path("a/b/out.spz")), self.expected())
        self.succeeds("export", "a\\..\\small.ply", ".\\a\\out.spz", cwd=self.folder)
        self.assertEqual(read(self.path("a/out.spz")), self.expected())

    def test_missing_folders_are_made(self):
        self.succeeds("render", "small.ply", "-o", "new\\folders/of\\pictures", "--frames", "1", cwd=self.folder)
        self.assertEqual(files_below(self.folder), ["new/folders/of/pictures/00000.png", "small.ply"])

    def test_a_file_is_replaced(self):
        out = write(self.path("out.spz"), b"old")
        self.succeeds("export", self.ply, out)
        self.assertEqual(read(out), self.expected())
        self.assertFalse(os.path.exists(out + ".part"))

    def test_a_file_that_another_reads_is_replaced(self):
        out = write(self.path("out.spz"), b"old")
        with open(out, "rb"):
            self.succeeds("export", self.ply, out)
        self.assertEqual(read(out), self.expected())

    def test_a_read_only_file_stays(self):
        out = write(self.path("out.spz"), b"precious")
        os.chmod(out, 0o444)
        self.fails(["export", self.ply, out], out, "read-only")
        self.assertEqual(read(out), b"precious")
        self.assertEqual(files_below(self.folder), ["out.spz", "small.ply"])

    def test_a_folder_in_the_way_stays(self):
        write(self.path("out.spz/inside"), b"precious")
        self.fails(["export", self.ply, self.path("out.spz")], "out.spz", "folder")
        self.assertEqual(read(self.path("out.spz/inside")), b"precious")

    def test_a_missing_folder_is_named(self):
        self.fails(["export", self.ply, self.path("none/out.spz")], "none")

    def test_a_folder_that_cannot_be_written_to(self):
        os.makedirs(self.path("shut"))
        write(self.path("shut/kept"), b"precious")
        someone = {} if os.geteuid() else self.someone_else()  # root may write to any folder
        os.chmod(self.path("shut"), 0o555)
        self.addCleanup(os.chmod, self.path("shut"), 0o755)
        self.fails(["export", self.ply, self.path("shut/out.spz")], "shut/out.spz", "Permission denied", **someone)
        self.assertEqual(files_below(self.path("shut")), ["kept"])
        os.chmod(self.path("shut"), 0o755)
        self.succeeds("export", self.ply, self.path("shut/out.spz"), **someone)

    def someone_else(self):
        """Returns arguments of run_windows for the user nobody, who owns the test folder, a copy of the program and
        a folder for wine."""
        nobody = pwd.getpwnam("nobody")
        home = os.path.join(self.folder, "home")
        os.makedirs(home)
        program = shutil.copy(WINDOWS, home)
        for where, _, names in os.walk(self.folder):
            for path in [where, *(os.path.join(where, name) for name in names)]:
                os.chown(path, nobody.pw_uid, nobody.pw_gid)
        environment = {**os.environ, "HOME": home, "WINEPREFIX": os.path.join(home, "wine"), "WINEDEBUG": "-all"}
        someone = {
            "user": nobody.pw_uid,
            "group": nobody.pw_gid,
            "extra_groups": [],
            "env": environment,
            "cwd": self.folder,
        }
        self.addCleanup(subprocess.run, ["wineserver", "-k"], **someone)
        return {"program": program, **someone}

    def test_null_device(self):
        for name in ["NUL", "nul"]:
            self.succeeds("info", self.ply, "--json", name, "--quiet", cwd=self.folder)
            self.assertEqual(files_below(self.folder), ["small.ply"])

    def test_json_has_unix_lines(self):
        said = self.succeeds("info", self.ply, "--json", "-")
        self.assertNotIn(b"\r", said.stdout)
        json.loads(said.stdout)
        self.succeeds("info", self.ply, "--json", self.path("out.json"))
        self.assertEqual(read(self.path("out.json")), said.stdout)

    def test_wrong_usage(self):
        self.assertEqual(run_windows("export", self.ply).returncode, 2)
        self.assertEqual(run_windows("nonsense").returncode, 2)


class Interrupt(Case):
    """Tests Ctrl-C, which only reaches programs that have a console; wine gives them one on a terminal."""

    def interrupted(self, when, *arguments):
        """Returns exit code and output of a program that Ctrl-C interrupts after some seconds, or once a file
        exists."""
        helper = os.path.join(os.path.dirname(WINDOWS), "tests", "windows_interrupt.exe")
        if not os.path.exists(helper):
            self.skipTest(f"no {helper}: the build has no tests")
        ours, theirs = pty.openpty()
        shown = []

        def drain():
            try:
                while data := os.read(ours, 65536):
                    shown.append(data)
            except OSError:  # the other end is closed
                pass

        command = ["wine", helper, str(when), *[str(word) for word in arguments]]
        environment = {**os.environ, "WINEDEBUG": "-all"}
        running = subprocess.Popen(command, stdin=theirs, stdout=theirs, stderr=theirs, env=environment)
        threading.Thread(target=drain, daemon=True).start()
        try:
            code = running.wait(timeout=600)
        finally:
            running.kill()
            os.close(theirs)
        return code, b"".join(shown)

    def test_a_program_ends_in_order(self):
        big = write(self.path("big.ply"), ply_bytes(some_splats() * 1000))
        bench = os.path.join(os.path.dirname(WINDOWS), "pags-bench.exe")
        if not os.path.exists(bench):
            self.skipTest(f"no {bench}, which packages don't bring")
        code, shown = self.interrupted(1, drive(bench), "stages", big)
        self.assertEqual(code, 3, shown)

    def test_training_goes_on_where_it_was(self):
        if not has_pictures():
            self.skipTest("this build reads no pictures")
        fixtures.make_dataset(self.path("data"))
        options = ["--iterations", "20000", "--checkpoint-every", "1000", "--threads", "1", "--quiet", *fixtures.SMALL]
        begun = drive(self.path("stopped/checkpoint.pags"))
        code, shown = self.interrupted(
            begun, drive(WINDOWS), "train", self.path("data"), "-o", self.path("stopped"), *options
        )
        self.assertEqual(code, 3, shown)
        half = read(self.path("stopped/background.ply"))
        self.succeeds("train", self.path("data"), "-o", self.path("stopped"), "--resume", *options)
        self.succeeds("train", self.path("data"), "-o", self.path("whole"), *options)
        whole = read(self.path("whole/background.ply"))
        self.assertEqual(read(self.path("stopped/background.ply")), whole)
        self.assertNotEqual(half, whole)  # the program was stopped before its end


def main():
    global WINDOWS, LINUX, PICTURES
    if len(sys.argv) < 3:
        sys.exit("usage: windows.py PAGS.EXE PAGS [TEST...]")
    WINDOWS, LINUX = os.path.abspath(sys.argv.pop(1)), os.path.abspath(sys.argv.pop(1))
    for path in [WINDOWS, LINUX]:
        if not os.path.exists(path):
            sys.exit(f"windows.py: {path} isn't there: run make and make cross TARGET=windows-x64 first")
    with tempfile.TemporaryDirectory(prefix="pags-windows-") as folder:
        PICTURES = write(os.path.join(folder, "small.png"), fixtures.png_bytes(8, 8, bytes(192)))
        write(os.path.join(folder, "small.ply"), ply_bytes(some_splats()))
        unittest.main(verbosity=2)


if __name__ == "__main__":
    main()
