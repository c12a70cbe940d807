# SPDX-License-Identifier: Apache-2.0
"""Maps the classes of networks to Cityscapes' train ids, which label images contain; 255 is unknown.

Sources: cityscapesScripts' labels.py; ADE20K's objectInfo150; Mapillary Vistas v1.2's config.json; Pascal VOC. Only
classes that occur on streets are mapped; the rest is unknown, and unknown pixels are used for nothing.
"""

import numpy as np

from .errors import SegmentError

UNKNOWN = 255
NAMES = (
    "road",
    "sidewalk",
    "building",
    "wall",
    "fence",
    "pole",
    "traffic light",
    "traffic sign",
    "vegetation",
    "terrain",
    "sky",
    "person",
    "rider",
    "car",
    "truck",
    "bus",
    "train",
    "motorcycle",
    "bicycle",
)
SKY = NAMES.index("sky")
(
    ROAD,
    SIDEWALK,
    BUILDING,
    WALL,
    FENCE,
    POLE,
    LIGHT,
    SIGN,
    VEGETATION,
    TERRAIN,
    _,
    PERSON,
    RIDER,
    CAR,
    TRUCK,
    BUS,
    TRAIN,
    MOTORCYCLE,
    BICYCLE,
) = range(19)

CITYSCAPES_IDS = {
    7: ROAD,
    8: SIDEWALK,
    11: BUILDING,
    12: WALL,
    13: FENCE,
    17: POLE,
    19: LIGHT,
    20: SIGN,
    21: VEGETATION,
    22: TERRAIN,
    23: SKY,
    24: PERSON,
    25: RIDER,
    26: CAR,
    27: TRUCK,
    28: BUS,
    29: TRUCK,
    30: TRUCK,
    31: TRAIN,
    32: MOTORCYCLE,
    33: BICYCLE,
}
# House, skyscraper, tower and hovel count as building; grass, earth, field, path, land and the like as terrain;
# minibike as motorcycle.
ADE20K = {
    0: WALL,
    1: BUILDING,
    2: SKY,
    4: VEGETATION,
    6: ROAD,
    9: TERRAIN,
    11: SIDEWALK,
    12: PERSON,
    13: TERRAIN,
    17: VEGETATION,
    20: CAR,
    25: BUILDING,
    29: TERRAIN,
    32: FENCE,
    38: FENCE,
    43: SIGN,
    46: TERRAIN,
    48: BUILDING,
    52: TERRAIN,
    68: TERRAIN,
    72: VEGETATION,
    79: BUILDING,
    80: BUS,
    83: TRUCK,
    84: BUILDING,
    87: POLE,
    91: TERRAIN,
    93: POLE,
    94: TERRAIN,
    102: CAR,
    116: MOTORCYCLE,
    127: BICYCLE,
    136: LIGHT,
}
MAPILLARY = {
    2: SIDEWALK,
    3: FENCE,
    4: FENCE,
    5: FENCE,
    6: WALL,
    7: ROAD,
    8: ROAD,
    9: SIDEWALK,
    10: ROAD,
    11: SIDEWALK,
    13: ROAD,
    14: ROAD,
    15: SIDEWALK,
    17: BUILDING,
    19: PERSON,
    20: RIDER,
    21: RIDER,
    22: RIDER,
    23: ROAD,
    24: ROAD,
    25: TERRAIN,
    26: TERRAIN,
    27: SKY,
    29: TERRAIN,
    30: VEGETATION,
    41: ROAD,
    43: ROAD,
    44: POLE,
    45: POLE,
    47: POLE,
    48: LIGHT,
    49: SIGN,
    50: SIGN,
    52: BICYCLE,
    54: BUS,
    55: CAR,
    56: TRUCK,
    57: MOTORCYCLE,
    58: TRAIN,
    59: TRUCK,
    60: TRUCK,
    61: TRUCK,
}
VOC = {2: BICYCLE, 6: BUS, 7: CAR, 14: MOTORCYCLE, 15: PERSON, 19: TRAIN}

TABLES = {
    "cityscapes": {i: i for i in range(19)},
    "cityscapes-ids": CITYSCAPES_IDS,
    "ade20k": ADE20K,
    "ade20k+0": {k + 1: v for k, v in ADE20K.items()},
    "mapillary": MAPILLARY,
    "voc": VOC,
}
# Class list by the network's number of classes. 20: Cityscapes with an additional class for everything else.
BY_COUNT = {
    19: "cityscapes",
    20: "cityscapes",
    21: "voc",
    34: "cityscapes-ids",
    35: "cityscapes-ids",
    65: "mapillary",
    66: "mapillary",
    150: "ade20k",
    151: "ade20k+0",
}


def read_table(path):
    """Reads a class table from a file with lines of two numbers, the network's class and the train id; # begins a
    comment."""
    table = {}
    try:
        with open(path, encoding="utf-8") as file:
            lines = file.read().splitlines()
    except OSError as error:
        raise SegmentError(
            f"{path}: {error.strerror}; --classes takes one of {', '.join(TABLES)}, or such a file"
        ) from None
    for number, line in enumerate(lines, 1):
        words = line.split("#")[0].split()
        if not words:
            continue
        if (
            len(words) != 2
            or not all(w.isdigit() for w in words)
            or not (int(words[1]) < 19 or int(words[1]) == UNKNOWN)
        ):
            raise SegmentError(f"{path}:{number}: expected a class of the network and a train id 0 to 18, or 255")
        table[int(words[0])] = int(words[1])
    return table


def choose(asked, count):
    """Chooses the class list: the one asked for, else by the network's number of classes `count` (None: the network
    outputs classes, not scores). Returns its name and table."""
    if asked:
        return asked, TABLES.get(asked) or read_table(asked)
    if count is None:
        return "cityscapes", TABLES["cityscapes"]
    if count not in BY_COUNT:
        raise SegmentError(
            f"the network knows {count} classes, and none of the class lists has as many "
            f"({', '.join(f'{n}: {c}' for n, c in BY_COUNT.items())}); say with --classes what they are"
        )
    return BY_COUNT[count], TABLES[BY_COUNT[count]]


def lookup(table, count=None):
    """Returns an array that maps the network's classes to train ids; its last entry, for classes beyond it, is
    unknown."""
    size = max([*table, (count or 1) - 1]) + 1
    out = np.full(size + 1, UNKNOWN, np.uint8)
    for index, train_id in table.items():
        out[index] = train_id
    return out
