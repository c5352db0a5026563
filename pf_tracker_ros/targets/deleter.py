"""When a target ends."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from pf_tracker_ros.targets.crowd import Crowd
from pf_tracker_ros.targets.life import Life

# Belief below which there is no such target.
_ENDS_BELOW = -1.0
# A target whose center is so near to the image's border, in its own sides, has left.
_LEFT_WITHIN = 0.03


class Deleter:
    """Ends targets that the detector does not find any more, or that have left the image.

    Args:
        remember: Seconds for which one that was told is remembered.
    """

    def __init__(self, remember: float) -> None:
        self._remember = remember

    def end(self, crowd: Crowd, image_size: tuple[int, int], interval: float) -> Crowd:
        """The crowd without those that end in this frame.

        Args:
            crowd: In this frame.
            image_size: (width, height), pixels.
            interval: Seconds since the last frame.
        """
        gone = [replace(life, gone_for=(life.gone_for or 0.0) + interval) for life in crowd.gone]
        lives = []
        for life in crowd.lives:
            if life.by_hand or not (life.belief < _ENDS_BELOW or _has_left(life, image_size)):
                lives.append(life)
            elif life.is_confirmed:
                gone.append(replace(life, gone_for=0.0))
        kept = [life for life in gone if (life.gone_for or 0.0) < self._remember]
        return replace(crowd, lives=tuple(lives), gone=tuple(kept))


def _has_left(life: Life, image_size: tuple[int, int]) -> bool:
    box = life.box
    center, margin = box[:2] + box[2:] / 2, _LEFT_WITHIN * box[2:]
    return bool((center <= margin).any() or (center >= np.array(image_size) - margin).any())
