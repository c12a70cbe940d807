# SPDX-License-Identifier: Apache-2.0
"""Writes a table as pandas up to 1.2 pickled it, which is how PandaSet's tables come: the names of pandas' classes of then, their states "0.14.1"."""

import gzip
import io
import pickle

import numpy as np


class Named:
    """An object pickled by name: a class, or a function that is called with arguments, and a state."""

    def __init__(self, name, arguments=(), state=None):
        self.name, self.arguments, self.state = name, arguments, state


class Writer(pickle._Pickler):
    def save(self, thing, save_persistent_id=True):
        if not isinstance(thing, Named):
            return super().save(thing, save_persistent_id)
        self.write(pickle.GLOBAL + f"{thing.name[0]}\n{thing.name[1]}\n".encode())
        if thing.arguments is None:
            return None
        self.save(tuple(thing.arguments))
        self.write(pickle.REDUCE)
        if thing.state is not None:
            self.save(thing.state)
            self.write(pickle.BUILD)
        return None


def dumps(thing):
    out = io.BytesIO()
    Writer(out, 3).dump(thing)
    return out.getvalue()


def table(columns):
    """Columns of equal length by name: numbers of one kind share a block, as they did; texts are objects."""
    names, kinds = list(columns), {}
    for i, name in enumerate(names):
        column = np.asarray(columns[name])
        kinds.setdefault(column.dtype if column.dtype.kind in "fib" else np.dtype(object), []).append(i)
    blocks = []
    for kind, places in kinds.items():
        where = (
            slice(places[0], places[-1] + 1, 1)
            if places == list(range(places[0], places[-1] + 1))
            else np.array(places)
        )
        blocks.append(
            {"values": np.array([np.asarray(columns[names[i]]).astype(kind) for i in places]), "mgr_locs": where}
        )
    rows = len(columns[names[0]])
    index = lambda kind, parts: Named(
        ("pandas.core.indexes.base", "_new_Index"), (Named(("pandas.core.indexes." + kind[0], kind[1]), None), parts)
    )  # noqa: E731
    axes = [
        index(("base", "Index"), {"data": np.array(names, object), "name": None}),
        index(("range", "RangeIndex"), {"start": 0, "stop": rows, "step": 1, "name": None}),
    ]
    old = (axes, [block["values"] for block in blocks], [], {"0.14.1": {"axes": axes, "blocks": blocks}})
    manager = Named(("pandas.core.internals.managers", "BlockManager"), (), old)
    return Named(("pandas.core.frame", "DataFrame"), (), {"_data": manager, "_typ": "dataframe", "_metadata": []})


def packed(columns):
    """The file of a table."""
    return gzip.compress(dumps(table(columns)), 1)
