"""Measurers: particles weighed where they are predicted, or after a search."""

from dataclasses import replace

import cv2
import numpy as np
import pytest

from pf_tracker_ros.cues import CUES, CueFusion
from pf_tracker_ros.filter import ParticleSet, ProposalParameters
from pf_tracker_ros.frames import Foreground, Frame
from pf_tracker_ros.tracking.assessment import Assessment
from pf_tracker_ros.tracking.box_covariance import (
    box_covariance,
    box_features,
    particle_covariance,
)
from pf_tracker_ros.tracking.estimate import TrackStatus
from pf_tracker_ros.tracking.measurement import Measurer, SearchingMeasurer
from pf_tracker_ros.tracking.prediction import Prediction
from pf_tracker_ros.tracking.search import Search, mode_mean

INTERVAL = 0.04
WORKING_SIZE = 40
SHARE, WINDOW = 0.6, 3.6


def fusion(*names):
    own = {name: CUES.parameters_of(name)() for name in names}
    return CueFusion({name: (CUES[name](one), one.weight) for name, one in own.items()})


def measurers(*names):
    """One of each kind, with the same cues."""
    cues = fusion(*names)
    parameters = ProposalParameters(share=SHARE, window=WINDOW)
    return (
        Measurer(cues, WORKING_SIZE),
        SearchingMeasurer(cues, WORKING_SIZE, parameters, adaptation=1.5),
    )


@pytest.fixture
def state(make_target_filter, couple):
    """In the first image, with templates of the cues of the preset `default`."""
    target_filter = make_target_filter("default", {"particles": 100})
    return target_filter.start(couple.images[0], couple.first[0])


def shifted(image, pixels):
    """The image moved to the right."""
    matrix = np.array([[1.0, 0.0, pixels], [0.0, 1.0, 0.0]])
    size = image.shape[1::-1]
    return cv2.warpAffine(image, matrix, size, borderMode=cv2.BORDER_REPLICATE)


def prediction_for(state):
    """The particles as they are, with different weights."""
    particles = state.particles.reweight(np.linspace(0.0, 1.0, len(state.particles)))
    return Prediction(particles, INTERVAL)


def measure(measurer, state, frame, prediction, generator=None):
    generator = generator or new_rng()
    predicted = measurer.predict_frame(state, frame, INTERVAL, prediction, generator)
    return measurer.measure(predicted)


def new_rng():
    return np.random.default_rng(8)


CUES_OF_DEFAULT = ("color_contrast", "correlation_response")


def test_without_a_search_every_particle_is_weighed_where_it_is(state, couple):
    measurer, _ = measurers(*CUES_OF_DEFAULT)
    prediction = prediction_for(state)
    generator = new_rng()
    measurement = measure(measurer, state, Frame(couple.images[0]), prediction, generator)
    assert measurement.frame_prediction.prediction.particles is prediction.particles
    np.testing.assert_array_equal(measurement.particles.states, prediction.particles.states)
    np.testing.assert_array_equal(
        measurement.boxes, state.motion.boxes(measurement.particles.states)
    )
    mean = measurement.particles.mean
    np.testing.assert_allclose(measurement.box, state.motion.boxes(mean[None])[0])
    # The weights are multiplied by the likelihoods, which fall with the distance.
    gained = measurement.particles.log_weights - prediction.particles.log_weights
    centers = measurement.boxes[:, :2] + measurement.boxes[:, 2:] / 2
    distance = np.linalg.norm(centers - couple.first[0][:2] - couple.first[0][2:] / 2, axis=1)
    assert np.corrcoef(gained, distance)[0, 1] < -0.8
    assert measurement.frame_prediction.search is None
    assert measurement.distractor_ratios == {}
    assert measurement.cue_weights == {"color_contrast": 0.5, "correlation_response": 0.5}
    # No random number is drawn.
    assert generator.bit_generator.state == new_rng().bit_generator.state
    status, particles = TrackStatus("lost", 9.0), measurement.particles
    lost = Assessment(measurement.box, 0.1, status, particles, measurement.boxes)
    covariance = measurer.covariance(measurement, lost, 9.0)
    expected = particle_covariance(measurement.particles, measurement.boxes)
    np.testing.assert_array_equal(covariance, expected)


def test_a_search_finds_a_target_where_no_particle_is(state, couple):
    """Two thirds of a box away."""
    measurer, searching = measurers(*CUES_OF_DEFAULT)
    frame = Frame(shifted(couple.images[0], 20))
    there = couple.first[0] + [20.0, 0.0, 0.0, 0.0]
    box = {
        one: measure(one, state, frame, prediction_for(state)).box for one in (measurer, searching)
    }
    assert np.abs(box[searching] - there).max() < 2.0
    assert there[0] - box[measurer][0] > 10.0


@pytest.mark.parametrize("side", [-1, 1], ids=["left", "right"])
def test_the_foreground_leads_a_search_to_the_moving_one_of_two_equal_objects(state, couple, side):
    """Both where no particle is, one of them part of the background."""
    _, searching = measurers(*CUES_OF_DEFAULT, "foreground")
    image = np.full_like(couple.images[0], 125)
    x, y, width, height = couple.first[0].astype(int)
    sprite = couple.images[0][y : y + height, x : x + width]
    for shift in (-28, 28):
        image[y : y + height, x + shift : x + shift + width] = sprite
    frame, there = Frame(image), x + 28 * side
    mask = np.zeros(image.shape[:2], np.uint8)
    mask[y : y + height, there : there + width] = 255
    frame.foreground = Foreground(mask, 1)
    state = replace(state, templates={**state.templates, "foreground": None})
    measurement = measure(searching, state, frame, prediction_for(state))
    assert np.abs(measurement.box - [there, y, width, height]).max() < 3.0
    found = measurement.particles.states[:, 0] - couple.first[0][0] - width / 2
    assert np.mean(found * side > width / 2) > 0.3


def test_the_search_is_around_the_predicted_mean_and_its_particles_carry_p_over_q(state, couple):
    _, searching = measurers(*CUES_OF_DEFAULT)
    cues = fusion(*CUES_OF_DEFAULT)
    frame, prediction = Frame(couple.images[1]), prediction_for(state)
    measurement = measure(searching, state, frame, prediction)
    before = prediction.particles
    boxes = state.motion.boxes(before.states)
    np.testing.assert_allclose(
        measurement.frame_prediction.search.center_box, before.weights @ boxes
    )

    # The same from its parts; `test_proposals.py` tests the proposal itself.
    center_box = before.weights @ boxes
    search = Search(center_box, ProposalParameters(share=SHARE, window=WINDOW), frame.size)
    region = searching.predict_frame(state, frame, INTERVAL, prediction, new_rng()).region
    found = cues.responses(region, search.boxes, state.templates)
    cue_weights = cues.adapt(state.distractor_ratios, 1.5)
    assert measurement.cue_weights == pytest.approx(cue_weights)
    centers = state.motion.center_prior(state.particles.states, INTERVAL)
    likelihood = cues.search(region, search.grid, found, state.templates, cue_weights)
    expected, log_prior = search.propose(before, state.motion, centers, likelihood, new_rng())
    np.testing.assert_allclose(measurement.particles.states, expected.states)
    assert np.ptp(expected.log_weights - before.log_weights) > 0.1
    # Sizes and velocities stay those of the motion model.
    np.testing.assert_array_equal(measurement.particles.states[:, 2:], before.states[:, 2:])
    gained = cues.log_likelihood(region, measurement.boxes, state.templates, cue_weights)
    weighted = expected.reweight(gained)
    np.testing.assert_allclose(measurement.particles.log_weights, weighted.log_weights, atol=1e-6)
    mean = mode_mean(measurement.particles, measurement.boxes, int(np.argmax(log_prior + gained)))
    np.testing.assert_allclose(measurement.box, state.motion.boxes(mean[None])[0])


def test_the_estimate_between_two_equal_objects_is_one_of_them_and_not_the_middle(state, couple):
    _, searching = measurers(*CUES_OF_DEFAULT)
    x, y, side, _ = couple.first[0].astype(int)
    image = couple.images[couple.hidden[0]].copy()
    # One on each side of the last box.
    places = [couple.first[0] + [right, 0.0, 0.0, 0.0] for right in (-20, 20)]
    for place in places:
        left = int(place[0])
        image[y : y + side, left : left + side] = couple.images[0][y : y + side, x : x + side]
    measurement = measure(searching, state, Frame(image), prediction_for(state))
    weights, lefts = measurement.particles.weights, measurement.boxes[:, 0]
    assert min(weights[np.abs(lefts - place[0]) < 5.0].sum() for place in places) > 0.02
    assert min(np.abs(measurement.box - place).max() for place in places) < 1.5


def test_similar_colors_beside_the_target_raise_the_ratio_of_the_color_cue(state, couple):
    _, searching = measurers(*CUES_OF_DEFAULT)
    plain = couple.images[0].copy()
    # The ground covers the other target, then the target's own colors in random order do.
    x, y, side, _ = couple.second[0].astype(int)
    plain[y : y + side, x : x + side] = plain[y + 40 : y + 40 + side, x : x + side]
    confusing = plain.copy()
    own_x, own_y = couple.first[0][:2].astype(int)
    colors = plain[own_y : own_y + side, own_x : own_x + side].reshape(-1, 3).copy()
    np.random.default_rng(0).shuffle(colors)
    confusing[y : y + side, x : x + side] = colors.reshape(side, side, 3)
    distractor_ratios = [
        measure(searching, state, Frame(image), prediction_for(state)).distractor_ratios
        for image in (plain, confusing)
    ]
    assert distractor_ratios[0].keys() == distractor_ratios[1].keys() == set(CUES_OF_DEFAULT)
    grown = {
        name: distractor_ratios[1][name] - distractor_ratios[0][name] for name in CUES_OF_DEFAULT
    }
    # The ratio is smoothed: a tenth of each frame.
    assert grown["color_contrast"] > 0.03
    assert grown["color_contrast"] > 2 * grown["correlation_response"]


def test_while_no_searching_cue_has_a_template_there_is_no_search(state, couple):
    measurer, searching = measurers("color_histogram", *CUES_OF_DEFAULT)
    frame = Frame(couple.images[1])
    templates = fusion("color_histogram").learn(
        searching.search_window(Frame(couple.images[0]), couple.first[0])[1], couple.first[0]
    )
    state = replace(state, templates=templates, distractor_ratios={})
    without, fallen_back = (
        measure(one, state, frame, prediction_for(state)) for one in (measurer, searching)
    )
    np.testing.assert_array_equal(without.particles.states, fallen_back.particles.states)
    np.testing.assert_array_equal(without.particles.log_weights, fallen_back.particles.log_weights)
    np.testing.assert_array_equal(without.box, fallen_back.box)
    assert without.match == fallen_back.match
    assert fallen_back.frame_prediction.search is None
    assessment = Assessment(
        without.box, 0.3, TrackStatus("occluded", 1.0), fallen_back.particles, fallen_back.boxes
    )
    covariance = searching.covariance(fallen_back, assessment, 1.0)
    expected = particle_covariance(fallen_back.particles, fallen_back.boxes)
    np.testing.assert_array_equal(covariance, expected)


def test_the_covariance_of_a_search_is_that_of_the_box_and_grows_while_hidden(state, couple):
    _, searching = measurers(*CUES_OF_DEFAULT)
    measurement = measure(searching, state, Frame(couple.images[1]), prediction_for(state))
    box, particles = measurement.box, measurement.particles
    seen = Assessment(box, 0.75, TrackStatus(), particles, measurement.boxes)
    np.testing.assert_array_equal(
        searching.covariance(measurement, seen, 5.0),
        box_covariance(box, box_features(box, 0.75)),
    )
    # The random walk of the preset's position noise, .6 box sizes in a second, for 4 s.
    hidden = seen._replace(status=TrackStatus("lost", 9.0))
    np.testing.assert_allclose(
        searching.covariance(measurement, hidden, 4.0),
        box_covariance(box, box_features(box, 0.0), 1.2),
    )


@pytest.mark.parametrize(("side", "reduction"), [(30, 1), (40, 1), (41, 2), (90, 3)])
def test_large_targets_are_measured_in_an_image_reduced_to_the_working_size(side, reduction, state):
    noise = np.random.default_rng(0).integers(0, 256, (240, 320, 3), dtype=np.uint8)
    box = np.array([100.0, 60.0, side, side])
    reductions = []

    class WatchedFrame(Frame):
        def view(self, part, reduction=1):
            reductions.append(reduction)
            return super().view(part, reduction)

    measurer = Measurer(fusion("color_histogram"), WORKING_SIZE)
    measurer.learn(WatchedFrame(noise), box)
    particles = ParticleSet.uniform([[100 + side / 2, 60 + side / 2, 0.0, 0.0, side, side]])
    estimate = replace(state.estimate, box=tuple(box.tolist()))
    templates, _ = measurer.learn(Frame(noise), box)
    measure(
        measurer,
        replace(state, templates=templates, estimate=estimate),
        WatchedFrame(noise),
        Prediction(particles, INTERVAL),
    )
    assert set(reductions) == ({reduction} if reduction == 1 else {1, reduction})
