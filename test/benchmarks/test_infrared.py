"""The infrared experiment: its measures by hand, and what its command writes."""

import numpy as np
import pytest

from pf_tracker_ros.evaluation import SequenceResult


@pytest.fixture
def infrared(benchmark):
    return benchmark("infrared")


def test_covered_share_is_of_the_true_box(infrared):
    true = np.array([[10.0, 10.0, 20.0, 40.0]] * 4)
    boxes = np.array(
        [
            [10.0, 10.0, 20.0, 40.0],
            [0.0, 0.0, 100.0, 100.0],
            [20.0, 20.0, 20.0, 40.0],
            [50.0, 10.0, 20.0, 40.0],
        ]
    )
    np.testing.assert_allclose(infrared.covered_shares(boxes, true), [1.0, 1.0, 0.375, 0.0])


@pytest.mark.parametrize(
    ("shares", "frame"),
    [
        ([1.0, 0.5, 0.1], None),
        ([1.0, 0.0, 0.1], None),
        ([1.0, 0.5, 0.0], 3),
        ([1.0, 0.0, 0.0], 2),
        ([0.0, 0.0, 0.0], 1),
        ([1.0, np.nan, 0.0], 3),
        ([1.0, 0.5, np.nan], None),
    ],
)
def test_the_loss_is_the_first_frame_of_those_without_cover_at_the_end(infrared, shares, frame):
    assert infrared.frame_of_loss(np.array(shares)) == frame


def test_frames_without_a_target_take_no_part(infrared):
    true = np.array([[10.0, 10.0, 20.0, 40.0], [np.nan] * 4, [10.0, 10.0, 20.0, 40.0]])
    boxes = np.array([[true[0], true[0], [200.0, 10.0, 20.0, 40.0]]])
    result = SequenceResult(
        "walk", (0,), true, boxes, np.zeros((1, 3), bool), np.full((1, 2), 0.001)
    )
    row = infrared.row("tracker", result)
    assert (row.tracked, row.lost_runs, row.frame_of_loss) == (0.5, 1, 3)


def test_the_command_compares_on_scenes_and_on_sequences(
    infrared, moving_square_sequence, tmp_path, capsys, monkeypatch
):
    shorter = lambda seed, settings=None: scene(seed, {"frames": 10, **(settings or {})})  # noqa: E731
    scene = infrared.InfraredScene
    monkeypatch.setattr(infrared, "InfraredScene", shorter)
    output = tmp_path / "new" / "infrared.md"
    arguments = [moving_square_sequence, "--seeds", 1, "--scenes", 1, "--output", output]
    assert infrared.main(list(map(str, arguments))) == 0
    heading, _, *rows = output.read_text().splitlines()
    assert heading.strip("| ").split(" | ") == infrared.TITLES
    cells = [row.strip("| ").split(" | ") for row in rows]
    sequences = ["generated 0", "generated 0, polarity flips", "moving_square"]
    assert [row[:2] for row in cells] == [
        [sequence, tracker] for sequence in sequences for tracker in infrared.TRACKERS
    ]
    held = [row for row in cells if row[0] == "moving_square" and row[1] == "zhang2015"]
    assert held[0][2:5] == ["100%", "0 of 1", "-"]
    assert "zhang2015" in capsys.readouterr().out


def test_a_folder_without_sequences_is_refused(infrared, tmp_path):
    with pytest.raises(ValueError, match="no sequence in"):
        infrared.main([str(tmp_path), "--scenes", "0"])
