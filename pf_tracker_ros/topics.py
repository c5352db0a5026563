"""The published result of a frame, for the node and for bag writers.

`OUTPUT_TOPICS` starts with the topics that robots act on. The status is not among them, because
skipped frames have one, too. `pf_tracker_ros.messages` describes the argument `new`.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from pf_tracker_ros.messages import (
    DETECTIONS_TYPE,
    IMAGE_TYPE,
    MARKERS_TYPE,
    POINTS_TYPE,
    POLYGON_TYPE,
    BoxMarker,
    MessageFactory,
    Status,
    box_message,
    hypothesis_message,
    image_message,
    markers_message,
    particles_message,
)
from pf_tracker_ros.overlay import draw_tracked, target_caption, target_color
from pf_tracker_ros.targets.session import DROPPED_ARRIVALS, estimate_of
from pf_tracker_ros.targets.tracked_target import (
    TrackedTarget,
    common_values,
    overall_state,
    severity,
    target_values,
)
from pf_tracker_ros.tracking.estimate import DESCRIPTIONS, Estimate
from pf_tracker_ros.tracking.likelihood_map import LikelihoodMap
from pf_tracker_ros.world.box_edges import BoxEdges
from pf_tracker_ros.world.target_colors import color_probability

_LINE_WIDTH = 2.0
# Class of a target without a label.
_UNLABELED = "target"

SKIPPED = ("refused", *DROPPED_ARRIVALS, "frozen", "paused")
"""Outcomes of skipped frames; "paused" is the node's alone."""

StatusValues = dict[str, str | float | int]


@dataclass(frozen=True, eq=False, kw_only=True)
class FrameResult:
    """The result after a frame.

    Attributes:
        targets: All targets in the order of their ids.
        selected: Id of the target that a robot acts on, 0 without.
        max_targets: Maximum number of targets.
        detector_runs: Number of detector outputs so far.
        image: As for `Tracker.update`; None if it is not drawn.
        likelihood: Around the selected target, None if it is not requested.
    """

    targets: tuple[TrackedTarget, ...] = ()
    selected: int = 0
    max_targets: int = 1
    detector_runs: int = 0
    image: NDArray[Any] | None = None
    likelihood: LikelihoodMap | None = None

    @property
    def estimate(self) -> Estimate | None:
        """Estimate of the selected target, None without one."""
        return estimate_of(self.targets, self.selected)

    @property
    def state(self) -> str:
        """State of the selected target, else of the best visible one; `idle` without targets."""
        return overall_state(self.targets, self.selected)

    @property
    def present(self) -> list[TrackedTarget]:
        """The targets that are not lost."""
        return [target for target in self.targets if target.estimate.state != "lost"]

    @property
    def values(self) -> StatusValues:
        """Values of the status for the frame and the selected target."""
        values = common_values(self.targets, self.selected, self.detector_runs, self.estimate)
        if self.image is not None:
            values["image_height"], values["image_width"] = self.image.shape[:2]
        return values | likelihood_values(self.likelihood) if self.likelihood else values

    def target_statuses(self, node: str) -> list[Status]:
        """A status for each target; `node` is the fully qualified name of the node."""
        return [
            Status(
                f"{node}: target {target.id}",
                severity(target),
                DESCRIPTIONS[target.estimate.state],
                target_values(target),
            )
            for target in self.targets
        ]

    def draw(self) -> NDArray[np.uint8]:
        """The image with the targets drawn into it, (H, W, 3) uint8 BGR.

        Raises:
            ValueError: There is no image.
        """
        if self.image is None:
            raise ValueError("the result has no image to draw on")
        multi_target = self.max_targets > 1
        return draw_tracked(self.image, self.targets, self.selected, multi_target=multi_target)


class OutputTopic(NamedTuple):
    """A topic of each frame.

    Attributes:
        name: Name of the topic, below the node's name.
        message_type: As `package/msg/Name`.
        build: Builds the message from `new`, a header and a result; None without a message, such
            as the box of a lost target.
        is_visualization: Whether it is for display only, and may follow the other topics.
    """

    name: str
    message_type: str
    build: Callable[[MessageFactory, Any, FrameResult], Any]
    is_visualization: bool = False


def _box(new: MessageFactory, header: Any, result: FrameResult) -> Any:
    estimate = result.estimate
    if estimate is None or estimate.state == "lost":
        return None
    return box_message(new, header, estimate.box)


def _boxes(new: MessageFactory, header: Any, result: FrameResult) -> Any:
    markers = []
    for target in result.present:
        blue, green, red = (value / 255.0 for value in target_color(target.id))
        color = (red, green, blue, 1.0 if target.estimate.state == "tracking" else 0.5)
        width = 2 * _LINE_WIDTH if target.id == result.selected else _LINE_WIDTH
        box, text = target.estimate.box, target_caption(target)
        markers.append(BoxMarker(target.id, box, text, color, width))
    return markers_message(new, header, markers)


def _detections(new: MessageFactory, header: Any, result: FrameResult) -> Any:
    detections = [_detection(new, header, target) for target in result.present]
    return new(DETECTIONS_TYPE, header=header, detections=detections)


def _detection(new: MessageFactory, header: Any, target: TrackedTarget) -> Any:
    """A target as a Detection2D; its score is the confidence.

    The first two rows and columns of the pose's covariance are those of the center, px^2.
    """
    estimate = target.estimate
    x, y, width, height = estimate.box
    center = {"x": x + width / 2, "y": y + height / 2}
    position = new("vision_msgs/msg/Point2D", **center)
    bbox = new(
        "vision_msgs/msg/BoundingBox2D",
        center=new("vision_msgs/msg/Pose2D", position=position),
        size_x=width,
        size_y=height,
    )
    covariance = np.zeros((6, 6))
    covariance[:2, :2] = estimate.covariance
    pose = new("geometry_msgs/msg/Pose", position=new("geometry_msgs/msg/Point", **center))
    label, score = target.label or _UNLABELED, float(estimate.confidence)
    result = hypothesis_message(new, label, score, pose, covariance)
    fields = {"header": header, "bbox": bbox, "results": [result], "id": str(target.id)}
    return new("vision_msgs/msg/Detection2D", **fields)


def _particles(new: MessageFactory, header: Any, result: FrameResult) -> Any:
    """Particles of all targets."""
    if not result.targets:
        return None
    estimates = [target.estimate for target in result.targets]
    counts = [len(estimate.weights) for estimate in estimates]
    ids = np.repeat([target.id for target in result.targets], counts)
    boxes = np.vstack([estimate.particle_boxes for estimate in estimates])
    weights = np.concatenate([estimate.weights for estimate in estimates])
    return particles_message(new, header, boxes, weights, ids)


def _overlay(new: MessageFactory, header: Any, result: FrameResult) -> Any:
    return None if result.image is None else image_message(new, header, result.draw())


def _likelihood(new: MessageFactory, header: Any, result: FrameResult) -> Any:
    """Fused log likelihood around the selected target, one pixel for each candidate center."""
    if result.likelihood is None:
        return None
    return image_message(new, header, result.likelihood.log_likelihood.astype(np.float32))


def target_probability(result: FrameResult) -> NDArray[np.uint8] | None:
    """Probability of each pixel of the selected target's box to be its own; 255 is 1.

    The box is the part of the estimate inside the image, in a coarser resolution. Only color images
    have one.
    """
    estimate, image = result.estimate, result.image
    if estimate is None or estimate.state == "lost" or image is None or image.ndim != 3:
        return None
    size = image.shape[1], image.shape[0]
    edges = BoxEdges.of(estimate.box, None, size)
    if edges is None:
        return None
    probability = color_probability(image, edges.box, size)
    return np.rint(255.0 * probability).astype(np.uint8)


def _target_probability(new: MessageFactory, header: Any, result: FrameResult) -> Any:
    probability = target_probability(result)
    return None if probability is None else image_message(new, header, probability)


def likelihood_values(likelihood: LikelihoodMap) -> StatusValues:
    """Extent of the likelihood image and the cues' likelihoods, under the keys of the status."""
    x, y, side, _ = likelihood.extent
    values: StatusValues = {"likelihood_x": x, "likelihood_y": y, "likelihood_side": side}
    for name, cue in likelihood.cues.items():
        values[f"at_target_{name}"] = cue.at_target
        values[f"at_second_peak_{name}"] = cue.at_second_peak
    return values


OUTPUT_TOPICS: Sequence[OutputTopic] = (
    OutputTopic("box", POLYGON_TYPE, _box),
    OutputTopic("boxes", MARKERS_TYPE, _boxes),
    OutputTopic("detections", DETECTIONS_TYPE, _detections),
    OutputTopic("target_probability", IMAGE_TYPE, _target_probability),
    OutputTopic("likelihood", IMAGE_TYPE, _likelihood),
    OutputTopic("particles", POINTS_TYPE, _particles, is_visualization=True),
    OutputTopic("overlay", IMAGE_TYPE, _overlay, is_visualization=True),
)
"""All topics besides the status."""
