"""The interface of features, and the calibration of a filter trained on them.

The responses of a correlation filter are not probabilities. A `Calibration`, fitted to footage with
ground truth, converts them to a similarity (logistic in the logarithm of two ratios) and to log
odds (linear in the logarithm of one).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from pf_tracker_ros.registry import Registry


@dataclass(frozen=True)
class Calibration:
    """Conversion of a filter's responses to similarity and log odds of the target.

    `benchmarks/uncertainty.py` measures what they are worth. A level is a response / the response
    to the last training window.

    Attributes:
        even_clutter: Standard deviation of the response map / its peak, at similarity 1/2.
        even_level: Level of the peak at similarity 1/2.
        exponent: Slope of the similarity with both.
        odds_slope: Slope of the log odds with the logarithm of the peak-to-sidelobe ratio at the
            box.
        even_peak_to_sidelobe: That ratio at log odds 0.
    """

    even_clutter: float
    even_level: float
    exponent: float
    odds_slope: float
    even_peak_to_sidelobe: float

    def similarity(self, peak: float, deviation: float, reference: float) -> float:
        """Similarity of a response map to one of the target, 0 to 1.

        Args:
            peak: The largest response, > 0.
            deviation: Standard deviation of the map, > 0.
            reference: Response to the last training window, > 0.
        """
        peak_score = self._score(self.even_clutter * peak / deviation)
        return peak_score * self._score(peak / reference / self.even_level)

    def log_odds(self, peak_to_sidelobe_ratio: float) -> dict[str, float]:
        """Log odds of the response at a box, see `Cue.log_odds`.

        Args:
            peak_to_sidelobe_ratio: Ratio at the box, > 0.
        """
        ratio = peak_to_sidelobe_ratio / self.even_peak_to_sidelobe
        return {"response": self.odds_slope * math.log(ratio)}

    def _score(self, ratio: float) -> float:
        """Logistic function of the ratio's logarithm: 0 to 1, 1/2 at a ratio of 1."""
        return ratio**self.exponent / (1.0 + ratio**self.exponent)


class Features(Protocol):
    """Converts image windows to channels, one value per cell.

    Attributes:
        cell_size: Pixels along each side of a cell.
        calibration: Calibration of a filter trained on these channels.
    """

    @property
    def cell_size(self) -> int: ...  # noqa: D102

    @property
    def calibration(self) -> Calibration: ...  # noqa: D102

    def extract(self, windows: NDArray[np.uint8]) -> NDArray[np.float32]:
        """The channels of windows, each computed independently.

        Args:
            windows: (K, P, P, 3) BGR or (K, P, P) gray, P a multiple of `cell_size`.

        Returns:
            (K, channels, P / cell_size, P / cell_size). The number of channels may differ only
            between colored and gray windows.
        """


FEATURES = Registry[Features]("kind of features", group="pf_tracker_ros.features")
