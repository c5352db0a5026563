"""An embedding network: vectors of boxes, close to each other for boxes of one target.

1. A crop of each box is read in the network's size.
2. The network converts it to a vector, or to a map of features. A map is averaged over parts of the
   box: from top to bottom, clothes differ along a body in every pose.
3. Vectors have length 1; their distance is 1 minus the cosine between them.

Sources: Wojke, Bewley 2018, "Deep cosine metric learning for person re-identification"; Sun et al.
2018, "Beyond part models: person retrieval with refined part pooling" (parts).
"""

from __future__ import annotations

import os
from typing import Any
from weakref import WeakValueDictionary

import numpy as np
from numpy.typing import NDArray

from pf_tracker_ros.frames import Frame
from pf_tracker_ros.networks.crops import Crop, mean_color, normalized, read_crop
from pf_tracker_ros.networks.description import ModelDescription, description_path, read_model
from pf_tracker_ros.networks.engines import engine_name, load_network
from pf_tracker_ros.networks.onnx_files import file_hash, network_path
from pf_tracker_ros.parameters import ParameterError

# Least length of a vector that is scaled to length 1.
_LEAST_LENGTH = 1e-9


class EmbeddingNetwork:
    """An embedding network with its description.

    A copy is the network itself. A pickle holds path and hash, and reads the files again.

    Args:
        model: Folder of the model, or the path of its description.
        engine: auto, onnxruntime or opencv.

    Attributes:
        description: Its description.
        folder: Folder of its files.
        engine: The engine in use.
        sha256: Hash of its file.

    Raises:
        ParameterError: The network cannot be used; the message says why and what to do.
    """

    def __init__(self, model: str, engine: str = "auto") -> None:
        if not model:
            raise ParameterError(
                "parameter 'appearance.embedding.model' is empty; allowed: the folder of a network "
                "with its model.yaml, see docs/identities.md"
            )
        self._arguments = (model, engine)
        self.engine = engine_name(engine)
        self.description, self.folder = read_model(model)
        rules = self.description.embedding
        path = network_path(self.folder, rules.file)
        try:
            self.sha256 = file_hash(path)
        except ParameterError as error:
            raise ParameterError(
                f"the network {self.description.name} cannot be used: {error}; it comes from "
                f"{self.description.source}"
            ) from error
        if rules.sha256 and self.sha256 != rules.sha256.lower():
            raise ParameterError(
                f"{path} is not the file that {self.description.name} describes: its SHA-256 is "
                f"{self.sha256}, not {rules.sha256}"
            )
        self._network = load_network(path, self.engine)
        key = (self.description, self.engine, self.sha256)
        if key not in _CHECKED:
            self._check()
            _CHECKED.add(key)

    def __reduce__(self) -> tuple[Any, ...]:
        return _restored, (self._arguments, self.sha256)

    def __deepcopy__(self, memo: dict[int, Any]) -> EmbeddingNetwork:
        return self

    def embed(self, frame: Frame, boxes: NDArray[np.float64]) -> NDArray[np.float32]:
        """(N, D) vectors of length 1 of (N, 4) boxes, pixels.

        Published networks have a fixed batch of one, so each box is a run of the network. A vector
        that is not finite is 0, which is like no other.

        Raises:
            ParameterError: The network does not fit its description.
        """
        border = mean_color(frame)
        return np.array([self._embed(frame, box, border) for box in boxes], np.float32)

    def _embed(
        self, frame: Frame, box: NDArray[np.float64], border: tuple[float, ...]
    ) -> NDArray[np.float32]:
        rules = self.description.embedding
        size = np.maximum(box[2:], 1.0) * rules.scale
        crop = Crop(box[:2] + box[2:] / 2 - size / 2, size)
        pixels = read_crop(frame, crop, (rules.width, rules.height), border)
        inputs = {rules.input: normalized(pixels, self.description)}
        try:
            (values,) = self._network.run(inputs, [rules.output])
        except Exception as error:
            # Each library has its own types of errors.
            reason = " ".join(str(error).split())
            raise ParameterError(
                f"the network {self.description.name} cannot run {rules.file} as its description "
                f"says ({reason})"
            ) from error
        vector = self._pooled(values).ravel()
        length = float(np.linalg.norm(vector))
        # A comparison with a value that is not finite is false.
        if _LEAST_LENGTH < length < np.inf:
            return vector / np.float32(length)
        return np.zeros_like(vector)

    def _pooled(self, values: NDArray[np.float32]) -> NDArray[np.float32]:
        """(D,) or (channels, rows, columns) of the network's output for one box.

        Raises:
            ParameterError: It is neither a vector nor a map with as many rows and columns.
        """
        rules = self.description.embedding
        if values.size == max(values.shape, default=0):
            return values.ravel()
        if values.ndim != 4 or values.shape[2] < rules.rows or values.shape[3] < rules.columns:
            raise ParameterError(
                f"the output {rules.output} of the network {self.description.name} has the shape "
                f"{values.shape}; allowed: a vector, or a map (1, channels, rows, columns) of at "
                f"least {rules.rows} x {rules.columns}"
            )
        parts = [
            np.array_split(rows, rules.columns, axis=2)
            for rows in np.array_split(values[0], rules.rows, axis=1)
        ]
        pooled = [[part.mean(axis=(1, 2)) for part in row] for row in parts]
        return np.array(pooled, np.float32)

    def _check(self) -> None:
        """Run the network once, on a gray frame.

        Raises:
            ParameterError: It does not fit its description.
        """
        frame = Frame(np.full((64, 64), 128, np.uint8))
        if not self.embed(frame, np.array([[16.0, 16.0, 32.0, 32.0]])).any():
            raise ParameterError(
                f"the network {self.description.name} gives no finite vector but 0; check mean and "
                "deviation in its description, or export it again"
            )


# Networks in use, by path, engine and process.
_IN_USE: WeakValueDictionary[tuple[str, str, int], EmbeddingNetwork] = WeakValueDictionary()
# Networks that fit their descriptions: description, engine and hash.
_CHECKED: set[tuple[ModelDescription, str, str]] = set()


def open_network(model: str, engine: str = "auto") -> EmbeddingNetwork:
    """A network; one in use in this process is not read again, even if its files are gone.

    Args:
        model: As of `EmbeddingNetwork`.
        engine: As of `EmbeddingNetwork`.

    Raises:
        ParameterError: As of `EmbeddingNetwork`.
    """
    # A forked process loads its own.
    key = (model and str(description_path(model).absolute()), engine, os.getpid())
    network = _IN_USE.get(key)
    if network is None:
        network = _IN_USE[key] = EmbeddingNetwork(model, engine)
    return network


def _restored(arguments: tuple[str, str], sha256: str) -> EmbeddingNetwork:
    """The network again, from the same files.

    Raises:
        ParameterError: The files have changed.
    """
    network = EmbeddingNetwork(*arguments)
    if network.sha256 != sha256:
        raise ParameterError(
            f"the files of the network in {arguments[0]} are not those of the copied tracker"
        )
    return network
