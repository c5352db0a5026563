"""Both transports of images, through a live node."""

from array import array

import cv2
import numpy as np
import pytest
from nodes import corner
from sensor_msgs.msg import CompressedImage

QUICK = {
    "preset": "li2007",
    "particles": 40,
    "track__wrong_box_cost": 0.0,
    "image_reliability": "reliable",
}


class Compressed:
    """Sends compressed images to the tracker of a client."""

    def __init__(self, client):
        self._client = client
        self._publisher = client.create_publisher(CompressedImage, "image/compressed", 10)

    def show(self, data, stamp, image_format="jpeg"):
        message = CompressedImage(format=image_format, data=array("B", bytes(data)))
        message.header.stamp.sec, message.header.stamp.nanosec = divmod(stamp, 10**9)
        before = len(self._client.statuses)
        self._publisher.publish(message)

        def found():
            return [s for s in self._client.statuses[before:] if s.stamp == stamp]

        return self._client.wait_for(found, "status of a compressed image")[0]


@pytest.fixture
def compressed(client):
    return Compressed(client)


def png(image):
    return cv2.imencode(".png", image)[1]


def test_compressed_images_give_the_boxes_of_the_same_raw_ones(
    graph, client, compressed, images, box
):
    node = graph.tracker(client, **QUICK)
    kinds = {"color": images[:4], "thermal": (images[:4].mean(axis=3) * 250).astype(np.uint16)}
    for kind, frames in kinds.items():
        boxes = []
        for transport in ("raw", "compressed"):
            client.boxes.clear()
            client.set_parameters(image_transport=transport, target_box=[*box])
            graph.introduce(client, node)
            for index, frame in enumerate(frames):
                if transport == "raw":
                    client.show(frame, client.at(index), "bgr8" if kind == "color" else "mono16")
                else:
                    compressed.show(png(frame), client.at(index))
            boxes.append([client.box_at(client.at(index)).polygon for index in range(4)])
            client.set_parameters(target_box=[0.0, 0.0, 10.0, 10.0])
        assert boxes[0] == boxes[1]


def test_jpeg_is_tracked_and_damaged_data_refused(graph, client, compressed, moving_square):
    target_box = list(moving_square.boxes[0])
    graph.tracker(client, target_box=target_box, image_transport="compressed", **QUICK)
    jpegs = [cv2.imencode(".jpg", image)[1].tobytes() for image in moving_square.images[:6]]
    bomb = bytearray(jpegs[1])
    at = bomb.index(b"\xff\xc0") + 5
    bomb[at : at + 4] = b"\x7f\xf0\x7f\xf0"
    assert compressed.show(jpegs[0], client.at(0)).values["frame"] == "started"
    for data in (jpegs[1][:-50], png(np.zeros((9, 9), np.uint8)), bomb):
        status = compressed.show(data, client.at(1) - 1_000_000)
        assert (status.level, status.values["frame"]) == ("ERROR", "refused")
    assert "declares 32752 x 32752 px" in status.message
    for index, jpeg in enumerate(jpegs[1:], start=1):
        assert compressed.show(jpeg, client.at(index)).values["frame"] == "tracked"
    assert corner(client.box_at(client.at(5))) == pytest.approx(moving_square.boxes[5][:2], abs=5)


def test_the_limit_of_compressed_images_can_change_at_run_time(graph, client, compressed, images):
    graph.tracker(client, image_transport="compressed", max_image_pixels=100, **QUICK)
    status = compressed.show(png(images[0]), client.at(0))
    assert "160 x 120 px; allowed: 100 px in all" in status.message
    assert client.set_parameters(max_image_pixels=160 * 120).successful
    assert compressed.show(png(images[0]), client.at(1)).level == "OK"


@pytest.mark.parametrize(
    ("remapping", "topic"),
    [
        ("image:=/camera/image_raw", "/camera/image_raw/compressed"),
        ("image/compressed:=/camera/jpeg", "/camera/jpeg"),
        ("unrelated:=/camera/other", "/image/compressed"),
    ],
)
def test_compressed_images_follow_the_remapping_of_raw_ones(graph, remapping, topic):
    node = graph.tracker(
        cli_args=["--ros-args", "-r", remapping], image_transport="compressed", **QUICK
    )
    assert topic in [subscription.topic_name for subscription in node.subscriptions]
