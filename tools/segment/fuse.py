# SPDX-License-Identifier: Apache-2.0
"""Fuses labels with class-agnostic masks: each mask takes the label of most of its pixels, so that labels end at the
masks' edges."""

import numpy as np

from .classes import UNKNOWN


def majority(labels, inside, share):
    """The most frequent known label of the mask's pixels, if more than `share` of the pixels have it; else None."""
    counts = np.bincount(labels[inside], minlength=256)
    total = counts.sum()
    counts[UNKNOWN] = 0
    best = int(counts.argmax())
    return best if counts[best] > share * total else None


def fuse(labels, masks, share=0.5):
    """Returns the labels [h][w] after each mask took its majority label; larger masks first, so that smaller masks on
    top of them keep their own label."""
    out = labels.copy()
    for mask in sorted(masks, key=lambda m: -m.area):
        x0, y0, x1, y1 = mask.box
        label = majority(labels[y0:y1, x0:x1], mask.inside, share)
        if label is not None:
            out[y0:y1, x0:x1][mask.inside] = label
    return out
