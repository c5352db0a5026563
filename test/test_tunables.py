"""Every tunable that is active in a preset makes a difference there."""

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
DIM, OCCLUDED, ABSENT = range(26, 30), range(18, 22), range(44, 66)
FIRST_BOX = (20, 30, 24, 24)
COMPARED = ("box", "state", "confidence", "covariance", "particles")

# Tunables without an effect of their own, and the settings that they need.
NEEDS = {
    # Other proposals do not fit the preset's motion model.
    ("li2007", "proposal.method"): {"motion.model": "affine"},
    # A single cue has all of the weight.
    ("zhang2015", "hog.weight"): {"cues": ("hog", "color_histogram")},
}

# Tunables that need detections, with a value other than the default.
OF_DETECTIONS = {
    "max_targets": 1,
    "track.reidentify_within": 0.0,
    "detector.labels": ("square",),
    "detector.score_above": 0.8,
    "detector.recall": 0.1,
}


@pytest.fixture(scope="module")
def scene():
    """A square grows and shrinks in changing light, is occluded, lost, and returns elsewhere."""
    generator = np.random.default_rng(3)
    coarse = generator.integers(40, 160, (12, 16, 3), dtype=np.uint8)
    ground = cv2.resize(coarse, (160, 120), interpolation=cv2.INTER_CUBIC)
    target = generator.integers(0, 255, (6, 6, 3), dtype=np.uint8)
    target[..., 2] = np.maximum(target[..., 2], 150)
    images = []
    for index in range(74):
        image = ground.copy()
        side = round(24 * 1.012 ** max(min(index - 8, 36 - index), 0))
        x, y = (20 + 2 * index, 30 + index) if index < ABSENT.stop else (2 * index - 102, 70)
        if index not in ABSENT:
            patch = cv2.resize(target, (side, side), interpolation=cv2.INTER_NEAREST)
            image[y : y + side, x : x + side] = patch
        if index in OCCLUDED:
            image[:, 50:90] = 90
        if index in DIM:
            image = cv2.convertScaleAbs(image, alpha=0.93)
        noisy = image + generator.normal(0.0, 2.0, image.shape)
        images.append(np.clip(noisy, 0, 255).astype(np.uint8))
    return images


def estimates_of(scene, preset, parameters, seed):
    """Yield the estimates."""
    tracker = Tracker.from_preset(preset, seed, parameters)
    yield tracker.start(scene[0], FIRST_BOX)
    for image in scene[1:]:
        yield tracker.update(image, INTERVAL)


def differ(one, other):
    return not all(np.array_equal(getattr(one, name), getattr(other, name)) for name in COMPARED)


@pytest.fixture(scope="module")
def makes_a_difference(scene, other_values):
    """Function: whether a parameter of a preset makes a difference, given other settings."""
    known = {}

    def default_run(preset, settings, seed):
        key = (preset, str(settings), seed)
        if key not in known:
            known[key] = list(estimates_of(scene, preset, settings, seed))
        return known[key]

    def makes(preset, declaration, settings):
        value = {**preset_parameters(preset), **settings}.get(declaration.name, declaration.default)
        for seed in SEEDS:
            for other in other_values(declaration, value):
                try:
                    found = estimates_of(scene, preset, {**settings, declaration.name: other}, seed)
                    if any(map(differ, default_run(preset, settings, seed), found)):
                        return True
                except ParameterError:
                    continue
        return False

    return makes


@pytest.mark.parametrize("preset", PRESETS)
def test_the_scene_covers_all_states(scene, preset):
    states = [estimate.state for estimate in estimates_of(scene, preset, {}, seed=0)]
    assert set(states[:18]) == set(states[35:44]) == {"tracking"}
    assert "occluded" in states[18:22]
    assert "lost" in states[44:]


@pytest.mark.parametrize(
    ("preset", "name"),
    [
        (preset, name)
        for preset in PRESETS
        for name, one in KNOWN.items()
        # Another appearance needs the file of a network: networks/test_embedding.py; a selected
        # target a session: targets/test_held_targets.py.
        if one.is_active(preset_parameters(preset))
        and name not in {*OF_DETECTIONS, "appearance.kind", "track.keep_selected"}
    ],
)
def test_a_tunable_makes_a_difference(makes_a_difference, preset, name):
    assert makes_a_difference(preset, KNOWN[name], NEEDS.get((preset, name), {}))


def tracks_with_detections(scene, preset, parameters):
    """Ids and boxes of each frame: the square, and another object with a gap in its detections."""
    pytest.importorskip("scipy")
    tracker = MultiTracker.from_preset(preset, 0, {"max_targets": 4, **parameters})
    tracks = []
    for index, image in enumerate(scene):
        x, y = (20 + 2 * index, 30 + index) if index < ABSENT.stop else (2 * index - 102, 70)
        found = [] if index in ABSENT else [((x, y, 24, 24), 0.95, "square")]
        if index not in range(15, 36):
            found.append(((20, 84, 24, 24), 0.6, "other"))
        seen = Detections(*zip(*found, strict=True)) if found else Detections([])
        targets = tracker.update(image, INTERVAL, seen if index % 3 == 0 else None)
        tracks.append([(target.id, target.estimate.box) for target in targets])
    return tracks


@pytest.mark.parametrize("preset", PRESETS)
def test_a_tunable_of_detections_makes_a_difference(scene, preset):
    default = tracks_with_detections(scene, preset, {})
    for name, value in OF_DETECTIONS.items():
        assert tracks_with_detections(scene, preset, {name: value}) != default, name


@pytest.mark.parametrize(("preset", "name"), NEEDS)
def test_a_tunable_that_needs_another_makes_none_by_itself(makes_a_difference, preset, name):
    assert not makes_a_difference(preset, KNOWN[name], {})
