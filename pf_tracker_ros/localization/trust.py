"""Whether a target that was out of sight is still the same, by its place and its confidence.

A box may go over to somebody else who crosses, and look fair soon. The first measurement after that
decides between two hypotheses: the target is where it was predicted from before, with the density
N(v; 0, S) of the innovation v; or the box is on somebody else, who may be anywhere, with the
density r per square meter. With the confidence p of the tracker, and the least one p0 of a target
that is not in doubt,

    log odds = log N(v; 0, S) - log min(r, N(0; 0, S)) + logit(p) - logit(p0)

They rise with the time for which the box is tracked on, from their least value to 0 in the time
`hold`. From 0 on, the target is the same. Until then, a frame without a measurement ends no doubt,
since the next one may agree with a place that is in doubt. The longer it was out of sight, the
wider is S, and the less its place says; once the target may be anywhere, too, only its looks do.
"""

from __future__ import annotations

import math

from pf_tracker_ros.stamps import NANOSECONDS

# People per square meter to whom a box may go over.
_OTHERS_DENSITY = 0.05
LEAST_LOG_ODDS = -4.0
"""Least log odds by the place: it contradicts the prediction."""
# Confidences closer to 0 or 1 count as this, since those of 0 and 1 are infinite.
_LEAST_CONFIDENCE = 1e-3


class Trust:
    """Of one target; a new one is trusted.

    Attributes:
        doubted_for: Seconds until its place and confidence suffice, infinite while it is hidden; 0
            without a doubt.
    """

    def __init__(self) -> None:
        self.doubted_for = 0.0
        # Least log odds by the place since the doubt began; infinite before the first measurement.
        self._by_place = math.inf
        # Whether the next measurement adds its place, since the target gave none.
        self._awaits_place = False
        # Stamps of the first measurement in this doubt after the target was hidden, None without,
        # and of the last one.
        self._measured_since: int | None = None
        self._measured_at = 0
        self._is_doubted = False

    def lose_sight(self, *, is_hidden: bool) -> None:
        """The target gives no measurement; the next one decides.

        A doubt that is not settled stays: the next one may agree with a doubted place.

        Args:
            is_hidden: Whether it is not tracked at all, and may be something else from now on.
        """
        self._is_doubted = self._awaits_place = True
        if is_hidden:
            self._measured_since, self.doubted_for = None, math.inf

    def contradict(self, stamp: int) -> None:
        """The target is in another place than predicted.

        Args:
            stamp: Of the frame, nanoseconds.
        """
        self._is_doubted, self._awaits_place = True, False
        self._by_place = LEAST_LOG_ODDS
        self._measured_since = self._measured_at = stamp

    def measure(
        self,
        stamp: int,
        by_place: float,
        confidence: float,
        *,
        min_confidence: float,
        hold: float,
    ) -> None:
        """Take a measurement of the tracked target.

        Args:
            stamp: Of the frame, nanoseconds.
            by_place: See `log_odds_by_place`.
            confidence: Of the target, `min_confidence` to 1.
            min_confidence: Least one of a target that is not in doubt.
            hold: Seconds from a place that contradicts until the target counts as the same.
        """
        if not self._is_doubted:
            return
        if self._awaits_place:
            # A doubt from before lasts no longer than it would have if the target had been seen.
            is_recent = stamp - self._measured_at < hold * NANOSECONDS
            self._by_place = min(self._by_place, by_place) if is_recent else by_place
            self._awaits_place = False
        if self._measured_since is None:
            self._measured_since = stamp
        self._measured_at = stamp
        log_odds = self._by_place + _logit(confidence) - _logit(min_confidence)
        needed = max(-log_odds, 0.0) * hold / -LEAST_LOG_ODDS
        self.doubted_for = max(needed - (stamp - self._measured_since) / NANOSECONDS, 0.0)
        self._is_doubted = self.doubted_for > 0.0
        if not self._is_doubted:
            self._by_place, self._measured_since = math.inf, None


def log_odds_by_place(log_density: float | None, squared: float | None) -> float:
    """Log odds that a measurement is of the target, by its place, -4 up.

    Args:
        log_density: Of the measurement given its prediction, 1/m^2; None without one.
        squared: Its normalized innovation; None without a prediction.
    """
    if log_density is None or squared is None:
        return 0.0
    largest = log_density + squared / 2.0
    by_place = log_density - min(math.log(_OTHERS_DENSITY), largest)
    return max(by_place, LEAST_LOG_ODDS)


def _logit(confidence: float) -> float:
    inside = min(max(confidence, _LEAST_CONFIDENCE), 1.0 - _LEAST_CONFIDENCE)
    return math.log(inside / (1.0 - inside))
