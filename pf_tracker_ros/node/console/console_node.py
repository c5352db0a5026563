"""The console's node: a web page about one tracker, in a process of its own."""

from __future__ import annotations

import errno
import os
import sys
from typing import Any

import cv2
from rclpy.node import Node
from rclpy.parameter import Parameter

from pf_tracker_ros.node.console.bridge import ConsoleBridge
from pf_tracker_ros.node.console.console_parameters import ConsoleParameters
from pf_tracker_ros.node.console.played_recording import PlayedRecording
from pf_tracker_ros.node.console.tracker_link import TrackerLink
from pf_tracker_ros.node.console.web_server import WebServer
from pf_tracker_ros.node.parameter_binding import ParameterBinding
from pf_tracker_ros.node.real_time import RealTimePriority
from pf_tracker_ros.node.running import run
from pf_tracker_ros.pages.access import is_loopback
from pf_tracker_ros.parameters import build

NICENESS = 10
"""Of the console's process: the machine is the tracker's first."""
_PROFILE = "FASTRTPS_DEFAULT_PROFILES_FILE"


class ConsoleNode(Node):
    """Serves the page, and plays the recording, from its start to its end.

    Its context is shut down where it cannot.

    Attributes:
        exit_code: 1 where the page cannot be served, else 0.
        url: The address to open, empty where there is none.

    Args:
        prioritize_dds: Whether the process is the node's alone, and a camera waits for its threads
            of DDS: these are to have the priority, all that is started from now on gives way.
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
        """End the web server, then the node."""
        if self._recording:
            self._recording.close()
        if self._server:
            self._server.close()
        super().destroy_node()  # type: ignore[no-untyped-call]

    def _serve(self, parameters: ConsoleParameters) -> None:
        host, port = parameters.host, parameters.port
        server = WebServer(host, port, lambda: ConsoleBridge(link, self._recording))
        link = TrackerLink(self, parameters.tracker, server.receive)
        if parameters.source:
            self._recording = PlayedRecording(
                self, parameters.source, parameters.bag_topic, link.name
            )
            if not self._recording.is_playable:
                self._recording.close()
                self._recording = None
                self._fail(f"{parameters.source} cannot be played; the node replay has said why")
                return
        try:
            server.start()
        except OSError as error:
            is_taken = error.errno == errno.EADDRINUSE
            why = "something else is served there" if is_taken else str(error)
            self._fail(
                f"the page cannot be served on {host}:{port}: {why}; give another one (-p "
                'port:=8643; make console CONSOLE_ARGS="--port 8643")'
            )
            return
        self._server = server
        self.url = server.url
        log = self.get_logger()  # type: ignore[no-untyped-call]
        log.info(f"the console of {link.name} is at {self.url}")
        if not is_loopback(host):
            log.warning(
                f"it can be reached from other machines ('host' is {host}): whoever has this link "
                "can drive the tracker, and the connection is not encrypted"
            )

    def _fail(self, reason: str) -> None:
        self.get_logger().fatal(reason)  # type: ignore[no-untyped-call]
        self.exit_code = 1
        self.context.try_shutdown()


def main(arguments: list[str] | None = None, source: str | None = None) -> int:
    """Run the console until it is told to stop.

    Args:
        arguments: The command line with the program's name, by default that of the process.
        source: In place of the parameter `source`.

    Returns:
        The exit code: 1 where the page cannot be served.
    """
    # No frame of the tracker is to wait for a picture.
    cv2.setNumThreads(1)
    # Where no profile gives Fast DDS more, the memory that it shares is smaller than an image, and
    # a camera waits for each of its readers.
    has_memory = bool(os.environ.get(_PROFILE))
    if has_memory:
        os.nice(NICENESS)
    nodes: list[ConsoleNode] = []

    def create() -> ConsoleNode:
        given = [] if source is None else [Parameter("source", value=source)]
        node = ConsoleNode(prioritize_dds=not has_memory, parameter_overrides=given)
        nodes.append(node)
        return node

    run(create, arguments)
    return nodes[0].exit_code if nodes else 0


if __name__ == "__main__":
    sys.exit(main())
