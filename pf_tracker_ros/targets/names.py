"""The ids of targets: from 1 on in the order in which they are told, never used again."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from pf_tracker_ros.boxes import overlaps
from pf_tracker_ros.targets.crowd import SAME_ABOVE, Crowd
from pf_tracker_ros.targets.life import Key, Life

# Names of targets that are remembered beyond those that there are.
_MOST_NAMES = 10_000


class Names:
    """Key of a target to its id."""

    def __init__(self) -> None:
        self._ids: dict[Key, int] = {}
        self._last = 0

    def __contains__(self, key: Key) -> bool:
        return key in self._ids

    def __getitem__(self, key: Key) -> int:
        return self._ids[key]

    def get(self, key: Key) -> int | None:
        """The id of a target, None while it has none."""
        return self._ids.get(key)

    def name(self, life: Life) -> int:
        """The id of a target, which gets one if it has none."""
        if life.key not in self._ids:
            self._last += 1
            self._ids[life.key] = self._last
        return self._ids[life.key]

    def told(self, lives: Sequence[Life]) -> dict[int, Life]:
        """Id to target, of those that are told."""
        return {self._ids[life.key]: life for life in lives if life.is_told and life.key in self}

    def next_by_hand(self, frame: int) -> Key:
        """A key for a target that is asked for in a frame."""
        before = sum(key.place < 0 and key.frame == frame for key in self._ids)
        return Key(frame, -1 - before)

    def hand_over(self, before: Sequence[Key], now: Key) -> None:
        """Let a target be called as the first of some that it takes over, which are no more."""
        names = [name for key in before if (name := self._ids.pop(key, None)) is not None]
        if names:
            self._ids[now] = names[0]

    def pass_on(self, told: Mapping[int, Life], crowd: Crowd) -> None:
        """Let targets that took the places of others, when those were worked out again, be them.

        Args:
            told: Id to target, as told before.
            crowd: As worked out again.
        """
        there = {life.key for life in (*crowd.lives, *crowd.gone)}
        lost = [(name, life) for name, life in told.items() if life.key not in there]
        for life in crowd.lives:
            if not lost or not life.is_told or life.key in self._ids:
                continue
            same = overlaps(life.box[None], np.array([one.box for _, one in lost]))[0]
            best = int(same.argmax())
            if same[best] > SAME_ABOVE:
                name, before = lost.pop(best)
                # Worked out once more, that one may be back, as another one.
                del self._ids[before.key]
                self._ids[life.key] = name

    def forget(self, crowd: Crowd, oldest: int) -> None:
        """Forget those that no frame can bring back.

        Args:
            crowd: All targets that there are.
            oldest: Number of the oldest frame that may be worked out again.
        """
        if len(self._ids) > _MOST_NAMES:
            there = {life.key for life in (*crowd.lives, *crowd.gone)}
            self._ids = {
                key: name for key, name in self._ids.items() if key in there or key.frame >= oldest
            }
