"""The publishers of the localizer, each message built only for subscribers."""

from __future__ import annotations

from rclpy.node import Node
from std_msgs.msg import Header

from pf_tracker_ros.localization.located_frame import LocatedFrame
from pf_tracker_ros.localization.position_topics import (
    POSITION_TOPICS,
    Headers,
    certain_target,
)
from pf_tracker_ros.messages import STATUS_TYPE, status_message
from pf_tracker_ros.node.localizer.transforms import Transforms
from pf_tracker_ros.node.messages import message_class, new_message
from pf_tracker_ros.node.qos import LATCHED_QOS, ErrorCallback, advertise, advertise_installed
from pf_tracker_ros.stamps import set_stamp
from pf_tracker_ros.world_messages import TARGET_FRAME, WorldTarget, pose_message


class Outputs:
    """The publishers; without vision_msgs, only `~/detections_3d` is missing.

    Args:
        node: The publishing node.
        transforms: Broadcasts the targets' frames; None where tf2_ros is not installed.
        tracker_status: Full name of the topic of the tracker's status.
        report: Called with a sentence if a QoS override is invalid.
    """

    def __init__(
        self,
        node: Node,
        transforms: Transforms | None,
        tracker_status: str,
        report: ErrorCallback,
    ) -> None:
        self._node = node
        self._transforms = transforms
        self._tracker_status = tracker_status
        types = {topic.name: topic.message_type for topic in POSITION_TOPICS}
        self._publishers = advertise_installed(node, types, report)
        self._status = advertise(
            node, message_class(STATUS_TYPE), "~/status", profile=LATCHED_QOS, report=report
        )

    def publish(self, located: LocatedFrame, fixed_frame: str) -> None:
        """Publish a frame.

        Args:
            located: The frame.
            fixed_frame: Frame of the positions.
        """
        frame = located.frame
        headers = Headers(Header(frame_id=fixed_frame), Header(frame_id=frame.frame_id))
        for header in headers:
            set_stamp(header, frame.stamp)
        for topic in POSITION_TOPICS:
            publisher = self._publishers.get(topic.name)
            if publisher and publisher.get_subscription_count():
                message = topic.build(new_message, headers, located)
                if message is not None:
                    publisher.publish(message)
        self._broadcast(headers.fixed, located)
        own, *others = located.statuses(self._node.get_fully_qualified_name())
        # The tracker takes the covered shares of its own targets only.
        own = own._replace(values={**own.values, "tracker_status": self._tracker_status})
        self._status.publish(status_message(new_message, headers.image, [own, *others]))

    def close(self) -> None:
        """Remove the publishers."""
        for publisher in (*self._publishers.values(), self._status):
            self._node.destroy_publisher(publisher)
        self._publishers.clear()

    def _broadcast(self, header: Header, located: LocatedFrame) -> None:
        if not self._transforms:
            return
        targets: dict[str, WorldTarget] = {
            f"{TARGET_FRAME}_{target.id}": target for target in located.world_targets
        }
        if certain := certain_target(located):
            targets[TARGET_FRAME] = certain
        poses = {
            name: pose_message(new_message, header, target).pose for name, target in targets.items()
        }
        self._transforms.broadcast(header, poses)
