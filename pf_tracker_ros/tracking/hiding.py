"""What is done with a target while it is hidden."""

from __future__ import annotations

from dataclasses import replace
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from pf_tracker_ros.filter import KalmanForesight, ParticleSet
from pf_tracker_ros.registry import Registry
from pf_tracker_ros.tracking.judgment import Judgment
from pf_tracker_ros.tracking.measurement import Measurement
from pf_tracker_ros.tracking.target import Target


class WhileHidden(Protocol):
    """How a target that is not seen is told, and from where it is followed on."""

    def judge(self, target: Target, measured: Measurement, judged: Judgment) -> Judgment:
        """What is told in a frame in which the target is hidden.

        Args:
            target: After the last frame.
            measured: In this one.
            judged: What would be told if the target was seen.
        """

    def begin_anew(self, target: Target, judged: Judgment) -> NDArray[np.float64] | None:
        """(4,) box, pixels, around which the particles are drawn anew; None where they go on.

        Args:
            target: After the last frame.
            judged: In this one, in which the target is hidden.
        """

    def go_on(
        self,
        target: Target,
        judged: Judgment,
        particles: ParticleSet,
        foresight: KalmanForesight | None,
    ) -> tuple[ParticleSet, KalmanForesight | None]:
        """From where the next frame goes on.

        Args:
            target: After the last frame.
            judged: In this one, in which the target is hidden.
            particles: Resampled from those that were told.
            foresight: The Kalman filter after this frame.
        """


WHILE_HIDDEN = Registry[WhileHidden]("behavior while the target is hidden")


@WHILE_HIDDEN.register("coast")
class Coast:
    """The motion model alone carries the particles on.

    What is at the box is not the target: its likelihoods would pull the particles to whatever hides
    it. Once the target is lost, every frame searches anew from where that began: carried on and on,
    the cloud and its cost would grow without end.
    """

    def judge(self, target: Target, measured: Measurement, judged: Judgment) -> Judgment:
        """See `WhileHidden.judge`."""
        predicted = measured.unsearched or measured.predicted
        box = target.motion.boxes(predicted.mean[None])[0]
        boxes = target.motion.boxes(predicted.states)
        return replace(judged, box=box, particles=predicted, boxes=boxes, learns=False)

    def begin_anew(self, target: Target, judged: Judgment) -> NDArray[np.float64] | None:
        """See `WhileHidden.begin_anew`."""
        return None

    def go_on(
        self,
        target: Target,
        judged: Judgment,
        particles: ParticleSet,
        foresight: KalmanForesight | None,
    ) -> tuple[ParticleSet, KalmanForesight | None]:
        """See `WhileHidden.go_on`."""
        # Another number of them that was just asked for has been drawn.
        if judged.track.state == "lost" and len(particles) == len(target.particles):
            return target.particles, target.foresight
        return particles, foresight


@WHILE_HIDDEN.register("follow")
class FollowLikeliest:
    """The likeliest place is followed all the time, and the state tells that it may be wrong.

    That finds the target sooner where it comes back nearby.
    """

    def judge(self, target: Target, measured: Measurement, judged: Judgment) -> Judgment:
        """See `WhileHidden.judge`."""
        return judged

    def begin_anew(self, target: Target, judged: Judgment) -> NDArray[np.float64] | None:
        """See `WhileHidden.begin_anew`.

        The size would follow whatever there is: once lost, the target has that which it had last.
        """
        if judged.track.state != "lost":
            return None
        size = np.array(target.seen_box[2:])
        return np.hstack([judged.box[:2] + (judged.box[2:] - size) / 2, size])

    def go_on(
        self,
        target: Target,
        judged: Judgment,
        particles: ParticleSet,
        foresight: KalmanForesight | None,
    ) -> tuple[ParticleSet, KalmanForesight | None]:
        """See `WhileHidden.go_on`."""
        return particles, foresight
