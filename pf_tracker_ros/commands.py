"""The executables, which read their command line before they import what takes time.

A signal that comes while `tracker` or `replay` are still importing ends them as any other does.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterator, Sequence
from importlib import import_module
from importlib.util import find_spec
from typing import NoReturn

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
    _require_opencv("tracker")
    _require_ros("tracker")
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
    parser.add_argument(
        "source",
        nargs="?",
        help="a rosbag2 folder or .mcap file, a video, a folder of images or a sequence folder; "
        "the same as the parameter source",
    )
    source = parser.read(sys.argv[1:]).source
    if source is not None and not _is_unicode(source):
        parser.error(f"the name {source!a} is not UTF-8, which ROS needs; rename it")
    _require_opencv("replay")
    _require_ros("replay")
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
    parser.add_argument(
        "source",
        nargs="?",
        help="a recording to play to the tracker from the page: a rosbag2 folder or .mcap file, a "
        "video, a folder of images or a sequence folder; the same as the parameter source",
    )
    source = parser.read(sys.argv[1:]).source
    if source is not None and not _is_unicode(source):
        parser.error(f"the name {source!a} is not UTF-8, which ROS needs; rename it")
    _require_opencv("console")
    _require_ros("console")
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
    _require_opencv("evaluate")
    try:
        from pf_tracker_ros.evaluation.__main__ import main
    except KeyboardInterrupt:
        print("evaluate: interrupted", file=sys.stderr)
        return 130

    return main()


def track() -> int:
    """Run the command `track`, and return its exit code."""
    _require_opencv("track")
    try:
        from pf_tracker_ros.recordings.__main__ import main
    except KeyboardInterrupt:
        print("track: interrupted", file=sys.stderr)
        return 130

    return main()


def _is_unicode(text: str) -> bool:
    try:
        text.encode()
    except UnicodeEncodeError:
        return False
    return True


def _require_opencv(command: str) -> None:
    try:
        require_opencv()
    except ModuleNotFoundError as error:
        print(f"{command}: error: {error}", file=sys.stderr)
        sys.exit(2)


def _require_ros(command: str) -> None:
    try:
        import_module("pf_tracker_ros.node")
    except ModuleNotFoundError as error:
        print(f"{command}: error: {error}", file=sys.stderr)
        sys.exit(2)


class _Parser(argparse.ArgumentParser):
    """Reads what is not for ROS, and tells how ROS is given what was meant for it."""

    def __init__(self, prog: str, description: str, examples: str) -> None:
        super().__init__(
            prog=prog,
            usage=f"{prog} [-h]{'' if prog == 'tracker' else ' [SOURCE]'} [--ros-args ...]",
            description=description,
            epilog=examples,
            formatter_class=argparse.RawDescriptionHelpFormatter,
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

    def error(self, message: str) -> NoReturn:
        self.exit(2, f"{self.prog}: error: {message} ({self.prog} --help tells more)\n")


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
