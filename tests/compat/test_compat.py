# SPDX-License-Identifier: Apache-2.0
"""test_compat.py PAGS CORPUS [PROGRAMS [MODULE]]: files and scripts of commit ec025b61 still work, or fail with a
message that names the replacement. CORPUS is the unpacked ec025b61.zip (make_corpus.sh lists its contents). PROGRAMS
is the folder of that commit's C programs, built against the current headers and libraries. MODULE is the folder of
the Python module."""

import json
import os
import re
import shutil
import subprocess
import sys
import tempfile
import unittest

PAGS, CORPUS, *MORE = map(os.path.abspath, sys.argv[1:])
PROGRAMS, MODULE = [*MORE, "", ""][:2]

# Removed on purpose: (verb, option) -> words of the message that names the replacement; JSON output -> removed keys.
GONE_OPTIONS = {}
GONE_KEYS = {}

TRAIN = [
    "train",
    "street",
    "--max-gaussians",
    "150",
    "--checkpoint-every",
    "10",
    "--preview-every",
    "0",
    "--split-every",
    "2",
    "-q",
]
CAMERA = {
    "width": 64,
    "height": 36,
    "fx": 40,
    "fy": 40,
    "cx": 32,
    "cy": 18,
    "camera_from_world_quaternion_wxyz": [1, 0, 0, 0],
    "camera_from_world_translation": [0, 0, 0],
}


def run(*words, **more):
    return subprocess.run([PAGS, *words], capture_output=True, text=True, stdin=subprocess.DEVNULL, timeout=300, **more)


def keys(value, path=""):
    """Returns the paths of all keys of a JSON value; all elements of a list share one path."""
    found = set()
    if isinstance(value, dict):
        for key, inner in value.items():
            found |= {f"{path}/{key}"} | keys(inner, f"{path}/{key}")
    elif isinstance(value, list):
        for inner in value:
            found |= keys(inner, f"{path}[]")
    return found


class Compat(unittest.TestCase):
    def setUp(self):
        folder = tempfile.TemporaryDirectory(prefix="pags-compat-")
        self.addCleanup(folder.cleanup)
        self.work = os.path.join(folder.name, "made by ec025b61")
        shutil.copytree(CORPUS, self.work)
        with open(self.path("camera.json"), "w", encoding="utf-8") as file:
            json.dump(CAMERA, file)

    def path(self, *names):
        return os.path.join(self.work, *names)

    def read(self, *names):
        with open(self.path(*names), encoding="utf-8") as file:
            return file.read()

    def succeeds(self, *words, **more):
        done = run(*words, cwd=self.work, **more)
        self.assertEqual(done.returncode, 0, f"{words}: {done.stderr}")
        return done

    def test_scenes(self):
        """Reads and draws the old scene folder, packed file and SPZ file."""
        for name in ("scene", "scene.pagsz", "scene.spz"):
            with self.subTest(name):
                self.succeeds("info", name)
                self.succeeds("render", name, "--camera", "camera.json", "-o", f"{name} pictures", "-q")
                self.assertEqual(os.listdir(self.path(f"{name} pictures")), ["00000.png"])

    def test_checkpoint(self):
        """Training resumes from the old checkpoint."""
        self.succeeds("info", "scene/checkpoint.pags")
        self.succeeds(*TRAIN, "-o", "scene", "-n", "30", "--resume", "--json", "now.json")
        now = json.loads(self.read("now.json"))
        self.assertTrue(now["resumed"])
        self.assertEqual(now["iterations"], 30)

    def test_json(self):
        """The JSON outputs still have every key of the old ones."""
        commands = {
            "train": [*TRAIN, "-o", "again", "-n", "20"],
            "render": ["render", "scene", "--split", "test", "-o", "pictures", "-q"],
            "eval": ["eval", "scene", "--dataset", "street", "-q"],
            "export": ["export", "scene", "scene.glb", "-q"],
            "info": ["info", "scene"],
            "info_dataset": ["info", "street"],
        }
        if "proxies" not in re.search(r"^with:(.*)", run("--version").stdout, re.M)[1].split():
            del commands["export"]
        for name, words in commands.items():
            with self.subTest(name):
                self.succeeds(*words, "--json", f"{name}.json")
                then, now = (
                    keys(json.loads(self.read(*path))) for path in (["json", f"{name}.json"], [f"{name}.json"])
                )
                self.assertEqual(then - now - set(GONE_KEYS.get(name, ())), set())

    def test_options(self):
        """Every old option of every verb is in the help or accepted, or the message names its replacement."""
        for name in sorted(os.listdir(self.path("help"))):
            verb = name.removesuffix(".txt")
            if verb == "pags":
                continue
            now = self.succeeds(verb, "--help").stdout
            for option in sorted(set(re.findall(r"^ +(?:-\w, )?(--[a-z][a-z-]*)", self.read("help", name), re.M))):
                if re.search(rf"{option}(?![\w-])", now):
                    continue
                with self.subTest(f"{verb} {option}"):
                    said = run(verb, "scene", option, cwd=self.work).stderr
                    accepted = "unknown option" not in said
                    self.assertTrue(accepted or (verb, option) in GONE_OPTIONS, said)
                    self.assertIn(GONE_OPTIONS.get((verb, option), ""), said)

    def test_fields(self):
        """Every old field of the training is still listed, or only its default is accepted and any other value is
        refused by name."""
        fields = self.read("fields.txt")
        now = set(re.findall(r"^  (\w+) ", run("train", "--fields").stdout, re.M))
        for name in sorted(set(re.findall(r"^  (\w+) +\S", fields, re.M)) - now):
            with self.subTest(name):
                default = re.search(rf"^  {name} .*?default\s+([^\s\];:]+)", fields, re.M | re.S)[1]
                train = ["train", "street", "-o", name, "-n", "1", "--overwrite", "-q", "--set"]
                self.succeeds(*train, f"{name}={default}")
                refused = run(*train, f"{name}=0.12345", cwd=self.work)
                self.assertEqual(refused.returncode, 2)
                self.assertRegex(refused.stderr, rf"{name}: always|{name} is now")

    def test_programs(self):
        """C programs written against the old headers still run."""
        if not PROGRAMS:
            self.skipTest("the C programs are not built")
        programs = {
            "first": ["scene", "camera.json", "picture.ppm"],
            "pick": ["scene", "camera.json", "32", "18"],
            "train": ["street", "trained", "10"],
        }
        for name, words in programs.items():
            with self.subTest(name):
                done = subprocess.run(
                    [os.path.join(PROGRAMS, f"compat_{name}"), *words], cwd=self.work, capture_output=True, text=True
                )
                self.assertEqual(done.returncode, 0, done.stderr)

    def test_python(self):
        """Python scripts written for the old module still run."""
        if not MODULE:
            self.skipTest("the Python module is not built")
        script = self.path("programs", "first.py")
        done = subprocess.run(
            [sys.executable, "-B", script, "scene"],
            cwd=self.work,
            env={**os.environ, "PYTHONPATH": MODULE},
            capture_output=True,
            text=True,
        )
        self.assertEqual(done.returncode, 0, done.stderr)
        self.assertIn("(64, 36)", done.stdout)


if __name__ == "__main__":
    unittest.main(argv=[sys.argv[0], "-v"])
