"""The estimate of a target after a frame, and the track states over time.

1. A target is "tracking" while its confidence is at least `TrackThresholds.tracked_above`.
2. Below, it is "occluded".
3. Occluded for `lost_after`, it is "lost".
4. A frame that is similar enough restarts the time, and makes a lost target occluded.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, fields
from types import MappingProxyType
from typing import Any, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from pf_tracker_ros.background import BackgroundState
from pf_tracker_ros.parameters import declared

TrackState = Literal["tracking", "occluded", "lost"]

# Fields of an estimate that are arrays.
_ARRAYS = ("box_covariance", "particles", "particle_boxes", "weights")


class FrozenCueWeights(Mapping[str, float]):
    """A read-only mapping that, unlike a `mappingproxy`, can be copied and pickled."""

    __slots__ = ("_cue_weights",)

    def __init__(self, cue_weights: Mapping[str, float]) -> None:
        self._cue_weights = dict(cue_weights)

    def __getitem__(self, name: str) -> float:
        return self._cue_weights[name]

    def __iter__(self) -> Iterator[str]:
        return iter(self._cue_weights)

    def __len__(self) -> int:
        return len(self._cue_weights)

    def __repr__(self) -> str:
        return repr(self._cue_weights)


@dataclass(frozen=True, eq=False)
class Estimate:
    """A target in one frame, as an immutable value that can be compared, copied and pickled.

    Arrays and cue weights are read-only, in copies too; the constructor copies writable arrays.
    Estimates are equal if all of their fields are, arrays in shape, type and every number. An
    estimate has no hash, as arrays have none.

    Attributes:
        box: (x, y, width, height) in pixels, (x, y) the top-left corner counted from 0.
        state: "tracking" while the measurements support the box; "occluded" while they do not;
            "lost" when that has lasted too long.
        confidence: With a search, as of "default", the probability that the box is on the target,
            0 to 1; it falls at once and rises over several frames. Else the similarity to the
            templates. Calibrated by `track.confidence_calibration`.
        box_covariance: (4, 4) covariance of center x, center y, width and height, px^2, always with
            an inverse: of the weighted particles; after a search, of the errors to expect given
            that the box is on the target (`box_covariance.py`). Errors of neighboring frames
            correlate.
        particles: (N, D) particle states, columns as named by the motion model.
        particle_boxes: (N, 4) boxes (x, y, width, height) of the particles, pixels.
        weights: (N,) normalized weights of the particles, before resampling.
        effective_sample_size: 1 / sum of squared weights, from 1 to N.
        cue_weights: Name of a cue to its weight in this frame's likelihood; they sum to 1.
        background: State of the background model in this frame; None without one.
        reacquired_for: Seconds since the target was found again after an occlusion or loss; None
            while it is not tracked, and if it has never been out of sight.

    Example:
        Standard deviations of the center, and of the lower edge, y + height / 2, in pixels:

        >>> import numpy as np
        >>> from pf_tracker_ros import Tracker
        >>> image = np.random.default_rng(1).integers(0, 256, (120, 160), np.uint8)
        >>> tracker = Tracker.from_preset("default", seed=0)
        >>> estimate = tracker.start(image, (60, 40, 40, 30))
        >>> estimate.box, estimate.state, estimate.confidence
        ((60.0, 40.0, 40.0, 30.0), 'tracking', 1.0)
        >>> estimate = tracker.update(image)
        >>> center = np.sqrt(estimate.covariance.diagonal())
        >>> lower_edge = np.array([0.0, 1.0, 0.0, 0.5])
        >>> edge = np.sqrt(lower_edge @ estimate.box_covariance @ lower_edge)
        >>> center.shape, bool(edge > 0)
        ((2,), True)
    """

    box: tuple[float, float, float, float]
    state: TrackState
    confidence: float
    box_covariance: NDArray[np.float64]
    particles: NDArray[np.float64] = field(repr=False)
    particle_boxes: NDArray[np.float64] = field(repr=False)
    weights: NDArray[np.float64] = field(repr=False)
    effective_sample_size: float
    cue_weights: Mapping[str, float]
    background: BackgroundState | None = None
    reacquired_for: float | None = None

    def __post_init__(self) -> None:
        for name in _ARRAYS:
            value = getattr(self, name)
            if isinstance(value, np.ndarray) and value.flags.writeable:
                value = value.copy()
                value.setflags(write=False)
                object.__setattr__(self, name, value)
        if not isinstance(self.cue_weights, FrozenCueWeights):
            object.__setattr__(self, "cue_weights", FrozenCueWeights(self.cue_weights))

    @property
    def covariance(self) -> NDArray[np.float64]:
        """(2, 2) covariance of the center, px^2."""
        return self.box_covariance[:2, :2]

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, Estimate):
            return NotImplemented
        return all(
            _same(getattr(self, field.name), getattr(other, field.name)) for field in fields(self)
        )

    __hash__ = None  # type: ignore[assignment]

    def __reduce__(self) -> tuple[Any, ...]:
        # The constructor makes arrays read-only again; copying and pickling make them writable.
        return type(self), tuple(getattr(self, field.name) for field in fields(self))


def estimate_values(estimate: Estimate) -> dict[str, str | float | int]:
    """Status keys and values of an estimate; box in pixels, covariance in px^2."""
    covariance = estimate.box_covariance
    x, y, width, height = (float(value) for value in estimate.box)
    background = {"background": str(estimate.background)} if estimate.background else {}
    cue_weights = {
        f"cue_weight_{name}": float(weight) for name, weight in estimate.cue_weights.items()
    }
    found_again = estimate.reacquired_for
    return (
        background
        | ({} if found_again is None else {"reacquired_for": float(found_again)})
        | cue_weights
        | {"box_x": x, "box_y": y, "box_width": width, "box_height": height}
        | {
            "confidence": float(estimate.confidence),
            "covariance_xx": float(covariance[0, 0]),
            "covariance_xy": float(covariance[0, 1]),
            "covariance_yy": float(covariance[1, 1]),
            "covariance_yh": float(covariance[1, 3]),
            "covariance_ww": float(covariance[2, 2]),
            "covariance_wh": float(covariance[2, 3]),
            "covariance_hh": float(covariance[3, 3]),
            "effective_sample_size": float(estimate.effective_sample_size),
            "particles": len(estimate.weights),
        }
    )


def _same(one: Any, other: Any) -> bool:
    if not (isinstance(one, np.ndarray) or isinstance(other, np.ndarray)):
        return bool(one == other)
    # `==` of an array and something else would be an array.
    same_kind = type(one) is type(other) and one.dtype == other.dtype
    return same_kind and np.array_equal(one, other)


SEVERITIES: Mapping[str, int] = MappingProxyType(
    {"idle": 0, "tracking": 0, "occluded": 1, "lost": 2}
)
"""Track state to level of diagnostic_msgs/DiagnosticStatus: 0 is OK, 1 WARN, 2 ERROR."""

DESCRIPTIONS: Mapping[str, str] = MappingProxyType(
    {
        "idle": "waiting for a target",
        "tracking": "tracking",
        "occluded": "hidden, or not certain yet: just found again, or a similar object is near",
        "lost": "the target is lost",
    }
)
"""Track state to a sentence for the user."""

# Seconds out of sight after which more count no more: the search sees the same places again.
_LONGEST_HIDDEN = 5.0


@dataclass(frozen=True)
class TrackThresholds:
    """Thresholds between the track states.

    For a probability p of the target and a cost c of a wrong box, a box costs (1 - p) c on average
    and no box costs p, so a box is the better choice from p = c / (1 + c) on.
    """

    wrong_box_cost: float = declared(
        0.82,
        "Cost c of a wrong box, relative to that of none. A target is tracked while its confidence "
        "is at least c / (1 + c), and otherwise occluded or lost; 0 asks for no confidence.",
        minimum=0.0,
        maximum=1e6,
    )
    lost_after: float = declared(
        2.0,
        "The target counts as lost after it has been occluded for this time. With "
        "'proposal.method' search, a frame that matches the current templates restarts it.",
        unit="s",
        minimum=0.0,
        maximum=3600.0,
    )

    @property
    def tracked_above(self) -> float:
        """Least confidence of a tracked target, 0 to 1."""
        return self.wrong_box_cost / (1.0 + self.wrong_box_cost)


class TrackStatus(NamedTuple):
    """Track state and its timers.

    Attributes:
        state: As in `Estimate.state`.
        time_since_seen: Seconds since the target was last seen, 0 while tracking.
        hidden_for: Seconds for which it has not been tracked, at most 5, whatever was similar in
            them; those for which it has been since are subtracted.
        reacquired_for: See `Estimate.reacquired_for`.
    """

    state: TrackState = "tracking"
    time_since_seen: float = 0.0
    hidden_for: float = 0.0
    reacquired_for: float | None = None

    def advance(
        self,
        confidence: float,
        similarity: float,
        interval: float,
        thresholds: TrackThresholds,
    ) -> TrackStatus:
        """The status one frame later, by the confidence after that frame.

        The similarity is that of the frame alone, 0 to 1. A high one restarts `time_since_seen`,
        even before the smoothed confidence has risen.
        """
        needed = thresholds.tracked_above
        if confidence >= needed and self.state != "tracking":
            return self.as_found()
        if confidence >= needed:
            tracked = None if self.reacquired_for is None else self.reacquired_for + interval
            return TrackStatus(
                hidden_for=max(self.hidden_for - interval, 0.0),
                reacquired_for=tracked,
            )
        hidden_for = min(self.hidden_for + interval, _LONGEST_HIDDEN)
        if similarity >= needed:
            return TrackStatus("occluded", interval, hidden_for)
        time_since_seen = interval + self.time_since_seen
        is_lost = self.state == "lost" or time_since_seen >= thresholds.lost_after
        state: TrackState = "lost" if is_lost else "occluded"
        return TrackStatus(state, time_since_seen, hidden_for)

    def as_found(self) -> TrackStatus:
        """The status in the frame in which a target is tracked again."""
        return TrackStatus(hidden_for=self.hidden_for, reacquired_for=0.0)
