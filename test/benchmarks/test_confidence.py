"""Confidence, covariance and honesty: figures by hand, and a small run of each benchmark."""

import math
import re
from itertools import product

import box_covariance
import cv2
import honesty
import numpy as np
import pytest
import uncertainty
from common import make_estimate
from honesty_footage import Clip, cut, ramp, relight, same_place, step
from honesty_situations import SITUATIONS

from pf_tracker_ros.footage import read_sequence

TRUE = [0.0, 0.0, 10.0, 10.0]


def frames_of(places, states=None, confidence=None):
    """Frames with boxes that are so many pixels to the right of the true ones."""
    count = len(places)
    given = zip(places, states or ["tracking"] * count, confidence or [1.0] * count, strict=True)
    estimates = [
        make_estimate((float(x), 0.0, 10.0, 10.0), state, sure) for x, state, sure in given
    ]
    return uncertainty.compared(estimates, np.tile(TRUE, (count, 1)))


def test_frames_are_compared_with_the_truth():
    frames = frames_of([0, 2, 6], ["tracking", "lost", "tracking"])
    np.testing.assert_allclose(frames.overlap, [1.0, 8 / 12, 4 / 16])
    assert frames.is_right.tolist() == [True, True, False]
    assert frames.is_tracking.tolist() == [True, False, True]


def test_figures_of_confidence_by_hand():
    generator = np.random.default_rng(0)
    confidence = generator.integers(0, 6, 40) / 5
    is_right = generator.random(40) < 0.3 + 0.4 * confidence
    frames = frames_of(np.where(is_right, 0, 9).tolist(), None, confidence.tolist())
    pairs = product(confidence[is_right], confidence[~is_right])
    expected = np.mean([(right > wrong) + 0.5 * (right == wrong) for right, wrong in pairs])
    figures = uncertainty.figures(frames)
    assert figures["area under the ROC curve of the confidence"] == pytest.approx(expected)
    two = uncertainty.figures(frames_of([0, 9], None, [0.9, 0.2]))
    assert two["expected calibration error"] == pytest.approx(0.15)


def test_groups_are_named_by_the_beginning_of_their_sequences():
    names = ["otb_car", "pets_t1", "otb_dog"]
    assert uncertainty.grouped(names, ["color=otb_", "pets_"]) == {"color": [0, 2], "pets_": [1]}
    for pattern, message in (("tud_", "matches no sequence"), ("(", "--group '\\('")):
        with pytest.raises(uncertainty.EvaluationError, match=message):
            uncertainty.grouped(names, [pattern])


def test_uncertainty_prints_its_tables_and_plots(moving_square_sequence, tmp_path, capsys):
    arguments = [str(moving_square_sequence), "--seeds", "2"]
    uncertainty.main([*arguments, "--output", str(tmp_path)])
    text = capsys.readouterr().out
    assert "Uncertainty: 1 sequence, 2 seeds" in text
    assert re.search(r"\nright frames that are called tracking +1\.000\n", text)
    assert cv2.imread(str(tmp_path / "uncertainty.png")).std() > 5


def drawn(coefficients, frames=40_000):
    """Errors of a known covariance."""
    generator = np.random.default_rng(1)
    features = np.column_stack([np.ones(frames), generator.normal(0.0, 0.5, (frames, 3))])
    size = np.array(
        [[1.0, box_covariance.SIZE_CORRELATION], [box_covariance.SIZE_CORRELATION, 1.0]]
    )
    errors = generator.standard_normal((frames, 4))
    errors[:, 2:] = errors[:, 2:] @ np.linalg.cholesky(size).T
    errors *= np.exp(features @ coefficients.T)
    return box_covariance.Errors(features, errors, errors[:, 1] + errors[:, 3] / 2)


def test_the_fit_finds_the_coefficients_that_the_errors_were_drawn_with():
    """With a variance 25 % larger, as on unseen footage."""
    coefficients = np.random.default_rng(2).uniform(-0.3, 0.3, (4, 4)) - np.eye(1, 4) * 2.5
    found = box_covariance.fit([drawn(coefficients)])
    unseen = np.eye(1, 4) * np.log(1.25) / 2
    np.testing.assert_allclose(found, coefficients + unseen, atol=0.03)


def test_true_coefficients_are_consistent_and_smaller_ones_are_not():
    coefficients = np.tile([-2.5, 0.1, -0.1, 0.2], (4, 1))
    errors = drawn(coefficients)
    for name, (squared, degrees) in box_covariance.squared_errors(errors, coefficients).items():
        assert squared.mean() / degrees == pytest.approx(1.0, abs=0.03), name
    half = coefficients - np.eye(1, 4) * np.log(2.0)
    squared, degrees = box_covariance.squared_errors(errors, half)["center"]
    assert squared.mean() / degrees == pytest.approx(4.0, abs=0.1)
    row = box_covariance.summary("title", [errors], [coefficients]).rows[0]
    assert [float(value) for value in row[2:]] == pytest.approx([0.5, 0.9, 0.99], abs=0.01)


def test_covariance_measures_tracked_boxes(moving_square_sequence):
    """Boxes of a square on a plain ground are within a fifth of its side."""
    measured = box_covariance.measure(read_sequence(moving_square_sequence), 1)
    assert len(measured.edges) > 10
    assert measured.features.shape == (len(measured.edges), 4)
    assert np.abs(measured.errors).max() < 0.2


def scene(seed):
    coarse = np.random.default_rng(seed).integers(20, 120, (6, 8, 3), np.uint8)
    return cv2.resize(coarse, (128, 96), interpolation=cv2.INTER_CUBIC)


def clip(seed=0, frames=6):
    images = tuple(np.roll(scene(seed), 2 * index, 1) for index in range(frames))
    return Clip(f"clip_{seed}", images, np.tile([40.0, 30.0, 20.0, 24.0], (frames, 1)), 0.1)


def test_the_light_changes_in_the_middle():
    assert [step(0.5)(time) for time in (-0.1, 0.0, 1.0)] == [1.0, 0.5, 0.5]
    assert [ramp(0.5, 2.0)(time) for time in (-1.0, 1.0, 3.0)] == [1.0, 0.75, 0.5]
    plain = clip()
    for index, image in enumerate(relight(plain, step(0.5))):
        expected = plain.images[index] if index < 3 else np.rint(plain.images[index] * 0.5)
        np.testing.assert_allclose(image, expected, atol=1)


def test_a_cut_goes_back_and_forth_in_the_size_of_the_first():
    begin, other = clip(), clip(1, 3)
    small = tuple(cv2.resize(one, (64, 48)) for one in other.images)
    images = list(cut(begin, Clip("", small, other.boxes, 0.1), 5))
    assert {image.shape for image in images} == {(96, 128, 3)}
    np.testing.assert_array_equal(images[6], images[10])
    assert same_place(begin, begin)
    assert not same_place(begin, other)


def test_a_clip_is_the_longest_part_with_the_target():
    class Sequence:
        name, nominal_interval = "", 0.1
        ground_truth = np.full((9, 4), 5.0)

        def frames(self):
            for index in range(9):
                yield type("Frame", (), {"image": np.full((4, 4, 3), index, np.uint8)})

    Sequence.ground_truth[[0, 3, 4]] = np.nan
    part = Clip.with_target(Sequence(), 6, 4)
    assert [int(image[0, 0, 0]) for image in part.images] == [5, 6, 7, 8, 7, 6]
    assert Clip.with_target(Sequence(), 6, 5) is None


@pytest.mark.parametrize("name", SITUATIONS)
def test_a_situation_leaves_the_frames_around_it_as_they_were(name):
    plain = clip(frames=60)
    shown = SITUATIONS[name](plain, 10, 50)
    for index in (*range(10), *range(-10, 0)):
        np.testing.assert_array_equal(shown.images[index], plain.images[index])
        np.testing.assert_array_equal(shown.boxes[index], plain.boxes[index])
    # The footage stands still while the lens is covered: at 0.1 s.
    stills = {"covered for 0.2 s": 2, "covered for 1 s": 10, "covered for 5 s": 50}
    stills["covered for 30 s"] = 300
    assert len(shown.images) == len(shown.boxes) == 60 + stills.get(name, 0)
    assert {image.shape for image in shown.images} == {(96, 128, 3)}
    # Gone from the first frame or the end of the transition on, or always in view. By 6.4 px a
    # frame, the center of the target, 50 px from the border, is outside in the eighth.
    first = {"erased by inpainting": 10, "a stranger covers it and stays": 30}
    first["view pans away"] = 17
    if name in stills:
        gone = range(10, 10 + stills[name])
    else:
        assert np.abs(shown.images[45] - plain.images[45].astype(int)).max() > 0
        gone = range(first[name], 50) if name in first else range(0)
    assert np.flatnonzero(np.isnan(shown.boxes[:, 0])).tolist() == list(gone)


def test_the_tables_of_honesty_by_hand():
    run = honesty.Run
    lights = [run(kind, name, 0, 0.5) for kind in [*honesty.LIGHTS][2:] for name in "ab"]
    lights += [run("as it is", "a", 0, 0.8), run("as it is", "b", 0, 0.6)]
    half = "half from one frame on"
    lights += [run(half, "a", 0, 0.7), run(half, "b", 0, 0.6)]
    cuts = [run("cut", "a to b", 0, 30), run("cut", "a to c", 0, 0)]
    situations = [
        run("noise", "a", 0, 11, math.inf, share=0.5),
        run("noise", "b", 0, 10, 2.0, share=0.1),
    ]
    light, scenes, made = honesty.tables_of([*lights, *cuts, *situations])
    assert light.rows[1] == [half, "a", "0.650", "-0.050", "-0.100"]
    assert scenes.rows == [["a to b 30", "2", "15.0%"]]
    assert made.rows == [["noise", "2", "30.0%", "1", "1"]]


def test_honesty_prints_its_tables(tmp_path, capsys):
    for name, seed in (("first", 0), ("second", 5)):
        folder = tmp_path / name
        (folder / "img").mkdir(parents=True)
        for index in range(12):
            cv2.imwrite(str(folder / "img" / f"{index:04}.png"), np.roll(scene(seed), index, 1))
        lines = [f"{40 + index},30,20,24\n" for index in range(12)]
        (folder / "groundtruth.txt").write_text("".join(lines))
    honesty.main([str(tmp_path), "--only", "light", "--only", "cut"])
    text = capsys.readouterr().out
    assert "Light that changes" in text
    assert "Cut to another scene" in text


def test_a_situation_is_judged(moving_square_sequence, monkeypatch):
    for name, count in {"BEFORE": 4, "DURING": 6, "AFTER": 5, "LEAST_FRAMES": 10}.items():
        monkeypatch.setattr(honesty, name, count)
    run = honesty.in_situation(0, moving_square_sequence, "erased by inpainting")
    assert (run.figure, run.share) == (0, 0.0)
    assert run.seconds >= 0.0
    honesty.read_with_target.cache_clear()


def test_a_single_sequence_is_not_enough(moving_square_sequence, capsys):
    with pytest.raises(SystemExit):
        honesty.main([str(moving_square_sequence), "--only", "cut"])
    assert "fewer than two sequences with colors" in capsys.readouterr().err
