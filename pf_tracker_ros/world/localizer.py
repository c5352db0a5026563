"""Position of a target in one frame, from its box and a depth image.

1. The edges of the box inside the image say where the target stands and ends (`box_edges`).
2. Ground and height give the distance from the box alone (`fusion`).
3. They, or a prediction, help to choose the target's pixels in the depth image (`depth`).
4. All are fused by their covariance. Without a foot in the image, the position is below the point
   in the depth image; without a depth either, there is none.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping, Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pf_tracker_ros.boxes import Box
from pf_tracker_ros.world.box_edges import BoxEdges
from pf_tracker_ros.world.box_samples import BoxSamples
from pf_tracker_ros.world.camera_model import CameraModel
from pf_tracker_ros.world.depth import (
    DepthReading,
    ExpectedDepth,
    check_depth,
    read_depth,
    share_nearer,
)
from pf_tracker_ros.world.fusion import (
    TO_MIDDLE,
    Surface,
    TargetHeight,
    box_measurements,
    foot_position,
    fuse,
    position_below,
)
from pf_tracker_ros.world.ground_plane import GroundPlane
from pf_tracker_ros.world.place import Bearing, Place
from pf_tracker_ros.world.target_colors import color_probability
from pf_tracker_ros.world.view import View

METHODS = ("ground", "height", "depth")

# Width of a person's box and its standard deviation, shares of the person's height.
_WIDTH, _WIDTH_SD = 0.29, 0.11
# Least and largest height of a target, meters; the largest is also that of its standard deviation.
_LEAST_HEIGHT, _LARGEST_HEIGHT = 1e-3, 1e3
# Standard deviation of a prediction, as a share of its distance, from which on it says nothing.
_VAGUE_ABOVE = 0.25
# Largest range of a position, meters: beyond, the box says nothing.
_FARTHEST = 1e4
# Likelihood that a target is not where its box says: it sits, or is partly hidden.
_UNEXPECTED = 0.05


class Localizer:
    """Positions of targets before one camera.

    Args:
        camera: Its calibration.
        camera_height: Height above the ground, meters; None where the ground is unknown.
        camera_pitch: Radians; positive looks down.
        camera_roll: Radians; positive lowers the right side.
        target_height: Expected height of a target, meters.
        target_height_sd: Standard deviation of that among targets, meters.
        tilt_sd: Standard deviation of pitch and roll against the ground, radians; None means a
            value for the camera's height: a vehicle below 3 m, a fixed camera above.
        plane: The ground in place of `camera_height`, `camera_pitch`, `camera_roll` and `tilt_sd`.

    Raises:
        ValueError: A number is not finite or out of its range.

    Example:
        A person of 1.75 m whose feet are 5 m before a level camera, 1.5 m above the ground:

        >>> from pf_tracker_ros.world import CameraModel, Localizer
        >>> camera = CameraModel(500.0, 500.0, 320.0, 240.0, 640, 480)
        >>> localizer = Localizer(camera, camera_height=1.5)
        >>> place = localizer.locate((300, 215, 40, 175))
        >>> place.method, bool(abs(place.position - (0.0, 1.5, 5.0)).max() < 0.2)
        ('ground+height', True)
    """

    def __init__(  # noqa: PLR0917 (the interface is fixed)
        self,
        camera: CameraModel,
        camera_height: float | None = 1.65,
        camera_pitch: float = 0.0,
        camera_roll: float = 0.0,
        target_height: float = 1.75,
        target_height_sd: float = 0.1,
        *,
        tilt_sd: float | None = None,
        plane: GroundPlane | None = None,
    ) -> None:
        if not (
            _LEAST_HEIGHT <= target_height <= _LARGEST_HEIGHT
            and 0.0 <= target_height_sd <= _LARGEST_HEIGHT
        ):
            raise ValueError(
                f"target_height is {target_height!r} and target_height_sd {target_height_sd!r}; "
                f"expected {_LEAST_HEIGHT:g} to {_LARGEST_HEIGHT:g} meters, and 0 to "
                f"{_LARGEST_HEIGHT:g}"
            )
        self.camera = camera
        self.plane = plane or GroundPlane.from_angles(
            camera_height, camera_pitch, camera_roll, tilt_sd
        )
        self._target_height = TargetHeight(float(target_height), float(target_height_sd))
        self._image_size = camera.width, camera.height

    def bearing(self, box: ArrayLike, box_covariance: ArrayLike | None = None) -> Bearing | None:
        """The direction of a box's center, which needs no distance.

        Args:
            box: See `locate`.
            box_covariance: See `locate`.

        Returns:
            None where the box is outside the image or the camera model.

        Raises:
            ValueError: An argument has a wrong shape or range.
        """
        edges = BoxEdges.of(box, box_covariance, self._image_size)
        if edges is None:
            return None
        rays, jacobians = self.camera.rays_with_jacobians(edges.points()[2:])
        return Bearing.of(rays[0], jacobians[0], edges.center_covariance())

    def locate(
        self,
        box: ArrayLike,
        box_covariance: ArrayLike | None = None,
        image: NDArray[np.generic] | None = None,
        depth: NDArray[np.generic] | None = None,
        *,
        target_probability: NDArray[np.generic] | None = None,
        predicted_range: tuple[float, float] | None = None,
        methods: Collection[str] = METHODS,
        plane: GroundPlane | None = None,
    ) -> Place | None:
        """The place of a target in one frame.

        Args:
            box: (x, y, width, height) in pixels, (x, y) the top-left corner counted from 0.
            box_covariance: (4, 4) of center x, center y, width and height, or (2, 2) of the center,
                px^2; None means that of a good detector.
            image: (H, W, 3) uint8 BGR, for the colors of the target; used only with depth and
                without `target_probability`.
            depth: (H, W) float in meters or uint16 in millimeters along the optical axis,
                registered to the image, of the same field of view in any resolution. 0, NaN and
                infinity are holes.
            target_probability: (rows, columns) probability, 0 to 1, of a pixel to be the target's,
                over the box in any resolution.
            predicted_range: Predicted distance from the camera to the middle of the box, and its
                standard deviation, meters: chooses between modes of the depth, and is not in the
                result. Of a standard deviation above a quarter of the distance, it says nothing.
            methods: What to use of `METHODS`.
            plane: The ground in this frame, in place of the constructor's.

        Returns:
            None where nothing can be said of the position, or the range is above 10 km.

        Raises:
            ValueError: An argument has a wrong type, shape or range.
        """
        unknown = set(methods) - set(METHODS)
        if unknown:
            raise ValueError(f"methods has '{unknown.pop()}'; allowed: {', '.join(METHODS)}")
        edges = BoxEdges.of(box, box_covariance, self._image_size)
        if edges is None:
            return None
        view = View.of(self.camera, edges, plane or self.plane)
        bearing = Bearing.of(view.rays[2], view.jacobians[2], edges.center_covariance())
        if bearing is None:
            return None
        inverses = box_measurements(view, self._target_height)
        usable = {name: value for name, value in inverses.items() if name in methods}
        surface, reading, depth_sd = None, None, 0.0
        if depth is not None and "depth" in methods:
            expected = (
                self._predicted_depth(view, predicted_range),
                self._depth_by_box(view, inverses),
            )
            reading = self._read_depth(
                edges.box,
                depth,
                image,
                target_probability,
                [one for one in expected if one is not None],
            )
            if reading is not None:
                surface = self._surface(edges, view.plane, reading)
        if surface is not None and view.has_foot and surface.shows_distance:
            usable["depth"], depth_sd = 1.0 / (surface.distance + TO_MIDDLE), surface.sd
        if usable:
            fused = fuse(view, usable, self._target_height, depth_sd)
            position, covariance = foot_position(view, fused)
            used = fused.methods
        elif surface is not None:
            position, covariance = position_below(view, surface, self._target_height)
            used = ("depth",)
        else:
            return None
        # A comparison with NaN is false.
        if not (
            math.hypot(*position.tolist()) <= _FARTHEST and math.isfinite(float(covariance.sum()))
        ):
            return None
        return Place(
            position,
            covariance,
            "+".join(name for name in METHODS if name in used),
            bearing.direction,
            bearing.covariance,
            None if reading is None else reading.occlusion,
            reading is not None and reading.is_unseen,
        )

    def covered_share(
        self, box: ArrayLike, depth: NDArray[np.generic], predicted_range: tuple[float, float]
    ) -> float | None:
        """The share, 0 to 1, of a box that something in front of the predicted target covers.

        For a target that the image does not show, and whose box is thus no measurement.

        Args:
            box: See `locate`.
            depth: See `locate`.
            predicted_range: See `locate`.

        Returns:
            None where the box is outside the image, has too few pixels with a depth, or the
            prediction is vague.

        Raises:
            ValueError: An argument has a wrong type, shape or range.
        """
        edges = BoxEdges.of(box, None, self._image_size)
        if edges is None:
            return None
        expected = self._predicted_depth(View.of(self.camera, edges, self.plane), predicted_range)
        if expected is None:
            return None
        depth = check_depth(depth, self._image_size)
        samples = BoxSamples.of(edges.box, self._image_size, depth.shape)
        return share_nearer(depth, samples, expected)

    def _predicted_depth(
        self, view: View, predicted_range: tuple[float, float] | None
    ) -> ExpectedDepth | None:
        """What the prediction says of the depth along the optical axis; None if it is vague."""
        forward = float(view.rays[2, 2])
        if predicted_range is None or forward <= 0.0:
            return None
        try:
            mean, sd = map(float, predicted_range)
        except (TypeError, ValueError):
            mean = sd = math.nan
        if not (0.0 < mean < math.inf and 0.0 <= sd < math.inf):
            raise ValueError(
                f"predicted_range is {predicted_range!r}; expected a positive distance and a "
                "standard deviation from 0 up, in meters"
            )
        return None if sd > _VAGUE_ABOVE * mean else ExpectedDepth(mean * forward, sd * forward)

    def _depth_by_box(self, view: View, inverses: Mapping[str, float]) -> ExpectedDepth | None:
        """What the box says of the depth along the optical axis; None behind the camera."""
        forward = float(view.rays[2, 2])
        if forward <= 0.0:
            return None
        if not inverses:
            # A part of a person is about as wide as the whole.
            angle = view.edges.box[2] * float(np.linalg.norm(view.jacobians[2, :, 0]))
            scale = self._target_height.mean / angle * forward
            return ExpectedDepth(_WIDTH * scale, _WIDTH_SD * scale, _UNEXPECTED)
        fused = fuse(view, inverses, self._target_height)
        scale = forward / float(view.horizontal[2])
        # A box that contains a part of the target is of a nearer one than its height says.
        return ExpectedDepth(
            fused.distance * scale, fused.sd * scale, _UNEXPECTED, "ground" not in inverses
        )

    def _read_depth(
        self,
        box: Box,
        depth: NDArray[np.generic],
        image: NDArray[np.generic] | None,
        target_probability: NDArray[np.generic] | None,
        expected: Sequence[ExpectedDepth],
    ) -> DepthReading | None:
        depth = check_depth(depth, self._image_size)
        samples = BoxSamples.of(box, self._image_size, depth.shape)
        if target_probability is None and image is not None:
            target_probability = color_probability(image, box, self._image_size)
        probability = None
        if target_probability is not None:
            probability = samples.resample(np.asarray(target_probability))
        return read_depth(depth, samples, probability, expected)

    def _surface(
        self, edges: BoxEdges, plane: GroundPlane, reading: DepthReading
    ) -> Surface | None:
        """The point in the depth image in the middle of the target; None where it is not seen."""
        if reading.depth is None:
            return None
        pixel = edges.middle - 0.5, edges.upper + reading.row * edges.box[3] - 0.5
        rays, jacobians = self.camera.rays_with_jacobians([pixel])
        ray = rays[0]
        if not ray[2] > 0.0:
            return None
        length = reading.depth / float(ray[2])
        horizontal = math.sqrt(max(1.0 - float(ray @ plane.down) ** 2, 0.0))
        return Surface(
            length * ray,
            length * horizontal,
            reading.sd / reading.depth * length * horizontal,
            length * jacobians[0, :, 0],
        )
