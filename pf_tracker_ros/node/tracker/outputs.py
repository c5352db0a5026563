"""What the node publishes of each frame besides its status."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any, NamedTuple

from geometry_msgs.msg import PolygonStamped
from numpy.typing import NDArray
from rclpy.node import Node
from rclpy.publisher import Publisher
from sensor_msgs.msg import Image, PointCloud2
from std_msgs.msg import Header
from visualization_msgs.msg import MarkerArray

from pf_tracker_ros.node.message_building import (
    box_message,
    boxes_message,
    image_message,
    likelihood_message,
    particles_message,
)
from pf_tracker_ros.node.qos import DEFAULT_QOS, Report, advertise
from pf_tracker_ros.node.tracker.detections import DETECTIONS_TYPE, detections_message
from pf_tracker_ros.node.tracker.drawing import DrawingThread
from pf_tracker_ros.overlay import draw_tracked
from pf_tracker_ros.targets.tracked_target import TrackedTarget
from pf_tracker_ros.tracking.likelihood_map import LikelihoodMap


class Looked(NamedTuple):
    """A frame that was looked at, and what was made of it.

    Attributes:
        header: Of the image.
        image: As for `Tracker.update`.
        targets: All that there are.
        selected: The target that a robot acts on, and that one topic is about; None without.
        has_several: Whether there may be several targets.
    """

    header: Header
    image: NDArray[Any]
    targets: Sequence[TrackedTarget]
    selected: TrackedTarget | None
    has_several: bool

    @property
    def present(self) -> list[TrackedTarget]:
        """The targets that are not lost."""
        return [target for target in self.targets if target.estimate.state != "lost"]


@dataclass(frozen=True)
class Output:
    """One topic.

    Attributes:
        topic: Its name.
        type: Of its messages.
        message: Makes the message of a frame; None where there is none to be published.
    """

    topic: str
    type: Any
    message: Callable[[Looked], Any]


def _box(looked: Looked) -> PolygonStamped | None:
    target = looked.selected
    if target is None or target.estimate.state == "lost":
        return None
    return box_message(target.estimate.box, looked.header)


def _particles(looked: Looked) -> PointCloud2 | None:
    return particles_message(looked.targets, looked.header) if looked.targets else None


def _overlay(looked: Looked) -> Image:
    drawn = draw_tracked(looked.image, looked.targets, has_several=looked.has_several)
    return image_message(drawn, looked.header)


# What others act on, which goes out before the status, ...
ACTED_ON = (
    Output("~/box", PolygonStamped, _box),
    Output("~/boxes", MarkerArray, lambda looked: boxes_message(looked.present, looked.header)),
    *(
        [
            Output(
                "~/detections",
                DETECTIONS_TYPE,
                lambda looked: detections_message(looked.present, looked.header),
            )
        ]
        if DETECTIONS_TYPE
        else []
    ),
)
# ... and what people look at, which goes out after it.
LOOKED_AT = (Output("~/particles", PointCloud2, _particles),)


class Outputs:
    """The publishers of one configured node; closed, they are gone.

    A message is made only where somebody listens.

    Args:
        node: The node that publishes.
        report: Called with a sentence if a subscriber cannot be reached.
    """

    def __init__(self, node: Node, report: Report) -> None:
        self._node = node
        make = partial(advertise, node, profile=DEFAULT_QOS, report=report)
        self._publishers: dict[str, Publisher] = {
            output.topic: make(output.type, output.topic) for output in (*ACTED_ON, *LOOKED_AT)
        }
        self._overlay = make(Image, "~/overlay")
        self._drawing = DrawingThread(self._overlay, report)
        self._likelihood = make(Image, "~/likelihood")

    def publish(self, looked: Looked, outputs: Sequence[Output] = ACTED_ON) -> None:
        """Publish what there is to say of a frame on some topics."""
        for output in outputs:
            publisher = self._publishers[output.topic]
            if publisher.get_subscription_count():
                message = output.message(looked)
                if message is not None:
                    publisher.publish(message)

    def show(self, looked: Looked) -> None:
        """Publish what people look at, particles and overlay."""
        self.publish(looked, LOOKED_AT)
        if self._overlay.get_subscription_count():
            self._drawing.draw(partial(_overlay, looked))

    @property
    def wants_likelihood(self) -> bool:
        """Whether somebody listens to the likelihood around the target."""
        return bool(self._likelihood.get_subscription_count())

    def publish_likelihood(self, likelihood: LikelihoodMap, header: Header) -> None:
        """Publish the likelihood around the target."""
        self._likelihood.publish(likelihood_message(likelihood, header))

    def close(self) -> None:
        """Withdraw the topics."""
        self._drawing.close()
        for publisher in (*self._publishers.values(), self._overlay, self._likelihood):
            self._node.destroy_publisher(publisher)
