"""Files of networks in the ONNX format: where they may be, and their bytes.

A file is in the format of Protocol Buffers, with the messages and field numbers of onnx.proto of
ONNX.
"""

from __future__ import annotations

import hashlib
from collections.abc import Iterator
from functools import lru_cache
from pathlib import Path
from typing import NamedTuple

from pf_tracker_ros.footage import FootageError
from pf_tracker_ros.footage.access import check_file, read_file, resolved
from pf_tracker_ros.parameters import ParameterError

# Bytes of a file, which is in memory about three times while it is loaded.
_MAX_BYTES = 500 * 10**6
# Files whose hash is remembered.
_HASHED = 64
# Path of the message fields from ModelProto to the tensor type of an output, and the number of its
# shape: graph, output, type, tensor_type; shape.
_OUTPUT_TYPES, _SHAPE = (7, 12, 2, 1), 2
# Messages with tensors somewhere in them: number of a field to its message.
_PARTS = {
    "model": {7: "graph", 20: "training", 25: "function"},
    "training": {1: "graph", 2: "graph"},
    "graph": {1: "node", 5: "tensor", 15: "sparse tensor"},
    "function": {7: "node", 11: "attribute"},
    "node": {5: "attribute"},
    "attribute": {
        **{5: "tensor", 6: "graph", 10: "tensor", 11: "graph"},
        **{22: "sparse tensor", 23: "sparse tensor"},
    },
    "sparse tensor": {1: "tensor", 2: "tensor"},
    "tensor": {},
}
# Number of a tensor's field which is not 0 if its values are in another file.
_DATA_LOCATION = 14
# Wire types of Protocol Buffers: variable-length number, 8 bytes, bytes with their length, 4 bytes.
_NUMBER, _EIGHT, _BYTES, _FOUR = 0, 1, 2, 5
# Bytes of the longest variable-length number.
_MAX_NUMBER = 10


def network_path(folder: Path, name: str) -> Path:
    """The path of a file that a description names.

    Raises:
        ParameterError: It is not in the folder of the description.
    """
    path = folder / name
    is_inside = not Path(name).is_absolute() and ".." not in Path(name).parts and "\0" not in name
    # Also where its links lead.
    if not (is_inside and resolved(path).is_relative_to(resolved(folder))):
        raise ParameterError(
            f"the file {name!r} of a network is not in the folder {folder} of its description; "
            "copy it there, and give its name"
        )
    return path


def file_hash(path: Path) -> str:
    """SHA-256 of a network's file, hexadecimal.

    Raises:
        ParameterError: As for `read_network`.
    """
    try:
        check_file(path, "network")
        status = path.stat()
    except (FootageError, OSError) as error:
        raise ParameterError(str(error)) from error
    return _hash_at(path, status.st_mtime_ns, status.st_size)


@lru_cache(maxsize=_HASHED)
def _hash_at(path: Path, modified: int, size: int) -> str:
    return content_hash(read_network(path))


def content_hash(content: bytes) -> str:
    """SHA-256 of a network, hexadecimal."""
    return hashlib.sha256(content).hexdigest()


def read_network(path: Path) -> bytes:
    """The bytes of a network.

    Raises:
        ParameterError: It is missing, not a regular file, too large, or not readable.
    """
    try:
        return read_file(path, "network", _MAX_BYTES)
    except FootageError as error:
        raise ParameterError(str(error)) from error


def check_is_whole(content: bytes) -> None:
    """Check that all values of a network are in its own file: its hash is of nothing else.

    Raises:
        ValueError: Some are in another file, or the bytes are not in the format of Protocol
            Buffers.
        IndexError: The latter.
    """
    messages = [("model", slice(0, len(content)))]
    while messages:
        kind, place = messages.pop()
        for field in _fields(content, place):
            if kind == "tensor" and field.number == _DATA_LOCATION and field.value:
                raise ValueError(
                    "it has weights in another file; export it with all weights in one file, such "
                    "as by external_data=False"
                )
            part = _PARTS[kind].get(field.number)
            if part and field.content:
                messages.append((part, field.content))


def with_output_shapes(content: bytes) -> bytes:
    """An ONNX file whose outputs without a shape have an empty one, which OpenCV requires.

    Raises:
        IndexError: The bytes are not in the format of Protocol Buffers.
        ValueError: The same.
    """
    return _edited(content, slice(0, len(content)), _OUTPUT_TYPES)


def _edited(content: bytes, message: slice, path: tuple[int, ...]) -> bytes:
    if not path:
        has_shape = any(field.number == _SHAPE for field in _fields(content, message))
        return content[message] if has_shape else content[message] + _field(_SHAPE, b"")
    return b"".join(
        _field(field.number, _edited(content, field.content, path[1:]))
        if field.number == path[0] and field.content
        else content[field.whole]
        for field in _fields(content, message)
    )


class _Field(NamedTuple):
    """A field of a message.

    Attributes:
        number: Its number.
        value: If it is a variable-length number, else 0.
        content: Place of its content, if it has a length.
        whole: Place of all of its bytes.
    """

    number: int
    value: int
    content: slice | None
    whole: slice


def _fields(content: bytes, message: slice) -> Iterator[_Field]:
    """The fields of the message in a place of a file in the format of Protocol Buffers."""
    place = message.start
    while place < message.stop:
        start, value, inner = place, 0, None
        key, place = _read_number(content, place)
        kind = key & 7
        if kind == _BYTES:
            length, place = _read_number(content, place)
            inner = slice(place, place + length)
            place += length
        elif kind == _NUMBER:
            value, place = _read_number(content, place)
        elif kind in (_FOUR, _EIGHT):
            place += 4 if kind == _FOUR else 8
        else:
            raise ValueError(f"unknown wire type {kind}")
        if place > message.stop:
            raise ValueError("the file is cut short")
        # Readers of the format cut keys to 32 bits.
        yield _Field((key & 0xFFFFFFFF) >> 3, value, inner, slice(start, place))


def _read_number(content: bytes, place: int) -> tuple[int, int]:
    """A variable-length number and the place after it."""
    value = 0
    for shift in range(0, 7 * _MAX_NUMBER, 7):
        byte = content[place]
        value |= (byte & 127) << shift
        place += 1
        if byte < 128:
            return value, place
    raise ValueError(f"a number has more than {_MAX_NUMBER} bytes")


def _field(number: int, content: bytes) -> bytes:
    return _number(number << 3 | _BYTES) + _number(len(content)) + content


def _number(value: int) -> bytes:
    """A variable-length number."""
    parts = bytearray()
    while value > 127:
        parts.append(value & 127 | 128)
        value >>= 7
    parts.append(value)
    return bytes(parts)
