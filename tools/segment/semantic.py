# SPDX-License-Identifier: Apache-2.0
"""Runs a semantic segmentation network: from a photograph to the train id of every pixel."""

import numpy as np
from PIL import Image

from . import classes, exports
from .errors import SegmentError
from .models import Model

STRIP = 64  # output rows interpolated at once, to bound memory: 150 classes x 64 x 1920 floats are 74 MB


def find_output(model):
    """Returns the first output whose type and rank fit labels or scores; most exports put auxiliary outputs after
    it."""
    for tensor in model.outputs:
        rank = len(tensor.shape)
        if (tensor.is_float and rank == 4) or (tensor.is_integer and rank in (3, 4)):
            return tensor
    return None


def choose_export(model, asked):
    """Finds the export of a model; returns it with the picture's input and the labels' output. Raises if none
    fits."""
    picture, labels = model.inputs[0] if len(model.inputs) == 1 else None, find_output(model)
    export = exports.named(asked) if asked else None
    if asked and not export:
        raise SegmentError(
            f"export '{asked}' is not known; expected one of {', '.join(e.name for e in exports.EXPORTS)}"
        )
    if not picture or not labels:
        raise model.refuse(exports.expectation(export))
    if export:
        if not exports.fits(export, picture, labels, ignore_names=True):
            raise model.refuse(exports.expectation(export))
        return export, picture, labels
    for export in exports.EXPORTS:
        if exports.fits(export, picture, labels):
            return export, picture, labels
    raise model.refuse(exports.expectation())


def channel_axis(tensor):
    """The axis of the classes in scores: -1 if only the last dimension is a known number of classes, else 1."""
    second, last = tensor.shape[1], tensor.shape[3]
    if last in classes.BY_COUNT and second not in classes.BY_COUNT:
        return -1
    return 1


def positions(count, size):
    """Positions for linear interpolation from `size` samples to `count`, with the outer edges aligned: returns lower
    index, upper index, and weight of the upper."""
    at = np.clip((np.arange(count) + 0.5) * size / count - 0.5, 0, size - 1)
    low = np.floor(at).astype(np.int64)
    return low, np.minimum(low + 1, size - 1), (at - low).astype(np.float32)


def enlarge_argmax(scores, height, width):
    """Interpolates scores [C][h][w] bilinearly to height x width and returns the best class of every pixel."""
    scores = np.ascontiguousarray(scores, np.float32)
    out = np.empty((height, width), np.int64)
    top, bottom, down = positions(height, scores.shape[1])
    left, right, across = positions(width, scores.shape[2])
    for begin in range(0, height, STRIP):
        rows = slice(begin, min(begin + STRIP, height))
        weight = down[rows][None, :, None]
        strip = scores[:, top[rows]] * (1 - weight) + scores[:, bottom[rows]] * weight
        strip = strip[:, :, left] * (1 - across) + strip[:, :, right] * across
        out[rows] = strip.argmax(axis=0)
    return out


def nearest(labels, height, width):
    rows = ((np.arange(height) + 0.5) * labels.shape[0] / height).astype(np.int64)
    columns = ((np.arange(width) + 0.5) * labels.shape[1] / width).astype(np.int64)
    return labels[rows[:, None], columns[None, :]]


class Semantic:
    """A network, its export and its class list. `size`, `mean` and `std` override the export's values unless None."""

    def __init__(self, path, threads=0, export=None, class_list=None, size=None, mean=None, std=None):
        self.model = Model(path, threads)
        self.export, self.picture, self.labels = choose_export(self.model, export)
        if self.export.integer_input and (mean or std):
            raise SegmentError(f"{path}: takes bytes as they are ({self.export.name}); --mean and --std do nothing")
        self.mean = np.asarray(mean or self.export.normal[0], np.float32)
        self.std = np.asarray(std or self.export.normal[1], np.float32)
        self.fixed = self.fixed_size()
        if size and self.fixed and size != self.fixed:
            raise self.model.refuse(f"an input of {size[0]}x{size[1]} pixels, as --size says, or of any size")
        self.size = size or self.fixed
        count = self.class_count()
        if count is None and not self.labels.is_integer and not class_list:
            raise SegmentError(
                f"{path}: the file leaves open how many classes {self.labels} has; say with --classes what they are"
            )
        self.class_list, table = classes.choose(class_list, count)
        self.lookup = classes.lookup(table, count)

    def fixed_size(self):
        shape = self.picture.shape
        height, width = shape[2:] if self.export.layout == "NCHW" else shape[1:3]
        return (width, height) if width and height else None

    def class_count(self):
        if self.labels.is_integer:
            return None
        return self.labels.shape[channel_axis(self.labels)]

    @property
    def knows_sky(self):
        return classes.SKY in self.lookup

    def describe(self):
        size = "x".join(map(str, self.size)) if self.size else f"any size (longer side {self.export.longest})"
        return (
            f"{self.model.path}: read as {self.export.name} ({self.picture.name}, {size}), classes of {self.class_list}"
        )

    def settings(self):
        return {
            "export": self.export.name,
            "classes": self.class_list,
            "size": self.size,
            "mean": self.mean.tolist(),
            "std": self.std.tolist(),
        }

    def target_size(self, width, height):
        if self.size:
            return self.size
        shrink = min(1, self.export.longest / max(width, height))
        step = self.export.multiple
        return tuple(max(step, round(side * shrink / step) * step) for side in (width, height))

    def prepare(self, photo):
        """Converts a photograph (uint8 [h][w][3], RGB) to the network's input."""
        width, height = self.target_size(photo.shape[1], photo.shape[0])
        small = np.asarray(Image.fromarray(photo).resize((width, height), Image.Resampling.BILINEAR))
        if self.export.bgr:
            small = small[:, :, ::-1]
        if not self.export.integer_input:
            small = (small.astype(np.float32) * np.float32(self.export.scale) - self.mean) / self.std
        if self.export.layout == "NCHW":
            small = small.transpose(2, 0, 1)
        return np.ascontiguousarray(small[None], self.picture.dtype)

    def best_classes(self, found, height, width):
        if found.ndim == 4 and self.labels.is_integer:
            found = found[:, 0] if found.shape[1] == 1 else found[..., 0]
        if found.ndim == 3:
            return nearest(found[0].astype(np.int64), height, width)
        scores = found[0]
        if channel_axis(self.labels) == -1:
            scores = scores.transpose(2, 0, 1)
        return enlarge_argmax(scores, height, width)

    def label(self, photo):
        """Labels a photograph: returns train ids, uint8 [h][w], 255 for unknown."""
        height, width = photo.shape[:2]
        found = self.model.run([self.labels.name], {self.picture.name: self.prepare(photo)})[0]
        best = self.best_classes(found, height, width)
        return self.lookup[np.where((best < 0) | (best >= len(self.lookup)), len(self.lookup) - 1, best)]
