"""Networks in the ONNX format, run on one thread by ONNX Runtime or OpenCV.

A network is loaded once in each process and engine, by the hash of its file. Both engines give the
same bits for the same input on one machine with one version of the library.

A file may come from anywhere: it is regular, of limited size and whole (`onnx_files`), and loading
and each run have a time limit.
"""

from __future__ import annotations

import os
import threading
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Future, wait
from functools import lru_cache, partial
from importlib.util import find_spec
from pathlib import Path
from typing import Any, Protocol, TypeVar

import numpy as np
from numpy.typing import NDArray

from pf_tracker_ros.networks.onnx_files import (
    check_is_whole,
    content_hash,
    file_hash,
    read_network,
    with_output_shapes,
)
from pf_tracker_ros.opencv import one_opencv_thread, quiet_opencv
from pf_tracker_ros.parameters import ParameterError

Tensor = NDArray[np.float32]

# Networks that stay loaded in a process.
_LOADED = 16
# Seconds that loading or one run may take. Networks here take milliseconds.
_TIME_LIMIT = 10.0
# A process that was stopped and goes on has used up one part of the time only.
_PARTS = 20
Result = TypeVar("Result")


class _Engine(Protocol):
    """A network in a library."""

    def run(self, inputs: Mapping[str, Tensor], outputs: Sequence[str]) -> list[Tensor]:
        """See `Network.run`."""

    def stop(self) -> None:
        """End a run in another thread, if the library can."""


class Network:
    """A loaded network. No run blocks its caller for longer than a time limit.

    Args:
        engine: The network in a library.
    """

    def __init__(self, engine: _Engine) -> None:
        self._engine = engine
        self._timed_out = False

    def run(self, inputs: Mapping[str, Tensor], outputs: Sequence[str]) -> list[Tensor]:
        """The named outputs for the named inputs.

        Raises:
            TimeoutError: This run or an earlier one takes longer than the time limit.
            Exception: The engine refuses names, shapes or an operation; its type is the engine's.
        """
        if self._timed_out:
            raise TimeoutError(f"an earlier run took more than {_TIME_LIMIT:g} s")
        try:
            return _within_time_limit(partial(self._engine.run, inputs, outputs))
        except TimeoutError:
            self._timed_out = True
            self._engine.stop()
            raise


def _within_time_limit(work: Callable[[], Result]) -> Result:
    """The result of work in a thread of its own, where it goes on if it takes too long.

    Raises:
        TimeoutError: It takes too long.
        Exception: As of the work.
    """
    outcome: Future[Result] = Future()

    def run() -> None:
        try:
            outcome.set_result(work())
        except BaseException as error:
            outcome.set_exception(error)

    # The end of the process does not wait for the thread.
    threading.Thread(target=run, name="network", daemon=True).start()
    for _ in range(_PARTS):
        if wait([outcome], timeout=_TIME_LIMIT / _PARTS).done:
            return outcome.result()
    raise TimeoutError(f"it takes more than {_TIME_LIMIT:g} s")


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


def load_network(path: Path, engine: str) -> Network:
    """The network of a file, loaded once in a process.

    Args:
        path: The file.
        engine: As returned by `engine_name`.

    Raises:
        ParameterError: It cannot be read, keeps weights in another file, or takes too long to load.
    """
    return _load(path, file_hash(path), engine, os.getpid())


@lru_cache(maxsize=_LOADED)
def _load(path: Path, sha256: str, engine: str, process: int) -> Network:
    """A network by its hash; a forked process loads its own."""
    content = read_network(path)
    if content_hash(content) != sha256:
        raise ParameterError(f"{path} was changed while it was read; try again")
    try:
        return Network(_within_time_limit(partial(_read, content, engine)))
    except Exception as error:
        reason = " ".join(str(error).split())
        raise ParameterError(
            f"{path} cannot be read as a network in the ONNX format by {engine} ({reason})"
        ) from error


def _read(content: bytes, engine: str) -> _Engine:
    check_is_whole(content)
    return _ENGINES[engine](content)


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

    def stop(self) -> None:
        """See `_Engine.stop`; OpenCV cannot."""


class _RuntimeNetwork:
    """A network in ONNX Runtime."""

    def __init__(self, content: bytes) -> None:
        import onnxruntime

        options = onnxruntime.SessionOptions()
        options.intra_op_num_threads = options.inter_op_num_threads = 1
        options.log_severity_level = 3
        # Not its own format, which `check_is_whole` does not read.
        options.add_session_config_entry("session.load_model_format", "ONNX")
        self._session = onnxruntime.InferenceSession(
            content, options, providers=["CPUExecutionProvider"]
        )
        self._run_options = onnxruntime.RunOptions()

    def run(self, inputs: Mapping[str, Tensor], outputs: Sequence[str]) -> list[Tensor]:
        """See `Network.run`."""
        results: list[Any] = self._session.run(list(outputs), dict(inputs), self._run_options)
        return results

    def stop(self) -> None:
        """See `_Engine.stop`."""
        self._run_options.terminate = True


_ENGINES: Mapping[str, Callable[[bytes], _Engine]] = {
    "opencv": _OpenCvNetwork,
    "onnxruntime": _RuntimeNetwork,
}
