"""The interface of a cue, and a property of all cues that read a region around many boxes."""

import cv2
import numpy as np
import pytest

from pf_tracker_ros.cues.color_histogram import ColorHistogram, ColorHistogramParameters
from pf_tracker_ros.cues.cue import Cue
from pf_tracker_ros.cues.gradient_orientation import (
    GradientOrientation,
    GradientOrientationParameters,
)
from pf_tracker_ros.cues.hog import Hog, HogParameters
from pf_tracker_ros.frames import Frame, Region


class LearningCue(Cue):
    """A cue that only learns."""

    def learn(self, region, box):
        return None


def test_a_cue_without_a_required_method_cannot_be_constructed():
    with pytest.raises(TypeError, match=r"abstract .*log_likelihood"):
        LearningCue()


@pytest.mark.parametrize(
    ("cue", "others"),
    [
        # A histogram samples boxes by their mean size, so the others have the same.
        (ColorHistogram(ColorHistogramParameters()), [(30.0, 20.0), (30.0, 20.0)]),
        (GradientOrientation(GradientOrientationParameters()), [(33.0, 21.0), (40.0, 30.0)]),
        (Hog(HogParameters(), smoothed=False), [(33.0, 21.0), (40.0, 30.0)]),
        (Hog(HogParameters(), smoothed=True), [(33.0, 21.0), (40.0, 30.0)]),
    ],
)
def test_a_box_has_the_same_likelihood_alone_and_among_boxes_far_away(cue, others):
    noise = np.random.default_rng(0).integers(0, 256, (15, 20, 3), dtype=np.uint8)
    frame = Frame(cv2.resize(noise, (160, 120), interpolation=cv2.INTER_CUBIC))
    box = np.array([[70.3, 40.2, 30.0, 20.0]])
    boxes = np.vstack([box, [(0.0, 0.0, *others[0]), (120.0, 90.0, *others[1])]])
    template = cue.learn(Region(frame, box), np.array([69.0, 40.0, 30.0, 20.0]))
    alone = cue.log_likelihood(Region(frame, box), box, template)
    among = cue.log_likelihood(Region(frame, boxes), boxes, template)
    assert alone[0] == pytest.approx(among[0], rel=2e-5)
