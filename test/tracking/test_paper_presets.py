"""The papers' presets give the boxes that they always gave, also through occlusions."""

import json
from pathlib import Path

import cv2
import numpy as np
import pytest

from pf_tracker_ros import Tracker
from pf_tracker_ros.evaluation.sequences import read_sequences

BOXES = json.loads((Path(__file__).parent / "paper_presets.json").read_text())
# Pixels.
TOLERANCE = 1e-3
# Measured with the kernels for AVX-512 and AVX2; those of older processors differ after occlusions.
is_alike = pytest.mark.skipif(
    "AVX2" not in cv2.getCPUFeaturesLine(), reason="this processor rounds otherwise"
)


@pytest.mark.slow
@is_alike
@pytest.mark.parametrize("name", BOXES)
def test_a_preset_of_a_paper_gives_the_same_boxes(name, sequences_directory):
    preset, sequence = name.split(" ")
    (footage,) = read_sequences([sequences_directory / sequence])
    frames = (frame.image for frame in footage.frames())
    tracker = Tracker.from_preset(preset, seed=3)
    tracker.start(next(frames), footage.ground_truth[0])
    expected = np.array(BOXES[name]["boxes"])
    every = BOXES[name]["every"]
    boxes = [
        tracker.update(image, 0.04).box
        for image, _ in zip(frames, range(len(expected) * every), strict=False)
    ]
    found = np.array(boxes)[every - 1 :: every]
    # Other processors round so that another particle is drawn somewhere.
    ways = [expected]
    for others in BOXES[name].get("rounded_otherwise", ()):
        ways.append(expected.copy())
        ways[-1][list(map(int, others))] = list(others.values())
    assert min(np.abs(found - way).max() for way in ways) <= TOLERANCE
