"""A bare subscriber: publishes a polygon for every image, which measures ROS' share of a frame.

python benchmarks/node_runs/bare_subscriber.py reliable
"""

from __future__ import annotations

import sys

import rclpy
from geometry_msgs.msg import Point32, PolygonStamped
from rclpy.executors import ExternalShutdownException
from rclpy.node import Node
from rclpy.qos import QoSProfile, ReliabilityPolicy
from sensor_msgs.msg import Image

# As the tracker subscribes.
DEPTHS = {"reliable": 2, "best_effort": 1}


class BareSubscriber(Node):
    """Answers every image.

    Args:
        reliability: Of its subscription, a key of `DEPTHS`.
    """

    def __init__(self, reliability: str) -> None:
        super().__init__("bare")
        self._publisher = self.create_publisher(PolygonStamped, "~/box", 10)
        quality = QoSProfile(
            depth=DEPTHS[reliability], reliability=ReliabilityPolicy[reliability.upper()]
        )
        self.create_subscription(Image, "image", self._on_image, quality)

    def _on_image(self, image: Image) -> None:
        answer = PolygonStamped(header=image.header)
        answer.polygon.points = [Point32()] * 4
        self._publisher.publish(answer)


def main() -> None:
    """Run until SIGINT."""
    rclpy.init()
    try:
        rclpy.spin(BareSubscriber(sys.argv[1]))
    except (KeyboardInterrupt, ExternalShutdownException):
        pass
    except RuntimeError:
        # A signal takes the context away while it answers.
        if rclpy.ok():
            raise
    finally:
        rclpy.try_shutdown()


if __name__ == "__main__":
    main()
