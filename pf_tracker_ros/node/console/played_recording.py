"""The recording that the console plays to the tracker, in lockstep: one of a list."""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path

from rclpy.node import Node
from rclpy.parameter import Parameter

from pf_tracker_ros.footage.access import lexists
from pf_tracker_ros.node.console.json_conversions import Json
from pf_tracker_ros.node.console.playlist import ListedRecording, recordings_to_json
from pf_tracker_ros.node.replay.replay_node import ReplayNode
from pf_tracker_ros.node.running import spinning
from pf_tracker_ros.recordings import RecordingError, open_recording
from pf_tracker_ros.recordings.sidecar_files import target_file
from pf_tracker_ros.recordings.target import Target, read_targets, save_targets

_IDLE_TIMEOUT = 30.0
STATUS_TIMEOUT = 5.0
"""Seconds to wait for a status. No frame is lost on the way, so a late one means a slow tracker."""


class PlayedRecording:
    """The replay publisher of the console, with a ROS context of its own.

    Attributes:
        listed: The recordings to choose from, at least one.
        index: Of the played one in the list.
        replay: Its replay node.
        before_frame: As of the replay node, for all recordings.

    Args:
        node: The console's node; images are published on its topic `image`.
        listed: As the attribute.
        index: Of the first one to play.
        bag_topic: As the parameter of `replay`.
        tracker: Fully qualified name of the tracker's node.

    Raises:
        RecordingError: The recording cannot be played.
    """

    replay: ReplayNode

    def __init__(
        self,
        node: Node,
        listed: Sequence[ListedRecording],
        index: int,
        bag_topic: str,
        tracker: str,
    ) -> None:
        self.listed = listed
        self.index = index
        self.before_frame: Callable[[int], None] = lambda index: None
        self._node = node
        self._bag_topic = bag_topic
        self._values = {
            "bag_topic": bag_topic,
            "lockstep": True,
            "lockstep_rate": 1.0,
            "lockstep_timeout": STATUS_TIMEOUT,
            "lockstep_status": f"{tracker}/status",
            "start_paused": True,
            "stay_at_end": True,
        }
        self._running = contextlib.ExitStack()
        self._start(index)

    def open(self, index: int) -> None:
        """Play a recording of the list instead of the present one, paused before its first frame.

        Raises:
            RecordingError: It cannot be played; the present one starts again.
        """
        # Closed first, as the nodes have the same name.
        self.close()
        try:
            self._start(index)
        except RecordingError:
            self._start(self.index)
            raise

    def _start(self, index: int) -> None:
        entry, image = self.listed[index], self._node.resolve_topic_name("image")
        remapped = ["-r", f"image:={image}", "-r", f"image/compressed:={image}/compressed"]
        if entry.speed is not None:
            self._values["lockstep_rate"] = float(entry.speed)
        values = {"source": entry.source, **self._values}
        create = partial(
            ReplayNode,
            spectator=self._node,
            namespace=self._node.get_namespace(),
            cli_args=["--ros-args", *remapped],
            use_global_arguments=False,
            parameter_overrides=[Parameter(name, value=value) for name, value in values.items()],
        )
        replay: ReplayNode = self._running.enter_context(
            spinning(lambda context: create(context=context), self._node.context.get_domain_id())
        )
        if not replay.has_started:
            self.close()
            raise RecordingError(f"{entry.source} cannot be played: {replay.failure}")
        replay.before_frame = self._announce
        self.index, self.replay = index, replay
        self._path = entry.path
        self._target_file = target_file(self._path)
        self._check_target_file()

    def close(self) -> None:
        """Stop the replay node."""
        self._running.close()

    @property
    def state(self) -> Json:
        """The recording's part of the `recording` message for the page."""
        return {
            "name": self._path.name,
            "index": self.index,
            "seconds": self.replay.elapsed,
            "frame": self.replay.position,
            "frame_count": self.replay.frame_count,
            "rate": self.replay.get_parameter("lockstep_rate").value,
            "target_file": self._target_file.name if self._has_target else "",
        }

    @property
    def list_for_page(self) -> list[Json]:
        """The recordings to choose from."""
        return recordings_to_json(self.listed)

    def wait_reason(self, image_topic: str) -> str:
        """Why the playback waits, with advice if the tracker subscribes to another topic.

        Args:
            image_topic: Image topic of the tracker, empty while unknown.

        Returns:
            A sentence, empty if it does not wait.
        """
        if self.replay.failure:
            advice = "choose another one" if len(self.listed) > 1 else "restart the console"
            return f"the recording cannot continue: {self.replay.failure}; {advice}"
        reason = self.replay.wait_reason
        own, other = (
            topic.removesuffix("/compressed") for topic in (self.replay.image_topic, image_topic)
        )
        if not reason or not other or own == other:
            return reason
        return (
            f"{reason}; the tracker subscribes to {other}: start the console with "
            f"--ros-args -r image:={other}"
        )

    @property
    def frame(self) -> int:
        """Index of the last frame played, 0 before the first."""
        return max(0, self.replay.position)

    @property
    def last_frame(self) -> int | None:
        """Index of the recording's last frame, None if its length is unknown."""
        count = self.replay.frame_count
        return None if count is None else max(0, count - 1)

    def wait_until_idle(self) -> bool:
        """Wait at most 30 s until the paused playback has a status for every frame.

        Returns:
            Whether it has.
        """
        return self.replay.playback.wait_until_held(_IDLE_TIMEOUT)

    def set_rate(self, rate: float) -> str:
        """Set the playback rate relative to the recording's own, 0 for as fast as the tracker.

        Returns:
            The reason of a refusal, or empty.
        """
        (result,) = self.replay.set_parameters([Parameter("lockstep_rate", value=rate)])
        if result.successful:
            self._values["lockstep_rate"] = rate
        return "" if result.successful else str(result.reason)

    def save(self, targets: Sequence[Target]) -> Path:
        """Write targets to the recording's sidecar file, replacing an earlier one.

        Returns:
            Path of the file.

        Raises:
            OSError: It cannot be written.
        """
        path = save_targets(targets, self._path, may_replace=True)
        self._check_target_file()
        return path

    def load(self) -> list[Target]:
        """The targets of the recording's sidecar file, with their frames.

        Reads the recording up to the last of these frames.

        Raises:
            RecordingError: The file is invalid, or belongs to another recording.
            FootageError: The recording cannot be read that far.
        """
        waiting = list(read_targets(self._target_file, self._path))
        found = []
        recording = open_recording(self._path, bag_topic=self._bag_topic, as_recorded=True)
        with contextlib.closing(recording.frames()) as frames:
            for frame in frames:
                for target in [*waiting]:
                    if box := target.box_in(frame):
                        found.append(replace(target, box=box, stamp=frame.stamp, frame=frame.index))
                        waiting.remove(target)
                if not waiting:
                    return found
        raise waiting[0].not_found_error()

    def _announce(self, index: int) -> None:
        self.before_frame(index)

    def _check_target_file(self) -> None:
        self._has_target = lexists(self._target_file)
