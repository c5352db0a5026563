"""Base class of the peers: name in the tables and requirements."""

from __future__ import annotations

from typing import ClassVar

from color_image_tracker import ColorImageTracker


class PeerTracker(ColorImageTracker):
    """Another tracker as one that can be evaluated; its answers are taken as they are.

    Args:
        seed: Seed of everything random.
    """

    name: ClassVar[str]
    """As it stands in the tables."""

    is_random: ClassVar[bool] = False
    """Whether the seed makes a difference."""

    @classmethod
    def missing(cls) -> str:
        """What has to be installed for this tracker to run; empty if nothing."""
        return ""
