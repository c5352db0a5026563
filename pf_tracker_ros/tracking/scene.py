"""What one camera sees, and the targets in it."""

from __future__ import annotations

import copy
from collections.abc import Mapping, Sequence
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pf_tracker_ros.background import BackgroundModel
from pf_tracker_ros.boxes import Box
from pf_tracker_ros.filter.randomness import Randomness
from pf_tracker_ros.frames import Foreground, Frame
from pf_tracker_ros.frames.gain_control import GainControl
from pf_tracker_ros.frames.light import Light
from pf_tracker_ros.tracking.estimate import TrackState
from pf_tracker_ros.tracking.follower import Follower
from pf_tracker_ros.tracking.likelihood_map import LikelihoodMap
from pf_tracker_ros.tracking.target import Target

_FIRST_ID = 1
# Which child of the seed the background model draws from.
_BACKGROUND_KEY = 0


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
        self._frame: Frame | None = None
        self._gain = GainControl()
        self._light = Light()
        self._background: BackgroundModel | None = None
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
        frame = self._frame
        boxes = [*self._boxes, box]
        gain, light = self._gain, self._light
        if frame is None or frame.image is not image:
            gain, light = gain.follow(image, 0.0), self._follow_light(image, 0.0)
            frame = self._open(image, gain, light, boxes)
        elif self._follower.needs_foreground and self._background is None:
            self._observe_background(frame, boxes)
        number = self._next_id
        target = self._follower.begin(frame, box, self._randomness(number), state)
        self._targets[number] = target
        self._next_id += 1
        self._frame, self._gain, self._light = frame, gain, light
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
        gain, light = self._gain.follow(image, interval), self._follow_light(image, interval)
        frame = self._open(image, gain, light, self._boxes)
        self._targets = {
            number: self._follower.follow(target, frame, interval)
            for number, target in self._targets.items()
        }
        self._frame, self._gain, self._light = frame, gain, light

    def map_likelihood(self, number: int) -> LikelihoodMap | None:
        """How likely a target is around its box, None where its frame is not at hand.

        Raises:
            KeyError: There is none of this id.
        """
        target = self._targets[number]
        return self._follower.map_likelihood(target, self._frame) if self._frame else None

    def reconfigure(self, follower: Follower) -> None:
        """Go on with other parameters; the targets are kept."""
        self._targets = {
            number: follower.reconfigure(target) for number, target in self._targets.items()
        }
        if not follower.needs_foreground:
            self._background = None
        self._follower = follower

    def __getstate__(self) -> dict[str, Any]:
        # A copy goes on with its next frame; that of the past would only make it large.
        return self.__dict__ | {"_frame": None}

    def __copy__(self) -> Scene:
        return copy.deepcopy(self)

    @property
    def _boxes(self) -> list[Box]:
        """Where the targets are, as the last frame left them."""
        return [target.estimate.box for target in self._targets.values()]

    def _follow_light(self, image: NDArray[np.generic], interval: float) -> Light:
        """The light of the next frame; as it is, where no target has been seen in another."""
        if not self._follower.parameters.follow_light:
            return Light()
        before = self._light if self._targets else Light()
        return before.follow(image, interval)

    def _open(
        self, image: NDArray[np.generic], gain: GainControl, light: Light, boxes: Sequence[Box]
    ) -> Frame:
        """The next frame; boxes tell where targets are."""
        frame = Frame(image, span=gain.span, light=light.gain)
        if self._follower.needs_foreground:
            self._observe_background(frame, boxes)
        return frame

    def _observe_background(self, frame: Frame, boxes: Sequence[Box]) -> None:
        """Tell the frame its foreground, and learn its background."""
        if self._background is None:
            parameters = self._follower.parameters.of_background["background"]
            draw = np.random.default_rng(self._child(_BACKGROUND_KEY))
            self._background = BackgroundModel(frame.pixels, parameters, draw, boxes)
        mask = self._background.update(frame.pixels, boxes)
        frame.background = self._background.state
        if frame.background.name != "off":
            frame.foreground = Foreground(mask, self._background.reduction)

    def _randomness(self, number: int) -> Randomness:
        """Of a target: the first draws from the seed itself, as a tracker of one target does."""
        seeds = np.random.SeedSequence(self._seed) if number == _FIRST_ID else self._child(number)
        return Randomness.of(np.random.default_rng(seeds))

    def _child(self, key: int) -> np.random.SeedSequence:
        return np.random.SeedSequence(self._seed, spawn_key=(key,))
