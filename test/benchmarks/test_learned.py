"""Overlaps over time of trackers, and their plots."""

from types import SimpleNamespace

import cv2
import numpy as np
import pytest

from pf_tracker_ros.evaluation import read_sequences


class Standing:
    """A tracker that repeats the first box."""

    def __init__(self, seed):
        assert seed == 0

    def start(self, image, box):
        self._answer = SimpleNamespace(box=box, state="tracking", confidence=1.0)
        return self._answer

    def update(self, image, dt):
        return self._answer


def test_overlaps_are_those_with_the_true_boxes(benchmark, write_sequence):
    boxes = [(20, 20, 20, 20), (30, 20, 20, 20), (np.nan,) * 4, (40, 20, 20, 20)]
    images = [np.zeros((80, 100, 3), np.uint8)] * len(boxes)
    (sequence,) = read_sequences([write_sequence("moved", images, np.array(boxes))])
    (values,) = benchmark("learned").overlaps(sequence, {"standing": Standing}).values()
    assert values == pytest.approx([1.0, 1 / 3, np.nan, 0.0], nan_ok=True)


@pytest.mark.parametrize("count", [1, 3])
def test_plots_are_drawn(benchmark, tmp_path, count):
    curves = {f"s{number}": {"one": np.linspace(0, 1, 5)} for number in range(count)}
    benchmark("learned").draw(tmp_path / "learned.png", curves)
    assert cv2.imread(str(tmp_path / "learned.png")).std() > 0


def test_a_missing_network_is_told_in_a_sentence(benchmark, tmp_path, capsys):
    assert benchmark("learned").main([str(tmp_path), "--model", str(tmp_path)]) == 1
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith("error: ")
    assert "model.yaml" in line
