# SPDX-License-Identifier: Apache-2.0
"""Masks take the label that most of their pixels have, so that labels end where things end."""

import numpy as np

from .classes import UNKNOWN


def majority(labels, inside, share):
    """The label of more than `share` of the mask's pixels that is most frequent; None: there is none."""
    counts = np.bincount(labels[inside], minlength=256)
    total = counts.sum()
    counts[UNKNOWN] = 0
    best = int(counts.argmax())
    return best if counts[best] > share * total else None


def fuse(labels, masks, share=0.5):
    """Labels [h][w] after each mask took its majority's: large masks first, so that what lies upon them keeps its own."""
    out = labels.copy()
    for mask in sorted(masks, key=lambda m: -m.area):
        x0, y0, x1, y1 = mask.box
        label = majority(labels[y0:y1, x0:x1], mask.inside, share)
        if label is not None:
            out[y0:y1, x0:x1][mask.inside] = label
    return out
