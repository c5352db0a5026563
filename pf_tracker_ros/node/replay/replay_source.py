"""Sources of the node `replay`: any recording as messages to publish."""

from __future__ import annotations

from collections.abc import Callable, Generator
from dataclasses import dataclass, replace
from functools import partial

from geometry_msgs.msg import PolygonStamped
from sensor_msgs.msg import CompressedImage, Image
from std_msgs.msg import Header

from pf_tracker_ros.footage import (
    Footage,
    FootageError,
    ImageBag,
    existing_path,
    is_bag,
    open_bag,
    open_footage,
)
from pf_tracker_ros.footage.bags import COMPRESSED_IMAGE_TYPE
from pf_tracker_ros.footage.ground_truth import true_box
from pf_tracker_ros.messages import box_message, image_message
from pf_tracker_ros.node.messages import new_message
from pf_tracker_ros.node.replay.replay_parameters import ReplayParameters
from pf_tracker_ros.stamps import set_stamp


@dataclass(frozen=True)
class ReplayItem:
    """An image message to publish.

    Attributes:
        stamp: Stamp of the image's header in nanoseconds.
        time: Source time in nanoseconds for the schedule: the log time of a bag, else the stamp.
        image: The message, or its recorded CDR bytes.
        ground_truth: The true box with the same stamp, None without one.
    """

    stamp: int
    time: int
    image: Image | bytes
    ground_truth: PolygonStamped | bytes | None

    def shifted(self, delay: int) -> ReplayItem:
        """The item delayed by nanoseconds; the stamps of its messages change in place.

        Raises:
            TypeError: Its messages are recorded bytes.
        """
        for message in (self.image, self.ground_truth):
            if isinstance(message, bytes):
                raise TypeError("the stamps of recorded bytes cannot change")
            if message is not None:
                set_stamp(message.header, self.stamp + delay)
        return replace(self, stamp=self.stamp + delay, time=self.time + delay)


@dataclass(frozen=True)
class ReplaySource:
    """A recording as messages.

    Attributes:
        name: Short name for messages.
        image_type: Message class of the images.
        count: Number of images, None if unknown.
        has_ground_truth: Whether there are true boxes.
        has_timestamps: Whether the stamps were recorded instead of computed from the frame rate.
        items: Reads the images in order; each call starts from the first. Raises FootageError if
            the source cannot be read.
    """

    name: str
    image_type: type[Image] | type[CompressedImage]
    count: int | None
    has_ground_truth: bool
    has_timestamps: bool
    items: Callable[[], Generator[ReplayItem, None, None]]


def open_replay_source(parameters: ReplayParameters) -> ReplaySource:
    """Open the source in the parameters.

    Raises:
        FootageError: It cannot be read, or lacks the requested ground truth.
    """
    path = existing_path(parameters.source)
    if is_bag(path):
        bag = open_bag(path, parameters.bag_topic, parameters.bag_ground_truth_topic)
        source = ReplaySource(
            name=f"{bag.name} ({bag.image_topic})",
            image_type=CompressedImage if bag.image_type == COMPRESSED_IMAGE_TYPE else Image,
            count=bag.image_count or None,
            has_ground_truth=bag.ground_truth_topic is not None,
            has_timestamps=True,
            items=partial(_items_of_bag, bag),
        )
    else:
        footage = open_footage(path, frame_rate=parameters.frame_rate)
        source = ReplaySource(
            name=footage.name,
            image_type=Image,
            count=footage.frame_count,
            has_ground_truth=footage.ground_truth is not None,
            has_timestamps=False,
            items=partial(_items_of_footage, footage, parameters.frame_id),
        )
    if parameters.target_from_ground_truth and not source.has_ground_truth:
        raise FootageError(
            f"{path} has no ground truth for the target; set target_box, or give a sequence folder "
            "or a bag with a PolygonStamped topic ending in ground_truth"
        )
    return source


def _items_of_bag(bag: ImageBag) -> Generator[ReplayItem, None, None]:
    """The images of a bag, as recorded bytes."""
    for index, image in enumerate(bag.images()):
        # An invalid message reaches no subscriber, and lockstep would wait forever.
        bag.deserialize(image, index)
        yield ReplayItem(image.stamp, image.log_time, image.message, image.ground_truth)


def _items_of_footage(footage: Footage, frame_id: str) -> Generator[ReplayItem, None, None]:
    """Frames of a video, a folder of images or a sequence, as messages."""
    boxes = footage.ground_truth
    for index, frame in enumerate(footage.frames()):
        header = make_header(frame.stamp, frame_id)
        box = true_box(boxes, index)
        ground_truth = box_message(new_message, header, box) if box else None
        image = image_message(new_message, header, frame.image)
        yield ReplayItem(frame.stamp, frame.stamp, image, ground_truth)


def make_header(stamp: int, frame_id: str) -> Header:
    """A header with a stamp in nanoseconds."""
    header = Header(frame_id=frame_id)
    set_stamp(header, stamp)
    return header
