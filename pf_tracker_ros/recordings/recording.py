"""Recordings of any kind as the frames that the node would be given, each with its stamp."""

from __future__ import annotations

from collections.abc import Generator
from dataclasses import dataclass
from itertools import islice, pairwise
from pathlib import Path
from statistics import median
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from pf_tracker_ros.boxes import Box, as_box, bounding_box
from pf_tracker_ros.decoding.decoder import ImageDecoder
from pf_tracker_ros.footage import (
    Footage,
    FootageError,
    ImageBag,
    existing_path,
    is_bag,
    open_bag,
    open_footage,
)
from pf_tracker_ros.footage.bags import COMPRESSED_IMAGE_TYPE, BagImage
from pf_tracker_ros.footage.base import DEFAULT_FRAME_RATE
from pf_tracker_ros.footage.cdr import (
    deserialize_compressed_image,
    deserialize_image,
    deserialize_polygon,
)
from pf_tracker_ros.frames import Frame
from pf_tracker_ros.stamps import NANOSECONDS

# As the parameter `max_image_pixels` of the node has it.
_LARGEST_IMAGE = 2**24
# What `replay` puts into the headers of footage that has none.
_FRAME_ID = "camera"
# So many stamps tell how fast a bag's camera was.
_TELLING_STAMPS = 30


@dataclass(frozen=True, eq=False)
class RecordedFrame:
    """One image of a recording.

    Attributes:
        index: Position in the recording, counted from 0.
        stamp: Of the header, nanoseconds; 0 means unknown.
        log_time: When it was recorded, nanoseconds; the stamp where the recording does not tell.
        frame_id: Frame of the header.
        decoded: The image with its stamp, as for `Session.process`; None where the message holds
            none that can be decoded.
        problem: Why there is no image, or empty.
        true_box: (x, y, width, height) in pixels, None where there is no ground truth for it.
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
        """As for `Tracker.update`, None without one."""
        return self.decoded.image if self.decoded else None


def open_recording(
    path: str | Path,
    *,
    bag_topic: str = "",
    bag_ground_truth_topic: str = "",
    frame_rate: float = DEFAULT_FRAME_RATE,
) -> Recording:
    """Open a bag, a video, a folder of images or a sequence folder.

    Args:
        path: Where it is.
        bag_topic: Image topic of a bag; empty takes the only one that there is.
        bag_ground_truth_topic: Topic of a bag with the true boxes; empty takes the only one whose
            name ends with `ground_truth`, if there is one.
        frame_rate: Frames a second, where the source does not tell.

    Raises:
        FootageError: It cannot be read; the message says why and what would be accepted.
    """
    source = existing_path(path)
    if is_bag(source):
        return BagRecording(open_bag(source, bag_topic, bag_ground_truth_topic))
    return FootageRecording(source, open_footage(source, frame_rate=frame_rate))


class FootageRecording:
    """Frames of a video, a folder of images or a sequence.

    Attributes:
        path: Where it is.
        frame_count: Number of frames as far as the source tells, else None.
        interval: Seconds from one frame to the next, about.
        has_ground_truth: Whether there are true boxes.

    Args:
        path: Where it is.
        footage: What was opened there.
    """

    def __init__(self, path: Path, footage: Footage) -> None:
        self.path = path
        self.frame_count = footage.frame_count
        self.interval = footage.nominal_interval
        self.has_ground_truth = footage.ground_truth is not None
        self._footage = footage

    def frames(self) -> Generator[RecordedFrame, None, None]:
        """Read the frames in order; each call starts from the first.

        Raises:
            FootageError: The recording cannot be read, or not any further.
        """
        boxes = self._footage.ground_truth
        for index, frame in enumerate(self._footage.frames()):
            true_box = None
            if boxes is not None and np.isfinite(boxes[index]).all():
                true_box = as_box(boxes[index])
            yield RecordedFrame(index, frame.stamp, frame.stamp, _FRAME_ID, frame, "", true_box)


class BagRecording:
    """The images of a bag, decoded as the node decodes them; attributes as `FootageRecording`.

    Args:
        bag: What was found in it.
    """

    def __init__(self, bag: ImageBag) -> None:
        self.path = bag.path
        self.frame_count = bag.image_count or None
        self.has_ground_truth = bag.ground_truth_topic is not None
        self._bag = bag
        self._decoder = ImageDecoder(_LARGEST_IMAGE)
        stamps = [image.stamp for image in islice(bag.images(), _TELLING_STAMPS)]
        gaps = [after - before for before, after in pairwise(stamps) if after > before]
        self.interval = median(gaps) / NANOSECONDS if gaps else 1.0 / DEFAULT_FRAME_RATE

    def frames(self) -> Generator[RecordedFrame, None, None]:
        """Read the frames in order; see `FootageRecording.frames`."""
        for index, recorded in enumerate(self._bag.images()):
            yield self._decoded(index, recorded)

    def _decoded(self, index: int, recorded: BagImage) -> RecordedFrame:
        is_compressed = self._bag.image_type == COMPRESSED_IMAGE_TYPE
        read = deserialize_compressed_image if is_compressed else deserialize_image
        try:
            message = read(recorded.message)
        except FootageError as error:
            raise FootageError(f"bag {self.path}, frame {index}: {error}") from error
        frame, problem = None, ""
        try:
            frame = Frame(self._decoder.decode(message), recorded.stamp)
        except (ValueError, cv2.error) as error:
            problem = str(error)
        true_box = None
        if recorded.ground_truth is not None:
            true_box = _box_of(deserialize_polygon(recorded.ground_truth))
        return RecordedFrame(
            index, recorded.stamp, recorded.log_time, message.frame_id, frame, problem, true_box
        )


Recording = FootageRecording | BagRecording
"""A source of frames."""


def _box_of(points: list[tuple[float, float]]) -> Box | None:
    """The bounding rectangle of a polygon, None where it spans no area."""
    corners = np.array(points, dtype=np.float64).reshape(-1, 2)
    if len(corners) < 2 or not np.isfinite(corners).all():
        return None
    box = bounding_box(corners)
    return box if all(box[2:]) else None
