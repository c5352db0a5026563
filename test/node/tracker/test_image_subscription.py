"""Every encoding and transport, through a live node."""

from array import array

import cv2
import numpy as np
import pytest
from sensor_msgs.msg import CompressedImage, Image

from pf_tracker_ros.decoding.image_decoding import ENCODINGS

QUICK = {
    "preset": "li2007",
    "particles": 40,
    "track__wrong_box_cost": 0.0,
    "image_reliability": "reliable",
}


def yuv(image):
    """(H, W) planes Y, U and V by ITU-R BT.601, video levels."""
    blue, green, red = (image[..., channel].astype(float) for channel in range(3))
    y = 16 + 0.257 * red + 0.504 * green + 0.098 * blue
    u = 128 - 0.148 * red - 0.291 * green + 0.439 * blue
    v = 128 + 0.439 * red - 0.368 * green - 0.071 * blue
    return [np.rint(plane).astype(np.uint8) for plane in (y, u, v)]


def half(plane, rows):
    """Every second column and, with `rows` 2, every second row of a plane of colors."""
    return plane[::rows, ::2]


def encoded(image, encoding):
    """A BGR image as rows of bytes of an encoding, without the project's code."""
    gray = image.mean(axis=2)
    if encoding.startswith("bayer"):
        rows, columns = np.indices(gray.shape) % 2
        letters = np.array(list(encoding[6:10])).reshape(2, 2)[rows, columns]
        mosaic = np.choose(
            np.select([letters == "b", letters == "g"], [0, 1], 2), image.T.swapaxes(1, 2)
        )
        return (mosaic.astype("<u2") * 16).view(np.uint8) if encoding.endswith("16") else mosaic
    if encoding in ("mono16", "16UC1"):
        return (gray * 16 + 5000).astype("<u2").view(np.uint8)
    if encoding == "32FC1":
        return (gray / 10 + 290).astype("<f4").view(np.uint8)
    if encoding in ("mono8", "8UC1"):
        return gray.astype(np.uint8)
    height, width = gray.shape
    y, u, v = yuv(image)
    opaque = np.full((height, width), 255, np.uint8)
    blue, green, red = (image[..., channel] for channel in range(3))
    if encoding in ("nv21", "nv24"):
        rows = 2 if encoding == "nv21" else 1
        colors = np.dstack([half(v, 2), half(u, 2)]) if rows == 2 else np.dstack([u, v])
        return np.vstack([y, colors.reshape(-1, width)])
    if encoding in ("yuv422", "uyvy", "yuv422_yuy2", "yuyv"):
        colors = np.empty_like(y)
        colors[:, ::2], colors[:, 1::2] = half(u, 1), half(v, 1)
        planes = [colors, y] if encoding in ("yuv422", "uyvy") else [y, colors]
    else:
        planes = {
            "bgr8": [blue, green, red],
            "8UC3": [blue, green, red],
            "rgb8": [red, green, blue],
            "bgra8": [blue, green, red, opaque],
            "rgba8": [red, green, blue, opaque],
        }[encoding]
    return np.dstack(planes).reshape(height, -1)


def test_the_target_is_tracked_in_every_encoding(graph, client, moving_square):
    graph.tracker(client, **QUICK)
    for encoding in ENCODINGS:
        client.boxes.clear()
        client.point_at(moving_square.boxes[0])
        for index in range(3):
            image = moving_square.images[index]
            rows = encoded(image, encoding)
            padded = np.pad(rows, ((0, 0), (0, 8)))
            message = Image(height=120, width=160, encoding=encoding, step=padded.shape[1])
            message.data = array("B", padded.tobytes())
            message.header.stamp.sec, message.header.stamp.nanosec = divmod(client.at(index), 10**9)
            status = client.send(message)
            expected = "tracked" if index else "started"
            assert (encoding, status.values["frame"], status.values["last_error"]) == (
                encoding,
                expected,
                "",
            )
        corner = client.box_at(client.at(2)).polygon.points[0]
        x, y = moving_square.boxes[2][:2]
        assert (corner.x, corner.y) == pytest.approx((x, y), abs=5), encoding


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
    faults = [b"", b"\0" * 100, jpegs[1][:200], jpegs[1][:-50], png(np.zeros((9, 9), np.uint8))]
    bomb = bytearray(jpegs[1])
    at = bomb.index(b"\xff\xc0") + 5
    bomb[at : at + 4] = b"\x7f\xf0\x7f\xf0"
    assert compressed.show(jpegs[0], client.at(0)).values["frame"] == "started"
    for index, jpeg in enumerate(jpegs[1:], start=1):
        for data in [*faults, bomb]:
            status = compressed.show(data, client.at(index) - 1_000_000)
            assert (status.level, status.values["frame"]) == ("ERROR", "refused")
        assert "declares 32752 x 32752 px" in status.message
        assert compressed.show(jpeg, client.at(index)).values["frame"] == "tracked"
    corner = client.box_at(client.at(5)).polygon.points[0]
    assert (corner.x, corner.y) == pytest.approx(moving_square.boxes[5][:2], abs=5)


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
