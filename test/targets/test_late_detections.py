"""Detections that arrive late, twice or out of order."""

import numpy as np
import pytest

from pf_tracker_ros import Detections

INTERVAL = 0.1


@pytest.mark.parametrize("delay", [1, 4, 9])
def test_late_detections_have_the_effect_of_those_in_time(walkers, make_tracker, as_told, delay):
    """After each, the targets are those of a detector without latency."""
    in_time, late = make_tracker(seed=2), make_tracker(seed=2)
    for number, image in enumerate(walkers.images):
        seen = walkers.detections(number) if number % 10 == 0 else None
        expected = in_time.update(image, INTERVAL, seen)
        before = number - delay
        detections = None
        if before >= 0 and before % 10 == 0:
            detections = walkers.detections(before, age=delay * INTERVAL)
        targets = late.update(image, INTERVAL, detections)
        if detections:
            assert as_told(targets) == as_told(expected)
    assert as_told(targets) == as_told(expected)


def test_detections_of_an_earlier_frame_keep_the_ids(run, walkers, make_tracker):
    tracker = make_tracker()
    ids = [target.id for target in run(tracker, walkers, range(1, 8), every=6)[-1]]
    late = walkers.detections(3, age=5 * INTERVAL)
    assert [target.id for target in tracker.update(walkers.images[8], INTERVAL, late)] == ids


def test_duplicate_detections_count_once(walkers, make_tracker, as_told):
    once, twice = make_tracker(), make_tracker()
    for tracker in (once, twice):
        tracker.update(walkers.images[0], INTERVAL)
        tracker.update(walkers.images[1], INTERVAL, walkers.detections(0, age=INTERVAL))
    again = walkers.detections(0, age=2 * INTERVAL)
    assert as_told(once.update(walkers.images[2], INTERVAL)) == as_told(
        twice.update(walkers.images[2], INTERVAL, again)
    )


def test_detections_beyond_the_buffer_are_rejected_with_a_reason(run, walkers, make_tracker):
    tracker = make_tracker()
    run(tracker, walkers, range(5), every=10)
    old = walkers.detections(0, age=100.0)
    assert len(tracker.update(walkers.images[5], INTERVAL, old)) == 3
    assert len(tracker.rejected_detections) == 1
    assert "100 s old" in tracker.rejected_detections[0]
    tracker.update(walkers.images[6], INTERVAL)
    assert tracker.rejected_detections == ()


def test_detections_of_before_the_first_frame_are_ignored_silently(walkers, make_tracker, run):
    tracker = make_tracker()
    run(tracker, walkers, range(5), every=10)
    before = walkers.detections(0, age=2.0)
    tracker.update(walkers.images[5], INTERVAL, before)
    assert tracker.rejected_detections == ()
    run(tracker, walkers, range(6, 29))
    # The first frames have left the buffer, so detections are missed.
    tracker.update(walkers.images[29], INTERVAL, walkers.detections(0, age=2.9))
    assert "2.9 s old" in tracker.rejected_detections[0]


def test_a_second_detector_s_later_result_keeps_the_ids(walkers, make_tracker):
    tracker = make_tracker()
    targets = []
    for number in range(8):
        seen = {0: walkers.detections(0, [1]), 3: walkers.detections(0, [0, 2], age=3 * INTERVAL)}
        targets.append(tracker.update(walkers.images[number], INTERVAL, seen.get(number)))
    assert [target.id for target in targets[0]] == [1]
    assert [target.id for target in targets[-1]] == [1, 2, 3]
    (before,), (after, *_) = targets[2], targets[-1]
    assert abs(before.estimate.box[0] - 5 * 3 - after.estimate.box[0]) < 5.0


def test_repeated_reprocessing_gives_no_id_to_two_targets(make_tracker):
    image = np.full((120, 160, 3), 120, np.uint8)
    image[40:80, 50:74], image[40:80, 56:80] = (20, 20, 230), (230, 40, 20)
    one, other = (np.array([(x, 40.0, 24.0, 40.0)]) for x in (50, 56))
    tracker = make_tracker()
    for _ in range(8):
        tracker.update(image, INTERVAL)
    tracker.update(image, INTERVAL, Detections(one))
    # It replaces that one, which returns when its frame is reprocessed again.
    (target,) = tracker.update(image, INTERVAL, Detections(other, age=0.4))
    assert target.id == 1
    tracker.update(image, INTERVAL, Detections(other, age=0.2))
    targets = tracker.update(image, INTERVAL, Detections(np.vstack([one, other])))
    assert [target.id for target in targets] == [1, 2]
    tracker.stop(1)
    assert [target.id for target in tracker.targets] == [2]


@pytest.mark.parametrize("pause", [1.5, 4.0, 100.0])
def test_after_a_pause_a_detection_recovers_its_target_at_once(
    run, walkers, make_tracker, iou, pause
):
    tracker = make_tracker()
    ids = [target.id for target in run(tracker, walkers, range(12), every=1)[-1]]
    targets = tracker.update(walkers.images[12], pause, walkers.detections(12))
    assert [target.id for target in targets] == ids
    for target, true in zip(targets, walkers.boxes[12], strict=True):
        assert target.estimate.state == "tracking"
        assert target.unconfirmed_for == 0.0
        assert iou(target.estimate.box, true) > 0.7


def test_late_detections_start_no_target_on_a_manual_one(run, walkers, make_tracker):
    tracker = make_tracker()
    id = tracker.start(walkers.images[0], walkers.boxes[0][0])
    run(tracker, walkers, range(1, 6))
    late = walkers.detections(0, targets=[0, 1], age=6 * INTERVAL)
    targets = tracker.update(walkers.images[6], INTERVAL, late)
    assert [target.id for target in targets] == [id, id + 1]
    assert targets[0].estimate.box[0] < 100
    assert targets[1].estimate.box[0] > 200
