"""Targets that hide each other."""

import pytest

INTERVAL = 0.1


def test_ids_come_out_of_a_crossing_as_they_went_in(run, crossing, make_tracker, iou):
    answers = run(make_tracker(), crossing, every=8)
    names = {}
    for number in (0, len(answers) - 1):
        for target in answers[number]:
            place = max(
                (0, 1), key=lambda one: iou(crossing.boxes[number][one], target.estimate.box)
            )
            assert iou(crossing.boxes[number][place], target.estimate.box) > 0.5
            names.setdefault(place, set()).add(target.id)
    assert sorted(map(len, names.values())) == [1, 1]
    assert names[0] != names[1]


def test_two_targets_do_not_settle_on_one(crossing, make_tracker, iou):
    tracker = make_tracker()
    shared = []
    for number, image in enumerate(crossing.images):
        seen = crossing.detections(number) if number == 0 else None
        targets = tracker.update(image, INTERVAL, seen)
        if number >= 30:
            shared.append(iou(*(target.estimate.box for target in targets)))
    assert max(shared) < 0.3


@pytest.mark.parametrize("footage", ["passage", "turned_passage"])
def test_a_hidden_target_goes_on_as_it_went(footage, request, make_tracker, iou):
    passage, tracker = request.getfixturevalue(footage), make_tracker()
    for number, image in enumerate(passage.images):
        hidden = iou(*passage.boxes[number][:2]) > 0.2
        told = tracker.update(
            image, INTERVAL, passage.detections(number, targets=[1] if hidden else None)
        )
        if number == 5:
            walker = min(told, key=lambda one: one.estimate.box[0]).id
        if number > 5:
            track = next(
                one
                for one in tracker._manager._track_set.tracks
                if tracker._manager._track_ids.get(one.key) == walker
            )
            assert iou(track.box, passage.boxes[number][0]) > 0.5, number


def test_a_target_behind_another_is_not_told_on_the_same_spot_for_long(pair, make_tracker, iou):
    tracker = make_tracker()
    doubled = 0
    for number, image in enumerate(pair.images):
        both = number < 8
        told = tracker.update(
            image, INTERVAL, pair.detections(number, targets=[0, 1] if both else [1])
        )
        boxes = [target.estimate.box for target in told]
        assert len(told) >= (1 if number > 3 else 0)
        doubled += len(boxes) == 2 and iou(*boxes) > 0.5
    assert doubled <= 3


def test_one_that_is_lost_hides_nobody(vanisher, make_tracker, iou):
    tracker = make_tracker(track__lost_after=1.0)
    for box in vanisher.boxes[0]:
        tracker.start(vanisher.images[0], box)
    doubled = 0
    for image, boxes in zip(vanisher.images[1:], vanisher.boxes[1:], strict=True):
        gone, walker = (target.estimate for target in tracker.update(image, INTERVAL))
        doubled += gone.state == "lost" and iou(gone.box, boxes[1]) > 0.5
        assert walker.state == "tracking"
        assert iou(walker.box, boxes[1]) > 0.7
    assert doubled


def test_one_that_leaves_behind_another_is_told_in_the_image(leaving_pair, make_tracker):
    tracker, hidden = make_tracker(), 0
    for box in leaving_pair.boxes[0]:
        tracker.start(leaving_pair.images[0], box)
    for image in leaving_pair.images[1:]:
        tracker.update(image, INTERVAL)
        for track in tracker._manager._track_set.tracks:
            hidden += track.is_occluded_by_other
            center = track.box[:2] + track.box[2:] / 2
            assert (center >= 0).all()
            assert (center <= (image.shape[1], image.shape[0])).all()
    assert hidden > 5
