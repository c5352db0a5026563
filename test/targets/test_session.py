"""The session with several targets: frames and detections, matched by their stamps."""

import cv2
import numpy as np
import pytest
from sessions import SECOND, START, at, ids, make_session, show

from pf_tracker_ros import Detections
from pf_tracker_ros.frames import Frame
from pf_tracker_ros.targets.requests import MAX_QUEUED_DETECTIONS
from pf_tracker_ros.tracking.frame_clock import TimePolicy
from pf_tracker_ros.tracking.presets import preset_parameters


@pytest.fixture
def session():
    return make_session(32)


@pytest.mark.parametrize("ahead", [3600 * SECOND, -3600 * SECOND])
def test_detections_of_another_clock_are_rejected(session, walkers, ahead):
    show(session, walkers, [0])
    with pytest.raises(ValueError, match="from another clock"):
        session.add_detections(walkers.detections(0), at(0) + ahead)


def test_the_queue_of_detections_without_frames_is_bounded(session, walkers):
    show(session, walkers, [0])
    for number in range(MAX_QUEUED_DETECTIONS + 5):
        session.add_detections(walkers.detections(0), at(20 + number))
    outcome = show(session, walkers, [1])
    assert len(outcome.rejected_detections) == 1
    assert outcome.rejected_detections[0].startswith("5 detector results left out")
    assert show(session, walkers, [2]).rejected_detections == ()


def test_a_request_beyond_max_targets_is_refused_at_once(walkers):
    session = make_session(2)
    for place in (0, 1):
        session.request(tuple(walkers.boxes[0][place]))
    with pytest.raises(ValueError, match="there are 2 targets, the maximum"):
        session.request(tuple(walkers.boxes[0][2]))
    assert show(session, walkers, [0]).started == (1, 2)
    with pytest.raises(ValueError, match="stop one first"):
        session.request(tuple(walkers.boxes[0][2]))
    session.stop_target(1)
    session.request(tuple(walkers.boxes[0][2]))
    assert ids(show(session, walkers, [1])) == [2, 3]


def test_a_correction_that_waits_is_no_further_target(walkers):
    session = make_session(2)
    session.request(tuple(walkers.boxes[0][0]))
    show(session, walkers, [0])
    session.request(tuple(walkers.boxes[0][0]))
    session.request(tuple(walkers.boxes[0][1]))
    assert ids(show(session, walkers, [1])) == [1, 2]


def test_the_only_target_that_there_may_be_is_selected_whatever_was_before(walkers):
    session = make_session(1, track__keep_selected=0.3)
    show(session, walkers, range(4), every=1, targets=[0])
    session.select(1)
    empty = np.full_like(walkers.images[0], 120)
    for number in range(4, 16):
        session.add_detections(Detections([], []), at(number))
        session.process(Frame(empty, at(number)))
    outcome = show(session, walkers, range(16, 20), every=1, targets=[1])
    assert ids(outcome) == [2]
    assert outcome.selected == session.selected == 2


# Detections between frames


def test_of_a_detector_that_is_faster_than_the_tracker_the_nearest_detections_count(walkers):
    """Each fourth image is tracked: the detections between two are of other places."""
    session = make_session(32)
    for number in range(24):
        session.add_detections(walkers.detections(number), at(number))
        if number % 4 == 3:
            outcome = session.process(Frame(walkers.images[number], at(number)))
    assert ids(outcome) == [1, 2, 3]


@pytest.mark.parametrize("late", [0, 2])
def test_detections_of_images_that_were_lost_start_no_targets(walkers, late):
    session = make_session(32)
    for number in range(24):
        if number >= late:
            session.add_detections(walkers.detections(number - late), at(number - late))
        if not 8 <= number < 16:
            outcome = session.process(Frame(walkers.images[number], at(number)))
            assert outcome.rejected_detections == ()
            assert set(ids(outcome)) <= {1, 2, 3}
    assert ids(outcome) == [1, 2, 3]


def test_a_slow_camera_takes_detections_of_up_to_half_an_interval(walkers):
    """One image a second, and a detector that stamps with its own time, 0.4 s off."""
    for offset in (-0.4, 0.4):
        session = make_session(32)
        for number in range(4):
            stamp = at(10 * number)
            session.process(Frame(walkers.images[0], stamp))
            session.add_detections(walkers.detections(0), stamp + round(offset * SECOND))
        outcome = session.process(Frame(walkers.images[0], at(40)))
        assert ids(outcome) == [1, 2, 3]


@pytest.mark.parametrize("age", [0.1, 1.0, 4.0])
def test_detections_of_before_the_first_image_are_ignored_silently(walkers, age):
    session = make_session(32)
    session.add_detections(walkers.detections(0), at(0) - round(age * SECOND))
    for number in (0, 1):
        assert show(session, walkers, [number]).rejected_detections == ()


def test_an_invalid_box_is_refused_alone(session, walkers):
    session.request((500.0, 500.0, 20.0, 20.0))
    session.request(tuple(walkers.boxes[0][1]))
    outcome = show(session, walkers, [0])
    assert outcome.started == (1,)
    (reason,) = outcome.refused
    assert reason.startswith("target refused: the center of box (500, 500")


def test_stop_removes_all_targets_and_stop_target_one(session, walkers):
    show(session, walkers, range(6), every=2)
    session.stop_target(2)
    assert [target.id for target in session.targets] == [1, 3]
    with pytest.raises(ValueError, match="there are: 1, 3"):
        session.stop_target(2)
    session.stop()
    outcome = show(session, walkers, [6])
    assert (outcome.frame, outcome.targets) == ("waiting", ())
    assert ids(show(session, walkers, [7, 8, 9, 10], every=2)) == [4, 5, 6]


def test_detections_of_before_a_stop_are_ignored_after_it(session, walkers):
    show(session, walkers, range(6), every=2)
    session.stop()
    session.add_detections(walkers.detections(4), at(4))
    outcome = session.process(Frame(walkers.images[6], at(6)))
    assert (outcome.targets, outcome.rejected_detections) == ((), ())
    assert ids(show(session, walkers, range(7, 12), every=2)) == [4, 5, 6]


@pytest.mark.parametrize(
    ("policy", "kept"), [("keep", [1, 2, 3, 4]), ("restart", [5]), ("wait", [])]
)
def test_a_jump_back_in_time(session, walkers, policy, kept):
    session.time_policy = TimePolicy(policy)
    show(session, walkers, range(6), every=2)
    # On the background: a second target on a walker would count as occluded.
    session.request((270.0, 8.0, 30.0, 24.0))
    assert len(show(session, walkers, [6]).targets) == 4
    # Of the time before the jump: starts nothing after it.
    session.add_detections(walkers.detections(6), at(6))
    outcome = session.process(Frame(walkers.images[7], at(7) - 100 * SECOND))
    assert outcome.jumped_back == pytest.approx(99.9)
    assert ids(outcome) == kept
    after = session.process(Frame(walkers.images[8], at(8) - 100 * SECOND))
    assert (after.jumped_back, ids(after)) == (0.0, kept)


@pytest.mark.parametrize("policy", ["keep", "restart", "wait"])
def test_a_rewound_recording_gives_its_targets_their_ids_again(session, walkers, policy):
    session.time_policy = TimePolicy(policy)
    boxes = [tuple(box) for box in walkers.boxes[0]]
    for first in (0, 0, 1):
        for box in boxes:
            session.request(box, at(0))
        outcome = show(session, walkers, range(first, 4))
        assert ids(outcome) == [1, 2, 3]
        session.stop()
    # Without a jump back, another target is never taken for an earlier one.
    session.request(boxes[0])
    assert ids(show(session, walkers, [4])) == [4]


@pytest.mark.parametrize("policy", ["keep", "restart", "wait"])
def test_a_jump_with_an_image_that_is_refused_changes_nothing(session, walkers, policy, as_told):
    session.time_policy = TimePolicy(policy)
    before = as_told(show(session, walkers, range(6), every=2).targets)
    with pytest.raises(ValueError, match="float64"):
        session.process(Frame(walkers.images[6].astype(float), at(6) - 100 * SECOND))
    assert as_told(session.targets) == before
    assert session.process(Frame(walkers.images[6], at(6) - 100 * SECOND)).jumped_back > 99


@pytest.mark.parametrize("policy", ["keep", "restart", "wait"])
def test_detections_of_before_a_jump_start_no_targets(session, walkers, policy):
    session.time_policy = TimePolicy(policy)
    ghost = Detections([[200.0, 10.0, 40.0, 60.0]], [0.95], ["ghost"])
    show(session, walkers, range(20), every=4)
    session.add_detections(ghost, at(20))
    assert session.process(Frame(walkers.images[19], at(1))).jumped_back == pytest.approx(1.8)
    for number in range(2, 24):
        if number in (2, 6, 8):
            with pytest.raises(ValueError, match="from before time went back"):
                session.add_detections(ghost, at(18))
        outcome = session.process(Frame(walkers.images[19], at(number)))
        assert "ghost" not in {target.label for target in outcome.targets}
        assert outcome.rejected_detections == ()


def test_skipped_frames_advance_the_clock(session, walkers):
    show(session, walkers, range(8), every=4)
    for second in range(1, 100, 5):
        session.add_detections(walkers.detections(7), at(7) + second * SECOND)
        session.skip(at(7) + second * SECOND)
    now = at(7) + 97 * SECOND
    # Of a skipped frame: ignored silently.
    session.add_detections(walkers.detections(7), now - SECOND)
    session.add_detections(walkers.detections(8), now)
    session.request(tuple(walkers.boxes[8][0]), now)
    outcome = session.process(Frame(walkers.images[8], now))
    assert (len(outcome.started), outcome.rejected_detections, outcome.refused) == (1, (), ())
    assert 0.0 in [target.unconfirmed_for for target in outcome.targets]


def test_detections_of_a_skipped_frame_start_nothing(session, walkers):
    show(session, walkers, range(3))
    for number in (3, 4):
        session.add_detections(walkers.detections(number), at(number))
        session.skip(at(number))
    session.add_detections(walkers.detections(4), at(4))
    outcome = show(session, walkers, [5, 6])
    assert (ids(outcome), outcome.rejected_detections) == ([], ())


def test_without_stamps_detections_belong_to_the_current_frame(session, walkers):
    for number in range(6):
        session.add_detections(walkers.detections(number), 0)
        outcome = session.process(Frame(walkers.images[number], 0))
    assert ids(outcome) == [1, 2, 3]
    assert outcome.rejected_detections == ()


@pytest.mark.parametrize("rate", [30, 60, 200])
def test_requests_and_detections_of_a_former_image_size_are_rejected(session, walkers, rate):
    step = SECOND // rate
    stamps = [START + number * step for number in range(6)]
    for image, stamp in zip(walkers.images[:3], stamps, strict=False):
        session.process(Frame(image, stamp))
    larger = cv2.resize(walkers.images[3], None, fx=2.0, fy=2.0)
    session.request(tuple(walkers.boxes[2][0]), stamps[2])
    outcome = session.process(Frame(larger, stamps[3]))
    assert (outcome.started, outcome.targets) == ((), ())
    assert outcome.refused == (
        "target refused: it was drawn on an image of another size or type; draw it on one like "
        "the last, "
        f"{larger.shape} uint8",
    )
    session.add_detections(walkers.detections(2), stamps[2])
    session.add_detections(walkers.detections(1), stamps[1])
    outcome = session.process(Frame(larger, stamps[4]))
    assert outcome.targets == ()
    assert outcome.rejected_detections == (
        "2 detector results left out: the images had another size or type",
    )
    session.request(tuple(2.0 * walkers.boxes[3][0]), stamps[3])
    assert session.process(Frame(larger, stamps[5])).started == (1,)


def test_images_of_another_type_are_refused_until_ten_in_a_row(session, walkers):
    show(session, walkers, range(8), every=4)
    gray = [image[..., 0].copy() for image in walkers.images]
    for number in range(8, 17):
        with pytest.raises(ValueError, match="image is"):
            session.process(Frame(gray[number], at(number)))
    assert len(session.targets) == 3
    assert session.process(Frame(gray[17], at(17))).targets == ()
    session.add_detections(walkers.detections(18), at(18))
    session.process(Frame(gray[18], at(18)))


def test_a_manual_target_is_kept_when_images_of_another_type_arrive(session, walkers):
    session.request(tuple(walkers.boxes[0][0]))
    show(session, walkers, range(3))
    for number in range(3, 20):
        with pytest.raises(ValueError, match="image is"):
            session.process(Frame(walkers.images[number][..., 0].copy(), at(number)))
    assert ids(show(session, walkers, [20])) == [1]


def gray(walkers, number):
    return walkers.images[number][..., 0].copy()


@pytest.mark.parametrize("behind", [None, 0, 5])
def test_a_manual_target_on_images_of_another_type_resets_the_tracker(walkers, iou, behind):
    session = make_session(2)
    for place in (0, 1):
        session.request(tuple(walkers.boxes[0][place]))
    show(session, walkers, range(4))
    for number in range(4, 10):
        with pytest.raises(ValueError, match="but the targets are tracked in images of"):
            session.process(Frame(gray(walkers, number), at(number)))
    drawn_on = 10 if behind is None else 10 - behind
    session.request(tuple(walkers.boxes[drawn_on][2]), 0 if behind is None else at(drawn_on), "new")
    outcome = session.process(Frame(gray(walkers, 10), at(10)))
    assert (outcome.frame, outcome.started, ids(outcome)) == ("started", (3,), [3])
    (message,) = outcome.ended
    assert message.startswith(
        "ended: 1, 2; a new target was drawn on images of another size or type"
    )
    for number in range(11, 16):
        outcome = session.process(Frame(gray(walkers, number), at(number)))
    assert (ids(outcome), outcome.ended, outcome.targets[0].label) == ([3], (), "new")
    session.request(tuple(walkers.boxes[14][0]), at(14))
    assert session.process(Frame(gray(walkers, 16), at(16))).started == (4,)


@pytest.mark.parametrize("number", [2, 3, 9])
def test_a_manual_target_on_a_matching_image_ends_no_other(session, walkers, number):
    session.request(tuple(walkers.boxes[0][0]))
    show(session, walkers, range(3))
    session.request(tuple(walkers.boxes[2][1]), 0 if number == 3 else at(number))
    for other in range(3, 6):
        with pytest.raises(ValueError, match="image is"):
            session.process(Frame(gray(walkers, other), at(other)))
    assert ids(show(session, walkers, range(6, 10))) == [1, 2]


def hide_first(walkers, number, scale=1.0):
    image = walkers.images[number].copy()
    image[20:80] = 128
    return cv2.resize(image, None, fx=scale, fy=scale)


@pytest.mark.parametrize(("hidden_for", "scales"), [(24, [2.0]), (5, [2.0, 1.0])])
def test_a_manual_target_unseen_for_long_is_found_in_another_image_size(
    session, walkers, iou, hidden_for, scales
):
    session.request(tuple(walkers.boxes[0][0]))
    session.request(tuple(walkers.boxes[0][1]))
    show(session, walkers, range(3))
    for number in range(3, 3 + hidden_for):
        outcome = session.process(Frame(hide_first(walkers, number), at(number)))
    assert ids(outcome) == [1, 2]
    assert outcome.targets[0].estimate.state != "tracking"
    for later, scale in enumerate(scales, start=3 + hidden_for):
        outcome = session.process(Frame(hide_first(walkers, later, scale), at(later)))
    assert (ids(outcome), outcome.ended) == ([1, 2], ())
    assert outcome.targets[0].estimate.state != "tracking"
    # It is recognized where it was last seen, since it was relearned there.
    shown = cv2.resize(walkers.images[2], None, fx=scale, fy=scale)
    for later in range(28, 60):
        outcome = session.process(Frame(shown, at(later)))
    first = outcome.targets[0].estimate
    assert first.state == "tracking"
    assert iou(first.box, scale * walkers.boxes[2][0]) > 0.5


def test_lowering_max_targets_below_the_number_of_targets_refuses_requests(session, walkers):
    show(session, walkers, range(6), every=2)
    values = preset_parameters("default", 32) | {"max_targets": 2}
    session.configure(values, 0)
    assert len(session.targets) == 3
    with pytest.raises(
        ValueError, match="there are 3 targets, but 'max_targets' is 2; stop 2 first"
    ):
        session.request((4.0, 4.0, 12.0, 12.0))
    # A request on an existing target is allowed.
    known = session.targets[0]
    session.request(known.estimate.box)
    assert show(session, walkers, [6]).started == (known.id,)
