"""A recording that the page plays to the tracker, frame by frame and in lockstep."""

from __future__ import annotations

import contextlib
from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path

from rclpy.node import Node
from rclpy.parameter import Parameter

from pf_tracker_ros.footage.access import lexists
from pf_tracker_ros.node.console.json_conversions import Json
from pf_tracker_ros.node.replay.replay_node import ReplayNode
from pf_tracker_ros.node.running import spinning
from pf_tracker_ros.recordings import open_recording
from pf_tracker_ros.recordings.sidecar_files import target_file
from pf_tracker_ros.recordings.target import Target, read_targets, save_targets

_SETTLING = 30.0
# A frame that is played twice is a duplicate to the tracker, and its box is gone from the page. No
# frame is lost on the way, so a tracker that does not answer is a slow one.
_PATIENCE = 5.0


class PlayedRecording:
    """The replay publisher of the console, with a ROS context of its own.

    Attributes:
        is_playable: Whether the source can be read; its node has told why it cannot.
        replay: That node.

    Args:
        node: The console's node; images go where it would look for them.
        source: As the parameter `source` of `replay`.
        bag_topic: As the parameter of `replay`.
        tracker: Fully qualified name of the tracker's node.
    """

    def __init__(self, node: Node, source: str, bag_topic: str, tracker: str) -> None:
        self._path = Path(source).resolve()
        self._bag_topic = bag_topic
        self._target_file = target_file(self._path)
        self._has_target = False
        self._look_for_target()
        image = node.resolve_topic_name("image")
        remapped = ["-r", f"image:={image}", "-r", f"image/compressed:={image}/compressed"]
        values = {
            "source": source,
            "bag_topic": bag_topic,
            "lockstep": True,
            "lockstep_rate": 1.0,
            "lockstep_timeout": _PATIENCE,
            "lockstep_status": f"{tracker}/status",
            "start_paused": True,
            "stay_at_end": True,
        }
        create = partial(
            ReplayNode,
            spectator=node,
            namespace=node.get_namespace(),
            cli_args=["--ros-args", *remapped],
            use_global_arguments=False,
            parameter_overrides=[Parameter(name, value=value) for name, value in values.items()],
        )
        self._running = contextlib.ExitStack()
        self.replay: ReplayNode = self._running.enter_context(
            spinning(lambda context: create(context=context), node.context.get_domain_id())
        )
        self.is_playable = self.replay.has_started

    def close(self) -> None:
        """End it."""
        self._running.close()

    @property
    def state(self) -> Json:
        """What the page shows of it."""
        return {
            "name": self._path.name,
            "frame": self.replay.position,
            "frames": self.replay.frame_count,
            "rate": self.replay.get_parameter("lockstep_rate").value,
            "target": self._target_file.name if self._has_target else "",
        }

    def wait_reason(self, image_topic: str) -> str:
        """Why it does not go on, and what to do where it and the tracker use other topics.

        Args:
            image_topic: That the tracker takes its images from, empty while that is not known.

        Returns:
            A sentence, empty if nothing is in the way.
        """
        if self.replay.failure:
            return f"the recording cannot go on, start the console anew: {self.replay.failure}"
        said = self.replay.wait_reason
        own, other = (
            topic.removesuffix("/compressed") for topic in (self.replay.image_topic, image_topic)
        )
        if not said or not other or own == other:
            return said
        return (
            f"{said}; the tracker takes its images from {other}: start the console "
            f"with --ros-args -r image:={other}"
        )

    @property
    def frame(self) -> int:
        """Index of the frame that was played last, 0 before the first."""
        return max(0, self.replay.position)

    @property
    def last_frame(self) -> int | None:
        """Index of the last frame, None where the source does not tell how many there are."""
        count = self.replay.frame_count
        return None if count is None else max(0, count - 1)

    def wait_until_idle(self) -> bool:
        """Wait until it stands still with every frame answered; whether it does.

        It has to be paused. At most half a minute.
        """
        return self.replay.playback.wait_until_held(_SETTLING)

    def set_rate(self, rate: float) -> str:
        """Set the speed relative to the recording's own, 0 for that of the tracker.

        Returns:
            Why it is refused, or empty.
        """
        (result,) = self.replay.set_parameters([Parameter("lockstep_rate", value=rate)])
        return "" if result.successful else str(result.reason)

    def save(self, targets: Sequence[Target]) -> Path:
        """Write targets beside the recording, over what has been saved before.

        Returns:
            Path of the file.

        Raises:
            OSError: It cannot be written.
        """
        path = save_targets(targets, self._path, may_replace=True)
        self._look_for_target()
        return path

    def load(self) -> list[Target]:
        """The targets of the file beside the recording, with the frames that they were drawn on.

        Reads the recording up to the last of these frames.

        Raises:
            RecordingError: The file is wrong, or of another recording.
            FootageError: The recording cannot be read that far.
        """
        waiting = list(read_targets(self._target_file, self._path))
        found = []
        recording = open_recording(self._path, bag_topic=self._bag_topic)
        with contextlib.closing(recording.frames()) as frames:
            for frame in frames:
                for target in [*waiting]:
                    if box := target.box_in(frame):
                        found.append(replace(target, box=box, stamp=frame.stamp, frame=frame.index))
                        waiting.remove(target)
                if not waiting:
                    return found
        raise waiting[0].not_found_error()

    def _look_for_target(self) -> None:
        self._has_target = lexists(self._target_file)
