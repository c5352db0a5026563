"""What belongs to the images of one camera, whatever is followed in them."""

from __future__ import annotations

import copy
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pf_tracker_ros.background import BackgroundModel
from pf_tracker_ros.boxes import Box
from pf_tracker_ros.frames import Foreground, Frame
from pf_tracker_ros.frames.ego_motion import EgoMotion
from pf_tracker_ros.frames.exposure import UNCHANGED_ILLUMINATION, GainControl

# Which child of the seed the background model draws from.
_BACKGROUND_KEY = 0


class ImageFrontEnd:
    """Makes a frame of each image: gain control, light and background model follow the images.

    It can be copied and pickled, without its last image: the copy goes on with the same bits and on
    its own, `copy.copy` as deep as `copy.deepcopy`.

    Args:
        seed: Seeds the background model.
        frame: The last one so far, with which nothing was done; None where there is none.
        removes_ghosts: See `BackgroundModel`.
        estimates_motion: Whether each frame tells how the camera has moved.

    Attributes:
        frame: The last one; None before the first, and in a fresh copy.
    """

    def __init__(
        self,
        seed: int,
        frame: Frame | None = None,
        *,
        removes_ghosts: bool = False,
        estimates_motion: bool = False,
    ) -> None:
        self._seed = seed
        self._lays_ghosts = removes_ghosts
        self._ego_motion = EgoMotion() if estimates_motion else None
        self._gain = GainControl()
        self._next_gain = self._gain
        self._light = self._next_light = UNCHANGED_ILLUMINATION
        self._background: BackgroundModel | None = None
        self.frame = frame
        self._kind = _kind_of(frame) if frame else None

    def configure(self, *, several: bool) -> None:
        """Change whether it tells its motion, and lays ghosts from the next background model on."""
        self._ego_motion = (self._ego_motion or EgoMotion()) if several else None
        self._lays_ghosts = several

    def accepts_image(self, image: NDArray[np.generic]) -> bool:
        """Whether an image has the size and kind of the last one; any has before the first."""
        return self._kind in (None, (image.shape, image.dtype))

    @property
    def image_format(self) -> str:
        """Shape and type of the images, in words."""
        return " ".join(map(str, self._kind or ()))

    def prepare(
        self,
        frame: Frame,
        interval: float,
        boxes: Sequence[Box],
        needs_foreground: bool,
        follow_light: bool,
    ) -> None:
        """Prepare the next frame; it is the last one as soon as `keep` says so.

        The background model learns it at once, and the camera's motion is counted from it.

        Args:
            frame: Of the size and kind of the last one; checked.
            interval: Seconds since that one.
            boxes: Where targets are.
            needs_foreground: Whether anybody asks for the foreground.
            follow_light: Whether an image that has become brighter or darker as a whole is seen in
                the light of those before.
        """
        self._next_gain = self._gain.update(frame.image, interval)
        self._next_light = (
            self._light.update(frame.image, interval) if follow_light else UNCHANGED_ILLUMINATION
        )
        frame.expose(self._next_gain.span, self._next_light)
        if self._ego_motion:
            frame.camera_motion = self._ego_motion.update(frame)
        if needs_foreground:
            self.update_background(frame, boxes)

    def commit(self, frame: Frame) -> None:
        """Take a frame that was opened for the last one."""
        if frame is not self.frame:
            self.frame, self._gain, self._light = frame, self._next_gain, self._next_light
            self._kind = _kind_of(frame)

    def reset_background(self) -> None:
        """Let the background model begin anew when it is asked for again."""
        self._background = None

    def update_background(self, frame: Frame, boxes: Sequence[Box]) -> None:
        """Tell the frame its foreground, and learn its background; arguments as for `open`."""
        if self._background is None:
            seeds = np.random.SeedSequence(self._seed, spawn_key=(_BACKGROUND_KEY,))
            draw = np.random.default_rng(seeds)
            self._background = BackgroundModel(
                frame.pixels, draw, boxes, removes_ghosts=self._lays_ghosts
            )
        mask = self._background.update(frame.pixels, boxes)
        frame.background = self._background.state
        if frame.background.name != "off":
            frame.foreground = Foreground(mask, self._background.reduction)

    def __getstate__(self) -> dict[str, Any]:
        # A copy goes on with its next frame; that of the past would only make it large.
        return self.__dict__ | {"frame": None}

    def __copy__(self) -> ImageFrontEnd:
        return copy.deepcopy(self)


def _kind_of(frame: Frame) -> tuple[tuple[int, ...], np.dtype[Any]]:
    return frame.image.shape, frame.image.dtype
