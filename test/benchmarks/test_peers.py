"""Peers run as trackers do, those installed; the comparison's figures by hand; what it writes."""

import csv
import types

import cv2
import numpy as np
import pytest

from pf_tracker_ros.evaluation import EvaluationError, SequenceResult, overlap
from pf_tracker_ros.tracking.presets import PRESETS

NAMES = ("CSRT", "KCF", "MIL", "dlib correlation", "color particle filter")
RANDOM = ("MIL", "color particle filter")


@pytest.fixture
def command(benchmark):
    return benchmark("peers")


@pytest.fixture
def installed(benchmark):
    """Gives a peer by its name, or skips the test."""
    peers = {peer.name: peer for peer in benchmark("peer_trackers").PEERS}
    assert tuple(peers) == NAMES

    def peer(name):
        if what := peers[name].missing():
            pytest.skip(f"{name}: {what}")
        return peers[name]

    return peer


@pytest.fixture(scope="module")
def cloth():
    """Images and boxes of a square; within a pattern that repeats, MIL would jump about."""
    generator = np.random.default_rng(11)
    ground = cv2.resize(generator.integers(70, 130, (20, 30, 3), dtype=np.uint8), (240, 160))
    cells = np.where(generator.integers(0, 2, (6, 6, 1)), (30, 60, 220), (20, 190, 240))
    square = cv2.resize(cells.astype(np.uint8), (36, 36), interpolation=cv2.INTER_NEAREST)
    boxes = np.array([(20 + 3 * index, 40 + index, 36, 36) for index in range(20)], float)
    images = [ground.copy() for _ in boxes]
    for image, (x, y) in zip(images, boxes[:, :2].astype(int), strict=True):
        image[y : y + 36, x : x + 36] = square
    return images, boxes


def track(tracker, images, box):
    tracker.start(images[0], box)
    return [tracker.update(image) for image in images[1:]]


def boxes_of(answers):
    return np.array([answer.box for answer in answers])


@pytest.mark.parametrize("name", NAMES)
def test_follows_an_easy_target_to_the_end(installed, name, cloth):
    images, true_boxes = cloth
    answers = track(installed(name)(0), images, true_boxes[0])
    assert {answer.state for answer in answers} == {"tracking"}
    assert overlap(boxes_of(answers), true_boxes[1:])[-5:].min() > 0.5


@pytest.mark.parametrize("name", NAMES)
def test_follows_in_gray_images_of_16_bit(installed, name, cloth):
    images, true_boxes = cloth
    # The middle of the range, as the range is taken from the first image.
    gray = [cv2.cvtColor(image, cv2.COLOR_BGR2GRAY).astype(np.uint16) * 100 for image in images]
    answers = track(installed(name)(0), gray, true_boxes[0])
    assert overlap(boxes_of(answers), true_boxes[1:])[-1] > 0.4


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize(
    "box", [(-10.0, 90.0, 40.0, 50.0), (140.5, -12.25, 30.0, 30.5), (50.2, 50.9, 3.1, 2.2)]
)
def test_awkward_boxes_and_black_frames_end_no_run(installed, name, box, moving_square):
    images = [*moving_square.images[:6], *[np.zeros_like(moving_square.images[0])] * 4]
    answers = track(installed(name)(0), images, np.array(box))
    assert np.isfinite(boxes_of(answers)).all()
    assert {answer.state for answer in answers} <= {"tracking", "lost"}


@pytest.mark.parametrize("name", NAMES)
def test_the_seed_decides_all_also_beside_another_tracker(installed, name, moving_square):
    peer, images, first = installed(name), moving_square.images, moving_square.boxes[0]
    alone = boxes_of(track(peer(5), images, first))
    one, other = peer(5), peer(6)
    one.start(images[0], first)
    other.start(images[0], first)
    answers = []
    for image in images[1:]:
        other.update(image)
        answers.append(one.update(image))
    np.testing.assert_array_equal(alone, boxes_of(answers))
    assert peer.is_random == (name in RANDOM)


@pytest.mark.parametrize("name", RANDOM)
def test_another_seed_gives_other_boxes(installed, name, moving_square):
    peer, images, first = installed(name), moving_square.images, moving_square.boxes[0]
    assert (
        boxes_of(track(peer(0), images, first)) != boxes_of(track(peer(1), images, first))
    ).any()


@pytest.mark.parametrize("name", NAMES)
def test_images_unlike_the_first_are_refused(installed, name, moving_square):
    tracker = installed(name)(0)
    gray = moving_square.images[0][..., 0].copy()
    tracker.start(gray, moving_square.boxes[0])
    for other in (gray[:100], moving_square.images[0], gray.astype(np.uint16)):
        with pytest.raises(ValueError, match=r"allowed: as the first one, \(120, 160\) uint8"):
            tracker.update(other)
    assert tracker.update(gray).state == "tracking"


def test_a_rectangle_of_dlib_is_the_box_it_was_made_from(benchmark, installed):
    """Its rectangles hold their last pixel: a slip would show as a box one pixel too large."""
    installed("dlib correlation")
    rectangle = benchmark("peer_trackers").rectangle((20.5, 30.0, 24.0, 12.5))
    found = rectangle.left(), rectangle.top(), rectangle.width(), rectangle.height()
    assert found == (20.5, 30.0, 24.0, 12.5)


def test_kcf_goes_on_where_its_threshold_would_give_up(installed, moving_square):
    images = [moving_square.images[0], *[np.zeros_like(moving_square.images[0])] * 3]
    answers = track(installed("KCF")(0), images, moving_square.boxes[0])
    assert {answer.state for answer in answers} == {"tracking"}


@pytest.mark.parametrize("fails", [True, False])
def test_a_frame_without_a_box_keeps_the_last_one_and_is_lost(benchmark, moving_square, fails):
    def update(_image):
        if fails:
            raise cv2.error("outside")
        return False, (0, 0, 0, 0)

    class Blind(benchmark("peer_trackers").OpenCvTracker):
        name, factory = "blind", "nothing"

        def _create(self):
            return types.SimpleNamespace(init=lambda *_: None, update=update)

    assert Blind.missing().startswith("pip install opencv-contrib")
    (answer,) = track(Blind(0), moving_square.images[:2], (10.0, 20.0, 30.0, 40.0))
    assert (answer.box, answer.state) == ((10.0, 20.0, 30.0, 40.0), "lost")


def result(name, shifts, milliseconds, seeds=(0,)):
    """A result whose boxes of 10 x 10 px are off by a shift in x, after a true first frame."""
    true_boxes = np.tile([0.0, 0.0, 10.0, 10.0], (len(shifts) + 1, 1))
    boxes = np.tile(true_boxes, (len(seeds), 1, 1))
    boxes[:, 1:, 0] = shifts
    lost = np.zeros(boxes.shape[:2], bool)
    seconds = np.full((len(seeds), len(shifts)), milliseconds / 1e3)
    return SequenceResult(name, tuple(seeds), true_boxes, boxes, lost, seconds)


def test_ratio_is_of_the_mean_times_and_needs_csrt(command):
    outcome = command.Outcome
    csrt = outcome("CSRT", [result("a", [100], 10.0), result("b", [100], 30.0)])
    ours = outcome("default", [result("a", [0], 4.0), result("b", [100], 6.0)])
    assert command.ratios([csrt, ours]) == pytest.approx([1.0, 0.25])
    (rows,) = command.summary([ours, csrt], "").groups
    # Overlaps 1, 1 and 1, 0 against 1, 0 twice; an overlap of 1 is above 20 of 21 thresholds.
    assert rows[0] == [f"**{cell}**" for cell in ("default", "0.714", "-", "0.750", "5.00", "0.25")]
    assert rows[1] == ["CSRT", "0.476", "-", "0.500", "20.00", "1.00"]
    assert command.summary([ours], "").groups[0][0][-1] == "**-**"
    assert command.by_sequence([ours, csrt]).groups[0][0] == ["a", "**0.952**", "0.476"]


def test_the_command_writes_table_and_plot(command, moving_square_sequence, tmp_path, capsys):
    output = tmp_path / "new" / "results"
    arguments = [moving_square_sequence, "--output", output, "--seeds", 2]
    assert command.main(list(map(str, arguments))) == 0
    found, missing = command.contenders(None)
    trackers = {one.name: one for one in found}
    assert set(PRESETS) < set(trackers)
    assert set(trackers) | set(missing) == {*PRESETS, *NAMES, "NanoTrack"}
    assert not set(trackers) & set(missing)

    with (output / "peers.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert {row["tracker"] for row in rows} == set(trackers)
    aucs = [float(row["success_auc"]) for row in rows]
    assert aucs == sorted(aucs, reverse=True)
    times = {row["tracker"]: float(row["cpu_ms_median"]) for row in rows}
    for row in rows:
        assert row["sequence"] == "moving_square"
        assert row["seeds"] == ("2" if trackers[row["tracker"]].is_random else "1")
        if "CSRT" in missing:
            assert row["cpu_ratio_to_CSRT"] == ""
        else:
            ratio = times[row["tracker"]] / times["CSRT"]
            assert float(row["cpu_ratio_to_CSRT"]) == pytest.approx(ratio, abs=1e-3)
    table, shown = (output / "peers.md").read_text(), capsys.readouterr().out
    assert "1 sequence, 20 frames" in table
    for name, what in missing.items():
        sentence = f"{name} is left out: {what}."
        assert sentence in table
        assert sentence in shown
    assert all(f"| {name} |" in table or f"| **{name}** |" in table for name in trackers)
    assert all(name in shown for name in trackers)
    assert (output / "peers.png").read_bytes().startswith(b"\x89PNG")


def test_peers_that_are_not_installed_are_left_out(command, monkeypatch):
    names = [peer.name for peer in command.PEERS]
    for peer in command.PEERS:
        monkeypatch.setattr(peer, "missing", lambda: "install it")
    found, missing = command.contenders(None)
    assert [contender.name for contender in found] == list(PRESETS)
    assert missing.items() >= dict.fromkeys(names, "install it").items()


def test_an_error_names_the_tracker(command, moving_square_sequence, monkeypatch):
    class Refuses:
        def start(self, image, box):
            raise ValueError("not this one")

    refusing = command.Contender("someone", lambda seed: Refuses(), is_random=False)
    with pytest.raises(EvaluationError, match="someone: moving_square, frame 1: not this one"):
        command.compare(command.read_sequences([moving_square_sequence]), [refusing], seeds=1)


@pytest.fixture
def empty_head(tmp_path, monkeypatch):
    """A file `head.onnx` in the current folder that holds no network."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "head.onnx").write_bytes(b"no network")


@pytest.mark.usefixtures("empty_head")
@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["nowhere"], "no folder 'nowhere'"),
        (["--seeds", "0", "."], "'0'; allowed: a whole number of at least 1"),
        ([".", "--tracker", "nobody"], "no tracker 'nobody'; there are: default, li2007"),
        ([".", "--tracker", "NanoTrack"], "NanoTrack cannot run: name its model files"),
        ([".", "--nanotrack", "absent", "head.onnx"], "no file 'absent'; allowed: NanoTrack's"),
        ([".", "--nanotrack", "head.onnx", "head.onnx"], "OpenCV cannot track with 'head.onnx'"),
        ([], "the following arguments are required: SEQUENCE_DIR"),
    ],
)
def test_wrong_arguments_are_refused_with_what_is_allowed(command, arguments, message, capsys):
    with pytest.raises(SystemExit) as ended:
        command.main(arguments)
    assert ended.value.code == 2
    assert message in " ".join(capsys.readouterr().err.split())
