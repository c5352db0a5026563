"""The benchmarks of costs: what they time, and what counts as answered."""

import frame_cost
import multi_target_cost
import numpy as np
import pytest


def test_the_loop_over_particles_finds_the_target():
    image = frame_cost.street(320, 240)
    box = (100, 80, 40, 40)
    corners = np.array([(100 + x, 80 + y) for x in range(-9, 10, 3) for y in range(-9, 10, 3)])
    weights = frame_cost.ParticleLoop(image, box).weights(image, corners)
    assert weights.sum() == pytest.approx(1.0)
    assert tuple(corners[weights.argmax()]) == (100, 80)


@pytest.mark.parametrize("kind", ["color", "gray", "16 bit"])
def test_every_preset_keeps_the_target_that_is_timed(kind):
    setting = frame_cost.Setting((320, 240), 40, 60, kind)
    for preset in frame_cost.PRESETS:
        tracker = frame_cost.started(preset, setting)
        assert tracker.estimate.state == "tracking"
        assert tracker.estimate.box[:2] == pytest.approx(setting.box[:2], abs=8.0)


def test_the_tables_are_saved(tmp_path):
    path = tmp_path / "new" / "cost.md"
    assert frame_cost.main(["--only", "loop", "--turns", "1", "--output", str(path)]) == 0
    assert path.read_text().startswith("**li2007")
    assert "| 1000 |" in path.read_text()


def test_a_frame_without_an_answer_has_no_age():
    pytest.importorskip("rclpy", reason="needs ROS 2")
    import node

    figures = node.Figures(4, [0.02, 0.02, 0.05], 0.04, 0.02, [0.9, 0.7], (10.0, 11.0))
    assert figures.cells() == ["4", "75.0", "20.0", "49.4", "10.00", "10 / 11", "0.70"]


def test_several_targets_are_timed_while_all_are_tracked(monkeypatch):
    """Else the benchmark ends with an error."""
    monkeypatch.setattr(multi_target_cost, "FRAMES", 15)
    times = multi_target_cost.times_of("8, a detector every 5th frame", "640x480")
    assert len(times) == 3
    assert min(times) > 0.0
