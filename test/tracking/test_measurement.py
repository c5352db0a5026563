"""Measurers: particles weighed where they are, or after a search all around."""

from dataclasses import replace

import cv2
import numpy as np
import pytest

from pf_tracker_ros.cues import CUES, CueFusion
from pf_tracker_ros.filter import ParticleSet, ProposalParameters
from pf_tracker_ros.filter.particles import GeneratorState
from pf_tracker_ros.frames import Foreground, Frame
from pf_tracker_ros.tracking.assessment import Assessment
from pf_tracker_ros.tracking.estimate import TrackStatus
from pf_tracker_ros.tracking.measurement import Measurer, SearchingMeasurer
from pf_tracker_ros.tracking.prediction import Prediction
from pf_tracker_ros.tracking.search import Search, covariance_about, mode_mean

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
def target(make_target_filter, couple):
    """In the first image, known by the cues of the preset `default`."""
    draw = GeneratorState.of(np.random.default_rng(3))
    target_filter = make_target_filter("default", {"particles": 100})
    return target_filter.initialize(Frame(couple.images[0]), tuple(couple.first[0]), draw)


def shifted(image, pixels):
    """All of the image so many pixels to the right."""
    matrix = np.array([[1.0, 0.0, pixels], [0.0, 1.0, 0.0]])
    size = image.shape[1::-1]
    return cv2.warpAffine(image, matrix, size, borderMode=cv2.BORDER_REPLICATE)


def prediction_for(target):
    """The particles as they are, of weights that are not all the same."""
    particles = target.particles.reweight(np.linspace(0.0, 1.0, len(target.particles)))
    return Prediction(particles, INTERVAL)


def measure(measurer, target, frame, prediction, draw=None):
    expected = measurer.predict_frame(target, frame, INTERVAL, prediction, draw or generator())
    return measurer.estimate(measurer.weigh(expected))


def generator():
    return np.random.default_rng(8)


CUES_OF_DEFAULT = ("color_contrast", "correlation_response")


def test_without_a_search_every_particle_is_weighed_where_it_is(target, couple):
    measurer, _ = measurers(*CUES_OF_DEFAULT)
    prediction = prediction_for(target)
    draw = generator()
    measured = measure(measurer, target, Frame(couple.images[0]), prediction, draw)
    assert measured.predicted is prediction.particles
    np.testing.assert_array_equal(measured.particles.states, prediction.particles.states)
    np.testing.assert_array_equal(measured.boxes, target.motion.boxes(measured.particles.states))
    mean = measured.particles.mean
    np.testing.assert_allclose(measured.box, target.motion.boxes(mean[None])[0])
    # The weights are those of the prediction times the likelihoods, so they fall with the distance.
    gained = measured.particles.log_weights - prediction.particles.log_weights
    centers = measured.boxes[:, :2] + measured.boxes[:, 2:] / 2
    distance = np.linalg.norm(centers - couple.first[0][:2] - couple.first[0][2:] / 2, axis=1)
    assert np.corrcoef(gained, distance)[0, 1] < -0.8
    assert measured.search is None
    assert measured.distractor_ratios == {}
    assert measured.cue_weights == {"color_contrast": 0.5, "correlation_response": 0.5}
    # It takes no chances.
    assert draw.bit_generator.state == generator().bit_generator.state
    covariance = measurer.covariance(
        target,
        measured,
        Assessment(measured.box, 0.1, TrackStatus("lost", 9.0), measured.particles, measured.boxes),
        9.0,
    )
    np.testing.assert_array_equal(covariance, measured.particles.covariance[:2, :2])


def test_a_search_finds_what_is_out_of_the_particles_reach(target, couple):
    """Two thirds of a box away, where no particle is drawn."""
    measurer, searching = measurers(*CUES_OF_DEFAULT)
    frame = Frame(shifted(couple.images[0], 20))
    there = couple.first[0] + [20.0, 0.0, 0.0, 0.0]
    box = {
        one: measure(one, target, frame, prediction_for(target)).box
        for one in (measurer, searching)
    }
    assert np.abs(box[searching] - there).max() < 2.0
    assert there[0] - box[measurer][0] > 10.0


@pytest.mark.parametrize("side", [-1, 1], ids=["left", "right"])
def test_a_search_is_led_to_the_one_of_two_alike_that_moves(target, couple, side):
    """Both out of the particles' reach, one of them part of the background."""
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
    target = replace(target, templates={**target.templates, "foreground": None})
    measured = measure(searching, target, frame, prediction_for(target))
    assert np.abs(measured.box - [there, y, width, height]).max() < 3.0
    found = measured.predicted.states[:, 0] - couple.first[0][0] - width / 2
    assert np.mean(found * side > width / 2) > 0.3


def test_the_search_is_around_the_predicted_mean_and_its_particles_carry_p_over_q(target, couple):
    _, searching = measurers(*CUES_OF_DEFAULT)
    cues = fusion(*CUES_OF_DEFAULT)
    frame, prediction = Frame(couple.images[1]), prediction_for(target)
    measured = measure(searching, target, frame, prediction)
    before = prediction.particles
    boxes = target.motion.boxes(before.states)
    np.testing.assert_allclose(measured.search.center_box, before.weights @ boxes)

    # The same by the parts, of which the search's own proposal is tested with the proposals.
    center_box = before.weights @ boxes
    search = Search(center_box, ProposalParameters(share=SHARE, window=WINDOW), frame.size)
    _, region = searching.search_window(frame, center_box)
    found = cues.responses(region, search.boxes, target.templates)
    cue_weights = cues.adapt(target.distractor_ratios, 1.5)
    assert measured.cue_weights == pytest.approx(cue_weights)
    centers = target.motion.center_prior(target.particles.states, INTERVAL)
    likelihood = cues.search(region, search.grid, found, target.templates, cue_weights)
    expected, log_prior = search.propose(before, target.motion, centers, likelihood, generator())
    np.testing.assert_allclose(measured.predicted.states, expected.states)
    np.testing.assert_allclose(measured.predicted.log_weights, expected.log_weights, atol=1e-6)
    assert np.ptp(measured.predicted.log_weights - before.log_weights) > 0.1
    # Sizes and velocities stay the motion model's.
    np.testing.assert_array_equal(measured.predicted.states[:, 2:], before.states[:, 2:])
    gained = measured.particles.log_weights - measured.predicted.log_weights
    mean = mode_mean(measured.particles, measured.boxes, int(np.argmax(log_prior + gained)))
    np.testing.assert_allclose(measured.box, target.motion.boxes(mean[None])[0])


def test_of_two_places_that_look_alike_one_is_told_and_not_the_middle(target, couple):
    _, searching = measurers(*CUES_OF_DEFAULT)
    x, y, side, _ = couple.first[0].astype(int)
    image = couple.images[couple.hidden[0]].copy()
    # On both sides of where it was.
    places = [couple.first[0] + [right, 0.0, 0.0, 0.0] for right in (-20, 20)]
    for center_box in places:
        left = int(center_box[0])
        image[y : y + side, left : left + side] = couple.images[0][y : y + side, x : x + side]
    measured = measure(searching, target, Frame(image), prediction_for(target))
    weights = [
        measured.particles.weights[np.abs(measured.boxes[:, 0] - center_box[0]) < 5.0].sum()
        for center_box in places
    ]
    assert min(weights) > 0.02
    assert min(np.abs(measured.box - center_box).max() for center_box in places) < 1.5


def test_what_looks_alike_beside_the_target_is_a_distraction(target, couple):
    _, searching = measurers(*CUES_OF_DEFAULT)
    plain = couple.images[0].copy()
    # The other target is near; the ground is put over it, and then the target's own colors.
    x, y, side, _ = couple.second[0].astype(int)
    plain[y : y + side, x : x + side] = plain[y + 40 : y + 40 + side, x : x + side]
    confusing = plain.copy()
    own_x, own_y = couple.first[0][:2].astype(int)
    colors = plain[own_y : own_y + side, own_x : own_x + side].reshape(-1, 3).copy()
    np.random.default_rng(0).shuffle(colors)
    confusing[y : y + side, x : x + side] = colors.reshape(side, side, 3)
    distractor_ratios = [
        measure(searching, target, Frame(image), prediction_for(target)).distractor_ratios
        for image in (plain, confusing)
    ]
    assert distractor_ratios[0].keys() == distractor_ratios[1].keys() == set(CUES_OF_DEFAULT)
    grown = {
        name: distractor_ratios[1][name] - distractor_ratios[0][name] for name in CUES_OF_DEFAULT
    }
    # A tenth of each frame is in it.
    assert grown["color_contrast"] > 0.03
    assert grown["color_contrast"] > 2 * grown["correlation_response"]


def test_while_no_cue_that_searches_has_a_template_it_is_as_without_a_search(target, couple):
    measurer, searching = measurers("color_histogram", *CUES_OF_DEFAULT)
    frame = Frame(couple.images[1])
    templates = fusion("color_histogram").learn(
        searching.search_window(Frame(couple.images[0]), couple.first[0])[1], couple.first[0]
    )
    target = replace(target, templates=templates, distractor_ratios={})
    without, fallen_back = (
        measure(one, target, frame, prediction_for(target)) for one in (measurer, searching)
    )
    np.testing.assert_array_equal(without.particles.states, fallen_back.particles.states)
    np.testing.assert_array_equal(without.particles.log_weights, fallen_back.particles.log_weights)
    np.testing.assert_array_equal(without.box, fallen_back.box)
    assert without.match == fallen_back.match
    assert fallen_back.search is None
    assessment = Assessment(
        without.box, 0.3, TrackStatus("occluded", 1.0), fallen_back.particles, fallen_back.boxes
    )
    covariance = searching.covariance(target, fallen_back, assessment, 1.0)
    np.testing.assert_array_equal(covariance, fallen_back.particles.covariance[:2, :2])


def test_the_covariance_of_a_search_by_hand(target, couple):
    _, searching = measurers(*CUES_OF_DEFAULT)
    frame = Frame(couple.images[1])
    measured = measure(searching, target, frame, prediction_for(target))
    box = measured.box + [3.0, 0.0, 0.0, 0.0]
    seen = Assessment(box, 0.75, TrackStatus(), measured.particles, measured.boxes)
    size = np.sqrt(measured.search.center_box[2] * measured.search.center_box[3])
    anywhere = (WINDOW * size) ** 2 / 12.0
    within = covariance_about(measured.particles, box[:2] + box[2:] / 2)
    np.testing.assert_allclose(
        searching.covariance(target, measured, seen, 5.0),
        0.75 * within + 0.25 * anywhere * np.eye(2),
    )
    # The random walk of the preset's position noise, .6 box sizes in a second, for 4 s.
    hidden = replace(seen, status=TrackStatus("lost", 9.0))
    np.testing.assert_allclose(
        searching.covariance(target, measured, hidden, 4.0),
        (anywhere + (0.6 * 2.0 * size) ** 2) * np.eye(2),
    )


@pytest.mark.parametrize(("side", "reduction"), [(30, 1), (40, 1), (41, 2), (90, 3)])
def test_large_targets_are_looked_at_reduced_to_the_working_size(side, reduction, target):
    noise = np.random.default_rng(0).integers(0, 256, (240, 320, 3), dtype=np.uint8)
    box = np.array([100.0, 60.0, side, side])
    looked_at = []

    class Watched(Frame):
        def view(self, part, reduction=1):
            looked_at.append(reduction)
            return super().view(part, reduction)

    measurer = Measurer(fusion("color_histogram"), WORKING_SIZE)
    measurer.learn(Watched(noise), box)
    particles = ParticleSet.uniform([[100 + side / 2, 60 + side / 2, 0.0, 0.0, side, side]])
    estimate = replace(target.estimate, box=tuple(box.tolist()))
    templates, _ = measurer.learn(Frame(noise), box)
    measure(
        measurer,
        replace(target, templates=templates, estimate=estimate),
        Watched(noise),
        Prediction(particles, INTERVAL),
    )
    assert set(looked_at) == ({reduction} if reduction == 1 else {1, reduction})
