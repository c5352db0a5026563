"""Evidence of something in front of the target, in the confidence of a frame."""

import pytest

from pf_tracker_ros import MultiTracker, Tracker
from pf_tracker_ros.frames import Frame
from pf_tracker_ros.targets.out_of_sequence import reprocess
from pf_tracker_ros.targets.session import Session
from pf_tracker_ros.tracking.filter_state import NO_EVIDENCE, OcclusionEvidence
from pf_tracker_ros.tracking.hints import Hint
from pf_tracker_ros.tracking.presets import preset_parameters

SECOND = 1_000_000_000
START = 100 * SECOND


@pytest.mark.parametrize(
    ("share", "factor"), [(0.0, 1.0), (0.25, 1.0), (0.5, 0.5), (0.85, 0.15), (1.0, 0.15)]
)
def test_the_factor_is_the_uncovered_share_within_bounds(share, factor):
    assert OcclusionEvidence(share).factor == pytest.approx(factor)


def counted(shares, interval=0.25):
    """Whether each of the shares of consecutive frames counts."""
    evidence, counts = NO_EVIDENCE, []
    for share in shares:
        evidence = evidence._replace(share=share)
        counts.append(evidence.factor < 1.0)
        evidence = evidence.advance(interval)
    return counts


def test_it_counts_for_two_seconds_and_again_after_a_clear_one():
    covered = [True] * 8
    assert counted([1.0] * 40) == covered + [False] * 32
    assert counted([1.0] * 20 + [0.0] * 3 + [1.0]) == covered + [False] * 16
    assert counted([1.0] * 20 + [0.0] * 4 + [1.0] * 9) == covered + [False] * 16 + covered + [False]
    # Occlusions with short gaps between them are one.
    assert sum(counted([0.6, 0.1] * 20)) == 8


@pytest.mark.parametrize("preset", ["default", "li2007"])
@pytest.mark.parametrize(("share", "factor"), [(0.6, 0.4), (1.0, 0.15)])
def test_the_odds_of_the_confidence_are_multiplied(moving_square, preset, share, factor):
    images, boxes = moving_square.images, moving_square.boxes
    estimates = []
    for covered in (0.0, share):
        tracker = Tracker.from_preset(preset, seed=0)
        tracker.start(images[0], boxes[0])
        estimates.append(tracker.update(images[1], covered_share=covered))
    plain, lowered = (one.confidence for one in estimates)
    # The confidence falls at once from the 1 of the start.
    odds = plain / (1.0 - plain) * factor
    assert lowered == pytest.approx(odds / (1.0 + odds))
    assert estimates[0].box == estimates[1].box


@pytest.mark.parametrize(("age", "counts"), [(0.5, True), (0.51, False), (0.0, False)])
def test_it_counts_once_in_the_next_frame_unless_it_is_old(moving_square, age, counts):
    images, boxes = moving_square.images, moving_square.boxes
    results = []
    for share in (0.0, 0.7):
        session = Session(preset_parameters("default", 1), 0)
        session.request(boxes[0])
        session.process(Frame(images[0], START))
        hints = {1: Hint(share), 7: Hint(1.0)}
        session.set_hints(hints, START + round((1.0 - age) * SECOND))
        outcome = session.process(Frame(images[1], START + SECOND))
        results.append(outcome.estimate.confidence)
        (track,) = session._manager._track_set.tracks
        assert track.filter_state.occlusion_evidence.share == 0.0
    assert (results[1] < results[0]) == counts


@pytest.mark.parametrize("share", [-0.1, 1.1, float("nan"), "half", None, True])
def test_a_share_that_is_none_is_refused(moving_square, share):
    images, boxes = moving_square.images, moving_square.boxes
    tracker, several = Tracker.from_preset("default"), MultiTracker.from_preset("default")
    tracker.start(images[0], boxes[0])
    several.start(images[0], boxes[0])
    with pytest.raises(ValueError, match=r"covered share is .*; allowed: a number from 0 to 1"):
        tracker.update(images[1], covered_share=share)
    with pytest.raises(ValueError, match="covered share"):
        several.update(images[1], covered_shares={1: share})


def test_shares_without_ids_are_refused(moving_square):
    tracker = MultiTracker.from_preset("default")
    with pytest.raises(ValueError, match=r"covered_shares is \[0.5\]; allowed: a mapping"):
        tracker.update(moving_square.images[0], covered_shares=[0.5])


def test_frames_with_it_are_no_looks_at_other_places(moving_square):
    """A wrong share hides the target for a moment, and costs it no trust after that."""
    images, boxes = moving_square.images, moving_square.boxes
    thresholds = {"track.wrong_box_cost": 20.0}
    tracker = Tracker.from_preset("default", seed=0, parameters=thresholds)
    tracker.start(images[0], boxes[0])
    for image in images[1:6]:
        hidden = tracker.update(image, 0.1, covered_share=1.0)
    assert hidden.state == "occluded"
    assert tracker._manager._track_set.tracks[0].filter_state.status.hidden_for == 0.0


def test_it_stays_with_its_frame_where_frames_are_reprocessed(moving_square):
    images, boxes = moving_square.images, moving_square.boxes
    tracker = MultiTracker.from_preset("default", seed=0)
    tracker.start(images[0], boxes[0])
    shares = {2: {1: 0.8}, 3: {1: 0.5, 9: 1.0}}
    targets = [
        tracker.update(images[number], covered_shares=shares.get(number)) for number in range(1, 5)
    ]
    manager = tracker._manager
    again, _ = reprocess(manager._pipeline, manager.frames.entries)
    assert again.tracks[0].filter_state.estimate == targets[-1][0].estimate
    assert targets[1][0].estimate.confidence < targets[0][0].estimate.confidence
