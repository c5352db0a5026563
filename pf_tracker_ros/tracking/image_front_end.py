"""Image front end: the steps that are common to all targets of one camera.

1. Gain control maps images of more than 8 bits to gray levels.
2. Illumination compensation keeps the brightness constant, if it is enabled.
3. A cut to another scene is found, in which a target is less likely.
4. Ego-motion estimation computes the camera's motion, with several targets.
5. The background model computes the foreground, if a cue reads it.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pf_tracker_ros.background import BackgroundModel
from pf_tracker_ros.boxes import Box
from pf_tracker_ros.frames import Foreground, Frame
from pf_tracker_ros.frames.continuity import Continuity
from pf_tracker_ros.frames.ego_motion import EgoMotion
from pf_tracker_ros.frames.exposure import UNCHANGED_ILLUMINATION, GainControl

# Spawn key of the background model's seed.
_BACKGROUND_KEY = 0


class ImageFrontEnd:
    """Gain control, illumination, ego-motion and background model of consecutive images.

    The seed is that of the background model; see there for ghosts. A first frame, if there is one,
    is not prepared yet.

    A deep copy or pickle lacks the last image, and continues independently with the same results.

    Attributes:
        frame: The last frame; None before the first, and in a fresh copy.
    """

    def __init__(
        self,
        seed: int,
        frame: Frame | None = None,
        *,
        needs_foreground: bool,
        follow_light: bool = False,
        removes_ghosts: bool,
        estimates_motion: bool = False,
    ) -> None:
        self._seed = seed
        self._needs_foreground, self._follow_light = needs_foreground, follow_light
        self._removes_ghosts = removes_ghosts
        self._ego_motion = EgoMotion() if estimates_motion else None
        self._gain = GainControl()
        self._next_gain = self._gain
        self._illumination = self._next_illumination = UNCHANGED_ILLUMINATION
        self._continuity = Continuity()
        self._background: BackgroundModel | None = None
        self.frame = frame
        self._format = _format_of(frame) if frame else None

    def configure(self, *, multi_target: bool, needs_foreground: bool, follow_light: bool) -> None:
        """Enable ego-motion for several targets, and ghost removal in the next background model."""
        self._ego_motion = (self._ego_motion or EgoMotion()) if multi_target else None
        self._removes_ghosts, self._follow_light = multi_target, follow_light
        if needs_foreground != self._needs_foreground:
            self._needs_foreground, self._background = needs_foreground, None

    def accepts_image(self, image: NDArray[np.generic]) -> bool:
        """Whether an image has the size and type of the last one; True before the first."""
        return self._format in (None, (image.shape, image.dtype))

    @property
    def image_format(self) -> str:
        """Shape and type of the images, in words."""
        return " ".join(map(str, self._format or ()))

    def prepare(
        self, frame: Frame, interval: float, boxes: Sequence[Box], *, is_tracked: bool = False
    ) -> None:
        """Prepare the next frame, of accepted size and type, which `commit` makes the last one.

        Background model, ego-motion and continuity are updated at once, gain and illumination by
        `commit`. Without a tracked target nothing learns the illumination.
        """
        self._next_gain = self._gain.update(frame.image, interval)
        self._next_illumination = UNCHANGED_ILLUMINATION
        if self._follow_light:
            learning = interval if is_tracked else 0.0
            self._next_illumination = self._illumination.update(frame.image, learning)
        frame.expose(self._next_gain.span, self._next_illumination)
        frame.odds_factor = self._continuity.update(frame.image, interval)
        if self._ego_motion:
            frame.camera_motion = self._ego_motion.update(frame)
        if self._needs_foreground:
            self._update_background(frame, boxes)

    def commit(self, frame: Frame) -> None:
        """Make a prepared frame the last one."""
        if frame is not self.frame:
            self.frame, self._format = frame, _format_of(frame)
            self._gain, self._illumination = self._next_gain, self._next_illumination

    def _update_background(self, frame: Frame, boxes: Sequence[Box]) -> None:
        """Set the frame's foreground and learn its background."""
        if self._background is None:
            seeds = np.random.SeedSequence(self._seed, spawn_key=(_BACKGROUND_KEY,))
            draw = np.random.default_rng(seeds)
            self._background = BackgroundModel(
                frame.pixels, draw, boxes, removes_ghosts=self._removes_ghosts
            )
        mask = self._background.update(frame.pixels, boxes)
        frame.background = self._background.state
        if frame.background.name != "off":
            frame.foreground = Foreground(mask, self._background.reduction)

    def __getstate__(self) -> dict[str, Any]:
        # The last frame would only make the copy large.
        return self.__dict__ | {"frame": None}


def _format_of(frame: Frame) -> tuple[tuple[int, ...], np.dtype[Any]]:
    return frame.image.shape, frame.image.dtype
