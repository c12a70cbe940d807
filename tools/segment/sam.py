# SPDX-License-Identifier: Apache-2.0
"""Runs Segment Anything from two ONNX files: an image encoder, and a decoder from points to masks.

Known exports, recognised by the decoder's inputs:
  segment-anything  facebookresearch's export_onnx_model.py for the decoder, with samexporter's, MobileSAM's or any encoder of
                    [1x3xSxS] (normalised and padded here) or [HxWx3] (which normalises and pads by itself)
  transformers      optimum's and transformers.js's vision_encoder and prompt_encoder_mask_decoder
  sam2              samexporter's and its kind: the picture stretched to a square, features of three sizes
All of them output logits at a quarter of the encoder's size, which are enlarged here: the full-size masks of
segment-anything's exports are cropped for the picture that the export was traced with, and wrong for other pictures.
"""

import dataclasses

import numpy as np
from PIL import Image

from .errors import SegmentError
from .models import Model

# Mean and standard deviation of ImageNet for samples from 0 to 255, as Segment Anything writes them.
MEAN = np.array([123.675, 116.28, 103.53], np.float32)
STD = np.array([58.395, 57.12, 57.375], np.float32)
USUAL_SIZE = 1024
BATCH = 16  # points per call if the decoder takes any number of prompts


@dataclasses.dataclass(frozen=True)
class Kind:
    name: str
    features: tuple  # decoder inputs that the encoder outputs
    points: str
    labels: str
    others: tuple  # further decoder inputs that are set
    masks: tuple  # outputs that may contain the masks, preferred ones first
    scores: str
    stretched: bool = False  # the picture is stretched to the square instead of padded


KINDS = (
    Kind(
        "segment-anything",
        ("image_embeddings",),
        "point_coords",
        "point_labels",
        ("mask_input", "has_mask_input", "orig_im_size"),
        ("low_res_masks", "masks"),
        "iou_predictions",
    ),
    Kind(
        "transformers",
        ("image_embeddings", "image_positional_embeddings"),
        "input_points",
        "input_labels",
        (),
        ("pred_masks",),
        "iou_scores",
    ),
    Kind(
        "sam2",
        ("image_embed", "high_res_feats_0", "high_res_feats_1"),
        "point_coords",
        "point_labels",
        ("mask_input", "has_mask_input"),
        ("low_res_masks", "masks"),
        "iou_predictions",
        stretched=True,
    ),
)


def expectation():
    lines = [
        f"{k.name}: inputs {', '.join([*k.features, k.points, k.labels, *k.others])}; outputs {k.masks[0]}"
        f"{' or ' + k.masks[1] if len(k.masks) > 1 else ''}, {k.scores}"
        for k in KINDS
    ]
    return "a decoder of Segment Anything (" + " | ".join(lines) + ")"


def decoder_kind(model):
    names = {tensor.name for tensor in model.inputs}
    for kind in KINDS:
        needed = {*kind.features, kind.points, kind.labels}
        if needed <= names <= needed | {*kind.others, "orig_im_size"} and model.output(kind.scores):
            if any(model.output(name) for name in kind.masks):
                return kind
    raise model.refuse(expectation())


def same_shape(a, b):
    return len(a) == len(b) and all(x is None or y is None or x == y for x, y in zip(a, b))


def size_by_masks(decoder):
    """The encoder's size if its file doesn't state it: four times the size of the decoder's mask input, else 1024."""
    mask = decoder.input("mask_input")
    return 4 * mask.shape[2] if mask and len(mask.shape) == 4 and mask.shape[2] else USUAL_SIZE


class Encoder:
    """The image encoder: computes a picture's features as a dict by the decoder's input names."""

    def __init__(self, path, decoder, kind, threads):
        self.model = Model(path, threads)
        self.kind = kind
        self.picture = self.model.inputs[0] if len(self.model.inputs) == 1 else None
        self.outputs = self.match(decoder)
        shape = self.picture.shape if self.picture and self.picture.is_float else ()
        self.prepares = len(shape) == 3 and shape[2] == 3 and not kind.stretched
        if not self.prepares and not (len(shape) == 4 and shape[1] == 3 and shape[2] == shape[3]):
            raise self.refuse(decoder)
        self.size = (None if self.prepares else shape[2]) or size_by_masks(decoder)

    def refuse(self, decoder):
        features = ", ".join(str(decoder.input(name)) for name in self.kind.features)
        return self.model.refuse(
            f"an image encoder for the decoder {decoder.path} ({self.kind.name}): one input float[1x3xSxS]"
            f"{'' if self.kind.stretched else ' or float[HxWx3]'}, outputs {features}"
        )

    def match(self, decoder):
        """Assigns this model's outputs to the decoder's feature inputs: by name, or, if there is only one of each, by
        shape."""
        found = {name: self.model.output(name) for name in self.kind.features}
        if len(found) == 1 and len(self.model.outputs) == 1:
            found = {self.kind.features[0]: self.model.outputs[0]}
        for name, tensor in found.items():
            if not tensor or not tensor.is_float or not same_shape(tensor.shape, decoder.input(name).shape):
                raise self.refuse(decoder)
        return found

    def place(self, width, height):
        """The size of a picture within the encoder's square, pixels."""
        if self.kind.stretched:
            return self.size, self.size
        scale = self.size / max(width, height)
        return max(1, int(width * scale + 0.5)), max(1, int(height * scale + 0.5))

    def prepare(self, photo):
        width, height = self.place(photo.shape[1], photo.shape[0])
        small = np.asarray(Image.fromarray(photo).resize((width, height), Image.Resampling.BILINEAR), np.float32)
        if self.prepares:
            return small.astype(self.picture.dtype)
        square = np.zeros((1, 3, self.size, self.size), self.picture.dtype)
        square[0, :, :height, :width] = ((small - MEAN) / STD).transpose(2, 0, 1)
        return square

    def features(self, photo):
        names = list(self.outputs)
        found = self.model.run([self.outputs[name].name for name in names], {self.picture.name: self.prepare(photo)})
        return dict(zip(names, found))


class Sam:
    """Encoder and decoder together: call `set_picture` once per picture, then `predict` for each batch of points."""

    def __init__(self, encoder_path, decoder_path, threads=0):
        self.decoder = Model(decoder_path, threads)
        self.kind = decoder_kind(self.decoder)
        self.encoder = Encoder(encoder_path, self.decoder, self.kind, threads)
        self.masks = next(name for name in self.kind.masks if self.decoder.output(name))
        prompts = self.decoder.input(self.kind.points).shape
        self.batch = BATCH if prompts and prompts[1 if self.kind.name == "transformers" else 0] is None else 1
        self.features = None
        self.width = self.height = 0

    def describe(self):
        return f"{self.decoder.path}: read as {self.kind.name}, {self.encoder.size} pixels, {self.batch} points at once"

    def set_picture(self, photo):
        self.height, self.width = photo.shape[:2]
        self.features = self.encoder.features(photo)

    def feed(self, points):
        """The decoder's inputs for a batch of points, each a prompt of its own; exports that expect a box get a
        padding point of label -1, which means no box."""
        count, placed = len(points), self.encoder.place(self.width, self.height)
        coordinates = np.asarray(points, np.float32) * (np.array(placed, np.float32) / (self.width, self.height))
        if self.kind.name == "transformers":
            at, labels = coordinates[None, :, None], np.ones((1, count, 1))
        else:
            at = np.stack([coordinates, np.zeros_like(coordinates)], 1)
            labels = np.tile([1.0, -1.0], (count, 1))
        small = self.encoder.size // 4
        feed = {
            self.kind.points: at,
            self.kind.labels: labels,
            "mask_input": np.zeros((count if self.kind.stretched else 1, 1, small, small)),
            "has_mask_input": np.zeros(1),
            "orig_im_size": np.array([self.height, self.width]),
        }
        feed = {
            name: np.ascontiguousarray(value, self.decoder.input(name).dtype)
            for name, value in feed.items()
            if self.decoder.input(name)
        }
        return feed | self.features

    def predict(self, points):
        """Predicts masks for points [n][2] in pixels of the picture: returns logits [n][m][h][w] at the decoder's
        size, and predicted IoU [n][m]."""
        logits, scores = self.decoder.run([self.masks, self.kind.scores], self.feed(points))
        if self.kind.name == "transformers":
            logits, scores = logits[0], scores[0]
        if logits.ndim != 4 or scores.shape != logits.shape[:2] or len(logits) != len(points):
            raise SegmentError(
                f"{self.decoder.path}: gave masks {list(logits.shape)} and scores {list(scores.shape)} for "
                f"{len(points)} points; expected [points, masks, h, w] and [points, masks]"
            )
        if logits.shape[1] == 4:  # the first of four masks is meant for prompts of several points
            logits, scores = logits[:, 1:], scores[:, 1:]
        return logits.astype(np.float32, copy=False), scores.astype(np.float32, copy=False)

    def enlarge(self, logits):
        """Enlarges one mask's logits to the picture's size, bilinearly from the part of the square that the picture
        fills."""
        if logits.shape == (self.height, self.width):
            return logits
        placed = self.encoder.place(self.width, self.height)
        box = (0, 0, logits.shape[1] * placed[0] / self.encoder.size, logits.shape[0] * placed[1] / self.encoder.size)
        return np.asarray(Image.fromarray(logits).resize((self.width, self.height), Image.Resampling.BILINEAR, box=box))
