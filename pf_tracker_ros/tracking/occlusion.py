"""What is done with a target while it is hidden."""

from __future__ import annotations

from dataclasses import replace
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from pf_tracker_ros.filter import KalmanFilter, ParticleSet
from pf_tracker_ros.registry import Registry
from pf_tracker_ros.tracking.assessment import Assessment
from pf_tracker_ros.tracking.filter_state import FilterState
from pf_tracker_ros.tracking.measurement import Measurement


class OcclusionPolicy(Protocol):
    """How a target that is not seen is told, and from where it is followed on."""

    def assess(
        self, target: FilterState, measured: Measurement, assessment: Assessment
    ) -> Assessment:
        """What is told in a frame in which the target is hidden.

        Args:
            target: After the last frame.
            measured: In this one.
            assessment: What would be told if the target was seen.
        """

    def redraw_box(self, target: FilterState, assessment: Assessment) -> NDArray[np.float64] | None:
        """(4,) box, pixels, around which the particles are drawn anew; None where they go on.

        Args:
            target: After the last frame.
            assessment: In this one, in which the target is hidden.
        """

    def next_particles(
        self,
        target: FilterState,
        assessment: Assessment,
        particles: ParticleSet,
        kalman_filter: KalmanFilter | None,
    ) -> tuple[ParticleSet, KalmanFilter | None]:
        """From where the next frame goes on.

        Args:
            target: After the last frame.
            assessment: In this one, in which the target is hidden.
            particles: Resampled from those that were told.
            kalman_filter: The Kalman filter after this frame.
        """


OCCLUSION_POLICIES = Registry[OcclusionPolicy]("behavior while the target is hidden")


@OCCLUSION_POLICIES.register("coast")
class Coast:
    """The motion model alone carries the particles on.

    What is at the box is not the target: its likelihoods would pull the particles to whatever hides
    it. Once the target is lost, every frame searches anew from where that began: carried on and on,
    the cloud and its cost would grow without end.
    """

    def assess(
        self, target: FilterState, measured: Measurement, assessment: Assessment
    ) -> Assessment:
        """See `OcclusionPolicy.assess`."""
        predicted = measured.transition_particles or measured.predicted
        box = target.motion.boxes(predicted.mean[None])[0]
        boxes = target.motion.boxes(predicted.states)
        return replace(assessment, box=box, particles=predicted, boxes=boxes, learns=False)

    def redraw_box(self, target: FilterState, assessment: Assessment) -> NDArray[np.float64] | None:
        """See `OcclusionPolicy.redraw_box`."""
        return None

    def next_particles(
        self,
        target: FilterState,
        assessment: Assessment,
        particles: ParticleSet,
        kalman_filter: KalmanFilter | None,
    ) -> tuple[ParticleSet, KalmanFilter | None]:
        """See `OcclusionPolicy.next_particles`."""
        # Another number of them that was just asked for has been drawn.
        if assessment.status.state == "lost" and len(particles) == len(target.particles):
            return target.particles, target.kalman_filter
        return particles, kalman_filter


@OCCLUSION_POLICIES.register("keep_tracking")
class KeepTracking:
    """The likeliest place is followed all the time, and the state tells that it may be wrong.

    That finds the target sooner where it comes back nearby.
    """

    def assess(
        self, target: FilterState, measured: Measurement, assessment: Assessment
    ) -> Assessment:
        """See `OcclusionPolicy.assess`."""
        return assessment

    def redraw_box(self, target: FilterState, assessment: Assessment) -> NDArray[np.float64] | None:
        """See `OcclusionPolicy.redraw_box`.

        The size would follow whatever there is: once lost, the target has that which it had last.
        """
        if assessment.status.state != "lost":
            return None
        size = np.array(target.last_seen_box[2:])
        return np.hstack([assessment.box[:2] + (assessment.box[2:] - size) / 2, size])

    def next_particles(
        self,
        target: FilterState,
        assessment: Assessment,
        particles: ParticleSet,
        kalman_filter: KalmanFilter | None,
    ) -> tuple[ParticleSet, KalmanFilter | None]:
        """See `OcclusionPolicy.next_particles`."""
        return particles, kalman_filter
