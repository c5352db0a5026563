"""Several targets: what is read and made of sequences, and figures by hand."""

import cv2
import numpy as np
import pytest
import targets
from target_trackers import TRACKERS

INFO = "[Sequence]\nname=drawn\nframeRate=10\nseqLength=12\nimWidth=160\nimHeight=120\n"


@pytest.fixture
def folders(tmp_path, moving_square):
    """A sequence of the MOT challenge with one target, found in every frame, and its images."""
    folder, images = tmp_path / "drawn", tmp_path / "images"
    folder.mkdir()
    images.mkdir()
    (folder / "seqinfo.ini").write_text(INFO)
    truth, found = [], []
    for number, box in enumerate(moving_square.boxes[:12], start=1):
        x, y, width, height = box
        truth.append(f"{number},7,{x + 1:g},{y + 1:g},{width:g},{height:g},1,0,0,0")
        found.append(f"{number},-1,{x + 1:g},{y + 1:g},{width:g},{height:g},0.9,-1,-1,-1")
        cv2.imwrite(str(images / f"{number:03d}.png"), moving_square.images[number - 1])
    (folder / "gt.txt").write_text("\n".join(truth))
    (folder / "det.txt").write_text("\n".join(found))
    return folder, images


def test_a_sequence_counts_pixels_from_zero(folders, moving_square):
    sequence = targets.read_sequence(*folders)
    assert sequence.interval == pytest.approx(0.1)
    assert len(sequence.truth) == len(sequence.detections) == 12
    np.testing.assert_allclose(sequence.truth[3].boxes, moving_square.boxes[3:4])
    np.testing.assert_allclose(sequence.detections[3][:, :4], moving_square.boxes[3:4])


def test_ours_follows_between_the_frames_that_the_detector_sees(folders):
    make = TRACKERS[targets.OURS]
    sequence = targets.read_sequence(*folders)
    done = targets.run(make(), sequence, every=12, first=0)
    for truth, told in zip(sequence.truth, done.tracks, strict=True):
        assert list(told.ids) == [1]
        assert targets.pairwise_iou(truth.boxes, told.boxes)[0, 0] > 0.6


def test_fewer_frames_than_the_ground_truth_are_refused(folders):
    make = TRACKERS[targets.OURS]
    folder, images = folders
    sequence = targets.read_sequence(folder, images)
    (images / "012.png").unlink()
    with pytest.raises(ValueError, match="has 11 frames; drawn needs 12"):
        targets.run(make(), sequence, every=12, first=0)


def test_the_boxes_go_along_with_a_camera_that_moves(folders, moving_square):
    sequence = targets.read_sequence(*folders).carried()
    assert "moving camera" in sequence.name
    assert np.ptp(sequence.camera.corners, axis=0).min() > 3.0
    in_view = 0
    for number, (truth, found) in enumerate(zip(sequence.truth, sequence.detections, strict=True)):
        image = sequence.camera.see(number, moving_square.images[number])
        assert image.shape == (90, 120, 3)
        np.testing.assert_allclose(found[:, :4], truth.boxes)
        y, x = np.nonzero(image[..., 2] > 170)
        for box in truth.boxes:
            if (box[:2] > 0).all() and (box[:2] + box[2:] < (120, 90)).all():
                assert box[:2] + box[2:] / 2 == pytest.approx(
                    (x.mean() + 0.5, y.mean() + 0.5), abs=1
                )
                in_view += 1
    assert in_view > 6


def test_perfect_boxes_score_all(folders):
    pytest.importorskip("trackeval")
    sequence = targets.read_sequence(*folders)
    figures = targets.score(sequence.truth, targets.Run(list(sequence.truth), 1.0))
    assert figures["HOTA"] == pytest.approx(100.0)
    assert figures["switches"] == figures["overlap %"] == 0.0


def test_boxes_that_overlap_are_counted():
    pytest.importorskip("trackeval")
    boxes = np.array([[10.0, 10.0, 20.0, 40.0], [14.0, 10.0, 20.0, 40.0], [90.0, 10.0, 20.0, 40.0]])
    tracks = targets.FrameTracks(np.arange(3), boxes)
    figures = targets.score([tracks], targets.Run([tracks], 1.0))
    assert figures["overlap %"] == pytest.approx(200 / 3)
    outcome = targets.Outcome(targets.OURS, "drawn", 5, figures)
    assert targets.table([outcome]).rows[0][:3] == [
        "**drawn**",
        "**5**",
        f"**{targets.OURS}**",
    ]
