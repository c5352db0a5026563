"""Targets that occlude each other."""

import numpy as np
import pytest

INTERVAL = 0.1


def test_ids_survive_a_crossing(run, crossing, make_tracker, iou):
    outputs = run(make_tracker(), crossing, every=8)
    ids = {}
    for number in (0, len(outputs) - 1):
        for target in outputs[number]:
            overlaps = [iou(box, target.estimate.box) for box in crossing.boxes[number]]
            assert max(overlaps) > 0.5
            ids.setdefault(int(np.argmax(overlaps)), set()).add(target.id)
    assert sorted(map(len, ids.values())) == [1, 1]
    assert ids[0] != ids[1]


def test_two_targets_do_not_merge(crossing, make_tracker, iou):
    tracker = make_tracker()
    overlaps = []
    for number, image in enumerate(crossing.images):
        detections = crossing.detections(number) if number == 0 else None
        targets = tracker.update(image, INTERVAL, detections)
        if number >= 30:
            overlaps.append(iou(*(target.estimate.box for target in targets)))
    assert max(overlaps) < 0.3


@pytest.mark.parametrize("footage", ["passage", "turned_passage"])
def test_an_occluded_target_keeps_its_velocity(footage, request, make_tracker, iou):
    passage, tracker = request.getfixturevalue(footage), make_tracker()
    for number, image in enumerate(passage.images):
        is_occluded = iou(*passage.boxes[number][:2]) > 0.2
        detections = passage.detections(number, targets=[1] if is_occluded else None)
        targets = tracker.update(image, INTERVAL, detections)
        if number == 5:
            walker = min(targets, key=lambda one: one.estimate.box[0]).id
        if number > 5:
            track = next(
                one
                for one in tracker._manager._track_set.tracks
                if tracker._manager._track_ids.get(one.key) == walker
            )
            assert iou(track.box, passage.boxes[number][0]) > 0.5, number


def test_a_target_behind_another_is_soon_not_reported_on_the_same_box(pair, make_tracker, iou):
    tracker = make_tracker()
    duplicates = 0
    for number, image in enumerate(pair.images):
        detections = pair.detections(number, targets=[0, 1] if number < 8 else [1])
        targets = tracker.update(image, INTERVAL, detections)
        boxes = [target.estimate.box for target in targets]
        assert len(targets) >= (1 if number > 3 else 0)
        duplicates += len(boxes) == 2 and iou(*boxes) > 0.5
    assert duplicates <= 3


def test_a_lost_target_occludes_none(vanisher, make_tracker, iou):
    tracker = make_tracker(track__lost_after=1.0)
    for box in vanisher.boxes[0]:
        tracker.start(vanisher.images[0], box)
    overlapping = 0
    for image, boxes in zip(vanisher.images[1:], vanisher.boxes[1:], strict=True):
        lost, walker = (target.estimate for target in tracker.update(image, INTERVAL))
        overlapping += lost.state == "lost" and iou(lost.box, boxes[1]) > 0.5
        assert walker.state == "tracking"
        assert iou(walker.box, boxes[1]) > 0.7
    assert overlapping


def test_a_target_that_leaves_behind_another_keeps_its_center_in_the_image(
    leaving_pair, make_tracker
):
    tracker, occluded = make_tracker(), 0
    for box in leaving_pair.boxes[0]:
        tracker.start(leaving_pair.images[0], box)
    for image in leaving_pair.images[1:]:
        tracker.update(image, INTERVAL)
        for track in tracker._manager._track_set.tracks:
            occluded += track.is_occluded_by_other
            center = track.box[:2] + track.box[2:] / 2
            assert (center >= 0).all()
            assert (center <= (image.shape[1], image.shape[0])).all()
    assert occluded > 5
