"""What the tracker knows about the target after one frame, and its state over time."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, fields
from types import MappingProxyType
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from pf_tracker_ros.background import BackgroundState
from pf_tracker_ros.parameters import declared

TrackState = Literal["tracking", "occluded", "lost"]

# Of an estimate's fields.
_ARRAYS = ("covariance", "particles", "particle_boxes", "weights")


class FrozenCueWeights(Mapping[str, float]):
    """A mapping that cannot be changed; unlike a `mappingproxy`, it can be copied and pickled.

    Args:
        cue_weights: Name to weight; copied.
    """

    __slots__ = ("_powers",)

    def __init__(self, cue_weights: Mapping[str, float]) -> None:
        self._powers = dict(cue_weights)

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
        cue_weights: Name of a cue to its weight in this frame's likelihood; they sum to 1.
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
    cue_weights: Mapping[str, float]
    background: BackgroundState | None = None

    def __post_init__(self) -> None:
        for name in _ARRAYS:
            value = getattr(self, name)
            if isinstance(value, np.ndarray) and value.flags.writeable:
                value = value.copy()
                value.setflags(write=False)
                object.__setattr__(self, name, value)
        if not isinstance(self.cue_weights, FrozenCueWeights):
            object.__setattr__(self, "cue_weights", FrozenCueWeights(self.cue_weights))

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
    cue_weights = {
        f"cue_weight_{name}": float(weight) for name, weight in estimate.cue_weights.items()
    }
    return (
        background
        | cue_weights
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


SEVERITIES: Mapping[str, int] = MappingProxyType(
    {"idle": 0, "tracking": 0, "occluded": 1, "lost": 2}
)
"""State to level of diagnostic_msgs/DiagnosticStatus: 0 is OK, 1 WARN, 2 ERROR."""

DESCRIPTIONS: Mapping[str, str] = MappingProxyType(
    {
        "idle": "waiting for a target",
        "tracking": "tracking",
        "occluded": "the target is hidden; its place is a guess",
        "lost": "the target is lost",
    }
)
"""State to words."""


# Seconds for which a target that was lost and is seen again may still turn out to be another.
_PROBATION = 2.0


@dataclass(frozen=True)
class TrackThresholds:
    """When the target counts as hidden, seen again, or gone."""

    occluded_below: float = declared(
        0.45,
        "The target counts as occluded while the confidence is below this; 0 switches it off.",
        minimum=0.0,
        maximum=1.0,
    )
    recovered_above: float = declared(
        0.5,
        "An occluded or lost target is seen again when the confidence reaches this, and also "
        "'occluded_below', or when the search finds an occluded one elsewhere.",
        minimum=0.0,
        maximum=1.0,
    )
    lost_after: float = declared(
        2.0,
        "The target counts as lost after it has been occluded for so long.",
        unit="s",
        minimum=0.0,
        maximum=3600.0,
    )


@dataclass(frozen=True)
class TrackStatus:
    """The state of a track and for how long the target has been out of sight.

    Attributes:
        state: As in `Estimate.state`.
        time_since_seen: Seconds since the target was last seen, 0 while tracking.
        probation: Seconds, counted from when it is tracked again, for which it may yet turn out
            that something else was found instead of the target that was lost; nothing is learned of
            it in them.
    """

    state: TrackState = "tracking"
    time_since_seen: float = 0.0
    probation: float = 0.0

    @property
    def is_settled(self) -> bool:
        """Whether the target is seen, and was not lost a short time ago."""
        return self.state == "tracking" and self.probation == 0.0

    def as_lost(self, thresholds: TrackThresholds) -> TrackStatus:
        """The track if what is followed was something else all the time."""
        return TrackStatus("lost", thresholds.lost_after)

    def advance(
        self, confidence: float, similarity: float, interval: float, thresholds: TrackThresholds
    ) -> TrackStatus:
        """The track one frame later.

        Args:
            confidence: After that frame, 0 to 1.
            similarity: What that frame alone says, 0 to 1; a glimpse starts the clock again, even
                before the confidence has risen.
            interval: Seconds since the last frame.
            thresholds: When it counts as hidden, seen again, or gone.
        """
        needed = thresholds.occluded_below
        if self.state != "tracking":
            needed = max(needed, thresholds.recovered_above)
        was_lost = self.state == "lost" or self.probation > 0.0
        if confidence >= needed:
            if self.state == "tracking":
                return TrackStatus(probation=max(self.probation - interval, 0.0))
            return TrackStatus(probation=_PROBATION if was_lost else 0.0)
        is_glimpsed = similarity >= needed
        time_since_seen = interval + (0.0 if is_glimpsed else self.time_since_seen)
        if is_glimpsed:
            return TrackStatus("occluded", time_since_seen, _PROBATION if was_lost else 0.0)
        # What is not confirmed is as lost as it was before.
        gone = was_lost or time_since_seen >= thresholds.lost_after
        return TrackStatus("lost" if gone else "occluded", time_since_seen)
