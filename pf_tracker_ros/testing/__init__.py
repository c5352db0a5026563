"""Replay tests: a pytest plugin for the recordings of one's own.

In `conftest.py`:

    pytest_plugins = ["pf_tracker_ros.testing"]

and in a test, with `drive.mcap` and `drive.target.yaml` beside it:

    def test_the_car_is_followed(tracked_recording):
        run = tracked_recording("drive.mcap", preset="default", baseline="drive.boxes.csv")
        run.check(final_state="tracking", mean_overlap=0.8, longest_loss=0.5, milliseconds_per_frame=30)

`pytest --update` stores what is found as the result to compare with. It is a plugin, as fixtures
alone could not add that option; and one that is named, as one that pytest finds by itself would
load with the tests of every package of a workspace.
"""

from pf_tracker_ros.testing.plugin import pytest_addoption, tracked_recording
from pf_tracker_ros.testing.runs import TrackedRun

__all__ = ["TrackedRun", "pytest_addoption", "tracked_recording"]
