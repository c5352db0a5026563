"""The profile for large images lets best-effort frames through that get lost without it."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

pytest.importorskip("rclpy")
PROFILE = Path(__file__).resolve().parents[2] / "config" / "fastdds_large_images.xml"
FRAMES = 20

# Publishes each frame after the answer to the last one, so that a slow machine loses none.
PUBLISHER = """
import array, sys, time
import rclpy
from rclpy.qos import QoSProfile, ReliabilityPolicy
from sensor_msgs.msg import Image
from std_msgs.msg import String

rclpy.init()
node = rclpy.create_node("publisher")
answers = []
node.create_subscription(String, "answer", lambda answer: answers.append(answer.data), 10)
quality = QoSProfile(depth=1, reliability=ReliabilityPolicy.BEST_EFFORT)
publisher = node.create_publisher(Image, "image", quality)
frame = Image(height=1080, width=1920, encoding="bgr8", step=3 * 1920)
frame.data = array.array("B", bytes(3 * 1920 * 1080))


def is_answered(number, seconds):
    frame.header.frame_id, deadline = str(number), time.monotonic() + seconds
    publisher.publish(frame)
    while frame.header.frame_id not in answers and time.monotonic() < deadline:
        rclpy.spin_once(node, timeout_sec=0.05)
    return frame.header.frame_id in answers


# With an answer to one of the first, both sides have discovered each other.
deadline = time.monotonic() + 60.0
while not is_answered(-1, 0.5):
    assert time.monotonic() < deadline
print(sum(is_answered(number, 10.0) for number in range(int(sys.argv[1]))))
"""

SUBSCRIBER = """
import rclpy
from rclpy.qos import QoSProfile, ReliabilityPolicy
from sensor_msgs.msg import Image
from std_msgs.msg import String

rclpy.init()
node = rclpy.create_node("subscriber")
publisher = node.create_publisher(String, "answer", 10)
quality = QoSProfile(depth=1, reliability=ReliabilityPolicy.BEST_EFFORT)
node.create_subscription(
    Image, "image", lambda image: publisher.publish(String(data=image.header.frame_id)), quality
)
rclpy.spin(node)
"""


def test_full_hd_frames_arrive_without_loss(ros_domain):
    variables = {**os.environ, "FASTRTPS_DEFAULT_PROFILES_FILE": str(PROFILE)}
    with subprocess.Popen([sys.executable, "-c", SUBSCRIBER], env=variables) as subscriber:
        try:
            command = [sys.executable, "-c", PUBLISHER, str(FRAMES)]
            received = subprocess.run(
                command, env=variables, stdout=subprocess.PIPE, check=True, timeout=300
            ).stdout
        finally:
            subscriber.kill()
    assert int(received) >= FRAMES - 1
