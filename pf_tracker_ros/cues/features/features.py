"""What every kind of features can do."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from pf_tracker_ros.registry import Registry


@dataclass(frozen=True)
class Calibration:
    """What the responses of a filter of some features say of the target.

    It is fitted to footage with ground truth, see `benchmarks/uncertainty.py`. A response stands
    out by so many standard deviations of the response map.

    Attributes:
        even_clutter: Standard deviation of the response map, as a share of its peak, at which the
            target is as likely there as not.
        even_level: The same for the peak, as a share of the response to what was learned from last.
        exponent: How fast the similarity changes with both.
        odds_slope: How fast the log odds that it is the target grow with the logarithm of how far
            the box stands out for the filter as it is.
        even_peak_to_sidelobe: How far it stands out where these are 0.
        first_odds_slope: As `odds_slope`, for the filter of the first frame.
        even_first_peak_to_sidelobe: As `even_peak_to_sidelobe`, for the filter of the first frame.
        level_odds_slope: How fast the log odds fall with the logarithm of the response at the box, below
            the least level: what has the target's colors is not it where the filter hardly answers.
        least_level: Share of the response to what was learned from last that the target hardly
            ever falls below.
    """

    even_clutter: float
    even_level: float
    exponent: float
    odds_slope: float
    even_peak_to_sidelobe: float
    first_odds_slope: float
    even_first_peak_to_sidelobe: float
    level_odds_slope: float
    least_level: float

    def similarity(self, peak: float, deviation: float, reference: float) -> float:
        """How much a response map looks like one of the target, 0 to 1.

        Args:
            peak: The largest response, above 0.
            deviation: Standard deviation of the map, above 0.
            reference: Response to what was learned from last, above 0.
        """
        peak_to_sidelobe_ratio = self._share(self.even_clutter * peak / deviation)
        return peak_to_sidelobe_ratio * self._share(peak / reference / self.even_level)

    def log_odds(
        self, peak_to_sidelobe_ratio: float, first_peak_to_sidelobe_ratio: float, level: float
    ) -> dict[str, float]:
        """What the responses at a box say, see `Cue.log_odds`.

        Args:
            peak_to_sidelobe_ratio: How far the box stands out for the filter as it is, above 0.
            first_peak_to_sidelobe_ratio: The same for the filter of the first frame.
            level: Response at the box, as a share of that to what was learned from last, above 0.
        """
        first_growth, even_first = self.first_odds_slope, self.even_first_peak_to_sidelobe
        return {
            "response": self.odds_slope
            * math.log(peak_to_sidelobe_ratio / self.even_peak_to_sidelobe),
            "first response": first_growth * math.log(first_peak_to_sidelobe_ratio / even_first),
            "level": self.level_odds_slope * min(math.log(level / self.least_level), 0.0),
        }

    def _share(self, ratio: float) -> float:
        """From 0 to 1, a half at a ratio of 1."""
        return ratio**self.exponent / (1.0 + ratio**self.exponent)


class Features(Protocol):
    """Turns windows of the image into channels, one value for each cell of them.

    Attributes:
        cell_size: Pixels along each side of a cell.
        calibration: What the responses of a filter of these channels say.
    """

    @property
    def cell_size(self) -> int: ...  # noqa: D102

    @property
    def calibration(self) -> Calibration: ...  # noqa: D102

    def extract(self, windows: NDArray[np.uint8]) -> NDArray[np.float32]:
        """The channels of windows, each as if there were no other.

        Args:
            windows: (K, P, P, 3) BGR or (K, P, P) gray, P a multiple of `cell_size`.

        Returns:
            (K, channels, P / stride, P / stride). The number of channels may differ between colored
            and gray windows, and in nothing else.
        """


FEATURES = Registry[Features]("kind of features", group="pf_tracker_ros.features")
