"""The interface of a cue.

A cue models the likelihood of the image given a box. Most compute a distance d between the box's
descriptor and the template's, and the likelihood exp(-sharpness * d^2).

Source: Li et al. 2007, section 2.2.
"""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, ClassVar, NamedTuple, Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from pf_tracker_ros.boxes import BoxGrid
from pf_tracker_ros.frames import Region
from pf_tracker_ros.parameters import declared
from pf_tracker_ros.registry import Registry


def declared_weight(default: float) -> float:
    """Parameter `weight`, 0 to 1, which every cue has."""
    return declared(
        default,
        "Weight (exponent) of this cue in the fused likelihood; 0 switches it off. The weights of "
        "all cues are scaled to a sum of 1.",
        minimum=0.0,
        maximum=1.0,
    )


@dataclass(frozen=True)
class CueParameters:
    """Parameters of every cue; a cue's own parameters derive from this class."""

    weight: float = declared_weight(0.5)


def declared_keep(default: float, symbol: str = "") -> float:
    """Parameter `keep`, 0 to 1, of cues whose template is an exponential moving average.

    The symbol is the paper's, empty without one.
    """
    named = f" ({symbol})" if symbol else ""
    return declared(
        default,
        f"Share of the old template that an update keeps{named}.",
        minimum=0.0,
        maximum=1.0,
    )


class Match(NamedTuple):
    """How well the observation of one box matches a template.

    Attributes:
        log_likelihood: log p(Z | X), as `Cue.log_likelihood` of that box.
        similarity: 0 (nothing in common) to 1 (equal), independent of the cue's sharpness.
    """

    log_likelihood: float
    similarity: float


class PredictedTarget(NamedTuple):
    """A target before its measurement: the region around its predicted box, and its template."""

    region: Region
    template: Any


class Cue(Protocol):
    """Compares boxes with a template of the target.

    A cue is stateless. Templates are immutable values, stored in the target's state.

    Attributes:
        uses_center_box_size: Whether it reads every box in the size of `Region.center_box`.
        is_discriminative: Whether its similarity distinguishes the target from other objects.
        needs_foreground: Whether it reads `Frame.foreground`.
        joins_search: Whether its likelihood is added in a search by searchable cues. It is cheap
            for many boxes, but does not find the target alone.
    """

    uses_center_box_size: ClassVar[bool] = False
    is_discriminative: ClassVar[bool] = True
    needs_foreground: ClassVar[bool] = False
    joins_search: ClassVar[bool] = False

    @property
    def context_margin(self) -> float:
        """Margin around a box that the cue reads, in box sides."""
        return 0.0

    @abstractmethod
    def learn(self, region: Region, box: NDArray[np.float64]) -> Any:
        """Template of the image in a (4,) box (x, y, width, height), pixels."""

    def observe(self, region: Region, box: NDArray[np.float64]) -> Any:
        """Observation of a (4,) box, for `match`, `log_odds` and `blend`; valid in this frame.

        By default a template. A cue can defer work that not every frame needs.
        """
        return self.learn(region, box)

    def template_from(self, observation: Any) -> Any:
        """Template of an observation, for a cue without one."""
        return observation

    def precompute(self, predicted_targets: Sequence[PredictedTarget]) -> None:
        """Compute maps of several targets' regions at once and store them there.

        This only saves time, and results do not depend on it.
        """
        return

    @abstractmethod
    def log_likelihood(
        self, region: Region, boxes: NDArray[np.float64], template: Any
    ) -> NDArray[np.float64]:
        """(N,) log p(Z | X) <= 0 of (N, 4) boxes of any size; 0 is a perfect match."""

    def log_likelihood_on_grid(
        self, region: Region, grid: BoxGrid, template: Any
    ) -> NDArray[np.float64]:
        """(M,) log likelihoods of the boxes of a grid, for a cue that joins a search."""
        return self.log_likelihood(region, grid.boxes, template)

    @abstractmethod
    def match(self, observation: Any, template: Any) -> Match | None:
        """Match of an observation with a template; None if the cue cannot decide."""

    def log_odds(self, observation: Any, template: Any) -> dict[str, float]:
        """Log odds that the observed box is the target, as independent terms.

        Returns:
            Name of each term to its log odds, > 0 for the target; empty if the cue cannot decide.
        """
        return {}

    @abstractmethod
    def blend(self, template: Any, observation: Any) -> Any:
        """The template, updated by an observation at the rate of the cue's parameters."""


# Each cue registers itself.
CUES = Registry[Cue]("cue", CueParameters, group="pf_tracker_ros.cues")


@runtime_checkable
class SearchableCue(Cue, Protocol):
    """A cue that is cheap for many boxes, so that it can search for the target.

    It computes a response, from which its log likelihood follows.
    """

    @abstractmethod
    def response(
        self, region: Region, boxes: NDArray[np.float64], template: Any
    ) -> NDArray[np.float64]:
        """(N,) responses, at most 1, at (N, 4) boxes."""

    def response_on_grid(self, region: Region, grid: BoxGrid, template: Any) -> NDArray[np.float64]:
        """(M,) responses at the boxes of a grid; a cue can override it to save time."""
        return self.response(region, grid.boxes, template)

    def log_growth(self, region: Region, box: NDArray[np.float64], template: Any) -> float:
        """Logarithm of the target's size over the predicted one; 0 where nothing tells.

        Args:
            region: Of the frame.
            box: (4,) of the target, pixels.
            template: Of the target.
        """
        return 0.0

    @abstractmethod
    def log_likelihood_of(
        self, response: NDArray[np.float64], template: Any
    ) -> NDArray[np.float64]:
        """(N,) log p(Z | X) <= 0 of (N,) responses."""

    def log_likelihood(
        self, region: Region, boxes: NDArray[np.float64], template: Any
    ) -> NDArray[np.float64]:
        """See `Cue.log_likelihood`."""
        return self.log_likelihood_of(self.response(region, boxes, template), template)
