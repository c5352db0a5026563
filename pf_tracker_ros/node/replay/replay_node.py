"""The node `replay`: publishes a recording like a camera, in real time or in lockstep.

1. The executor's thread serves the tracker's status, the services and the parameters.
2. The playback thread publishes.
3. The prefetching thread reads and decodes.

`ReplayParameters` has the parameters.
"""

from __future__ import annotations

import itertools
import sys
import threading
import traceback
from collections.abc import Callable, Generator, Sequence
from contextlib import closing
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray
from rclpy.exceptions import NameValidationException
from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.node import Node
from rclpy.parameter import Parameter
from std_srvs.srv import SetBool, Trigger

from pf_tracker_ros.footage import FootageError, PartialFootageError
from pf_tracker_ros.footage.prefetch import Prefetch
from pf_tracker_ros.node.parameter_binding import ParameterBinding
from pf_tracker_ros.node.replay.playback import Playback, PlaybackStopped, SeekRequested
from pf_tracker_ros.node.replay.replay_outputs import DEPTH, ReplayOutputs
from pf_tracker_ros.node.replay.replay_parameters import ReplayParameters
from pf_tracker_ros.node.replay.replay_source import ReplayItem, ReplaySource, open_replay_source
from pf_tracker_ros.node.replay.restamping import Restamper
from pf_tracker_ros.node.running import run
from pf_tracker_ros.parameters import build
from pf_tracker_ros.plurals import counted
from pf_tracker_ros.stamps import NANOSECONDS, stamp_of

_WARNING_INTERVAL, _MAX_WARNING_INTERVAL = 5.0, 60.0
_UNLIMITED_RATE = 1e9
# Limits the memory for long recordings, and for loops with new stamps each time.
_MAX_INDEXED_STAMPS = 10_000


class ReplayNode(Node):
    """Publishes `image`, `~/ground_truth`, the tracker's target and `/clock` from a recording.

    With an invalid parameter or source the node stays up and waits for valid ones. At the end of
    the source it shuts its context down.

    Frames of a source without time stamps, such as a video, are stamped with the node's time when
    published; in lockstep and with `publish_clock` from 1 s on, so that runs are reproducible.

    Attributes:
        exit_code: 1 after a failure of the source during the playback, else 0.
        has_started: Whether the playback has started.
        before_frame: Called in the playback thread with the index of each frame before it is
            published.
        playback: The schedule, once started.
        position: Index of the last published frame, counted from 0; -1 before the first.
        stamp: Stamp of that frame in nanoseconds; 0 before the first.
        elapsed: Time of that frame after the first frame, seconds.
        failure: Error message of a source that cannot be opened or played, else empty.

    Args:
        spectator: As for `ReplayOutputs`.
        **options: Arguments of `rclpy.node.Node`.
    """

    def __init__(self, *, spectator: Node | None = None, **options: Any) -> None:
        super().__init__("replay", **options)
        self._spectator = spectator
        self.before_frame: Callable[[int], None] = lambda index: None
        self._log = self.get_logger()  # type: ignore[no-untyped-call]
        self.exit_code = 0
        self._published = 0
        self.position = -1
        self.stamp = 0
        self.elapsed = 0.0
        self._start_time: int | None = None
        self.failure = ""
        self._wait_reason = ""
        self._indices: dict[int, int] = {}
        self._restamper = Restamper(lambda: self.get_clock().now().nanoseconds)
        self._thread: threading.Thread | None = None
        self._binding = ParameterBinding(self)
        self._binding.declare(ReplayParameters)
        self._start()
        self._binding.listen(
            apply=lambda changes: self._start(), ready=lambda: self._thread is not None
        )

    def _start(self) -> None:
        """Open the source and start the playback, unless started or a parameter is invalid."""
        if self._thread is not None or self._binding.refused:
            return
        parameters = build(ReplayParameters, self._binding.values)
        before = set(self.publishers)
        try:
            self._set_up(open_replay_source(parameters), parameters)
        except (FootageError, NameValidationException) as error:
            for publisher in set(self.publishers) - before:
                self.destroy_publisher(publisher)
            self.failure = str(error)
            advice = (
                ""
                if parameters.source
                else "; start 'replay drive.mcap', or set the parameter, which the node waits for: "
                f"ros2 param set {self.get_fully_qualified_name()} source drive.mcap"
            )
            self._log.error(f"not playing: {error}{advice}")
            return
        self._thread = threading.Thread(target=self._run, name="playback", daemon=True)
        self._thread.start()

    def _set_up(self, source: ReplaySource, parameters: ReplayParameters) -> None:
        self._fixed = parameters
        self._source = source
        self.failure = ""
        self.playback = Playback(paused=parameters.start_paused)
        self._outputs = ReplayOutputs(self, source, parameters, self.playback, self._spectator)
        if parameters.lockstep:
            self._status_subscription = self.create_subscription(
                DiagnosticArray, parameters.lockstep_status, self._on_status, DEPTH
            )
        self.create_service(SetBool, "~/pause", self._on_pause)
        self.create_service(Trigger, "~/step", self._on_step)

    @property
    def _rate(self) -> float:
        return float(self._binding.values["rate"])

    @property
    def _lockstep_rate(self) -> float:
        return float(self._binding.values["lockstep_rate"])

    @property
    def has_started(self) -> bool:  # noqa: D102
        return self._thread is not None

    @property
    def frame_count(self) -> int | None:
        """Number of frames of the source, None if unknown; once started."""
        return self._source.count

    @property
    def image_topic(self) -> str:
        """Full name of the image topic, once started."""
        return self._outputs.image_topic

    @property
    def wait_reason(self) -> str:
        """Why the playback waits, or would wait after the pause; empty if it does not."""
        if self._wait_reason or not self.playback.paused:
            return self._wait_reason
        try:
            return _waiting_for(self._missing())
        except (rclpy_implementation.InvalidHandle, rclpy_implementation.RCLError):
            # Destroyed or shut down, perhaps by another thread.
            return ""

    def index_of(self, stamp: int) -> int | None:
        """Index of a frame by its stamp in nanoseconds; None if not among the last 10,000."""
        return self._indices.get(stamp)

    def destroy_node(self) -> None:
        """Stop the playback and destroy the node."""
        if self._thread is not None:
            self.playback.stop()
            self._thread.join()
        super().destroy_node()  # type: ignore[no-untyped-call]

    def _on_status(self, status: DiagnosticArray) -> None:
        self.playback.mark_processed(stamp_of(status.header))

    def _on_pause(self, request: SetBool.Request, response: SetBool.Response) -> SetBool.Response:
        self.playback.paused = request.data
        response.success = True
        published = counted(self._published, "frame")
        response.message = f"{'paused' if request.data else 'playing'}, {published} published"
        return response

    def _on_step(self, request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        response.success = self.playback.paused
        if response.success:
            self.playback.step()
        response.message = (
            f"one more after {counted(self._published, 'frame')}"
            if response.success
            else "steps need a pause; call the service ~/pause with true first"
        )
        return response

    def _run(self) -> None:
        try:
            self._play_source()
        except PlaybackStopped:
            pass
        except FootageError as error:
            self._fail(str(error))
        except Exception:
            # A shutdown destroys the publishers while this thread runs.
            if self.context.ok():
                self._fail(f"playback failed: {traceback.format_exc()}")
        self.context.try_shutdown()

    def _fail(self, reason: str) -> None:
        self._log.fatal(reason)
        self.failure = reason
        self.exit_code = 1
        # Nobody waits for what will not come.
        self.playback.stop()

    def _play_source(self) -> None:
        count = self._source.count
        frames = "an unknown number of frames" if count is None else counted(count, "frame")
        self._log.info(f"replaying {self._source.name}: {frames} on {self.image_topic}")
        self._wait_for_tracker()
        first, repeats = 0, True
        while repeats:
            try:
                repeats = self._play_to_end(first)
                first = 0
            except SeekRequested as request:
                (first,) = request.args
            self.playback.begin_pass()
        self._outputs.wait_for_delivery()
        self._log.info(f"published {counted(self._published, 'frame')} of {self._source.name}")

    def _play_to_end(self, first: int) -> bool:
        """Play from a frame, counted from 0, to the end; returns whether to start again.

        Raises:
            SeekRequested: Playback continues at another frame.
        """
        try:
            self._play_pass(first)
        except PartialFootageError as error:
            self._log.warning(str(error))
        if self._binding.values["loop"]:
            return True
        if self._fixed.stay_at_end:
            self.playback.wait_at_end()
        return False

    def _play_pass(self, first: int) -> None:
        target_is_due = self._outputs.sends_target and first == 0
        with closing(Prefetch(_items_from(self._source, first))) as items:
            for index, source_item in enumerate(items, first):
                self._wait_until_due(source_item)
                item = self._restamped(source_item)
                if target_is_due:
                    target_is_due = not self._send_target(item)
                self.before_frame(index)
                self.playback.clear_processed()
                self._add_to_index(item.stamp, index)
                self._outputs.publish(item)
                self._mark_published(index, item.stamp, source_item.time)
                if self._fixed.lockstep:
                    self._wait_for_status(item)

    def _add_to_index(self, stamp: int, index: int) -> None:
        self._indices.pop(stamp, None)
        self._indices[stamp] = index
        if len(self._indices) > _MAX_INDEXED_STAMPS:
            del self._indices[next(iter(self._indices))]

    def _mark_published(self, index: int, stamp: int, time: int) -> None:
        self.position, self.stamp = index, stamp
        self._start_time = time if self._start_time is None else self._start_time
        self.elapsed = (time - self._start_time) / NANOSECONDS
        self._published += 1

    def _restamped(self, item: ReplayItem) -> ReplayItem:
        """The item with the stamp to publish."""
        if self._source.has_timestamps or self._fixed.lockstep or self._fixed.publish_clock:
            return item
        return item.shifted(self._restamper.delay_of(item.stamp, self._rate))

    def _wait_until_due(self, item: ReplayItem) -> None:
        if self._fixed.lockstep:
            # The rate may become 0 during the wait.
            self.playback.wait_until_due(
                item.time,
                (lambda: self._lockstep_rate or _UNLIMITED_RATE) if self._lockstep_rate else None,
            )
            return
        lag = self.playback.wait_until_due(item.time, lambda: self._rate)
        if self.playback.has_restarted:
            self._restamper.follow_clock()
        if lag > 0:
            self._log.warning(
                f"fell {lag:.2f} s behind the source's time at frame {self._published}; "
                f"the rate of {self._rate:g} is too high for this machine",
                throttle_duration_sec=_WARNING_INTERVAL,
            )

    def _send_target(self, item: ReplayItem) -> bool:
        """Send the target if it is in this frame; returns whether it is."""
        if not self._outputs.publish_target(item):
            return False
        self.playback.restart_schedule()
        self._restamper.follow_clock()
        return True

    def _wait_for_tracker(self) -> None:
        """Wait for the peers that lockstep and the target need, else briefly for a subscriber."""
        self._outputs.wait_for_subscriber()
        interval = _WARNING_INTERVAL
        while missing := self._missing():
            self._wait_reason = _waiting_for(missing)
            # The reason must not outlive a change of what is missing.
            if not self.playback.wait_for(lambda: self._missing() != missing, interval):
                self._log.warning(f"{self._wait_reason}{self._outputs.other_topic_hint()}")
                interval = min(2.0 * interval, _MAX_WARNING_INTERVAL)
        self._wait_reason = ""

    def _missing(self) -> list[str]:
        missing = self._outputs.missing_peers()
        if self._fixed.lockstep:
            status_topic = self._status_subscription.topic_name
            if self.count_publishers(status_topic) == 0:
                missing.append(f"a publisher of {status_topic} (a tracker)")
        return missing

    def _wait_for_status(self, item: ReplayItem) -> None:
        while True:
            timeout = self._binding.values["lockstep_timeout"]
            if self.playback.wait_until_processed(item.stamp, timeout):
                self._wait_reason = ""
                return
            stamp = item.stamp / NANOSECONDS
            self._wait_reason = (
                f"no status for frame {self.position} (stamp {stamp:.9f}) on "
                f"{self._status_subscription.topic_name} within {timeout:g} s; "
                f"publishing it again{self._lockstep_hint()}"
            )
            self._log.warning(self._wait_reason, throttle_duration_sec=_WARNING_INTERVAL)
            self._outputs.publish(item)

    def _lockstep_hint(self) -> str:
        """Likely cause of a missing status."""
        missing = self._missing()
        if missing:
            return f"; waiting for {' and '.join(missing)}"
        best_effort = self._outputs.best_effort_subscribers()
        if best_effort:
            return (
                f"; {', '.join(best_effort)} subscribes with best effort, which loses frames; "
                "set it to reliable (tracker: image_reliability)"
            )
        return ""


def _waiting_for(missing: Sequence[str]) -> str:
    return f"waiting for {' and '.join(missing)}" if missing else ""


def _items_from(source: ReplaySource, first: int) -> Generator[ReplayItem, None, None]:
    """The items of a source from an index on, counted from 0."""
    with closing(source.items()) as items:
        yield from itertools.islice(items, first, None)


def main(arguments: list[str] | None = None, source: str | None = None) -> int:
    """Run the replay publisher until its source ends or a signal stops it.

    Args:
        arguments: Command line with program name, by default that of the process.
        source: Replaces the parameter `source`; if it cannot be played, the node does not wait.

    Returns:
        Exit code: 0 at the end or when stopped, 1 after a failure during the playback, 2 if
        `source` cannot be played.
    """
    nodes: list[ReplayNode] = []

    def create() -> ReplayNode:
        given = [] if source is None else [Parameter("source", value=source)]
        node = ReplayNode(parameter_overrides=given)
        nodes.append(node)
        if source is not None and not node.has_started:
            node.exit_code = 2
            node.context.try_shutdown()
        return node

    run(create, arguments)
    return nodes[0].exit_code if nodes else 0


if __name__ == "__main__":
    sys.exit(main())
