"""Boxes that read the same pixels are computed once."""

import tracemalloc

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pf_tracker_ros.cues import CUES
from pf_tracker_ros.cues.duplicates import DEDUPLICATE_FROM, unique_pairs
from pf_tracker_ros.frames import Frame, Region

# Many pairs of few distinct values.
PAIRS = st.lists(st.tuples(st.integers(-3, 4), st.integers(-1, 6)), min_size=40, max_size=200)


@given(PAIRS, st.integers(1, 1000))
def test_each_distinct_pair_occurs_once_and_represents_all_equal_ones(pairs, step):
    x, y = np.array(pairs, dtype=np.intp).T
    unique, positions = unique_pairs(step * x, y)
    assert len({pairs[number] for number in unique}) == len(unique) == len(set(pairs))
    assert [pairs[unique[number]] for number in positions] == pairs


@given(st.lists(st.tuples(st.integers(-5000, 5000), st.integers(-9, 6000)), min_size=1))
def test_widely_spread_pairs_are_represented_by_equal_ones(pairs):
    x, y = np.array(pairs, dtype=np.intp).T
    unique, positions = unique_pairs(x, y)
    assert [pairs[unique[number]] for number in positions] == pairs


def test_the_memory_for_widely_spread_pairs_is_limited():
    generator = np.random.default_rng(0)
    x, y = generator.integers(0, 20_000, (2, 1000))
    tracemalloc.start()
    unique_pairs(x, y)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < 2**20


@pytest.mark.parametrize("name", ["color_histogram", "gradient_orientation"])
@pytest.mark.parametrize("size", [(40.0, 40.0), (33.0, 21.4), (7.5, 52.0)])
def test_many_boxes_of_one_size_have_the_same_values_as_alone(name, size):
    """Up to rounding: the corners of a box's parts are rounded independently."""
    generator = np.random.default_rng(0)
    image = generator.integers(0, 256, (120, 160, 3), dtype=np.uint8)
    boxes = np.empty((4 * DEDUPLICATE_FROM, 4))
    boxes[:, :2] = generator.normal((60.0, 40.0), 4.0, (len(boxes), 2))
    boxes[:, 2:] = size
    cue = CUES[name](CUES.parameters_of(name)())
    region = Region(Frame(image), boxes)
    template = cue.learn(region, np.array([61.0, 38.0, *size]))
    together = cue.log_likelihood(region, boxes, template)
    assert len(np.unique(together)) > 50
    alone = [cue.log_likelihood(region, box[None], template)[0] for box in boxes]
    np.testing.assert_allclose(together, alone, rtol=1e-5, atol=1e-4)
