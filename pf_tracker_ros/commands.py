"""Entry points of the executables. Each parses its command line before the slow imports.

SIGINT and SIGTERM end the nodes (all but `evaluate` and `track`) cleanly even during the imports.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterator, Sequence
from importlib import import_module
from importlib.util import find_spec
from types import ModuleType

from pf_tracker_ros.command_lines import Parser, split_ros_arguments
from pf_tracker_ros.foreign_code import foreign_exit
from pf_tracker_ros.opencv import require_opencv
from pf_tracker_ros.signals import hold_signals

_EXAMPLES = {
    "tracker": """\
examples:
  tracker --ros-args -r image:=/camera/image_raw -p preset:=li2007
  tracker --ros-args --params-file my_tracker.yaml -p target_box:="[293.0, 97.0, 115.0, 82.0]"

Every setting is a ROS parameter: see `ros2 param list /pf_tracker` and `ros2 param describe`.
""",
    "localizer": """\
examples:
  localizer --ros-args -r camera_info:=/camera/camera_info -p camera.height:=1.2
  localizer --ros-args -r camera_info:=/camera/camera_info -r depth:=/camera/depth/image_raw \\
      -r odom:=/odom -p fixed_frame:=odom

Every setting is a ROS parameter: see `ros2 param list /localizer` and `ros2 param describe`.
""",
    "replay": """\
examples:
  replay drive.mcap
  replay drive.mp4 --ros-args -r image:=/camera/image_raw -p rate:=0.5 -p loop:=true

Other settings are ROS parameters: see `ros2 param list /replay` and `ros2 param describe`.
""",
    "console": """\
examples:
  console
  console drive.mcap
  console bags/*.mcap
  console --ros-args -p port:=8700 -p tracker:=/left/pf_tracker

Then open the printed address. Other settings are ROS parameters: see `ros2 param list /console`
and `ros2 param describe`.
""",
    "watch": """\
examples:
  watch
  watch --once
  watch --rate 0 --ros-args -r pf_tracker/status:=/left/pf_tracker/status
""",
}
_ARGUMENTS = {
    "tracker": "",
    "localizer": "",
    "replay": " [SOURCE]",
    "console": " [SOURCE ...]",
    "watch": " [--rate HZ] [--once]",
}


def tracker() -> None:
    """Run the tracker node."""
    _Parser("tracker", "Track targets in the images of a topic (ROS node pf_tracker).").read()
    _node("tracker.tracker_node").main()


def localizer() -> None:
    """Run the localizer node."""
    _Parser(
        "localizer", "Tell where the tracker's targets are, in meters (ROS node localizer)."
    ).read()
    _node("localizer.localizer_node").main()


def replay() -> int:
    """Run the replay publisher, and return its exit code."""
    parser = _Parser("replay", "Publish a recording like a camera (ROS node replay).")
    source = next(iter(parser.read_sources("", nargs="?")), None)
    return int(_node("replay.replay_node").main(source=source))


def console() -> int:
    """Run the console, and return its exit code."""
    parser = _Parser(
        "console", "Serve a web page that shows and controls the tracker (ROS node console)."
    )
    sources = parser.read_sources("recordings to play from the page, the first one first: ")
    if find_spec("aiohttp") is None:
        parser.exit(
            2,
            "console: error: the Python package aiohttp is missing; install this package's extra "
            "'console' with pip, or python3-aiohttp with apt\n",
        )
    return int(_node("console.console_node").main(sources=sources))


def watch() -> None:
    """Run the node that prints boxes and positions."""
    parser = _Parser(
        "watch",
        "Print what tracker and localizer publish: a line with state, confidence and box or "
        "position of each target (ROS node watch).",
    )
    parser.add_argument(
        "--rate",
        type=_lines_a_second,
        default=2.0,
        metavar="HZ",
        help="lines a second for each target, and one for each change of its state; 0 prints every "
        "frame (default: %(default)g)",
    )
    parser.add_argument("--once", action="store_true", help="end after the first frame of a target")
    options = parser.read()
    _node("watch.watch_node").main(rate=options.rate, once=options.once)


def _lines_a_second(text: str) -> float:
    rate = float(text)
    if not 0.0 <= rate <= 1000.0:
        raise argparse.ArgumentTypeError(f"{text!r}; allowed: 0 to 1000")
    return rate


def evaluate() -> int:
    """Run the command `evaluate`, and return its exit code."""
    return _run("evaluate", "pf_tracker_ros.evaluation.__main__")


def track() -> int:
    """Run the command `track`, and return its exit code."""
    return _run("track", "pf_tracker_ros.recordings.__main__")


def tune() -> int:
    """Run the command `tune`, and return its exit code."""
    return _run("tune", "pf_tracker_ros.tuning.__main__")


def model() -> int:
    """Run the command `model`, and return its exit code."""
    return _run("model", "pf_tracker_ros.networks.__main__")


def _run(command: str, module: str) -> int:
    """Run a command that needs no ROS."""
    try:
        return int(_import_or_exit(command, module).main())
    except KeyboardInterrupt:
        # Interrupted during the imports; the commands handle later interrupts themselves.
        print(f"{command}: interrupted", file=sys.stderr)
        return 130
    except SystemExit as ended:
        # A part of another package may raise it in any method.
        if not (where := foreign_exit(ended)):
            raise
        advice = "remove its package, or choose none of its parts"
        print(f"{command}: error: {where}; {advice}", file=sys.stderr)
        return 1


def _node(module: str) -> ModuleType:
    """Import the module of a node, or end the program with the name of the missing package."""
    return _import_or_exit(module.partition(".")[0], f"pf_tracker_ros.node.{module}")


def _import_or_exit(command: str, module: str) -> ModuleType:
    """Import a command's module, or end the program with the name of the missing package."""
    try:
        require_opencv()
        return import_module(module)
    except ModuleNotFoundError as error:
        print(f"{command}: error: {error}", file=sys.stderr)
        sys.exit(2)


class _Parser(Parser):
    """Parser of the arguments outside --ros-args; errors show the ROS form of a parameter.

    Its construction begins to hold signals.
    """

    def __init__(self, prog: str, description: str) -> None:
        hold_signals()
        super().__init__(
            prog,
            usage=f"{prog} [-h]{_ARGUMENTS[prog]} [--ros-args ...]",
            description=description,
            epilog=_EXAMPLES[prog],
            allow_abbrev=False,
        )

    def read(self) -> argparse.Namespace:
        """Parse this process' command line; ROS arguments are ignored."""
        own, _ = split_ros_arguments(sys.argv[1:])
        options, unknown = self.parse_known_args(own)
        if unknown:
            self.error(
                f"unknown argument {' '.join(unknown)}; set parameters and remappings by "
                f"{self.prog} --ros-args {' '.join(_as_parameters(unknown))}"
            )
        return options

    def read_sources(self, purpose: str, nargs: str = "*") -> list[str]:
        """Parse this process' command line; returns its sources, as many as `nargs` allows."""
        self.add_argument(
            "source",
            nargs=nargs,
            help=f"{purpose}rosbag2 folder, .mcap file, video, folder of images or sequence "
            "folder; same as the parameter source",
        )
        given = self.read().source
        sources = [given] if isinstance(given, str) else list(given or ())
        for source in sources:
            try:
                source.encode()
            except UnicodeEncodeError:
                self.error(
                    f"the file name {source!a} is not UTF-8, as ROS requires; rename the file"
                )
        return sources


def _as_parameters(unknown: Sequence[str]) -> Iterator[str]:
    """Arguments such as `--preset li2007` in ROS form; an example for any others."""
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
