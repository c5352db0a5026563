"""Who of those that are missing is seen again."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from pf_tracker_ros.appearances import Appearance
from pf_tracker_ros.boxes import covered
from pf_tracker_ros.targets.assignment import assign
from pf_tracker_ros.targets.crowd import Crowd
from pf_tracker_ros.targets.life import Life

# A target is recognized where its appearance differs by less than so much of what it usually
# varies by.
_ALIKE_BELOW = 1.5
# How far it may have come: box heights at once, and in each second.
_REACH, _SPEED = 1.0, 1.0
# Belief below which a target that somebody asked for is missing, if the image does not show it.
_MISSING_BELOW = -1.0
# A box that holds more than this of another target's is around both.
_HOLDS_ABOVE = 0.8


class Recognizer:
    """Gives targets that a detector has started the names of those they were before.

    Nobody ends what was started by hand. If it is lost, though, the detector finds it before
    anybody knows that it is the same one, and it begins as another: until the detector has missed
    the one often enough, and both look alike.

    Args:
        appearance: Compares descriptors.
    """

    def __init__(self, appearance: Appearance) -> None:
        self._appearance = appearance

    def recognize(self, crowd: Crowd) -> Crowd:
        """The crowd with those recognized that a detection shows.

        What has ended is recognized by the first detection or not at all.

        Args:
            crowd: In a frame that the detector saw.
        """
        missing = [*crowd.gone, *(life for life in crowd.lives if _is_missing(life))]
        shown = [life for life in crowd.lives if _may_be_another(life, crowd.lives)]
        if not missing or not shown:
            return crowd
        differs = np.array([self._differences(before, shown) for before in missing])
        pairs = assign(differs, _ALIKE_BELOW)
        known = {shown[column].key: missing[row] for row, column in pairs.items()}
        found = {before.key for before in known.values()}
        return replace(
            crowd,
            lives=tuple(
                _as_before(life, known[life.key]) if life.key in known else life
                for life in crowd.lives
                if life.key not in found
            ),
            gone=tuple(life for life in crowd.gone if life.key not in found),
        )

    def _differences(self, before: Life, shown: Sequence[Life]) -> NDArray[np.float64]:
        """(N,) how unlike a missing target others are, in what it varies by; infinite if not it."""
        differs = self._appearance.distance(
            before.descriptor, np.array([life.descriptor for life in shown])
        )
        may_be = [_may_be(before, life) for life in shown]
        return np.where(may_be, differs / before.varies, math.inf)


def _is_missing(life: Life) -> bool:
    """Whether somebody asked for a target that neither the detector nor the image shows."""
    is_seen = life.unconfirmed_for == 0.0 or life.target.estimate.state == "tracking"
    return life.by_hand and not is_seen and life.belief < _MISSING_BELOW


def _may_be_another(life: Life, lives: Sequence[Life]) -> bool:
    """Whether a detection shows a target that a detector has started, and that one alone."""
    if life.unconfirmed_for > 0.0 or life.by_hand or life.is_rival:
        return False
    known = (one for one in lives if one is not life and one.is_told and not _is_missing(one))
    others = [one.box for one in known if one.target.estimate.state != "lost"]
    inside = covered(np.array(others).reshape(-1, 4), life.box[None])
    return bool((inside <= _HOLDS_ABOVE).all())


def _may_be(before: Life, life: Life) -> bool:
    """Whether another target may be the missing one, whatever it looks like."""
    if before.gone_for is None:
        since, began_after = before.unconfirmed_for, life.age <= before.unconfirmed_for
    else:
        since, began_after = before.gone_for, life.confirmations == 1
    # Nobody looks for what has ended: its course alone goes along where the camera turns.
    one, other = life.box, before.box if before.gone_for is None else before.expected
    apart = one[:2] + one[2:] / 2 - other[:2] - other[2:] / 2
    is_near = math.hypot(*apart) <= (_REACH + _SPEED * since) * other[3]
    return began_after and is_near and _may_be_called(before, life.label)


def _may_be_called(before: Life, label: str) -> bool:
    """Whether a target may have a label: nobody has called it anything else alone."""
    known = set(before.votes) - {""}
    return not known or label in known or not label


def _as_before(life: Life, before: Life) -> Life:
    """A target that is the one of before, where it is now."""
    votes = {
        label: before.votes.get(label, 0.0) + life.votes.get(label, 0.0)
        for label in (*before.votes, *life.votes)
    }
    return replace(
        life,
        key=before.key,
        descriptor=before.descriptor,
        varies=before.varies,
        views=before.views,
        belief=max(life.belief, 0.5),
        age=before.age + (before.gone_for or 0.0),
        confirmations=before.confirmations + life.confirmations,
        votes=votes,
    )
