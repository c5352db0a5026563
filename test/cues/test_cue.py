"""The abstract methods of a cue."""

import pytest

from pf_tracker_ros.cues.cue import Cue


class Half(Cue):
    """A cue that only learns."""

    def learn(self, region, box):
        return None


def test_a_cue_without_a_required_method_cannot_be_constructed():
    with pytest.raises(TypeError, match=r"abstract .*log_likelihood"):
        Half()
