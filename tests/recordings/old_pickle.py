# SPDX-License-Identifier: Apache-2.0
"""Writes tables as pandas up to 1.2 pickled them, which is the form of PandaSet's tables: with the class names of
that time and block states "0.14.1"."""

import gzip
import io
import pickle

import numpy as np


class Named:
    """An object that is pickled by name: a class or a function, the arguments of its call, and a state."""

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
    """Returns a table of named columns of equal length. Numbers of one type share a block, as in old pandas; texts
    are objects."""
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
    """Returns the bytes of the table's pickle."""
    return gzip.compress(dumps(table(columns)), 1)
