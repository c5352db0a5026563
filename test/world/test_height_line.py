"""The line of box heights over lower edges, and the plane that it is a case of."""

import numpy as np
import pytest

from pf_tracker_ros.world import GroundPlane, fit_ground_plane
from pf_tracker_ros.world.height_line import HeightLine


def test_before_a_level_camera_it_is_the_ground(camera, box_of):
    """Slope and horizon by the geometry, and by the plane that is learned from the same people."""
    places = [(distance, 0.02 * distance - 0.2) for distance in np.linspace(4.0, 20.0, 60)]
    boxes = np.array([box_of(camera, GroundPlane.from_angles(1.4), *place)[0] for place in places])
    line = HeightLine.fit(boxes[:, 1] + boxes[:, 3], boxes[:, 3])
    assert line.slope == pytest.approx(1.75 / 1.4, rel=1e-4)
    # Edges count half a pixel more than the calibration.
    horizon = line.lower_edge - line.height / line.slope
    assert horizon == pytest.approx(camera.cy + 0.5, abs=0.02)
    learned = fit_ground_plane(camera, boxes).plane
    assert 1.75 / line.slope == pytest.approx(learned.height, rel=1e-3)
    assert learned.pitch == pytest.approx(0.0, abs=1e-3)
