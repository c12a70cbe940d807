# SPDX-License-Identifier: Apache-2.0
"""Tests captures as users have them: several COLMAP models, names of other systems, stated splits, formats of other
programs. A run is also resumed with another data set."""

import json
import os
import shutil

import fixtures
from fixtures import SMALL, Case, DataCase, files_below, png_bytes, read, run, write

GREY = png_bytes(16, 12, bytes([90]) * (16 * 12 * 3))
CAMERA = "1 PINHOLE 16 12 20 20 8 6\n"


def colmap_text(names, first=0):
    """Returns the text of an images.txt file. The cameras stand in a row and look along z."""
    return "".join(f"{i + 1} 1 0 0 0 {-i - first} 0 0 1 {name}\n\n" for i, name in enumerate(names))


class Colmap(Case):
    """Tests COLMAP models of the pictures 0.png, 1.png and so on."""

    def pictures(self, count=6, folder="images", ending=".png"):
        for i in range(count):
            self.write(f"{folder}/{i}{ending}", GREY)
        return [f"{i}{ending}" for i in range(count)]

    def model(self, folder, names):
        self.write(f"{folder}/cameras.txt", CAMERA)
        self.write(f"{folder}/images.txt", colmap_text(names))

    def info(self, *more):
        """Returns the JSON that `info` writes, and the lines that it prints."""
        done = self.succeeds("info", self.folder, "--json", self.path("out.json"), *more)
        return json.loads(read(self.path("out.json"))), done.stdout

    def views(self, facts):
        return facts["views_train"] + facts["views_test"]

    def warning(self, facts, *words):
        self.assertEqual(len(facts["warnings"]), 1, facts["warnings"])
        for word in words:
            self.assertIn(word, facts["warnings"][0])

    def test_largest_model_is_used(self):
        names = self.pictures()
        self.model("sparse/0", names[:2])
        self.model("sparse/1", names)
        facts, _ = self.info()
        self.assertEqual(self.views(facts), 6)
        self.warning(facts, "2 COLMAP models", "sparse/1 with 6 pictures", "sparse/0 with 2")
        self.assertIn("because of --strict", run("info", self.folder, "--strict").stderr)
        facts, _ = self.info("--colmap", "sparse/0")
        self.assertEqual(self.views(facts), 2)
        self.warning(facts, "4 of 6 pictures", "images/2.png")
        self.assertEqual(self.views(self.info("--colmap", "sparse")[0]), 6)

    def test_copies_are_no_warning(self):
        names = self.pictures()
        self.model("sparse/0", names)
        self.model("sparse/1", names)
        facts, printed = self.info("--strict")
        self.assertEqual(facts["warnings"], [])
        self.assertIn("sparse/1", printed)

    def test_models_in_subfolders(self):
        for model, images in [
            ("sparse/1", "images"),
            ("dense/sparse", "dense/images"),
            ("reconstruction", "images"),
            ("a/b/c/0", "images"),
        ]:
            with self.subTest(model):
                self.folder = self.path(model.replace("/", "_"))
                self.model(model, self.pictures(folder=images))
                facts, _ = self.info("--strict")
                self.assertEqual(self.views(facts), 6)
                self.folder = os.path.dirname(self.folder)

    def test_several_captures(self):
        """The first capture by name is used, with a warning. Models of the same pictures cause no warning."""
        self.model("a/reconstruction", self.pictures(5, "a/images"))
        self.model("b/sparse/0", self.pictures(6, "b/images"))
        self.model("c/sparse", self.pictures(5, "c/images"))
        facts, _ = self.info()
        self.assertEqual(self.views(facts), 5)
        self.warning(
            facts, f"{self.folder}: holds 3 data sets: a/reconstruction is used, and 2 left out, the first is b/sparse"
        )
        for verb in [["info", self.folder], ["train", self.folder, "-o", self.path("out")]]:
            self.fails([*verb, "--strict"], "b/sparse", "because of --strict")
        shutil.rmtree(self.path("b"))
        self.warning(self.info()[0], "2 data sets", "the first is c/sparse")
        shutil.rmtree(self.path("c"))
        self.write("c/transforms.json", "{}")
        self.warning(self.info()[0], "2 data sets", "the first is c (")
        shutil.rmtree(self.path("c"))
        self.model("distorted/sparse", self.pictures(5, "a/images"))
        facts, printed = self.info("--strict")
        self.assertIn("the first is distorted/sparse", printed)

    def test_windows_paths(self):
        self.pictures(folder="images/Left")
        self.model("sparse/0", [f"Left\\{i}.png" for i in range(6)])
        facts, _ = self.info()
        self.warning(
            facts, "6 of 6 pictures are found by reading backslashes as slashes", "images/Left/0.png for 'Left\\0.png'"
        )
        self.assertEqual(facts["views_missing"], 0)

    def test_letter_case_and_extension(self):
        self.pictures(5)
        self.write("images/5.PNG", GREY)
        self.model("sparse/0", [f"{i}.JPG" for i in range(5)] + ["5.png"])
        facts, _ = self.info()
        self.assertEqual(self.views(facts), 6)
        self.assertEqual(len(facts["warnings"]), 2)
        self.assertIn("1 of 6 pictures are found in other letter case", facts["warnings"][0])
        self.assertIn("5 of 6 pictures are found with another extension", facts["warnings"][1])

    def test_folder_in_other_letter_case(self):
        self.model("sparse/0", self.pictures(folder="Images"))
        facts, _ = self.info()
        self.assertEqual(self.views(facts), 6)
        self.warning(facts, "there is no folder images", "/Images")

    def test_two_pictures_with_one_stem(self):
        """A name that matches two pictures is refused, since either picture may be meant."""
        names = self.pictures()
        self.write("images/0.jpg", GREY)
        self.model("sparse/0", ["0.tif"] + names[1:])
        self.fails(["info", self.folder], "no such image", "images/0.tif", "1 of 6")

    def test_lists_of_held_out_pictures(self):
        names = self.pictures()
        self.model("sparse/0", names)
        self.write("sparse/0/test.txt", "1.png\n4\n")
        facts, printed = self.info("--strict")
        self.assertEqual((facts["views_train"], facts["views_test"]), (4, 2))
        self.assertIn("held out by test.txt", printed)
        facts, printed = self.info("--split-every", "3")
        self.assertIn("by --split-every, not those of test.txt", printed)
        self.write("sparse/0/test.txt", "1.png\nnone.png\n")
        self.warning(self.info()[0], "1 of its 2 names are of no picture")

    def test_images_without_their_empty_lines(self):
        """images.txt may lack its empty lines of observations. The line after an image then is the next image, whatever
        words its name has. Comments may stand between images."""
        for pattern in ("{}.png", "a ({}).png", "a b {}.png", "{} 1 2", "a b c d e {}.png"):
            for end in ("\n", "\r\n"):
                names = [pattern.format(i) for i in range(6)]
                for name in names:
                    self.write(f"images/{name}", GREY)
                self.model("sparse/0", names)
                text = colmap_text(names).replace("1 0 0 0", "0.9 0.1 0.3 0.3").replace("\n", end)
                self.write(
                    "sparse/0/images.txt",
                    text.replace(end + end, end + "# observations" + end + "  1.5 2.5 -1  3 4 7 " + end),
                )
                self.assertEqual(self.views(self.info()[0]), 6, pattern)
                self.write("sparse/0/images.txt", text.replace(end + end, end))
                self.fails(
                    ["info", self.folder], "images.txt:2: expected a line of observations", "empty lines missing"
                )
                shutil.rmtree(self.path("images"))

    def test_unused_and_unknown_cameras(self):
        names = self.pictures()
        self.model("sparse/0", names)
        self.write("sparse/0/cameras.txt", CAMERA + "7 OPENCV 16 12 -1.#IND 1 1 1 0 0 0 0\n8 SOMETHING 3 4\n")
        self.assertEqual(self.info("--strict")[0]["warnings"], [])
        self.write("sparse/0/cameras.txt", "1 EQUIRECTANGULAR 16 12 16 12\n")
        self.assertIn("views keep their lens", self.succeeds("info", self.folder).stdout)
        self.write("sparse/0/cameras.txt", "1 PINHOLE 16 12 0.02 0.02 8 6\n")
        self.fails(["info", self.folder], "an angle of view of 180 degrees", "millimetres")

    def test_distortion_that_folds(self):
        """A distortion that can't be undone in the corners causes a warning. One that can't be undone in much of the
        picture is refused."""
        self.model("sparse/0", self.pictures())
        self.write("sparse/0/cameras.txt", "1 SIMPLE_RADIAL 16 12 10 8 6 -0.21\n")
        self.warning(self.info()[0], "the distortion can't be undone at up to", "of a picture", "0.png")
        self.write("sparse/0/cameras.txt", "1 SIMPLE_RADIAL 16 12 10 8 6 -1\n")
        self.fails(["info", self.folder], "can't be undone at", "stops growing 4 pixels from the centre")


class Remembered(DataCase):
    """A scene remembers the COLMAP model that it was trained with."""

    def test_eval_finds_the_model(self):
        data, scene = self.path("data"), self.path("scene")
        names = [os.path.basename(name) for name in files_below(self.data) if name.endswith(".png")]
        shutil.copytree(self.data, data)
        write(os.path.join(data, "other/cameras.txt"), "1 PINHOLE 64 48 60 60 32 24\n")
        write(os.path.join(data, "other/images.txt"), colmap_text(names))
        self.succeeds("train", data, "-o", scene, "-n", "1", "--colmap", "other", *SMALL)
        self.assertEqual(json.loads(read(os.path.join(scene, "scene.json")))["colmap"], "other")
        self.succeeds("eval", scene)

    def test_resume_with_another_data_set(self):
        data, scene = self.path("data"), self.path("scene")
        shutil.copytree(self.data, data)
        again = ["train", data, "-o", scene, "--resume", "-n", "3", *SMALL]
        self.succeeds("train", data, "-o", scene, "-n", "2", "-q", *SMALL)
        with open(os.path.join(data, "transforms.json")) as file:
            good = json.load(file)
        for change, word in [
            (lambda d: d["frames"].pop(), "it has 8 views now, not 9"),
            (lambda d: d.update(fl_x=70.0), "the camera of 000.png has focal lengths 70, 60"),
            (lambda d: d["frames"][3]["transform_matrix"][0].__setitem__(3, 9.0), "the camera of 003.png stands"),
        ]:
            changed = json.loads(json.dumps(good))
            change(changed)
            write(os.path.join(data, "transforms.json"), json.dumps(changed))
            self.fails(again, "belongs to other views", word, "--overwrite")
        write(os.path.join(data, "transforms.json"), json.dumps(good))
        self.succeeds(*again)


class Transforms(DataCase):
    """Tests variants of one transforms.json."""

    def setUp(self):
        super().setUp()
        shutil.copytree(self.data, self.path("data"))
        self.data = self.path("data")
        with open(os.path.join(self.data, "transforms.json")) as file:
            self.content = json.load(file)

    def save(self, name="transforms.json", frames=None, **more):
        content = {**self.content, **more, "frames": self.content["frames"] if frames is None else frames}
        write(os.path.join(self.data, name), json.dumps({k: v for k, v in content.items() if v is not None}))

    def info(self, *more):
        done = self.succeeds("info", self.data, "--json", self.path("out.json"), *more)
        return json.loads(read(self.path("out.json"))), done.stdout

    def test_lists_of_a_split(self):
        names = [frame["file_path"] for frame in self.content["frames"]]
        self.save(
            train_filenames=names[:6],
            val_filenames=["./" + names[6]],
            test_filenames=[names[7].replace("/", "\\"), names[8]],
        )
        facts, printed = self.info("--strict")
        self.assertEqual((facts["views_train"], facts["views_test"]), (6, 3))
        self.assertIn("3 of 9 views are held out by its lists of file names", printed)
        self.save(train_filenames=names[:5] + [names[7]], test_filenames=names[6:8] + ["images/none.png"])
        facts, _ = self.info()
        self.assertEqual((facts["views_train"], facts["views_test"]), (5, 2))
        words = [
            "1 pictures are in train_filenames and held out, too",
            "1 of 8 names",
            "2 frames are in none of its lists",
        ]
        self.assertEqual(len(facts["warnings"]), 3, facts["warnings"])
        for word, line in zip(words, facts["warnings"]):
            self.assertIn(word, line)
        self.save(train_filenames=["frames/1.png"])
        self.fails(["info", self.data], "none of its 9 frames is in train_filenames")
        self.save(train_filenames=[], test_filenames=[])
        self.assertEqual(self.info("--strict")[0]["views_test"], 2)
        self.save(test_filenames=names[:1])
        self.assertEqual(self.info()[0]["views_train"], 8)

    def test_pictures_beside_the_listed_ones(self):
        write(
            os.path.join(self.data, "images/000.jpg"), GREY
        )  # a copy in another format and a mask aren't counted as left out
        write(os.path.join(self.data, "images/001.png.png"), GREY)
        self.assertEqual(self.info()[0]["warnings"], [])
        self.save(frames=self.content["frames"][:6])
        facts, _ = self.info()
        self.assertEqual(len(facts["warnings"]), 1, facts["warnings"])
        self.assertIn("3 of 11 pictures in the folders of the ones used are not in it", facts["warnings"][0])
        self.save("transforms_train.json")
        self.assertIn("transforms.json is used", self.info()[0]["warnings"][0])
        self.save(cx=0.5, cy=0.5)
        self.assertIn("9 of 9 cameras have their principal point at the edge", self.info()[0]["warnings"][1])
        self.save(fl_x=5.0, fl_y=5.0)
        self.assertIn("9 of 9 views have unlikely intrinsics", self.info()[0]["warnings"][1])
        self.save(k1=5000.0)
        self.fails(["info", self.data], "its distortion leaves", "of 64 x 48")

    def split_files(self):
        os.remove(os.path.join(self.data, "transforms.json"))
        frames = self.content["frames"]
        self.save("transforms_train.json", frames[:5])
        self.save("transforms_val.json", frames[5:6])
        self.save("transforms_test.json", frames[6:])

    def test_files_of_a_split(self):
        self.split_files()
        facts, _ = self.info("--strict")
        self.assertEqual((facts["views_train"], facts["views_test"]), (5, 4))
        scene = self.path("scene")
        self.succeeds("train", self.data, "-o", scene, "-n", "1", "-q", *SMALL)
        held_out = {
            view["name"] for view in json.loads(read(os.path.join(scene, "scene.json")))["cameras"] if view["test"]
        }
        self.assertEqual({os.path.basename(name) for name in held_out}, {"005.png", "006.png", "007.png", "008.png"})
        os.remove(os.path.join(self.data, "transforms_val.json"))
        os.remove(os.path.join(self.data, "transforms_test.json"))
        self.assertEqual(self.info()[0]["views_test"], 1)

    def test_eval_on_a_given_test_file(self):
        self.split_files()
        scene, train, test = (
            self.path("scene"),
            os.path.join(self.data, "transforms_train.json"),
            os.path.join(self.data, "transforms_test.json"),
        )
        self.succeeds("train", train, "--split-every", "0", "-o", scene, "-n", "1", "-q", *SMALL)
        done = self.succeeds("eval", scene, "--dataset", test, "--json", self.path("out.json"))
        scores = json.loads(read(self.path("out.json")))
        self.assertEqual((scores["train"]["views"], scores["test"]["views"]), (0, 3))
        self.assertIn("all 3 count as held out", done.stdout)
        done = self.succeeds("eval", scene, "--dataset", self.path("data"), "--split", "train")
        self.save("transforms_some.json", self.content["frames"][3:5])
        done = self.succeeds("eval", scene, "--dataset", os.path.join(self.data, "transforms_some.json"))
        self.assertIn("3 of the scene's 5 views are not in it", done.stdout)

    def test_paths_of_other_machines(self):
        write(os.path.join(self.data, "mattes", "0.png"), png_bytes(64, 48, bytes([255]) * (64 * 48 * 3)))
        for prefix in ["C:\\Users\\x\\data\\", "/home/x/data/", "../data2/"]:
            frames = [{**f, "file_path": prefix + f["file_path"]} for f in self.content["frames"]]
            self.save(frames=frames)
            facts, _ = self.info()
            self.assertEqual(len(facts["warnings"]), 1, facts["warnings"])
            self.assertIn(
                "9 of 9 files are found below this folder, not below the one that they name", facts["warnings"][0]
            )
        self.save(
            frames=[
                {**f, "file_path": f["file_path"].replace("/", "\\"), "mask_path": "Mattes\\0.png"}
                for f in self.content["frames"]
            ]
        )
        facts, _ = self.info()
        self.assertEqual(len(facts["warnings"]), 2, facts["warnings"])

    def scaled(self, *scales):
        """Returns the frames. The axes of the first cameras are multiplied by `scales`."""
        frames = json.loads(json.dumps(self.content["frames"]))
        for frame, scale in zip(frames, scales, strict=False):
            for row in frame["transform_matrix"][:3]:
                row[:3] = [scale[i] * v for i, v in enumerate(row[:3])]
        return frames

    def test_matrices_with_a_scale(self):
        """The scale of a camera object is ignored. Other matrices that are no poses are refused."""
        self.save()
        self.succeeds("train", self.data, "-o", self.path("plain"), "-n", 1, *SMALL)
        self.save(frames=self.scaled([0.33] * 3, [100] * 3))
        facts, _ = self.info()
        self.assertEqual(len(facts["warnings"]), 1, facts["warnings"])
        self.assertIn(
            "'transform_matrix' of 2 of 9 frames has a scale (0.33 to 100), which is left out", facts["warnings"][0]
        )
        self.succeeds("train", self.data, "-o", self.path("scaled"), "-n", 1, *SMALL)
        cameras = [json.loads(read(self.path(name, "scene.json")))["cameras"] for name in ("plain", "scaled")]
        for a, b in zip(*cameras, strict=True):
            for key in ("camera_from_world_translation", "camera_from_world_quaternion_wxyz"):
                for x, y in zip(a[key], b[key], strict=True):
                    self.assertAlmostEqual(x, y, 9)
        for scale, words in [
            ([1, 1, 2], "differ in length"),
            ([-1, -1, -1], "it mirrors"),
            ([-3, -3, -3], "it mirrors"),
            ([0, 0, 0], "differ in length"),
        ]:
            self.save(frames=self.scaled(scale))
            self.fails(["info", self.data], "transforms.json", "(000.png)", words)
        frames = self.scaled()
        frames[4]["transform_matrix"] = [list(row) for row in zip(*frames[4]["transform_matrix"], strict=True)]
        self.save(frames=frames)
        self.fails(["info", self.data], "the last row of 'transform_matrix'", "expected 0 0 0 1")

    def test_names_without_extension(self):
        """If a name matches two pictures, the warning names the picture that is used."""
        names = [f["file_path"] for f in self.content["frames"]]
        self.save(
            frames=[
                {**f, "file_path": name[: -len(".png")]} for f, name in zip(self.content["frames"], names, strict=True)
            ]
        )
        self.assertEqual(self.info()[0]["warnings"], [])
        write(os.path.join(self.data, names[2][: -len("png")] + "jpg"), read(os.path.join(self.data, names[3])))
        facts, _ = self.info()
        self.assertEqual(len(facts["warnings"]), 1, facts["warnings"])
        self.assertIn("1 of 9 files are found with several extensions", facts["warnings"][0])
        self.assertIn("images/002.png for 'images/002'", facts["warnings"][0])

    def test_dialects(self):
        """Tests names of camera models, angles in degrees, and keys that aren't used."""
        angle = 56.144973871  # 2 * atan(32 / 60) in degrees
        self.save(fl_x=None, fl_y=None, x_fov=angle, w=None, h=None, cx=None, cy=None)
        facts, _ = self.info("--strict")
        self.assertEqual((facts["width"], facts["height"]), (64, 48))
        self.save(camera_model="full_opencv", k1=0.01, k4=0.01)
        self.info("--strict")
        self.save(fl_x=None, fl_y=None, camera_angle_x=angle)
        self.fails(["info", self.data], "transforms.json", "'camera_angle_x' is 56.145, expected radians", "degrees")
        self.save(camera_model="EQUIRECTANGULAR")
        self.assertIn("views keep their lens", self.succeeds("info", self.data).stdout)
        self.save(camera_model=None, equirectangular=True)
        self.fails(["info", self.data], "camera_model 'equal-area cylinder' is not known")
        self.save(frames=[{**f, "depth_file_path": "depth/0.png"} for f in self.content["frames"]])
        self.assertIn("'depth_file_path' of 9 frames is ignored", self.info()[0]["warnings"][0])


class Foreign(Case):
    """A message names the other program's format and tells how to convert it to COLMAP."""

    def test_folders(self):
        for name, words in {
            "reconstruction.json": ["OpenSfM", "export_colmap"],
            "opensfm/reconstruction.json": ["OpenSfM", "export_colmap"],
            "sfm_data.json": ["OpenMVG", "openMVG_main_openMVG2Colmap"],
            "cameras.sfm": ["Meshroom", "aliceVision_exportColmap"],
            "cameras.xml": ["Metashape", "COLMAP"],
            "scene.rsproj": ["RealityScan", "COLMAP"],
            "camera_pose.LOG": [".log", "pags import photos"],
            "database.db": ["database", "colmap mapper"],
            "drive.MP4": ["video", "pags import photos VIDEO"],
            "a.jpg": ["1 picture without cameras", "pags import photos "],
            "transforms_test.json": ["transforms_test.json", "give that file itself"],
            "images/a.jpg": ["1 picture without cameras", "images -o DATASET`"],
            "sparse/0/cameras.txt": ["a COLMAP model that lacks files", "cameras and images"],
            "readme.md": ["not a data set", "pags import photos FOLDER"],
        }.items():
            with self.subTest(name):
                folder = self.path(name.replace("/", "_").replace(".", "_"))
                write(os.path.join(folder, name), "{}")
                self.fails(["info", folder], folder, *words)
                self.fails(["train", folder, "-o", self.path("out")], folder, *words)

    def test_files(self):
        for name, text, word in [
            ("a.json", '[{"cameras": {}, "shots": {}}]', "OpenSfM"),
            ("b.json", '{"sfm_data_version": "0.3", "views": []}', "OpenMVG"),
            ("c.json", '{"version": ["1", "2"], "featuresFolders": [], "poses": []}', "AliceVision"),
            ("d.json", '{"hello": 1}', "expected 'frames'"),
        ]:
            path = self.write(name, text)
            self.fails(["info", path], f"{name}:1: not a data set", word)
            self.fails(["train", path, "-o", self.path("out")], f"{name}:1: not a data set", word)
        for name, word in [
            ("cameras.xml", "Metashape"),
            ("a.log", "trajectory"),
            ("b.mp4", "pags import photos VIDEO"),
            ("images.txt", "COLMAP model"),
        ]:
            path = self.write(name, "text")
            self.fails(["info", path], path, word)
            self.fails(["train", path, "-o", self.path("out")], path, word)

    def test_scenes_and_splats_are_no_captures(self):
        """For a folder that holds something else, the message names the content and what is needed."""
        self.write("splats/a.ply", "ply")
        self.write("splats/thumb.png", GREY)
        self.write("inria/point_cloud/iteration_7/point_cloud.ply", "ply")
        self.write("inria/cameras.json", "[]")
        self.write("of_scenes/one/scene.json", "{}")
        self.write("of_sets/one/transforms.json", "{}")
        self.write("of_logs/av2/city_SE3_egovehicle.feather", b"ARROW1\0\0")
        for name, words in {
            "splats": ["1 splat file, such as a.ply", "render or export"],
            "splats/a.ply": ["a file of points or splats"],
            "inria": ["a training output without photographs"],
            "of_scenes": ["its folder one is a scene"],
            "of_sets": ["its folder one is a data set"],
            "of_logs": ["of_logs/av2: is a log of Argoverse 2"],
        }.items():
            self.fails(["train", self.path(name), "-o", self.path("out")], self.path(name), *words)
        for name in ["of_sets/one", "splats"]:
            line = self.fails(["render", self.path(name), "-o", self.path("out")], "no scene.json")
            self.assertEqual("'pags train' makes a scene" in line, name != "splats")
        for name in ["rigs.bin", "frames.txt"]:
            self.fails(["info", self.write(name, "text")], f"{name} is a file of a COLMAP model")
        self.fails(["info", self.write("cfg_args", "Namespace()")], "of a training's output", "its folder")


if __name__ == "__main__":
    fixtures.main()
