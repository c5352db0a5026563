"""A target by the boxes of the tracker, located as by the node `localizer`."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pf_tracker_ros import Estimate, Tracker
from pf_tracker_ros.localization.localizer_parameters import LocalizerParameters
from pf_tracker_ros.localization.tracker_frame import ReportedTarget, TrackerFrame
from pf_tracker_ros.localization.world_tracks import LocatedTarget, Sensed, WorldTracks
from pf_tracker_ros.stamps import NANOSECONDS
from pf_tracker_ros.world import in_fixed_frame
from world_parts.errors import Array, Errors

_KINDS = ("position of a frame, m", "filtered, m", "velocity, m/s")


class LocatedTracker:
    """Tracks a target with the preset `default` and locates it.

    Args:
        image: First image.
        box: Of the target in it.
        interval: Between two frames, seconds.
        seed: Of the tracker.
    """

    def __init__(
        self, image: NDArray[np.generic], box: ArrayLike, interval: float, seed: int
    ) -> None:
        self._tracker, self._tracks = Tracker.from_preset("default", seed=seed), WorldTracks()
        self._interval, self._time = interval, 1.0
        self._tracker.start(image, box)

    def update(self, image: NDArray[np.generic], sensed: Sensed) -> tuple[Estimate, LocatedTarget]:
        """Track and locate the target in the next frame."""
        estimate = self._tracker.update(image, dt=self._interval)
        self._time += self._interval
        target = ReportedTarget(
            1, "", estimate.state, estimate.confidence, estimate.box, estimate.box_covariance
        )
        stamp = round(self._time * NANOSECONDS)
        frame = TrackerFrame(stamp, "camera", False, estimate.state, 1, None, (target,))
        (located,) = self._tracks.advance(frame, sensed, LocalizerParameters())
        return estimate, located


class TrackedErrors:
    """Errors of the positions and velocities of located targets."""

    def __init__(self) -> None:
        self._errors: dict[str, list[Array]] = {kind: [] for kind in _KINDS}
        self._covariances: dict[str, list[Array]] = {kind: [] for kind in _KINDS}

    def add(self, located: LocatedTarget, sensed: Sensed, position: Array, velocity: Array) -> None:
        """Add a frame in which the box is on the target.

        Args:
            located: Of the frame.
            sensed: As of the frame.
            position: (2,) true one, meters.
            velocity: (2,) true one, meters per second; NaN where it is unknown.
        """
        if located.place:
            pose = sensed.pose.pose
            fixed = in_fixed_frame(located.place, pose.rotation, pose.translation)
            self._add(_KINDS[0], fixed.mean[:2] - position, fixed.covariance[:2, :2])
        if located.silence or not located.world:
            return
        filtered = located.world.filtered
        self._add(_KINDS[1], filtered.position - position, filtered.covariance[:2, :2])
        if np.isfinite(velocity).all():
            self._add(_KINDS[2], filtered.velocity - velocity, filtered.covariance[2:, 2:])

    def rows(self) -> list[list[str]]:
        """A row of a table for each kind of error."""
        return [
            [
                kind,
                *Errors.of(
                    np.reshape(self._errors[kind], (-1, 2)),
                    np.reshape(self._covariances[kind], (-1, 2, 2)),
                ).cells(),
            ]
            for kind in _KINDS
        ]

    def _add(self, kind: str, error: Array, covariance: Array) -> None:
        self._errors[kind].append(error)
        self._covariances[kind].append(covariance)


def central_velocities(positions: Array, interval: float) -> Array:
    """(N, 2) velocities of (N, 2) positions by central differences over six frames; else NaN."""
    velocities = np.full(positions.shape, np.nan)
    velocities[3:-3] = (positions[6:] - positions[:-6]) / (6.0 * interval)
    return velocities
