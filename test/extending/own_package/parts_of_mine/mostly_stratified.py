"""A resampling scheme: most particles are drawn in equal strata, the others independently."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pf_tracker_ros.filter import RESAMPLERS
from pf_tracker_ros.parameters import declared


# The full name is `resampling.mostly_stratified.share`.
@dataclass(frozen=True)
class MostlyStratifiedParameters:
    """A mixture of two schemes."""

    share: float = declared(0.8, "Share drawn in strata.", minimum=0.0, maximum=1.0)


@RESAMPLERS.register("mostly_stratified", MostlyStratifiedParameters)
class MostlyStratified:
    """Draws a share of the particles in strata, the others independently.

    Args:
        parameters: The share.
    """

    def __init__(self, parameters: MostlyStratifiedParameters) -> None:
        self._share = parameters.share
        self._stratified, self._multinomial = (
            RESAMPLERS[name]() for name in ("stratified", "multinomial")
        )

    def indices(
        self, weights: NDArray[np.float64], count: int, generator: np.random.Generator
    ) -> NDArray[np.intp]:
        """See `Resampler.indices`."""
        first = round(self._share * count)
        return np.concatenate(
            [
                self._stratified.indices(weights, first, generator),
                self._multinomial.indices(weights, count - first, generator),
            ]
        )
