# SPDX-License-Identifier: Apache-2.0
"""Classifies the files in a folder of photographs: photographs, masks, smaller copies and maps, unsupported picture formats, videos, system files. The report
counts every file that is not read."""

import os
import re

from PIL import Image

from . import video

ENDINGS = (".jpg", ".jpeg", ".png")
RAW = (".dng", ".cr2", ".cr3", ".nef", ".arw", ".raf", ".orf", ".rw2", ".pef", ".srw", ".gpr")
OTHERS = (
    ".heic",
    ".heif",
    ".tif",
    ".tiff",
    ".webp",
    ".avif",
    ".bmp",
    ".gif",
    ".jxl",
    ".jp2",
    ".exr",
    ".jpe",
    ".jfif",
    ".mpo",
    *RAW,
)
SYSTEM = ("thumbs.db", "ehthumbs.db", "desktop.ini", "icon\r")
SYSTEM_FOLDERS = ("__macosx", "@eadir", "#recycle", "$recycle.bin", "lost+found", "system volume information")
MASKS = ("mask", "masks")
LIKE_MASKS = re.compile(r"(^|[ ._-])masks?($|[ ._-])")
MAPS = re.compile(
    r"(depths?|normals?|semantics?|segmentations?|segs?|labels?|alphas?|mattes?|flows?|thumbs?|thumbnails?|previews?|proxy|proxies|undistorted)([ _-](maps?|images?))?"
)
SMALLER = re.compile(r"(.+)_(2|4|8|16)")
SHADES = 16  # a grey picture with at most this number of values is a mask or a label map


class Folder:
    """The photographs below a folder by relative path, sorted, and the path of each one's mask."""

    def __init__(self, root, output, account):
        self.root, self.account, self.masks = root, account, {}
        pictures = self.walk(output)
        inner = [name for name in pictures if any(LIKE_MASKS.search(part.lower()) for part in name.split(os.sep)[:-1])]
        outer = [name for name in pictures if name not in set(inner)] if len(inner) < len(pictures) else pictures
        self.stems = {}  # folders of photographs by file name without extension
        for name in outer:
            self.stems.setdefault(stem_of(name), []).append(name)
        self.photographs = [name for name in outer if not self.is_named_mask(name) and not self.is_map(name)]
        self.known = set(self.photographs)
        if outer is not pictures:
            for name in inner:
                self.sort_mask(name)

    def walk(self, output):
        """Supported pictures, by file name extension; counts all other files."""
        pictures, skipped = [], os.path.realpath(output)

        def unreadable(error):
            self.account.leave_out(
                "folders", f"can't be read: {error.strerror}", [os.path.relpath(error.filename, self.root)]
            )

        rest = []
        for place, folders, files in os.walk(self.root, onerror=unreadable):
            below = os.path.relpath(place, self.root)
            path_of = lambda name, below=below: os.path.normpath(os.path.join(below, name))  # noqa: E731
            system = any(
                part.startswith(".") or part.lower() in SYSTEM_FOLDERS for part in below.split(os.sep) if part != "."
            )
            self.account.leave_out(
                "folders",
                "are links, which are not followed",
                sorted(path_of(name) for name in folders if os.path.islink(os.path.join(place, name))),
            )
            folders[:] = sorted(name for name in folders if os.path.realpath(os.path.join(place, name)) != skipped)
            for name in sorted(files):
                if system or name.startswith(".") or name.lower() in SYSTEM:
                    self.account.leave_out("files", "hidden or system files", [path_of(name)])
                elif name.lower().endswith(ENDINGS):
                    pictures.append(path_of(name))
                else:
                    rest.append(path_of(name))
        stems = {os.path.splitext(name)[0].lower() for name in pictures}
        for name in rest:
            ending = os.path.splitext(name)[1].lower()
            if ending in OTHERS and os.path.splitext(name)[0].lower() in stems:
                self.account.leave_out("pictures", f"{ending[1:].upper()} with a JPEG or PNG of the same name", [name])
            elif ending in OTHERS:
                what = (
                    "masks"
                    if any(LIKE_MASKS.search(part.lower()) for part in os.path.dirname(name).split(os.sep))
                    else "photographs"
                )
                self.account.leave_out(
                    what, f"{ending[1:].upper()} is not supported; convert to JPEG or PNG first", [name]
                )
            elif ending in video.ENDINGS:
                self.account.leave_out("videos", "videos are imported separately: pass the video file as RAW", [name])
            else:
                self.account.leave_out("files", "not photographs by their file name extensions", [name])
        return sorted(pictures)

    def is_named_mask(self, name):
        """A picture whose name marks it as the mask of another in the same folder: a.jpg.png, a_mask.png."""
        place, file = os.path.split(name)
        stem = os.path.splitext(file)[0]
        without = re.fullmatch(r"(.+)[ ._-]mask", stem, re.IGNORECASE)
        beside = [
            other
            for other in self.stems.get(without[1].lower() if without else os.path.splitext(stem)[0].lower(), ())
            if os.path.dirname(other) == place and other != name
        ]
        beside = beside if without else [other for other in beside if os.path.basename(other).lower() == stem.lower()]
        if len(beside) == 1:
            self.put_mask(beside[0], name)
        return len(beside) == 1

    def is_map(self, name):
        """A smaller copy, or a map of depths, labels etc., of a photograph of the same name in another folder."""
        parts = name.split(os.sep)
        others = [other for other in self.stems[stem_of(name)] if os.path.dirname(other) != os.path.dirname(name)]
        folders = {os.path.dirname(other) for other in others}
        for i, part in enumerate(parts[:-1] if others else ()):
            smaller = SMALLER.fullmatch(part)
            if smaller and os.sep.join([*parts[:i], smaller[1], *parts[i + 1 : -1]]) in folders:
                self.account.leave_out("pictures", f"smaller copies of the photographs in {smaller[1]}", [name])
                return True
            if MAPS.fullmatch(part.lower()):
                self.account.leave_out(
                    "pictures",
                    f"in a folder {part}, with the names of photographs elsewhere: treated as their copies or maps",
                    [name],
                )
                return True
        if (
            others
            and has_few_shades(os.path.join(self.root, name))
            and not all(has_few_shades(os.path.join(self.root, other)) for other in others)
        ):
            self.account.leave_out(
                "pictures",
                f"grey with at most {SHADES} values and the names of photographs elsewhere; if these are masks, put them into a folder named masks",
                [name],
            )
            return True
        return False

    def sort_mask(self, name):
        """A picture in a folder named after masks whose path without that folder, or with another in its place, is a photograph's."""
        parts = name.split(os.sep)
        at = next(i for i, part in enumerate(parts) if LIKE_MASKS.search(part.lower()))
        before, after, file = parts[:at], parts[at + 1 : -1], parts[-1]
        whole = os.path.splitext(file)[0].lower()
        fitting = []
        for other in {*self.stems.get(whole, ()), *self.stems.get(os.path.splitext(whole)[0], ())} & self.known:
            *folder, own = other.split(os.sep)
            end = len(folder) - len(after)
            if (
                (own.lower() == whole or os.path.splitext(own)[0].lower() == whole)
                and end >= at
                and folder[:at] == before
                and folder[end:] == after
            ):
                fitting.append((end, other))
        nearest = [other for end, other in fitting if end == min(fitting)[0]]
        if parts[at].lower() not in MASKS:
            self.account.leave_out(
                "masks",
                f"in {parts[at]}: training only uses masks in a folder named masks, white where a photograph counts",
                [name],
            )
        elif len(nearest) != 1:
            self.account.leave_out(
                "masks", "belong to several photographs" if nearest else "have no photograph of the same name", [name]
            )
        else:
            self.put_mask(nearest[0], name)

    def put_mask(self, photograph, name):
        if self.masks.setdefault(photograph, name) != name:
            self.account.leave_out("masks", "their photographs also have other masks", [name])


def stem_of(name):
    return os.path.splitext(os.path.basename(name))[0].lower()


def has_few_shades(path):
    try:
        with Image.open(path) as picture:
            return picture.mode in ("1", "L", "P") and picture.convert("L").getcolors(SHADES) is not None
    except (OSError, SyntaxError, ValueError, Image.DecompressionBombError):
        return False
