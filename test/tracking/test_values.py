"""Estimates are immutable values, and a tracker can be copied while it tracks."""

import copy
import dataclasses
import json
import multiprocessing
import pickle

import numpy as np
import pytest

from pf_tracker_ros import Estimate, Tracker
from pf_tracker_ros.tracking.presets import PRESETS

every_preset = pytest.mark.parametrize("preset", sorted(PRESETS))
ARRAYS = ("box_covariance", "particles", "particle_boxes", "weights")


def pickled(value):
    return pickle.loads(pickle.dumps(value))


every_way = pytest.mark.parametrize("copied", [copy.copy, copy.deepcopy, pickled])


def followed(tracker, images):
    return [tracker.update(image) for image in images]


@pytest.fixture
def tracker(moving_square):
    tracker = Tracker.from_preset("zhang_bo", seed=3)
    tracker.start(moving_square.images[0], moving_square.boxes[0])
    followed(tracker, moving_square.images[1:4])
    return tracker


@every_way
def test_a_copied_estimate_is_equal_and_as_read_only(tracker, copied):
    estimate = copied(tracker.estimate)
    assert (estimate == tracker.estimate) is True
    assert (estimate != tracker.estimate) is False
    for name in ARRAYS:
        with pytest.raises(ValueError, match="read-only"):
            getattr(estimate, name)[0] = 0.0
    with pytest.raises(TypeError):
        estimate.cue_weights["color_histogram"] = 1.0
    assert estimate.cue_weights == dict(tracker.estimate.cue_weights)
    with pytest.raises(dataclasses.FrozenInstanceError):
        estimate.confidence = 1.0


def other_values(estimate):
    """Each field with a value that differs from the estimate's in one respect."""
    for name in ARRAYS:
        array = getattr(estimate, name)
        nudged = array.copy()
        nudged.flat[-1] = np.nextafter(nudged.flat[-1], np.inf)
        others = (nudged, array[:-1], array.astype(np.float32), array.tolist(), None)
        yield from ((name, value) for value in others)
    x, y, width, height = estimate.box
    yield "box", (x, y, width, np.nextafter(height, 0.0))
    yield "state", "lost"
    yield "confidence", estimate.confidence / 2
    yield "effective_sample_size", estimate.effective_sample_size / 2
    yield "cue_weights", {name: weight / 2 for name, weight in estimate.cue_weights.items()}
    yield "background", None
    yield "reacquired_for", 1.5


def test_estimates_that_differ_in_any_field_are_not_equal(tracker):
    differing = list(other_values(tracker.estimate))
    assert {name for name, _ in differing} == {f.name for f in dataclasses.fields(Estimate)}
    for name, value in differing:
        other = dataclasses.replace(tracker.estimate, **{name: value})
        assert (other == tracker.estimate) is False, name
    assert tracker.estimate != tracker.estimate.box


def test_an_estimate_has_no_hash(tracker):
    with pytest.raises(TypeError, match="unhashable"):
        hash(tracker.estimate)


def test_an_estimate_becomes_a_dictionary(tracker):
    fields = dataclasses.asdict(tracker.estimate)
    assert Estimate(**fields | {"background": tracker.estimate.background}) == tracker.estimate
    assert fields["background"] == {"name": "learning", "reason": ""}
    json.dumps({name: fields[name] for name in fields.keys() - set(ARRAYS) - {"cue_weights"}})
    json.dumps(dict(fields["cue_weights"]))


def test_an_estimate_copies_its_arguments(tracker):
    weights, cue_weights = tracker.estimate.weights.copy(), {"color_histogram": 1.0}
    estimate = dataclasses.replace(tracker.estimate, weights=weights, cue_weights=cue_weights)
    weights[0], cue_weights["color_histogram"] = 7.0, 7.0
    assert estimate.weights[0] == tracker.estimate.weights[0]
    assert estimate.cue_weights == {"color_histogram": 1.0}


@every_way
@every_preset
def test_a_copied_tracker_gives_the_same_bits_independently(preset, copied, moving_square):
    images = moving_square.images
    tracker = Tracker.from_preset(preset, seed=3)
    tracker.start(images[0], moving_square.boxes[0])
    followed(tracker, images[1:8])
    twin, astray, again = (copied(tracker) for _ in range(3))
    # A copy must not affect the others.
    followed(astray, [np.zeros_like(images[0])] * 4)
    expected = followed(twin, images[8:16])
    assert followed(tracker, images[8:16]) == expected
    assert followed(again, images[8:16]) == expected
    assert tracker.start(images[0], moving_square.boxes[0]) == again.start(
        images[0], moving_square.boxes[0]
    )
    assert tracker != again


@every_way
def test_a_tracker_without_a_target_can_be_copied(copied, moving_square):
    tracker = Tracker.from_preset("li2007", seed=8, parameters={"particles": 30})
    twin = copied(tracker)
    assert not twin.started
    assert twin.parameters == tracker.parameters
    started = [
        one.start(moving_square.images[0], moving_square.boxes[0]) for one in (tracker, twin)
    ]
    assert started[0] == started[1]


def test_a_tracker_goes_on_in_another_process(tracker, moving_square):
    context = multiprocessing.get_context("spawn")
    image = moving_square.images[4]
    with context.Pool(1) as pool:
        elsewhere = pool.apply(Tracker.update, (tracker, image))
    assert elsewhere == tracker.update(image)


@every_preset
def test_the_error_handling_of_numpy_in_the_caller_changes_nothing(preset, moving_square):
    def run():
        tracker = Tracker.from_preset(preset, seed=3)
        first = tracker.start(moving_square.images[0], moving_square.boxes[0])
        tracker.set_parameters({"particles": tracker.parameters["particles"] + 20})
        # The last ones without the target.
        empty = [np.zeros_like(moving_square.images[0])] * 4
        return [first, *followed(tracker, [*moving_square.images[1:8], *empty])]

    expected = run()
    with np.errstate(all="raise"):
        assert run() == expected
        assert set(np.geterr().values()) == {"raise"}


def test_an_estimate_is_printed_in_a_few_lines(moving_square):
    tracker = Tracker.from_preset("default")
    text = repr(tracker.start(moving_square.images[0], moving_square.boxes[0]))
    assert "state='tracking'" in text
    assert len(text) < 1000
