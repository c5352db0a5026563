"""Track drawn clips with the ROS node, let a robot follow a person, and write the results.

For each clip:

1. Draw the frames into an MCAP bag.
2. Run the executables `replay` and `tracker` in lockstep, so each run gives the same boxes. If the
   built-in detector starts the targets, they may start a frame earlier or later.
3. Record the outputs of the tracker.
4. Write result.mcap, result.json, overlay.mp4 and contact_sheet.png to demo/<clip>/.
5. Track the bag with the executable `track`, without ROS, and write the report.

Then let a robot follow a person through a room (`follower.py`). After each of these the page
demo/index.html has more; the browser loads it again until it is complete.
"""

from __future__ import annotations

import argparse
import os
import shutil
import sys
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path

import follower
from clips import CLIPS, Clip
from failure import DemoError
from follower import FollowerResult
from page import PAGE, ClipResult, write_page
from processes import NodeProcess, run_to_end
from recording import RECORDED_STATUS, Recorder
from report import (
    Summary,
    add_row,
    collect,
    read_overlays,
    summary_table,
    write_bag,
    write_contact_sheet,
    write_json,
    write_video,
)
from rich.console import Console

from pf_tracker_ros.footage import Footage, FootageError, write_footage
from pf_tracker_ros.ros_domains import unused_domain

FOLDER = Path(__file__).resolve().parent
DDS_PROFILE = FOLDER.parent / "config" / "fastdds_large_images.xml"
LOGS = "log"
_MEETING_TIMEOUT = 30.0
_REPLAY_TIMEOUT = 600.0
# Longer than the 3 s after which DDS sends lost messages again.
_ANSWER_TIMEOUT = 5.0


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the demo.

    Args:
        arguments: Command line without the program name; None for that of the process.

    Returns:
        The exit code, 1 if a step failed.
    """
    parser = argparse.ArgumentParser(description=str(__doc__).partition("\n")[0])
    parser.add_argument(
        "--output", type=Path, default=FOLDER, help="folder for a folder of results per clip"
    )
    output = parser.parse_args(arguments).output.resolve()
    console = Console()
    began = time.monotonic()
    # A page of an earlier run would show what this one replaces.
    with suppress(OSError):
        (output / PAGE).unlink()
    try:
        table = summary_table()
        results: list[ClipResult] = []
        for clip in CLIPS:
            folder = output / clip.name
            summary = run_clip(console, clip, folder)
            add_row(table, clip.name, summary, os.path.relpath(folder))
            results.append(ClipResult(clip, summary, track_arguments(clip, folder)))
            page = write_page(results, None, output)
            if len(results) == 1:
                # Not by `print` of Rich, which would break the address.
                print(f"first video, more to come: {page.as_uri()}", flush=True)
        followed = run_follower(console, output / follower.NAME)
        page = write_page(results, followed, output)
    except StepFailed as failure:
        console.print(f"[bold red]failed[/] {failure.step}: ", end="")
        console.print(str(failure.error), markup=False)
        console.print(failure.details, markup=False, style="dim")
        return 1
    except KeyboardInterrupt:
        console.print("interrupted")
        return 130
    console.print(table)
    console.print(f"{followed.name}: {followed.errors}", markup=False, soft_wrap=True)
    console.print(f"all of it: {time.monotonic() - began:.0f} s", style="dim")
    print(f"videos, reports and bags on one page: {page.as_uri()}")
    return 0


class StepFailed(Exception):  # noqa: N818
    """A step of the demo failed."""

    def __init__(self, step: str, error: Exception) -> None:
        """Store the name of the step and the error."""
        super().__init__(str(error))
        self.step = step
        self.error = error
        self.details = error.details if isinstance(error, DemoError) else ""


@contextmanager
def step(console: Console, name: str) -> Iterator[None]:
    """Show a step while it runs; raises `StepFailed` with its name if it fails."""
    began = time.monotonic()
    try:
        with console.status(name):
            yield
    except (DemoError, FootageError, OSError) as error:
        raise StepFailed(name, error) from error
    console.print(f"{name}: {time.monotonic() - began:.1f} s", style="dim")


def run_clip(console: Console, clip: Clip, folder: Path) -> Summary:
    """Track one clip and write its results.

    Args:
        console: Shows the steps.
        clip: The clip.
        folder: Folder for the results; emptied first.

    Returns:
        The figures of the clip.

    Raises:
        StepFailed: A step failed.
    """
    with step(console, f"{clip.name}: drawing the bag"):
        bag = folder / clip.bag
        footage = clip.draw()
        # Complete before it replaces another: a console may be playing that.
        drawn = bag.with_name(f"new_{bag.name}")
        clear(folder, kept=bag)
        write_footage(footage, drawn)
        drawn.replace(bag)
        stamps = [frame.stamp for frame in footage.frames()]
    with ros_domain(folder), Recorder(several=clip.box is None) as recorder:
        with step(console, f"{clip.name}: replaying it into the tracker"):
            track(clip, recorder, folder)
        with step(console, f"{clip.name}: writing the results"):
            summary = write_results(clip, recorder, stamps, footage, folder)
    with step(console, f"{clip.name}: tracking it without ROS, for the report"):
        run_to_end("track", track_arguments(clip, folder), folder / LOGS / "track.log")
    return summary


def run_follower(console: Console, folder: Path) -> FollowerResult:
    """Let the robot follow; arguments as for `run_clip`."""
    with step(console, f"{follower.NAME}: driving after a person"):
        clear(folder)
        rows = follower.drive(folder)
    with step(console, f"{follower.NAME}: locating the person, for the report"):
        return follower.locate(folder, rows)


def clear(folder: Path, kept: Path | None = None) -> None:
    """Remove the files of an earlier run, but for one, and make the folder of the logs."""
    folder.mkdir(parents=True, exist_ok=True)
    for old in folder.iterdir():
        if old.is_dir():
            shutil.rmtree(old)
        elif old != kept:
            old.unlink()
    (folder / LOGS).mkdir()


def track_arguments(clip: Clip, folder: Path) -> list[str]:
    """Arguments of `track` that give the node's boxes from the bag of a clip."""
    arguments = [str(folder / clip.bag)]
    parameters = dict(clip.parameters)
    if clip.box:
        arguments += ["--box", ",".join(f"{value:g}" for value in clip.box)]
    else:
        arguments += ["--detector", str(parameters.pop("built_in_detector"))]
        arguments += ["--detector-rate", str(parameters.pop("built_in_detector_rate"))]
    arguments += [f"--parameter={name}={value}" for name, value in parameters.items()]
    return [*arguments, "--output", str(folder / "tracked"), "--bag", "--video", "--report"]


@contextmanager
def ros_domain(folder: Path) -> Iterator[None]:
    """Use a free ROS domain on the loopback interface, and log to the folder of the clip."""
    with unused_domain() as domain:
        os.environ["ROS_DOMAIN_ID"] = str(domain)
        os.environ["ROS_AUTOMATIC_DISCOVERY_RANGE"] = "LOCALHOST"
        os.environ["FASTRTPS_DEFAULT_PROFILES_FILE"] = str(DDS_PROFILE)
        os.environ["ROS_LOG_DIR"] = str(folder / LOGS)
        yield


def track(clip: Clip, recorder: Recorder, folder: Path) -> None:
    """Run the tracker and the replay publisher until every frame is recorded.

    Raises:
        DemoError: A process failed or timed out.
    """
    tracker = NodeProcess(
        "tracker",
        folder / LOGS / "tracker.log",
        image_reliability="reliable",
        seed=0,
        **clip.parameters,
    )
    with tracker:
        if not recorder.meet_tracker(_MEETING_TIMEOUT, tracker.check):
            raise tracker.failure(f"the tracker did not answer within {_MEETING_TIMEOUT:g} s")
        replay = NodeProcess(
            "replay",
            folder / LOGS / "replay.log",
            source=folder / clip.bag,
            lockstep=True,
            lockstep_status=RECORDED_STATUS,
            lockstep_timeout=_ANSWER_TIMEOUT,
            # A quarter of the real-time rate: a busy machine detects people in time, too.
            **({"target_box": list(clip.box)} if clip.box else {"lockstep_rate": 0.25}),
        )
        with replay:

            def has_ended() -> bool:
                tracker.check()
                replay.check()
                return replay.exit_code == 0

            if not recorder.wait_until(has_ended, _REPLAY_TIMEOUT):
                raise replay.failure(f"the replay did not end within {_REPLAY_TIMEOUT:g} s")


def write_results(
    clip: Clip, recorder: Recorder, stamps: list[int], footage: Footage, folder: Path
) -> Summary:
    """Write the recorded messages, and return the figures of the clip.

    Raises:
        DemoError: A message was not recorded, or a file cannot be written.
    """
    results = collect(recorder, stamps)
    write_bag(recorder, stamps, folder / "result.mcap")
    write_json(clip.name, results, folder / "result.json")
    overlays = read_overlays(recorder, stamps)
    write_video(overlays, 1.0 / footage.nominal_interval, folder / "overlay.mp4")
    write_contact_sheet(overlays, folder / "contact_sheet.png")
    return Summary.of(results)


if __name__ == "__main__":
    sys.exit(main())
