"""Targets for other parameters, or images of another size: learned again where they were seen."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from pf_tracker_ros.appearances import Appearance
from pf_tracker_ros.boxes import Box
from pf_tracker_ros.frames import Frame
from pf_tracker_ros.parameters import declarations
from pf_tracker_ros.targets.tracks import Crowd, Key, Life
from pf_tracker_ros.tracking.parameters import TrackerParameters
from pf_tracker_ros.tracking.scaling import clamp_box, scaled_box, scaled_to
from pf_tracker_ros.tracking.target_filter import TargetFilter


class Sight(NamedTuple):
    """Where a target was last seen.

    Attributes:
        frame: In which.
        box: Of the target.
    """

    frame: Frame
    box: Box


def needs_learning(
    lives: Sequence[Life], before: Mapping[str, Any], after: Mapping[str, Any]
) -> bool:
    """Whether other parameters ask for targets that are learned again.

    Args:
        lives: Those that are followed, and were in the frames that are kept.
        before: Full name to value of every parameter in force.
        after: The same of the others.
    """
    for name, one in declarations(TrackerParameters).items():
        if lives and one.read_only and one.counts(before) and after[name] != before[name]:
            return True
    knowing = {name for name in after["cues"] if after[f"{name}.weight"] > 0.0}
    return not all(knowing & life.target.templates.keys() for life in lives)


def reconfigured(crowd: Crowd, target_filter: TargetFilter) -> Crowd:
    """The crowd for other parameters, which need nothing learned again."""
    lives = (replace(life, target=target_filter.reconfigure(life.target)) for life in crowd.lives)
    return replace(crowd, lives=tuple(lives))


def learned_again(
    crowd: Crowd,
    sights: Mapping[Key, Sight],
    target_filter: TargetFilter,
    appearance: Appearance | None = None,
) -> tuple[Crowd, tuple[Life, ...]]:
    """The crowd with every target learned again; one that is hidden is so until it is seen.

    Args:
        crowd: After the last frame.
        sights: Where its targets were last seen.
        target_filter: Learns them.
        appearance: Describes them anew, and those that have ended are forgotten; None where the
            descriptors stay.

    Returns:
        The crowd, and those that are not in it because they were never seen.
    """
    lives: list[Life] = []
    unseen: list[Life] = []
    for life in crowd.lives:
        sight = sights.get(life.key)
        if sight is None:
            unseen.append(life)
            continue
        box, before = clamp_box(sight.box, sight.frame.image), life.target
        target = target_filter.initialize(
            sight.frame, box, before.generator_state, before.estimate.state
        )
        learned = replace(life, target=target, learned_for=0.0)
        lives.append(learned.described(sight.frame, box, appearance) if appearance else learned)
    gone = () if appearance else crowd.gone
    return replace(crowd, lives=tuple(lives), gone=gone), tuple(unseen)


def resized(
    crowd: Crowd,
    sights: Mapping[Key, Sight],
    target_filter: TargetFilter,
    last: Frame,
    opened: Frame,
) -> tuple[Crowd, dict[Key, Sight]]:
    """The crowd in images of another size, without those that were never seen.

    Args:
        crowd: After the last frame.
        sights: Where its targets were last seen.
        target_filter: Learns them.
        last: The last frame.
        opened: The same in that size, and what the image front end knows of it.

    Returns:
        The crowd, and where its targets were last seen, scaled as well.
    """
    frames = {id(last): opened}
    before, after = last.size, opened.size
    factors = np.divide(after, before)
    scaled: dict[Key, Sight] = {}
    for key, sight in sights.items():
        image = scaled_to(sight.frame.image, opened.image)
        if image is not None:
            frame = frames.setdefault(id(sight.frame), Frame(image, sight.frame.stamp))
            scaled[key] = Sight(frame, scaled_box(sight.box, sight.frame.size, after))
    crowd, _ = learned_again(crowd, scaled, target_filter)
    lives = [_scaled(life, factors) for life in crowd.lives]
    gone = []
    for life in crowd.gone:
        estimate = life.target.estimate
        there = replace(estimate, box=scaled_box(estimate.box, before, after))
        gone.append(replace(_scaled(life, factors), target=replace(life.target, estimate=there)))
    return replace(crowd, lives=tuple(lives), gone=tuple(gone)), scaled


def _scaled(life: Life, factors: NDArray[np.float64]) -> Life:
    """What is known of a target beside the filter, by how many pixels one becomes on each axis."""
    return replace(
        life,
        log_size=life.log_size + np.log(factors),
        course=life.course.scale(factors),
        glimpse=None,
        stood=None if life.stood is None else life.stood * np.tile(factors, 2),
    )
