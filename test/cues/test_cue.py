"""What a cue must have."""

import pytest

from pf_tracker_ros.cues.cue import Cue


class Half(Cue):
    """Learns, and compares nothing."""

    def learn(self, region, box):
        return None


def test_a_cue_that_lacks_a_method_cannot_be_made():
    with pytest.raises(TypeError, match=r"abstract .*log_likelihood"):
        Half()
