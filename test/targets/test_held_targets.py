"""A selected target stays while it may come back; a detector's misses count with the image."""

import numpy as np
import pytest
from sessions import at, ids, make_session, show

from pf_tracker_ros.frames import Frame


@pytest.mark.parametrize("max_targets", [1, 8])
def test_missed_detections_do_not_hide_a_selected_target_that_the_image_shows(walkers, max_targets):
    """Two in a row of a detector of two frames in a second, then one that finds it."""
    session = make_session(max_targets)
    for number in range(25):
        found = [0] if number in (0, 5, 20) else []
        outcome = show(session, walkers, [number], 5, found)
        if number == 0 and max_targets > 1:
            session.select(1)
        assert [(one.id, one.estimate.state) for one in outcome.targets] == [(1, "tracking")]


def test_a_detector_that_does_not_see_a_target_ends_it_or_its_tracking(walkers):
    """One drawn by hand, and one of the detector, which both have been detected before."""
    session = make_session(8)
    session.request(tuple(walkers.boxes[0][0]))
    states = []
    for number in range(30):
        outcome = show(session, walkers, [number], 2, [0, 1] if number < 6 else [])
        states.append({one.id: one.estimate.state for one in outcome.targets})
    assert states[7] == {1: "tracking", 2: "tracking"}
    assert states[-1] == {1: "occluded"}


def test_the_misses_of_a_detector_that_has_stopped_are_forgotten(walkers):
    """Ten seconds after its last answer, the image counts alone."""
    session = make_session(8)
    session.request(tuple(walkers.boxes[0][0]))
    for number in range(24):
        show(session, walkers, [number], 2, [0] if number < 6 else [])
    factors = []
    for number in range(24, 150):
        session.process(Frame(walkers.images[23], at(number)))
        factors.append(session._manager.get_track(1).filter_state.detector_factor)
    assert factors[0] < 0.1
    assert factors[-1] == 1.0
    assert session.estimate is None
    assert session.targets[0].estimate.state == "tracking"


@pytest.mark.parametrize(
    ("log_odds", "is_found", "factor"),
    [(-50.0, False, np.exp(-6.0)), (-2.0, False, np.exp(-2.0)), (1.5, False, 1.0)]
    + [(1.5, True, np.exp(1.5)), (-0.5, True, np.exp(-0.5))],
)
def test_what_a_detector_sees_counts_with_the_image(walkers, log_odds, is_found, factor):
    """A miss counts against it, and finding the target again for it."""
    session = make_session(8)
    session.request(tuple(walkers.boxes[0][0]))
    show(session, walkers, range(3), 1, [0])
    track = session._manager.get_track(1).with_existence(log_odds, is_found=is_found)
    assert track.existence_log_odds == log_odds
    assert track.filter_state.detector_factor == pytest.approx(factor)


def test_where_a_bystander_is_predicted_hides_nobody_between_detections(draw):
    """They walk up to the target, and turn back after the last detection."""
    steps = np.arange(24.0)
    turn = np.where(steps < 9.0, 240.0 - 15.0 * steps, 120.0 + 15.0 * (steps - 8.0))
    drawn = draw([(np.full(24, 90.0), 100.0), (turn, 106.0)])
    session = make_session(1)
    states = []
    for number in range(20):
        if number % 2 == 0 and number <= 8:
            session.add_detections(drawn.detections(number, [0, 1] if number else [0]), at(number))
        outcome = session.process(Frame(drawn.images[number], at(number)))
        states.append(outcome.estimate.state)
    assert any(track.is_distractor for track in session._manager._track_set.tracks)
    assert states[12:] == ["tracking"] * 8


def test_a_detector_of_other_things_does_not_count_against_a_target_drawn_by_hand(walkers):
    session = make_session(8)
    session.request(tuple(walkers.boxes[0][0]))
    outcome = show(session, walkers, range(30), 2, [1])
    assert outcome.targets[0].estimate.state == "tracking"


@pytest.fixture(scope="module")
def crossing(draw):
    """The first of two walks behind a wall from frame 10 to 26; the other one walks on."""
    steps = np.arange(45.0)
    drawn = draw([(60.0 + 2.0 * steps, 60.0), (280.0 - 2.0 * steps, 140.0)])
    for number in range(10, 27):
        drawn.images[number][30:90, :200] = 128
        drawn.boxes[number, 0] = np.nan
    return drawn


@pytest.mark.parametrize("max_targets", [1, 8])
def test_a_selected_target_keeps_its_id_until_it_is_found_again(crossing, iou, max_targets):
    """With one target, the other person is told apart from it, and does not replace it."""
    session = make_session(max_targets)
    for number in range(45):
        outcome = show(session, crossing, [number], 2, [0] if number < 4 else [0, 1])
        if number == 2:
            assert ids(outcome) == [1]
            session.select(1)
        if number > 2:
            assert outcome.selected == 1
            assert outcome.estimate is not None
        if number == 26:
            assert outcome.estimate.state != "tracking"
        if max_targets == 1 and number > 2:
            assert ids(outcome) == [1]
    assert outcome.estimate.state == "tracking"
    assert iou(outcome.estimate.box, crossing.boxes[44][0]) > 0.5


def test_a_selected_target_ends_when_it_may_not_come_back(crossing):
    session = make_session(1, track__keep_selected=1.0)
    for number in range(45):
        outcome = show(session, crossing, [number], 2, [0] if number < 4 else [1])
    # The other one is the target now.
    assert ids(outcome) == [2]
