# SPDX-License-Identifier: Apache-2.0
"""Tests of tools/segment: its modules, and runs of the whole tool on a tiny driving set whose output pags reads.

test_segment.py PAGS. Uses tools/segment/.venv if it exists; without onnxruntime it prints a message and exits with
77."""

import errno
import io
import json
import os
import pathlib
import re
import signal
import stat
import subprocess
import sys
import tempfile
import threading
import time
import unittest

HERE = os.path.dirname(os.path.abspath(__file__))
sys.path[:0] = [os.path.dirname(HERE)]

from tool_python import TOOLS, need  # noqa: E402

need("segment", "onnxruntime", "numpy", "PIL")
sys.path[:0] = [HERE, TOOLS]

import networks  # noqa: E402
import numpy as np  # noqa: E402
from PIL import Image  # noqa: E402
from segment import automatic, classes, exports, fuse, layout  # noqa: E402
from segment.errors import SegmentError  # noqa: E402
from segment.progress import Progress, duration  # noqa: E402
from segment.sam import Sam  # noqa: E402
from segment.semantic import Semantic, enlarge_argmax  # noqa: E402

PAGS = os.environ.get("PAGS", "build/pags")


def picture(width, height, parts):
    """Paints road everywhere except in the rectangles `parts` (class, x0, y0, x1, y1). Returns the photograph and its labels."""
    labels = np.zeros((height, width), np.uint8)
    for index, x0, y0, x1, y1 in parts:
        labels[y0:y1, x0:x1] = index
    table = np.zeros((256, 3), np.uint8)
    for index, colour in networks.COLOURS.items():
        table[index] = colour
    return table[labels], labels


# The rectangles' borders lie between the points of a grid of 8 x 8.
STREET = ((10, 0, 0, 96, 24), (13, 9, 39, 33, 57), (11, 60, 30, 72, 57))


class Scratch(unittest.TestCase):
    def setUp(self):
        self.scratch = tempfile.TemporaryDirectory()
        self.addCleanup(self.scratch.cleanup)

    def path(self, *names):
        return os.path.join(self.scratch.name, *names)

    def refused(self, text, call, *arguments, **more):
        with self.assertRaises(SegmentError) as caught:
            call(*arguments, **more)
        self.assertIn(text, str(caught.exception))


class Parts(unittest.TestCase):
    def test_grid(self):
        self.assertEqual(automatic.point_grid(2).tolist(), [[0.25, 0.25], [0.75, 0.25], [0.25, 0.75], [0.75, 0.75]])
        grid = automatic.point_grid(32)
        self.assertEqual(grid.shape, (1024, 2))
        self.assertTrue(grid.min() == 1 / 64 and grid.max() == 63 / 64)

    def test_crops_cover_the_picture_and_overlap(self):
        crops = automatic.crop_boxes(1500, 1000, 2, 512 / 1500)
        self.assertEqual([layer for _, layer in crops], [0] + [1] * 4 + [2] * 16)
        self.assertEqual(crops[0][0], (0, 0, 1500, 1000))
        # Layer 1: overlap int(341.3 * 2 / 2), crops of ceil((341 + 1500) / 2) x ceil((341 + 1000) / 2).
        self.assertEqual(
            [box for box, layer in crops if layer == 1],
            [(0, 0, 921, 671), (0, 330, 921, 1000), (580, 0, 1500, 671), (580, 330, 1500, 1000)],
        )
        for layer in (1, 2):
            seen = np.zeros((1000, 1500), int)
            for (x0, y0, x1, y1), of in crops:
                seen[y0:y1, x0:x1] += of == layer
            self.assertTrue(seen.min() >= 1 and seen.max() >= 4)

    def test_stability_is_the_overlap_of_two_cuts(self):
        logits = np.array([[-2, -0.5, 0.5, 2, 2]], np.float32)
        self.assertAlmostEqual(automatic.stability_score(logits, 1.0), 2 / 4)
        self.assertEqual(automatic.stability_score(logits - 9, 1.0), 0)

    def test_bounds(self):
        inside = np.zeros((5, 7), bool)
        self.assertIsNone(automatic.bounds(inside))
        inside[1:3, 2:6] = True
        self.assertEqual(automatic.bounds(inside), (2, 1, 6, 3))

    def test_boxes_cut_by_a_crop_are_marked(self):
        crop, size = (100, 0, 300, 200), (400, 200)
        for box, cut in (
            ((105, 50, 200, 100), True),
            ((150, 50, 290, 100), True),
            ((150, 0, 200, 200), False),
            ((150, 50, 200, 100), False),
        ):
            self.assertEqual(automatic.is_cut_off(box, crop, *size), cut, box)
        self.assertFalse(automatic.is_cut_off((0, 0, 400, 200), (0, 0, 400, 200), *size))

    def test_suppression_keeps_the_best_of_similar_masks(self):
        boxes = [(0, 0, 10, 10), (0, 0, 10, 9), (0, 0, 10, 5), (20, 20, 30, 30), (0, 0, 10, 10)]
        self.assertEqual(automatic.suppress(boxes, [0.9, 0.95, 0.8, 0.5, 0.9], 0.7), [1, 2, 3])
        self.assertEqual(automatic.suppress(boxes, [0.9, 0.9, 0.9, 0.9, 0.9], 0.95), [0, 1, 2, 3])
        self.assertEqual(automatic.suppress([], [], 0.7), [])

    def test_majority(self):
        labels = np.array([[13, 13, 13, 0, 0, 255]], np.uint8)
        whole = np.ones((1, 6), bool)
        self.assertIsNone(fuse.majority(labels, whole, 0.5))  # exactly a half isn't a majority
        self.assertEqual(fuse.majority(labels, whole, 0.4), 13)
        self.assertEqual(fuse.majority(labels, labels != 0, 0.5), 13)
        self.assertIsNone(fuse.majority(np.full((2, 2), 255, np.uint8), np.ones((2, 2), bool), 0.5))

    def test_small_masks_cover_large_ones(self):
        labels = np.zeros((10, 10), np.uint8)
        labels[3:6, 3:6], labels[4, 4] = 13, 11
        ones = lambda x0, y0, x1, y1: automatic.Mask((x0, y0, x1, y1), np.ones((y1 - y0, x1 - x0), bool), 1, 1, 100)
        for masks in ([ones(0, 0, 10, 10), ones(3, 3, 6, 7)], [ones(3, 3, 6, 7), ones(0, 0, 10, 10)]):
            found = fuse.fuse(labels, masks)
            self.assertEqual(np.unique(found[3:7, 3:6]).tolist(), [13])
            self.assertEqual(found.sum(), 12 * 13)

    def test_scores_are_interpolated_before_the_choice(self):
        scores = np.array([[[0.0, 1.0]], [[0.6, 0.6]]])
        # Enlarged to 8 pixels the scores of class 0 are 0, 0, 0.125, 0.375, 0.625, 0.875, 1, 1.
        self.assertEqual(enlarge_argmax(scores, 1, 8).tolist(), [[1, 1, 1, 1, 0, 0, 0, 0]])

    def test_class_lists(self):
        for name, table in classes.TABLES.items():
            self.assertTrue(set(table.values()) <= set(range(19)), name)
            self.assertIn(classes.CAR, table.values(), name)
            self.assertEqual(classes.SKY in table.values(), name != "voc", name)
        self.assertEqual(classes.lookup({2: 10}, 5).tolist(), [255, 255, 10, 255, 255, 255])

    def test_durations(self):
        self.assertEqual([duration(s) for s in (0.4, 59, 150, 9000)], ["0 s", "59 s", "3 min", "2 h 30 min"])

    def test_progress_states_the_time_after_the_first_image(self):
        now, stream = [0.0], io.StringIO()
        progress = Progress(240, stream=stream, clock=lambda: now[0])
        now[0] = 12.5
        progress.finished("000_0.jpg")
        self.assertEqual(stream.getvalue(), "000_0.jpg: 12.50 s per image, 240 images, about 50 min left\n")
        for _ in range(5):
            now[0] += 10
            progress.finished("x")
        self.assertEqual(stream.getvalue().count("\n"), 2)
        self.assertIn("4 of 240, 10.62 s per image, 42 min left", stream.getvalue())


class Labels(Scratch):
    def check(self, exact=True, photo=None, **how):
        network = {
            k: v
            for k, v in how.items()
            if k in ("size", "count", "normal", "colours", "name", "out", "last", "data", "classes", "shrink", "bgr")
        }
        more = {k: v for k, v in how.items() if k not in network}
        networks.semantic(self.path("m.onnx"), **network)
        semantic = Semantic(self.path("m.onnx"), 1, **more)
        photo, truth = picture(48, 32, ((10, 0, 0, 48, 10), (13, 4, 16, 20, 26), (11, 30, 12, 36, 28)))
        found = semantic.label(photo)
        self.assertEqual((found.dtype, found.shape), (np.uint8, truth.shape))
        if exact:
            self.assertTrue((found == truth).all(), how)
        elif how.get("size", 1) is None:  # sides are rounded to multiples of 32, which moves borders by a pixel
            self.assertGreater((found == truth).mean(), 0.85, how)
        return semantic

    def test_every_form_of_network(self):
        forms = (
            ("transformers", {}),
            ("transformers", {"size": None, "exact": False}),
            ("torchvision", {"name": "input", "out": "output"}),
            ("torchvision", {"name": "input", "classes": 4}),
            ("paddleseg", {"name": "x", "classes": 3, "normal": networks.HALF}),
            ("openvino-adas", {"name": "data", "normal": networks.PLAIN, "bgr": True, "count": 20}),
            (
                "tensorflow-deeplab",
                {"name": "ImageTensor:0", "last": True, "data": np.uint8, "normal": networks.PLAIN, "classes": 3},
            ),
            ("bytes-nhwc", {"name": "y", "last": True, "data": np.uint8, "normal": networks.PLAIN}),
            ("float-nhwc", {"name": "y", "last": True, "normal": networks.HALF}),
        )
        for name, how in forms:
            self.assertEqual(self.check(**how).export.name, name)

    def test_flags_override_the_table(self):
        self.check(name="input", normal=networks.HALF, mean=(0.5, 0.5, 0.5), std=(0.5, 0.5, 0.5))
        self.check(name="input", normal=networks.HALF, export="paddleseg")
        semantic = self.check(size=(48, 32))
        self.refused("24x16 pixels, as --size says", Semantic, self.path("m.onnx"), size=(24, 16))
        self.assertEqual(semantic.target_size(1000, 500), (48, 32))
        networks.semantic(self.path("free.onnx"), size=None)
        free = Semantic(self.path("free.onnx"))
        self.assertEqual(free.target_size(1920, 1080), (1024, 576))
        self.assertEqual(Semantic(self.path("free.onnx"), size=(96, 64)).target_size(1920, 1080), (96, 64))

    def test_classes(self):
        ade = {6: networks.COLOURS[0], 2: networks.COLOURS[10], 12: networks.COLOURS[11], 20: networks.COLOURS[13]}
        self.assertEqual(self.check(count=150, colours=ade).class_list, "ade20k")
        odd = {5: networks.COLOURS[0], 0: networks.COLOURS[10], 3: networks.COLOURS[11], 1: networks.COLOURS[13]}
        with open(self.path("list.txt"), "w", encoding="utf-8") as file:
            file.write("# mine\n5 0\n0 10\n3 11 # person\n1 13\n")
        self.check(count=7, colours=odd, class_list=self.path("list.txt"))
        self.refused("knows 7 classes", Semantic, self.path("m.onnx"))
        with open(self.path("list.txt"), "a", encoding="utf-8") as file:
            file.write("2 19\n")
        self.refused("list.txt:6: expected", Semantic, self.path("m.onnx"), class_list=self.path("list.txt"))
        self.refused("--classes takes one of cityscapes", Semantic, self.path("m.onnx"), class_list="nothing")
        voc = self.check(exact=False, count=21, colours={15: networks.COLOURS[11], 0: networks.COLOURS[0]})
        self.assertFalse(voc.knows_sky)

    def test_networks_that_do_not_fit_are_refused(self):
        self.refused("no such file", Semantic, self.path("none.onnx"))
        with open(self.path("text.onnx"), "w", encoding="utf-8") as file:
            file.write("no network")
        self.refused("not an ONNX model", Semantic, self.path("text.onnx"))
        networks.encoder(self.path("e.onnx"), prepares=True)
        self.refused("found inputs input_image float[?x?x3]", Semantic, self.path("e.onnx"))
        networks.decoder(self.path("d.onnx"))
        self.refused("expected one input with a picture", Semantic, self.path("d.onnx"))
        networks.semantic(self.path("m.onnx"))
        self.refused("expected one input (any name) float[1xHxWx3]", Semantic, self.path("m.onnx"), export="float-nhwc")
        self.refused(
            "export 'other' is not known; expected one of transformers", Semantic, self.path("m.onnx"), export="other"
        )

    def test_the_table_can_be_printed(self):
        for export in exports.EXPORTS:
            self.assertIn(export.name, exports.table_text())


class Masks(Scratch):
    def sam(self, kind="segment-anything", prepares=False, **how):
        networks.encoder(self.path("e.onnx"), kind, prepares=prepares)
        networks.decoder(self.path("d.onnx"), kind, **how)
        return Sam(self.path("e.onnx"), self.path("d.onnx"), 1)

    def overlap(self, mask, truth):
        found = np.zeros(truth.shape, bool)
        found[mask.box[1] : mask.box[3], mask.box[0] : mask.box[2]] = mask.inside
        return (found & truth).sum() / (found | truth).sum()

    def check(self, sam, **how):
        """Asserts that every object of the street is found once, and nothing else."""
        photo, truth = picture(96, 64, STREET)
        steps = []
        masks = automatic.automatic_masks(sam, photo, automatic.Settings(points=8, **how), lambda *a: steps.append(a))
        self.assertEqual(steps[-1], (64, 64))
        self.assertEqual(len(masks), 4)
        for index in (0, 10, 11, 13):
            best = max(self.overlap(mask, truth == index) for mask in masks)
            self.assertGreater(best, 0.7, index)  # a logit covers three pixels of the picture
        self.assertTrue(all(abs(mask.predicted_iou - 0.95) < 1e-6 for mask in masks))

    def test_every_known_export(self):
        self.check(self.sam())
        self.check(self.sam(prepares=True))
        self.check(self.sam(free=True))
        self.check(self.sam(single=True))
        self.check(self.sam("transformers"))
        self.check(self.sam("sam2"))
        self.assertEqual([self.sam(free=f).batch for f in (False, True)], [1, 16])

    def test_full_size_masks_are_used_without_others(self):
        networks.encoder(self.path("e.onnx"), size=384)
        networks.decoder(self.path("d.onnx"), size=384, low=False)
        sam = Sam(self.path("e.onnx"), self.path("d.onnx"), 1)  # 96 x 96 logits for a picture of 96 x 96
        photo, truth = picture(96, 96, STREET)
        masks = automatic.automatic_masks(sam, photo, automatic.Settings(points=8))
        self.assertGreater(max(self.overlap(mask, truth == 13) for mask in masks), 0.9)

    def test_filters(self):
        photo, _ = picture(96, 64, STREET)
        count = lambda **how: len(automatic.automatic_masks(self.sam(), photo, automatic.Settings(points=8, **how)))
        self.assertEqual(count(predicted_iou=0.96), 0)  # the first of the four masks, of IoU 0.99, isn't used
        self.assertEqual(count(), 4)
        self.assertEqual(count(predicted_iou=0.4), 5)  # adds the mask of the whole picture, of IoU 0.5
        self.assertEqual(count(box_nms=1.0), 64)
        self.assertEqual(count(box_nms=1.0, stability=0.0), 128)  # adds the last of the four masks, the unstable one

    def test_crops_find_small_objects(self):
        parts = ((13, 20, 20, 26, 26),)
        photo, truth = picture(240, 160, parts)
        found = []
        for layers in (0, 1):
            masks = automatic.automatic_masks(self.sam(), photo, automatic.Settings(points=16, crop_layers=layers))
            found.append(max([self.overlap(mask, truth == 13) for mask in masks], default=0))
        self.assertGreater(found[1], found[0] + 0.05)

    def test_signatures_that_do_not_fit_are_refused(self):
        networks.encoder(self.path("e.onnx"))
        networks.decoder(self.path("d.onnx"))
        networks.semantic(self.path("m.onnx"))
        self.refused(
            "expected a decoder of Segment Anything (segment-anything: inputs image_embeddings, point_coords",
            Sam,
            self.path("e.onnx"),
            self.path("m.onnx"),
        )
        self.refused(
            "e.onnx: its signature doesn't match: found inputs image float[1x3x128x128]",
            Sam,
            self.path("d.onnx"),
            self.path("e.onnx"),
        )
        self.refused("outputs image_embeddings float[1x3x32x32]", Sam, self.path("m.onnx"), self.path("d.onnx"))
        networks.encoder(self.path("wide.onnx"), channels=6)
        self.refused("expected an image encoder for the decoder", Sam, self.path("wide.onnx"), self.path("d.onnx"))
        networks.encoder(self.path("two.onnx"), "sam2")
        self.refused("expected an image encoder for the decoder", Sam, self.path("two.onnx"), self.path("d.onnx"))


class Runs(Scratch):
    """Runs the program on a driving set of two cameras."""

    FRAMES = 3

    def setUp(self):
        super().setUp()
        self.data = self.path("set")
        for folder in ("images", "intrinsics", "extrinsics"):
            os.makedirs(os.path.join(self.data, folder))
        self.photo, self.truth = picture(96, 64, STREET)
        for camera in range(2):
            self.text(f"intrinsics/{camera}.txt", "90 90 48 32 0 0 0 0 0")
            for frame in range(self.FRAMES):
                self.add_photo(frame, camera)
        self.text("dataset.json", json.dumps({"kind": "pandaset", "fps": 10}))
        self.network = self.path("labels.onnx")
        networks.semantic(self.network, size=(96, 64), shrink=1)

    def add_photo(self, frame, camera):
        Image.fromarray(self.photo).save(os.path.join(self.data, "images", f"{frame:03d}_{camera}.png"))
        self.text(f"extrinsics/{frame:03d}_{camera}.txt", f"1 0 0 {frame}\n0 1 0 0\n0 0 1 0\n0 0 0 1\n")

    def text(self, name, text):
        with open(os.path.join(self.data, name), "w", encoding="utf-8") as file:
            file.write(text)

    def command(self, *more):
        return [
            sys.executable,
            "-B",
            os.path.join(TOOLS, "segment"),
            self.data,
            "--semantic",
            self.network,
            "-j",
            "1",
            *more,
        ]

    def run_tool(self, *more, code=0):
        done = subprocess.run(self.command(*more), capture_output=True, text=True, timeout=300)
        self.assertEqual(done.returncode, code, done.stdout + done.stderr)
        return done.stdout if code == 0 else done.stderr

    def mask(self, folder, stem):
        return np.asarray(Image.open(os.path.join(self.data, folder, stem + ".png")))

    def test_pags_reads_the_output(self):
        said = self.run_tool()
        self.assertRegex(said, r"000_0.png: \d+\.\d\d s per image, 6 images, about ")
        for camera in range(2):
            for frame in range(self.FRAMES):
                stem = f"{frame:03d}_{camera}"
                self.assertTrue((self.mask("semantic", stem) == self.truth).all())
                self.assertTrue((self.mask("sky_masks", stem) == np.where(self.truth == 10, 255, 0)).all())
        facts = subprocess.run([PAGS, "info", self.data, "--json", "-"], capture_output=True, text=True, timeout=300)
        self.assertEqual(facts.returncode, 0, facts.stderr)
        notes = "\n".join(json.loads(facts.stdout)["notes"])
        self.assertIn("of 6 views 6 have sky_masks, 6 semantic", notes)
        self.assertIn("pedestrians and cyclists from semantic in 6 of 6 views", notes)

    def test_masks_refine_labels(self):
        """Coarse labels of a semantic network are refined by the masks of a finer Segment Anything."""
        networks.semantic(self.network, size=(96, 64), shrink=8)
        networks.encoder(self.path("e.onnx"), size=384)
        networks.decoder(self.path("d.onnx"), size=384)
        self.run_tool("--cameras", "0", "--frames", "0-0")
        before = (self.mask("semantic", "000_0") == self.truth).mean()
        said = self.run_tool(
            "--cameras",
            "0",
            "--frames",
            "0-0",
            "--sam",
            "--sam-encoder",
            self.path("e.onnx"),
            "--sam-decoder",
            self.path("d.onnx"),
            "--points",
            "8",
            "--overwrite",
        )
        after = (self.mask("semantic", "000_0") == self.truth).mean()
        self.assertIn("read as segment-anything, 384 pixels", said)
        self.assertGreater(after, 0.99)
        self.assertLess(before, 0.985)
        self.assertFalse(os.path.exists(os.path.join(self.data, "semantic", "001_0.png")))

    def test_output_elsewhere_and_choice_of_photographs(self):
        self.run_tool("-o", self.path("out"), "--cameras", "1", "--frames", "1-2", "--no-sky", "-q")
        self.assertEqual(sorted(os.listdir(self.path("out", "semantic"))), ["001_1.png", "002_1.png", "segment.json"])
        self.assertFalse(os.path.exists(self.path("out", "sky_masks")))
        self.assertFalse(os.path.exists(os.path.join(self.data, "semantic")))

    def test_a_stopped_run_resumes(self):
        for frame in range(self.FRAMES, 30):
            self.add_photo(frame, 0)
        folder = os.path.join(self.data, "semantic")
        process = subprocess.Popen(self.command(), stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
        deadline = time.monotonic() + 120
        while process.poll() is None and time.monotonic() < deadline:
            if os.path.isdir(folder) and len(os.listdir(folder)) > 2:
                process.send_signal(signal.SIGINT)
                break
            time.sleep(0.001)
        _, errors = process.communicate(timeout=120)
        if process.returncode == 0:
            self.skipTest("the machine was too fast to be interrupted")
        self.assertEqual(process.returncode, 3, errors)
        self.assertIn("interrupted", errors)
        self.assertNotIn("Traceback", errors)
        made = {
            name: os.stat(os.path.join(folder, name)).st_mtime_ns
            for name in os.listdir(folder)
            if name.endswith(".png")
        }
        self.assertTrue(0 < len(made) < 33)
        for name in made:
            self.assertTrue((self.mask("semantic", name[:-4]) == self.truth).all())
        for each in (folder, os.path.join(self.data, "sky_masks")):
            self.assertFalse([name for name in os.listdir(each) if name.endswith(layout.PART)])
        self.assertIn(f"{len(made)} of 33 images are already done", self.run_tool())
        self.assertEqual(len(os.listdir(folder)), 34)
        for name, when in made.items():
            self.assertEqual(os.stat(os.path.join(folder, name)).st_mtime_ns, when)
        self.assertIn("33 of 33 images are already done", self.run_tool())

    def test_special_files_are_never_replaced(self):
        """Masks are written through links and into FIFOs and devices; none of these is replaced by a file."""
        masks, kind = os.path.join(self.data, "semantic"), lambda path: stat.S_IFMT(os.lstat(path).st_mode)
        write = lambda path, data=b"new": layout.write_whole(path, lambda file: file.write(data))
        self.run_tool()
        link, away = os.path.join(masks, "000_0.png"), self.path("away.png")
        os.remove(link)
        os.symlink(away, link)  # a dangling link: the photograph still has to be processed
        self.run_tool()
        self.assertEqual((kind(link), kind(away)), (stat.S_IFLNK, stat.S_IFREG))
        self.assertTrue((self.mask("semantic", "000_0") == self.truth).all())
        fifo, got = self.path("fifo"), []
        os.mkfifo(fifo)
        reader = threading.Thread(target=lambda: got.append(pathlib.Path(fifo).read_bytes()), daemon=True)
        reader.start()
        layout.write_whole(fifo, lambda file: Image.fromarray(self.photo).save(file, "PNG"))
        reader.join(60)
        self.assertEqual(kind(fifo), stat.S_IFIFO)
        self.assertTrue((np.asarray(Image.open(io.BytesIO(got[0]))) == self.photo).all())
        os.symlink("b", self.path("a"))
        os.symlink("a", self.path("b"))
        os.mkdir(self.path("folder"))
        os.chmod(away, 0o444)
        for path, words in (
            (self.path("a"), os.strerror(errno.ELOOP)),
            (self.path("folder"), "a folder of that name exists"),
            (link, "it is read-only (mode 0444)"),
        ):
            with self.assertRaisesRegex(
                layout.SegmentError, f"{re.escape(path)}: can't be written: {re.escape(words)}"
            ):
                write(path)
        self.assertEqual([kind(self.path(name)) for name in "ab"], [stat.S_IFLNK] * 2)
        device = self.path("device")
        try:
            os.mknod(device, stat.S_IFCHR | 0o666, os.makedev(1, 3))
            os.close(os.open(device, os.O_WRONLY))
        except OSError as error:
            return print(f"devices are left out: mknod isn't permitted here ({error})")
        write(device)
        self.assertEqual(kind(device), stat.S_IFCHR)

    def test_files_of_a_killed_run_are_removed(self):
        self.run_tool()
        part = os.path.join(self.data, "semantic", ".000_0.png" + layout.PART)
        with open(part, "wb") as file:
            file.write(b"half")
        os.remove(os.path.join(self.data, "semantic", "000_0.png"))
        self.assertIn("5 of 6 images are already done", self.run_tool())
        self.assertFalse(os.path.exists(part))

    def test_other_settings_and_other_masks_are_not_mixed(self):
        self.run_tool()
        self.assertIn("made with another semantic network", self.run_tool("--mean", "0,0,0", code=1))
        self.assertIn("made with another choice of sky masks", self.run_tool("--no-sky", code=1))
        networks.semantic(self.network, size=(96, 64), shrink=4)
        self.assertIn("--overwrite", self.run_tool(code=1))
        self.assertNotIn("done already", self.run_tool("--overwrite"))
        os.remove(os.path.join(self.data, "semantic", layout.RECORD))
        self.assertIn("has masks that this tool did not make; --overwrite replaces them", self.run_tool(code=1))
        for name in os.listdir(os.path.join(self.data, "semantic")):
            os.remove(os.path.join(self.data, "semantic", name))
        self.assertIn("--no-sky keeps them", self.run_tool(code=1))
        self.run_tool("--no-sky")

    def test_bad_sets_are_explained(self):
        self.text("dataset.json", json.dumps({"labels": "waymo"}))
        self.assertIn("dataset.json: declares waymo labels for semantic", self.run_tool(code=1))
        self.text("dataset.json", "{}")
        self.text("images/001_0.png", "no picture")
        self.assertIn("001_0.png: can't be read as a picture", self.run_tool(code=1))
        self.assertTrue(os.path.exists(os.path.join(self.data, "semantic", "000_1.png")))
        self.assertIn("found none", self.run_tool("--cameras", "7", code=1))
        self.data = self.path("nowhere")
        self.assertIn("expected a driving set", self.run_tool(code=1))

    def test_usage(self):
        for more, text in (
            (["--sam"], "--sam needs --sam-encoder FILE"),
            (["--sam-encoder", "x"], "require --sam"),
            (["--majority", "2"], "--majority"),
            (["--size", "3"], "--size"),
        ):
            self.assertIn(text, self.run_tool(*more, code=2))


if __name__ == "__main__":
    if len(sys.argv) > 1:
        PAGS = sys.argv.pop(1)
    unittest.main()
