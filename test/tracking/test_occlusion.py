"""What is done with a target while it is hidden: it coasts, or the likeliest place is followed."""

from dataclasses import replace

import cv2
import numpy as np
import pytest

from pf_tracker_ros import Tracker
from pf_tracker_ros.cues import Match
from pf_tracker_ros.filter import ParticleSet
from pf_tracker_ros.filter.particles import GeneratorState
from pf_tracker_ros.frames import Frame
from pf_tracker_ros.tracking.assessment import Assessment
from pf_tracker_ros.tracking.estimate import TrackStatus
from pf_tracker_ros.tracking.measurement import Measurement
from pf_tracker_ros.tracking.occlusion import OCCLUSION_POLICIES, Coast, KeepTracking

HIDDEN = (TrackStatus("occluded", 0.2), TrackStatus("lost", 3.0))


@pytest.fixture
def target(make_target_filter, couple):
    draw = GeneratorState.of(np.random.default_rng(3))
    frame = Frame(couple.images[0])
    return make_target_filter("zhang_bo").initialize(frame, tuple(couple.first[0]), draw)


@pytest.fixture
def measured(target, couple):
    """The likeliest particle is the last one, far from the middle of the cloud."""
    predicted = target.particles
    weighed = predicted.reweight(np.linspace(0.0, 400.0, len(predicted)))
    boxes = target.motion.boxes(predicted.states)
    frame = Frame(couple.images[1])
    match = Match(-30.0, 0.1)
    return Measurement(frame, predicted, weighed, boxes, boxes[-1], {}, {}, match, {})


def told_if_seen(measured, track):
    return Assessment(measured.box, 0.1, track, measured.particles, measured.boxes)


def test_there_are_two_ways():
    assert dict(OCCLUSION_POLICIES) == {"coast": Coast, "keep_tracking": KeepTracking}


@pytest.mark.parametrize("track", HIDDEN)
def test_a_coasting_target_is_told_where_the_motion_alone_takes_it(target, measured, track):
    seen = told_if_seen(measured, track)
    assessment = Coast().assess(target, measured, seen)
    mean = measured.predicted.mean
    np.testing.assert_array_equal(assessment.box, target.motion.boxes(mean[None])[0])
    assert np.abs(assessment.box - measured.box).max() > 0.5
    assert assessment.particles is measured.predicted
    assert assessment.learns is False
    assert (assessment.status, assessment.confidence) == (track, 0.1)
    np.testing.assert_array_equal(
        assessment.boxes, target.motion.boxes(assessment.particles.states)
    )


@pytest.mark.parametrize("track", HIDDEN)
def test_the_likeliest_place_is_told_as_if_it_was_seen(target, measured, track):
    seen = told_if_seen(measured, track)
    assert KeepTracking().assess(target, measured, seen) is seen
    assert seen.learns is True


@pytest.mark.parametrize("way", [Coast(), KeepTracking()])
@pytest.mark.parametrize("track", HIDDEN)
def test_only_a_lost_target_that_coasts_goes_on_from_where_that_began(target, measured, way, track):
    resampled = ParticleSet.uniform(measured.particles.states + 1.0)
    kalman_filter = replace(target.kalman_filter.predict(0.04))
    assessment = way.assess(target, measured, told_if_seen(measured, track))
    particles, ahead = way.next_particles(target, assessment, resampled, kalman_filter)
    if isinstance(way, Coast) and track.state == "lost":
        assert (particles, ahead) == (target.particles, target.kalman_filter)
    else:
        assert (particles, ahead) == (resampled, kalman_filter)


@pytest.mark.parametrize("way", sorted(OCCLUSION_POLICIES))
def test_the_parameter_chooses(way, make_target_filter, couple):
    """Where nothing is sure enough, the target counts as hidden though it moves in plain sight."""
    parameters = {"track.occluded_below": 1.0, "track.recovered_above": 1.0}
    target_filter = make_target_filter("li2007", parameters | {"track.occlusion_policy": way})
    draw = GeneratorState.of(np.random.default_rng(3))
    target = target_filter.initialize(Frame(couple.images[0]), tuple(couple.second[0]), draw)
    learned = target.templates["color_histogram"]
    for image in couple.images[1:]:
        target = target_filter.follow(target, Frame(image), 0.04)
        assert target.status.state == "occluded"
    off = np.abs(np.array(target.estimate.box) - couple.second[-1]).max()
    assert off < 6.0 if way == "keep_tracking" else off > 20.0
    assert (target.templates["color_histogram"] is learned) == (way == "coast")


def test_a_lost_target_that_is_followed_keeps_its_size_in_a_motion_that_counts_from_the_first():
    """It grew to twice its size before it went; the affine motion has its scale as a logarithm."""
    ground = cv2.GaussianBlur(
        np.random.default_rng(0).integers(0, 255, (240, 320, 3)).astype(np.uint8), (0, 0), 3
    )
    sprite = np.zeros((40, 30, 3), np.uint8)
    sprite[:20], sprite[20:] = (20, 20, 220), (200, 30, 30)

    def picture(scale):
        image = ground.copy()
        part = cv2.resize(sprite, None, fx=scale, fy=scale)
        image[80 : 80 + len(part), 100 : 100 + part.shape[1]] = part
        return image

    values = {
        "track.occlusion_policy": "keep_tracking",
        "cues": ("color_histogram", "gradient_orientation"),
        "proposal.method": "transition",
        "motion.size_noise": 0.3,
        "motion.position_noise": 0.3,
        "particles": 600,
        "template.update_above": 0.3,
    }
    tracker = Tracker.from_preset("zhang_bo", parameters=values)
    tracker.start(picture(1.0), (100, 80, 30, 40))
    for step in range(1, 120):
        seen = tracker.update(picture(1 + step / 120))
    assert seen.box[2] > 50.0
    for _ in range(60):
        gone = tracker.update(ground)
    assert gone.state == "lost"
    found = tracker.update(picture(2.0))
    assert found.state == "tracking"
    assert found.box[2] == pytest.approx(60.0, rel=0.2)


def test_a_target_that_is_lost_goes_on_with_the_number_of_particles_that_is_asked_for(couple):
    tracker = Tracker.from_preset("li2007")
    tracker.start(couple.images[0], couple.first[0])
    blank = np.zeros_like(couple.images[0])
    for _ in range(80):
        estimate = tracker.update(blank, 0.04)
    assert estimate.state == "lost"
    tracker.set_parameters({"particles": 200})
    for _ in range(2):
        estimate = tracker.update(blank, 0.04)
    assert (estimate.state, len(estimate.weights)) == ("lost", 200)


def test_coasting_takes_no_particles_from_a_search(couple):
    """With the same noise, a cloud spreads as far whether places were looked at or not."""
    spreads = {}
    for method in ("search", "transition"):
        changed = {"proposal.method": method, "track.occlusion_policy": "coast", "particles": 2000}
        tracker = Tracker.from_preset("default", 0, {**changed, "track.lost_after": 100.0})
        tracker.start(couple.images[0], couple.first[0])
        for _ in range(20):
            tracker.update(couple.images[0], 0.04)
        for _ in range(10):
            estimate = tracker.update(np.zeros_like(couple.images[0]), 0.04)
        assert estimate.state == "occluded"
        centers = estimate.particles[:, :2]
        mean = estimate.weights @ centers
        spreads[method] = np.sqrt(estimate.weights @ ((centers - mean) ** 2).sum(axis=1))
    assert spreads["search"] < 1.3 * spreads["transition"]
