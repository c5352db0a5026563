"""Whether targets that are near each other are still who they were."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from pf_tracker_ros.appearances import Appearance
from pf_tracker_ros.targets.detections import Sighting
from pf_tracker_ros.targets.life import Life

# Targets within so many heights of each other may have been taken for each other.
_NEAR = 2.0
# By how much the descriptors must fit better the other way round.
_MARGIN = 0.15


def tell_apart(
    lives: Sequence[Life], own: Sequence[Sighting | None], appearance: Appearance
) -> tuple[Life, ...]:
    """The targets, with those exchanged that came out of a crossing as each other.

    Who is who is asked of the appearance, as soon as detections show both alone; the filters go on.

    Args:
        lives: The targets.
        own: The detection of each, None where there is none.
        appearance: Compares descriptors.
    """
    settled = list(lives)
    shown = [place for place, one in enumerate(own) if one is not None and one.is_clear]
    for place, other in itertools.combinations(shown, 2):
        one, another = settled[place], settled[other]
        seen, seen_other = own[place], own[other]
        if seen is None or seen_other is None or not _are_near(seen, seen_other):
            continue
        shown_both = np.array([seen.descriptor, seen_other.descriptor])
        one_as_is, one_exchanged = appearance.distance(one.descriptor, shown_both)
        another_exchanged, another_as_is = appearance.distance(another.descriptor, shown_both)
        if one_as_is + another_as_is - (one_exchanged + another_exchanged) > _MARGIN:
            settled[place], settled[other] = _with_filter(another, one), _with_filter(one, another)
    return tuple(settled)


def _are_near(one: Sighting, other: Sighting) -> bool:
    apart = one.box[:2] + one.box[2:] / 2 - other.box[:2] - other.box[2:] / 2
    return math.hypot(*apart) < _NEAR * (one.box[3] + other.box[3]) / 2


def _with_filter(life: Life, other: Life) -> Life:
    """Who the one is, where the other one was followed."""
    return replace(
        life,
        target=other.target,
        course=other.course,
        log_size=other.log_size,
        learned_for=other.learned_for,
        is_hidden=other.is_hidden,
        glimpse=other.glimpse,
    )
