"""What every cue can do; and sums over boxes, read from an integral image at their corners."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, ClassVar, NamedTuple, Protocol, TypeVar, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from pf_tracker_ros.boxes import BoxGrid
from pf_tracker_ros.frames import Region
from pf_tracker_ros.parameters import declared
from pf_tracker_ros.registry import Registry

Value = TypeVar("Value", np.int32, np.float64)


def box_sums(
    integral: NDArray[Value], columns: NDArray[np.intp], rows: NDArray[np.intp]
) -> NDArray[Value]:
    """(..., N) sums over boxes.

    Args:
        integral: (h + 1, w + 1), the sum over all pixels above and left of each place.
        columns: (..., 2, N) where each box starts and where it ends, 0 to w.
        rows: (..., 2, N) the same down, 0 to h.
    """
    starts = rows * integral.shape[1]
    corners = integral.ravel().take(starts[..., :, None, :] + columns[..., None, :, :])
    across = corners[..., 1, :] - corners[..., 0, :]
    added: NDArray[Value] = across[..., 1, :] - across[..., 0, :]
    return added


def box_sums_on_grid(
    integral: NDArray[Value], columns: NDArray[np.intp], rows: NDArray[np.intp]
) -> NDArray[Value]:
    """(R, C) sums over boxes in rows and columns.

    Args:
        integral: As for `box_sums`.
        columns: (2, C) where the boxes of each column start and where they end.
        rows: (2, R) the same of each row.
    """
    down = integral.take(rows[1], axis=0)
    down -= integral.take(rows[0], axis=0)
    return down.take(columns[1], axis=1) - down.take(columns[0], axis=1)


def declared_weight(default: float) -> float:
    """The parameter that every cue has.

    Args:
        default: 0 to 1.
    """
    weight: float = declared(
        default,
        "Power of this cue in the fused likelihood beside other cues; 0 switches it off. The "
        "powers of all cues are scaled to a sum of 1.",
        minimum=0.0,
        maximum=1.0,
    )
    return weight


@dataclass(frozen=True)
class CueParameters:
    """What every cue has; those of a cue are derived from it."""

    weight: float = declared_weight(0.5)


def declared_keep(default: float, symbol: str = "") -> float:
    """The parameter of cues whose template is a mean: how slowly it follows the target.

    Args:
        default: 0 to 1.
        symbol: The paper's symbol for it, empty where it has none.
    """
    named = f" ({symbol})" if symbol else ""
    keep: float = declared(
        default,
        f"Share of the old template that an update keeps{named}.",
        minimum=0.0,
        maximum=1.0,
    )
    return keep


class Match(NamedTuple):
    """How well one box fits a template.

    Attributes:
        log_likelihood: log p(Z | X), as `Cue.log_likelihood` gives it for that box.
        similarity: 0 (nothing in common) to 1 (the same), whatever the cue's sharpness.
    """

    log_likelihood: float
    similarity: float


class PredictedTarget(NamedTuple):
    """A target in a frame that it has not been looked for in.

    Attributes:
        region: Of the frame, where it is expected.
        template: As it looked last.
        first: As it looked in the beginning.
    """

    region: Region
    template: Any
    first: Any


class Cue(Protocol):
    """Compares boxes with a template of the target.

    A cue is stateless: it is configured once, and the templates that it learns are values that the
    target owns. To freeze a template is not to replace it.

    Attributes:
        uses_center_box_size: Whether it looks at every box in the size of `Region.center_box`.
        is_discriminative: Whether its similarity tells the target from other things, and not only from
            nothing.
        needs_foreground: Whether it reads `Frame.foreground`.
        joins_search: Whether it has a say in a search that searchable cues lead: many boxes cost it
            little, but it does not know the target.
    """

    uses_center_box_size: ClassVar[bool] = False
    is_discriminative: ClassVar[bool] = True
    needs_foreground: ClassVar[bool] = False
    joins_search: ClassVar[bool] = False

    @property
    def context_margin(self) -> float:
        """How far beyond each side of a box the cue reads the region, in box sides."""
        return 0.0

    @abstractmethod
    def learn(self, region: Region, box: NDArray[np.float64]) -> Any:
        """The template of what is in a (4,) box (x, y, width, height), pixels."""

    def observe(self, region: Region, box: NDArray[np.float64]) -> Any:
        """What is in a (4,) box of the frame at hand, for `match` and `blend`.

        The template that `learn` gives, unless a cue can put off work that not every frame needs;
        what it gives then is of use in this frame only.
        """
        return self.learn(region, box)

    def template_from(self, seen: Any) -> Any:
        """The template of what was observed, for a cue that has none yet."""
        return seen

    def precompute(self, predicted_targets: Sequence[PredictedTarget]) -> None:
        """Compute at once what several targets will ask of their regions, and leave it there.

        For a cue to which that costs less than one target after another; no answer depends on it.
        """
        return

    @abstractmethod
    def log_likelihood(
        self, region: Region, boxes: NDArray[np.float64], template: Any
    ) -> NDArray[np.float64]:
        """(N,) log p(Z | X), at most 0, of (N, 4) boxes of any size; 0 is a perfect match."""

    def log_likelihood_on_grid(
        self, region: Region, grid: BoxGrid, template: Any
    ) -> NDArray[np.float64]:
        """(M,) the same of the boxes of a grid; for a cue that joins a search."""
        return self.log_likelihood(region, grid.boxes, template)

    @abstractmethod
    def match(self, seen: Any, template: Any) -> Match | None:
        """How well the one box that was observed fits; None if the cue cannot tell."""

    def log_odds(self, seen: Any, template: Any, first: Any) -> dict[str, float]:
        """How much what was observed speaks for the target: log odds, which all add up.

        Args:
            seen: Of the one box.
            template: As the target looked last.
            first: As it looked in the beginning; it never changes, so what was learned by mistake
                since then does not make it like anything else.

        Returns:
            Question that was asked to what its answer says, above 0 for the target and below for
            something else; empty if the cue cannot tell.
        """
        return {}

    @abstractmethod
    def blend(self, template: Any, seen: Any) -> Any:
        """The template moved towards what was observed, as far as the cue's parameters say."""


# Each cue registers itself.
CUES = Registry[Cue]("cue", CueParameters, group="pf_tracker_ros.cues")


@runtime_checkable
class SearchableCue(Cue, Protocol):
    """A cue that many boxes cost next to nothing, so that it can look for the target.

    It measures one number, from which its log likelihood follows.
    """

    @abstractmethod
    def response(
        self, region: Region, boxes: NDArray[np.float64], template: Any
    ) -> NDArray[np.float64]:
        """(N,) how much of the target there is at (N, 4) boxes, at most 1."""

    def response_on_grid(self, region: Region, grid: BoxGrid, template: Any) -> NDArray[np.float64]:
        """(M,) the same of the boxes of a grid; for a cue that does rows and columns at once."""
        return self.response(region, grid.boxes, template)

    @abstractmethod
    def log_likelihood_of(
        self, strength: NDArray[np.float64], template: Any
    ) -> NDArray[np.float64]:
        """(N,) log p(Z | X), at most 0, of (N,) strengths."""

    def log_likelihood(
        self, region: Region, boxes: NDArray[np.float64], template: Any
    ) -> NDArray[np.float64]:
        """See `Cue.log_likelihood`."""
        return self.log_likelihood_of(self.response(region, boxes, template), template)
