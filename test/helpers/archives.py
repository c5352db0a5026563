"""What several tests of archives need: options, results, and the processes that write them."""

import contextlib
import json
import os
import signal

from subprocesses import processes_below, wait_until

from pf_tracker_ros.recordings.command_line import parser
from pf_tracker_ros.recordings.plan import apply_parameter_file

TARGET = "target_box: [20, 30, 24, 24]"


def options_of(*arguments):
    """The options of `track` on an archive."""
    options = parser().parse_args(["--archive", "a", "--output", "b", *arguments])
    apply_parameter_file(options)
    return options


def boxes_in(output):
    """Name of a recording to the bytes of its boxes, without hidden folders."""
    found = {path.relative_to(output): path for path in output.rglob("boxes.csv")}
    return {
        str(name.parent): path.read_bytes()
        for name, path in found.items()
        if not any(part.startswith(".") for part in name.parts)
    }


def assert_whole(output):
    """All results outside hidden folders are complete."""
    for name, content in boxes_in(output).items():
        done = json.loads((output / name / "done.json").read_text())
        assert content.count(b"\n") == 1 + (12 if done["error"] else 20)


def wait_for_results(output, count):
    """Wait for a number of finished recordings."""
    wait_until(lambda: len(list(output.glob("day_?/drive_*/done.json"))) >= count)


def kill_worker(driver, name):
    """Kill a process below the driver that has a name in its command line."""
    found = []
    wait_until(lambda: found.extend(processes_below(driver.pid, name)) or found)
    # It may have ended in between.
    with contextlib.suppress(ProcessLookupError):
        os.kill(found[0], signal.SIGKILL)


def fail_late(store, monkeypatch):
    """Lets each upload of a `done.json` into a store fail."""
    put_file = type(store).put_file

    def put(self, local, remote, **further):
        if remote.endswith("done.json"):
            raise ConnectionError("the line is dead")
        put_file(self, local, remote, **further)

    monkeypatch.setattr(type(store), "put_file", put)
