# SPDX-License-Identifier: Apache-2.0
"""Writes small ONNX networks with the inputs and outputs of real ones. They compute their results by plain
arithmetic instead of trained weights.

Semantic networks give each pixel the class of the nearest colour. The network of Segment Anything returns for a
point the mask of all pixels of its colour."""

import numpy as np
from onnx_writer import Graph

IMAGENET = (np.array([0.485, 0.456, 0.406]), np.array([0.229, 0.224, 0.225]))
PLAIN = (
    np.zeros(3),
    np.full(3, 1 / 255),
)  # mean and standard deviation for networks whose inputs are samples from 0 to 255
HALF = (np.full(3, 0.5), np.full(3, 0.5))
# Train ids and their colours: road, sky, person, car.
COLOURS = {0: (120, 120, 120), 10: (60, 160, 250), 11: (250, 40, 40), 13: (30, 200, 40)}


def semantic(
    path,
    size=(48, 32),
    count=19,
    normal=IMAGENET,
    colours=None,
    name="pixel_values",
    out="logits",
    last=False,
    data=np.float32,
    classes=None,
    shrink=2,
    bgr=False,
):
    """Writes a semantic network. size: size of the input, None for any. last: channels come last. classes: the rank
    (3 or 4) of an output of class numbers that replaces the scores."""
    colours = COLOURS if colours is None else colours
    mean, std = normal
    weights, bias = np.zeros((count, 3, 1, 1)), np.full(count, -1e6)
    for index, colour in colours.items():
        centre = (np.array(colour[::-1] if bgr else colour) / 255 - mean) / std
        weights[index, :, 0, 0], bias[index] = 2 * centre, -(centre**2).sum()
    width, height = size or ("width", "height")
    small = [side // shrink if size else side + "_small" for side in (height, width)]
    g = Graph()
    at = g.input(name, [1, height, width, 3] if last else [1, 3, height, width], data)
    if data != np.float32:
        at = g.op("Cast", at, to=1)
    if last:
        at = g.op("Transpose", at, perm=[0, 3, 1, 2])
    at = g.op("AveragePool", at, kernel_shape=[shrink, shrink], strides=[shrink, shrink])
    at = g.op("Conv", at, g.constant(weights), g.constant(bias))
    if classes:
        at = g.op("ArgMax", at, axis=1, keepdims=classes - 3)
        g.output(out, at, [1, *small] if classes == 3 else [1, 1, *small], np.int64)
    elif last:
        g.output(out, g.op("Transpose", at, perm=[0, 2, 3, 1]), [1, *small, count])
    else:
        g.output(out, at, [1, count, *small])
    g.save(path)


def encoder(path, kind="segment-anything", size=128, prepares=False, channels=3):
    """Writes an image encoder whose features are the mean colours of squares of 4 x 4 pixels."""
    g = Graph()
    small = size // 4
    if prepares:
        at = g.input("input_image", ["height", "width", 3])
        at = g.op("Div", g.op("Sub", at, [123.675, 116.28, 103.53]), [58.395, 57.12, 57.375])
        at = g.op("Transpose", at, perm=[2, 0, 1])
        sides = g.op("Shape", at)
        ends = g.op("Sub", g.constant([3, size, size], np.int64), sides)
        at = g.op("Pad", at, g.op("Concat", g.constant([0, 0, 0], np.int64), ends, axis=0))
        at = g.op("Unsqueeze", at, g.constant([0], np.int64))
    else:
        at = g.input("pixel_values" if kind == "transformers" else "image", [1, 3, size, size])
    at = g.op("AveragePool", at, kernel_shape=[4, 4], strides=[4, 4])
    if channels != 3:
        at = g.op("Concat", *[at] * (channels // 3), axis=1)
    if kind == "sam2":
        for name in ("high_res_feats_0", "high_res_feats_1", "image_embed"):
            g.output(name, at, [1, channels, small, small])
    else:
        g.output("image_embeddings", at, [1, channels, small, small])
        if kind == "transformers":
            g.output("image_positional_embeddings", at, [1, channels, small, small])
    g.save(path)


def same_colour(g, features, x, y, small):
    """Returns logits [n][1][small][small] that are positive where features have the point's colour. The points' x
    and y [n][1][1][1] are in feature squares."""
    across = g.constant((np.arange(small) + 0.5).reshape(1, 1, 1, small))
    down = g.constant((np.arange(small) + 0.5).reshape(1, 1, small, 1))
    dx, dy = g.op("Sub", across, x), g.op("Sub", down, y)
    distance = g.op("Add", g.op("Mul", dx, dx), g.op("Mul", dy, dy))
    near = g.op("Exp", g.op("Mul", distance, -6.0))
    plane = g.constant([2, 3], np.int64)
    colour = g.op("Div", g.op("ReduceSum", g.op("Mul", features, near), plane), g.op("ReduceSum", near, plane))
    off = g.op("Sub", features, colour)
    square = g.op("ReduceSum", g.op("Mul", off, off), g.constant([1], np.int64))
    return g.op("Mul", g.op("Sub", 0.6, square), 30.0)


def decoder(path, kind="segment-anything", size=128, free=False, single=False, low=True):
    """Writes a mask decoder with four masks for each point: one that must not be used, a good one, one of low
    predicted IoU, and an unstable one."""
    g = Graph()
    small, many = size // 4, "points" if free or kind != "segment-anything" else 1
    names = {
        "sam2": ["image_embed", "high_res_feats_0", "high_res_feats_1"],
        "transformers": ["image_embeddings", "image_positional_embeddings"],
    }.get(kind, ["image_embeddings"])
    features = [g.input(name, [1, 3, small, small]) for name in names][0]
    if kind == "transformers":
        at = g.op("Reshape", g.input("input_points", [1, many, 1, 2]), g.constant([-1, 2], np.int64))
        labels = g.op(
            "Reshape",
            g.op("Cast", g.input("input_labels", [1, many, 1], np.int64), to=1),
            g.constant([-1, 1], np.int64),
        )
    else:
        coordinates, all_labels = g.input("point_coords", [many, "n", 2]), g.input("point_labels", [many, "n"])
        at = g.op("Gather", coordinates, g.constant(0, np.int64), axis=1)
        second = g.op("Gather", all_labels, g.constant([1], np.int64), axis=1)
        labels = g.op("Neg", second)  # 1 if the second point is labelled as padding (-1)
        g.input("mask_input", ["points" if kind == "sam2" else 1, 1, small, small])
        g.input("has_mask_input", [1])
        if kind == "segment-anything":
            g.input("orig_im_size", [2])
    column = g.constant([-1, 1, 1, 1], np.int64)
    x, y = (
        g.op("Reshape", g.op("Gather", g.op("Mul", at, 0.25), g.constant([i], np.int64), axis=1), column)
        for i in (0, 1)
    )
    good = same_colour(g, features, x, y, small)
    full = g.op("Add", g.op("Mul", good, 0.0), 9.0)
    masks, scores = (
        ([good], [0.95]) if single else ([full, good, full, g.op("Mul", good, 0.02)], [0.99, 0.95, 0.5, 0.93])
    )
    if kind == "transformers":
        masks, scores = masks[1:], scores[1:]
    masks = g.op("Concat", *masks, axis=1)
    scores = g.op("Mul", g.constant([scores]), labels)
    sides = [many, 1 if single else 3 if kind == "transformers" else 4]
    if kind == "transformers":
        front = g.constant([0], np.int64)
        g.output("pred_masks", g.op("Unsqueeze", masks, front), [1, *sides, small, small])
        g.output("iou_scores", g.op("Unsqueeze", scores, front), [1, *sides])
    else:
        g.output("masks", g.op("Neg", masks) if low else masks, [*sides, "h", "w"])
        g.output("iou_predictions", scores, sides)
        if low:
            g.output("low_res_masks", masks, [*sides, small, small])
    g.save(path)
