# SPDX-License-Identifier: Apache-2.0
"""Tables that pandas wrote as pickles, read without running what they say: a pickle is a program, and this one may call nothing but numpy's arrays.

Of pandas only the names are known that its pickled tables consist of (the form "0.14.1", which versions up to 1.2 wrote); stand-ins take their
parts. Anything else that a file names is refused.
"""

import gzip
import io
import pickle
import zlib

import numpy as np

from .errors import RecordingError

MOST = 1 << 30  # bytes, unpacked: the largest tables of the sources take 10 MB
RECONSTRUCT = np.zeros(0).__reduce__()[0]


class Parts:
    """Stands for an object of pandas: keeps its state."""

    state = None

    def __init__(self, *arguments):
        pass

    def __setstate__(self, state):
        self.state = state


def array_of(kind, *arguments):
    """numpy's own, of arrays alone: no subclass can be named."""
    if kind is not np.ndarray:
        raise pickle.UnpicklingError("an array of another class")
    return RECONSTRUCT(kind, *arguments)


NAMES = {
    ("builtins", "slice"): slice,
    ("pandas.core.frame", "DataFrame"): Parts,
    ("pandas.core.internals.managers", "BlockManager"): Parts,
    ("pandas.core.indexes.base", "_new_Index"): lambda kind, parts: parts,
    ("pandas.core.indexes.base", "Index"): Parts,
    ("pandas.core.indexes.numeric", "Int64Index"): Parts,
    ("pandas.core.indexes.range", "RangeIndex"): Parts,
    ("numpy", "ndarray"): np.ndarray,
    ("numpy", "dtype"): np.dtype,
    ("numpy.core.multiarray", "_reconstruct"): array_of,
    ("numpy._core.multiarray", "_reconstruct"): array_of,
}


class Reader(pickle.Unpickler):
    def find_class(self, module, name):
        if (module, name) not in NAMES:
            newer = "; tables of pandas 1.3 and later aren't read, take PandaSet's own files" if module.split(".")[0] in ("pandas", "pyarrow") else ""
            raise pickle.UnpicklingError(f"names {module}.{name}, which no table needs{newer}")
        return NAMES[module, name]

    def persistent_load(self, identity):
        raise pickle.UnpicklingError("refers to something outside of the file")


def unpacked(path):
    """The bytes of a pickle, which may be compressed, whatever its name says."""
    with open(path, "rb") as file:
        packed = file.read(2) == b"\x1f\x8b"
    with gzip.open(path, "rb") if packed else open(path, "rb") as file:
        data = file.read(MOST + 1)
    if len(data) > MOST:
        raise RecordingError(f"{path}: is over {MOST >> 20} MB unpacked, more than any table")
    return data


def table(path, columns):
    """Columns of a table by their names, each a numpy array; RecordingError unless all of `columns` are there."""
    try:
        frame = Reader(io.BytesIO(unpacked(path))).load()
        parts = (frame.state.get("_mgr") or frame.state["_data"]).state[3]["0.14.1"]
        names = [str(name) for name in parts["axes"][0]["data"]]
        found = {}
        for block in parts["blocks"]:
            found.update((names[i], row) for i, row in zip(np.arange(len(names))[block["mgr_locs"]], np.atleast_2d(block["values"])))
        lengths = {len(column) for column in found.values()}
        if len(lengths) != 1:
            raise ValueError("its columns differ in length" if lengths else "it has no columns")
    except (OSError, EOFError, zlib.error, pickle.UnpicklingError, ValueError, TypeError, AttributeError, LookupError, MemoryError, OverflowError) as error:
        raise RecordingError(f"{path}: can't be read as a pickled table: {str(error).splitlines()[0] if str(error) else type(error).__name__}") from None
    lacking = [name for name in columns if name not in found]
    if lacking:
        raise RecordingError(f"{path}: has no column {lacking[0]!r}; expected {', '.join(columns)}")
    return found
