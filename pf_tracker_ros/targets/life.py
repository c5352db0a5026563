"""A target and its life: where it came from, what speaks for it, what it has been called."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pf_tracker_ros.targets.appearance import Look
from pf_tracker_ros.tracking.target import Target


class Key(NamedTuple):
    """Names a target for good, even where what happened since is worked out again.

    Attributes:
        frame: Number of the frame that it began in.
        place: Among those that began there: from 0 up by a detection, from -1 down by hand.
    """

    frame: int
    place: int


@dataclass(frozen=True, eq=False)
class Life:
    """A target, and what is known of it beside its place and its templates; a value.

    Attributes:
        key: Its name for good.
        target: As the filter follows it.
        look: What it looks like, as far as confirmed.
        log_size: (2,) logarithms of its width and height, smoothed over the detections.
        belief: Logarithm of the odds that there is such a target.
        velocity: (2,) of its center as it was seen to move, smoothed, pixels per second.
        votes: Label to the sum of the scores with which it was given.
        age: Seconds since it began.
        confirmations: Detections that were taken for it, the first one too.
        unconfirmed_for: Seconds since the last of them.
        learned_for: Seconds since it was learned anew.
        is_confirmed: Whether it was confirmed often enough to be told.
        is_hidden: Whether another target is in front of it.
        gone_for: Seconds since it ended; None while it is followed.
    """

    key: Key
    target: Target
    look: Look
    log_size: NDArray[np.float64]
    belief: float
    velocity: tuple[float, float] = (0.0, 0.0)
    votes: Mapping[str, float] = field(default_factory=dict)
    age: float = 0.0
    confirmations: int = 1
    unconfirmed_for: float = 0.0
    learned_for: float = 0.0
    is_confirmed: bool = False
    is_hidden: bool = False
    gone_for: float | None = None

    @property
    def by_hand(self) -> bool:
        """Whether somebody asked for it, so that only they end it."""
        return self.key.place < 0

    @property
    def label(self) -> str:
        """What it was called most."""
        return max(self.votes, key=lambda label: self.votes[label], default="")

    @property
    def box(self) -> NDArray[np.float64]:
        """(4,) as the last frame left it, pixels."""
        return np.array(self.target.estimate.box)

    def expected(self, interval: float) -> NDArray[np.float64]:
        """(4,) where its box will be in so many seconds, pixels."""
        x, y = self.velocity
        return self.box + interval * np.array([x, y, 0.0, 0.0])

    @property
    def is_told(self) -> bool:
        """Whether it is sure enough, and seen well enough, to be told."""
        is_seen = self.belief > 0.0 and self.target.estimate.state != "lost"
        return self.by_hand or (self.is_confirmed and is_seen)

    def voted(self, label: str, score: float) -> Life:
        """The same, called by a label once more."""
        return replace(self, votes={**self.votes, label: self.votes.get(label, 0.0) + score})
