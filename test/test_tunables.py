"""Every tunable that counts with a preset makes a difference there."""

import cv2
import numpy as np
import pytest

from pf_tracker_ros import Detections, MultiTracker, Tracker
from pf_tracker_ros.parameters import ParameterError, declarations
from pf_tracker_ros.tracking.parameters import TrackerParameters
from pf_tracker_ros.tracking.presets import PRESETS, preset_parameters

KNOWN = declarations(TrackerParameters)
INTERVAL = 0.1
SEEDS = range(3)
DIM, HIDDEN, GONE = range(26, 30), range(18, 22), range(44, 66)
FIRST_BOX = (20, 30, 24, 24)
TOLD = ("box", "state", "confidence", "covariance", "particles")

# What makes no difference by itself, and what has to be chosen beside it.
BESIDE = {
    # Another one does not suit the other choices of the preset.
    ("li2007", "proposal.method"): {"motion.model": "affine"},
    # A single cue has all of the weight.
    ("zhang2015", "hog.weight"): {"cues": ("hog", "color_histogram")},
}

# What counts where a detector finds targets, and another value of it.
OF_DETECTIONS = {
    "max_targets": 1,
    "track.reidentify_within": 0.0,
    "detector.labels": ("square",),
    "detector.score_above": 0.8,
    "detector.recall": 0.1,
}


@pytest.fixture(scope="module")
def scene():
    """A square that grows and shrinks, in changing light, is hidden, lost, and back elsewhere."""
    generator = np.random.default_rng(3)
    coarse = generator.integers(40, 160, (12, 16, 3), dtype=np.uint8)
    ground = cv2.resize(coarse, (160, 120), interpolation=cv2.INTER_CUBIC)
    target = generator.integers(0, 255, (6, 6, 3), dtype=np.uint8)
    target[..., 2] = np.maximum(target[..., 2], 150)
    images = []
    for index in range(74):
        image = ground.copy()
        side = round(24 * 1.012 ** max(min(index - 8, 36 - index), 0))
        x, y = (20 + 2 * index, 30 + index) if index < GONE.stop else (2 * index - 102, 70)
        if index not in GONE:
            patch = cv2.resize(target, (side, side), interpolation=cv2.INTER_NEAREST)
            image[y : y + side, x : x + side] = patch
        if index in HIDDEN:
            image[:, 50:90] = 90
        if index in DIM:
            image = cv2.convertScaleAbs(image, alpha=0.93)
        noisy = image + generator.normal(0.0, 2.0, image.shape)
        images.append(np.clip(noisy, 0, 255).astype(np.uint8))
    return images


def follow(scene, preset, parameters, seed):
    """The estimates, one by one."""
    tracker = Tracker.from_preset(preset, seed, parameters)
    yield tracker.start(scene[0], FIRST_BOX)
    for image in scene[1:]:
        yield tracker.update(image, INTERVAL)


def differ(one, other):
    return not all(np.array_equal(getattr(one, name), getattr(other, name)) for name in TOLD)


@pytest.fixture(scope="module")
def makes_a_difference(scene, other_values):
    """Whether a parameter of a preset does, beside others that are set."""
    known = {}

    def usual(preset, beside, seed):
        key = (preset, str(beside), seed)
        if key not in known:
            known[key] = list(follow(scene, preset, beside, seed))
        return known[key]

    def makes(preset, declaration, beside):
        value = {**preset_parameters(preset), **beside}.get(declaration.name, declaration.default)
        for seed in SEEDS:
            for other in other_values(declaration, value):
                try:
                    found = follow(scene, preset, {**beside, declaration.name: other}, seed)
                    if any(map(differ, usual(preset, beside, seed), found)):
                        return True
                except ParameterError:
                    continue
        return False

    return makes


@pytest.mark.parametrize("preset", PRESETS)
def test_the_scene_has_it_all(scene, preset):
    states = [estimate.state for estimate in follow(scene, preset, {}, seed=0)]
    assert set(states[:18]) == set(states[35:44]) == {"tracking"}
    assert "occluded" in states[18:22]
    assert "lost" in states[44:]


@pytest.mark.parametrize(
    ("preset", "name"),
    [
        (preset, name)
        for preset in PRESETS
        for name, one in KNOWN.items()
        if one.is_active(preset_parameters(preset)) and name not in OF_DETECTIONS
    ],
)
def test_a_tunable_makes_a_difference(makes_a_difference, preset, name):
    assert makes_a_difference(preset, KNOWN[name], BESIDE.get((preset, name), {}))


def told_of_detections(scene, preset, parameters):
    """Ids and boxes frame by frame: the square, and what the detector does not find for a while."""
    pytest.importorskip("scipy")
    tracker = MultiTracker.from_preset(preset, 0, {"max_targets": 4, **parameters})
    told = []
    for index, image in enumerate(scene):
        x, y = (20 + 2 * index, 30 + index) if index < GONE.stop else (2 * index - 102, 70)
        found = [] if index in GONE else [((x, y, 24, 24), 0.95, "square")]
        if index not in range(15, 36):
            found.append(((20, 84, 24, 24), 0.6, "other"))
        seen = Detections(*zip(*found, strict=True)) if found else Detections([])
        answer = tracker.update(image, INTERVAL, seen if index % 3 == 0 else None)
        told.append([(target.id, target.estimate.box) for target in answer])
    return told


@pytest.mark.parametrize("preset", PRESETS)
def test_a_tunable_of_detections_makes_a_difference(scene, preset):
    usual = told_of_detections(scene, preset, {})
    for name, value in OF_DETECTIONS.items():
        assert told_of_detections(scene, preset, {name: value}) != usual, name


@pytest.mark.parametrize(("preset", "name"), BESIDE)
def test_what_needs_another_choice_makes_none_by_itself(makes_a_difference, preset, name):
    assert not makes_a_difference(preset, KNOWN[name], {})
