"""Networks in the ONNX format, run on one thread by ONNX Runtime or OpenCV.

A network is loaded once in each process and engine, by the hash of its file. Both engines give the
same bits for the same input on one machine with one version of the library.
"""

from __future__ import annotations

import hashlib
import os
import threading
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import lru_cache
from importlib.util import find_spec
from pathlib import Path
from typing import Any, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from pf_tracker_ros.opencv import one_opencv_thread, quiet_opencv
from pf_tracker_ros.parameters import ParameterError

Tensor = NDArray[np.float32]

# Networks that stay loaded in a process.
_LOADED = 16
# Path of the message fields from ModelProto to the tensor type of an output, and the number of its
# shape: graph, output, type, tensor_type; shape. Source: onnx.proto of ONNX.
_OUTPUT_TYPES, _SHAPE = (7, 12, 2, 1), 2
# Wire types of Protocol Buffers: variable-length number, 8 bytes, bytes with their length, 4 bytes.
_NUMBER, _EIGHT, _BYTES, _FOUR = 0, 1, 2, 5


class Network(Protocol):
    """A loaded network."""

    def run(self, inputs: Mapping[str, Tensor], outputs: Sequence[str]) -> list[Tensor]:
        """The named outputs for the named inputs.

        Raises:
            Exception: The engine refuses names, shapes or an operation; its type is the engine's.
        """


def engine_name(engine: str) -> str:
    """The engine in use here.

    Args:
        engine: onnxruntime, opencv, or auto for ONNX Runtime where it is installed, else OpenCV.

    Raises:
        ParameterError: ONNX Runtime is not installed.
    """
    has_runtime = find_spec("onnxruntime") is not None
    if engine == "onnxruntime" and not has_runtime:
        raise ParameterError(
            "ONNX Runtime is not installed: pip install onnxruntime, or choose the engine opencv"
        )
    if engine == "auto":
        return "onnxruntime" if has_runtime else "opencv"
    return engine


def file_hash(path: Path) -> str:
    """SHA-256 of a file, hexadecimal.

    Raises:
        OSError: The file cannot be read.
    """
    stat = path.stat()
    return _hash_of(path, stat.st_mtime_ns, stat.st_size)


@lru_cache(maxsize=4 * _LOADED)
def _hash_of(path: Path, modified: int, size: int) -> str:
    return hashlib.sha256(path.read_bytes()).hexdigest()


def load_network(path: Path, engine: str) -> Network:
    """The network of a file, loaded once in a process.

    Args:
        path: The file.
        engine: As returned by `engine_name`.

    Raises:
        ParameterError: The engine cannot read the file.
        OSError: The file cannot be read.
    """
    return _load(path, file_hash(path), engine, os.getpid())


@lru_cache(maxsize=_LOADED)
def _load(path: Path, sha256: str, engine: str, process: int) -> Network:
    """A network by its hash; a forked process loads its own."""
    try:
        return _LOADERS[engine](path.read_bytes())
    except OSError:
        raise
    except Exception as error:
        reason = " ".join(str(error).split())
        raise ParameterError(
            f"{path} cannot be read as a network in the ONNX format by {engine} ({reason})"
        ) from error


class _OpenCvNetwork:
    """A network in OpenCV's `dnn` module, which is not safe for several threads."""

    def __init__(self, content: bytes) -> None:
        import cv2

        with quiet_opencv():
            patched = np.frombuffer(with_output_shapes(content), np.uint8)
            self._net = cv2.dnn.readNetFromONNX(patched)
        self._lock = threading.Lock()

    def run(self, inputs: Mapping[str, Tensor], outputs: Sequence[str]) -> list[Tensor]:
        """See `Network.run`."""
        with self._lock, one_opencv_thread(), quiet_opencv():
            for name, values in inputs.items():
                self._net.setInput(values, name)
            # Copies: the arrays may be the network's own memory.
            return [values.copy() for values in self._net.forward(list(outputs))]


class _RuntimeNetwork:
    """A network in ONNX Runtime."""

    def __init__(self, content: bytes) -> None:
        import onnxruntime

        options = onnxruntime.SessionOptions()
        options.intra_op_num_threads = options.inter_op_num_threads = 1
        options.log_severity_level = 3
        self._session = onnxruntime.InferenceSession(
            content, options, providers=["CPUExecutionProvider"]
        )

    def run(self, inputs: Mapping[str, Tensor], outputs: Sequence[str]) -> list[Tensor]:
        """See `Network.run`."""
        results: list[Any] = self._session.run(list(outputs), dict(inputs))
        return results


_LOADERS: Mapping[str, Callable[[bytes], Network]] = {
    "opencv": _OpenCvNetwork,
    "onnxruntime": _RuntimeNetwork,
}


def with_output_shapes(content: bytes) -> bytes:
    """An ONNX file whose outputs without a shape have an empty one, which OpenCV requires.

    Raises:
        IndexError: The bytes are not in the format of Protocol Buffers.
        ValueError: The same.
    """
    return _edited(content, _OUTPUT_TYPES)


def _edited(message: bytes, path: tuple[int, ...]) -> bytes:
    if not path:
        has_shape = any(field.number == _SHAPE for field in _fields(message))
        return message if has_shape else message + _field(_SHAPE, b"")
    return b"".join(
        _field(field.number, _edited(field.content, path[1:]))
        if field.number == path[0] and field.content is not None
        else field.encoded
        for field in _fields(message)
    )


class _Field(NamedTuple):
    """A field of a message: number, content if it has a length, and all of its bytes."""

    number: int
    content: bytes | None
    encoded: bytes


def _fields(message: bytes) -> Iterator[_Field]:
    """The fields of a message in the format of Protocol Buffers."""
    place = 0
    while place < len(message):
        start, content = place, None
        key, place = _read_number(message, place)
        kind = key & 7
        if kind == _BYTES:
            length, place = _read_number(message, place)
            content = message[place : place + length]
            place += length
        elif kind == _NUMBER:
            _, place = _read_number(message, place)
        elif kind in (_FOUR, _EIGHT):
            place += 4 if kind == _FOUR else 8
        else:
            raise ValueError(f"unknown wire type {kind}")
        if place > len(message):
            raise ValueError("the file is cut short")
        yield _Field(key >> 3, content, message[start:place])


def _read_number(message: bytes, place: int) -> tuple[int, int]:
    """A variable-length number and the place after it."""
    value = shift = 0
    while True:
        byte = message[place]
        value |= (byte & 127) << shift
        place += 1
        if byte < 128:
            return value, place
        shift += 7


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
