"""How sure it is that the target is in the box."""

from __future__ import annotations

from dataclasses import dataclass

from pf_tracker_ros.cues import Match


@dataclass(frozen=True)
class Confidence:
    """The confidence from frame to frame: it falls at once, and rises as fast as is allowed.

    Attributes:
        rate: Share of each frame in it while it rises, above 0 up to 1. With less, good looks after
            a doubtful one must be several.
    """

    rate: float

    def update(self, before: float, match: Match) -> float:
        """The confidence after a frame, 0 to 1.

        Args:
            before: After the last frame, 0 to 1.
            match: How well what is in the box fits the templates.
        """
        if match.similarity <= before:
            return match.similarity
        return self.rate * match.similarity + (1.0 - self.rate) * before
