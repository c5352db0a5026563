"""Small recordings of every kind, written without the code under test."""

import functools
import os
import signal
import tempfile
from contextlib import contextmanager
from pathlib import Path

import cv2
import numpy as np
import pytest


@functools.cache
def typestore():
    """The message types of rosbags, which a ROS from apt does not have: skips without it."""
    pytest.importorskip("rosbags")
    from rosbags.typesys import Stores, get_typestore

    return get_typestore(Stores.ROS2_JAZZY)


@pytest.fixture
def pictures():
    """Five pictures of noise, so that a frame out of place is noticed."""
    generator = np.random.default_rng(7)
    return [generator.integers(0, 256, (24, 32, 3), dtype=np.uint8) for _ in range(5)]


@pytest.fixture
def write_video():
    """Write pictures into a lossless video."""

    def write(path: Path, images, rate: float = 30.0) -> Path:
        height, width = images[0].shape[:2]
        codec = cv2.VideoWriter_fourcc(*"FFV1")
        writer = cv2.VideoWriter(str(path), codec, rate, (width, height))
        assert writer.isOpened()
        for image in images:
            writer.write(image)
        writer.release()
        return path

    return write


@pytest.fixture
def write_images():
    """Write pictures as files of the given names."""

    def write(folder: Path, images_by_name) -> Path:
        folder.mkdir(parents=True, exist_ok=True)
        for name, image in images_by_name.items():
            assert cv2.imwrite(str(folder / name), image)
        return folder

    return write


@pytest.fixture
def make_message():
    """Serialize a message of the common interfaces with a stamp in nanoseconds."""
    types = typestore().types

    def header(stamp):
        seconds, nanoseconds = divmod(stamp, 10**9)
        time = types["builtin_interfaces/msg/Time"](sec=seconds, nanosec=nanoseconds)
        return types["std_msgs/msg/Header"](stamp=time, frame_id="lens")

    def make(message_type, stamp, *, little_endian=True):
        fields = {
            "sensor_msgs/msg/Image": lambda: {
                "height": 2,
                "width": 3,
                "encoding": "mono8",
                "is_bigendian": 0,
                "step": 3,
                "data": np.arange(6, dtype=np.uint8) + stamp % 50,
            },
            "sensor_msgs/msg/CompressedImage": lambda: {
                "format": "jpeg",
                "data": np.arange(5, dtype=np.uint8),
            },
            "geometry_msgs/msg/PolygonStamped": lambda: {
                "polygon": types["geometry_msgs/msg/Polygon"](
                    points=[types["geometry_msgs/msg/Point32"](x=1.0, y=2.0, z=0.0)]
                )
            },
        }[message_type]()
        message = types[message_type](header=header(stamp), **fields)
        return bytes(typestore().serialize_cdr(message, message_type, little_endian=little_endian))

    return make


@pytest.fixture
def write_bag():
    """Write (topic, type, log time, message) rows into a bag of the given kind."""

    def write(path: Path, rows, storage="MCAP", compression="NONE") -> Path:
        from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin, Writer

        writer = Writer(path, version=9, storage_plugin=StoragePlugin[storage])
        writer.set_compression(CompressionMode[compression], CompressionFormat.ZSTD)
        with writer:
            connections = {}
            for topic, message_type, log_time, message in rows:
                if (topic, message_type) not in connections:
                    connections[topic, message_type] = writer.add_connection(
                        topic, message_type, typestore=typestore()
                    )
                if message is not None:
                    writer.write(connections[topic, message_type], log_time, message)
        return path

    return write


@pytest.fixture
def no_hang():
    """Ends a test that waits for something that never comes."""

    def give_up(number, frame):
        raise TimeoutError("it hangs")

    before = signal.signal(signal.SIGALRM, give_up)
    signal.alarm(20)
    yield
    signal.alarm(0)
    signal.signal(signal.SIGALRM, before)


@pytest.fixture
def public_folder():
    """An empty folder that every user may look into."""
    with tempfile.TemporaryDirectory() as folder:
        Path(folder).chmod(0o755)
        yield Path(folder)


@pytest.fixture
def ordinary_user():
    """A block as a user who may not read everything, for tests that root runs."""

    @contextmanager
    def block():
        is_root = os.geteuid() == 0
        if is_root:
            os.seteuid(65534)
        try:
            yield
        finally:
            if is_root:
                os.seteuid(0)

    return block
