# SPDX-License-Identifier: Apache-2.0
"""Reads tables that pandas wrote as pickles without executing them: pickles are programs, and only the names below may be called.

Only the names of pandas and numpy in pickled tables of the form "0.14.1" (up to pandas 1.2) are known, and stand-ins replace them. All other names are
rejected. numpy's own types can't be used: they trust a pickle's description of their memory (a type of objects that claims to have none turns bytes of the
file into pointers)."""

import gzip
import io
import math
import pickle
import pickletools
import re
import zlib

import numpy as np

from .errors import RecordingError

MOST = 1 << 30  # bytes, unpacked; the largest tables of the sources take 10 MB


class Parts:
    """Stand-in for an object of pandas: keeps its state."""

    state = None

    def __init__(self, *arguments):
        pass

    def __setstate__(self, state):
        self.state = state


class Type:
    """Stand-in for numpy's dtype: a code such as f8, and the byte order."""

    order = "<"

    def __init__(self, code, *flags):
        self.code = str(code)

    def __setstate__(self, state):
        self.order = {"<": "<", ">": ">"}.get(state[1], "<")

    def real(self):
        """The type, of numbers or objects; no other is needed."""
        if self.code in ("O", "O8", "O4"):
            return np.dtype(object)
        if not re.fullmatch("f[248]|[iu][1248]|b1", self.code):
            raise pickle.UnpicklingError(f"has an array of the unsupported type {self.code[:40]!r}")
        return np.dtype(self.order + self.code)


class Array:
    """Stand-in for numpy's array, which a pickle creates empty and fills by __setstate__; `values` is the array."""

    values = None

    def __init__(self, *arguments):
        pass

    def __setstate__(self, state):
        _, shape, kind, fortran, data = state
        kind, count = kind.real(), math.prod(shape)
        if not all(type(n) is int and n >= 0 for n in shape):
            raise pickle.UnpicklingError("has an array without shape")
        if kind == object:  # noqa: E721, a type of numpy
            if type(data) is not list or len(data) != count:
                raise pickle.UnpicklingError("has an array whose number of objects differs from its shape")
            flat = np.empty(count, object)
            for i, value in enumerate(data):
                flat[i] = value
        else:
            if type(data) is not bytes or len(data) != count * kind.itemsize:
                raise pickle.UnpicklingError("has an array whose number of bytes differs from its shape")
            flat = np.frombuffer(data, kind)
        self.values = flat.reshape(shape, order="F" if fortran else "C")


def values_of(thing):
    if not isinstance(thing, Array) or thing.values is None:
        raise pickle.UnpicklingError("has another type instead of an array")
    return thing.values


NAMES = {
    ("builtins", "slice"): slice,
    ("pandas.core.frame", "DataFrame"): Parts,
    ("pandas.core.internals.managers", "BlockManager"): Parts,
    ("pandas.core.indexes.base", "_new_Index"): lambda kind, parts: parts,
    ("pandas.core.indexes.base", "Index"): Parts,
    ("pandas.core.indexes.numeric", "Int64Index"): Parts,
    ("pandas.core.indexes.range", "RangeIndex"): Parts,
    ("numpy", "ndarray"): Array,
    ("numpy", "dtype"): Type,
    ("numpy.core.multiarray", "_reconstruct"): Array,
    ("numpy._core.multiarray", "_reconstruct"): Array,
}


class Reader(pickle.Unpickler):
    def find_class(self, module, name):
        if (module, name) not in NAMES:
            newer = (
                "; tables of pandas 1.3 and later are not supported, use PandaSet's original files"
                if module.split(".")[0] in ("pandas", "pyarrow")
                else ""
            )
            raise pickle.UnpicklingError(f"names {module}.{name}, which is not allowed in a table{newer}")
        return NAMES[module, name]

    def persistent_load(self, identity):
        raise pickle.UnpicklingError("refers to an external object")


def check_places(data):
    """Rejects large memo indices: the unpickler allocates a list up to the largest index, which could take all memory."""
    for code, place, _ in pickletools.genops(data):
        if code.name in ("PUT", "BINPUT", "LONG_BINPUT") and not 0 <= place <= len(data):
            raise pickle.UnpicklingError(f"uses memo index {place} in a file of {len(data)} bytes")


def unpacked(path):
    """The bytes of a pickle, decompressed if necessary, whatever its file name."""
    with open(path, "rb") as file:
        packed = file.read(2) == b"\x1f\x8b"
    with gzip.open(path, "rb") if packed else open(path, "rb") as file:
        data = file.read(MOST + 1)
    if len(data) > MOST:
        raise RecordingError(f"{path}: over {MOST >> 20} MB unpacked, larger than any known table")
    return data


def table(path, columns):
    """Columns of a table by name, each a numpy array; RecordingError unless all of `columns` exist."""
    try:
        data = unpacked(path)
        check_places(data)
        frame = Reader(io.BytesIO(data)).load()
        parts = (frame.state.get("_mgr") or frame.state["_data"]).state[3]["0.14.1"]
        names = [str(name) for name in values_of(parts["axes"][0]["data"])]
        found = {}
        for block in parts["blocks"]:
            places = block["mgr_locs"] if isinstance(block["mgr_locs"], slice) else values_of(block["mgr_locs"])
            found.update(
                (names[i], row)
                for i, row in zip(np.arange(len(names))[places], np.atleast_2d(values_of(block["values"])))
            )
        if any(column.ndim != 1 for column in found.values()):
            raise ValueError("a column is not a one-dimensional array")
        lengths = {len(column) for column in found.values()}
        if len(lengths) != 1:
            raise ValueError("its columns differ in length" if lengths else "it has no columns")
    except (
        OSError,
        EOFError,
        zlib.error,
        pickle.UnpicklingError,
        ValueError,
        TypeError,
        AttributeError,
        LookupError,
        MemoryError,
        OverflowError,
    ) as error:
        raise RecordingError(
            f"{path}: can't be read as a pickled table: {str(error).splitlines()[0] if str(error) else type(error).__name__}"
        ) from None
    lacking = [name for name in columns if name not in found]
    if lacking:
        raise RecordingError(f"{path}: no column {lacking[0]!r}; expected {', '.join(columns)}")
    return found
