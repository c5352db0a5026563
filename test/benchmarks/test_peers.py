"""Peers run as trackers do, those installed; the comparison's figures by hand; what it writes."""

import cv2
import numpy as np
import peer_trackers
import peers
import pytest

from pf_tracker_ros.evaluation import EvaluationError, SequenceResult, overlap
from pf_tracker_ros.tracking.presets import PRESETS

NAMES = ("CSRT", "KCF", "dlib correlation", "color particle filter")
INSTALLED = [peer for peer in peer_trackers.PEERS if not peer.missing()]


def track(tracker, images, box):
    tracker.start(images[0], box)
    return [tracker.update(image) for image in images[1:]]


@pytest.mark.parametrize("peer", INSTALLED)
def test_a_peer_follows_an_easy_target_in_color_and_in_16_bit(peer, cloth):
    images, true_boxes = cloth
    # The middle of the range, as the range is taken from the first image.
    gray = [cv2.cvtColor(image, cv2.COLOR_BGR2GRAY).astype(np.uint16) * 100 for image in images]
    for shown, least in ((images, 0.5), (gray, 0.4)):
        answers = track(peer(0), shown, true_boxes[0])
        assert {answer.state for answer in answers} == {"tracking"}
        assert overlap(answers[-1].box, true_boxes[-1]) > least
    tracker = peer(0)
    tracker.start(gray[0], true_boxes[0])
    with pytest.raises(ValueError, match=r"allowed: as the first one, \(160, 240\) uint16"):
        tracker.update(images[0])


@pytest.mark.parametrize("peer", INSTALLED)
@pytest.mark.parametrize("box", [(-10.0, 90.0, 40.0, 50.0), (50.2, 50.9, 3.1, 2.2)])
def test_awkward_boxes_and_black_frames_end_no_run(peer, box, cloth):
    images = [*cloth[0][:4], *[np.zeros_like(cloth[0][0])] * 3]
    answers = track(peer(0), images, box)
    assert np.isfinite([answer.box for answer in answers]).all()
    assert {answer.state for answer in answers} <= {"tracking", "lost"}


def test_a_frame_without_a_box_keeps_the_last_one_and_is_lost(cloth):
    class Blind(peer_trackers.PeerTracker):
        name = "blind"

        def _learn(self, image, box):
            pass

        def _find(self, image, box):
            return None

    (answer,) = track(Blind(0), cloth[0][:2], (10.0, 20.0, 30.0, 40.0))
    assert (answer.box, answer.state) == ((10.0, 20.0, 30.0, 40.0), "lost")


def result(name, shifts, milliseconds):
    """A result whose boxes of 10 x 10 px are off by a shift in x, after a true first frame."""
    true_boxes = np.tile([0.0, 0.0, 10.0, 10.0], (len(shifts) + 1, 1))
    boxes = true_boxes[None].copy()
    boxes[:, 1:, 0] = shifts
    seconds = np.full((1, len(shifts)), milliseconds / 1e3)
    return SequenceResult(name, (0,), true_boxes, boxes, np.zeros(boxes.shape[:2], bool), seconds)


def test_ratio_is_of_the_mean_times_and_needs_csrt():
    csrt = [result("a", [100], 10.0), result("b", [100], 30.0)]
    ours = [result("a", [0], 4.0), result("b", [100], 6.0)]
    rows = peers.summary({"default": ours, "CSRT": csrt}, "").rows
    # Overlaps 1, 1 and 1, 0 against 1, 0 twice; an overlap of 1 is above 20 of 21 thresholds.
    assert rows[0] == [f"**{cell}**" for cell in ("default", "0.714", "0.750", "0.25")]
    assert rows[1] == ["CSRT", "0.476", "0.500", "1.00"]
    assert peers.summary({"default": ours}, "").rows[0][-1] == "**-**"


def test_the_command_prints_the_table_and_writes_the_plot(moving_square_sequence, tmp_path, capsys):
    peers.main([str(moving_square_sequence), "--seeds", "1", "--output", str(tmp_path)])
    found, missing = peers.contenders()
    assert set(found) | set(missing) == {*PRESETS, *NAMES}
    told = capsys.readouterr().out
    assert "Presets and peers, 1 seed\n" in told
    assert all(f"{name} is left out: {what}." in told for name, what in missing.items())
    first = [line.split("  ")[0].strip("*") for line in told.splitlines()]
    assert set(found) <= set(first)
    assert (tmp_path / "peers.png").read_bytes().startswith(b"\x89PNG")


def test_an_error_names_the_tracker(moving_square_sequence):
    class Refuses:
        def start(self, image, box):
            raise ValueError("not this one")

    refusing = {"someone": lambda seed: Refuses()}
    with pytest.raises(EvaluationError, match="someone: moving_square, frame 1: not this one"):
        peers.compare(peers.read_sequences([moving_square_sequence]), refusing, seeds=1)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["nowhere"], "no folder 'nowhere'"),
        (["--seeds", "0", "."], "'0'; allowed: a whole number of at least 1"),
    ],
)
def test_wrong_arguments_are_refused_with_what_is_allowed(arguments, message, capsys):
    with pytest.raises(SystemExit):
        peers.main(arguments)
    assert message in " ".join(capsys.readouterr().err.split())
