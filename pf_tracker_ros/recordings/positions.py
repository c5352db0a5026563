"""Positions of the targets of a bag, in meters, from the sensors recorded beside the images.

They are those of the node `localizer` (`localization/`). A frame takes what was recorded up to a
second after it, where the node waits for the messages.
"""

from __future__ import annotations

import heapq
import math
from collections.abc import Callable, Generator, Mapping, Sequence
from contextlib import closing
from dataclasses import replace
from itertools import islice
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from pf_tracker_ros.footage.bag_reading import BagTopic, reading
from pf_tracker_ros.footage.bags import COMPRESSED_IMAGE_TYPE, read_topic
from pf_tracker_ros.footage.base import FootageError
from pf_tracker_ros.footage.cdr import (
    deserialize_camera_info,
    deserialize_compressed_image,
    deserialize_image,
    deserialize_imu,
    deserialize_odometry,
    deserialize_transforms,
    header_stamp,
)
from pf_tracker_ros.localization.frame_localizer import FrameLocalizer, Sensors
from pf_tracker_ros.localization.localizer_parameters import LocalizerParameters
from pf_tracker_ros.localization.located_frame import LocatedFrame
from pf_tracker_ros.localization.problems import Problems
from pf_tracker_ros.localization.sensors import (
    BasePoses,
    CameraCalibration,
    DepthImages,
    Gravity,
    NotYetError,
    Store,
)
from pf_tracker_ros.localization.tracker_frame import ReportedTarget, TrackerFrame
from pf_tracker_ros.localization.transform_tree import TransformTree
from pf_tracker_ros.messages import IMAGE_TYPE
from pf_tracker_ros.recordings.errors import RecordingError
from pf_tracker_ros.recordings.tracking import TrackedFrame, Tracking
from pf_tracker_ros.stamps import NANOSECONDS
from pf_tracker_ros.topics import target_probability
from pf_tracker_ros.tracking.hints import Hint

# Nanoseconds after a frame up to which messages may still belong to it.
_LOOK_AHEAD = NANOSECONDS


class _Kind(NamedTuple):
    """How the topic of a sensor is recognized.

    Attributes:
        name: Of the sensor.
        types: Its message types.
        part: Part of the topic's name.
        topic: Whole name of the topic; empty where it may have any.
    """

    name: str
    types: tuple[str, ...]
    part: str = ""
    topic: str = ""


_CAMERA_INFO, _ODOMETRY, _IMU, _TRANSFORMS = (
    "sensor_msgs/msg/CameraInfo",
    "nav_msgs/msg/Odometry",
    "sensor_msgs/msg/Imu",
    "tf2_msgs/msg/TFMessage",
)
_DESERIALIZERS: Mapping[str, Callable[[bytes], Any]] = {
    _CAMERA_INFO: deserialize_camera_info,
    IMAGE_TYPE: deserialize_image,
    COMPRESSED_IMAGE_TYPE: deserialize_compressed_image,
    _ODOMETRY: deserialize_odometry,
    _IMU: deserialize_imu,
    _TRANSFORMS: deserialize_transforms,
}
_STATIC = "tf_static"
_KINDS = (
    _Kind(CameraCalibration.name, (_CAMERA_INFO,)),
    _Kind(DepthImages.name, (IMAGE_TYPE, COMPRESSED_IMAGE_TYPE), "depth"),
    _Kind(BasePoses.name, (_ODOMETRY,)),
    _Kind(Gravity.name, (_IMU,)),
    _Kind(TransformTree.name, (_TRANSFORMS,), topic="/tf"),
    _Kind(_STATIC, (_TRANSFORMS,), topic="/tf_static"),
)
SENSORS = tuple(kind.name for kind in _KINDS)
"""Names of the sensors, as those of the node's topics."""


class RecordedPositions:
    """Locates the targets of a bag.

    Attributes:
        parameters: Of the localizer.
        topics: Name of each recorded sensor to its topic.
        notes: After reading: what was wrong with the sensors, a sentence each.

    Args:
        path: The bag.
        image_topic: Topic of the images.
        given: Name of a sensor to its topic, or to an empty text for none; others are chosen.
        parameters: Of the localizer.

    Raises:
        RecordingError: A topic is missing or ambiguous.
        FootageError: The bag cannot be read.
    """

    def __init__(
        self,
        path: Path,
        image_topic: str,
        given: Mapping[str, str],
        parameters: LocalizerParameters,
    ) -> None:
        self.parameters = parameters
        self.notes: list[str] = []
        self._path = path
        with reading(path) as reader:
            recorded = [topic for topic in reader.topics() if topic.name != image_topic]
        beside = _calibration_beside(image_topic, recorded)
        given = {CameraCalibration.name: beside, **given} if beside else given
        chosen = {kind.name: _choose(path, recorded, kind, given.get(kind.name)) for kind in _KINDS}
        if chosen[CameraCalibration.name] is None:
            raise RecordingError(
                f"{path} has no CameraInfo, which --world needs; record camera_info with the images"
            )
        self._topics = {name: topic for name, topic in chosen.items() if topic}
        self.topics = {name: topic.name for name, topic in self._topics.items()}

    def locate(self, tracking: Tracking) -> Generator[TrackedFrame, None, None]:
        """Add the positions to tracked frames, in order; the tracker gets what covers its targets.

        Raises:
            FootageError: The bag cannot be read.
        """
        with closing(tracking), closing(self.open()) as sensors:
            hints: Mapping[int, Hint] | None = None
            while True:
                try:
                    tracked = tracking.send(hints)
                except StopIteration:
                    return
                located = _located(tracked, sensors)
                hints = located.hints
                yield replace(tracked, located=located)

    def open(self) -> RecordedSensors:
        """Begin a pass through the sensors of the bag.

        Raises:
            FootageError: The bag cannot be read.
        """
        self.notes.clear()
        return RecordedSensors(self._path, self._topics, self.parameters, self.notes)


class _Topic:
    """A topic of a bag as the source of a sensor's messages; without a name, the bag has none."""

    def __init__(self, topic: BagTopic | None) -> None:
        self.topic = topic.name if topic else ""
        self.is_used = topic is not None
        self.is_silent = topic is None


class RecordedSensors:
    """Locates frames in order, with the sensors of a bag.

    Args:
        path: The bag.
        topics: Name of each recorded sensor to its topic.
        parameters: Of the localizer.
        notes: Gets a sentence for what is wrong with the sensors.
    """

    def __init__(
        self,
        path: Path,
        topics: Mapping[str, BagTopic],
        parameters: LocalizerParameters,
        notes: list[str],
    ) -> None:
        if parameters.camera.height:
            # Only the rotation of an accelerometer is asked for, which does not change.
            topics = {name: topic for name, topic in topics.items() if name != TransformTree.name}
        self._parameters = parameters
        self._sources = {name: _Topic(topics.get(name)) for name in SENSORS}
        calibration = CameraCalibration(self._sources[CameraCalibration.name])
        depth = DepthImages(self._sources[DepthImages.name])
        base = BasePoses(self._sources[BasePoses.name])
        self._gravity = Gravity(self._sources[Gravity.name])
        transforms = TransformTree(self._sources[TransformTree.name])
        stores: tuple[Store, ...] = (calibration, depth, base, self._gravity, transforms)
        self._takers = {store.name: store.take for store in stores}
        self._takers[_STATIC] = transforms.take_static
        has_transforms = TransformTree.name in topics or _STATIC in topics
        self._problems = Problems(notes.append, math.inf)
        self._frames = FrameLocalizer(
            Sensors(
                calibration, depth, base, self._gravity, transforms if has_transforms else None
            ),
            self._problems,
        )
        self._messages = _merged(path, {name: topics[name] for name in topics if name != _STATIC})
        self._next = next(self._messages, None)
        # They may have been recorded after the first image.
        self._take_first(path, topics, CameraCalibration.name, 1)
        self._take_first(path, topics, _STATIC, None)

    def close(self) -> None:
        """Close the bag."""
        self._messages.close()

    def locate(
        self,
        frame: TrackerFrame,
        log_time: int,
        probability: Callable[[], NDArray[np.float64] | None] = lambda: None,
    ) -> LocatedFrame:
        """Locate the targets of a frame.

        Args:
            frame: Of the tracker.
            log_time: When its image was recorded, nanoseconds.
            probability: As for `FrameLocalizer.locate`.
        """
        if frame.stamp <= 0:
            return self._frames.located(frame, "the images have no stamps, which positions need")
        self._read_until(log_time)
        while True:
            is_last_chance = self._next is None or self._next.log_time > log_time + _LOOK_AHEAD
            try:
                return self._frames.locate(
                    frame, self._parameters, probability, is_last_chance=is_last_chance
                )
            except NotYetError:
                self._read_next()

    def _take_first(
        self, path: Path, topics: Mapping[str, BagTopic], sensor: str, count: int | None
    ) -> None:
        """Take the first messages of a sensor, None for all."""
        if topic := topics.get(sensor):
            with closing(read_topic(path, topic.name)) as messages:
                for _, message in islice(messages, count):
                    self._take(_Recorded(0, topic, sensor, message))

    def _read_until(self, log_time: int) -> None:
        while self._next and self._next.log_time <= log_time:
            self._read_next()

    def _read_next(self) -> None:
        recorded, self._next = self._next, next(self._messages, None)
        if recorded:
            self._take(recorded)
        if self._next is None:
            for source in self._sources.values():
                source.is_silent = True

    def _take(self, recorded: _Recorded) -> None:
        name = recorded.sensor
        try:
            if name == Gravity.name and self._gravity.is_needless(header_stamp(recorded.message)):
                return
            message = _DESERIALIZERS[recorded.topic.message_type](recorded.message)
            self._takers[name](message.stamp, message.frame_id, message)
        except (ValueError, FootageError) as error:
            self._problems.set(name, f"{name} refused: {error}")
        else:
            self._problems.set(name, "")


class _Recorded(NamedTuple):
    """A message of a bag."""

    log_time: int
    topic: BagTopic
    sensor: str
    message: bytes


def _merged(path: Path, topics: Mapping[str, BagTopic]) -> Generator[_Recorded, None, None]:
    """The messages of several topics in the order of recording."""

    def of(sensor: str, topic: BagTopic) -> Generator[_Recorded, None, None]:
        # A reader of its own, as a reader has one position in its file.
        with closing(read_topic(path, topic.name)) as messages:
            for log_time, message in messages:
                yield _Recorded(log_time, topic, sensor, message)

    streams = [of(*item) for item in topics.items()]
    try:
        yield from heapq.merge(*streams, key=lambda recorded: recorded.log_time)
    finally:
        for stream in streams:
            stream.close()


def _calibration_beside(image_topic: str, recorded: Sequence[BagTopic]) -> str:
    """The CameraInfo that is published with the images, by its name; empty without."""
    names = {topic.name for topic in recorded if topic.message_type == _CAMERA_INFO}
    # That of compressed images is beside the raw ones.
    parents = image_topic.split("/")[:-1], image_topic.split("/")[:-2]
    beside = ("/".join([*parent, CameraCalibration.name]) for parent in parents)
    return next((name for name in beside if name in names), "")


def _choose(
    path: Path, recorded: Sequence[BagTopic], kind: _Kind, given: str | None
) -> BagTopic | None:
    """The topic of a sensor; None where the bag has none, or none is wanted."""
    name = kind.name
    fitting = {topic.name: topic for topic in recorded if topic.message_type in kind.types}
    if given is not None:
        if given and given not in fitting:
            raise RecordingError(
                f"--world-topic {name}={given}: {path} has no such topic of type "
                f"{' or '.join(kind.types)}; there are: {', '.join(sorted(fitting)) or 'none'}"
            )
        return fitting.get(given)
    named = {
        one: topic for one, topic in fitting.items() if kind.part in one and kind.topic in ("", one)
    }
    if len(named) > 1:
        raise RecordingError(
            f"{path} has several topics for {name}: {', '.join(sorted(named))}; choose with "
            f"--world-topic {name}=TOPIC, or {name}= for none"
        )
    return next(iter(named.values()), None)


def _located(tracked: TrackedFrame, sensors: RecordedSensors) -> LocatedFrame:
    return sensors.locate(_reported(tracked), tracked.frame.log_time, lambda: _probability(tracked))


def _reported(tracked: TrackedFrame) -> TrackerFrame:
    """A frame as the tracker reports it on `~/status`."""
    image = tracked.image
    return TrackerFrame(
        stamp=tracked.frame.stamp,
        frame_id=tracked.frame.frame_id,
        is_skipped=tracked.state == "skipped",
        state=tracked.state,
        selected=tracked.selected,
        image_size=None if image is None else (image.shape[1], image.shape[0]),
        targets=tuple(map(ReportedTarget.of, tracked.targets)),
    )


def _probability(tracked: TrackedFrame) -> NDArray[np.float64] | None:
    probability = target_probability(tracked)
    return None if probability is None else probability / 255.0
