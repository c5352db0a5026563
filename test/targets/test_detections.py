import numpy as np
import pytest

from pf_tracker_ros import Detections
from pf_tracker_ros.appearances.color_stripes import ColorStripes
from pf_tracker_ros.frames import Frame
from pf_tracker_ros.targets.detections import describe_detections

SIZE = (320, 200)


def describe(detections, score_above=0.0):
    image = np.full((SIZE[1], SIZE[0], 3), 90, np.uint8)
    return describe_detections(detections, Frame(image), score_above, ColorStripes())


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (([[1, 2, 3]],), r"shape \(1, 3\)"),
        (([1, 2, 3, 4],), r"shape \(4,\)"),
        (([[1, 2, 3, 4], [1, 2]],), "no array of numbers"),
        ((["a"],), "expected numbers"),
        (([[1, 2, 3, 4]], [0.5, 0.6]), r"scores have the shape \(2,\)"),
        (([[1, 2, 3, 4]], None, ["a", "b"]), "2 labels; expected 1"),
        (([[1, 2, 3, 4]], None, "a"), "expected 1 text, one per box"),
        (([[1, 2, 3, 4]], None, [3]), "expected 1 text, one per box"),
        (([[1, 2, 3, 4]], None, 3), "labels are 3; expected 1 text, one per box"),
        (([[1, 2, 3, 4]], None, None, -0.1), "age is -0.1"),
        (([[1, 2, 3, 4]], None, None, float("nan")), "age is nan"),
        (([[1, 2, 3, 4]], None, None, 10**400), "age is 1000"),
        (([[1, 2, 3, 4]], None, None, "now"), "age is 'now'"),
    ],
)
def test_mismatched_arguments_are_refused_in_one_line(arguments, message):
    with pytest.raises(ValueError, match=message) as raised:
        Detections(*arguments)
    assert "\n" not in str(raised.value)


@pytest.mark.parametrize("nothing", [[], np.empty((0, 4)), np.empty(0)])
def test_detections_may_be_empty(nothing):
    assert len(Detections(nothing)) == 0
    assert describe(Detections(nothing)) == ([], [])


def test_arguments_are_copied_and_read_only():
    boxes = np.array([[10.0, 20.0, 30.0, 40.0]])
    detections = Detections(boxes)
    boxes[:] = 0
    assert detections.boxes[0, 0] == 10.0
    with pytest.raises(ValueError, match="read-only"):
        detections.boxes[0, 0] = 1.0


@pytest.mark.parametrize(
    ("box", "reason"),
    [
        ((np.nan, 1, 30, 40), "not finite"),
        ((1e308, 1, 1e308, 40), "not finite"),
        ((10, 10, 0, 40), "smaller than 2 px"),
        ((10, 10, -30, 40), "smaller than 2 px"),
        ((1000, 10, 30, 40), "outside of the image"),
        ((-100, 10, 30, 40), "outside of the image"),
    ],
)
def test_an_unusable_box_is_left_out_and_the_others_count(box, reason):
    described, reasons = describe(Detections([box, (100, 50, 30, 40)]))
    assert [tuple(one.box) for one in described] == [(100, 50, 30, 40)]
    assert len(reasons) == 1
    assert reason in reasons[0]
    assert reasons[0].startswith("1 of 2 detections")


def test_a_box_is_clipped_to_the_image():
    described, _ = describe(Detections([(-10, -20, 60, 100), (-50, -50, 400, 300)]))
    assert sorted(tuple(one.box) for one in described) == [(0, 0, 50, 80), (0, 0, 320, 200)]


def test_duplicates_count_once_with_the_best_score():
    boxes = [(100, 50, 30, 60), (101, 50, 30, 60), (100, 51, 30, 60), (120, 50, 30, 60)]
    described, reasons = describe(Detections(boxes, [0.5, 0.9, 0.6, 0.7], ["a", "b", "c", "d"]))
    assert [one.label for one in described] == ["b", "d"]
    assert reasons == []


def test_low_and_nan_scores_are_left_out_and_rounded_ones_clipped():
    boxes = [(20, 50, 30, 60), (80, 50, 30, 60), (140, 50, 30, 60)]
    described, reasons = describe(Detections(boxes, [0.2, np.nan, 1.000001]), score_above=0.3)
    assert [one.score for one in described] == [1.0]
    assert len(reasons) == 1


def test_scores_in_percent_or_below_0_are_left_out_with_the_reason():
    boxes = [(20, 50, 30, 60), (80, 50, 30, 60), (140, 50, 30, 60)]
    described, reasons = describe(Detections(boxes, [90.0, -0.5, 0.9]), score_above=0.3)
    assert [one.score for one in described] == [0.9]
    assert reasons == ["2 of 3 detections left out: a score is not 0 to 1"]


def test_of_ten_thousand_the_best_200_count():
    draw = np.random.default_rng(0)
    boxes = np.hstack([draw.uniform(0, 180, (10_000, 2)), np.full((10_000, 2), 12.0)])
    detections = Detections(boxes, draw.uniform(0, 0.9, 10_000))
    described, reasons = describe(detections)
    assert 0 < len(described) <= 200
    assert "10000" in reasons[0]
