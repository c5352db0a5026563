"""The console's node: a web page about one tracker, in a process of its own."""

from __future__ import annotations

import errno
import os
import sys
from collections.abc import Sequence
from typing import Any

import cv2
from rclpy.node import Node
from rclpy.parameter import Parameter

from pf_tracker_ros.node.console.bridge import ConsoleBridge
from pf_tracker_ros.node.console.console_parameters import ConsoleParameters
from pf_tracker_ros.node.console.played_recording import PlayedRecording
from pf_tracker_ros.node.console.playlist import ListedRecording, list_recordings
from pf_tracker_ros.node.console.tracker_link import TrackerLink
from pf_tracker_ros.node.console.web_server import WebServer
from pf_tracker_ros.node.parameter_binding import ParameterBinding
from pf_tracker_ros.node.real_time import RealTimePriority
from pf_tracker_ros.node.running import run
from pf_tracker_ros.pages.access import is_loopback
from pf_tracker_ros.parameters import build
from pf_tracker_ros.recordings import RecordingError

NICENESS = 10
"""Niceness of the console's process: the tracker goes first."""
_PROFILE = "FASTRTPS_DEFAULT_PROFILES_FILE"


class ConsoleNode(Node):
    """Serves the page, and plays the recording.

    On an error it shuts down its context.

    Attributes:
        exit_code: 1 if the page cannot be served, else 0.
        url: The address to open, empty on an error.

    Args:
        prioritize_dds: Whether to raise the niceness now, after the start of the DDS threads, and
            to request real-time priority for those: a camera may wait for them. Only for a process
            of its own.
        **options: Of `rclpy.node.Node`.
    """

    def __init__(self, *, prioritize_dds: bool = False, **options: Any) -> None:
        super().__init__("console", **options)
        if prioritize_dds:
            os.nice(NICENESS)
        self.exit_code = 0
        self.url = ""
        self._server: WebServer | None = None
        self._recording: PlayedRecording | None = None
        binding = ParameterBinding(self)
        binding.declare(ConsoleParameters)
        binding.listen()
        if binding.refused:
            self._fail("; ".join(binding.refused.values()))
            return
        parameters = build(ConsoleParameters, binding.values)
        if prioritize_dds:
            log = self.get_logger()  # type: ignore[no-untyped-call]
            RealTimePriority(log.warning).request_priority(parameters.realtime_priority)
        self._serve(parameters)

    def destroy_node(self) -> None:
        """Stop the recording, the web server and the node."""
        if self._recording:
            self._recording.close()
        if self._server:
            self._server.close()
        super().destroy_node()  # type: ignore[no-untyped-call]

    def _serve(self, parameters: ConsoleParameters) -> None:
        host, port = parameters.host, parameters.port
        server = WebServer(host, port, lambda: ConsoleBridge(link, self._recording))
        link = TrackerLink(self, parameters.tracker, server.receive)
        try:
            self._recording = self._open_recording(parameters, link.name)
        except RecordingError as error:
            self._fail(str(error))
            return
        try:
            server.start()
        except OSError as error:
            is_taken = error.errno == errno.EADDRINUSE
            reason = "the port is in use" if is_taken else str(error)
            self._fail(
                f"the page cannot be served on {host}:{port}: {reason}; give another port (-p "
                'port:=8643; make console CONSOLE_ARGS="--port 8643")'
            )
            return
        self._server = server
        self.url = server.url
        log = self.get_logger()  # type: ignore[no-untyped-call]
        log.info(f"the console of {link.name} is at {self.url}")
        if not is_loopback(host):
            log.warning(
                f"other machines can reach the page ('host' is {host}): anybody with this link can "
                "control the tracker, and the connection is not encrypted"
            )

    def _open_recording(
        self, parameters: ConsoleParameters, tracker: str
    ) -> PlayedRecording | None:
        """The recording to play first, with all others to choose from; None if there is none.

        Raises:
            RecordingError: It cannot be played, or the tour is invalid.
        """
        source = parameters.source
        listed = list_recordings(source, parameters.recordings, parameters.tour)
        if not listed:
            return None
        first = ListedRecording(source).path if source else listed[0].path
        index = [one.path for one in listed].index(first)
        return PlayedRecording(self, listed, index, parameters.bag_topic, tracker)

    def _fail(self, reason: str) -> None:
        self.get_logger().fatal(reason)  # type: ignore[no-untyped-call]
        self.exit_code = 1
        self.context.try_shutdown()


def main(arguments: list[str] | None = None, sources: Sequence[str] = ()) -> int:
    """Run the console until it is shut down.

    Args:
        arguments: Command line with the program's name; by default that of the process.
        sources: The first overrides the parameter `source`, the others `recordings`.

    Returns:
        The exit code: 1 if the page cannot be served.
    """
    # One thread for encoding, so that the tracker keeps the other cores.
    cv2.setNumThreads(1)
    # Without a profile, Fast DDS' shared memory is smaller than an image, and a camera waits for
    # each of its readers.
    has_profile = bool(os.environ.get(_PROFILE))
    if has_profile:
        os.nice(NICENESS)
    nodes: list[ConsoleNode] = []

    def create() -> ConsoleNode:
        overrides = [Parameter("source", value=one) for one in sources[:1]]
        if sources[1:]:
            overrides.append(Parameter("recordings", value=list(sources[1:])))
        node = ConsoleNode(prioritize_dds=not has_profile, parameter_overrides=overrides)
        nodes.append(node)
        return node

    run(create, arguments)
    return nodes[0].exit_code if nodes else 0


if __name__ == "__main__":
    sys.exit(main())
