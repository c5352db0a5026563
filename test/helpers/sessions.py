"""Sessions of the library that are shown drawn frames, ten a second."""

from pf_tracker_ros.frames import Frame
from pf_tracker_ros.targets.session import Session
from pf_tracker_ros.tracking.presets import preset_parameters

SECOND = 1_000_000_000
START = 1_700_000_000 * SECOND
STEP = SECOND // 10


def at(number):
    """The stamp of a frame."""
    return START + number * STEP


def make_session(max_targets, seed=0, **parameters):
    """A session with a frame buffer for all late input."""
    named = {name.replace("__", "."): value for name, value in parameters.items()}
    session = Session(preset_parameters("default", max_targets) | named, seed)
    session.frame_buffer.limit(frames=200, megabytes=128.0)
    return session


def show(session, drawn, numbers, every=0, targets=None):
    """Process frames, each `every`th with detections, of all or some targets; the last outcome."""
    for number in numbers:
        if every and number % every == 0:
            session.add_detections(drawn.detections(number, targets), at(number))
        outcome = session.process(Frame(drawn.images[number], at(number)))
    return outcome


def ids(outcome):
    """The ids of its targets."""
    return [target.id for target in outcome.targets]
