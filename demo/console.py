"""Run the console on the clips of the demo, without a camera.

1. Draw each clip into a bag, once.
2. Start the executable `tracker`.
3. Start the executable `console`, which plays the bags to the tracker. Its tour, `tour.yaml`, says
   what to try with each of them.
"""

from __future__ import annotations

import argparse
import os
import signal
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path

from clips import CLIPS, Clip
from failure import DemoError
from processes import NodeProcess
from rich.console import Console
from run import FOLDER, LOGS, StepFailed, ros_domain, step

from pf_tracker_ros.footage import FootageError, write_footage
from pf_tracker_ros.node.console.playlist import read_tour
from pf_tracker_ros.recordings import RecordingError

TOUR = FOLDER / "tour.yaml"
_NAMES = [clip.name for clip in CLIPS]


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the console until it is interrupted or terminated.

    Args:
        arguments: Command line without the program name; None for that of the process.

    Returns:
        The exit code, 1 if a step failed.
    """
    signal.signal(signal.SIGTERM, _end)
    parser = argparse.ArgumentParser(description=str(__doc__).partition("\n")[0])
    parser.add_argument("--clip", choices=_NAMES, default=_NAMES[0], help="what to look at first")
    parser.add_argument("--port", type=int, default=8642, help="to serve the page on")
    given = parser.parse_args(arguments)
    folder = FOLDER / given.clip
    try:
        console = Console()
        recordings = {clip.name: _recording_of(clip, console) for clip in CLIPS}
        recording = recordings[given.clip]
        first = next(entry for entry in read_tour(TOUR) if entry.path == recording)
        with ros_domain(folder):
            tracker = NodeProcess("tracker", folder / LOGS / "tracker.log", **first.parameters)
            with tracker:
                domain = os.environ["ROS_DOMAIN_ID"]
                print(f"other nodes and commands join by ROS_DOMAIN_ID={domain}", flush=True)
                print("Ctrl-C ends tracker and console", flush=True)
                return _serve(recording, given.port)
    except StepFailed as failure:
        print(f"error: {failure.step}: {failure}", file=sys.stderr)
        return 1
    except (DemoError, FootageError, RecordingError, OSError) as error:
        print(f"error: {error}", file=sys.stderr)
        return 1
    except KeyboardInterrupt:
        return 0


def _recording_of(clip: Clip, console: Console) -> Path:
    """The bag of a clip, written if missing."""
    folder = FOLDER / clip.name
    (folder / LOGS).mkdir(parents=True, exist_ok=True)
    recording = folder / clip.bag
    if not recording.exists():
        with step(console, f"{clip.name}: drawing the bag"):
            write_footage(clip.draw(), recording)
    return recording


def _end(*_: object) -> None:
    """Handle SIGTERM like Ctrl-C, so that tracker and console end too."""
    raise KeyboardInterrupt


def _serve(recording: Path, port: int) -> int:
    """Run the console in the foreground, and return its exit code."""
    executable = Path(sys.executable).parent / "console"
    command = [str(executable), str(recording), "--ros-args"]
    command += ["-p", f"port:={port}", "-p", f"tour:={TOUR}"]
    with subprocess.Popen(command, env=os.environ) as process:
        while True:
            try:
                return process.wait()
            except KeyboardInterrupt:
                # A terminal sends SIGINT to the console too, other senders do not.
                process.send_signal(signal.SIGINT)


if __name__ == "__main__":
    sys.exit(main())
