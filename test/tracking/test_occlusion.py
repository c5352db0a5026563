"""Occlusion policies: coast, or keep tracking the likeliest box."""

from dataclasses import replace
from types import SimpleNamespace

import cv2
import numpy as np
import pytest

from pf_tracker_ros import Tracker
from pf_tracker_ros.cues import Match
from pf_tracker_ros.filter import ParticleSet
from pf_tracker_ros.frames import Frame
from pf_tracker_ros.tracking.assessment import Assessment
from pf_tracker_ros.tracking.estimate import TrackStatus
from pf_tracker_ros.tracking.measurement import Measurement
from pf_tracker_ros.tracking.occlusion import OCCLUSION_POLICIES, Coast, KeepTracking
from pf_tracker_ros.tracking.prediction import Prediction

STATUSES = (TrackStatus("occluded", 0.2), TrackStatus("lost", 3.0))


@pytest.fixture
def state(make_target_filter, couple):
    return make_target_filter("zhang_bo").start(couple.images[0], couple.first[0])


@pytest.fixture
def measurement(state, couple):
    """The likeliest particle is the last one, far from the mean."""
    predicted = state.particles
    weighted = predicted.reweight(np.linspace(0.0, 400.0, len(predicted)))
    boxes = state.motion.boxes(predicted.states)
    frame_prediction = SimpleNamespace(filter_state=state, prediction=Prediction(predicted, 0.04))
    match = Match(-30.0, 0.1)
    return Measurement(frame_prediction, weighted, boxes, boxes[-1], {}, {}, match, {})


def measured_assessment(measurement, status):
    return Assessment(measurement.box, 0.1, status, measurement.particles, measurement.boxes)


@pytest.mark.parametrize("status", STATUSES)
def test_the_box_of_a_coasting_target_is_that_of_the_motion_model(state, measurement, status):
    seen = measured_assessment(measurement, status)
    assessment = Coast().assess(measurement, seen)
    predicted = state.particles
    mean = predicted.mean
    np.testing.assert_array_equal(assessment.box, state.motion.boxes(mean[None])[0])
    assert np.abs(assessment.box - measurement.box).max() > 0.5
    assert assessment.particles is predicted
    assert assessment.learns is False
    assert (assessment.status, assessment.confidence) == (status, 0.1)
    np.testing.assert_array_equal(assessment.boxes, state.motion.boxes(assessment.particles.states))


@pytest.mark.parametrize("status", STATUSES)
def test_with_keep_tracking_the_assessment_stays(state, measurement, status):
    seen = measured_assessment(measurement, status)
    assert KeepTracking().assess(measurement, seen) is seen
    assert seen.learns is True


@pytest.mark.parametrize("policy", [Coast(), KeepTracking()])
@pytest.mark.parametrize("status", STATUSES)
def test_only_a_lost_target_that_coasts_keeps_its_particles(state, measurement, policy, status):
    resampled = ParticleSet.uniform(measurement.particles.states + 1.0)
    kalman_filter = replace(state.kalman_filter.predict(0.04))
    assessment = policy.assess(measurement, measured_assessment(measurement, status))
    particles, ahead = policy.next_particles(state, assessment, resampled, kalman_filter)
    if isinstance(policy, Coast) and status.state == "lost":
        assert (particles, ahead) == (state.particles, state.kalman_filter)
    else:
        assert (particles, ahead) == (resampled, kalman_filter)


@pytest.mark.parametrize("policy", sorted(OCCLUSION_POLICIES))
def test_the_parameter_selects_the_policy(policy, make_target_filter, couple):
    """With a threshold that no confidence reaches, a visible target counts as occluded."""
    parameters = {"track.wrong_box_cost": 1e6}
    target_filter = make_target_filter("li2007", parameters | {"track.occlusion_policy": policy})
    state = target_filter.start(couple.images[0], couple.second[0])
    learned = state.templates["color_histogram"]
    for image in couple.images[1:]:
        state = target_filter.follow(state, Frame(image), 0.04)
        assert state.status.state == "occluded"
    off = np.abs(np.array(state.estimate.box) - couple.second[-1]).max()
    assert off < 6.0 if policy == "keep_tracking" else off > 20.0
    assert (state.templates["color_histogram"] is learned) == (policy == "coast")


def test_a_lost_target_keeps_its_last_size_in_a_motion_model_with_a_relative_scale():
    """It grows to twice its size first; the affine motion model has the logarithm of its scale."""
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
        lost = tracker.update(ground)
    assert lost.state == "lost"
    found = tracker.update(picture(2.0))
    assert found.state == "tracking"
    assert found.box[2] == pytest.approx(60.0, rel=0.2)


def test_a_change_of_the_number_of_particles_applies_to_a_lost_target(couple):
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


def test_coasting_particles_are_those_of_the_transition_prior_without_a_search(couple):
    """With the same noise, their standard deviation is the same with and without a search."""
    std = {}
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
        std[method] = np.sqrt(estimate.weights @ ((centers - mean) ** 2).sum(axis=1))
    assert std["search"] < 1.3 * std["transition"]
