"""Searchable cues: responses on a grid equal those of its boxes to the bit."""

import numpy as np
import pytest
from common import grain

from pf_tracker_ros.boxes import BoxGrid
from pf_tracker_ros.cues.color_contrast import ColorContrast, ColorContrastParameters
from pf_tracker_ros.cues.correlation_response import (
    CorrelationResponse,
    CorrelationResponseParameters,
)
from pf_tracker_ros.frames import Frame, Region

BOX = np.array([60.0, 40.0, 30.0, 20.0])
CUES = {
    "contrast": ColorContrast(ColorContrastParameters()),
    "response": CorrelationResponse(CorrelationResponseParameters()),
    "response in one size": type("OneSize", (CorrelationResponse,), {"size_span": 1.0})(
        CorrelationResponseParameters()
    ),
}


@pytest.fixture(scope="module")
def image():
    return grain(0, 120, 160, scale=2.0)


@pytest.mark.parametrize("cue", CUES.values(), ids=CUES)
@pytest.mark.parametrize("reduction", [1, 2])
@pytest.mark.parametrize(
    ("corner", "size"),
    [((50.3, 31.7), (30.0, 20.0)), ((-9.6, -7.2), (30.0, 20.0)), ((110.1, 88.8), (33.3, 17.1))],
    ids=["inside", "across the corner", "in another size"],
)
def test_a_grid_reads_what_its_boxes_read(image, cue, reduction, corner, size):
    """More columns than rows, unevenly spaced, as for a grid clipped at the image's edge."""
    left = corner[0] + np.array([0.0, 2.3, 4.6, 6.9, 9.2, 9.2, 9.2])
    top = corner[1] + np.array([0.0, 0.0, 1.9, 3.8])
    grid = BoxGrid(left, top, np.array(size))
    center_box = np.array([*corner, *BOX[2:]])
    frame = Frame(image.astype(np.uint8))
    learned = Region(frame, BOX[None], reduction, cue.context_margin, center_box=BOX)
    template = cue.learn(learned, BOX)
    region = Region(frame, grid.boxes, reduction, cue.context_margin, center_box=center_box)
    responses = cue.response_on_grid(region, grid, template)
    assert responses.shape == (28,)
    assert len(np.unique(responses)) > 5
    np.testing.assert_array_equal(responses, cue.response(region, grid.boxes, template))


def test_the_boxes_of_a_grid_are_in_rows():
    grid = BoxGrid(np.array([1.0, 3.0]), np.array([10.0, 20.0, 30.0]), np.array([5.0, 6.0]))
    np.testing.assert_array_equal(
        grid.boxes,
        [
            [1, 10, 5, 6],
            [3, 10, 5, 6],
            [1, 20, 5, 6],
            [3, 20, 5, 6],
            [1, 30, 5, 6],
            [3, 30, 5, 6],
        ],
    )
