"""Embedding: vectors of a network that the user supplies; see `networks.embedding`."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pf_tracker_ros.appearances.appearance import APPEARANCES, Appearance, Descriptor
from pf_tracker_ros.frames import Frame
from pf_tracker_ros.parameters import declared


@dataclass(frozen=True)
class EmbeddingParameters:
    """The embedding network."""

    model: str = declared(
        "",
        "Folder of the network, or the path of its description; see docs/identities.md.",
        read_only=True,
    )


@APPEARANCES.register("embedding", EmbeddingParameters)
class Embedding(Appearance):
    """Vectors of an embedding network; the distance is 1 minus the cosine, times a scale.

    Raises:
        ParameterError: The network cannot be used; the message says why.
    """

    def __init__(self, parameters: EmbeddingParameters) -> None:
        # Imported here: nothing but this appearance needs it.
        from pf_tracker_ros.networks.embedding import open_network

        self._network = open_network(parameters.model)

    def extract(self, frame: Frame, boxes: NDArray[np.float64]) -> NDArray[np.float32]:
        """See `Appearance.extract`."""
        return self._network.embed(frame, boxes)

    def distance(self, descriptor: Descriptor, others: NDArray[np.float32]) -> NDArray[np.float64]:
        """See `Appearance.distance`."""
        distances = 1.0 - (others @ descriptor).astype(np.float64)
        scale = self._network.description.embedding.distance_scale
        return np.clip(scale * distances, 0.0, 1.0)

    def blend(self, descriptor: Descriptor, other: Descriptor, share: float) -> Descriptor:
        """See `Appearance.blend`."""
        mean = (1.0 - share) * descriptor + share * other
        length = float(np.linalg.norm(mean))
        return (mean / length if length > 0.0 else descriptor).astype(np.float32)
