# SPDX-License-Identifier: Apache-2.0
"""Segment Anything's automatic mode: masks of everything in a picture, prompted by a grid of points.

As in Kirillov et al. 2023, appendix B, with their defaults: every point gives up to three masks. A mask is kept if
its predicted IoU and its stability (the IoU of the masks cut at logits +1 and -1) are high and if it doesn't end at
the border of a crop. Duplicates are removed by non-maximum suppression of the boxes: first within a crop, preferring
a higher predicted IoU, then between crops, preferring smaller crops.
"""

import dataclasses
import math

import numpy as np

NEAR_EDGE = 20  # pixels: a box that ends this near to the border of its crop counts as cut off there


@dataclasses.dataclass(frozen=True)
class Settings:
    points: int = 32  # points per side of the grid
    predicted_iou: float = 0.88
    stability: float = 0.95
    stability_offset: float = 1.0
    box_nms: float = 0.7
    crop_layers: int = 0  # layer n has 2^n x 2^n crops
    crop_nms: float = 0.7
    crop_overlap: float = 512 / 1500  # of the picture's shorter side, in the first layer
    crop_points_divisor: int = 1  # layer n has points / divisor^n per side


@dataclasses.dataclass
class Mask:
    box: tuple  # x0, y0, x1, y1 in pixels of the picture; x1 and y1 are exclusive
    inside: np.ndarray  # bool [y1 - y0][x1 - x0]
    predicted_iou: float
    stability: float
    crop_area: int

    @property
    def area(self):
        return int(self.inside.sum())


def point_grid(side):
    """The grid's points in the unit square, [side * side][2], row by row from the top."""
    at = (np.arange(side) + 0.5) / side
    return np.stack(np.meshgrid(at, at), -1).reshape(-1, 2)


def crop_boxes(width, height, layers, overlap_share):
    """Lists the crops as ((x0, y0, x1, y1), layer): the whole picture, then the crops of each layer."""
    out = [((0, 0, width, height), 0)]
    for layer in range(1, layers + 1):
        a_side = 2**layer
        overlap = int(overlap_share * min(width, height) * (2 / a_side))
        size = [int(math.ceil((overlap * (a_side - 1) + length) / a_side)) for length in (width, height)]
        for column in range(a_side):
            for row in range(a_side):
                x, y = column * (size[0] - overlap), row * (size[1] - overlap)
                out.append(((x, y, min(x + size[0], width), min(y + size[1], height)), layer))
    return out


def stability_score(logits, offset):
    outer = np.count_nonzero(logits > -offset)
    return np.count_nonzero(logits > offset) / outer if outer else 0.0


def bounds(inside):
    """The bounding box of a mask's pixels; None if the mask is empty."""
    rows, columns = np.flatnonzero(inside.any(axis=1)), np.flatnonzero(inside.any(axis=0))
    if len(rows) == 0:
        return None
    return int(columns[0]), int(rows[0]), int(columns[-1]) + 1, int(rows[-1]) + 1


def is_cut_off(box, crop, width, height):
    """Whether a box (pixels of the picture) ends at a border of its crop that isn't a border of the picture."""
    for side, limit in enumerate((0, 0, width, height)):
        if abs(box[side] - crop[side]) <= NEAR_EDGE and abs(box[side] - limit) > NEAR_EDGE:
            return True
    return False


def suppress(boxes, scores, threshold):
    """Non-maximum suppression: returns the indices of the boxes kept, best score first; the earlier one of equal
    scores."""
    boxes = np.asarray(boxes, np.float64).reshape(-1, 4)
    areas = (boxes[:, 2] - boxes[:, 0]) * (boxes[:, 3] - boxes[:, 1])
    order = np.argsort(-np.asarray(scores, np.float64), kind="stable")
    kept = []
    while len(order):
        best, order = order[0], order[1:]
        kept.append(int(best))
        low = np.maximum(boxes[best, :2], boxes[order, :2])
        high = np.minimum(boxes[best, 2:], boxes[order, 2:])
        shared = np.prod(np.clip(high - low, 0, None), axis=1)
        order = order[shared <= threshold * (areas[best] + areas[order] - shared)]
    return kept


def masks_of_points(sam, points, crop, picture_size, settings):
    """The masks of one batch of points that pass all filters: predicted IoU, stability, not cut off by the crop."""
    logits, scores = sam.predict(points)
    found = []
    for point, mask in np.argwhere(scores > settings.predicted_iou):
        large = sam.enlarge(logits[point, mask])
        stability = stability_score(large, settings.stability_offset)
        inside = large > 0
        box = bounds(inside) if stability >= settings.stability else None
        if box is None:
            continue
        placed = (box[0] + crop[0], box[1] + crop[1], box[2] + crop[0], box[3] + crop[1])
        if not is_cut_off(placed, crop, *picture_size):
            part = inside[box[1] : box[3], box[0] : box[2]].copy()
            area = (crop[2] - crop[0]) * (crop[3] - crop[1])
            found.append(Mask(placed, part, float(scores[point, mask]), stability, area))
    return found


def masks_of_crop(sam, photo, crop, side, settings, step):
    x0, y0, x1, y1 = crop
    sam.set_picture(np.ascontiguousarray(photo[y0:y1, x0:x1]))
    points = point_grid(side) * (x1 - x0, y1 - y0)
    found = []
    for begin in range(0, len(points), sam.batch):
        batch = points[begin : begin + sam.batch]
        found += masks_of_points(sam, batch, crop, (photo.shape[1], photo.shape[0]), settings)
        step(len(batch))
    kept = suppress([m.box for m in found], [m.predicted_iou for m in found], settings.box_nms)
    return [found[i] for i in kept]


def automatic_masks(sam, photo, settings, progress=None):
    """Returns the masks of photo (uint8 [h][w][3]); calls progress(done, all) after every batch of points."""
    crops = [
        (crop, max(1, settings.points // settings.crop_points_divisor**layer))
        for crop, layer in crop_boxes(photo.shape[1], photo.shape[0], settings.crop_layers, settings.crop_overlap)
    ]
    total, done = sum(side * side for _, side in crops), 0

    def step(count):
        nonlocal done
        done += count
        if progress:
            progress(done, total)

    found = [mask for crop, side in crops for mask in masks_of_crop(sam, photo, crop, side, settings, step)]
    if len(crops) > 1:
        kept = suppress([m.box for m in found], [1 / m.crop_area for m in found], settings.crop_nms)
        found = [found[i] for i in kept]
    return found
