"""The benchmark of confidence and covariance: its figures by hand, what it writes."""

import csv
import math
from dataclasses import replace
from itertools import product

import cv2
import numpy as np
import pytest
from scipy.linalg import block_diag

from pf_tracker_ros import Estimate


@pytest.fixture
def uncertainty(benchmark):
    return benchmark("uncertainty")


def estimate(x=0.0, state="tracking", confidence=1.0, covariance=((4.0, 0.0), (0.0, 1.0))):
    return Estimate(
        box=(x, 0.0, 10.0, 10.0),
        state=state,
        confidence=confidence,
        box_covariance=block_diag(covariance, np.eye(2)),
        particles=np.empty((1, 4)),
        particle_boxes=np.empty((1, 4)),
        weights=np.ones(1),
        effective_sample_size=1.0,
        cue_weights={},
    )


def test_the_roc_area_is_the_share_of_pairs_in_order(uncertainty):
    generator = np.random.default_rng(0)
    confidence = generator.integers(0, 6, 40) / 5
    is_right = generator.random(40) < 0.3 + 0.4 * confidence
    pairs = product(confidence[is_right], confidence[~is_right])
    expected = np.mean([(right > wrong) + 0.5 * (right == wrong) for right, wrong in pairs])
    assert uncertainty.roc_area(confidence, is_right) == pytest.approx(expected)
    assert math.isnan(uncertainty.roc_area(confidence, np.ones(40, bool)))


def test_frames_are_compared_with_the_truth_by_hand(uncertainty):
    """Off by 2 px: 2^2 / 4 along x and 2^2 / 1 along y; frames without a target are left out."""
    estimates = [estimate(), estimate(2.0, "lost", 0.3), estimate(), estimate(6.0)]
    true_boxes = np.array(
        [[0.0, 2.0, 10.0, 10.0], [0.0, 0.0, 10.0, 10.0], [math.nan] * 4, [0.0, 0.0, 10.0, 10.0]]
    )
    frames = uncertainty.compared(estimates, true_boxes, 0.04)
    np.testing.assert_allclose(frames.distance, [4.0, 1.0, 9.0])
    np.testing.assert_allclose(frames.overlap, [8 / 12, 8 / 12, 4 / 16])
    assert frames.is_right.tolist() == [True, True, False]
    assert frames.is_tracking.tolist() == [True, False, True]
    assert frames.confidence.tolist() == [1.0, 0.3, 1.0]


def test_an_ellipse_holds_the_share_of_a_gaussian_that_it_should(uncertainty):
    covariance = np.array([[0.9, 0.4], [0.4, 0.5]])
    centers = np.random.default_rng(0).multivariate_normal([0, 0], covariance, 4000)
    estimates = [estimate(covariance=covariance)] * 4000
    frames = uncertainty.compared(estimates, np.hstack([centers, np.full((4000, 2), 10.0)]), 0.04)
    for share in (0.5, 0.9, 0.99):
        assert uncertainty.inside(frames, share) == pytest.approx(share, abs=0.02)
    assert uncertainty.on_target(frames).mean() == pytest.approx(2.0, abs=0.1)


def test_the_covariance_is_judged_only_where_a_tracked_box_is_on_the_target(uncertainty):
    estimates = [estimate(1.0), estimate(9.5), estimate(2.0, "occluded")]
    frames = uncertainty.compared(estimates, np.tile([0.0, 0.0, 10.0, 10.0], (3, 1)), 0.04)
    assert uncertainty.on_target(frames) == pytest.approx([0.25])


def test_the_table_of_reliability_by_hand(uncertainty):
    estimates = [estimate(x, confidence=c) for x, c in ((0, 1.0), (0, 0.95), (9, 0.92), (9, 0.0))]
    frames = uncertainty.compared(estimates, np.tile([0.0, 0.0, 10.0, 10.0], (4, 1)), 0.04)
    rows = uncertainty.reliability(uncertainty.together([frames, frames])).groups[0]
    assert rows[0] == ["0.0 to 0.1", "2", "0.000"]
    assert rows[1] == ["0.1 to 0.2", "0", "-"]
    assert rows[9] == ["0.9 to 1.0", "6", "0.667"]


def test_frames_long_after_the_target_was_lost_are_counted_by_hand(uncertainty):
    """At 1 Hz: astray from the third frame on, found once, astray again for five frames."""
    places = [0, 0, 50, 50, 50, 50, 0, 50, 50, 50, 50, 50]
    states = ["tracking"] * 5 + ["lost"] + ["tracking"] * 5 + ["occluded"]
    estimates = [estimate(x, state) for x, state in zip(places, states, strict=True)]
    true_boxes = np.tile([0.0, 0.0, 10.0, 10.0], (12, 1))
    frames = uncertainty.compared(estimates, true_boxes, 1.0)
    assert frames.astray.tolist() == [0, 0, 1, 2, 3, 4, 0, 1, 2, 3, 4, 5]
    # The sixth, the eleventh and the twelfth frame; of these the eleventh is called tracking.
    row = uncertainty.summary(frames, "").groups[0][-1]
    assert row[0].startswith("frames more than 3 s after the target was lost")
    assert row[1] == "0.667"


def test_each_group_has_an_area_of_its_own(uncertainty):
    estimates = [estimate(confidence=0.9), estimate(9.0, confidence=0.2)]
    true_boxes = np.tile([0.0, 0.0, 10.0, 10.0], (2, 1))
    good, bad = (
        uncertainty.compared(each, true_boxes, 0.04) for each in (estimates, estimates[::-1])
    )
    bad = replace(bad, confidence=bad.confidence[::-1])
    by_group = uncertainty.group_table({"a": good, "b": bad}).groups[0]
    assert by_group[0] == ["area under the ROC curve of the confidence", "1.000", "0.000"]
    # Confidences of 0.9 and 0.2, right and wrong, or wrong and right.
    assert by_group[1] == ["expected calibration error", "0.150", "0.850"]


def test_the_command_writes_its_files(uncertainty, moving_square_sequence, tmp_path, capsys):
    arguments = [str(moving_square_sequence), "--preset", "li2007", "--seeds", "2"]
    assert uncertainty.main([*arguments, "--output", str(tmp_path / "new")]) == 0
    text = (tmp_path / "new" / "uncertainty.md").read_text()
    assert "# Uncertainty of preset li2007: 1 sequence, 2 seeds" in text
    assert "| right frames that are called tracking | 1.000 |" in text
    with (tmp_path / "new" / "uncertainty.csv").open() as file:
        rows = list(csv.DictReader(file))
    # 20 frames but the first, two seeds.
    assert sum(int(row["frames"]) for row in rows) == 2 * 19
    assert cv2.imread(str(tmp_path / "new" / "uncertainty.png")).std() > 5
    assert "area under the ROC curve" in capsys.readouterr().out


def test_an_unknown_preset_is_refused(uncertainty, moving_square_sequence, capsys):
    with pytest.raises(SystemExit):
        uncertainty.main([str(moving_square_sequence), "--preset", "nobody"])
    assert "no preset 'nobody'; there are: default" in capsys.readouterr().err


def test_groups_are_named_by_the_beginning_of_their_sequences(uncertainty):
    names = ["otb_car", "pets_t1", "otb_dog"]
    assert uncertainty.grouped(names, ["otb_", "pets_"]) == {"otb_": [0, 2], "pets_": [1]}
    for pattern, message in (("tud_", "matches no sequence"), ("(", "--group '\\('")):
        with pytest.raises(uncertainty.EvaluationError, match=message):
            uncertainty.grouped(names, [pattern])
