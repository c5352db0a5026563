"""An embedding network: vectors of boxes, close to each other for boxes of one target.

1. A crop of each box is read in the network's size.
2. The network converts it to a vector, or to a map of features. A map is averaged over parts of the
   box: from top to bottom, clothes differ along a body in every pose.
3. Vectors have length 1; their distance is 1 minus the cosine between them.

Sources: Wojke, Bewley 2018, "Deep cosine metric learning for person re-identification"; Sun et al.
2018, "Beyond part models: person retrieval with refined part pooling" (parts).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from pf_tracker_ros.frames import Frame
from pf_tracker_ros.networks.crops import Crop, mean_color, normalized, read_crop
from pf_tracker_ros.networks.described import DescribedNetwork
from pf_tracker_ros.parameters import ParameterError

# Least length of a vector that is scaled to length 1.
_LEAST_LENGTH = 1e-9


class EmbeddingNetwork(DescribedNetwork):
    """An embedding network with its description; see `DescribedNetwork`."""

    parameter = "appearance.embedding.model"

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
        (values,) = self._run(rules.file, inputs, [rules.output])
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

    def _files(self) -> dict[str, str]:
        """See `DescribedNetwork._files`."""
        embedding = self.description.embedding
        if not embedding.file:
            raise ParameterError(
                f"the network {self.description.name} has no 'embedding.file' in its description, "
                "so it does not tell targets apart; allowed: a network with an embedding"
            )
        return {embedding.file: embedding.sha256}

    def _check(self) -> None:
        """See `DescribedNetwork._check`."""
        frame = Frame(np.full((64, 64), 128, np.uint8))
        if not self.embed(frame, np.array([[16.0, 16.0, 32.0, 32.0]])).any():
            raise ParameterError(
                f"the network {self.description.name} gives no finite vector but 0; check mean and "
                "deviation in its description, or export it again"
            )
