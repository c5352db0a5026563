"""What the tracker knows about the target after one frame."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, fields
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from pf_tracker_ros.background import BackgroundState

TrackState = Literal["tracking", "occluded", "lost"]

# Of an estimate's fields.
_ARRAYS = ("covariance", "particles", "particle_boxes", "weights")


class FrozenPowers(Mapping[str, float]):
    """A mapping that cannot be changed; unlike a `mappingproxy`, it can be copied and pickled.

    Args:
        powers: Name to power; copied.
    """

    __slots__ = ("_powers",)

    def __init__(self, powers: Mapping[str, float]) -> None:
        self._powers = dict(powers)

    def __getitem__(self, name: str) -> float:
        return self._powers[name]

    def __iter__(self) -> Iterator[str]:
        return iter(self._powers)

    def __len__(self) -> int:
        return len(self._powers)

    def __repr__(self) -> str:
        return repr(self._powers)


@dataclass(frozen=True, eq=False)
class Estimate:
    """The tracker's answer for one frame, a value: it can be compared, copied and pickled.

    Its arrays are read-only and its powers cannot be changed, in copies too; arrays that can be
    written are copied when one is made. Two estimates are equal if all of their fields are, arrays
    in shape, type and every number. As arrays have no hash, an estimate has none.

    Attributes:
        box: (x, y, width, height) in pixels, (x, y) the top-left corner counted from 0.
        state: "tracking" while the measurements support the box; "occluded" while they do not;
            "lost" when that has lasted too long.
        confidence: 0 (nothing at the box looks like the target) to 1 (exactly the template), as
            `track.confidence_rate` lets it rise.
        covariance: (2, 2), px^2: covariance of the box's center under the weighted particles; after
            a search, of where the target is about that center, given the confidence.
        particles: (N, D) particle states, columns as named by the motion model.
        particle_boxes: (N, 4) the particles as (x, y, width, height) boxes in pixels.
        weights: (N,) normalized weights of the particles, before resampling.
        effective_sample_size: 1 / sum of squared weights, from 1 to N.
        powers: Name of a cue to its power in this frame's likelihood; they sum to 1.
        background: What the background model is worth in this frame; None where there is none.
    """

    box: tuple[float, float, float, float]
    state: TrackState
    confidence: float
    covariance: NDArray[np.float64]
    particles: NDArray[np.float64] = field(repr=False)
    particle_boxes: NDArray[np.float64] = field(repr=False)
    weights: NDArray[np.float64] = field(repr=False)
    effective_sample_size: float
    powers: Mapping[str, float]
    background: BackgroundState | None = None

    def __post_init__(self) -> None:
        for name in _ARRAYS:
            value = getattr(self, name)
            if isinstance(value, np.ndarray) and value.flags.writeable:
                value = value.copy()
                value.setflags(write=False)
                object.__setattr__(self, name, value)
        if not isinstance(self.powers, FrozenPowers):
            object.__setattr__(self, "powers", FrozenPowers(self.powers))

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, Estimate):
            return NotImplemented
        return all(
            _same(getattr(self, field.name), getattr(other, field.name)) for field in fields(self)
        )

    __hash__ = None  # type: ignore[assignment]

    def __reduce__(self) -> tuple[Any, ...]:
        # By way of the constructor, since an array that was copied or unpickled can be written.
        return type(self), tuple(getattr(self, field.name) for field in fields(self))


def estimate_values(estimate: Estimate) -> dict[str, str | float | int]:
    """An estimate's values under the keys that the status uses; covariance in px^2."""
    covariance = estimate.covariance
    background = {"background": str(estimate.background)} if estimate.background else {}
    powers = {f"power_{name}": float(power) for name, power in estimate.powers.items()}
    return (
        background
        | powers
        | {
            "confidence": float(estimate.confidence),
            "covariance_xx": float(covariance[0, 0]),
            "covariance_xy": float(covariance[0, 1]),
            "covariance_yy": float(covariance[1, 1]),
            "effective_sample_size": float(estimate.effective_sample_size),
            "particles": len(estimate.weights),
        }
    )


def _same(one: Any, other: Any) -> bool:
    if not (isinstance(one, np.ndarray) or isinstance(other, np.ndarray)):
        return bool(one == other)
    # Of an array and something else, `==` would be an array.
    same_kind = type(one) is type(other) and one.dtype == other.dtype
    return same_kind and np.array_equal(one, other)
