import numpy as np


def test_a_sequence_is_measured(benchmark, moving_square_sequence):
    result = benchmark("keyframes").measure(moving_square_sequence, 8, "default", 0)
    assert result.is_keyframe.nonzero()[0].tolist() == [0, 8, 16]
    np.testing.assert_array_equal(result.joined[result.is_keyframe], 1.0)
    np.testing.assert_array_equal(result.restarted[result.is_keyframe], 1.0)
    assert result.forward[0] == 1.0
    assert result.joined.mean() > 0.8


def test_the_recall_is_that_of_wrong_frames(benchmark):
    keyframes = benchmark("keyframes")
    joined = np.array([1.0, 0.4, 0.3, 0.9])
    is_listed = np.array([False, True, False, True])
    is_keyframe = np.array([True, False, False, False])
    row = keyframes.Result("a", is_keyframe, joined, joined, joined, is_listed).row
    assert row == ["a", "4", "1", "0.650", "0.650", "0.650", "2", "0.50", "0.50"]


def test_short_sequences_are_left_out(benchmark, moving_square_sequence, monkeypatch, capsys):
    monkeypatch.setattr("sys.argv", ["keyframes.py", str(moving_square_sequence)])
    assert benchmark("keyframes").main() == 2
    assert "no sequence with more than 60 frames" in capsys.readouterr().err
