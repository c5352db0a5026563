"""What one camera sees, and the targets in it."""

from __future__ import annotations

import copy
from collections.abc import Mapping
from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray

from pf_tracker_ros.boxes import Box
from pf_tracker_ros.filter.randomness import Randomness
from pf_tracker_ros.tracking.camera import Camera
from pf_tracker_ros.tracking.estimate import TrackState
from pf_tracker_ros.tracking.follower import Follower
from pf_tracker_ros.tracking.likelihood_map import LikelihoodMap
from pf_tracker_ros.tracking.target import Target

_FIRST_ID = 1


class Scene:
    """One camera: what belongs to its images is here, and its targets by their ids.

    The gain control, for images of more than 8 bits, the light, for those of 8 bits, and the
    background model follow the images, one step a frame, however many targets there are. A target
    is a value with a source of random numbers of its own, so none depends on whether there are
    others; but where the background model begins anew, it is told where all of them are.

    A scene can be copied and pickled, with its targets but without its last image: the copy goes on
    with the same bits and on its own, `copy.copy` as deep as `copy.deepcopy`.

    Args:
        follower: Follows the targets.
        seed: Seeds all randomness.
    """

    def __init__(self, follower: Follower, seed: int = 0) -> None:
        self._follower = follower
        self._seed = seed
        self._camera = Camera(seed)
        self._targets: dict[int, Target] = {}
        self._next_id = _FIRST_ID

    @property
    def targets(self) -> Mapping[int, Target]:
        """Id to target, as the last frame left it."""
        return MappingProxyType(self._targets)

    def start(self, image: NDArray[np.generic], box: Box, state: TrackState = "tracking") -> int:
        """Take a new target.

        Args:
            image: The one that was given last, unchanged since, or another, which is then the
                scene's next; checked.
            box: Of the target; checked.
            state: That it is in; another than tracking if the image is not of the present.

        Returns:
            Its id, from 1 on, never used again.
        """
        frame, needs_foreground = self._camera.frame, self._follower.needs_foreground
        boxes = [*self._boxes, box]
        if frame is None or frame.image is not image:
            if not self._targets:
                self._camera.forget_light()
            frame = self._camera.open(image, 0.0, boxes, needs_foreground, self._follows_light)
        elif needs_foreground and not self._camera.has_background:
            self._camera.observe_background(frame, boxes)
        number = self._next_id
        target = self._follower.begin(frame, box, self._randomness(number), state)
        self._targets[number] = target
        self._next_id += 1
        self._camera.keep(frame)
        return number

    def stop(self, number: int) -> None:
        """Forget a target.

        Raises:
            KeyError: There is none of this id.
        """
        del self._targets[number]

    def update(self, image: NDArray[np.generic], interval: float) -> None:
        """Follow all targets into the next frame.

        Args:
            image: Of the size and kind of the last one; checked.
            interval: Seconds since that one.
        """
        frame = self._camera.open(
            image, interval, self._boxes, self._follower.needs_foreground, self._follows_light
        )
        self._targets = {
            number: self._follower.follow(target, frame, interval)
            for number, target in self._targets.items()
        }
        self._camera.keep(frame)

    def map_likelihood(self, number: int) -> LikelihoodMap | None:
        """How likely a target is around its box, None where its frame is not at hand.

        Raises:
            KeyError: There is none of this id.
        """
        target, frame = self._targets[number], self._camera.frame
        return self._follower.map_likelihood(target, frame) if frame else None

    def reconfigure(self, follower: Follower) -> None:
        """Go on with other parameters; the targets are kept."""
        self._targets = {
            number: follower.reconfigure(target) for number, target in self._targets.items()
        }
        if not follower.needs_foreground:
            self._camera.forget_background()
        self._follower = follower

    def __copy__(self) -> Scene:
        return copy.deepcopy(self)

    @property
    def _follows_light(self) -> bool:
        return self._follower.parameters.follow_light

    @property
    def _boxes(self) -> list[Box]:
        """Where the targets are, as the last frame left them."""
        return [target.estimate.box for target in self._targets.values()]

    def _randomness(self, number: int) -> Randomness:
        """Of a target: the first draws from the seed itself, as a tracker of one target does."""
        seeds = np.random.SeedSequence(self._seed) if number == _FIRST_ID else self._child(number)
        return Randomness.of(np.random.default_rng(seeds))

    def _child(self, key: int) -> np.random.SeedSequence:
        return np.random.SeedSequence(self._seed, spawn_key=(key,))
