# SPDX-License-Identifier: Apache-2.0
"""Writes ONNX files without the onnx package: protocol buffers encoded by hand (onnx.proto of ONNX 1.8, opset 13)."""

import struct

import numpy as np

TYPES = {np.dtype(np.float32): 1, np.dtype(np.uint8): 2, np.dtype(np.int32): 6, np.dtype(np.int64): 7}


def varint(value):
    value &= (1 << 64) - 1
    out = b""
    while value > 127:
        out += bytes([value & 127 | 128])
        value >>= 7
    return out + bytes([value])


def field(number, value):
    """Encodes one field: integers as varints, floats as 32 bits, texts and messages with their length."""
    if isinstance(value, float):
        return varint(number << 3 | 5) + struct.pack("<f", value)
    if isinstance(value, int):
        return varint(number << 3) + varint(value)
    data = value.encode() if isinstance(value, str) else value
    return varint(number << 3 | 2) + varint(len(data)) + data


def tensor(name, array):
    array = np.array(array, order="C")
    dims = b"".join(field(1, side) for side in array.shape)
    return dims + field(2, TYPES[array.dtype]) + field(8, name) + field(9, array.tobytes())


def value_info(name, dtype, shape):
    """Describes a tensor; a dimension given as a text is a free dimension of that name."""
    sides = b"".join(field(1, field(2, side) if isinstance(side, str) else field(1, side)) for side in shape)
    return field(1, name) + field(2, field(1, field(1, TYPES[np.dtype(dtype)]) + field(2, sides)))


def attribute(name, value):
    if isinstance(value, (list, tuple)):
        return field(1, name) + b"".join(field(8, int(v)) for v in value) + field(20, 7)
    if isinstance(value, float):
        return field(1, name) + field(2, value) + field(20, 1)
    if isinstance(value, int):
        return field(1, name) + field(3, value) + field(20, 2)
    return field(1, name) + field(4, value) + field(20, 3)


class Graph:
    def __init__(self):
        self.parts, self.count = b"", 0

    def input(self, name, shape, dtype=np.float32):
        self.parts += field(11, value_info(name, dtype, shape))
        return name

    def output(self, name, source, shape, dtype=np.float32):
        self.parts += field(1, field(1, source) + field(2, name) + field(4, "Identity"))
        self.parts += field(12, value_info(name, dtype, shape))

    def constant(self, array, dtype=np.float32):
        self.count += 1
        name = f"c{self.count}"
        self.parts += field(5, tensor(name, np.asarray(array, dtype)))
        return name

    def op(self, kind, *inputs, **attributes):
        """Adds a node with one output; numbers among its inputs become constants."""
        self.count += 1
        name = f"n{self.count}"
        named = [i if isinstance(i, str) else self.constant(i) for i in inputs]
        node = b"".join(field(1, i) for i in named) + field(2, name) + field(4, kind)
        self.parts += field(1, node + b"".join(field(5, attribute(k, v)) for k, v in attributes.items()))
        return name

    def save(self, path):
        graph = self.parts + field(2, "g")
        with open(path, "wb") as file:
            file.write(field(1, 7) + field(7, graph) + field(8, field(1, "") + field(2, 13)))
