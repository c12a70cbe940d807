# SPDX-License-Identifier: Apache-2.0
"""Imports photographs without cameras, or a video: COLMAP finds the cameras; DATASET/images and DATASET/sparse/0 are the input of `pags train`.

Intermediate files are in DATASET/colmap: the database, from which COLMAP resumes after an interruption, and its logs, which stay. DATASET/import.json,
written last, has the results."""

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

OF_IMAGES = re.compile(
    r"images|input|images_.*"
)  # folders next to which training looks for masks: only DATASET/images may have such a name
EXHAUSTIVE = 150  # up to this number of photographs all pairs are matched; above it, neighbours in order
NEXT, APART = (
    10,
    10,
)  # in order: each with this number of successors, with those 2, 4, 8 ... further, and every APARTth with every other such
PART = 64  # minimum pairs per COLMAP process: the work lost by an interruption
FRAMES = 120  # frames used of a video
TURNS = {
    5: Image.Transpose.TRANSPOSE,
    6: Image.Transpose.ROTATE_270,
    7: Image.Transpose.TRANSVERSE,
    8: Image.Transpose.ROTATE_90,
}  # by EXIF orientation
ORIENTATION, EXIF, FOCAL, MAKE, MODEL, SPACE, INTEROPERABILITY = 0x0112, 0x8769, 0x920A, 0x010F, 0x0110, 0xA001, 0xA005
warnings.simplefilter("ignore", Image.DecompressionBombWarning)  # allows photographs of 90 million pixels


def is_video(raw):
    return os.path.isfile(raw) and raw.lower().endswith(video.ENDINGS)


def plain(name, taken):
    """The name of a copy, without folders named images. COLMAP's lists separate names by spaces, skip lines that begin with # and are UTF-8; it turns \\\\
    into /."""
    *folders, file = name.split(os.sep)
    name = os.sep.join([*(folder for folder in folders if not OF_IMAGES.fullmatch(folder)), file])
    stem, ending = os.path.splitext(
        re.sub(r"[\\#\x00-\x20\x7f\ud800-\udfff]", "_", "_".join(name.replace(os.sep, "/").split()))
    )
    new, number = stem + ending, 1
    while new.lower() in taken:
        number += 1
        new = f"{stem}_{number}{ending}"
    taken.add(new.lower())
    return new


def square_size(picture):
    """The size after making pixels square: JPEG and PNG may state densities or a ratio for both axes."""
    across, down = (
        picture.info.get("jfif_density")
        or picture.info.get("dpi" if picture.format == "PNG" else "")
        or picture.info.get("aspect")
        or (1, 1)
    )
    aspect = down / across if across > 0 and down > 0 else 1
    if 0.99 < aspect < 1.01 or not 0.05 < aspect < 20:
        return picture.size
    width, height = picture.size
    return (round(width * aspect), height) if aspect > 1 else (width, round(height / aspect))


def how_stored(source, picture, exif):
    """Options of Pillow that keep the file's colour information."""
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
    if (
        exif.get_ifd(EXIF).get(SPACE) == 2 or exif.get_ifd(INTEROPERABILITY).get(1) == "R03"
    ):  # Adobe RGB: cameras mark it in two ways
        options["exif"] = without_turn(picture.info["exif"])
    return options


def without_turn(exif):
    """The bytes of EXIF with orientation 1 (upright) in the first directory."""
    order = "little" if exif[6:8] == b"II" else "big"
    number = lambda at, size: int.from_bytes(exif[at : at + size], order)  # noqa: E731
    first = 6 + number(10, 4)
    for entry in range(first + 2, first + 2 + 12 * number(first, 2), 12):
        if number(entry, 2) == ORIENTATION:
            return exif[: entry + 8] + (1).to_bytes(2, order) + exif[entry + 10 :]
    return exif


class Photographs:
    """The copies for COLMAP, by name in `folder`, each with the key of its camera."""

    def __init__(self, folder):
        self.folder, self.account, self.camera, self.masks, self.damage, self.video, self.squared = (
            folder,
            Account(),
            {},
            0,
            None,
            [],
            0,
        )
        self.sizes, self.digests, self.turns, self.tried = {}, {}, {}, 0

    def is_copy(self, source, name):
        """Whether another photograph has the same bytes: training would know it although it is held out."""
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
        """Copies a photograph byte by byte; one with an EXIF rotation or non-square pixels is re-encoded upright and with square pixels."""
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
                        ImageOps.exif_transpose(square).save(
                            target + ".part", picture.format, **how_stored(source, picture, exif)
                        )
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
        """Writes a mask as PNG where training looks for it; rotated like its photograph if only that fits."""
        target = os.path.join(os.path.dirname(self.folder), "masks", *(name + ".png").split("/"))
        try:
            with Image.open(source) as picture, Image.open(os.path.join(self.folder, *name.split("/"))) as photograph:
                picture.load()
                width, height = photograph.size
                fits = lambda size: abs(size[0] * height - size[1] * width) <= max(width, height)  # noqa: E731
                stored = (
                    TURNS.get(self.turns.get(name)) if not fits(picture.size) and fits(picture.size[::-1]) else None
                )
                if not fits(picture.size) and stored is None:
                    raise ValueError(
                        f"{picture.size[0]} x {picture.size[1]} pixels, but the photograph has {width} x {height}"
                    )
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
        return (
            *(size[::-1] if turned else size),
            turned,
            str(exif.get(MAKE)),
            str(exif.get(MODEL)),
            str(exif.get_ifd(EXIF).get(FOCAL)),
        )

    def cameras(self):
        """Names by camera, in order."""
        found = {}
        for name in sorted(self.camera):
            found.setdefault(self.camera[name], []).append(name)
        return list(found.values())


def judged_once(raw, path, show, before):
    """The result of video.judged for a video's frames, cached in a file for resuming."""
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
        sharp, change, words = judged_once(
            raw, os.path.join(output, "colmap", "frames.json"), progress.show, shown.before
        )
        if words:
            photographs.damage = (
                f"{raw} is truncated or damaged; {len(sharp)} of about {progress.total} frames can be read: {words}"
            )
        chosen = video.choose(sharp, change, pictures or FRAMES)
        photographs.account.leave_out(
            "video frames", "sharper neighbours are used instead", count=len(sharp) - len(chosen)
        )
        for name in video.extract(raw, chosen, folder, shown):
            photographs.add(os.path.join(folder, name), name)
    else:
        found, taken = Folder(raw, output, photographs.account), set()
        names = found.photographs
        if pictures and len(names) > pictures:
            names = [names[i * len(names) // pictures] for i in range(pictures)]
            photographs.account.leave_out(
                "photographs", f"not selected by --pictures {pictures}", count=len(found.photographs) - pictures
            )
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
        raise RecordingError(
            f"{raw}: {f'{len(photographs.camera)} of {photographs.tried} JPEG and PNG files can be read' if photographs.tried else 'has no JPEG or PNG files'}; finding cameras requires at least three photographs{why}"
        )
    return photographs


def pairs(names, in_order):
    """The pairs of photographs to match."""
    n = len(names)
    if not in_order:
        return [(a, b) for a in range(n) for b in range(a + 1, n)]
    steps = [*range(1, NEXT + 1), *(2**k for k in range(4, 30) if 2**k < n)]
    near = {(a, a + step) for a in range(n) for step in steps if a + step < n}
    return sorted(near | {(a, b) for a in range(0, n, APART) for b in range(a + APART, n, APART)})


class Work:
    """COLMAP's steps on the photographs, in DATASET/colmap."""

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
        """Runs one step with its output in a log file."""
        code = colmap.run(command, log, count, show)
        if code:
            raise RecordingError(
                f"COLMAP failed at its {what} (code {code}): {colmap.last_words(log)[:300]}; see {log}"
            )

    def features(self):
        there, progress = self.database.features(), Progress(self.quiet, "features of photograph")
        progress.total = len(self.photographs.camera)
        for names in self.photographs.cameras():
            if not all(name in there for name in names):
                command = self.runner.extract(self.file, self.photographs.folder, self.write("names.txt", names))
                self.must(
                    "features",
                    command,
                    self.path("features.log"),
                    lambda: self.database.count("keypoints"),
                    progress.show,
                )
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
            self.must(
                "pairs", self.runner.match(self.file, self.write("pairs.txt", (" ".join(pair) for pair in part))), log
            )
            begun += len(part)
            progress.show(begun)
        progress.end()

    def tidy(self):
        """Removes the intermediate files, except COLMAP's logs."""
        for name in os.listdir(self.folder):
            if not name.endswith(".log"):
                path = self.path(name)
                shutil.rmtree(path) if os.path.isdir(path) else os.remove(path)

    def map(self):
        """The models, best first; an interrupted mapping starts again."""
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
        raise RecordingError(
            f"COLMAP placed no camera: the photographs have {features[0]} to {features[-1]} features, and {fit} pairs match; it requires sharp "
            f"photographs of a static scene, each overlapping most of the previous one from another position ({colmap.last_words(log)[:200]}; {log})"
        )


def placed(log):
    """Number of cameras that mapping has tried, from its log, without the initial two."""
    with open(log, "rb") as file:
        return file.read().count(b"Registering image")


def left_out(name, features, fits, other):
    """The most likely reason why a photograph has no camera."""
    if name in other:
        return f"in a separate group of {other[name]} photographs without matches to the largest group"
    if features.get(name, 0) < 200:
        return f"{features.get(name, 0)} features: blurred, dark or without texture"
    if not fits.get(name):
        return "shares no content with another photograph"
    return f"matches {fits[name]} other{'s' if fits[name] > 1 else ''} too weakly"


def told(work, models):
    """The results for import.json."""
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
    counts = {
        "cameras": len(photographs.cameras()),
        "photographs": len(photographs.camera),
        "masks": photographs.masks,
        "registered": len(names),
        "points": count,
    }
    return photographs.account.result(
        counts
        | {
            "reprojection_error": error,
            "turned_upright": len(photographs.turns),
            "made_square": photographs.squared,
            "damage": photographs.damage,
            "video": photographs.video,
        }
    )


def say(output, facts, people):
    print(
        f"{output}: {facts['registered']} of {facts['photographs']} photographs have cameras; {facts['points']} points, mean reprojection error "
        f"{facts['reprojection_error']:.2f} px; next: pags train {output} -o SCENE",
        file=people,
    )
    if facts.get("damage"):
        print(f"warning: {facts['damage']}", file=sys.stderr)
    if facts.get("masks"):
        print(
            f"{plural(facts['masks'], 'masks')} are in {os.path.join(output, 'masks')}, where training finds them: white where a photograph counts",
            file=people,
        )
    for line in lines(facts["left_out"]):
        print(line, file=people)
    if facts["turned_upright"]:
        print(
            f"{facts['turned_upright']} photographs with an EXIF rotation were re-encoded upright (JPEG, quality 97)",
            file=people,
        )
    if facts.get("made_square"):
        print(
            f"{facts['made_square']} photographs with non-square pixels were re-encoded with square pixels", file=people
        )


def begin(raw, output, pictures):
    """The source recorded in import.json, and the results if complete. Raises for a folder started from another source."""
    asked = {"importer": "photos", "source": os.path.realpath(raw), "pictures": pictures}
    path = os.path.join(output, "import.json")
    if lock.contents(output):
        try:
            with open(path, encoding="utf-8") as file:
                there = json.load(file)
        except (OSError, ValueError):
            raise RecordingError(
                f"{output}: not empty, and not written by an import of photographs; choose another folder, or remove it"
            ) from None
        if not isinstance(there, dict) or {key: there.get(key) for key in asked} != asked:
            raise RecordingError(
                f"{output}: an import from another source or with other options started here (see its import.json); choose another folder, or remove it"
            )
        facts = there.get("result")
        if facts and isinstance(facts["left_out"], dict):  # format of version 0.2.0
            facts["left_out"] = [
                {"what": "photographs", "count": 1, "why": why, "which": [name]}
                for name, why in facts["left_out"].items()
            ]
        return asked, facts
    put(path, asked)
    return asked, None


def put(path, content):
    os.makedirs(os.path.dirname(path), exist_ok=True)
    with open(path + ".part", "w", encoding="utf-8", errors="surrogateescape") as file:
        file.write(json.dumps(content, indent=1) + "\n")
    os.replace(path + ".part", path)


def read(raw, output, pictures, people, quiet):
    """Imports a folder of photographs or a video. Returns the results."""
    if not os.path.isdir(raw) and not is_video(raw):
        raise RecordingError(
            f"{raw}: {'neither a folder nor a video: ' + ' '.join(video.ENDINGS) if os.path.exists(raw) else 'is missing'}"
        )
    if os.path.realpath(output) == os.path.realpath(raw):
        raise RecordingError(f"{output}: is the folder of the photographs; choose another folder to write")
    runner = colmap.find()
    asked, facts = begin(raw, output, pictures)
    if facts is None:
        photographs = gather(raw, output, pictures, quiet, people)
        work = Work(runner, output, photographs, quiet)
        work.features()
        in_order = is_video(raw) or len(photographs.camera) > EXHAUSTIVE
        if in_order and people and not is_video(raw):
            print(
                f"{len(photographs.camera)} photographs are matched in the order of their names, assumed to be that of capture",
                file=people,
            )
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
