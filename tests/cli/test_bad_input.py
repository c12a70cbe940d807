# SPDX-License-Identifier: Apache-2.0
"""Bad input gives exit code 1, one line on stderr that names file and place, and no partial output."""

import json
import os
import struct

import fixtures
import scenes
from fixtures import FRONT, Case, files_below, make_dataset, ply_bytes, png_bytes, read, some_splats


class BadSplats(Case):
    def refused(self, path, *words):
        """Asserts that render and info refuse the file. render must not create its output folder."""
        out = self.path("out")
        self.fails(["render", path, "-o", out], path, *words)
        self.assertFalse(os.path.exists(out), files_below(self.folder))
        self.fails(["info", path], path, *words)

    def test_missing(self):
        self.refused(self.path("missing.ply"), "No such file")

    def test_truncated_ply(self):
        whole = ply_bytes(some_splats())
        for length in [len(whole) - 1, len(whole) - 100, len(whole) // 2, 200, 40, 3]:
            self.refused(self.write(f"cut{length}.ply", whole[:length]))

    def test_nan_in_ply(self):
        """A row with a value that isn't finite is left out and reported. A file that has only such rows is refused."""
        for column, name in [(0, "x"), (9, "opacity"), (10, "scale_0"), (13, "rot_0"), (6, "f_dc_0")]:
            rows = some_splats()
            rows[7][column] = float("nan")
            path = self.write(f"nan_{name}.ply", ply_bytes(rows))
            self.assertIn("1 of 40 Gaussians are left out", self.succeeds("info", path).stderr)
            self.fails(["info", path, "--strict"], "the first is 7")
            self.refused(self.write(f"all_{name}.ply", ply_bytes(rows[7:8])), "Gaussian 0")
        rows = some_splats()
        rows[3][1] = float("inf")
        self.fails(["info", self.write("inf.ply", ply_bytes(rows)), "--strict"], "the first is 3")

    def test_ply_shorter_than_its_count(self):
        text = ply_bytes(some_splats()).replace(b"vertex 40", b"vertex 9000000000000000000")
        self.refused(self.write("count.ply", text))

    def test_ply_without_positions(self):
        text = ply_bytes(some_splats()).replace(b"float x\n", b"float q\n")
        self.refused(self.write("names.ply", text), "x")

    def test_empty_and_foreign_files(self):
        self.refused(self.write("empty.ply", b""))
        self.refused(self.write("text.ply", b"hello world\n"))
        self.refused(self.write("cut.spz", b"NGSP" + struct.pack("<III", 4, 100, 0)))
        self.refused(self.write("gz.spz", b"\x1f\x8b\x08\0\0\0\0\0\0\0"))
        self.refused(self.write("odd.splat", b"\1" * 33))


class BadScenes(Case):
    def refused(self, *words):
        self.fails(["render", self.path("scene"), "-o", self.path("out")], *words)
        self.assertFalse(os.path.exists(self.path("out")))

    def test_wrong_json(self):
        self.write("scene/scene.json", '{\n "version": 1,\n "models": [}\n')
        self.refused("scene.json:3")

    def test_json_that_is_no_scene(self):
        self.write("scene/scene.json", "[1, 2]\n")
        self.refused("scene.json")

    def test_empty_folder(self):
        os.makedirs(self.path("scene"))
        self.refused(self.path("scene"))

    def test_poses_that_overflow(self):
        """A finite pose or correction is refused if calculations with it overflow."""
        scenes.make_scene(self.path("scene"))
        good = json.loads(read(self.path("scene/scene.json")))
        for key, value in [
            ("rotation", [1e300, 0, 0]),
            ("translation", [0, 1e300, 0]),
            ("world_from_object", [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 1e200]),
        ]:
            bad = json.loads(json.dumps(good))
            bad["objects"][1]["knots"][2][key] = value
            self.write("scene/scene.json", json.dumps(bad))
            self.refused("scene.json:1: a pose", "expected at most")
        for key, value in [("origin", [0, 1e300, 0]), ("background", [1e300, 0, 0])]:
            self.write("scene/scene.json", json.dumps({**good, key: value}))
            self.refused("scene.json:1: expected numbers from -1e+12 to 1e+12", key)
        for key, value, words in [
            ("gain", [1e300, 1, 1], "'gain'"),
            ("camera_from_world_translation", [0, 0, 1e300], " away; expected at most 1e12"),
        ]:
            bad = json.loads(json.dumps(good))
            bad["cameras"][1][key] = value
            self.write("scene/scene.json", json.dumps(bad))
            self.refused("scene.json:1", words)


class BadCameras(Case):
    def test_cameras(self):
        scene = self.write("a.ply", ply_bytes(some_splats()))
        good = {**FRONT, "camera_from_world_translation": [0, 0, 5]}
        bad = {
            "no_fx.json": {key: value for key, value in good.items() if key != "fx"},
            "width.json": {**good, "width": -3},
            "huge.json": {**good, "width": 1e9},
            "focal.json": {**good, "fy": 0},
            "short.json": {**good, "camera_from_world_translation": [0, 0]},
            "word.json": {**good, "fx": "wide"},
        }
        for name, camera in bad.items():
            path = self.write(name, json.dumps(camera))
            self.fails(["render", scene, "--camera", path, "-o", self.path("out")], path)
        cut = self.write("cut.json", json.dumps(good, indent=1)[:60])
        self.fails(["render", scene, "--camera", cut, "-o", self.path("out")], cut + ":")
        self.assertFalse(os.path.exists(self.path("out")))
        whole = self.write("good.json", json.dumps(good))
        self.succeeds("render", scene, "--camera", whole, "-o", self.path("out"))
        self.assertEqual(files_below(self.path("out")), ["00000.png"])


class BadOutput(Case):
    def test_render(self):
        scene = self.write("a.ply", ply_bytes(some_splats()))
        blocker = self.write("file", b"in the way")
        for out in [blocker, os.path.join(blocker, "below"), "/proc/pags-test"]:
            self.fails(["render", scene, "-n", "1", "-o", out], blocker if out.startswith(blocker) else out)
        self.fails(["render", scene, "-n", "1", "-o", self.path("out"), "--json", "/proc/x.json"], "/proc/x.json")
        self.fails(["info", scene, "--json", self.folder], self.folder)
        self.assertEqual(files_below(self.folder), ["a.ply", "file"])
        self.assertEqual(read(blocker), b"in the way")

    def test_train(self):
        data = make_dataset(self.path("data"), views=3, width=16, height=12)
        blocker = self.write("file", b"in the way")
        before = files_below(self.folder)
        for out in [blocker, os.path.join(blocker, "below"), "/proc/pags-test"]:
            named = blocker if out.startswith(blocker) else out
            self.fails(["train", data, "-o", out, "--iterations", "5", "-q"], named)
        self.write("full/something", b"mine")
        self.fails(["train", data, "-o", self.path("full"), "--iterations", "5"], self.path("full"), "--overwrite")
        self.assertEqual(files_below(self.folder), sorted([*before, "full/something"]))


class BadDatasets(Case):
    def refused(self, path, *words):
        self.fails(["train", path, "-o", self.path("out"), "--iterations", "5", "--quiet"], *words)
        self.assertFalse(os.path.exists(self.path("out")), files_below(self.folder))
        self.fails(["info", path], *words)

    def change(self, **more):
        """Changes keys of the data set's transforms.json; returns the data set."""
        path = self.path("data", "transforms.json")
        transforms = json.loads(read(path))
        self.write("data/transforms.json", json.dumps({**transforms, **more}, indent=1))
        return self.path("data")

    def setUp(self):
        super().setUp()
        self.data = make_dataset(self.path("data"), views=3, width=16, height=12)

    def test_no_data_set(self):
        os.makedirs(self.path("nothing"))
        self.refused(self.path("nothing"), self.path("nothing"), "not a data set")
        self.refused(self.path("absent"), self.path("absent"))

    def test_zero_images(self):
        self.refused(self.change(frames=[]), "transforms.json", "at least one image")

    def test_wrong_json(self):
        whole = read(self.path("data", "transforms.json"))
        self.write("data/transforms.json", whole[: len(whole) // 2])
        self.refused(self.data, "transforms.json:")
        self.write("data/transforms.json", "{}")
        self.refused(self.data, "transforms.json:1")

    def test_wrong_values(self):
        self.refused(self.change(fl_x="wide"), "transforms.json:", "fl_x")
        self.refused(self.change(fl_x=-5), "transforms.json")
        frames = json.loads(read(self.path("data", "transforms.json")))["frames"]
        frames[1]["transform_matrix"][0] = [1, 2, 3]
        self.refused(self.change(fl_x=60, frames=frames), "transforms.json:", "transform_matrix")

    def test_missing_image(self):
        os.remove(self.path("data", "images", "001.png"))
        self.refused(self.data, "001.png", "--allow-missing")
        self.succeeds("info", self.data, "--allow-missing")

    def test_four_byte_png(self):
        self.write("data/images/001.png", b"\x89PNG")
        self.refused(self.data, "001.png")

    def test_cut_png(self):
        # The header is complete. Only decoding finds the fault, after training has begun.
        path = self.path("data", "images", "001.png")
        whole = read(path)
        self.write("data/images/001.png", whole[: len(whole) * 2 // 3])
        # libpng leaves OpenImageIO's reader by longjmp. This leaks a string of OpenImageIO; it isn't a leak of this
        # program.
        environment = {**os.environ, "ASAN_OPTIONS": "detect_leaks=0"}
        arguments = ["train", self.data, "-o", self.path("out"), "--iterations", "30", "--quiet"]
        self.fails(arguments, "001.png", env=environment)
        self.assertFalse(os.path.exists(self.path("out")), files_below(self.folder))

    def test_wrong_size(self):
        self.write("data/images/001.png", png_bytes(7, 9, bytes(7 * 9 * 3)))
        self.refused(self.data, "001.png", "7 x 9")


class BadEvaluation(Case):
    def test_eval(self):
        scene = self.write("a.ply", ply_bytes(some_splats()))
        data = make_dataset(self.path("data"), views=3, width=16, height=12)
        self.fails(["eval", scene], scene, "--dataset")
        self.fails(["eval", scene, "--dataset", self.path("none")], self.path("none"))
        weights = self.write("weights.npz", b"PK")
        self.fails(["eval", scene, "--dataset", data, "--lpips-weights", weights], weights)


if __name__ == "__main__":
    fixtures.main()
