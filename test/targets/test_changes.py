"""Targets that are kept, with their ids, when the parameters or the images' size change."""

import copy

import cv2
import numpy as np
import pytest

from pf_tracker_ros.frames import Frame
from pf_tracker_ros.parameters import ParameterError

INTERVAL = 0.1


@pytest.fixture
def started(walkers, make_tracker):
    """A tracker that has followed the walkers for eight frames."""

    def start(**parameters):
        tracker = make_tracker(**parameters)
        for number in range(8):
            found = walkers.detections(number) if number % 4 == 0 else None
            tracker.update(walkers.images[number], INTERVAL, found)
        assert [target.id for target in tracker.targets] == [1, 2, 3]
        return tracker

    return start


def follow(tracker, walkers, numbers, iou, scale=1.0):
    """Follow without a detector; the ids, which must stay on what they were on."""
    for number in numbers:
        image = cv2.resize(walkers.images[number], None, fx=scale, fy=scale)
        for target in tracker.update(image, INTERVAL):
            best = max(iou(target.estimate.box, scale * box) for box in walkers.boxes[number])
            assert best > 0.5, (number, target.id)
    return [target.id for target in tracker.targets]


@pytest.mark.parametrize(
    "values",
    [
        {"particles": 60, "detector.score_above": 0.5},
        {"motion.model": "constant_velocity", "proposal.method": "transition"},
        {"cues": ("color_histogram", "gradient_orientation"), "proposal.method": "transition"},
    ],
    ids=["tuned", "another motion model", "other cues"],
)
def test_parameters_change_and_the_targets_stay(started, walkers, iou, values):
    tracker = started()
    tracker.set_parameters(values)
    assert {name: tracker.parameters[name] for name in values} == values
    assert follow(tracker, walkers, range(8, 16), iou) == [1, 2, 3]


def test_a_tuned_tracker_still_takes_late_detections(started, walkers):
    tracker = started()
    tracker.set_parameters({"particles": 60})
    tracker.update(walkers.images[8], INTERVAL, walkers.detections(4, age=4 * INTERVAL))
    assert tracker.rejected_detections == ()
    assert [target.id for target in tracker.targets] == [1, 2, 3]


@pytest.mark.parametrize("values", [{"particles": 0}, {"nose": 1}, {"cues": ("foreground",)}])
def test_a_change_that_is_refused_changes_nothing(started, walkers, as_told, values):
    tracker, other = started(), started()
    with pytest.raises(ParameterError):
        tracker.set_parameters({"detector.recall": 0.5, **values})
    assert tracker.parameters == other.parameters
    assert as_told(tracker.update(walkers.images[8], INTERVAL)) == as_told(
        other.update(walkers.images[8], INTERVAL)
    )


def test_a_target_that_is_long_out_of_sight_is_learned_from_where_it_was_seen_last(
    walkers, make_tracker, iou
):
    tracker = make_tracker()
    tracker.start(walkers.images[0], walkers.boxes[0][0])
    blank = np.full_like(walkers.images[0], 120)
    for _ in range(40):
        (target,) = tracker.update(blank, INTERVAL)
    state = target.estimate.state
    assert state != "tracking"
    tracker.set_parameters({"working_size": 30})
    (target,) = tracker.targets
    assert (target.id, target.estimate.state) == (1, state)
    for _ in range(30):
        (target,) = tracker.update(walkers.images[0], INTERVAL)
    assert target.estimate.state == "tracking"
    assert iou(target.estimate.box, walkers.boxes[0][0]) > 0.6


def test_what_no_frame_shows_that_is_kept_refuses_the_change(started, walkers):
    """As in a copy, which carries no frames."""
    tracker = copy.copy(started())
    with pytest.raises(ParameterError, match="target 1 must be relearned"):
        tracker.set_parameters({"motion.model": "constant_velocity", "particles": 50})
    assert tracker.parameters["motion.model"] == "constant_velocity_and_size"
    tracker.set_parameters({"particles": 50})
    tracker.update(walkers.images[8], INTERVAL)
    tracker.set_parameters({"working_size": 30})
    assert [target.id for target in tracker.targets] == [1, 2, 3]


def test_a_lost_target_stays_lost_for_sure_when_it_is_learned_again(walkers, make_tracker):
    tracker = make_tracker(track__lost_after=0.5)
    tracker.start(walkers.images[0], walkers.boxes[0][0])
    blank = np.full_like(walkers.images[0], 120)
    for _ in range(12):
        (target,) = tracker.update(blank, INTERVAL)
    assert target.estimate.state == "lost"
    tracker.set_parameters({"working_size": 30})
    (target,) = tracker.targets
    assert target.estimate.state == "lost"
    assert target.estimate.confidence == 0.0


@pytest.mark.parametrize("scale", [2.0, 0.5])
def test_a_camera_that_scales_its_images_keeps_the_ids(started, walkers, iou, scale):
    tracker = started()
    image = cv2.resize(walkers.images[8], None, fx=scale, fy=scale)
    assert not tracker._manager.accepts_image(image)
    assert tracker._manager.resize(Frame(image))
    assert tracker._manager.accepts_image(image)
    assert follow(tracker, walkers, range(8, 14), iou, scale) == [1, 2, 3]


def test_images_of_another_kind_are_not_scaled_to(started, walkers, as_told):
    tracker = started()
    before = as_told(tracker.targets)
    for image in (walkers.images[8][..., 0].copy(), walkers.images[8][:100]):
        assert not tracker._manager.resize(Frame(image))
    assert as_told(tracker.targets) == before
    assert tracker._manager.accepts_image(walkers.images[8])


def test_ids_are_not_used_again_after_all_were_forgotten(started, walkers):
    tracker = started()
    tracker._manager.clear()
    assert tracker.targets == ()
    for number in range(8, 13):
        told = tracker.update(walkers.images[number], INTERVAL, walkers.detections(number))
    assert [target.id for target in told] == [4, 5, 6]


def test_another_camera_may_send_other_images(started, walkers, start_earlier):
    tracker = started()
    tracker._manager.reset()
    gray = [image[:100, :, 0].copy() for image in walkers.images]
    assert tracker.update(gray[0], INTERVAL) == ()
    assert start_earlier(tracker, walkers.boxes[0][0]) == 4
    (target,) = tracker.update(gray[1], INTERVAL)
    assert target.id == 4


def test_a_target_drawn_on_a_frame_gone_by_is_followed_up_to_now(
    walkers, make_tracker, iou, start_earlier
):
    tracker = make_tracker()
    for number in range(10):
        tracker.update(walkers.images[number], INTERVAL)
    id = start_earlier(tracker, walkers.boxes[3][1], 6 * INTERVAL, "dog")
    (target,) = tracker.targets
    assert (target.id, target.label) == (id, "dog")
    assert iou(target.estimate.box, walkers.boxes[9][1]) > 0.6
    assert target.age == pytest.approx(6 * INTERVAL)
    # Nor is it gone where what happened since is worked out again.
    late = walkers.detections(6, targets=[0], age=4 * INTERVAL)
    told = tracker.update(walkers.images[10], INTERVAL, late)
    assert id in [one.id for one in told]


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (((10, 10, 20, 20), 60.0), "its frame is 59.300 s older than the oldest one in the buffer"),
        (((10, 10, 0, 20), 0.0), "too small"),
    ],
)
def test_an_earlier_target_that_cannot_be_is_refused(
    started, as_told, arguments, message, start_earlier
):
    tracker = started()
    before = as_told(tracker.targets)
    with pytest.raises(ValueError, match=message):
        start_earlier(tracker, *arguments)
    assert as_told(tracker.targets) == before


def test_before_the_first_frame_there_is_nothing_to_start_on(make_tracker):
    with pytest.raises(ValueError, match="no frame yet"):
        make_tracker()._manager.start((10, 10, 20, 20))


def test_several_answers_at_once_are_as_good_as_one_after_the_other(walkers, make_tracker):
    """Two detectors, and one that is late: what each says counts in the frame that it saw."""
    together, in_time = make_tracker(), make_tracker()
    for number in range(12):
        found = [walkers.detections(number, [0]), walkers.detections(number, [1])]
        in_time.update(walkers.images[number], INTERVAL, found if number % 4 == 0 else None)
        late = None
        if number in (2, 6, 10):
            late = [walkers.detections(number - 2, [which], age=2 * INTERVAL) for which in (1, 0)]
        together.update(walkers.images[number], INTERVAL, late)
    boxes = [{t.id: t.estimate.box for t in tracker.targets} for tracker in (together, in_time)]
    assert len(boxes[0]) == len(boxes[1]) == 2
    assert np.allclose(sorted(boxes[0].values()), sorted(boxes[1].values()), atol=4.0)


def test_only_labels_that_are_asked_for_count(walkers, make_tracker):
    tracker = make_tracker(detector__labels=("person", "dog"))
    for number in range(4):
        found = walkers.detections(number, labels=["person", "car", "dog"])
        told = tracker.update(walkers.images[number], INTERVAL, found)
    assert sorted(target.label for target in told) == ["dog", "person"]
    assert tracker.rejected_detections == ()


def test_a_history_of_fewer_frames_reaches_less_far(started, walkers):
    tracker = started()
    tracker._manager.frames.limit(3, 100.0)
    tracker.update(walkers.images[8], INTERVAL, walkers.detections(4, age=4 * INTERVAL))
    assert "s old" in tracker.rejected_detections[0]
    tracker.update(walkers.images[9], INTERVAL, walkers.detections(8, age=INTERVAL))
    assert tracker.rejected_detections == ()
