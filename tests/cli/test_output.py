# SPDX-License-Identifier: Apache-2.0
"""Tests standard output that is full, closed or a broken pipe, warnings on standard error, and file names that aren't
UTF-8."""

import json
import os
import subprocess
import unittest

import fixtures
from fixtures import SMALL, DataCase, program, read, run

LATIN = os.fsdecode(b"stra\xdfe")  # a folder's name in Latin-1, as on old disks; it isn't UTF-8


class OutputCase(DataCase):
    @classmethod
    def setUpClass(cls):
        super().setUpClass()
        cls.scene = os.path.join(cls.shared_folder(), "scene")
        done = run("train", cls.data, "-o", cls.scene, "-n", 2, *SMALL)
        assert done.returncode == 0, done.stderr

    def train(self):
        return ["train", self.data, "-n", 1, "-o", self.path("trained"), *SMALL]


class Unwritable(OutputCase):
    @unittest.skipUnless(os.path.exists("/dev/full"), "no /dev/full")
    def test_full(self):
        splats = self.path("a.ply")
        for words in [
            ["--help"],
            ["--version"],
            ["render", "-h"],
            ["train", "--fields"],
            ["info", self.data],
            ["info", self.scene, "--json", "-"],
            ["eval", self.scene],
            ["export", self.scene, splats],
            self.train(),
            ["pags-bench", "-h"],
        ]:
            if words[0] == "pags-bench" and not os.path.exists(program(words)[0]):
                continue
            with self.subTest(words), open("/dev/full", "w") as full:
                done = subprocess.run(program(words), stdout=full, stderr=subprocess.PIPE, text=True)
                self.assertEqual(
                    (done.returncode, done.stderr.count("standard output: No space left on device")),
                    (1, 1),
                    done.stderr,
                )
        for path in [splats, self.path("trained", "scene.json")]:
            self.assertTrue(os.path.exists(path), "files are written nevertheless")
        self.succeeds("info", self.scene, "--quiet", stdout=None)

    def closed(self, *words):
        return subprocess.run(["sh", "-c", 'exec "$@" >&-', "sh", *program(words)], stderr=subprocess.PIPE, text=True)

    def test_closed(self):
        """Standard output is closed. A command whose answer goes there fails, any other succeeds. No file gets the
        descriptor of standard output and thus its text."""
        for words in [
            ["--version"],
            ["render", "-h"],
            ["train", "--fields"],
            ["info", self.data],
            ["info", self.data, "--json", "-"],
            ["eval", self.scene],
        ]:
            done = self.closed(*words)
            self.assertEqual((done.returncode, done.stderr.count("standard output")), (1, 1), done)
        self.succeeds("export", self.scene, self.path("a.ply"))
        for words in [
            ["export", self.scene, self.path("b.ply")],
            ["info", self.data, "--json", self.path("a.json")],
            self.train(),
        ]:
            done = self.closed(*words)
            self.assertEqual((done.returncode, done.stderr), (0, ""), done)
        self.assertEqual(read(self.path("a.ply")), read(self.path("b.ply")))
        json.loads(read(self.path("a.json")))

    def test_broken_pipe(self):
        """The reader has closed the pipe. The program finishes its work, then its exit code reports the broken pipe."""
        ends = os.pipe()
        os.close(ends[0])
        done = subprocess.run(program(self.train()), stdout=ends[1], stderr=subprocess.PIPE, text=True)
        os.close(ends[1])
        self.assertEqual((done.returncode, done.stderr), (1, "pags: standard output: Broken pipe\n"))
        self.succeeds("info", self.path("trained"))


class OtherBytes(OutputCase):
    """File names that aren't UTF-8 are escaped where a text must be UTF-8. The program still finds the files."""

    def json_of(self, *names):
        with open(self.path(*names), encoding="utf-8") as file:
            return json.load(file)

    def succeeds_in_bytes(self, *words, **more):
        done = run(*words, errors="surrogateescape", **more)
        self.assertEqual(done.returncode, 0, done.stderr)
        return done

    def test_folder(self):
        data, scene = self.path(LATIN, "D"), self.path(LATIN, "S")
        fixtures.make_dataset(data, views=9)
        self.succeeds_in_bytes("train", data, "-o", scene, "-n", 2, "--log-every", 1, *SMALL)
        self.succeeds_in_bytes("train", data, "-o", scene, "-n", 3, "--resume", *SMALL)
        self.assertEqual(self.json_of(LATIN, "S", "scene.json")["dataset"], data)
        self.succeeds_in_bytes("eval", "S", "--json", "../e.json", cwd=self.path(LATIN))
        self.assertGreater(self.json_of("e.json")["test"]["views"], 0)
        self.assertIn(LATIN, self.json_of(LATIN, "S", "report.json")["command_line"])
        with open(self.path(LATIN, "S", "report.html"), encoding="utf-8") as page:
            self.assertIn(r"stra\xDFe", page.read())
        self.succeeds_in_bytes(
            "render", scene, "--split", "test", "-o", self.path(LATIN, "R"), "--json", self.path("r.json")
        )
        self.json_of("r.json")

    def test_photographs(self):
        """A photograph's name isn't UTF-8. The data set's JSON and the scene hold it with the escape that Python
        writes. glTF holds a readable form."""
        data = self.path("D")
        fixtures.make_dataset(data, views=9)
        with open(os.path.join(data, "transforms.json"), encoding="utf-8") as file:
            table = json.load(file)
        for frame in table["frames"]:
            old = frame["file_path"]
            frame["file_path"] = os.path.join(os.path.dirname(old), LATIN + os.path.basename(old))
            os.rename(os.path.join(data, old), os.path.join(data, frame["file_path"]))
        fixtures.write(os.path.join(data, "transforms.json"), json.dumps(table))
        self.succeeds_in_bytes("train", data, "-o", self.path("S"), "-n", 2, *SMALL)
        names = {view["name"] for view in self.json_of("S", "scene.json")["cameras"]}
        self.assertLessEqual(names, {os.path.basename(frame["file_path"]) for frame in table["frames"]})
        self.succeeds_in_bytes("eval", self.path("S"), "--json", self.path("e.json"))
        if run("export", "--help").returncode == 0:
            self.succeeds_in_bytes("export", self.path("S"), self.path(f"a {LATIN}.gltf"), "--splats")
            text = self.json_of(f"a {LATIN}.gltf")
            self.assertEqual(text["buffers"][0]["uri"], "a%20stra%DFe.bin")
            self.succeeds_in_bytes("info", self.path(f"a {LATIN}.gltf"))


if __name__ == "__main__":
    fixtures.main()
