# SPDX-License-Identifier: Apache-2.0
"""Tests pags import photos: what COLMAP is given, and what is made of its results. stand_in_colmap.py replaces
COLMAP; check_photos.py runs the real one."""

import json
import os
import shutil
import signal
import subprocess
import sys
import time
import unittest
from unittest import mock

HERE = os.path.dirname(os.path.abspath(__file__))
sys.path[:0] = [os.path.dirname(HERE), os.path.join(os.path.dirname(HERE), "cli")]

from tool_python import TOOLS, need  # noqa: E402

need("recordings", "numpy", "PIL")
sys.path[:0] = [os.path.join(TOOLS, "recordings")]

import fixtures  # noqa: E402
import numpy as np  # noqa: E402
from fixtures import Case, files_below, read, write  # noqa: E402
from pags_recordings import photos, video  # noqa: E402
from pags_recordings.account import Account  # noqa: E402
from pags_recordings.display import Display  # noqa: E402
from pags_recordings.errors import RecordingError  # noqa: E402
from pags_recordings.folder import Folder  # noqa: E402
from PIL import Image  # noqa: E402
from PIL.PngImagePlugin import PngInfo  # noqa: E402


def picture(path, size=(60, 40), camera="A", orientation=1, seed=0, **more):
    os.makedirs(os.path.dirname(path), exist_ok=True)
    pixels = np.random.default_rng(seed).integers(0, 256, (size[1], size[0], 3), dtype=np.uint8)
    image = Image.fromarray(pixels)
    exif = image.getexif()
    exif[photos.MODEL], exif[photos.ORIENTATION] = camera, orientation
    image.save(path, exif=exif, **more)


class WithStandIn(Case):
    def setUp(self):
        super().setUp()
        self.raw, self.out, self.calls = self.path("raw"), self.path("out"), self.path("calls")
        os.makedirs(self.path("bin"))
        shutil.copy(os.path.join(HERE, "stand_in_colmap.py"), self.path("bin", "colmap"))
        os.chmod(self.path("bin", "colmap"), 0o755)

    def environment(self, **more):
        return (
            os.environ
            | {
                "PYTHONPATH": os.path.join(TOOLS, "recordings"),
                "PATH": self.path("bin") + ":/usr/bin:/bin",
                "COLMAP_CALLS": self.calls,
            }
            | more
        )

    def run_photos(self, *more, raw=None, **environment):
        command = [sys.executable, "-B", "-m", "pags_recordings", "photos", raw or self.raw, "-o", self.out, *more]
        return subprocess.run(command, capture_output=True, text=True, env=self.environment(**environment))

    def imports(self, *more, **environment):
        done = self.run_photos("--json", "-", *more, **environment)
        self.assertEqual(done.returncode, 0, done.stderr)
        return json.loads(done.stdout), done.stderr

    def reasons(self, facts):
        """Returns the reason for which each file was left out, by name."""
        return {name: row["why"] for row in facts["left_out"] for name in row["which"]}

    def refused(self, *words, code=1, more=(), raw=None, **environment):
        done = self.run_photos(*more, raw=raw, **environment)
        self.assertEqual(done.returncode, code, done.stdout + done.stderr)
        self.assertEqual(done.stderr.count("\n"), 1, done.stderr)
        for word in words:
            self.assertIn(word, done.stderr)
        self.assertFalse(os.path.exists(os.path.join(self.out, "sparse")))

    def called(self):
        return read(self.calls).decode().splitlines() if os.path.exists(self.calls) else []


class Photos(WithStandIn):
    def test_report(self):
        for number in range(5):
            picture(os.path.join(self.raw, f"day {number}.jpg"), seed=number)
        for number, name in enumerate(("alone.jpg", "few.JPG", "aside1.png", "aside2.png")):
            picture(os.path.join(self.raw, "more", name), seed=10 + number)
        write(os.path.join(self.raw, "cut.jpg"), read(os.path.join(self.raw, "day 0.jpg"))[:300])
        write(os.path.join(self.raw, "notes.txt"), "no picture")
        facts, said = self.imports()
        self.assertEqual(
            (facts["photographs"], facts["registered"], facts["points"], facts["reprojection_error"]), (9, 5, 2, 0.75)
        )
        why = self.reasons(facts)
        self.assertEqual(why.pop("notes.txt"), "not photographs by their file name extensions")
        self.assertEqual(
            sorted(why), ["cut.jpg", "more/alone.jpg", "more/aside1.png", "more/aside2.png", "more/few.JPG"]
        )
        for name, word in [
            ("cut.jpg", "can't be read"),
            ("more/alone.jpg", "no content with another"),
            ("more/aside1.png", "separate group of 2"),
            ("more/few.JPG", "50 features"),
        ]:
            self.assertIn(word, why[name])
            self.assertIn(name, said)
        self.assertIn("5 of 9 photographs have cameras", said)
        self.assertEqual(read(os.path.join(self.out, "images", "day_0.jpg")), read(os.path.join(self.raw, "day 0.jpg")))
        self.assertEqual(
            sorted(os.listdir(os.path.join(self.out, "sparse", "0"))), ["cameras.bin", "images.bin", "points3D.bin"]
        )
        self.assertEqual(
            sorted(os.listdir(os.path.join(self.out, "colmap"))), ["cameras.log", "features.log", "pairs.log"]
        )
        self.assertIn("use_gpu 0", self.called()[0])
        # The same command again prints the same and starts nothing; another source is refused.
        calls = len(self.called())
        self.assertEqual(self.imports()[0]["left_out"], facts["left_out"])
        self.assertEqual(len(self.called()), calls)
        picture(self.path("other", "a.jpg"))
        done = self.run_photos(raw=self.path("other"))
        self.assertEqual((done.returncode, "another source" in done.stderr), (1, True), done.stderr)

    def test_cameras_by_size_and_exif(self):
        for number, (camera, size, orientation) in enumerate(
            [("A", (60, 40), 1), ("A", (60, 40), 1), ("B", (60, 40), 1), ("A", (40, 60), 1), ("A", (60, 40), 6)]
        ):
            picture(os.path.join(self.raw, f"{number}.jpg"), size, camera, orientation, seed=number)
        facts, said = self.imports()
        self.assertEqual(len([call for call in self.called() if call.startswith("feature_extractor")]), 4)
        self.assertEqual(facts["turned_upright"], 1)
        self.assertIn("1 photographs with an EXIF rotation were re-encoded", said)
        with Image.open(os.path.join(self.out, "images", "4.jpg")) as upright:
            self.assertEqual((upright.size, upright.getexif().get(photos.ORIENTATION, 1)), ((40, 60), 1))
            before = np.asarray(Image.open(os.path.join(self.raw, "4.jpg"))).astype(int)
            self.assertLess(
                np.abs(np.rot90(before, -1) - np.asarray(upright)).mean(), 6
            )  # encoded as JPEG once more; turned the wrong way, noise would differ by 85 grey levels

    def test_pairs(self):
        self.assertEqual(len(photos.pairs(list(range(20)), False)), 190)
        ordered = photos.pairs(list(range(400)), True)
        self.assertLess(len(ordered), 400 * 18)
        for pair in [(0, 1), (0, 10), (0, 16), (3, 3 + 256), (0, 390), (120, 300)]:
            self.assertIn(pair, ordered)
        self.assertNotIn((1, 12), ordered)
        self.assertEqual(len(set(ordered)), len(ordered))

    def test_stopping_and_resuming(self):
        for number in range(4):
            picture(os.path.join(self.raw, f"{number}.png"), seed=number)
        command = [sys.executable, "-B", "-m", "pags_recordings", "photos", self.raw, "-o", self.out]
        process = subprocess.Popen(command, stderr=subprocess.PIPE, env=self.environment(COLMAP_DOES="wait"), text=True)
        deadline = time.monotonic() + 60
        while not any(call.startswith("matches") for call in self.called()):
            self.assertLess(time.monotonic(), deadline)
            time.sleep(0.05)
        process.send_signal(signal.SIGINT)
        self.assertIn("the same command resumes", process.communicate()[1])
        self.assertEqual(process.returncode, 3)
        children = subprocess.run(["pgrep", "-f", self.path("bin", "colmap")], capture_output=True, text=True).stdout
        self.assertEqual(children, "")
        facts, _ = self.imports()
        self.assertEqual(facts["registered"], 4)
        self.assertEqual(
            [call.split()[0] for call in self.called()],
            ["feature_extractor", "matches_importer", "matches_importer", "mapper"],
        )

    def test_fewer(self):
        for number in range(9):
            picture(os.path.join(self.raw, f"{number}.png"), seed=number)
        facts, _ = self.imports("--pictures", "3")
        self.assertEqual(
            (facts["photographs"], sorted(os.listdir(os.path.join(self.out, "images")))),
            (3, ["0.png", "3.png", "6.png"]),
        )

    def test_bad_input(self):
        os.makedirs(self.raw)
        self.refused("raw: has no JPEG or PNG files")
        write(os.path.join(self.raw, "IMG_1.HEIC"), "x")
        self.refused(
            "raw: has no JPEG or PNG files",
            "left out: 1 photograph: IMG_1.HEIC: HEIC is not supported; convert to JPEG or PNG first",
        )
        picture(os.path.join(self.raw, "1.png"))
        write(os.path.join(self.raw, "2.png"), "no picture")
        self.refused("1 of 2 JPEG and PNG files can be read;", "2.png: can't be read")
        self.refused("is missing", raw=self.path("none"))
        write(self.path("a.txt"), "x")
        self.refused("neither a folder nor a video", raw=self.path("a.txt"))
        done = self.run_photos("--sequence", "1")
        self.assertEqual(
            (done.returncode, "--sequence: not supported for photos" in done.stderr), (2, True), done.stderr
        )
        shutil.rmtree(self.out)
        for number in range(3):
            picture(os.path.join(self.raw, f"{number}.png"), seed=number)
        self.refused("COLMAP failed at its features (code 1): there is no room for it", COLMAP_DOES="fail")
        self.refused(
            "COLMAP placed no camera",
            "900 to 900 features",
            "3 pairs match",
            "No good initial image pair",
            COLMAP_DOES="nothing",
        )
        shutil.rmtree(self.out)
        with mock.patch("shutil.which", return_value=None), mock.patch("importlib.util.find_spec", return_value=None):
            with self.assertRaisesRegex(
                photos.RecordingError, "COLMAP, which finds the cameras, isn't installed: .*install"
            ):
                photos.read(self.raw, self.out, None, None, True)
        self.assertFalse(os.path.exists(self.out))
        write(os.path.join(self.out, "mine.txt"), "x")
        self.refused("not written by an import", more=("--overwrite",))
        self.assertEqual(list(files_below(self.out)), ["mine.txt"])


class Folders(WithStandIn):
    """Every file of a folder is a photograph, a mask, or counted with the reason why it is left out."""

    def put(self, *names, seed=0):
        for number, name in enumerate(names):
            picture(os.path.join(self.raw, name), seed=seed + number)

    def mask(self, *names, size=(60, 40)):
        for name in names:
            os.makedirs(os.path.dirname(os.path.join(self.raw, name)), exist_ok=True)
            Image.fromarray(np.repeat(np.uint8([[0, 255]]), size[0] // 2, 1).repeat(size[1], 0)).save(
                os.path.join(self.raw, name)
            )

    def look(self):
        """Returns the photographs, their masks, and the counts of files left out; checks that every file is in one
        of them."""
        account = Account()
        found = Folder(self.raw, self.out, account)
        rows = [row for row in account.rows.values() if row["what"] != "folders"]
        self.assertEqual(
            len(found.photographs) + len(found.masks) + sum(row["count"] for row in rows),
            len(list(files_below(self.raw))),
        )
        return (
            found.photographs,
            found.masks,
            {name: row["why"] for row in account.rows.values() for name in row["which"]},
        )

    def test_formats(self):
        self.put("1.jpg", "2.PNG", "sub/3.jpeg")
        for name in (
            "4.HEIC",
            "5.heif",
            "6.tif",
            "1.CR2",
            "7.MOV",
            "notes.txt",
            "1.xmp",
            "Thumbs.db",
            ".hidden.jpg",
            ".cache/8.jpg",
            "__MACOSX/._1.jpg",
            "@eaDir/1.jpg",
        ):
            write(os.path.join(self.raw, name), "x")
        os.symlink(self.raw, os.path.join(self.raw, "loop"))
        photographs, masks, why = self.look()
        self.assertEqual((photographs, masks), (["1.jpg", "2.PNG", "sub/3.jpeg"], {}))
        for name, words in [
            ("4.HEIC", "HEIC is not supported; convert"),
            ("6.tif", "TIF is not supported"),
            ("1.CR2", "with a JPEG or PNG of the same name"),
            ("7.MOV", "videos are imported separately"),
            ("notes.txt", "not photographs"),
            ("Thumbs.db", "system files"),
            (".cache/8.jpg", "hidden"),
            ("__MACOSX/._1.jpg", "system files"),
            ("loop", "are not followed"),
        ]:
            self.assertIn(words, why[name])
        with mock.patch(
            "os.walk",
            side_effect=lambda root, onerror: (
                onerror(PermissionError(13, "Permission denied", os.path.join(root, "sub"))) or []
            ),
        ):
            self.assertEqual(self.look_without_count()["sub"], "can't be read: Permission denied")

    def look_without_count(self):
        account = Account()
        Folder(self.raw, self.out, account)
        return {name: row["why"] for row in account.rows.values() for name in row["which"]}

    def test_masks(self):
        self.put("images/a.jpg", "images/b.jpg", "images/cam/a.jpg", "images/c.JPG")
        self.mask("masks/a.jpg.png", "masks/b.png", "Masks/cam/a.png", "masks/gone.png", "sky_masks/a.png")
        photographs, masks, why = self.look()
        self.assertEqual(photographs, ["images/a.jpg", "images/b.jpg", "images/c.JPG", "images/cam/a.jpg"])
        self.assertEqual(
            masks,
            {"images/a.jpg": "masks/a.jpg.png", "images/b.jpg": "masks/b.png", "images/cam/a.jpg": "Masks/cam/a.png"},
        )
        self.assertIn("have no photograph", why["masks/gone.png"])
        self.assertIn("in sky_masks: ", why["sky_masks/a.png"])

    def test_masks_elsewhere(self):
        """Finds masks next to the photographs by their names, and in a folder of masks for each camera. A folder
        that has only a folder "masks" in it holds photographs."""
        self.put("a.jpg", "b.jpg", "left/images/1.png", "right/images/1.png", "the mask.jpg")
        self.mask("a_mask.png", "b.jpg.png", "left/masks/1.png", "right/masks/1.png", "masks/1.png")
        photographs, masks, why = self.look()
        self.assertEqual(photographs, ["a.jpg", "b.jpg", "left/images/1.png", "right/images/1.png", "the mask.jpg"])
        self.assertEqual(
            masks,
            {
                "a.jpg": "a_mask.png",
                "b.jpg": "b.jpg.png",
                "left/images/1.png": "left/masks/1.png",
                "right/images/1.png": "right/masks/1.png",
            },
        )
        self.assertEqual(why, {"masks/1.png": "belong to several photographs"})
        self.raw = self.path("of masks")
        self.put("masks/1.jpg", "masks/2.jpg")
        self.assertEqual(self.look()[0], ["masks/1.jpg", "masks/2.jpg"])

    def test_copies_and_maps(self):
        """Leaves out smaller copies and depth maps with the names of photographs in other folders, but keeps
        photographs of a second camera."""
        self.put(
            "images/1.jpg",
            "images/2.jpg",
            "images_4/1.jpg",
            "images_4/2.jpg",
            "depth/1.png",
            "cam1/1.jpg",
            "other_4/9.jpg",
        )
        self.mask("seg person/1.png")
        photographs, _, why = self.look()
        self.assertEqual(photographs, ["cam1/1.jpg", "images/1.jpg", "images/2.jpg", "other_4/9.jpg"])
        self.assertEqual(sorted(why), ["depth/1.png", "images_4/1.jpg", "images_4/2.jpg", "seg person/1.png"])
        self.assertIn("smaller copies of the photographs in images", why["images_4/1.jpg"])
        self.assertIn("put them into a folder named masks", why["seg person/1.png"])

    def test_masks_are_written(self):
        """Writes masks as PNG next to DATASET/images, where training finds them, turned as the photograph is; leaves
        out masks of another size."""
        self.put("images/1.jpg", "images/2.jpg", "images/4 5.jpg")
        picture(os.path.join(self.raw, "images", "3.jpg"), orientation=6, seed=9)
        self.mask("masks/1.png", "masks/3.png", "masks/4 5.jpg")
        self.mask("masks/2.png", size=(40, 40))
        facts, said = self.imports()
        self.assertEqual(
            (facts["photographs"], facts["masks"], sorted(files_below(os.path.join(self.out, "images")))),
            (4, 3, ["1.jpg", "2.jpg", "3.jpg", "4_5.jpg"]),
        )
        self.assertIn("3 masks are in ", said)
        self.assertEqual(
            sorted(files_below(os.path.join(self.out, "masks"))), ["1.jpg.png", "3.jpg.png", "4_5.jpg.png"]
        )
        self.assertEqual(
            read(os.path.join(self.out, "masks", "1.jpg.png")), read(os.path.join(self.raw, "masks", "1.png"))
        )
        with Image.open(os.path.join(self.out, "masks", "3.jpg.png")) as turned:
            self.assertEqual((turned.size, [turned.getpixel((5, y)) for y in (5, 55)]), ((40, 60), [0, 255]))
        self.assertEqual(
            [row["why"] for row in facts["left_out"]], ["can't be used: 40 x 40 pixels, but the photograph has 60 x 40"]
        )

    def test_the_same_photograph_twice(self):
        self.put("1.jpg", "2.jpg", "3.jpg")
        for name in ("1 (1).jpg", "again/3.jpg"):
            write(
                os.path.join(self.raw, name),
                read(os.path.join(self.raw, name[0] + ".jpg" if name[0] == "1" else "3.jpg")),
            )
        facts, _ = self.imports()
        self.assertEqual((facts["photographs"], sum(row["count"] for row in facts["left_out"])), (3, 2))
        self.assertEqual(
            sorted(row["why"] for row in facts["left_out"]),
            ["has the same bytes as 1_(1).jpg", "has the same bytes as 3.jpg"],
        )


class Damage(WithStandIn):
    """Damaged or maliciously named files are refused in one line with exit code 1, or left out with their name.
    Nothing is written outside of the folder."""

    def setUp(self):
        super().setUp()
        for number in range(5):
            picture(os.path.join(self.raw, f"{number}.jpg"), (200, 150), seed=number)
        self.good = read(os.path.join(self.raw, "0.jpg"))

    def outside(self):
        return {
            name: os.lstat(self.path(name)).st_mtime_ns
            for name in files_below(self.path())
            if not name.startswith(("out/", "calls"))
        }

    def test_photographs(self):
        """Leaves out damaged photographs and other files of a good folder, each with a reason."""
        bad = {
            "cut.jpg": self.good[: len(self.good) // 2],
            "end.jpg": self.good[:-900],
            "empty.jpg": b"",
            "text.png": b"a text\n" * 99,
            "zero.jpg": bytes(5000),
        }
        for name, content in bad.items():
            write(os.path.join(self.raw, name), content)
        os.symlink(self.path("nowhere"), os.path.join(self.raw, "link.jpg"))
        os.makedirs(os.path.join(self.raw, "folder.jpg"))
        before = self.outside()
        facts, said = self.imports()
        self.assertEqual(
            (facts["photographs"], facts["registered"], sorted(self.reasons(facts))), (5, 5, sorted([*bad, "link.jpg"]))
        )
        for name in self.reasons(facts):
            self.assertIn(name, said)
            self.assertIn("can't be read: ", self.reasons(facts)[name])
        self.assertEqual(
            (sorted(os.listdir(os.path.join(self.out, "images"))), self.outside()),
            ([f"{n}.jpg" for n in range(5)], before),
        )

    def test_one_and_none(self):
        for number in range(1, 5):
            os.remove(os.path.join(self.raw, f"{number}.jpg"))
        self.refused("raw: 1 of 1 JPEG and PNG files can be read; finding cameras requires at least three photographs")
        os.remove(os.path.join(self.raw, "0.jpg"))
        self.refused("raw: has no JPEG or PNG files")

    def test_file_in_the_way(self):
        write(self.out, "mine")
        before = self.outside()
        for out in (self.out, os.path.join(self.out, "deeper", "still")):
            for more in ((), ("--overwrite",)):
                done = self.run_photos("-o", out, *more)
                self.assertEqual(
                    (
                        done.returncode,
                        done.stderr.count("\n"),
                        f"{self.out}: not a folder, but {out} requires one" in done.stderr,
                    ),
                    (1, 1, True),
                    done.stderr,
                )
        self.assertEqual((self.outside(), read(self.out)), (before, b"mine"))

    def test_names(self):
        """Folders and photographs may have any name; COLMAP gets names that it can read."""
        self.raw, self.out = self.path("r\naw $(touch x)%41"), self.path("o ut\n#?%41;'")
        names = [
            "plain.jpg",
            "-o.jpg",
            "#a.jpg",
            "a\\b.jpg",
            "a\nb.jpg",
            "$(touch y) `z`;'\".jpg",
            "%d.jpg",
            "..c.jpg",
            os.fsdecode(b"\xe9\xff.jpg"),
            "s\nub/-d.jpg",
            "e\x1b[31m.jpg",
        ]
        for number, name in enumerate(names):
            picture(os.path.join(self.raw, name), seed=number)
        before = set(os.listdir(self.path()))
        facts, _ = self.imports()
        self.assertEqual(
            (facts["registered"], list(self.reasons(facts))), (len(names) - 1, ["..c.jpg"])
        )  # the name ..c.jpg begins with a dot, so the file is hidden
        self.assertEqual(set(os.listdir(self.path())) - before, {os.path.basename(self.out), "calls"})
        copies = list(files_below(os.path.join(self.out, "images")))
        self.assertEqual(len(copies), facts["registered"])
        for name in copies:
            self.assertFalse(set(name) & set("\\# \n\x1b") or not name.isprintable(), name)
        self.assertEqual(
            sorted(read(os.path.join(self.out, "images", n)) for n in copies),
            sorted(read(os.path.join(self.raw, n)) for n in names if not n.startswith(".")),
        )

    @unittest.skipUnless(shutil.which("ffmpeg"), "needs ffmpeg")
    def test_videos(self):
        """A cut video gives frames up to the cut and a message; a file that is no video is refused in one line."""
        for number in range(30):
            picture(self.path("frames", f"{number:03d}.png"), (96, 64), seed=number)
        movie = {}
        for name, flags in (
            ("whole.mp4", ["-movflags", "faststart"]),
            ("last.mp4", []),
            ("film.mkv", []),
        ):  # moov is last: the table of frames is at the end of the file
            subprocess.run(
                ["ffmpeg", "-v", "error", "-i", self.path("frames", "%03d.png"), *flags, self.path(name)],
                check=True,
                stdin=subprocess.DEVNULL,
            )
            movie[name] = read(self.path(name))
        whole = movie["whole.mp4"]
        self.raw = self.path("whole.mp4")
        self.assertIsNone(self.imports("--pictures", "8")[0]["damage"])
        hole = whole[: len(whole) // 2] + bytes(len(whole) // 8) + whole[len(whole) // 2 + len(whole) // 8 :]
        for name, content in (
            ("cut.mp4", whole[: len(whole) * 2 // 3]),
            ("hole.mp4", hole),
            ("cut.mkv", movie["film.mkv"][: len(movie["film.mkv"]) // 2]),
        ):
            shutil.rmtree(self.out)
            self.raw = self.path(name)
            write(self.raw, content)
            facts, said = self.imports("--pictures", "8")
            self.assertEqual(facts["photographs"], 8)
            self.assertIn(f"{name} is truncated or damaged; ", facts["damage"])
            self.assertIn(f"warning: {facts['damage']}\n", said)
        shutil.rmtree(self.out)
        os.makedirs(self.path("folder.mp4"))
        for name, content in (
            ("text.mp4", b"a text\n" * 99),
            ("none.mp4", b""),
            ("head.mp4", whole[:600]),
            ("last.mp4", movie["last.mp4"][:-1000]),
            ("zero.mkv", bytes(5000)),
        ):
            write(self.path(name), content)
            self.refused(f"{name}: not a video that ffmpeg can read", raw=self.path(name))
            shutil.rmtree(self.out)
        write(self.path("head.mkv"), movie["film.mkv"][:600])
        self.refused("head.mkv: ffmpeg can read no picture", raw=self.path("head.mkv"))
        shutil.rmtree(self.out)
        self.refused("folder.mp4: has no JPEG or PNG files", raw=self.path("folder.mp4"))

    @unittest.skipUnless(shutil.which("ffmpeg"), "needs ffmpeg")
    def test_many_messages(self):
        """A heavily damaged video makes ffmpeg print more than a pipe holds; the import doesn't hang."""
        for number in range(8):
            picture(self.path("frames", f"{number:03d}.png"), (320, 240), seed=number)
        film = self.path("a.avi")
        subprocess.run(
            [
                "ffmpeg",
                "-v",
                "error",
                "-stream_loop",
                "150",
                "-i",
                self.path("frames", "%03d.png"),
                "-c:v",
                "mjpeg",
                "-q:v",
                "9",
                film,
            ],
            check=True,
            stdin=subprocess.DEVNULL,
        )
        frames = read(film).split(b"\xff\xd8\xff")
        write(
            film,
            b"\xff\xd8\xff".join(
                frame if number % 4 == 0 else frame[:500] + bytes(99) + frame[599:]
                for number, frame in enumerate(frames)
            ),
        )
        sharp, _, words = video.judged(film, lambda done: None)
        self.assertGreater(len(sharp), 300)
        self.assertEqual(len(words), 300)
        self.assertGreater(
            len(
                subprocess.run(
                    ["ffmpeg", "-v", "error", "-i", film, "-f", "null", "-"],
                    capture_output=True,
                    stdin=subprocess.DEVNULL,
                ).stderr
            ),
            70000,
        )


class Colours(WithStandIn):
    """Photographs that are written upright and with square pixels keep the colour profile of their file."""

    def opened(self, name):
        with Image.open(os.path.join(self.out, "images", name)) as copy:
            copy.load()
            return copy

    def copies(self):
        self.imports()
        return {name: self.opened(name) for name in os.listdir(os.path.join(self.out, "images"))}

    def test_profiles_stay(self):
        for number in range(3):
            picture(os.path.join(self.raw, f"{number}.jpg"), orientation=6, seed=number, icc_profile=b"a profile")
        for name, copy in self.copies().items():
            self.assertEqual((copy.size, copy.info["icc_profile"]), ((40, 60), b"a profile"), name)

    def test_adobe_rgb_of_cameras(self):
        entry = lambda tag, kind, count, value: (
            tag.to_bytes(2, "big") + kind.to_bytes(2, "big") + count.to_bytes(4, "big") + value
        )  # noqa: E731
        end = bytes(4)
        exif = (
            b"Exif\0\0MM\0*\0\0\0\x08"
            + b"\0\x02"
            + entry(0x112, 3, 1, b"\0\x06\0\0")
            + entry(0x8769, 4, 1, (38).to_bytes(4, "big"))
            + end
        )
        exif += (
            b"\0\x01" + entry(0xA005, 4, 1, (56).to_bytes(4, "big")) + end + b"\0\x01" + entry(1, 2, 4, b"R03\0") + end
        )
        for number in range(3):
            picture(os.path.join(self.raw, f"{number}.jpg"), seed=number)
            with Image.open(os.path.join(self.raw, f"{number}.jpg")) as plain:
                plain.load()
                plain.save(os.path.join(self.raw, f"{number}.jpg"), exif=exif)
        for name, copy in self.copies().items():
            self.assertEqual(
                (copy.size, copy.getexif()[0x112], copy.getexif().get_ifd(0xA005)[1]), ((40, 60), 1, "R03"), name
            )

    def test_png_chunks_stay(self):
        for number in range(3):
            path = os.path.join(self.raw, f"{number}.png")
            said = PngInfo()
            said.add(b"gAMA", (100000).to_bytes(4, "big"))
            said.add(b"cICP", bytes([12, 13, 0, 1]))
            picture(path, orientation=3, seed=number, pnginfo=said)
        for name in self.copies():
            content = read(os.path.join(self.out, "images", name))
            self.assertIn(b"gAMA" + (100000).to_bytes(4, "big"), content)
            self.assertIn(b"cICP" + bytes([12, 13, 0, 1]), content)

    def test_pixels_become_square(self):
        for number in range(3):
            picture(os.path.join(self.raw, f"{number}.png"), seed=number, dpi=(100, 150))
            picture(os.path.join(self.raw, f"{number}.jpg"), seed=number + 5, orientation=6, dpi=(200, 100))
        facts, _ = self.imports()
        self.assertEqual(facts["made_square"], 6)
        for number in range(3):
            self.assertEqual(self.opened(f"{number}.png").size, (90, 40))
            self.assertEqual(self.opened(f"{number}.jpg").size, (80, 60))


class Video(Case):
    def test_choice(self):
        """Takes the requested number of frames, in the order of time: the sharpest in each part, spread over time
        and motion."""
        sharp, change = np.ones(300), np.ones(300)
        sharp[[7, 23]] = 5
        chosen = video.choose(sharp, change, 20)
        self.assertEqual(
            (len(chosen), chosen == sorted(set(chosen)), 7 in chosen, 23 in chosen), (20, True, True, True)
        )
        self.assertLess(np.diff(chosen).max(), 27)
        change[:150] = 0  # the camera rests in the first half, which gets a quarter of the frames
        rested = video.choose(np.ones(300), change, 20)
        self.assertEqual(sum(number < 150 for number in rested), 5)
        self.assertEqual(video.choose(sharp[:3], change[:3], 20), [0, 1, 2])
        jump = video.choose(np.ones(21), np.eye(21)[20], 20)  # no frame is taken in the middle of a cut
        self.assertEqual((len(set(jump)), len(jump), jump[-1]), (11, 11, 20))

    @unittest.skipUnless(shutil.which("ffmpeg"), "needs ffmpeg")
    def test_frames_of_a_file(self):
        """Of a video of 40 frames, every fourth of which is sharp, the ten sharp frames are taken with their pixels."""
        for number in range(40):
            base = np.random.default_rng(number // 4).integers(0, 256, (45, 80, 3), dtype=np.uint8)
            small = Image.fromarray(base).resize((640, 360), Image.NEAREST if number % 4 == 1 else Image.BICUBIC)
            small.save(self.path(f"f{number:03d}.png"))
        movie = self.path("a b.mkv")
        subprocess.run(
            ["ffmpeg", "-v", "error", "-i", self.path("f%03d.png"), "-c:v", "ffv1", movie],
            check=True,
            stdin=subprocess.DEVNULL,
        )
        self.assertEqual(video.length(movie), 40)
        sharp, change, words = video.judged(movie, lambda done: None)
        self.assertEqual(words, "")
        chosen = video.choose(sharp, change, 10)
        self.assertEqual(chosen, list(range(1, 40, 4)))
        os.makedirs(self.path("out"))
        names = video.extract(movie, chosen, self.path("out"))
        self.assertEqual((names[1], sorted(os.listdir(self.path("out")))), ("frame_000005.jpg", names))
        found = np.asarray(Image.open(self.path("out", names[1]))).astype(int)
        self.assertLess(
            np.abs(found - np.asarray(Image.open(self.path("f005.png"))).astype(int)).mean(), 8
        )  # JPEG halves the resolution of colour

    def film(self, name, frames, *flags):
        """Makes a video of six frames from yuv420p or yuv420p10le planes; every second frame is upside down."""
        width, height = 64, 32
        deep = "yuv420p10le" in flags
        values = [value[::step].astype("<u2" if deep else "u1").tobytes() for step in (1, -1) for value in frames]
        write(self.path("raw.yuv"), b"".join(values) * 3)
        command = [
            "ffmpeg",
            "-v",
            "error",
            "-y",
            "-f",
            "rawvideo",
            "-pix_fmt",
            "yuv420p10le" if deep else "yuv420p",
            "-s",
            f"{width}x{height}",
            "-r",
            "10",
            "-i",
            self.path("raw.yuv"),
            *flags,
            self.path(name),
        ]
        if subprocess.run(command, stdin=subprocess.DEVNULL, capture_output=True).returncode:
            self.skipTest("ffmpeg can't write such a film")
        return self.path(name)

    def shown(self, path):
        """Imports a video; returns the filter that was used, the size of its frames, and the colour in the middle of
        each half of a frame."""
        facts = Display(path, video.place(path))
        shutil.rmtree(self.path("out"), ignore_errors=True)
        os.makedirs(self.path("out"))
        self.assertEqual(len(video.judged(path, lambda done: None, facts.before)[0]), 6)
        name = video.extract(path, [1, 4], self.path("out"), facts)[1]
        pixels = np.asarray(Image.open(self.path("out", name))).astype(int)
        height, width = pixels.shape[:2]
        return "; ".join(facts.words), (width, height), [pixels[height // 2, width * part // 4] for part in (1, 3)]

    def halves(self, colours, kr, kb, top):
        """Returns the planes of a frame whose halves have two colours (samples from 0 to 1), in a limited range of 8
        or 10 bits."""
        planes = [np.empty((32, 64)), np.empty((16, 32)), np.empty((16, 32))]
        for half, (r, g, b) in enumerate(colours):
            y = kr * r + (1 - kr - kb) * g + kb * b
            for plane, value, scale, zero in zip(
                planes, (y, (b - y) / 2 / (1 - kb), (r - y) / 2 / (1 - kr)), (219, 224, 224), (16, 128, 128)
            ):
                plane[:, half * plane.shape[1] // 2 : (half + 1) * plane.shape[1] // 2] = np.round(
                    (value * scale + zero) * top
                )
        return planes

    def near(self, seen, wanted, tolerance=6):
        self.assertLess(np.abs(np.array(seen) - np.array(wanted)).max(), tolerance, seen)

    @unittest.skipUnless(shutil.which("ffmpeg"), "needs ffmpeg")
    def test_colours(self):
        """Videos in BT.709, BT.2020, HLG and PQ give frames of the recorded colours."""
        wanted = np.array([[200, 60, 40], [90, 150, 60]]) / 255
        lit = np.where(wanted <= 0.04045, wanted / 12.92, ((wanted + 0.055) / 1.055) ** 2.4)
        wide = lit @ np.array([[0.6274, 0.3293, 0.0433], [0.0691, 0.9195, 0.0114], [0.0164, 0.0880, 0.8956]]).T
        scene = wide * 0.2650  # HLG at 75 % of its range
        hlg = np.where(
            scene <= 1 / 12,
            np.sqrt(3 * scene),
            0.17883277 * np.log(np.maximum(12 * scene - 0.28466892, 1e-9)) + 0.55991073,
        )
        power = (wide * 203 / 10000) ** 0.1593017578125
        pq = ((0.8359375 + 18.8515625 * power) / (1 + 18.6875 * power)) ** 78.84375
        sdr = np.where(wide <= 0.0031308, wide * 12.92, 1.055 * wide ** (1 / 2.4) - 0.055)
        tags = lambda primaries, transfer, matrix: [
            "-color_primaries",
            primaries,
            "-color_trc",
            transfer,
            "-colorspace",
            matrix,
        ]  # noqa: E731
        for name, samples, primaries, transfer, words in (
            ("hlg", hlg, "bt2020", "arib-std-b67", "HLG (HDR), BT.2020"),
            ("pq", pq, "bt2020", "smpte2084", "PQ (HDR), BT.2020"),
            ("sdr", sdr, "bt2020", "bt2020-10", "colours of BT.2020 are converted to sRGB"),
        ):
            planes = self.halves(samples, 0.2627, 0.0593, 4)
            said, _, seen = self.shown(
                self.film(
                    f"{name}.mkv",
                    planes,
                    "-pix_fmt",
                    "yuv420p10le",
                    "-c:v",
                    "ffv1",
                    *tags(primaries, transfer, "bt2020nc"),
                )
            )
            self.assertIn(words, said)
            self.near(seen, wanted * 255)
        said, _, seen = self.shown(
            self.film(
                "709.mkv", self.halves(wanted, 0.2126, 0.0722, 1), "-c:v", "ffv1", *tags("bt709", "bt709", "bt709")
            )
        )
        self.assertEqual(said, "")
        self.near(seen, wanted * 255)
        said, _, seen = self.shown(self.film("601.mkv", self.halves(wanted, 0.299, 0.114, 1), "-c:v", "ffv1"))
        self.assertEqual(said, "")
        self.near(seen, wanted * 255)
        path = self.film(
            "log.mkv", self.halves(wanted, 0.2126, 0.0722, 1), "-c:v", "ffv1", *tags("bt709", "log100", "bt709")
        )
        with self.assertRaisesRegex(RecordingError, r"log.mkv: its colours \(log.*\) are not supported; .*zscale"):
            Display(path, video.place(path))

    @unittest.skipUnless(shutil.which("ffmpeg"), "needs ffmpeg")
    def test_shapes(self):
        """Interlaced frames are deinterlaced, and pixels become square; a rotated video becomes upright. The number
        of frames stays."""
        rows = np.arange(32) % 2 * 100 + 60  # alternating lines, as at a moving edge
        planes = [np.repeat(rows[:, None], 64, 1), np.full((16, 32), 128), np.full((16, 32), 128)]
        comb = self.film(
            "a.avi",
            planes,
            "-c:v",
            "mpeg2video",
            "-flags",
            "+ilme+ildct",
            "-top",
            "1",
            "-qscale:v",
            "1",
            "-vf",
            "setfield=tff,setsar=4/3",
        )
        said, size, seen = self.shown(comb)
        self.assertIn("interlaced frames are deinterlaced (bwdif); pixels of 4:3 are made square", said)
        self.assertEqual(size, (86, 32))
        pixels = np.asarray(Image.open(self.path("out", "frame_000004.jpg"))).astype(int)
        self.assertLess(
            np.abs(np.diff(pixels[8:24, 40, 0])).max(), 40
        )  # steps between the alternating lines would be 100
        _, size, _ = self.shown(self.film("b.mkv", planes, "-c:v", "ffv1", "-vf", "setsar=1/2"))
        self.assertEqual(size, (64, 64))

    @unittest.skipUnless(shutil.which("ffmpeg"), "needs ffmpeg")
    def test_frames_are_judged_once(self):
        """A resumed import takes the same frames, and judges them again only if the video has changed."""
        for number in range(12):
            picture(self.path(f"f{number:03d}.png"), (96, 64), seed=number)
        movie, out = self.path("a.mkv"), self.path("out")
        subprocess.run(
            ["ffmpeg", "-v", "error", "-i", self.path("f%03d.png"), "-c:v", "ffv1", movie],
            check=True,
            stdin=subprocess.DEVNULL,
        )
        first = photos.gather(movie, out, 4, True)
        with mock.patch.object(video, "judged", side_effect=AssertionError("judged again")):
            self.assertEqual(list(photos.gather(movie, out, 4, True).camera), list(first.camera))
        os.utime(movie, ns=(1, 1))
        with mock.patch.object(video, "judged", wraps=video.judged) as again:
            photos.gather(movie, out, 4, True)
            again.assert_called_once()
        write(os.path.join(out, "colmap", "frames.json"), '{"bytes": 3')
        self.assertEqual(list(photos.gather(movie, out, 4, True).camera), list(first.camera))

    @unittest.skipUnless(shutil.which("ffmpeg"), "needs ffmpeg")
    def test_no_video(self):
        write(self.path("a.mp4"), "no video")
        with self.assertRaisesRegex(photos.RecordingError, "not a video that ffmpeg can read"):
            video.length(self.path("a.mp4"))


if __name__ == "__main__":
    fixtures.main()
