"""Targets for other parameters, or images of another size: learned again where they were seen."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from pf_tracker_ros.boxes import Box, as_box
from pf_tracker_ros.frames import Frame
from pf_tracker_ros.parameters import declarations
from pf_tracker_ros.targets.crowd import Crowd
from pf_tracker_ros.targets.history import History, Moment
from pf_tracker_ros.targets.life import Life
from pf_tracker_ros.targets.parameters import MultiTrackerParameters
from pf_tracker_ros.tracking.follower import Follower
from pf_tracker_ros.tracking.scaling import box_within, scaled_box, scaled_to, size_of


class Memory(NamedTuple):
    """All that is known of the targets.

    Attributes:
        crowd: After the last frame.
        history: The frames so far.
        frame: The last one, None before the first.
    """

    crowd: Crowd
    history: History
    frame: Frame | None

    @property
    def every_life(self) -> list[Life]:
        """Those that are followed, and were in the frames that are kept."""
        before = (life for moment in self.history.moments for life in moment.before.lives)
        return [*self.crowd.lives, *before]


class Sight(NamedTuple):
    """Where a target was last seen.

    Attributes:
        frame: In which.
        box: Of the target, with its center in the image.
    """

    frame: Frame
    box: Box


def needs_learning(memory: Memory, before: Mapping[str, Any], after: Mapping[str, Any]) -> bool:
    """Whether other parameters ask for targets that are learned again.

    Args:
        memory: What is known of the targets.
        before: Full name to value of every parameter in force.
        after: The same of the others.
    """
    lives = memory.every_life
    for name, one in declarations(MultiTrackerParameters).items():
        if lives and one.read_only and one.counts(before) and after[name] != before[name]:
            return True
    knowing = {name for name in after["cues"] if after[f"{name}.power"] > 0.0}
    return not all(knowing & life.target.templates.keys() for life in lives)


def reconfigured(memory: Memory, follower: Follower) -> tuple[Crowd, tuple[Moment, ...]]:
    """The crowd and the moments for other parameters, which need nothing learned again."""

    def each(lives: Sequence[Life]) -> tuple[Life, ...]:
        return tuple(replace(life, target=follower.reconfigure(life.target)) for life in lives)

    moments = tuple(
        replace(
            moment,
            before=replace(moment.before, lives=each(moment.before.lives)),
            begun=each(moment.begun),
        )
        for moment in memory.history.moments
    )
    return replace(memory.crowd, lives=each(memory.crowd.lives)), moments


def learned_again(
    memory: Memory, follower: Follower, adapt: Callable[[Sight], Sight] = lambda sight: sight
) -> tuple[Crowd, tuple[Life, ...]]:
    """The crowd with every target learned again; one that is hidden is so until it is seen.

    Args:
        memory: What is known of the targets.
        follower: Learns them.
        adapt: Makes of where a target was seen where it is to be learned.

    Returns:
        The crowd, and those that are not in it because they were not seen for too long.
    """
    lives: list[Life] = []
    unseen: list[Life] = []
    for life in memory.crowd.lives:
        sight = _last_sight(life, memory)
        if sight is None:
            unseen.append(life)
            continue
        frame, box = adapt(sight)
        before = life.target
        target = follower.begin(frame, box, before.randomness, before.estimate.state)
        lives.append(replace(life, target=target, learned_for=0.0))
    return replace(memory.crowd, lives=tuple(lives)), tuple(unseen)


def resized(memory: Memory, follower: Follower, like: NDArray[np.generic]) -> Crowd:
    """The crowd in images of another size, without those that were not seen for too long.

    Args:
        memory: What is known of the targets.
        follower: Learns them.
        like: An image of that size, of the same kind and aspect ratio.
    """
    frames: dict[int, Frame] = {}
    before, after = (memory.frame.size if memory.frame else size_of(like)), size_of(like)
    factors = np.divide(after, before)

    def adapt(sight: Sight) -> Sight:
        image = scaled_to(sight.frame.image, like)
        frame = frames.setdefault(id(sight.frame), Frame(like if image is None else image))
        return Sight(frame, scaled_box(sight.box, before, after))

    crowd, _ = learned_again(memory, follower, adapt)
    lives = [_scaled(life, factors) for life in crowd.lives]
    gone = []
    for life in crowd.gone:
        estimate = life.target.estimate
        there = replace(estimate, box=scaled_box(estimate.box, before, after))
        gone.append(replace(_scaled(life, factors), target=replace(life.target, estimate=there)))
    return replace(crowd, lives=tuple(lives), gone=tuple(gone))


def _scaled(life: Life, factors: NDArray[np.float64]) -> Life:
    """What is known of a target beside the filter, by how many pixels one becomes on each axis."""
    return replace(
        life,
        log_size=life.log_size + np.log(factors),
        course=life.course.scale(factors),
        glimpse=None,
        stood=None if life.stood is None else life.stood * np.tile(factors, 2),
    )


def _last_sight(life: Life, memory: Memory) -> Sight | None:
    """Where a target was last seen, None if that is longer ago than frames are kept."""
    after = memory.crowd
    frames = [(moment.frame, moment.before) for moment in reversed(memory.history.moments)]
    if not frames and memory.frame:
        frames = [(memory.frame, Crowd())]
    for frame, before in frames:
        one = next((one for one in after.lives if one.key == life.key), None)
        if one and one.target.estimate.state == "tracking":
            return Sight(frame, box_within(as_box(one.box), frame.image))
        after = before
    return None
