"""Images of a few pixels are no error."""

import numpy as np
import pytest

from pf_tracker_ros import Tracker
from pf_tracker_ros.background import BackgroundModel
from pf_tracker_ros.tracking.presets import PRESETS

SIZES = [(1, 1), (1, 2), (2, 1), (2, 2), (2, 3), (3, 2), (1, 50), (50, 1), (5, 5)]
KINDS = {
    "color": lambda generator, size: generator.integers(0, 256, (*size, 3), dtype=np.uint8),
    "gray": lambda generator, size: generator.integers(0, 256, size, dtype=np.uint8),
    "16 bit": lambda generator, size: generator.integers(0, 65536, size, dtype=np.uint16),
}


def is_finite(estimate):
    numbers = [value for value in vars(estimate).values() if isinstance(value, np.ndarray)]
    assert len(numbers) == 4
    numbers += [estimate.box, estimate.confidence, estimate.effective_sample_size]
    return all(np.isfinite(value).all() for value in numbers)


@pytest.mark.parametrize("kind", sorted(KINDS))
@pytest.mark.parametrize("size", SIZES, ids=str)
@pytest.mark.parametrize("preset", sorted(PRESETS))
def test_an_image_of_few_pixels_is_tracked_in_like_any_other(preset, size, kind, recwarn):
    generator = np.random.default_rng(4)
    height, width = size
    for box in [(0, 0, width, height), (width - 0.5, height - 0.5, 1, 1)]:
        tracker = Tracker.from_preset(preset)
        estimates = [tracker.start(KINDS[kind](generator, size), box)]
        for dt in (None, 0.0, 0.04, 5.0, None):
            estimates.append(tracker.update(KINDS[kind](generator, size), dt))
        assert all(is_finite(estimate) for estimate in estimates)
    assert not recwarn.list


@pytest.mark.parametrize("kind", ["gray", "color"])
@pytest.mark.parametrize("reduction", [1, 16])
def test_every_background_model_takes_one_pixel(kind, reduction):
    generator = np.random.default_rng(4)
    model = BackgroundModel(
        KINDS[kind](generator, (1, 1)),
        np.random.default_rng(0),
        [(0.0, 0.0, 1.0, 1.0)],
        reduction=reduction,
    )
    for _ in range(20):
        mask = model.update(KINDS[kind](generator, (1, 1)), [(0.0, 0.0, 1.0, 1.0)])
        assert mask.shape == (1, 1)
