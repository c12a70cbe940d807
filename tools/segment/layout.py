# SPDX-License-Identifier: Apache-2.0
"""The data set on disk: lists the photographs, writes the masks, and finds the masks that a former run has written.

The layout is drivestudio's: images/TTT_C.jpg or .png are read; semantic/TTT_C.png and sky_masks/TTT_C.png are
written, each atomically. semantic/segment.json records the settings that the masks were made with, so that a run goes
on only with the same settings.
"""

import errno
import io
import json
import os
import re
import stat

import numpy as np
from PIL import Image

from .errors import SegmentError

PICTURE = re.compile(r"(\d+)_(\d+)\.(jpg|jpeg|png)$", re.IGNORECASE)
MASK = re.compile(r"\d+_\d+\.png$", re.IGNORECASE)
PART = ".part"
RECORD = "segment.json"


class Photo:
    def __init__(self, folder, name):
        match = PICTURE.match(name)
        self.path = os.path.join(folder, name)
        self.name = name
        self.stem = name[: match.start(3) - 1]
        self.frame, self.camera = int(match[1]), int(match[2])

    def load(self):
        """Loads the photograph as uint8 [h][w][3], RGB; a rotation in its metadata is ignored, as the data set's
        reader does."""
        try:
            with Image.open(self.path) as image:
                return np.asarray(image.convert("RGB"))
        except (OSError, Image.DecompressionBombError, SyntaxError) as error:
            raise SegmentError(f"{self.path}: can't be read as a picture: {error}") from None


def list_photos(dataset, cameras=None, frames=None):
    folder = os.path.join(dataset, "images")
    try:
        names = os.listdir(folder)
    except OSError as error:
        raise SegmentError(
            f"{folder}: {error.strerror}; expected a driving set with pictures images/TTT_C.jpg or .png"
        ) from None
    photos = [Photo(folder, name) for name in names if PICTURE.match(name)]
    photos = [
        p for p in photos if (not cameras or p.camera in cameras) and (not frames or frames[0] <= p.frame <= frames[1])
    ]
    if not photos:
        raise SegmentError(
            f"{folder}: expected pictures named TTT_C.jpg or TTT_C.png of the cameras and frames asked for, found none"
        )
    return sorted(photos, key=lambda p: (p.frame, p.camera))


def check_labels(dataset):
    """Checks that dataset.json names no labels other than Cityscapes' train ids, in which label images are
    written."""
    path = os.path.join(dataset, "dataset.json")
    if not os.path.exists(path):
        return
    try:
        with open(path, encoding="utf-8") as file:
            labels = json.load(file).get("labels", "cityscapes")
    except (OSError, ValueError, AttributeError) as error:
        raise SegmentError(f"{path}: expected a description of a data set: {error}") from None
    if str(labels).split(" ")[0] not in ("cityscapes", "step"):
        raise SegmentError(
            f"{path}: declares {labels} labels for semantic, but this tool writes Cityscapes train ids; "
            f"change 'labels' to \"cityscapes\" or remove it"
        )


def writes_straight(path):
    """Whether the path is a device or a FIFO, which is written directly. Raises OSError for a folder, a loop of
    links, and a read-only file, even for root."""
    try:
        mode = os.stat(path).st_mode
    except FileNotFoundError:
        return False
    if stat.S_ISDIR(mode):
        raise IsADirectoryError(errno.EISDIR, "a folder of that name exists")
    if not mode & 0o222:
        raise PermissionError(errno.EACCES, f"it is read-only (mode {mode & 0o7777:04o})")
    if not os.access(path, os.W_OK):
        raise PermissionError(errno.EACCES, os.strerror(errno.EACCES))
    return not stat.S_ISREG(mode)


def write_whole(path, write):
    """Writes a file atomically: calls write(file) on a temporary file in the same folder, then renames it. As in the engine (engine/base/file.h), only
    regular files are replaced: devices and FIFOs are written directly, links are followed."""
    part = None
    try:
        if writes_straight(path):
            whole = io.BytesIO()  # devices and FIFOs can't seek
            write(whole)
            with open(path, "wb") as file:
                file.write(whole.getbuffer())
            return
        target = os.path.realpath(path)
        part = os.path.join(os.path.dirname(target), "." + os.path.basename(target) + PART)
        with open(part, "wb") as file:
            write(file)
            file.flush()
            os.fsync(file.fileno())
        os.replace(part, target)
    except OSError as error:
        raise SegmentError(f"{path}: can't be written: {error.strerror or error}") from None
    finally:
        if part and os.path.exists(part):
            os.remove(part)


class Output:
    """The output folders and the record of the settings; with `sky` False, sky_masks is left unchanged."""

    def __init__(self, root, sky):
        self.semantic = os.path.join(root, "semantic")
        self.sky = os.path.join(root, "sky_masks") if sky else None
        self.record = os.path.join(self.semantic, RECORD)

    def folders(self):
        return [folder for folder in (self.semantic, self.sky) if folder]

    def prepare(self, settings, overwrite):
        try:
            for folder in self.folders():
                os.makedirs(folder, exist_ok=True)
                for name in os.listdir(folder):
                    if name.startswith(".") and name.endswith(PART):
                        os.remove(os.path.join(folder, name))
            if overwrite:
                self.clear()
        except OSError as error:
            raise SegmentError(f"{error.filename}: {error.strerror}") from None
        if os.path.exists(self.record):
            self.check_record(settings)
        else:
            self.check_foreign()
            text = json.dumps(settings, indent=1) + "\n"
            write_whole(self.record, lambda file: file.write(text.encode()))

    def clear(self):
        """Removes the masks of a former run. The record is removed first, so that the masks left by an interrupted
        removal count as made by another program and are not reused."""
        if os.path.exists(self.record):
            os.remove(self.record)
        for folder in self.folders():
            for name in os.listdir(folder):
                if MASK.match(name) and os.path.isfile(os.path.join(folder, name)):
                    os.remove(os.path.join(folder, name))

    def check_foreign(self):
        for folder in self.folders():
            if any(MASK.match(name) for name in os.listdir(folder)):
                more = "" if folder == self.semantic else ", --no-sky keeps them"
                raise SegmentError(f"{folder}: has masks that this tool did not make; --overwrite replaces them{more}")

    def check_record(self, settings):
        try:
            with open(self.record, encoding="utf-8") as file:
                former = json.load(file)
        except (OSError, ValueError) as error:
            raise SegmentError(
                f"{self.record}: expected the record of a former run: {error}; --overwrite starts again"
            ) from None
        wanted = json.loads(json.dumps(settings))
        for key in sorted({*former, *wanted} if isinstance(former, dict) else {"record"}):
            if not isinstance(former, dict) or former.get(key) != wanted.get(key):
                raise SegmentError(
                    f"{self.record}: the masks here were made with another {key}; pass the same, or --overwrite "
                    f"to start again"
                )

    def path(self, folder, photo):
        return os.path.join(folder, photo.stem + ".png")

    def done(self, photo):
        return all(os.path.exists(self.path(folder, photo)) for folder in self.folders())

    def write(self, photo, labels, sky):
        """Writes the masks of a photograph; the label image last, so that an interrupted write doesn't count as
        done."""
        if self.sky:
            self.save(self.sky, photo, np.where(sky, np.uint8(255), np.uint8(0)))
        self.save(self.semantic, photo, labels)

    def save(self, folder, photo, plane):
        image = Image.fromarray(plane)
        write_whole(self.path(folder, photo), lambda file: image.save(file, "PNG"))
