"""The executables, which read their command line before they import what takes time.

A signal that comes while `tracker` or `replay` are still importing ends them as any other does.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterator, Sequence
from importlib import import_module
from importlib.util import find_spec
from types import ModuleType

from pf_tracker_ros.command_lines import Parser
from pf_tracker_ros.opencv import require_opencv
from pf_tracker_ros.ros_arguments import split_ros_arguments
from pf_tracker_ros.signals import hold_signals

_TRACKER_EXAMPLES = """\
examples:
  tracker --ros-args -r image:=/camera/image_raw -p preset:=li2007
  tracker --ros-args --params-file my_tracker.yaml -p target_box:="[293.0, 97.0, 115.0, 82.0]"

Everything is a ROS parameter: `ros2 param list /pf_tracker` and `ros2 param describe` tell of each.
"""
_REPLAY_EXAMPLES = """\
examples:
  replay drive.mcap
  replay drive.mp4 --ros-args -r image:=/camera/image_raw -p rate:=0.5 -p loop:=true

The rest is ROS parameters: `ros2 param list /replay` and `ros2 param describe` tell of each.
"""
_CONSOLE_EXAMPLES = """\
examples:
  console
  console drive.mcap
  console --ros-args -p port:=8700 -p tracker:=/left/pf_tracker

Then open the address that it writes. The rest is ROS parameters: `ros2 param list /console` and
`ros2 param describe` tell of each.
"""


def tracker() -> None:
    """Run the tracker node."""
    hold_signals()
    parser = _Parser(
        "tracker",
        "Track a target in the images of a topic: the ROS node pf_tracker.",
        _TRACKER_EXAMPLES,
    )
    parser.read(sys.argv[1:])
    _require("tracker", "pf_tracker_ros.node")
    from pf_tracker_ros.node.tracker.tracker_node import main

    main()


def replay() -> int:
    """Run the replay publisher, and return its exit code."""
    hold_signals()
    parser = _Parser(
        "replay",
        "Publish a recording as a camera does: the ROS node replay.",
        _REPLAY_EXAMPLES,
    )
    source = parser.read_source("")
    _require("replay", "pf_tracker_ros.node")
    from pf_tracker_ros.node.replay.replay_node import main

    return main(source=source)


def console() -> int:
    """Run the console, and return its exit code."""
    hold_signals()
    parser = _Parser(
        "console",
        "Serve a web page that shows what the tracker sees, and drives it: the ROS node console.",
        _CONSOLE_EXAMPLES,
    )
    source = parser.read_source("a recording to play to the tracker from the page: ")
    _require("console", "pf_tracker_ros.node")
    if find_spec("aiohttp") is None:
        print(
            "console: error: the Python package aiohttp is missing; install the extra 'console' of "
            "this package with pip, or python3-aiohttp with apt",
            file=sys.stderr,
        )
        sys.exit(2)
    from pf_tracker_ros.node.console.console_node import main

    return main(source=source)


def evaluate() -> int:
    """Run the command `evaluate`, and return its exit code."""
    return _run("evaluate", "pf_tracker_ros.evaluation.__main__")


def track() -> int:
    """Run the command `track`, and return its exit code."""
    return _run("track", "pf_tracker_ros.recordings.__main__")


def _run(command: str, module: str) -> int:
    """Run a command that needs no ROS."""
    try:
        return int(_require(command, module).main())
    except KeyboardInterrupt:
        # Later ones are caught, and told with what they have ended.
        print(f"{command}: interrupted", file=sys.stderr)
        return 130


def _require(command: str, module: str) -> ModuleType:
    """Import what a command needs, or end it with what is missing."""
    try:
        require_opencv()
        return import_module(module)
    except ModuleNotFoundError as error:
        print(f"{command}: error: {error}", file=sys.stderr)
        sys.exit(2)


class _Parser(Parser):
    """Reads what is not for ROS, and tells how ROS is given what was meant for it."""

    def __init__(self, prog: str, description: str, examples: str) -> None:
        super().__init__(
            prog,
            usage=f"{prog} [-h]{'' if prog == 'tracker' else ' [SOURCE]'} [--ros-args ...]",
            description=description,
            epilog=examples,
            allow_abbrev=False,
        )

    def read(self, command_line: Sequence[str]) -> argparse.Namespace:
        """Parse a command line without the program's name; its ROS arguments are left out."""
        own, _ = split_ros_arguments(command_line)
        options, unknown = self.parse_known_args(own)
        if unknown:
            self.error(
                f"there is no argument {' '.join(unknown)}; parameters and remappings are "
                f"given to ROS: {self.prog} --ros-args {' '.join(_as_parameters(unknown))}"
            )
        return options

    def read_source(self, purpose: str) -> str | None:
        """Parse this process' command line, which may name a source; its ROS arguments stay."""
        self.add_argument(
            "source",
            nargs="?",
            help=f"{purpose}a rosbag2 folder or .mcap file, a video, a folder of images or a "
            "sequence folder; the same as the parameter source",
        )
        source: str | None = self.read(sys.argv[1:]).source
        try:
            (source or "").encode()
        except UnicodeEncodeError:
            self.error(f"the name {source!a} is not UTF-8, which ROS needs; rename it")
        return source


def _as_parameters(unknown: Sequence[str]) -> Iterator[str]:
    """Arguments such as `--preset li2007` as ROS takes them; an example if they are not."""
    if unknown[0] in ("-p", "-r"):
        yield from unknown
        return
    names = [word for word in unknown if word.startswith("--")]
    for name in names or ["--NAME=VALUE"]:
        option, equals, value = name.removeprefix("--").partition("=")
        if not equals:
            following = unknown[unknown.index(name) + 1 :][:1]
            value = following[0] if following and not following[0].startswith("-") else "VALUE"
        yield f"-p {option}:={value}"
