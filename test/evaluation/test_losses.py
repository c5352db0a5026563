"""Where a target was out of sight, and what the boxes and the confidence tell about the cause."""

import numpy as np

from pf_tracker_ros.evaluation.reports.content import SequenceContent
from pf_tracker_ros.evaluation.reports.losses import losses
from pf_tracker_ros.evaluation.reports.timeline import RecordingVideo, Run, timeline

SIZE = (200, 100)
MIDDLE = (80.0, 40.0, 20.0, 20.0)


def content(states, confidence=None, box=MIDDLE, name="target 1", first=0):
    count = len(states)
    confidence = np.full(count, 0.9) if confidence is None else np.array(confidence, dtype=float)
    boxes = np.tile(np.array(box, dtype=float), (count, 1))
    return SequenceContent(
        name, boxes, None, tuple(states), confidence, confidence, {}, first=first
    )


def states(*runs):
    return [state for state, count in runs for _ in range(count)]


def test_short_occlusions_are_left_out_and_losses_are_not():
    shown = content(
        states(("tracking", 5), ("occluded", 2), ("tracking", 5), ("occluded", 3), ("lost", 2))
    )
    (loss,), count = losses([shown], SIZE)
    assert (loss.first, loss.last, count) == (12, 16, 1)
    assert loss.states == "occluded in 12 to 14; lost in 15 to 16"
    assert loss.outcome == "not found again"
    (short,), _ = losses([content(states(("tracking", 2), ("lost", 1), ("tracking", 1)))], SIZE)
    assert (short.states, short.outcome) == ("lost", "found again in frame 3, 0 px away")
    # Frames are counted in the recording.
    shown = content(states(("tracking", 2), ("occluded", 4), ("tracking", 1)), first=10)
    (loss,), _ = losses([shown], SIZE)
    assert (loss.first, loss.last, loss.outcome) == (12, 15, "found again in frame 16, 0 px away")


def cause(*contents, has_depth=False):
    (loss,), _ = losses(contents, SIZE, has_depth=has_depth)
    return loss.cause


def test_the_cause_is_a_target_in_front_an_edge_skipped_frames_or_the_confidence():
    out = states(("tracking", 3), ("occluded", 4))
    other = content(["tracking"] * 7, box=(84.0, 40.0, 20.0, 20.0), name="target 2")
    assert cause(content(out), other) == "behind target 2"
    far = content(["tracking"] * 7, box=(150.0, 40.0, 20.0, 20.0), name="target 2")
    assert cause(content(out, box=(1.0, 40.0, 20.0, 20.0)), far) == "at the left edge of the image"
    lower = content(out, box=(80.0, 79.0, 20.0, 20.0))
    assert cause(lower) == "at the lower edge of the image"
    skipped = content(states(("tracking", 2), ("skipped", 2), ("lost", 3)))
    assert cause(skipped) == "after 2 skipped frames"
    sudden = content(out, [0.9, 0.9, 0.9, 0.1, 0.1, 0.1, 0.1])
    assert cause(sudden).startswith("the confidence fell from 0.90 to 0.10 in 1 frame: something")
    slow = content(
        states(("tracking", 6), ("occluded", 3)), [0.9, 0.8, 0.7, 0.6, 0.5, 0.4, 0.3, 0.3, 0.3]
    )
    assert cause(slow).startswith("the confidence fell from 0.90 to 0.30 in 6 frames: it was")
    stayed = "the confidence stayed at 0.90: the tracker took it for hidden by something"
    assert cause(content(out)) == f"{stayed} that has no box here"
    assert cause(content(out), has_depth=True) == f"{stayed} that has no box here, or by its depth"
    assert cause(content(out, [np.nan] * 7)) == "the confidence is unknown"
    unreported = content(states(("tracking", 3), ("unreported", 4)), [0.9] * 3 + [np.nan] * 4)
    assert cause(unreported).startswith("not reported: it had ended, or could not be told")
    hidden = content(states(("occluded", 4), ("tracking", 3)), [0.2] * 4 + [0.9] * 3)
    assert cause(hidden) == "from the first frame on, at a confidence of 0.20"


def test_the_longest_of_many_are_listed_in_order():
    shown = content(states(*(("tracking", 1), ("lost", 2)) * 50, ("tracking", 1), ("lost", 9)))
    listed, count = losses([shown], SIZE)
    assert (len(listed), count) == (40, 51)
    assert listed[-1].last - listed[-1].first == 8
    assert [loss.first for loss in listed] == sorted(loss.first for loss in listed)


def test_the_timeline_has_the_states_and_a_line_where_the_confidence_is_known():
    shown = content(["idle", "tracking", "tracking", "lost"], [np.nan, 0.5, 1.0, np.nan], first=2)
    made = timeline([shown], RecordingVideo("", 25.0, 6, SIZE))
    (row,) = made.rows
    assert row.runs == [Run(2, 1, "idle"), Run(3, 2, "tracking"), Run(5, 1, "lost")]
    assert row.lines == ["3,0.5 4,0.5 4,0 5,0"]
    assert made.data["targets"][0]["confidence"] == [None, 0.5, 1.0, None]
