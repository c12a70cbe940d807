# SPDX-License-Identifier: Apache-2.0
"""Opens ONNX models, describes their inputs and outputs, and runs them."""

import dataclasses
import hashlib
import os

import numpy as np

from .errors import SegmentError

TYPES = {
    "tensor(float)": np.float32,
    "tensor(float16)": np.float16,
    "tensor(double)": np.float64,
    "tensor(uint8)": np.uint8,
    "tensor(int64)": np.int64,
    "tensor(int32)": np.int32,
    "tensor(bool)": np.bool_,
}


@dataclasses.dataclass(frozen=True)
class Tensor:
    """One input or output of a model; free dimensions of `shape` have the value None."""

    name: str
    type: str
    shape: tuple

    @property
    def dtype(self):
        return TYPES.get(self.type, np.float32)

    @property
    def is_float(self):
        return self.type in ("tensor(float)", "tensor(float16)", "tensor(double)")

    @property
    def is_integer(self):
        return self.type in ("tensor(int64)", "tensor(int32)", "tensor(uint8)", "tensor(uint16)", "tensor(int8)")

    def __str__(self):
        sides = "x".join("?" if side is None else str(side) for side in self.shape)
        return f"{self.name} {self.type[7:-1]}[{sides}]"


def tensor_of(value):
    shape = tuple(side if isinstance(side, int) and side > 0 else None for side in value.shape)
    return Tensor(value.name, value.type, shape)


class Model:
    """An ONNX model opened by onnxruntime for the CPU."""

    def __init__(self, path, threads=0):
        try:
            import onnxruntime
        except ImportError:
            raise SegmentError(
                "onnxruntime is not installed here; run `make setup` and use tools/segment/.venv/bin/python, or "
                "pip install -r tools/segment/requirements.txt"
            ) from None
        if not os.path.isfile(path):
            raise SegmentError(f"{path}: no such file; expected an ONNX model")
        options = onnxruntime.SessionOptions()
        options.intra_op_num_threads = threads
        options.log_severity_level = 4  # errors are reported by the exception
        try:
            self.session = onnxruntime.InferenceSession(path, options, providers=["CPUExecutionProvider"])
        except Exception as error:  # onnxruntime's own classes are not part of its documented interface
            reason = str(error).strip().splitlines()[0]
            raise SegmentError(f"{path}: not an ONNX model that onnxruntime can read: {reason}") from None
        self.path = path
        self.inputs = [tensor_of(value) for value in self.session.get_inputs()]
        self.outputs = [tensor_of(value) for value in self.session.get_outputs()]
        self.options = onnxruntime.RunOptions()
        self.options.log_severity_level = 4
        self.options.only_execute_path_to_fetches = True  # don't compute unused outputs, such as full-size masks

    def input(self, name):
        return next((tensor for tensor in self.inputs if tensor.name == name), None)

    def output(self, name):
        return next((tensor for tensor in self.outputs if tensor.name == name), None)

    def signature(self):
        return f"inputs {', '.join(map(str, self.inputs))}; outputs {', '.join(map(str, self.outputs))}"

    def refuse(self, expected):
        return SegmentError(f"{self.path}: its signature doesn't match: found {self.signature()}; expected {expected}")

    def run(self, outputs, feed):
        try:
            return self.session.run(outputs, feed, self.options)
        except Exception as error:
            reason = str(error).strip().splitlines()[0]
            raise SegmentError(f"{self.path}: failed to run: {reason}") from None


def identity(path):
    """Name and SHA-256 of a file, which identify the model in the record of a run."""
    digest = hashlib.sha256()
    with open(path, "rb") as file:
        while chunk := file.read(1 << 20):
            digest.update(chunk)
    return {"name": os.path.basename(path), "sha256": digest.hexdigest()}
