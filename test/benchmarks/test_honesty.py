"""The benchmark of honesty: the footage that it makes, its figures by hand, what it writes."""

import csv
import math

import cv2
import numpy as np
import pytest


@pytest.fixture
def footage(benchmark):
    return benchmark("honesty_footage")


@pytest.fixture
def honesty(benchmark):
    return benchmark("honesty")


def scene(seed, size=(96, 128)):
    coarse = np.random.default_rng(seed).integers(20, 120, (6, 8, 3), np.uint8)
    return cv2.resize(coarse, size[::-1], interpolation=cv2.INTER_CUBIC)


def clip(footage, seed=0, frames=6):
    images = tuple(np.roll(scene(seed), 2 * index, 1) for index in range(frames))
    boxes = np.tile([40.0, 30.0, 20.0, 24.0], (frames, 1))
    return footage.Clip(f"clip_{seed}", images, boxes, 0.1)


def test_lights_by_hand(footage):
    assert [footage.step(0.5)(time) for time in (-0.1, 0.0, 1.0)] == [1.0, 0.5, 0.5]
    assert [footage.ramp(0.5, 2.0)(time) for time in (-1.0, 1.0, 3.0)] == [1.0, 0.75, 0.5]
    pulses = [footage.flicker(0.3, 10.0)(time) for time in (-0.01, 0.0, 0.025, 0.075)]
    assert pulses == pytest.approx([1.0, 1.0, 1.3, 0.7])


def test_the_light_changes_in_the_middle(footage):
    plain = clip(footage)
    images = list(footage.relight(plain, footage.step(0.5)))
    for index, image in enumerate(images):
        expected = plain.images[index] if index < 3 else np.rint(plain.images[index] * 0.5)
        np.testing.assert_allclose(image, expected, atol=1)


def test_a_cut_goes_back_and_forth_in_the_size_of_the_first(footage):
    begin, other = clip(footage), clip(footage, 1, 3)
    other = footage.Clip(
        "", tuple(cv2.resize(one, (64, 48)) for one in other.images), other.boxes, 0.1
    )
    images = list(footage.cut(begin, other, 5))
    assert len(images) == 11
    assert {image.shape for image in images} == {(96, 128, 3)}
    np.testing.assert_array_equal(images[6], images[10])
    np.testing.assert_array_equal(images[7], images[9])


def test_a_target_leaves_and_comes_back_from_the_other_side(footage):
    gone = footage.departure(clip(footage), clip(footage, 1), (1.0, 2.0, 1.0), 0.1)
    is_there = np.isfinite(gone.boxes[:, 0])
    assert is_there.tolist() == [True] * 10 + [False] * 20 + [True] * 10
    speed = np.diff(gone.boxes[:10, 0])
    np.testing.assert_allclose(speed, speed[0])
    assert speed[0] > 0
    assert 90 < gone.boxes[9, 0] < 128
    assert gone.boxes[30, 0] < 0
    x, y, width, height = np.rint(gone.boxes[5]).astype(int)
    middle = np.s_[y + height // 4 : y + 3 * height // 4, x + width // 4 : x + 3 * width // 4]
    background = clip(footage, 1).images[5]
    assert np.abs(gone.images[5][middle].astype(int) - background[middle]).mean() > 5
    np.testing.assert_array_equal(gone.images[15], clip(footage, 1).images[5])


def test_a_target_vanishes_beside_its_like_which_stays(footage):
    over = clip(footage, 1)
    gone = footage.beside_its_like(clip(footage), over, (1.0, 2.0, 1.0), 0.1)
    is_there = np.isfinite(gone.boxes[:, 0])
    assert is_there.tolist() == [True] * 10 + [False] * 20 + [True] * 10
    assert (np.diff(gone.boxes[:10, 0]) > 0).all()
    np.testing.assert_array_equal(gone.boxes[30:], gone.boxes[30:31].repeat(10, axis=0))
    x, y, width, height = np.rint(gone.boxes[30]).astype(int)
    places = {"target": x, "other": x + round(1.5 * width)}
    for index, expected in ((15, {"other"}), (35, {"target", "other"})):
        plain = over.images[(0, 1, 2, 3, 4, 5, 4, 3, 2, 1)[index % 10]]
        changed = np.abs(gone.images[index].astype(int) - plain).max(axis=2) > 5
        seen = {
            name
            for name, left in places.items()
            if changed[y + height // 4 : y + 3 * height // 4, left + width // 4 :][
                :, : width // 2
            ].mean()
            > 0.5
        }
        assert seen == expected


def test_clips_of_different_places_are_distinguished(footage):
    assert footage.same_place(clip(footage), clip(footage))
    assert not footage.same_place(clip(footage), clip(footage, 1))


def test_the_tables_by_hand(honesty):
    run = honesty.Run
    lights = [
        run("as it is", "a", 0, 0.8),
        run("as it is", "b", 0, 0.6),
        run("half from one frame on", "a", 0, 0.7),
        run("half from one frame on", "b", 0, 0.6),
    ]
    kinds = [kind for kind in honesty.LIGHTS if kind not in {one.kind for one in lights}]
    lights += [run(kind, name, 0, 0.5) for kind in kinds for name in "ab"]
    rows = honesty.light_table(lights).groups[0]
    assert rows[1] == ["half from one frame on", "a", "0.650", "-0.050", "-0.100"]
    cuts = [run("cut", "a to b", 0, 30), run("cut", "a to c", 0, 0), run("cut", "a to a", 0, 90)]
    cuts[2] = run("cut", "a to a", 0, 90, is_apart=True)
    assert honesty.cut_table(cuts).groups[0] == [
        ["other places", "a to b 30", "2", "15.0%"],
        ["the same place at another time", "a to a 90", "1", "90.0%"],
    ]
    kind, other = honesty.DEPARTURES
    gone = [run(kind, "a", 0, 11, 0.5), run(kind, "b", 0, 10, 2.5), run(kind, "c", 0, 0, math.inf)]
    gone.append(run(other, "a", 0, 0, 2.0))
    assert honesty.away_table(gone).groups[0] == [[kind, "3", "1", "1"], [other, "1", "0", "1"]]


@pytest.fixture
def situations(benchmark):
    return benchmark("honesty_situations").SITUATIONS


def test_every_situation_leaves_the_frames_around_it_as_they_were(footage, situations):
    plain = clip(footage, frames=60)
    for name, situation in situations.items():
        # The images roll by 2 px in each: not a still camera.
        shown = situation(plain, 10, 50)
        if name.startswith("fades"):
            assert shown is None
            continue
        for index in (*range(10), *range(-10, 0)):
            np.testing.assert_array_equal(shown.images[index], plain.images[index], err_msg=name)
            np.testing.assert_array_equal(shown.boxes[index], plain.boxes[index])
        assert len(shown.images) == len(shown.boxes)
        assert {image.shape for image in shown.images} == {(96, 128, 3)}
        assert np.abs(shown.images[45] - plain.images[45].astype(int)).max() > 0, name


def test_where_the_target_is_in_a_situation(footage, situations):
    """Gone from the first frame or the end of the transition on, in view, or turned and scaled."""
    plain = clip(footage, frames=60)
    first_gone = {
        "black image": 10,
        "erased by inpainting": 10,
        "a stranger covers it and stays": 30,
        # By 6.4 px a frame; its center, 50 px from the border, is outside in the eighth.
        "view pans away": 17,
    }
    for name, first in first_gone.items():
        gone = np.flatnonzero(np.isnan(situations[name](plain, 10, 50).boxes[:, 0]))
        assert gone.tolist() == list(range(first, 50)), name
    for name in ("one frozen image", "a copy of its first look passes", "noise"):
        assert np.isfinite(situations[name](plain, 10, 50).boxes).all()
    shrunk = situations["shrinking to 8 px"](plain, 10, 50).boxes[49]
    assert np.sqrt(shrunk[2] * shrunk[3]) == pytest.approx(8.0)
    np.testing.assert_allclose(shrunk[:2] + shrunk[2:] / 2, [50.0, 42.0])
    # The footage stands still while the lens is covered: 5 s at 0.1 s.
    assert len(situations["covered for 5 s, level 12"](plain, 10, 50).images) == 60 + 50


def test_a_clip_is_the_longest_part_with_the_target(footage):
    class Sequence:
        name, nominal_interval = "", 0.1
        ground_truth = np.full((9, 4), 5.0)

        def frames(self):
            for index in range(9):
                yield type("Frame", (), {"image": np.full((4, 4, 3), index, np.uint8)})

    Sequence.ground_truth[[0, 3, 4]] = np.nan
    part = footage.Clip.with_target(Sequence(), 6, 4)
    assert [int(image[0, 0, 0]) for image in part.images] == [5, 6, 7, 8, 7, 6]
    assert footage.Clip.with_target(Sequence(), 6, 5) is None
    Sequence.ground_truth[:] = np.nan
    assert footage.Clip.with_target(Sequence(), 6, 1) is None


def test_the_table_of_situations_by_hand(honesty):
    run = honesty.Run
    runs = [
        run("black image", "a", 0, 0, 0.5, share=0.0),
        run("noise", "a", 0, 11, math.inf, share=0.5),
        run("noise", "b", 0, 10, 2.0, share=0.1),
    ]
    assert [table.groups[0] for table in honesty.tables_of(runs)] == [
        [["black image", "1", "0.0%", "0", "1"], ["noise", "2", "30.0%", "1", "1"]]
    ]


def test_the_command_writes_its_files(honesty, tmp_path, capsys):
    for name, seed in (("first", 0), ("second", 5)):
        folder = tmp_path / name
        (folder / "img").mkdir(parents=True)
        for index in range(12):
            cv2.imwrite(str(folder / "img" / f"{index:04}.png"), np.roll(scene(seed), index, 1))
        lines = [f"{40 + index},30,20,24\n" for index in range(12)]
        (folder / "groundtruth.txt").write_text("".join(lines))
    arguments = [str(tmp_path), "--preset", "li2007", "--processes", "2"]
    arguments += [text for part in honesty.PARTS for text in ("--only", part)]
    assert honesty.main([*arguments, "--output", str(tmp_path / "new")]) == 0
    text = (tmp_path / "new" / "honesty.md").read_text()
    assert "# Honesty of preset li2007" in text
    assert "## GainOverTime that changes" in text
    with (tmp_path / "new" / "honesty.csv").open() as file:
        kinds = [row["kind"] for row in csv.DictReader(file)]
    # Two sequences in each light; one is the scene and background of the other.
    assert len(kinds) == 2 * len(honesty.LIGHTS) + 1 + len(honesty.DEPARTURES)
    assert "Cut to another scene" in capsys.readouterr().out


def test_only_some_situations(honesty, moving_square_sequence, tmp_path, monkeypatch, capsys):
    for name, count in {"BEFORE": 4, "DURING": 6, "AFTER": 5, "LEAST_FRAMES": 10}.items():
        monkeypatch.setattr(honesty, name, count)
    run = honesty.in_situation("default", 0, moving_square_sequence, "black image")
    assert (run.figure, run.share) == (0, 0.0)
    assert run.seconds >= 0.0
    monkeypatch.setattr(honesty, "LEAST_FRAMES", 60)
    honesty.read_with_target.cache_clear()
    assert honesty.in_situation("default", 0, moving_square_sequence, "black image") is None
    with pytest.raises(SystemExit):
        honesty.main([str(moving_square_sequence), "--only", "nothing"])
    assert "invalid choice: 'nothing'" in capsys.readouterr().err


def test_a_single_sequence_is_not_enough(honesty, moving_square_sequence, capsys):
    with pytest.raises(SystemExit):
        honesty.main([str(moving_square_sequence)])
    assert "fewer than two sequences with colors" in capsys.readouterr().err
