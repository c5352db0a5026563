"""What several tests of archives need: options, and tasks in this process."""

from pf_tracker_ros.recordings.command_line import parser
from pf_tracker_ros.recordings.plan import apply_parameter_file

TARGET = "target_box: [20, 30, 24, 24]"


def options_of(*arguments):
    """The options of `track` on an archive."""
    options = parser().parse_args(["--archive", "a", "--output", "b", *arguments])
    apply_parameter_file(options)
    return options


def fail_late(store, monkeypatch):
    """Lets each upload of a `done.json` into a store fail."""
    put_file = type(store).put_file

    def put(self, local, remote, **further):
        if remote.endswith("done.json"):
            raise ConnectionError("the line is dead")
        put_file(self, local, remote, **further)

    monkeypatch.setattr(type(store), "put_file", put)
