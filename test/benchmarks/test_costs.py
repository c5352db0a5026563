"""The benchmarks of costs: what they time, and what counts as answered."""

import frame_cost
import multi_target_cost
import pytest


@pytest.mark.parametrize("kind", ["color", "gray", "16 bit"])
def test_every_preset_keeps_the_target_that_is_timed(kind):
    setting = frame_cost.Setting((320, 240), 40, 60, kind)
    for preset in frame_cost.PRESETS:
        tracker = frame_cost.started(preset, setting)
        assert tracker.estimate.state == "tracking"
        assert tracker.estimate.box[:2] == pytest.approx(setting.box[:2], abs=8.0)


def test_the_slowest_updates_are_set_beside_the_median():
    ((median, slowest, ratio),) = frame_cost.tail_table(1).rows
    assert float(slowest) / float(median) == pytest.approx(float(ratio), rel=0.1)
    assert float(ratio) >= 1.0


def test_a_frame_without_an_answer_has_no_age():
    pytest.importorskip("rclpy", reason="needs ROS 2")
    import node

    figures = node.Figures(4, [0.02, 0.02, 0.05], 10.0, 5.0, 0.7, (10.0, 11.0))
    assert figures.cells() == ["4", "75.0", "20.0", "49.4", "10.00", "10 / 11", "0.70"]


def test_several_targets_are_timed_while_all_are_tracked(monkeypatch):
    """Else the benchmark ends with an error."""
    monkeypatch.setattr(multi_target_cost, "FRAMES", 15)
    times = multi_target_cost.times_of("8, a detector every 5th frame", "640x480")
    assert len(times) == 3
    assert min(times) > 0.0
