# SPDX-License-Identifier: Apache-2.0
"""Tests pags report and the report.html of pags train. The page is well-formed, needs no other file, and has the
figures of pags eval."""

import base64
import html.parser
import json
import math
import os
import re
import shutil
import signal
import subprocess
import time

import fixtures
from fixtures import SMALL, DataCase, files_below, make_dataset, png_bytes, read

VOID = {"meta", "img", "br", "link", "input", "hr"}
SHAPES = {"path", "circle", "text", "title"}
# The least PSNR in dB between a page's JPEG file and its source. With quality 82 and halved chroma, the small colourful
# pictures here reach 31 to 40 dB. A picture of another view is below 20 dB.
JPEG = 27


class Page(html.parser.HTMLParser):
    """Reads a page. Fails if the page isn't well-formed or refers to anything outside."""

    def __init__(self, path):
        super().__init__(convert_charrefs=True)
        self.stack, self.rows, self.images, self.headings, self.codes = [], [], [], [], []
        self.text = ""
        self.source = read(path).decode("utf-8")  # strict decoding fails on bytes that aren't UTF-8
        assert not re.search("[\x00-\x08\x0b-\x1f\x7f-\x9f]", self.source), "control characters"
        self.feed(self.source)
        self.close()
        assert not self.stack, self.stack

    def handle_starttag(self, tag, attributes):
        names = [name for name, _ in attributes]
        assert tag not in ("script", "iframe", "object", "embed", "link", "base", "form", "a"), tag
        assert len(names) == len(set(names)), f"{tag}: an attribute twice"
        for name, value in attributes:
            assert not name.startswith("on"), f"{tag} {name}"
            assert name not in ("href", "srcset", "action", "background", "poster"), f"{tag} {name}"
            assert name != "src" or value.startswith("data:image/jpeg;base64,"), value[:60]
            assert name != "style" or "url" not in value, value
        if tag not in VOID:
            self.stack.append(tag)
        if tag == "tr":
            self.rows.append([])
        if tag in ("td", "th"):
            self.rows[-1].append("")
        if tag in ("h1", "h2", "h3"):
            self.headings.append("")
        if tag == "img":
            self.images.append(dict(attributes))

    def handle_startendtag(self, tag, attributes):
        assert tag in SHAPES, f"<{tag}/>"

    def handle_endtag(self, tag):
        assert self.stack and self.stack[-1] == tag, f"</{tag}> in {self.stack}"
        self.stack.pop()

    def handle_data(self, data):
        if "style" in self.stack:
            assert not re.search(r"url\(|@import|://", data), data
            return
        self.text += data
        if self.stack and {"td", "th"} & set(self.stack):
            self.rows[-1][-1] += data
        if self.stack and {"h1", "h2", "h3"} & set(self.stack):
            self.headings[-1] += data

    def row(self, first):
        return next((row for row in self.rows if row and row[0] == first), None)

    def views(self):
        return [heading.split(" · ") for heading in self.headings if "dB, SSIM" in heading]

    def jpegs(self):
        return [(image["alt"], base64.b64decode(image["src"].split(",", 1)[1], validate=True)) for image in self.images]


def psnr(a, b):
    return 10 * math.log10(255**2 * len(a) / max(sum((p - q) ** 2 for p, q in zip(a, b)), 1e-9))


def rgb(path):
    width, height, channels, bits, data = fixtures.read_png(path)
    assert (channels, bits) == (3, 8)
    return width, height, data


class Report(DataCase):
    @classmethod
    def setUpClass(cls):
        super().setUpClass()
        folder = cls.shared_folder()
        cls.scene, cls.other = os.path.join(folder, "scene"), os.path.join(folder, "other")
        for out, count in [(cls.scene, 60), (cls.other, 40)]:
            done = fixtures.run("train", cls.data, "-o", out, "-n", count, "--split-every", 3, "--log-every", 5, *SMALL)
            assert done.returncode == 0, done.stderr
            assert f"report: {out}/report.html" in done.stdout, done.stdout
        done = fixtures.run("eval", cls.scene, "--json", "-", "--images", os.path.join(folder, "compared"))
        cls.compared, cls.scores = os.path.join(folder, "compared"), json.loads(done.stdout)["test"]

    def report(self, *arguments, **more):
        out = self.path("page.html")
        done = self.succeeds("report", *arguments, "-o", out, "--json", "-", **more)
        return Page(out), json.loads(done.stdout), done.stderr

    def test_training_writes_a_report(self):
        page = Page(os.path.join(self.scene, "report.html"))
        self.assertEqual(page.headings[:2], ["scene", "Figures"])
        self.assertIn(f"pags train {self.data} -o {self.scene} -n 60 --split-every 3", page.text)
        self.assertIn("PSNR, training views", page.text)
        self.assertEqual(
            page.row("trained by version")[1], json.loads(read(os.path.join(self.scene, "report.json")))["version"]
        )
        self.assertEqual(page.row("waiting for photographs")[0], "waiting for photographs")
        self.assertEqual(page.row("max_gaussians"), ["max_gaussians", "1500"])
        self.assertEqual(len(page.images), 9)

    def test_figures_are_those_of_eval(self):
        page, said, _ = self.report(self.scene)
        self.assertEqual(
            page.row("whole picture"), ["whole picture", f"{self.scores['psnr']:.2f}", f"{self.scores['ssim']:.4f}"]
        )
        self.assertEqual(
            said["scenes"],
            [
                {
                    "scene": self.scene,
                    "views": 3,
                    "measured": 3,
                    "pictures": 3,
                    "psnr": self.scores["psnr"],
                    "ssim": self.scores["ssim"],
                    "lpips": None,
                }
            ],
        )
        expected = [
            [view["name"], f"{view['psnr']:.2f} dB, SSIM {view['ssim']:.4f}"] for view in self.scores["per_view"]
        ]
        self.assertEqual(page.views(), expected)
        self.assertIn(f"{self.scores['psnr']:.2f} dB", page.text)
        self.assertIn("Means over 3 of 3 held-out views", page.text)
        self.assertEqual(page.source.count('class="line a"'), 3)  # the curves of loss, PSNR and number of Gaussians
        self.assertEqual(page.source.count('class="dot a"'), 3)

    def test_report_changes_no_other_file(self):
        before = {name: read(os.path.join(self.other, name)) for name in files_below(self.other)}
        self.succeeds("report", self.other)
        after = {name: read(os.path.join(self.other, name)) for name in files_below(self.other)}
        changed = [name for name in after if before.get(name) != after[name]]
        self.assertLessEqual(set(changed), {"report.html"})
        self.assertEqual(sorted(before), sorted(after))

    def test_pictures_match_their_captions(self):
        """The test makes the page's JPEG files the photographs of a data set. pags eval writes them as PNG files, which
        the test can read."""
        page, _, _ = self.report(self.scene)
        shutil.copytree(self.data, self.path("jpeg"))
        with open(self.path("jpeg", "transforms.json")) as file:
            transforms = json.load(file)
        frame, names = transforms["frames"][0], []
        for number, (alt, data) in enumerate(page.jpegs()):
            names.append((page.views()[number // 3][0].replace(".png", ""), alt))
            self.write(f"jpeg/images/j{number}.jpg", data)
        transforms["frames"] = [{**frame, "file_path": f"images/j{number}.jpg"} for number in range(len(names))]
        self.write("jpeg/transforms.json", json.dumps(transforms))
        self.write("x.ply", fixtures.ply_bytes(fixtures.some_splats()))
        self.succeeds(
            "eval", self.path("x.ply"), "--dataset", self.path("jpeg"), "--images", self.path("decoded"), "-q"
        )
        self.assertEqual([alt for _, alt in names], ["photograph", "rendered", "error"] * 3)
        for number, (name, alt) in enumerate(names):
            width, height, decoded = rgb(self.path("decoded", f"j{number}_photo.png"))
            self.assertEqual((width, height), (64, 48))
            _, _, photo = rgb(os.path.join(self.compared, f"{name}_photo.png"))
            _, _, render = rgb(os.path.join(self.compared, f"{name}_render.png"))
            if alt != "error":
                self.assertGreater(psnr(decoded, photo if alt == "photograph" else render), JPEG, (name, alt))
                continue
            # The map is brighter where the error is larger. Halved chroma blurs the map somewhat.
            error = [
                min(1, 4 / 3 / 255 * sum(abs(photo[i + c] - render[i + c]) for c in range(3)))
                for i in range(0, len(photo), 3)
            ]
            bright = [sum(decoded[i : i + 3]) / 765 for i in range(0, len(decoded), 3)]
            self.assertGreater(self.correlation(error, bright), 0.9, name)

    def correlation(self, a, b):
        means = [sum(values) / len(values) for values in (a, b)]
        products = [
            sum((p - means[i]) * (q - means[j]) for p, q in zip(u, v))
            for i, u, j, v in [(0, a, 1, b), (0, a, 0, a), (1, b, 1, b)]
        ]
        return products[0] / math.sqrt(products[1] * products[2])

    def test_views_left_out_are_named(self):
        page, said, _ = self.report(self.scene, "--views", 1)
        self.assertEqual((said["scenes"][0]["measured"], said["scenes"][0]["pictures"], len(page.images)), (3, 1, 3))
        self.assertEqual(page.row("whole picture")[1], f"{self.scores['psnr']:.2f}")
        self.assertIn("2 of 3 views have no picture", page.text)
        for view in self.scores["per_view"][1:]:
            self.assertIn(view["name"], page.text)
        page, _, _ = self.report(self.scene, "--views", 2)
        self.assertEqual(
            [view[0] for view in page.views()], [self.scores["per_view"][i]["name"] for i in (0, 2)]
        )  # the shown views are evenly spread
        page, _, _ = self.report(self.scene, "--views", 0)
        self.assertEqual((len(page.images), page.row("whole picture")[1]), (0, f"{self.scores['psnr']:.2f}"))

    def test_two_side_by_side(self):
        page, said, _ = self.report(self.scene, self.other)
        a, b = said["scenes"]
        self.assertEqual(page.headings[0], "scene compared with other")
        self.assertEqual(
            page.row("PSNR, held-out views"),
            ["PSNR, held-out views", f"{a['psnr']:.2f} dB", f"{b['psnr']:.2f} dB", f"{b['psnr'] - a['psnr']:+.2f} dB"],
        )
        self.assertEqual(page.row("iterations"), ["iterations", "60", "40", "-33.3 %"])
        self.assertEqual(
            [alt for alt, _ in page.jpegs()[:5]], ["photograph", "rendered, A", "rendered, B", "error, A", "error, B"]
        )
        self.assertEqual(len(page.images), 15)
        at = next(i for i, row in enumerate(page.rows) if row == ["setting", "A", "B"])
        differing = page.rows[
            at + 1 : next(i for i in range(at + 1, len(page.rows)) if page.rows[i] == ["setting", "A", "B"])
        ]
        self.assertIn(["iterations", "60", "40"], differing)
        self.assertTrue(all(a != b for _, a, b in differing), differing)
        self.assertEqual(
            (page.source.count('class="line a"'), page.source.count('class="line b"')), (4, 5)
        )  # the lines include the key and the outline of B's histogram

    def test_two_scenes_of_one_name(self):
        """Scenes of the same name are distinguished by their paths. The report works if only one of them knows the photographs."""
        shutil.copytree(self.other, self.path("b", "scene"))
        page, _, _ = self.report(self.scene, self.path("b", "scene"))
        self.assertEqual(page.headings[0], f"{self.scene} compared with {self.path('b', 'scene')}")
        described = json.loads(read(self.path("b", "scene", "scene.json")))
        self.write("b/scene/scene.json", json.dumps({**described, "dataset": None}))
        page, _, errors = self.report(self.path("b", "scene"), self.scene)
        self.assertIn("expected --dataset DATASET", errors)
        self.assertEqual([alt for alt, _ in page.jpegs()[:4]], ["photograph", "rendered, A", "rendered, B", "error, B"])
        self.succeeds("report", self.path("b", "scene") + "/")
        self.assertEqual(Page(self.path("b", "scene", "report.html")).headings[0], self.path("b", "scene") + "/")

    def test_scenes_of_other_recordings(self):
        data = make_dataset(self.path("elsewhere"), views=6)
        for i in range(6):
            os.rename(os.path.join(data, "images", f"{i:03}.png"), os.path.join(data, "images", f"x{i}.png"))
        text = read(os.path.join(data, "transforms.json")).decode()
        self.write("elsewhere/transforms.json", re.sub(r"images/00(\d)", r"images/x\1", text))
        self.succeeds("train", data, "-o", self.path("b"), "-n", 5, "-q", *SMALL)
        page, said, _ = self.report(self.scene, self.path("b"))
        self.assertEqual([scene["pictures"] for scene in said["scenes"]], [0, 0])
        self.assertIn("No view is in both.", page.text)
        self.assertIsNotNone(page.row("PSNR, held-out views"))

    def test_missing_photographs(self):
        scene, data = self.path("scene"), self.path("gone")
        shutil.copytree(self.scene, scene)
        described = json.loads(read(os.path.join(scene, "scene.json")))
        self.write("scene/scene.json", json.dumps({**described, "dataset": data}))
        page, said, errors = self.report(scene)
        self.assertIn(data, page.text)
        self.assertIn("Photographs are missing", page.text)
        self.assertIn(f"warning: {scene}: the report has no photographs: {data}", errors)
        self.assertEqual([alt for alt, _ in page.jpegs()], ["rendered"] * 3)
        self.assertEqual((said["scenes"][0]["measured"], said["scenes"][0]["psnr"]), (0, None))
        self.assertIsNone(page.row("whole picture"))
        done = fixtures.run("report", scene, "-o", self.path("strict.html"), "--strict", "-q")
        self.assertEqual(done.returncode, 1, done.stderr)
        self.assertIn("--strict", done.stderr)
        self.assertFalse(os.path.exists(self.path("strict.html")))
        self.fails(["report", scene, "--dataset", data, "-o", self.path("x.html"), "-q"], data)
        self.assertFalse(os.path.exists(self.path("x.html")))
        page, said, _ = self.report(scene, "--dataset", self.data)
        self.assertEqual(said["scenes"][0]["psnr"], self.scores["psnr"])

    def test_unreadable_photograph(self):
        data = self.path("data")
        shutil.copytree(self.data, data)
        self.write("data/images/000.png", read(os.path.join(data, "images", "000.png"))[:200])
        page, said, errors = self.report(self.scene, "--dataset", data)
        self.assertEqual((said["scenes"][0]["views"], said["scenes"][0]["measured"]), (3, 2))
        self.assertIn("000.png", errors)
        self.assertIn("Means over 2 of 3 held-out views", page.text)
        self.assertEqual([alt for alt, _ in page.jpegs()].count("rendered"), 3)

    def test_scenes_with_little_data(self):
        """Old scenes have no log, no report and no configuration. A splat file doesn't even have views."""
        scene = self.path("old")
        shutil.copytree(self.scene, scene)
        described = json.loads(read(os.path.join(scene, "scene.json")))
        self.write("old/report.json", "[]")
        self.write("old/log.jsonl", "")
        self.report(scene)
        for name in ("log.jsonl", "report.json", "report.html"):
            os.remove(os.path.join(scene, name))
        self.write("old/scene.json", json.dumps({**described, "config": None}))
        page, _, _ = self.report(scene)
        self.assertEqual(page.row("whole picture")[1], f"{self.scores['psnr']:.2f}")
        self.assertIn("There is no log.jsonl", page.text)
        self.assertIn("There is no report.json", page.text)
        page, said, _ = self.report(self.write("x.ply", fixtures.ply_bytes(fixtures.some_splats())))
        self.assertEqual((said["scenes"][0]["views"], len(page.images)), (0, 0))
        self.assertIn("There is no recorded view to show.", page.text)
        page, said, errors = self.report(self.path("x.ply"), "--dataset", self.data)
        scores = json.loads(self.succeeds("eval", self.path("x.ply"), "--dataset", self.data, "--json", "-").stdout)[
            "test"
        ]
        self.assertEqual((said["scenes"][0]["views"], said["scenes"][0]["psnr"]), (scores["views"], scores["psnr"]))
        self.assertEqual(len(page.images), 3 * scores["views"])

    def test_damaged_log(self):
        scene = self.path("scene")
        shutil.copytree(self.scene, scene)
        with open(os.path.join(scene, "log.jsonl"), "ab") as file:
            file.write(b'{"step": 61, "loss": "<b>"}\n[1, 2]\n{"step": 62, "lo')
        self.write("scene/report.json", "{<script>")
        page, _, _ = self.report(scene)
        self.assertRegex(page.text, r"2 of \d+ lines of log.jsonl can't be read")
        self.assertIn("A file of the training can't be read", page.text)
        self.assertEqual(page.source.count('class="line a"'), 3)

    def test_hostile_names(self):
        """Names with markup, quotes, control characters and bytes that aren't UTF-8 appear as text."""
        evil = "<script>alert(\"1\")</script>&amp;<img src=http://x onerror='y'>"
        data = self.path('d&"<b>')
        shutil.copytree(self.data, data)
        photo = "000&b<i>\"'.png"  # this photograph is held out, as 000.png was
        os.rename(os.path.join(data, "images", "000.png"), os.path.join(data, "images", photo))
        transforms = json.loads(read(os.path.join(data, "transforms.json")))
        transforms["frames"][0]["file_path"] = f"images/{photo}"
        self.write('d&"<b>/transforms.json', json.dumps(transforms))
        scene = self.path("s<u>&'\"")
        self.succeeds("train", data, "-o", scene, "-n", 5, "--split-every", 3, "-q", *SMALL)
        described = json.loads(read(os.path.join(scene, "scene.json")))
        knot = {
            "frame": 0,
            "time": 0,
            "trained": True,
            "world_from_object": [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0],
            "rotation": [0, 0, 0],
            "translation": [0, 0, 0],
        }
        described["objects"] = [
            {
                "id": evil,
                "class": "\x07\u202e</td>" + evil,
                "category": "vehicle",
                "size": [1, 1, 1],
                "moving": False,
                "model": None,
                "knots": [knot],
            }
        ]
        described["modelled"] = {
            "caf\u00e9_s": "\u00e9",
            evil: evil,
            "data": ["</table>", "&lt;"],
            "objects": [{"id": evil, "modelled": False, "why": "'>" + evil}],
        }
        described["config"] = {**described["config"], evil: evil}
        self.write("s<u>&'\"/scene.json", json.dumps(described))
        report = json.loads(read(os.path.join(scene, "report.json")))
        report.update(
            {
                "command_line": f"pags {evil}",
                "version": evil,
                "kernels": "</pre>\x1b[31m",
                "bad_rows": 3,
                "first_bad_row": evil,
            }
        )
        with open(os.path.join(scene, "report.json"), "wb") as file:
            file.write(json.dumps(report).encode().replace(b'"kernels": "', b'"kernels": "\xff\xc0\xaf'))
        page, _, _ = self.report(scene)
        self.assertEqual(page.headings[0], "s<u>&'\"")
        self.assertEqual(page.views()[0][0], photo)
        thing = next(row for row in page.rows if row[0] == evil and len(row) == 8)
        self.assertEqual(thing[1:5], ["\ufffd\u202e</td>" + evil, "0", "yes", "'>" + evil])
        self.assertIn(["caf\u00e9 s", "\u00e9"], page.rows)
        self.assertIn([evil, evil], page.rows)  # one row is in the modelled properties, one in the settings
        self.assertEqual(page.row("trained by version")[1], evil)
        self.assertEqual(page.row("kernels")[1], r"\xFF\xC0\xAF</pre>" + "\ufffd[31m")
        self.assertIn(["", "&lt;"], page.rows)
        self.assertIn(f"pags {evil}", page.text)
        self.assertNotIn("<script", page.source)

    def test_time_is_bounded(self):
        """A training's report shows the views that can be measured within one second. It names the others, which pags
        report can show."""
        row, views = png_bytes(2000, 1500, b"\x40\x80\xc0" * 3000000), 120
        make_dataset(self.path("big"), views=views, width=4, height=3)
        for i in range(views):
            self.write(f"big/images/{i:03}.png", row)
        transforms = json.loads(read(self.path("big/transforms.json")))
        transforms.update({"w": 2000, "h": 1500, "fl_x": 1800, "fl_y": 1800, "cx": 1000, "cy": 750})
        self.write("big/transforms.json", json.dumps(transforms))
        self.succeeds("train", self.path("big"), "-o", self.path("s"), "-n", 2, "--split-every", 2, "-q", *SMALL)
        page = Page(self.path("s", "report.html"))
        found = re.search(r"Means over (\d+) of 60 held-out views", page.text)
        self.assertTrue(found, page.text[:2000])
        self.assertLess(int(found[1]), 60)
        self.assertIn("Only evenly spaced views that fit into the time limit", page.text)
        self.assertEqual(len(page.images), 3 * int(found[1]))
        self.assertIn(f"{60 - int(found[1])} of 60 views have no picture", page.text)
        self.interrupt(self.path("s"))
        shown = [int(view[0][:3]) // 2 for view in page.views()]
        self.assertIn(0, shown)
        # The views are evenly spread, like the first numbers of a van der Corput sequence. With at least 2^k of 64
        # places, the distance between neighbours is at most 64 / 2^k.
        self.assertLessEqual(
            max(b - a for a, b in zip(shown, [*shown[1:], 60])), 64 // 2 ** (len(shown).bit_length() - 1), shown
        )

    def stopped(self, arguments, ready, number):
        """Starts the program and sends it the signal when ready(process id) is true. Returns its exit code and
        stderr."""
        run = subprocess.Popen(fixtures.program(arguments), stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
        try:
            deadline = time.monotonic() + 60
            while time.monotonic() < deadline and run.poll() is None and not ready(run.pid):
                time.sleep(0.02)
            run.send_signal(number)
            _, errors = run.communicate(timeout=60)
        finally:
            run.kill()
            run.wait()
        return run.returncode, errors

    def interrupt(self, scene):
        """Presses Ctrl-C while the report measures `scene`. No page is written, and the old page stays."""
        page = self.write("before.html", "what was there before")

        def catches(pid):
            caught = re.search(rb"SigCgt:\s*([0-9a-f]+)", read(f"/proc/{pid}/status"))
            return caught and int(caught[1], 16) >> (signal.SIGINT - 1) & 1

        code, errors = self.stopped(["report", scene, "-o", page, "-q"], catches, signal.SIGINT)
        self.assertEqual((code, errors), (3, f"pags: interrupted; {page} wasn't written\n"))
        self.assertEqual(read(page), b"what was there before")

    def train_until(self, out, number, *more):
        log = os.path.join(out, "log.jsonl")
        arguments = ["train", self.data, "-o", out, "-n", 1000000, "--log-every", 1, *SMALL, *more]
        return self.stopped(arguments, lambda _: os.path.exists(log) and os.path.getsize(log) > 2000, number)

    def test_report_of_a_stopped_run(self):
        out = self.path("scene")
        self.assertEqual(self.train_until(out, signal.SIGINT)[0], 3)
        page = Page(os.path.join(out, "report.html"))
        self.assertIn("The training was stopped before its last step", page.text)
        self.assertGreater(len(page.images), 0)
        fixtures.run("train", self.data, "-o", out, "-n", 1000000, "--resume", "--time-limit", "1s", *SMALL)
        self.assertIn("The training was resumed", Page(os.path.join(out, "report.html")).text)

    def test_new_run_removes_the_old_report(self):
        out = self.path("scene")
        self.write("scene/report.html", "of an earlier run")
        self.train_until(out, signal.SIGKILL, "--overwrite")
        self.assertIn("log.jsonl", files_below(out))
        self.assertNotIn("report.html", files_below(out))

    def test_scene_is_saved_without_its_report(self):
        out = self.path("scene")
        os.makedirs(os.path.join(out, "report.html"))
        done = self.succeeds("train", self.data, "-o", out, "-n", 3, "--resume", *SMALL)
        self.assertIn("warning: the scene was written, but its report wasn't: ", done.stderr)
        self.succeeds("info", out)

    def test_errors(self):
        self.fails(["report", self.path("none")], self.path("none"))
        self.fails(["report", self.scene, self.other], "-o FILE", code=2)
        self.fails(["report", self.scene, "a", "b"], "unexpected 'b'", code=2)
        self.fails(["report"], "SCENE is missing", code=2)
        self.fails(["report", self.scene, "--colmap", "x"], "--colmap: no effect without --dataset", code=2)
        self.fails(["report", self.scene, "-o", self.path("none", "x.html"), "-q"], self.path("none"))
        self.fails(["report", self.scene, "-o", self.folder, "-q"], self.folder)
        splats = self.write("x.ply", fixtures.ply_bytes(fixtures.some_splats()))
        self.fails(["report", splats, "-q"], splats, "-o FILE")
        self.fails(["report", os.path.join(self.scene, "log.jsonl"), "-o", self.path("x.html"), "-q"], "log.jsonl")
        self.succeeds("report", os.path.join(self.scene, "scene.json"), "-q")


class Drive(fixtures.Case):
    def test_classes_and_objects(self):
        street, scene = self.path("street"), self.path("scene")
        self.succeeds(
            "synth",
            "street",
            "-o",
            street,
            "--size",
            "128x72",
            "--frames",
            9,
            "--cameras",
            1,
            "--samples",
            2,
            "--objects",
            3,
            "--lidar-points",
            3000,
        )
        self.succeeds("train", street, "-o", scene, "-n", 30, "-q")
        page = Page(os.path.join(scene, "report.html"))
        scores = json.loads(self.succeeds("eval", scene, "--split", "test", "--json", "-").stdout)["test"]
        facts = json.loads(self.succeeds("info", scene, "--objects", "--json", "-").stdout)
        for name, region in [
            ("critical: vehicles, pedestrians, cyclists", "critical"),
            ("all else", "noncritical"),
            ("moving", "moving"),
            ("moving vehicles", "vehicles"),
        ]:
            self.assertEqual(
                page.row(name)[1:], [f"{scores['psnr_' + region]:.2f}", f"{scores['ssim_' + region]:.4f}"], name
            )
        modelled = {note["id"]: note for note in facts["modelled"]["objects"]}
        for thing in facts["every_object"]:
            row = page.row(thing["name"])
            self.assertEqual(row[1:3], [thing["class"], f"{thing['gaussians']:,}".replace(",", " ")], thing)
            self.assertEqual(row[4], modelled[thing["name"]]["why"])
        vehicles = next(one for one in facts["objects"] if one["name"] == "vehicle")
        row = page.row("vehicle")
        self.assertEqual(row[1:5], [str(vehicles[key]) for key in ("count", "critical", "moving", "own_models")])
        total = sum(thing["gaussians"] for thing in facts["every_object"] if thing["category"] == "vehicle")
        self.assertEqual(row[5:], [f"{total:,}".replace(",", " "), f"{scores['psnr_vehicles']:.2f}"])
        self.assertEqual(page.row("lidar points"), ["lidar points", str(facts["modelled"]["lidar_points"])])
        self.assertIn("Priorities, % of the Gaussians", page.text)

        # Reports on a splat file, the scene's background. Its Gaussians have numbers of objects that the file doesn't
        # describe.
        alone = self.path("alone.html")
        self.succeeds("report", os.path.join(scene, "background.ply"), "-o", alone)
        self.assertIn("There is no recorded view to show.", Page(alone).text)


if __name__ == "__main__":
    fixtures.main()
