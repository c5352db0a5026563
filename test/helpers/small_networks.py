"""Writes small networks in the ONNX format, without the package onnx.

Bytes are in the format of Protocol Buffers, with the field numbers of onnx.proto.
"""

import numpy as np


def _number(value):
    encoded = bytearray()
    while value > 127:
        encoded.append(value & 127 | 128)
        value >>= 7
    return bytes([*encoded, value])


def field(number, value):
    """A field of a message: a number, or text, bytes or a message with its length."""
    if isinstance(value, int):
        return _number(number << 3) + _number(value)
    value = value.encode() if isinstance(value, str) else value
    return _number(number << 3 | 2) + _number(len(value)) + value


def tensor(name, values):
    """A constant."""
    values = np.asarray(values, np.float32)
    dimensions = b"".join(field(1, length) for length in values.shape)
    return dimensions + field(2, 1) + field(8, name) + field(9, values.tobytes())


def value(name, shape):
    """An input or an output; an empty shape is left out."""
    dimensions = b"".join(field(1, field(1, length)) for length in shape)
    kind = field(1, 1) + (field(2, dimensions) if shape else b"")
    return field(1, name) + field(2, field(1, kind))


def integers(name, *values):
    """An attribute of a node."""
    numbers = b"".join(field(8, value) for value in values)
    return field(5, field(1, name) + numbers + field(20, 7))


def node(kind, inputs, output, *attributes):
    """An operation."""
    names = b"".join(field(1, name) for name in inputs)
    return names + field(2, output) + field(4, kind) + b"".join(attributes)


def network(nodes, tensors, inputs, outputs):
    """The bytes of a file."""
    graph = b"".join(field(1, one) for one in nodes) + field(2, "network")
    graph += b"".join(field(5, one) for one in tensors)
    graph += b"".join(field(11, one) for one in inputs)
    graph += b"".join(field(12, one) for one in outputs)
    return field(1, 7) + field(7, graph) + field(8, field(2, 13))
