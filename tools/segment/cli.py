# SPDX-License-Identifier: Apache-2.0
"""The command line: options, the loop over photographs, and the same exit codes as pags."""

import argparse
import dataclasses
import io
import os
import signal
import sys
import time

from . import exports
from .automatic import Settings, automatic_masks
from .classes import SKY, TABLES
from .errors import Interrupted, SegmentError
from .fuse import fuse
from .layout import Output, check_labels, list_photos
from .models import identity
from .progress import Progress, duration
from .sam import Sam
from .semantic import Semantic

DONE, FAILED, USAGE, INTERRUPTED = 0, 1, 2, 3


def pair(separator):
    def read(text):
        a, _, b = text.partition(separator)
        return int(a), int(b)

    return read


def size(text):
    value = pair("x")(text)
    if min(value) < 1 or max(value) > 16384:
        raise ValueError
    return value


def three(text):
    values = tuple(float(word) for word in text.split(","))
    if len(values) != 3:
        raise ValueError
    return values


def share(text):
    value = float(text)
    if not 0 <= value <= 1:
        raise ValueError
    return value


def number(low, high):
    def read(text):
        value = int(text)
        if not low <= value <= high:
            raise ValueError
        return value

    return read


def numbers(text):
    return {int(word) for word in text.split(",")}


def parser():
    p = argparse.ArgumentParser(
        prog="segment",
        description="Experimental: not yet run with a real network. Makes label images (semantic/, Cityscapes train ids) and sky_masks/ for a driving set with "
        "your ONNX networks. Run again to resume. See docs/masks.md.",
    )
    d = Settings()
    p.add_argument("dataset", nargs="?", metavar="DATASET", help="folder with images/TTT_C.jpg or .png")
    p.add_argument("--semantic", metavar="FILE", help="network for semantic segmentation (.onnx); required")
    p.add_argument("-o", "--output", metavar="FOLDER", help="folder for semantic/ and sky_masks/ (default: DATASET)")
    p.add_argument("--cameras", type=numbers, metavar="LIST", help="numbers separated by commas (default: all)")
    p.add_argument("--frames", type=pair("-"), metavar="A-B", help="time steps, both included (default: all)")
    p.add_argument("--no-sky", action="store_true", help="don't write sky_masks")
    p.add_argument("--overwrite", action="store_true", help="remove existing masks and start again")
    p.add_argument(
        "-j", "--threads", type=number(0, 256), default=0, metavar="N", help="0 (default): chosen by onnxruntime"
    )
    p.add_argument("-q", "--quiet", action="store_true", help="print only errors")
    g = p.add_argument_group("export type of the network, if its signature is ambiguous (--list-exports)")
    g.add_argument("--list-exports", action="store_true", help="print the known exports and exit")
    g.add_argument("--export", metavar="NAME", help="its class list")
    g.add_argument("--classes", metavar="NAME|FILE", help=f"{', '.join(TABLES)}, or a file of lines `class train-id`")
    g.add_argument("--size", type=size, metavar="WxH", help="input size in pixels, if the file leaves it open")
    g.add_argument("--mean", type=three, metavar="R,G,B", help="mean of samples from 0 to 1, subtracted")
    g.add_argument("--std", type=three, metavar="R,G,B", help="standard deviation of samples from 0 to 1, divided by")
    g = p.add_argument_group("Segment Anything: class-agnostic masks; each takes the most frequent label of its pixels")
    g.add_argument("--sam", action="store_true", help="enable it: 0.5 to 2 minutes per image on a CPU")
    g.add_argument("--sam-encoder", metavar="FILE", help="image encoder (.onnx)")
    g.add_argument("--sam-decoder", metavar="FILE", help="mask decoder (.onnx)")
    g.add_argument(
        "--points", type=number(1, 256), default=d.points, metavar="N", help=f"points per side of the grid ({d.points})"
    )
    g.add_argument(
        "--predicted-iou", type=share, default=d.predicted_iou, metavar="F", help=f"minimum ({d.predicted_iou})"
    )
    g.add_argument("--stability", type=share, default=d.stability, metavar="F", help=f"minimum ({d.stability})")
    g.add_argument(
        "--box-nms",
        type=share,
        default=d.box_nms,
        metavar="F",
        help=f"IoU above which boxes are duplicates ({d.box_nms})",
    )
    g.add_argument("--crop-layers", type=number(0, 4), default=0, metavar="N", help="layer n adds 2^n x 2^n crops (0)")
    g.add_argument(
        "--crop-points-divisor", type=number(1, 16), default=1, metavar="N", help="divisor of points per layer (1)"
    )
    g.add_argument(
        "--majority", type=share, default=0.5, metavar="F", help="minimum share of a mask for its label (0.5)"
    )
    return p


def check_usage(p, a):
    if not a.dataset:
        p.error("DATASET is missing")
    if not a.semantic:
        p.error("--semantic FILE is missing: labels require a network")
    if a.sam and not (a.sam_encoder and a.sam_decoder):
        p.error("--sam needs --sam-encoder FILE and --sam-decoder FILE")
    if not a.sam and (a.sam_encoder or a.sam_decoder):
        p.error("--sam-encoder and --sam-decoder require --sam")


def automatic_settings(a):
    return Settings(
        points=a.points,
        predicted_iou=a.predicted_iou,
        stability=a.stability,
        box_nms=a.box_nms,
        crop_layers=a.crop_layers,
        crop_points_divisor=a.crop_points_divisor,
    )


def record(a, semantic, sky):
    """The settings that determine the masks, by names used in error messages."""
    out = {
        "choice of sky masks": sky,
        "semantic network": identity(a.semantic) | semantic.settings(),
        "use of Segment Anything": None,
    }
    if a.sam:
        out["use of Segment Anything"] = {
            "encoder": identity(a.sam_encoder),
            "decoder": identity(a.sam_decoder),
            "majority": a.majority,
            **dataclasses.asdict(automatic_settings(a)),
        }
    return out


def say(a, text):
    if not a.quiet:
        print(text, flush=True)


def open_networks(a):
    semantic = Semantic(a.semantic, a.threads, a.export, a.classes, a.size, a.mean, a.std)
    say(a, semantic.describe())
    sam = Sam(a.sam_encoder, a.sam_decoder, a.threads) if a.sam else None
    if sam:
        say(a, sam.describe())
    return semantic, sam


def label_photo(a, photo, semantic, sam, progress):
    picture = photo.load()
    labels = semantic.label(picture)
    if sam:
        masks = automatic_masks(
            sam, picture, automatic_settings(a), lambda part, whole: progress.within(photo.name, part, whole)
        )
        labels = fuse(labels, masks, a.majority)
    return labels


def run(a):
    check_labels(a.dataset)
    photos = list_photos(a.dataset, a.cameras, a.frames)
    semantic, sam = open_networks(a)
    sky = semantic.knows_sky and not a.no_sky
    if not sky and not a.no_sky:
        say(a, f"{a.semantic}: has no sky class; no sky_masks are written")
    output = Output(a.output or a.dataset, sky)
    output.prepare(record(a, semantic, sky), a.overwrite)
    left = [photo for photo in photos if not output.done(photo)]
    if len(left) < len(photos):
        say(a, f"{len(photos) - len(left)} of {len(photos)} images are already done")
    progress = Progress(len(left), a.quiet)
    try:
        for photo in left:
            labels = label_photo(a, photo, semantic, sam, progress)
            output.write(photo, labels, labels == SKY)
            progress.finished(photo.name)
    except KeyboardInterrupt:
        progress.end()
        raise Interrupted(
            f"interrupted after {progress.done} of {len(left)} images; the same command resumes from here"
        ) from None
    progress.end()
    seconds = duration(progress.clock() - progress.begun)
    say(a, f"{len(left)} images in {seconds}, masks in {' and '.join(output.folders())}")


class Interrupt:
    """Converts signals that request an end, as in pags: KeyboardInterrupt once; a Ctrl-C more than 0.3 s later ends the process immediately."""

    ASKING = "SIGINT", "SIGTERM", "SIGHUP", "SIGUSR1", "SIGUSR2", "SIGXCPU"

    def __init__(self):
        self.since, self.former = None, {}
        for number in (getattr(signal, name) for name in self.ASKING if hasattr(signal, name)):
            if number == signal.SIGINT or signal.getsignal(number) != signal.SIG_IGN:  # under nohup SIGHUP is ignored
                self.former[number] = signal.signal(number, self.on_signal)

    def on_signal(self, number, _):
        if self.since is None:
            self.since = time.monotonic()
            raise KeyboardInterrupt
        if number == signal.SIGINT and time.monotonic() - self.since >= 0.3:
            os._exit(130)

    def set_back(self):
        for number, handler in self.former.items():
            signal.signal(number, handler)


def main(arguments=None):
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="surrogateescape")  # print names that are not UTF-8 unchanged
    p = parser()
    a = p.parse_args(arguments)
    if a.list_exports:
        print(exports.table_text())
        return DONE
    check_usage(p, a)
    signals = Interrupt()
    try:
        run(a)
        return DONE
    except (SegmentError, OSError) as error:  # an OSError also for standard output
        print(f"segment: {error}", file=sys.stderr)
        return INTERRUPTED if isinstance(error, Interrupted) else FAILED
    except KeyboardInterrupt:
        print("segment: interrupted before the first image", file=sys.stderr)
        return INTERRUPTED
    finally:
        signals.set_back()
