"""The likelihood map around the target."""

import numpy as np
import pytest

from pf_tracker_ros import Tracker
from pf_tracker_ros.tracking.likelihood_map import map_likelihood
from pf_tracker_ros.tracking.presets import PRESETS

BOX = (40.0, 30.0, 20.0, 20.0)


def peaked_at(*centers, height=0.0):
    """A cue whose log likelihood falls with the distance to the nearest center."""

    def of(boxes):
        middles = boxes[:, :2] + boxes[:, 2:] / 2
        return height - min_distance(middles, centers) / 10

    return of


def min_distance(places, centers):
    return np.min([np.linalg.norm(places - center, axis=1) for center in centers], axis=0)


def test_the_map_is_centered_on_the_box_and_has_the_peak_of_the_cue():
    cue = peaked_at((60.0, 35.0))
    found = map_likelihood(BOX, (200, 100), {"one": 1.0}, lambda boxes: {"one": cue(boxes)})
    x, y, side, _ = found.extent
    assert (x + side / 2, y + side / 2) == (50.0, 40.0)
    rows, columns = found.log_likelihood.shape
    row, column = np.unravel_index(np.argmax(found.log_likelihood), (rows, columns))
    peak = x + (column + 0.5) * side / columns, y + (row + 0.5) * side / rows
    assert peak == pytest.approx((60.0, 35.0), abs=side / columns)


def test_the_second_peak_is_the_likeliest_box_beside_the_target():
    near, far = peaked_at((50.0, 40.0)), peaked_at((50.0, 40.0), (75.0, 40.0), height=-0.5)
    found = map_likelihood(
        BOX, (200, 100), {"near": 0.2, "far": 0.8}, lambda b: {"near": near(b), "far": far(b)}
    )
    x, y, width, height = found.second_peak
    assert (x + width / 2, y + height / 2) == pytest.approx((75.0, 40.0), abs=2.0)
    assert found.cues["near"].at_target == pytest.approx(0.0, abs=1e-9)
    assert found.cues["near"].at_second_peak == pytest.approx(-2.5, abs=0.2)
    assert found.cues["far"].at_second_peak == pytest.approx(-0.5, abs=0.2)


def test_the_second_peak_of_a_box_that_fills_the_image_is_the_box():
    found = map_likelihood(
        (0.0, 0.0, 100.0, 100.0), (100, 100), {"one": 1.0}, lambda b: {"one": np.zeros(len(b))}
    )
    assert found.second_peak == (0.0, 0.0, 100.0, 100.0)


@pytest.mark.parametrize("preset", PRESETS)
def test_a_map_does_not_change_the_estimates(preset, couple):
    mapped, plain = (Tracker.from_preset(preset, seed=1) for _ in range(2))
    assert mapped.map_likelihood() is None
    for tracker in (mapped, plain):
        tracker.start(couple.images[0], couple.first[0])
    for image in couple.images[1:]:
        found = mapped.map_likelihood()
        assert found.log_likelihood.shape == (32, 32)
        assert np.isfinite(found.log_likelihood).all()
        assert found.log_likelihood.max() <= 1e-9
        assert found.cues.keys() == mapped.estimate.cue_weights.keys()
        assert mapped.update(image, 0.04) == plain.update(image, 0.04)


def test_a_visible_target_is_likelier_than_the_second_peak(couple):
    tracker = Tracker.from_preset("default", seed=1)
    tracker.start(couple.images[0], couple.second[0])
    for image in couple.images[1:8]:
        tracker.update(image, 0.04)
    for cue in tracker.map_likelihood().cues.values():
        assert cue.at_target > cue.at_second_peak


def test_a_target_at_the_edge_is_mapped_within_the_image(couple):
    tracker = Tracker.from_preset("default", seed=1)
    tracker.start(couple.images[0], (-10, -10, 24, 24))
    assert np.isfinite(tracker.map_likelihood().log_likelihood).all()
