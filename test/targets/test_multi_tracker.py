import copy
import pickle
from functools import partial

import cv2
import numpy as np
import pytest

from pf_tracker_ros import Detections, MultiTracker
from pf_tracker_ros.parameters import ParameterError

INTERVAL = 0.1


# Targets that a detector starts


def test_detections_start_targets_that_are_tracked_between_them(run, walkers, make_tracker, iou):
    outputs = run(make_tracker(), walkers, every=10, labels=["person"] * 3)
    for number, targets in enumerate(outputs):
        assert [target.id for target in targets] == [1, 2, 3]
        for target in targets:
            truth = max(walkers.boxes[number], key=lambda box: iou(box, target.estimate.box))
            assert iou(truth, target.estimate.box) > 0.6
            assert target.label == "person"
            assert target.estimate.state == "tracking"
            assert target.age == pytest.approx(number * INTERVAL)
            assert target.unconfirmed_for == pytest.approx(number % 10 * INTERVAL)


@pytest.mark.parametrize("scale", [0.5, 2.0])
def test_images_may_change_their_size_at_the_same_aspect_ratio(
    run, walkers, make_tracker, iou, scale
):
    tracker = make_tracker()
    run(tracker, walkers, range(8), every=1)
    for number in range(8, 12):
        image = cv2.resize(walkers.images[number], None, fx=scale, fy=scale)
        targets = tracker.update(image, INTERVAL)
    assert [target.id for target in targets] == [1, 2, 3]
    for target in targets:
        assert max(iou(target.estimate.box, scale * box) for box in walkers.boxes[11]) > 0.5
    with pytest.raises(ValueError, match="start again to change their type or aspect ratio"):
        tracker.update(image[:, :-20], INTERVAL)


def test_a_fast_detector_needs_several_hits(walkers, make_tracker):
    tracker = make_tracker()
    counts = []
    for number in range(8):
        detections = walkers.detections(number) if number > 1 else Detections([])
        counts.append(len(tracker.update(walkers.images[number], INTERVAL, detections)))
    assert counts == [0, 0, 0, 0, 3, 3, 3, 3]


def test_a_detector_that_runs_twice_a_second_needs_one_hit(walkers, make_tracker):
    tracker = make_tracker()
    for number, detections in enumerate((Detections([]), None, walkers.detections(2))):
        targets = tracker.update(walkers.images[number], 0.24, detections)
    assert len(targets) == 3


@pytest.mark.parametrize("offset", [(-36, 0), (0, -38), (276, 0), (0, 138)])
def test_a_box_cut_by_the_border_needs_two_hits(walkers, make_tracker, offset):
    image = np.roll(walkers.images[0], offset, axis=(1, 0))
    detections = Detections([walkers.boxes[0][0] + [*offset, 0, 0]])
    tracker = make_tracker()
    assert tracker.update(image, INTERVAL, detections) == ()
    tracker.update(image, INTERVAL)
    assert len(tracker.update(image, 1.0, detections)) == 1


def test_a_target_that_the_detector_misses_ends(run, walkers, make_tracker):
    tracker = make_tracker()
    run(tracker, walkers, [0], every=1)
    targets = run(tracker, walkers, range(1, 30), every=5, targets=[0, 2])[-1]
    assert len(targets) == 2
    centers = [target.estimate.box[1] for target in targets]
    assert all(abs(y - 80) > 20 for y in centers)


def test_a_false_detection_beside_a_target_soon_ends(walkers, make_tracker):
    tracker = make_tracker()
    for number in range(14):
        found = walkers.detections(number)
        if number == 8:
            beside = walkers.boxes[8][:1] - [10.0, 4.0, 0.0, 0.0]
            found = Detections(np.vstack([found.boxes, beside]), [*found.scores, 0.6])
        tracker.update(walkers.images[number], INTERVAL, found)
        if number == 8:
            assert len(tracker._manager._track_set.tracks) == 4
    assert len(tracker._manager._track_set.tracks) == 3


def test_detections_overrule_an_image_that_they_leave(draw, make_tracker, iou):
    leaves, rests = (60 + 2 * np.maximum(np.arange(24) - 10, 0), 90), (np.full(24, 60), 90)
    footage = draw([leaves, rests], colors=[(20, 20, 230)] * 2, textures=(10, 10))
    tracker = make_tracker()
    for number, image in enumerate(footage.images):
        targets = tracker.update(image, INTERVAL, footage.detections(number, targets=[0]))
        # The image shows the target at rest, and behind it what its detections follow.
        overlaps = [iou(footage.boxes[number][0], one.estimate.box) for one in targets]
        assert number < 3 or max(overlaps) > 0.6


def test_detections_start_at_most_max_targets(run, walkers, make_tracker):
    assert len(run(make_tracker(max_targets=2), walkers, [0], every=1)[0]) == 2


def test_max_targets_counts_for_manual_ones(walkers, make_tracker, start_earlier):
    tracker = make_tracker(max_targets=2)
    for box in walkers.boxes[0][:2]:
        tracker.start(walkers.images[0], box)
    for start in (partial(start_earlier, tracker), partial(tracker.start, walkers.images[0])):
        with pytest.raises(ValueError, match="there are 2 targets, the maximum"):
            start(walkers.boxes[0][2])
    tracker.stop(1)
    assert tracker.start(walkers.images[0], walkers.boxes[0][2]) == 3


def test_low_scores_start_no_target(walkers, make_tracker):
    low = Detections(walkers.boxes[0], [0.6, 0.1, 0.95])
    assert len(make_tracker(detector__score_above=0.5).update(walkers.images[0], 0.1, low)) <= 2


def test_the_label_of_a_target_is_the_most_frequent_one(walkers, make_tracker):
    tracker = make_tracker()
    labels = ["car", "person", "person", "car", "person"]
    for number, label in enumerate(labels):
        detections = walkers.detections(number, targets=[0], labels=[label])
        targets = tracker.update(walkers.images[number], 1.0, detections)
    assert [(target.id, target.label) for target in targets] == [(1, "person")]


# Determinism


def test_equal_frames_detections_and_seeds_give_equal_bits(run, walkers, make_tracker, as_told):
    runs = [run(make_tracker(seed=4), walkers, every=6) for _ in range(2)]
    assert list(map(as_told, runs[0])) == list(map(as_told, runs[1]))
    other = run(make_tracker(seed=5), walkers, every=6)
    assert list(map(as_told, runs[0])) != list(map(as_told, other))


@pytest.mark.parametrize(
    "copied", [copy.copy, copy.deepcopy, lambda one: pickle.loads(pickle.dumps(one))]
)
def test_a_copy_goes_on_with_the_same_bits(run, walkers, make_tracker, as_told, copied):
    tracker = make_tracker()
    run(tracker, walkers, range(5), every=10)
    other = copied(tracker)
    outputs = [list(map(as_told, run(one, walkers, (5, 6), every=1))) for one in (tracker, other)]
    assert outputs[0] == outputs[1]


# Shared work


def test_one_wrong_detection_does_not_move_a_target_away(run, walkers, make_tracker, iou):
    tracker = make_tracker()
    run(tracker, walkers, range(12), every=5)
    wrong = walkers.boxes[12].copy()
    wrong[0, 0] += 12.0
    targets = tracker.update(walkers.images[12], INTERVAL, Detections(wrong))
    assert iou(walkers.boxes[12][0], targets[0].estimate.box) > 0.55


# Lifecycle


def test_a_target_that_left_is_reidentified_for_some_time(run, leaver, make_tracker):
    ids = {}
    for seconds in (10.0, 0.0):
        tracker = make_tracker(track__reidentify_within=seconds)
        outputs = run(tracker, leaver, every=2)
        away = [number for number, boxes in enumerate(leaver.boxes) if np.isnan(boxes[0]).any()]
        assert len(outputs[away[-1]]) == 1
        first = {target.id for target in outputs[6]}
        last = {target.id for target in outputs[-1]}
        ids[seconds] = (first, last)
    assert ids[10.0][0] == ids[10.0][1]
    assert len(ids[0.0][0] & ids[0.0][1]) == 1
    assert len(ids[0.0][1]) == 2


# Invalid input


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ((np.zeros((10, 10, 3), np.uint8),), "start again"),
        (("image",), "image is a str"),
        ((None, -1.0), "dt is -1.0"),
        ((None, float("nan")), "dt is nan"),
        ((None, 0.1, [[1, 2, 3, 4]]), "expected Detections"),
    ],
)
def test_a_refused_call_changes_no_target(walkers, make_tracker, as_told, arguments, message):
    tracker, other = make_tracker(), make_tracker()
    for one in (tracker, other):
        one.update(walkers.images[0], INTERVAL, walkers.detections(0))
    image, *rest = arguments
    with pytest.raises(ValueError, match=message):
        tracker.update(walkers.images[1] if image is None else image, *rest)
    assert as_told(tracker.targets) == as_told(other.targets)
    assert as_told(tracker.update(walkers.images[1], INTERVAL)) == as_told(
        other.update(walkers.images[1], INTERVAL)
    )


def test_an_image_buffer_may_be_reused(walkers, make_tracker, as_told):
    kept, reused = make_tracker(), make_tracker()
    buffer = np.empty_like(walkers.images[0])
    for number in range(8):
        late = walkers.detections(2, age=5 * INTERVAL) if number == 7 else None
        buffer[:] = walkers.images[number]
        outputs = [
            kept.update(walkers.images[number], INTERVAL, late),
            reused.update(buffer, INTERVAL, late),
        ]
        buffer[:] = 0
    assert as_told(outputs[0]) == as_told(outputs[1])


def test_parameters_are_those_of_the_preset_and_the_given_ones(make_tracker):
    assert make_tracker(max_targets=5).parameters["max_targets"] == 5
    with pytest.raises(ParameterError, match="no preset 'none'"):
        MultiTracker.from_preset("none")
    with pytest.raises(ParameterError, match=r"track\.reidentify_within"):
        make_tracker(track__reidentify_within=-1.0)
    with pytest.raises(TypeError, match="from_preset"):
        MultiTracker("default")


@pytest.mark.parametrize("preset", ["li2007", "zhang2015", "zhang_bo"])
def test_every_preset_tracks_several_targets(run, walkers, preset):
    tracker = MultiTracker.from_preset(preset)
    outputs = run(tracker, walkers, range(7), every=3)
    assert [target.id for target in outputs[-1]] == [1, 2, 3]


@pytest.mark.parametrize("box", [(np.nan, 1, 20, 20), (0.4, 0.5, 0.1, 0.2), (5000, 10, 20, 20)])
def test_only_unusable_detections_are_no_misses(walkers, make_tracker, box):
    tracker = make_tracker()
    tracker.update(walkers.images[0], INTERVAL, walkers.detections(0))
    for image in walkers.images[1:]:
        targets = tracker.update(image, INTERVAL, [Detections([box]), Detections([box] * 2)])
        assert [target.id for target in targets] == [1, 2, 3]
        first, second = tracker.rejected_detections
        assert "1 of 1 detection left out" in first
        assert "2 of 2 detections left out" in second


def test_long_labels_need_no_more_memory(walkers, make_tracker):
    tracker = make_tracker()
    sizes = []
    for number in range(25):
        labels = [f"person {number:04d} " + "x" * 100_000] * 3
        detections = walkers.detections(number, labels=labels)
        targets = tracker.update(walkers.images[number], INTERVAL, detections)
        sizes.append(len(pickle.dumps(tracker)))
    assert all(len(target.label) <= 100 for target in targets)
    assert sizes[-1] < sizes[12] + 50_000


def test_tracking_goes_on_after_every_interval(walkers, make_tracker):
    tracker = make_tracker()
    for number, dt in enumerate([INTERVAL, 1e20, 1e20, 1e150, 1e300, INTERVAL]):
        targets = tracker.update(walkers.images[number], dt, walkers.detections(number))
    assert len(targets) == 3
