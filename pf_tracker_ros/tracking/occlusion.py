"""Occlusion policies: the box and the particles of a target that is not tracked.

- `Coast`: predict without an update, since the image at the box shows the occluder.
- `KeepTracking`: go on with the likeliest box. Li et al. 2007 do so and freeze the templates only.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from pf_tracker_ros.filter import KalmanFilter, ParticleSet
from pf_tracker_ros.registry import Registry
from pf_tracker_ros.tracking.assessment import Assessment
from pf_tracker_ros.tracking.filter_state import FilterState
from pf_tracker_ros.tracking.measurement import Measurement


class OcclusionPolicy:
    """Handles a target that is not tracked. These defaults treat it as a tracked one."""

    def assess(self, measurement: Measurement, assessment: Assessment) -> Assessment:
        """Assessment of a frame in which the target is not tracked."""
        return assessment

    def redraw_box(self, state: FilterState, assessment: Assessment) -> NDArray[np.float64] | None:
        """(4,) box, pixels, to redraw the particles around; None to keep the particles."""
        return None

    def next_particles(
        self,
        state: FilterState,
        assessment: Assessment,
        particles: ParticleSet,
        kalman_filter: KalmanFilter | None,
    ) -> tuple[ParticleSet, KalmanFilter | None]:
        """Particles and Kalman filter to predict the next frame from, after resampling."""
        return particles, kalman_filter


OCCLUSION_POLICIES = Registry[OcclusionPolicy]("occlusion policy")


@OCCLUSION_POLICIES.register("coast")
class Coast(OcclusionPolicy):
    """The motion model alone moves the particles.

    A lost target is predicted from the same particles in every frame: predicted on and on, their
    variance and the cost would grow without bound.
    """

    def assess(self, measurement: Measurement, assessment: Assessment) -> Assessment:
        """See `OcclusionPolicy.assess`."""
        predicted = measurement.frame_prediction.prediction.particles
        motion = measurement.state.motion
        box, boxes = motion.boxes(predicted.mean[None])[0], motion.boxes(predicted.states)
        return assessment._replace(box=box, particles=predicted, boxes=boxes, learns=False)

    def next_particles(
        self,
        state: FilterState,
        assessment: Assessment,
        particles: ParticleSet,
        kalman_filter: KalmanFilter | None,
    ) -> tuple[ParticleSet, KalmanFilter | None]:
        """See `OcclusionPolicy.next_particles`."""
        # After a change of the number of particles, the resampled ones have the new number.
        if assessment.status.state == "lost" and len(particles) == len(state.particles):
            return state.particles, state.kalman_filter
        return particles, kalman_filter


@OCCLUSION_POLICIES.register("keep_tracking")
class KeepTracking(OcclusionPolicy):
    """The likeliest box is tracked on; the state warns that it may not be the target.

    This finds a target that reappears nearby sooner.
    """

    def redraw_box(self, state: FilterState, assessment: Assessment) -> NDArray[np.float64] | None:
        """See `OcclusionPolicy.redraw_box`.

        A lost target keeps its last seen size, which would else adapt to any other object.
        """
        if assessment.status.state != "lost":
            return None
        size = np.array(state.last_seen_box[2:])
        return np.hstack([assessment.box[:2] + (assessment.box[2:] - size) / 2, size])
