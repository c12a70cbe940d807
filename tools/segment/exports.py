# SPDX-License-Identifier: Apache-2.0
"""Table of the known exports of segmentation networks: how they are recognised, and which input they expect.

An export is chosen by the signature of the file or by --export. The first one that fits is used, so special ones come
first. Mean and standard deviation refer to samples from 0 to 1; samples from 0 to 255 are multiplied by `scale`
before.
"""

import dataclasses

IMAGENET = ((0.485, 0.456, 0.406), (0.229, 0.224, 0.225))
HALF = ((0.5, 0.5, 0.5), (0.5, 0.5, 0.5))
RAW = ((0.0, 0.0, 0.0), (1.0, 1.0, 1.0))


@dataclasses.dataclass(frozen=True)
class Export:
    name: str
    about: str
    inputs: tuple  # possible names of the picture's input; empty: any name
    layout: str  # NCHW or NHWC
    normal: tuple  # mean and standard deviation
    scale: float = 1 / 255
    integer_input: bool = False
    integer_output: bool | None = None  # True: outputs classes; False: scores; None: either
    bgr: bool = False
    longest: int = 1024  # if the file leaves the size open: largest length of the longer side
    multiple: int = 32  # and the number that both sides are multiples of


EXPORTS = (
    Export(
        "transformers",
        "SegFormer, MobileViT, BEiT, UperNet and others by optimum or transformers.js",
        ("pixel_values",),
        "NCHW",
        IMAGENET,
    ),
    Export(
        "tensorflow-deeplab",
        "DeepLab's frozen graphs by tf2onnx: bytes in, classes out",
        ("ImageTensor", "ImageTensor:0"),
        "NHWC",
        RAW,
        scale=1,
        integer_input=True,
        longest=513,
        multiple=1,
    ),
    Export(
        "openvino-adas",
        "semantic-segmentation-adas-0001 and its kind: BGR from 0 to 255",
        ("data",),
        "NCHW",
        RAW,
        scale=1,
        bgr=True,
        longest=2048,
    ),
    Export("paddleseg", "PaddleSeg's by paddle2onnx: classes out", ("x", "x0"), "NCHW", HALF, integer_output=True),
    Export(
        "bytes-nhwc",
        "any network with a picture of bytes in, channels last",
        (),
        "NHWC",
        RAW,
        scale=1,
        integer_input=True,
    ),
    Export("float-nhwc", "any network of floats with channels last (Keras): from -1 to 1", (), "NHWC", HALF),
    Export(
        "torchvision",
        "torchvision, mmsegmentation, EdgeNets, DDRNet, PIDNet, BiSeNet: anything else with channels first",
        (),
        "NCHW",
        IMAGENET,
    ),
)


def named(name):
    return next((export for export in EXPORTS if export.name == name), None)


def picture_layout(tensor):
    """Returns NCHW or NHWC, by the dimension that holds the three channels; None if neither."""
    if len(tensor.shape) != 4 or tensor.shape[0] not in (None, 1):
        return None
    first, last = tensor.shape[1], tensor.shape[3]
    if first == 3:
        return "NCHW"
    return "NHWC" if last == 3 else None


def fits(export, picture, labels, ignore_names=False):
    """Whether a network with this input and output can be of this export. If it was asked for by name (ignore_names),
    the properties that only serve recognition may differ: input name and output type."""
    if export.inputs and picture.name not in export.inputs and not ignore_names:
        return False
    if picture_layout(picture) != export.layout or picture.is_integer != export.integer_input:
        return False
    if not (picture.is_float or picture.is_integer):
        return False
    return ignore_names or export.integer_output is None or labels.is_integer == export.integer_output


def expectation(export=None):
    """Describes the signature that an export expects, for error messages."""
    one = "one input with a picture, float or uint8 [1x3xHxW] or [1xHxWx3]"
    if export:
        kind = "uint8" if export.integer_input else "float"
        sides = "1x3xHxW" if export.layout == "NCHW" else "1xHxWx3"
        one = f"one input {'|'.join(export.inputs) or '(any name)'} {kind}[{sides}] ({export.name})"
    return f"{one} and an output of scores, float [1xCxhxw] or [1xhxwxC], or of classes, integer [1xhxw] or [1x1xhxw]"


def table_text():
    rows = []
    for e in EXPORTS:
        kind = "uint8" if e.integer_input else "float"
        pixels = "BGR" if e.bgr else "RGB"
        mean = (
            "0 to 255"
            if e.normal == RAW
            else "mean " + " ".join(map(str, e.normal[0])) + ", std " + " ".join(map(str, e.normal[1]))
        )
        rows.append(
            f"{e.name:19} input {'|'.join(e.inputs) or 'any'}, {kind} {e.layout} {pixels}, {mean}\n{'':19} {e.about}"
        )
    return "\n".join(rows)
