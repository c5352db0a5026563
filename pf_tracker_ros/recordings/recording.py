"""Recordings of every kind, read as the frames and stamps that the node would receive."""

from __future__ import annotations

from collections.abc import Generator
from contextlib import closing, suppress
from dataclasses import dataclass
from itertools import count, islice, pairwise
from pathlib import Path
from statistics import median
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from pf_tracker_ros.boxes import Box, bounding_box
from pf_tracker_ros.decoding.image_decoding import decode_image
from pf_tracker_ros.footage import (
    Footage,
    ImageBag,
    PartialFootageError,
    existing_path,
    is_bag,
    open_bag,
    open_footage,
)
from pf_tracker_ros.footage.bags import BagImage
from pf_tracker_ros.footage.base import DEFAULT_FRAME_RATE
from pf_tracker_ros.footage.cameras import Camera, CameraImage, is_camera
from pf_tracker_ros.footage.cdr import deserialize_polygon
from pf_tracker_ros.footage.ground_truth import true_box
from pf_tracker_ros.footage.stamp_order import StampOrder
from pf_tracker_ros.footage.videos import VideoFootage
from pf_tracker_ros.frames import Frame
from pf_tracker_ros.plurals import counted
from pf_tracker_ros.stamps import NANOSECONDS

# Default of the node's parameter `max_image_pixels`.
_MAX_IMAGE_PIXELS = 2**24
# Of footage without headers, as `replay` sets it.
_FRAME_ID = "camera"
# Stamps of a bag from which its frame interval is estimated.
_INTERVAL_STAMPS = 30


@dataclass(frozen=True, eq=False)
class RecordedFrame:
    """One image of a recording.

    Attributes:
        index: Position in the recording, counted from 0.
        stamp: Of the header, nanoseconds; 0 means unknown.
        log_time: Time of recording, nanoseconds; the stamp outside bags.
        frame_id: Coordinate frame of the header.
        decoded: The image with its stamp, as for `Session.process`; None if it cannot be decoded.
        problem: Why there is no image, or empty.
        true_box: (x, y, width, height) in pixels, None without ground truth for this frame.
    """

    index: int
    stamp: int
    log_time: int
    frame_id: str
    decoded: Frame | None
    problem: str
    true_box: Box | None

    @property
    def image(self) -> NDArray[Any] | None:
        """The image as for `Tracker.update`, or None."""
        return self.decoded.image if self.decoded else None


def open_recording(
    path: str | Path,
    *,
    bag_topic: str = "",
    frame_rate: float = DEFAULT_FRAME_RATE,
    as_recorded: bool = False,
) -> Recording:
    """Open a bag, a video, a folder of images, a sequence folder or a camera.

    Args:
        path: Path of the recording; or a camera, see `is_camera`.
        bag_topic: Image topic of a bag; empty selects the only one.
        frame_rate: Hertz, for sources without a frame rate of their own.
        as_recorded: Whether the images of a bag keep the order of recording, in which the node
            receives them, instead of being sorted by their stamps.

    Raises:
        FootageError: The recording cannot be read.
    """
    if is_camera(str(path)):
        return CameraRecording(Camera(str(path)))
    source = existing_path(path)
    if is_bag(source):
        bag = open_bag(source, bag_topic)
        return BagRecording(bag, as_recorded=as_recorded)
    return FootageRecording(source, open_footage(source, frame_rate=frame_rate))


class FootageRecording:
    """Frames of a video, a folder of images or a sequence.

    Attributes:
        path: Path of the recording.
        frame_count: Number of frames if the source states it, else None.
        interval: Approximate frame interval, seconds.
        has_ground_truth: Whether there are true boxes.
        note: After reading: what is unusual in it, as a sentence, or empty.
        is_live: Whether it cannot be read again.

    Args:
        path: As the attribute.
        footage: The opened footage.
    """

    is_live = False

    def __init__(self, path: Path, footage: Footage) -> None:
        self.path = path
        self.frame_count = footage.frame_count
        self.interval = footage.nominal_interval
        self.has_ground_truth = footage.ground_truth is not None
        self._footage = footage

    @property
    def note(self) -> str:  # noqa: D102
        return self._footage.note if isinstance(self._footage, VideoFootage) else ""

    def frames(self) -> Generator[RecordedFrame, None, None]:
        """Read the frames in order; each call starts from the first.

        Raises:
            FootageError: The recording cannot be read, or only in part.
            PartialFootageError: After the last frame, if others are missing or damaged.
        """
        boxes = self._footage.ground_truth
        for index, frame in enumerate(self._footage.frames()):
            box = true_box(boxes, index)
            yield RecordedFrame(index, frame.stamp, frame.stamp, _FRAME_ID, frame, "", box)


class BagRecording:
    """The images of a bag, decoded as in the node.

    Attributes, beside those of `FootageRecording`:
        image_topic: Their topic.

    Args:
        bag: The opened bag.
        as_recorded: As for `open_recording`.
    """

    is_live = False

    def __init__(self, bag: ImageBag, *, as_recorded: bool = False) -> None:
        self.path = bag.path
        self.image_topic = bag.image_topic
        self.frame_count = bag.image_count or None
        self.has_ground_truth = bag.ground_truth_topic is not None
        self.note = ""
        self._bag = bag
        self._as_recorded = as_recorded
        stamps: list[int] = []
        # Missing images are reported when all are read.
        with suppress(PartialFootageError), closing(bag.images()) as images:
            stamps.extend(image.stamp for image in islice(images, _INTERVAL_STAMPS))
        gaps = [after - before for before, after in pairwise(stamps) if after > before]
        self.interval = median(gaps) / NANOSECONDS if gaps else 1.0 / DEFAULT_FRAME_RATE

    def frames(self) -> Generator[RecordedFrame, None, None]:
        """Read the frames in order; see `FootageRecording.frames`."""
        if self._as_recorded:
            yield from map(self._decode, count(), self._bag.images())
            return
        order = StampOrder()
        yield from map(self._decode, count(), order.sort(self._bag.images()))
        if order.moved_count:
            self.note = (
                f"{counted(order.moved_count, 'frame')} of {self.path.name} were recorded out of "
                "order and sorted by their stamps; with --as-recorded they are skipped, as in the "
                "node"
            )

    def _decode(self, index: int, recorded: BagImage) -> RecordedFrame:
        message = self._bag.deserialize(recorded, index)
        frame, problem = None, ""
        try:
            frame = Frame(decode_image(message, _MAX_IMAGE_PIXELS), recorded.stamp)
        except (ValueError, cv2.error) as error:
            problem = str(error)
        box = None
        if recorded.ground_truth is not None:
            box = _bounding_box(deserialize_polygon(recorded.ground_truth))
        return RecordedFrame(
            index, recorded.stamp, recorded.log_time, message.frame_id, frame, problem, box
        )


class CameraRecording:
    """The pictures of a camera from now on, without an end.

    Attributes, beside those of `FootageRecording`:
        is_live: True.

    Args:
        camera: The camera.
    """

    frame_count = None
    has_ground_truth = False
    is_live = True
    note = ""

    def __init__(self, camera: Camera) -> None:
        # Of no file, but named in messages like one.
        self.path = Path(camera.name.rpartition("://")[2])
        self.interval = camera.interval
        self._camera = camera
        self._first: CameraImage | None = None

    def frames(self) -> Generator[RecordedFrame, None, None]:
        """Read the newest picture each time, the first time that of `take`, if there is one.

        It can be called once.

        Raises:
            FootageError: The camera sends no picture any more.
        """
        numbers = count()
        if self._first is not None:
            yield self._recorded(next(numbers), self._first)
        with closing(self._camera):
            for number in numbers:
                yield self._recorded(number, self._camera.next())

    def take(self) -> RecordedFrame:
        """Take a picture, which becomes the first frame; raises as `frames`."""
        self._first = self._camera.next()
        return self._recorded(0, self._first)

    @staticmethod
    def _recorded(index: int, picture: CameraImage) -> RecordedFrame:
        frame = Frame(picture.image, picture.stamp)
        return RecordedFrame(index, picture.stamp, picture.stamp, _FRAME_ID, frame, "", None)


Recording = FootageRecording | BagRecording | CameraRecording
"""A source of frames."""


def _bounding_box(points: list[tuple[float, float]]) -> Box | None:
    """The bounding rectangle of a polygon, None if it spans no area."""
    corners = np.array(points, dtype=np.float64).reshape(-1, 2)
    if len(corners) < 2 or not np.isfinite(corners).all():
        return None
    box = bounding_box(corners)
    return box if all(box[2:]) else None
