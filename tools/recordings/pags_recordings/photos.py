# SPDX-License-Identifier: Apache-2.0
"""Photographs without cameras, or a video: COLMAP finds the cameras, and DATASET/images and DATASET/sparse/0 are what `pags train` reads.

Work lies in DATASET/colmap: the database, which COLMAP goes on with where it was stopped, and its words, which stay. DATASET/import.json, written
last, says what came of it.
"""

import hashlib
import json
import os
import re
import shutil
import sys
import warnings

import numpy as np
from PIL import Image, ImageOps
from PIL.PngImagePlugin import PngInfo

from . import colmap, lock, video
from .account import Account, lines, plural
from .display import Display
from .errors import RecordingError
from .folder import Folder
from .importing import Progress

OF_IMAGES = re.compile(r"images|input|images_.*")  # folders beside which training looks for masks: DATASET/images is to be the only one
EXHAUSTIVE = 150  # photographs of which each is compared with each other; more are compared in their order
NEXT, APART = 10, 10  # in order: each with so many that follow, with those 2, 4, 8 ... farther, and every APARTth with every other such
PART = 64  # pairs that one process of COLMAP compares at least: what is lost when it is stopped
FRAMES = 120  # pictures of a video
TURNS = {5: Image.Transpose.TRANSPOSE, 6: Image.Transpose.ROTATE_270, 7: Image.Transpose.TRANSVERSE, 8: Image.Transpose.ROTATE_90}  # by EXIF's orientation
ORIENTATION, EXIF, FOCAL, MAKE, MODEL, SPACE, INTEROPERABILITY = 0x0112, 0x8769, 0x920A, 0x010F, 0x0110, 0xA001, 0xA005
warnings.simplefilter("ignore", Image.DecompressionBombWarning)  # a photograph of 90 million pixels is none


def is_video(raw):
    return os.path.isfile(raw) and raw.lower().endswith(video.ENDINGS)


def plain(name, taken):
    """The name of a copy, without folders called images. COLMAP's lists separate names by spaces, pass over lines that begin with # and are UTF-8; it turns \\ into /."""
    *folders, file = name.split(os.sep)
    name = os.sep.join([*(folder for folder in folders if not OF_IMAGES.fullmatch(folder)), file])
    stem, ending = os.path.splitext(re.sub(r"[\\#\x00-\x20\x7f\ud800-\udfff]", "_", "_".join(name.replace(os.sep, "/").split())))
    new, number = stem + ending, 1
    while new.lower() in taken:
        number += 1
        new = f"{stem}_{number}{ending}"
    taken.add(new.lower())
    return new


def square_size(picture):
    """The size with square pixels: JPEG and PNG may state how many there are across and down an inch, or in what ratio."""
    across, down = picture.info.get("jfif_density") or picture.info.get("dpi" if picture.format == "PNG" else "") or picture.info.get("aspect") or (1, 1)
    aspect = down / across if across > 0 and down > 0 else 1
    if 0.99 < aspect < 1.01 or not 0.05 < aspect < 20:
        return picture.size
    width, height = picture.size
    return (round(width * aspect), height) if aspect > 1 else (width, round(height / aspect))


def how_stored(source, picture, exif):
    """Options of Pillow's that keep what the file says of its colours."""
    if picture.format == "PNG":
        said, kept = PngInfo(), (b"gAMA", b"cHRM", b"sRGB", b"cICP")
        with open(source, "rb") as file:
            file.seek(8)
            while len(head := file.read(8)) == 8 and head[4:] != b"IDAT":
                data = file.read(int.from_bytes(head[:4], "big") + 4)[:-4]
                if head[4:] in kept:
                    said.add(head[4:], data)
        return {"pnginfo": said}
    options = {"quality": 97, "subsampling": 0, "icc_profile": picture.info.get("icc_profile")}
    if exif.get_ifd(EXIF).get(SPACE) == 2 or exif.get_ifd(INTEROPERABILITY).get(1) == "R03":  # Adobe RGB: two ways of cameras to say it
        options["exif"] = without_turn(picture.info["exif"])
    return options


def without_turn(exif):
    """The bytes of EXIF with the orientation 1 (upright) in the first directory."""
    order = "little" if exif[6:8] == b"II" else "big"
    number = lambda at, size: int.from_bytes(exif[at : at + size], order)  # noqa: E731
    first = 6 + number(10, 4)
    for entry in range(first + 2, first + 2 + 12 * number(first, 2), 12):
        if number(entry, 2) == ORIENTATION:
            return exif[: entry + 8] + (1).to_bytes(2, order) + exif[entry + 10 :]
    return exif


class Photographs:
    """The copies that COLMAP sees, by their names below `folder`, each with what says which camera took it."""

    def __init__(self, folder):
        self.folder, self.account, self.camera, self.masks, self.damage, self.video, self.squared = folder, Account(), {}, 0, None, [], 0
        self.sizes, self.digests, self.turns, self.tried = {}, {}, {}, 0

    def is_copy(self, source, name):
        """Whether another photograph has the same bytes: held out, it would be known from training."""
        first = self.sizes.setdefault(os.path.getsize(source), (source, name))
        if first[0] == source:
            return False
        for path, known in (first, (source, name)):
            with open(path, "rb") as file:
                digest = hashlib.sha256(file.read()).digest()
            known = self.digests.setdefault(digest, known)
        if known != name:
            self.account.leave_out("photographs", f"has the same bytes as {known}", [name])
        return known != name

    def add(self, source, name):
        """Copies a photograph byte by byte; one that is turned by its EXIF orientation, or whose pixels aren't square, is written upright and square anew."""
        target = os.path.join(self.folder, *name.split("/"))
        self.tried += 1
        try:
            with Image.open(source) as picture:
                if self.is_copy(source, name):
                    return
                exif = picture.getexif()
                turned = exif.get(ORIENTATION, 1) not in (0, 1)
                size = square_size(picture)
                self.camera[name] = self.taken_by(size, picture, exif, turned)
                if not os.path.exists(target):
                    os.makedirs(os.path.dirname(target), exist_ok=True)
                    if turned or size != picture.size:
                        square = picture if size == picture.size else picture.resize(size, Image.Resampling.LANCZOS)
                        ImageOps.exif_transpose(square).save(target + ".part", picture.format, **how_stored(source, picture, exif))
                    else:
                        picture.load()
                        shutil.copyfile(source, target + ".part")
                    os.replace(target + ".part", target)
                self.squared += size != picture.size
                if turned:
                    self.turns[name] = exif[ORIENTATION]
        except (OSError, SyntaxError, ValueError, Image.DecompressionBombError) as error:
            self.account.leave_out("photographs", f"can't be read: {' '.join(str(error).split())}", [name])
            self.camera.pop(name, None)

    def add_mask(self, source, name):
        """A mask as PNG where training looks for it; turned as its photograph was, if only that fits it."""
        target = os.path.join(os.path.dirname(self.folder), "masks", *(name + ".png").split("/"))
        try:
            with Image.open(source) as picture, Image.open(os.path.join(self.folder, *name.split("/"))) as photograph:
                picture.load()
                width, height = photograph.size
                fits = lambda size: abs(size[0] * height - size[1] * width) <= max(width, height)  # noqa: E731
                stored = TURNS.get(self.turns.get(name)) if not fits(picture.size) and fits(picture.size[::-1]) else None
                if not fits(picture.size) and stored is None:
                    raise ValueError(f"{picture.size[0]} x {picture.size[1]} pixels, but the photograph has {width} x {height}")
                os.makedirs(os.path.dirname(target), exist_ok=True)
                if picture.format == "PNG" and stored is None:
                    shutil.copyfile(source, target + ".part")
                else:
                    (picture if stored is None else picture.transpose(stored)).save(target + ".part", "PNG")
                os.replace(target + ".part", target)
            self.masks += 1
        except (OSError, SyntaxError, ValueError, Image.DecompressionBombError) as error:
            self.account.leave_out("masks", f"can't be used: {' '.join(str(error).split())}", [name])

    @staticmethod
    def taken_by(size, picture, exif, turned):
        return (*(size[::-1] if turned else size), turned, str(exif.get(MAKE)), str(exif.get(MODEL)), str(exif.get_ifd(EXIF).get(FOCAL)))

    def cameras(self):
        """Names by camera, in order."""
        found = {}
        for name in sorted(self.camera):
            found.setdefault(self.camera[name], []).append(name)
        return list(found.values())


def judged_once(raw, path, show, before):
    """What video.judged says of a video's frames, kept in a file for an import that goes on."""
    status = os.stat(raw)
    mark = {"bytes": status.st_size, "modified": status.st_mtime_ns, "before": list(before)}
    try:
        with open(path, encoding="utf-8") as file:
            there = json.load(file)
        if {key: there[key] for key in mark} == mark and len(there["sharp"]) == len(there["change"]) > 0:
            return np.array(there["sharp"], float), np.array(there["change"], float), str(there["words"])
    except (OSError, ValueError, LookupError, TypeError):
        pass
    sharp, change, words = video.judged(raw, show, before)
    put(path, mark | {"sharp": sharp.tolist(), "change": change.tolist(), "words": words})
    return sharp, change, words


def gather(raw, output, pictures, quiet, people=None):
    """Fills DATASET/images."""
    folder = os.path.join(output, "images")
    os.makedirs(folder, exist_ok=True)
    photographs, progress = Photographs(folder), Progress(quiet, "photograph")
    if is_video(raw):
        video.need()
        progress = Progress(quiet, "video frame")
        progress.total = video.length(raw)
        shown = Display(raw, video.place(raw))
        photographs.video = shown.words
        if people and shown.words:
            print(f"{raw}: {'; '.join(shown.words)}", file=people)
        sharp, change, words = judged_once(raw, os.path.join(output, "colmap", "frames.json"), progress.show, shown.before)
        if words:
            photographs.damage = f"{raw} is cut or damaged; {len(sharp)} of about {progress.total} frames can be read: {words}"
        chosen = video.choose(sharp, change, pictures or FRAMES)
        photographs.account.leave_out("video frames", "sharper ones beside them are taken", count=len(sharp) - len(chosen))
        for name in video.extract(raw, chosen, folder, shown):
            photographs.add(os.path.join(folder, name), name)
    else:
        found, taken = Folder(raw, output, photographs.account), set()
        names = found.photographs
        if pictures and len(names) > pictures:
            names = [names[i * len(names) // pictures] for i in range(pictures)]
            photographs.account.leave_out("photographs", f"--pictures {pictures} chose others", count=len(found.photographs) - pictures)
        progress.total = len(names)
        for done, name in enumerate(names):
            copy = plain(name, taken)
            photographs.add(os.path.join(raw, name), copy)
            if copy in photographs.camera and name in found.masks:
                photographs.add_mask(os.path.join(raw, found.masks[name]), copy)
            progress.show(done + 1)
    progress.end()
    if len(photographs.camera) < 3:
        why = "".join(f"; {line}" for line in lines(list(photographs.account.rows.values()), 3))
        raise RecordingError(f"{raw}: {f'{len(photographs.camera)} of {photographs.tried} JPEG and PNG files can be read' if photographs.tried else 'has no JPEG or PNG files'}; cameras are found of three photographs or more{why}")
    return photographs


def pairs(names, in_order):
    """Which photographs are compared."""
    n = len(names)
    if not in_order:
        return [(a, b) for a in range(n) for b in range(a + 1, n)]
    steps = [*range(1, NEXT + 1), *(2**k for k in range(4, 30) if 2**k < n)]
    near = {(a, a + step) for a in range(n) for step in steps if a + step < n}
    return sorted(near | {(a, b) for a in range(0, n, APART) for b in range(a + APART, n, APART)})


class Work:
    """COLMAP's steps over the photographs, in DATASET/colmap."""

    def __init__(self, runner, output, photographs, quiet):
        self.runner, self.photographs, self.quiet = runner, photographs, quiet
        self.folder = os.path.join(output, "colmap")
        os.makedirs(self.folder, exist_ok=True)
        self.file = os.path.join(self.folder, "database.db")
        self.database = colmap.Database(self.file)

    def path(self, name):
        return os.path.join(self.folder, name)

    def write(self, name, lines):
        with open(self.path(name), "w", encoding="utf-8", errors="surrogateescape") as file:
            file.writelines(line + "\n" for line in lines)
        return self.path(name)

    def must(self, what, command, log, count=lambda: 0, show=lambda done: None):
        """Runs one step; its words go to a file."""
        code = colmap.run(command, log, count, show)
        if code:
            raise RecordingError(f"COLMAP failed at its {what} (code {code}): {colmap.last_words(log)[:300]}; all it said is in {log}")

    def features(self):
        there, progress = self.database.features(), Progress(self.quiet, "features of photograph")
        progress.total = len(self.photographs.camera)
        for names in self.photographs.cameras():
            if not all(name in there for name in names):
                command = self.runner.extract(self.file, self.photographs.folder, self.write("names.txt", names))
                self.must("features", command, self.path("features.log"), lambda: self.database.count("keypoints"), progress.show)
        progress.end()

    def matches(self, in_order):
        names = sorted(self.photographs.camera)
        wanted = pairs(names, in_order)
        there = {frozenset(pair[:2]) for pair in self.database.pairs()}
        left = [pair for pair in ((names[a], names[b]) for a, b in wanted) if frozenset(pair) not in there]
        progress, log = Progress(self.quiet, "pair"), self.path("pairs.log")
        progress.total, begun = len(left), 0
        while begun < len(left):
            part = left[begun : begun + max(PART, len(left) // 100)]
            self.must("pairs", self.runner.match(self.file, self.write("pairs.txt", (" ".join(pair) for pair in part))), log)
            begun += len(part)
            progress.show(begun)
        progress.end()

    def tidy(self):
        """Leaves what COLMAP said."""
        for name in os.listdir(self.folder):
            if not name.endswith(".log"):
                path = self.path(name)
                shutil.rmtree(path) if os.path.isdir(path) else os.remove(path)

    def map(self):
        """The models, best first; an interrupted one begins anew."""
        models, log = self.path("models"), self.path("cameras.log")
        shutil.rmtree(models, ignore_errors=True)
        os.makedirs(models)
        if os.path.exists(log):
            os.remove(log)
        progress = Progress(self.quiet, "camera")
        progress.total = len(self.photographs.camera)
        colmap.run(self.runner.map(self.file, self.photographs.folder, models), log, lambda: placed(log), progress.show)
        progress.end()
        found = colmap.models(models)
        if found:
            return found
        features = sorted(self.database.features().values()) or [0]
        fit = sum(fit >= colmap.INLIERS for _, _, fit in self.database.pairs())
        raise RecordingError(f"COLMAP placed no camera: the photographs have {features[0]} to {features[-1]} features, and {fit} pairs fit together; it takes sharp "
                             f"photographs of a scene that stands still, each showing most of the one before from another place ({colmap.last_words(log)[:200]}; {log})")  # fmt: skip


def placed(log):
    """Cameras that mapping has set out to place so far, by its words; the first two are none of these."""
    with open(log, "rb") as file:
        return file.read().count(b"Registering image")


def left_out(name, features, fits, other):
    """Why a photograph has no camera, most likely."""
    if name in other:
        return f"belongs to another group of {other[name]} photographs that nothing connects with the largest"
    if features.get(name, 0) < 200:
        return f"{features.get(name, 0)} features: blurred, dark or without texture"
    if not fits.get(name):
        return "shows nothing that another photograph shows"
    return f"fits {fits[name]} other{'s' if fits[name] > 1 else ''} too loosely"


def told(work, models):
    """What came of it, as import.json has it."""
    best, names = models[0], set(colmap.registered(models[0]))
    count, error = colmap.points(best)
    fits, other = {}, {}
    for a, b, fit in work.database.pairs():
        for name in (a, b):
            fits[name] = fits.get(name, 0) + (fit >= colmap.INLIERS)
    for model in reversed(models[1:]):
        group = colmap.registered(model)
        other.update(dict.fromkeys(group, len(group)))
    features = work.database.features()
    photographs = work.photographs
    for name in sorted(photographs.camera):
        if name not in names:
            photographs.account.leave_out("photographs", left_out(name, features, fits, other), [name])
    counts = {"cameras": len(photographs.cameras()), "photographs": len(photographs.camera), "masks": photographs.masks, "registered": len(names), "points": count}
    return photographs.account.result(counts | {"reprojection_error": error, "turned_upright": len(photographs.turns), "made_square": photographs.squared, "damage": photographs.damage, "video": photographs.video})


def say(output, facts, people):
    print(f"{output}: {facts['registered']} of {facts['photographs']} photographs have cameras; {facts['points']} points, mean reprojection error "
          f"{facts['reprojection_error']:.2f} px; next: pags train {output} -o SCENE", file=people)  # fmt: skip
    if facts.get("damage"):
        print(f"warning: {facts['damage']}", file=sys.stderr)
    if facts.get("masks"):
        print(f"{plural(facts['masks'], 'masks')} are in {os.path.join(output, 'masks')}, where training finds them: white where a photograph counts", file=people)
    for line in lines(facts["left_out"]):
        print(line, file=people)
    if facts["turned_upright"]:
        print(f"{facts['turned_upright']} photographs were turned by their EXIF orientation and are written upright anew (JPEG, quality 97)", file=people)
    if facts.get("made_square"):
        print(f"{facts['made_square']} photographs have pixels that are not square, and are written with square ones", file=people)


def begin(raw, output, pictures):
    """What import.json says the import is of, and what came of it if it is complete. A folder that was begun from anything else is refused."""
    asked = {"importer": "photos", "source": os.path.realpath(raw), "pictures": pictures}
    path = os.path.join(output, "import.json")
    if lock.contents(output):
        try:
            with open(path, encoding="utf-8") as file:
                there = json.load(file)
        except (OSError, ValueError):
            raise RecordingError(f"{output}: isn't empty, and no import of photographs wrote it; give another folder, or remove it") from None
        if not isinstance(there, dict) or {key: there.get(key) for key in asked} != asked:
            raise RecordingError(f"{output}: was begun from another source or with other options (see its import.json); give another folder, or remove it")
        facts = there.get("result")
        if facts and isinstance(facts["left_out"], dict):  # of version 0.2.0
            facts["left_out"] = [{"what": "photographs", "count": 1, "why": why, "which": [name]} for name, why in facts["left_out"].items()]
        return asked, facts
    put(path, asked)
    return asked, None


def put(path, content):
    os.makedirs(os.path.dirname(path), exist_ok=True)
    with open(path + ".part", "w", encoding="utf-8", errors="surrogateescape") as file:
        file.write(json.dumps(content, indent=1) + "\n")
    os.replace(path + ".part", path)


def read(raw, output, pictures, people, quiet):
    """Imports a folder of photographs or a video. Returns what came of it."""
    if not os.path.isdir(raw) and not is_video(raw):
        raise RecordingError(f"{raw}: {'is no folder and no video: ' + ' '.join(video.ENDINGS) if os.path.exists(raw) else 'is missing'}")
    if os.path.realpath(output) == os.path.realpath(raw):
        raise RecordingError(f"{output}: is the folder of the photographs itself; give another one to write to")
    runner = colmap.find()
    asked, facts = begin(raw, output, pictures)
    if facts is None:
        photographs = gather(raw, output, pictures, quiet, people)
        work = Work(runner, output, photographs, quiet)
        work.features()
        in_order = is_video(raw) or len(photographs.camera) > EXHAUSTIVE
        if in_order and people and not is_video(raw):
            print(f"{len(photographs.camera)} photographs are compared in the order of their names, as they were taken", file=people)
        work.matches(in_order)
        models = work.map()
        facts = told(work, models)
        model = os.path.join(output, "sparse", "0")
        shutil.rmtree(os.path.join(output, "sparse"), ignore_errors=True)
        os.makedirs(os.path.dirname(model))
        os.replace(models[0], model)
        work.tidy()
        put(os.path.join(output, "import.json"), asked | {"result": facts})
    if people:
        say(output, facts, people)
    return facts
