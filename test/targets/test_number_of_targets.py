"""One target or several, by `max_targets`: from the start, or changed during a session."""

import sys

import numpy as np
import pytest
from common import run_python
from sessions import SECOND, START, STEP, at, ids, make_session, show

from pf_tracker_ros.frames import Frame
from pf_tracker_ros.targets.session import Session
from pf_tracker_ros.tracking.frame_clock import TimePolicy
from pf_tracker_ros.tracking.presets import preset_parameters


def configure(session, max_targets):
    session.configure(preset_parameters("default", max_targets), seed=0)


# Changed while targets are followed


def test_a_single_target_keeps_its_id_when_max_targets_increases(walkers, iou):
    session = make_session(1)
    session.request(tuple(walkers.boxes[0][0]))
    before = show(session, walkers, range(5))
    configure(session, 4)
    assert ids(show(session, walkers, [5])) == ids(before) == [1]
    session.request(tuple(walkers.boxes[6][1]), at(6), "second")
    outcome = show(session, walkers, range(6, 12))
    assert ids(outcome) == [1, 2]
    for target, place in zip(outcome.targets, (0, 1), strict=True):
        assert iou(target.estimate.box, walkers.boxes[11][place]) > 0.6
    assert ids(show(session, walkers, range(12, 16), 2, [2])) == [1, 2, 3]


def test_with_max_targets_1_a_new_target_replaces_the_several_there_are(walkers, iou):
    session = make_session(4)
    for place in range(3):
        session.request(tuple(walkers.boxes[0][place]))
    assert show(session, walkers, range(4)).started == ()
    configure(session, 1)
    outcome = show(session, walkers, range(4, 8))
    assert ids(outcome) == [1, 2, 3]
    session.request(tuple(walkers.boxes[8][1]), at(8))
    outcome = show(session, walkers, range(8, 12))
    assert ids(outcome) == [4]
    assert iou(outcome.targets[0].estimate.box, walkers.boxes[11][1]) > 0.6


@pytest.mark.parametrize(("before", "after"), [(1, 4), (4, 1)])
def test_a_refused_change_of_max_targets_changes_nothing(walkers, as_told, before, after):
    sessions = [make_session(before), make_session(before)]
    for session in sessions:
        session.request(tuple(walkers.boxes[0][0]))
        show(session, walkers, range(3))
    wrong = preset_parameters("default", after) | {"particles": 0}
    for attempt in (sessions[0].check, sessions[0].configure):
        with pytest.raises(ValueError, match="particles"):
            attempt(wrong, 0)
    outputs = [as_told(show(session, walkers, range(3, 8)).targets) for session in sessions]
    assert outputs[0] == outputs[1]


# The selected target


def test_the_estimate_is_that_of_the_selected_target(walkers):
    session = make_session(4)
    for place in range(3):
        session.request(tuple(walkers.boxes[0][place]))
    outcome = show(session, walkers, [0])
    assert (session.selected, outcome.selected, outcome.estimate) == (0, 0, None)
    session.select(2)
    outcome = show(session, walkers, [1])
    assert outcome.selected == session.selected == 2
    assert outcome.estimate is outcome.targets[1].estimate is session.estimate
    session.select(0)
    assert (session.selected, session.estimate) == (0, None)


@pytest.mark.parametrize("id", [3, -1, True, "1", 1.5])
def test_an_unknown_id_cannot_be_selected(walkers, id):
    session = make_session(4)
    for place in range(2):
        session.request(tuple(walkers.boxes[0][place]))
    show(session, walkers, [0])
    session.select(2)
    with pytest.raises(ValueError, match=rf"no target has the id {id!r}; there are: 1, 2"):
        session.select(id)
    assert session.selected == 2


def test_a_lost_target_stays_selected_and_a_stopped_one_is_not_replaced(walkers):
    session = make_session(4, track__lost_after=0.3, redetection__windows=0)
    for place in range(2):
        session.request(tuple(walkers.boxes[0][place]))
    show(session, walkers, range(3))
    session.select(1)
    for number in range(3, 20):
        image = walkers.images[number].copy()
        image[20:80] = 128
        outcome = session.process(Frame(image, at(number)))
    assert outcome.targets[0].estimate.state == "lost"
    assert (outcome.selected, outcome.estimate) == (1, outcome.targets[0].estimate)
    session.stop_target(1)
    outcome = show(session, walkers, [20])
    assert (ids(outcome), outcome.selected, outcome.estimate) == ([2], 0, None)


def test_a_target_that_has_left_stays_selected_until_it_is_reidentified(leaver):
    session = make_session(4)
    show(session, leaver, range(10), 2, [0, 1])
    (id,) = (one.id for one in session.targets if one.estimate.box[0] > 150)
    session.select(id)
    # The first target has left the image from frame 14 to 39.
    outcome = show(session, leaver, range(10, 36), every=2)
    assert (outcome.selected, outcome.estimate.state) == (id, "lost")
    outcome = show(session, leaver, range(36, 50), every=2)
    assert id in ids(outcome)
    assert outcome.estimate is not None


def test_a_single_target_is_always_selected(walkers):
    session = make_session(1)
    assert session.selected == 0
    for number in (0, 3):
        session.request(tuple(walkers.boxes[number][0]), at(number))
        outcome = show(session, walkers, range(number, number + 3))
        assert outcome.selected == session.selected == ids(outcome)[0]
        assert outcome.estimate is outcome.targets[0].estimate
    session.stop()
    assert (session.selected, session.estimate) == (0, None)


@pytest.mark.parametrize(("policy", "selected"), [("keep", 2), ("restart", 4), ("wait", 0)])
def test_the_selected_target_after_a_jump_back_in_time(walkers, policy, selected):
    session = make_session(4)
    session.time_policy = TimePolicy(policy)
    for place in range(2):
        session.request(tuple(walkers.boxes[0][place]))
    show(session, walkers, range(5))
    session.select(2)
    outcome = session.process(Frame(walkers.images[0], at(0) - 100 * SECOND))
    assert outcome.jumped_back > 99
    assert outcome.selected == selected
    if policy == "restart":
        # The two manual targets start again with new ids, in their order.
        assert outcome.started == (3, 4)
        assert outcome.estimate.box == tuple(walkers.boxes[0][1])


# A single target with a detector


def test_of_many_detections_one_starts_the_single_target(walkers):
    session = make_session(1)
    outcome = show(session, walkers, range(12), every=3)
    assert len(outcome.targets) == 1
    assert outcome.rejected_detections == ()


def test_detections_confirm_and_correct_a_manual_target(walkers, iou):
    """Its box was drawn beside it."""
    drawn = tuple(walkers.boxes[0][0] + (5, 4, 0, 0))
    boxes = {}
    for every in (2, 100):
        session = make_session(1)
        session.request(drawn, label="mine")
        for number in range(20):
            outcome = show(session, walkers, [number], number % every == 1, (0, 1))
        boxes[every] = outcome.estimate.box
        assert (ids(outcome), outcome.targets[0].label) == ([1], "mine")
        assert outcome.targets[0].unconfirmed_for == pytest.approx(0.0 if every == 2 else 1.8)
    truth = walkers.boxes[19][0]
    assert iou(boxes[2], truth) > 0.8
    assert iou(boxes[2], truth) > iou(boxes[100], truth) + 0.1


def test_a_manual_target_replaces_a_detected_one(walkers, iou):
    session = make_session(1)
    assert ids(show(session, walkers, range(6), 2, (1,))) == [1]
    session.request(tuple(walkers.boxes[6][0]), at(6))
    outcome = show(session, walkers, range(6, 12), 2, (0, 1))
    assert ids(outcome) == [2]
    assert iou(outcome.estimate.box, walkers.boxes[11][0]) > 0.6


@pytest.mark.parametrize("preset", ["default", "li2007"])
def test_late_detections_of_the_frame_of_a_manual_target_start_no_other(walkers, iou, preset):
    """The first of the detections is of another object."""
    session = Session(preset_parameters(preset), seed=0)
    session.frame_buffer.limit(frames=200, megabytes=128.0)
    show(session, walkers, range(3))
    session.request(tuple(walkers.boxes[3][0]), at(3))
    show(session, walkers, range(3, 5))
    session.add_detections(walkers.detections(3, [1, 0]), at(3))
    for number in range(5, 12):
        outcome = show(session, walkers, [number])
        assert ids(outcome) == [outcome.selected] == [1]
        assert iou(walkers.boxes[number][0], outcome.estimate.box) > 0.5


def test_with_max_targets_1_a_detected_distractor_is_no_second_target(draw):
    steps = np.arange(60)
    paths = [(60 + 2 * steps, 100), (200 - 2 * steps, 104)]
    twins = draw(paths, colors=[(20, 20, 230)] * 2, textures=(10, 10))
    session, detected = Session(preset_parameters("default"), seed=0), 0
    session.frame_buffer.limit(frames=200, megabytes=128.0)
    session.request(tuple(twins.boxes[0][0]))
    for number, image in enumerate(twins.images):
        stamp = START + number * STEP * 2 // 5
        if any(track.is_distractor for track in session._manager._track_set.tracks):
            session.add_detections(twins.detections(number), stamp)
            detected += 1
        assert ids(session.process(Frame(image, stamp))) == [1]
    assert detected > 5


def test_a_replaced_target_stays_ended_after_a_late_detection(walkers):
    session = make_session(5)
    show(session, walkers, range(5))
    session.request(tuple(walkers.boxes[5][0]), at(5))
    show(session, walkers, range(5, 8))
    configure(session, 1)
    session.request(tuple(walkers.boxes[3][1]), at(3))
    assert ids(show(session, walkers, [8])) == [2]
    session.add_detections(walkers.detections(4, [0]), at(4))
    outcome = show(session, walkers, [9])
    assert ids(outcome) == [outcome.selected] == [2]


def test_a_target_on_an_earlier_frame_than_the_last_start_is_tracked_from_there(walkers, iou):
    session = make_session(1)
    show(session, walkers, range(12))
    session.request(tuple(walkers.boxes[12][0]), at(12))
    show(session, walkers, range(12, 20))
    session.request(tuple(walkers.boxes[5][0]), at(5))
    outcome = show(session, walkers, [20])
    assert outcome.caught_up == 15
    assert iou(walkers.boxes[20][0], outcome.estimate.box) > 0.5


@pytest.mark.parametrize("max_targets", [1, 5])
def test_a_target_on_a_frame_before_a_relearning_is_refused(walkers, max_targets):
    session = make_session(max_targets)
    session.request(tuple(walkers.boxes[0][0]))
    show(session, walkers, range(15))
    session.configure(preset_parameters("default", max_targets) | {"working_size": 60}, seed=0)
    session.request(tuple(walkers.boxes[8][1]), at(8))
    (reason,) = show(session, walkers, [15]).refused
    assert "older than the oldest one in the buffer; allowed: the last 1 frame" in reason


@pytest.mark.parametrize(("selected", "place"), [(1, 0), (2, 1), (0, 2)])
def test_with_max_targets_1_the_selected_or_last_manual_target_starts_again(
    walkers, iou, selected, place
):
    session = make_session(5)
    session.time_policy = TimePolicy("restart")
    for box in walkers.boxes[0]:
        session.request(tuple(box))
    show(session, walkers, range(5))
    session.select(selected)
    configure(session, 1)
    outcome = session.process(Frame(walkers.images[0], START - 100 * SECOND))
    assert ids(outcome) == list(outcome.started) == [outcome.selected]
    assert iou(walkers.boxes[0][place], outcome.estimate.box) > 0.5


def test_missing_scipy_is_reported_with_the_first_detections(walkers, monkeypatch):
    monkeypatch.setitem(sys.modules, "scipy.optimize", None)
    session = make_session(5)
    show(session, walkers, range(2))
    with pytest.raises(ValueError, match=r"detections need SciPy .*pip install scipy"):
        session.add_detections(walkers.detections(1), at(1))
    assert show(session, walkers, [2]).frame == "waiting"


def test_scipy_is_not_imported_before_the_first_detections():
    """A single target saves its third of a second and 30 MB."""
    code = """
import sys
import numpy as np
from pf_tracker_ros import Detections
from pf_tracker_ros.frames import Frame
from pf_tracker_ros.targets.session import Session
from pf_tracker_ros.tracking.presets import preset_parameters
image = np.random.default_rng(0).integers(0, 255, (100, 120, 3), dtype=np.uint8)
session = Session(preset_parameters("default", 4), 0)
session.request((30.0, 30.0, 24.0, 24.0))
for stamp in range(1, 5):
    session.process(Frame(image.copy(), stamp * 10**8))
before = "scipy" in sys.modules
session.add_detections(Detections([(31, 30, 24, 24)]), 5 * 10**8)
session.process(Frame(image.copy(), 5 * 10**8))
print(before, "scipy" in sys.modules)
"""
    pytest.importorskip("scipy")
    assert run_python(code, check=True).stdout.split() == ["False", "True"]


# Thinned out and reduced frames


@pytest.mark.parametrize("max_targets", [1, 4])
@pytest.mark.parametrize("source", ["manual", "detected"])
def test_late_input_for_a_thinned_out_and_reduced_frame(walkers, iou, max_targets, source):
    """Only the newest few frames fit into the buffer in full."""
    session = make_session(max_targets)
    size = walkers.images[0].nbytes
    session.frame_buffer.limit(frames=200, megabytes=9 * size / 1e6)
    count, stamped = 58, 14
    # Two frames per image, 1/30 s apart: the walkers at half speed.
    stamps = [START + round(number * SECOND / 30) for number in range(count)]
    image = np.arange(count) // 2
    for number in range(count - 1):
        session.process(Frame(walkers.images[image[number]].copy(), stamps[number]))
    entries = session.frame_buffer.since(stamps[stamped])
    assert entries[0].stored_frame is not entries[0].frame
    assert len(entries) < count - 1 - stamped
    if source == "manual":
        session.request(tuple(walkers.boxes[image[stamped]][0]), stamps[stamped])
    else:
        session.add_detections(walkers.detections(image[stamped], [0]), stamps[stamped])
    outcome = session.process(Frame(walkers.images[image[-1]].copy(), stamps[-1]))
    assert (outcome.refused, outcome.rejected_detections) == ((), ())
    (target,) = outcome.targets
    assert iou(target.estimate.box, walkers.boxes[image[-1]][0]) > 0.6
    assert target.age == pytest.approx((stamps[-1] - stamps[stamped]) / SECOND, abs=0.07)
