# SPDX-License-Identifier: Apache-2.0
"""Reads the display properties of a video and builds the ffmpeg filters that deinterlace, make pixels square, and convert to sRGB: interlaced frames,
non-square pixels, HDR (HLG, PQ: ITU-R BT.2100), BT.2020 and P3."""

import json
import subprocess

import numpy as np

from .errors import RecordingError

WHITE = (0.3127, 0.3290)
PRIMARIES = {  # chromaticities of red, green, blue; the white point is D65
    "bt709": ((0.640, 0.330), (0.300, 0.600), (0.150, 0.060)),
    "bt2020": ((0.708, 0.292), (0.170, 0.797), (0.131, 0.046)),
    "smpte432": ((0.680, 0.320), (0.265, 0.690), (0.150, 0.060)),
}
SAME = (None, "unknown", "reserved", "bt709", "smpte170m", "bt470bg", "smpte240m")  # primaries treated as those of sRGB
DISPLAY = (
    None,
    "unknown",
    "reserved",
    "bt709",
    "smpte170m",
    "smpte240m",
    "bt470m",
    "bt470bg",
    "iec61966-2-1",
    "iec61966-2-4",
    "bt1361e",
    "bt2020-10",
    "bt2020-12",
)
NAMES = {"arib-std-b67": "HLG (HDR)", "smpte2084": "PQ (HDR)", "bt2020": "BT.2020", "smpte432": "Display P3"}
MATRICES = {
    "bt709": "bt709",
    "smpte170m": "bt601",
    "bt470bg": "bt601",
    "smpte240m": "smpte240m",
    "fcc": "fcc",
    "bt2020nc": "bt2020",
}
GRID = 65  # entries per side of the colour table
SHOULDER = 0.8  # fraction of white above which HDR is compressed to white


def probed(path):
    """The first video stream as ffprobe describes it, and its first frames."""
    asked = [
        "ffprobe",
        "-v",
        "error",
        "-select_streams",
        "v:0",
        "-show_streams",
        "-show_frames",
        "-read_intervals",
        "%+#12",
        "-of",
        "json",
        path,
    ]
    done = subprocess.run(asked, capture_output=True, stdin=subprocess.DEVNULL)
    try:
        facts = json.loads(done.stdout.decode(errors="replace"))
        return facts["streams"][0], facts.get("frames", [])
    except (ValueError, LookupError):
        return {}, []


def to_xyz(primaries):
    """The matrix from linear light of these primaries to XYZ, with white at D65."""
    columns = np.array([(x / y, 1, (1 - x - y) / y) for x, y in primaries]).T
    white = np.array([WHITE[0] / WHITE[1], 1, (1 - WHITE[0] - WHITE[1]) / WHITE[1]])
    return columns * np.linalg.solve(columns, white)


def light(code, transfer):
    """Linear light of a sample from 0 to 1; 1 is the white of SDR pictures: 75 % of HLG's range and 203 cd/m2 of PQ's (ITU-R BT.2408)."""
    if transfer == "arib-std-b67":
        a, b, c = 0.17883277, 0.28466892, 0.55991073
        scene = lambda v: np.where(v <= 0.5, v * v / 3, (np.exp((v - c) / a) + b) / 12)  # noqa: E731
        return scene(code) / scene(0.75)
    if transfer == "smpte2084":
        power = np.maximum(code, 0) ** (1 / 78.84375)
        return (
            (np.maximum(power - 0.8359375, 0) / (18.8515625 - 18.6875 * power)) ** (1 / 0.1593017578125) * 10000 / 203
        )
    return np.where(code <= 0.04045, code / 12.92, ((code + 0.055) / 1.055) ** 2.4)


def display(lit):
    """sRGB of linear light; values above SHOULDER approach white."""
    lit = np.maximum(lit, 0)
    lit = np.where(lit <= SHOULDER, lit, 1 - (1 - SHOULDER) * np.exp(-(lit - SHOULDER) / (1 - SHOULDER)))
    return np.where(lit <= 0.0031308, lit * 12.92, 1.055 * lit ** (1 / 2.4) - 0.055)


def plain_display(lit):
    lit = np.clip(lit, 0, 1)
    return np.where(lit <= 0.0031308, lit * 12.92, 1.055 * lit ** (1 / 2.4) - 0.055)


class Display:
    """The conversion of frames to pictures. `before`: filters that need neighbouring frames; `after`: filters of single pictures; `words`: descriptions."""

    def __init__(self, path, place):
        stream, frames = probed(place)
        self.before, self.after, self.words, self.table = [], [], [], None
        self.unweave(stream, frames)
        self.turn(stream)
        self.make_square(stream)
        self.convert(path, stream)

    def unweave(self, stream, frames):
        flagged = any(frame.get("interlaced_frame") for frame in frames)
        if flagged or stream.get("field_order") in ("tt", "bb", "tb", "bt"):
            self.before.append(f"bwdif=mode=send_frame:deint={'interlaced' if flagged else 'all'}")
            self.words.append("interlaced frames are deinterlaced (bwdif)")

    def turn(self, stream):
        turns = [data["rotation"] for data in stream.get("side_data_list", []) if data.get("rotation")]
        if turns:  # ffmpeg rotates
            self.words.append(f"frames are rotated upright by {turns[0]} degrees, as stored in the video")

    def make_square(self, stream):
        across, _, down = str(stream.get("sample_aspect_ratio", "")).partition(":")
        if across.isdigit() and down.isdigit() and int(across) and int(down) and across != down:
            self.after.append(
                "scale='if(gt(sar,1),round(iw*sar/2)*2,iw)':'if(gt(sar,1),ih,round(ih/sar/2)*2)',setsar=1"
            )
            self.words.append(f"pixels of {across}:{down} are made square")

    def convert(self, path, stream):
        primaries, transfer, matrix = (stream.get(key) for key in ("color_primaries", "color_transfer", "color_space"))
        hdr = transfer in ("arib-std-b67", "smpte2084")
        name = ", ".join(
            NAMES.get(word, word)
            for word in (
                transfer if hdr or transfer not in DISPLAY else None,
                primaries if primaries not in SAME else None,
            )
            if word
        )
        vision = next((data for data in stream.get("side_data_list", []) if "dv_profile" in data), {})
        if vision.get("dv_profile") == 5:
            name = "Dolby Vision, profile 5"
        if (
            vision.get("dv_profile") == 5
            or not (hdr or transfer in DISPLAY)
            or primaries not in (*SAME, *PRIMARIES)
            or matrix in ("bt2020c", "ictcp", "ycgco")
        ):
            raise RecordingError(
                f"{path}: its colours ({name or matrix}) are not supported; convert the video to BT.709 first: ffmpeg -i VIDEO -vf zscale=t=linear:npl=203,format=gbrpf32le,zscale=p=bt709,tonemap=mobius,"
                "zscale=t=bt709:m=bt709:r=tv,format=yuv420p -c:v libx264 -crf 12 OUT.mp4 (an ffmpeg with zscale, and for Dolby Vision with libplacebo)"
            )
        if name:
            self.table = (
                transfer if hdr else None,
                PRIMARIES[primaries] if primaries in PRIMARIES else PRIMARIES["bt2020" if hdr else "bt709"],
            )
            stored = MATRICES.get(matrix, "bt2020" if hdr or primaries == "bt2020" else "auto")
            self.after += [f"scale=in_color_matrix={stored}:out_range=pc", "format=gbrp16le", "lut3d=colours.cube"]
            self.words.append(
                f"colours of {name} are converted to sRGB"
                + (
                    ", with 75 % of HLG as white"
                    if transfer == "arib-std-b67"
                    else ", with 203 cd/m2 as white"
                    if hdr
                    else ""
                )
            )
        if name or matrix in (
            "bt709",
            "smpte240m",
            "fcc",
            "bt2020nc",
        ):  # JPEG uses BT.601; ffmpeg 5 writes the video's matrix unconverted
            self.after += ["scale=out_color_matrix=bt601:out_range=pc", "format=yuvj420p"]

    def write_table(self, file):
        """The converted colours of a grid of samples, in the order of lut3d: red changes fastest."""
        transfer, primaries = self.table
        steps = np.linspace(0, 1, GRID)
        blue, green, red = np.meshgrid(steps, steps, steps, indexing="ij")
        code = np.stack([red, green, blue], -1).reshape(-1, 3)
        lit = light(code, transfer) @ (np.linalg.inv(to_xyz(PRIMARIES["bt709"])) @ to_xyz(primaries)).T
        file.write(f"LUT_3D_SIZE {GRID}\n")
        np.savetxt(file, (display if transfer else plain_display)(lit), "%.6f")
