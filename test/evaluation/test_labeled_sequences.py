"""`evaluate --ground-truth`: true boxes from a file of labeled boxes."""

import json
import shutil

import numpy as np
import pytest

from pf_tracker_ros.evaluation import EvaluationError
from pf_tracker_ros.evaluation.__main__ import main
from pf_tracker_ros.evaluation.sequences import open_labeled_sequences
from pf_tracker_ros.footage import FootageError
from pf_tracker_ros.formats import FORMATS, BoxTrack, LabeledBox, RecordingInfo

QUICK = ("--preset", "li2007", "--parameter", "particles=20", "--seeds", "1")


@pytest.fixture
def images(moving_square_sequence, tmp_path):
    """The moving square as a folder of images."""
    return shutil.move(moving_square_sequence / "img", tmp_path / "walk")


@pytest.fixture
def labels(moving_square, tmp_path):
    """Two tracks: the square with an absence, and its second half."""
    boxes = {frame: LabeledBox(tuple(box)) for frame, box in enumerate(moving_square.boxes)}
    second = {frame: boxes[frame] for frame in range(10, 20)}
    path = tmp_path / "walk.xml"
    tracks = [BoxTrack(1, "", boxes | {4: LabeledBox(None)}), BoxTrack(5, "", second)]
    FORMATS["cvat"]["boxes.cvat.xml"](path, tracks, RecordingInfo("walk", 20, {0: (160, 120)}))
    return path


def test_each_track_is_a_sequence_from_its_first_box(images, labels, moving_square):
    (one, other), failures = open_labeled_sequences([images], labels)
    assert not failures
    assert [one.name, other.name] == ["walk, target 1", "walk, target 5"]
    assert np.isnan(one.ground_truth[4]).all()
    np.testing.assert_allclose(one.ground_truth[5:], moving_square.boxes[5:])
    assert other.frame_count == 10
    np.testing.assert_array_equal(
        [frame.image for frame in other.frames()], moving_square.images[10:]
    )


def test_the_command_gives_its_scores(images, labels, moving_square, write_sequence, tmp_path):
    truth = moving_square.boxes.copy()
    truth[4] = np.nan
    sequence = write_sequence("same", moving_square.images, truth)
    outputs = [tmp_path / "labeled.json", tmp_path / "sequence.json"]
    for output, arguments in zip(
        outputs, ([images, "--ground-truth", labels], [sequence]), strict=True
    ):
        assert main([*map(str, arguments), *QUICK, "--output", str(output)]) == 0
    labeled, plain = (json.loads(output.read_text())["sequences"] for output in outputs)
    assert labeled.keys() == {"walk, target 1", "walk, target 5"}
    assert labeled["walk, target 1"]["success_auc"] == plain["same"]["success_auc"]


def test_wrong_files_and_sources_are_refused(images, labels, tmp_path):
    path = tmp_path / "walk.txt"
    path.write_text("1,1,21,31,24,24\n2,1,25,33,24,24\n7,2,1,1,9,9\n")
    sequences, (failure,) = open_labeled_sequences([images], path)
    assert [sequence.name for sequence in sequences] == ["walk, target 1"]
    # A track of one frame is reported.
    assert failure.name == "walk, target 2"
    (tmp_path / "drive.mcap").write_bytes(b"\x89MCAP0\r\n")
    for text, sources, message in (
        ("9", [images], "begins with"),
        ("31,1,1,1,9,9\n", [images], "frame 30, .* walk has 20 frames: it belongs to"),
        ("", [images, images], "for one source, and 2 are given"),
        ("", [tmp_path / "none"], "there is no"),
        ("", [tmp_path / "drive.mcap"], "is a bag"),
    ):
        path.write_text(text)
        with pytest.raises((EvaluationError, FootageError), match=message):
            open_labeled_sequences(sources, path if text else labels)
