"""Replay tests: a pytest plugin that tests the tracker on the user's recordings.

In `conftest.py`:

    pytest_plugins = ["pf_tracker_ros.testing"]

and in a test, with `drive.mcap` and `drive.target.yaml` in the same folder:

    def test_the_car_is_tracked(tracked_recording):
        run = tracked_recording("drive.mcap", preset="default", baseline="drive.boxes.csv")
        run.check(final_state="tracking", mean_overlap=0.8, longest_loss=0.5)

`pytest --update` stores the result as the baseline. The plugin is loaded by name, because an entry
point would load it in the tests of every package of a workspace.
"""

from pf_tracker_ros.testing.plugin import pytest_addoption, tracked_recording
from pf_tracker_ros.testing.runs import TrackedRun

__all__ = ["TrackedRun", "pytest_addoption", "tracked_recording"]
