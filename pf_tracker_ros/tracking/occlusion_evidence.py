"""Evidence from outside of the image that something is in front of a target.

A depth camera sees which share of the box is nearer than the target. The odds that the box shows
the target are multiplied by the uncovered share, in one frame:

    odds' = odds max(1 - share, 0.15),    if share > 0.25

It is evidence and no command. A wrong source must not silence a target that the image shows: the
evidence counts for at most 2 s, and again only after 1 s in which nothing is in front.
"""

from __future__ import annotations

from typing import NamedTuple

# Share from which on it counts, and least factor of the odds.
_COUNTS_ABOVE, _LEAST_FACTOR = 0.25, 0.15
# Seconds for which it counts, and seconds without anything in front after which it counts again.
_COUNTS_FOR, _CLEAR_FOR = 2.0, 1.0


class OcclusionEvidence(NamedTuple):
    """What is known of the next frame.

    Attributes:
        share: Share of the box that something in front covers, 0 to 1.
        used_for: Seconds for which it has counted.
        clear_for: Seconds since then without anything in front.
    """

    share: float = 0.0
    used_for: float = 0.0
    clear_for: float = 0.0

    @property
    def factor(self) -> float:
        """Factor of the odds of the target; 1 where the evidence does not count."""
        if self.share <= _COUNTS_ABOVE or self.used_for >= _COUNTS_FOR:
            return 1.0
        return max(1.0 - self.share, _LEAST_FACTOR)

    @property
    def is_counted(self) -> bool:
        """Whether it counts, or has counted in this occlusion for less than its time."""
        return self.factor < 1.0 or 0.0 < self.used_for < _COUNTS_FOR

    def advance(self, interval: float) -> OcclusionEvidence:
        """After the frame: nothing is known of the next one.

        Args:
            interval: Seconds since the frame before.
        """
        if self.factor < 1.0:
            return OcclusionEvidence(used_for=self.used_for + interval)
        if self.used_for == 0.0:
            return NO_EVIDENCE
        clear_for = 0.0 if self.share > _COUNTS_ABOVE else self.clear_for + interval
        return (
            NO_EVIDENCE
            if clear_for >= _CLEAR_FOR
            else OcclusionEvidence(used_for=self.used_for, clear_for=clear_for)
        )


NO_EVIDENCE = OcclusionEvidence()
"""Nothing is in front, as without a source."""
