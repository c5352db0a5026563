"""The confidence from frame to frame."""

import pytest

from pf_tracker_ros.cues import Match
from pf_tracker_ros.tracking.confidence import Confidence
from pf_tracker_ros.tracking.track_parameters import TrackParameters


def told(rate, before, similarities):
    """The confidences after frames of these similarities, whatever their likelihood."""
    confidence, after = Confidence(rate), []
    for number, similarity in enumerate(similarities):
        before = confidence.update(before, Match(-10.0 * number, similarity))
        after.append(before)
    return after


def test_it_falls_at_once_and_rises_by_its_share_of_each_frame():
    assert told(0.25, 1.0, (0.2, 1.0, 1.0, 0.5, 0.9)) == pytest.approx([0.2, 0.4, 0.55, 0.5, 0.6])


def test_by_default_it_is_what_the_frame_says():
    similarities = [0.1, 0.3, 0.7, 0.2]
    assert told(TrackParameters().confidence_rate, 0.3, similarities) == similarities


def test_it_never_rises_above_what_the_frames_say():
    assert told(0.5, 0.0, [0.8] * 60)[-1] == pytest.approx(0.8)
