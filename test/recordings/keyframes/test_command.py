"""`track --keyframes` on a drawn square whose true boxes are known."""

import csv
import json
import re
from dataclasses import dataclass
from pathlib import Path
from types import SimpleNamespace

import cv2
import numpy as np
import pytest
import yaml
from common import read_boxes

from pf_tracker_ros.evaluation.metrics import overlap
from pf_tracker_ros.formats import FORMATS, BoxTrack, LabeledBox, RecordingInfo, read_tracks
from pf_tracker_ros.frames import Frame
from pf_tracker_ros.recordings.errors import WRONG_TARGET
from pf_tracker_ros.recordings.keyframes.keyframes import KeyframeTrack, read_keyframes
from pf_tracker_ros.recordings.keyframes.tracking import track_between_keyframes
from pf_tracker_ros.recordings.recording import RecordedFrame, open_recording
from pf_tracker_ros.tracking.presets import preset_parameters

QUICK = ("--preset", "li2007")
LAST = 19


@dataclass
class Run:
    """What `track` has printed and written."""

    code: int
    output: str
    errors: str
    folder: Path

    @property
    def rows(self):
        return read_boxes(self.folder)

    @property
    def boxes(self):
        """(frames, 4) boxes of a single target, NaN without one."""
        names = ("x", "y", "width", "height")
        return np.array([[float(row[name] or "nan") for name in names] for row in self.rows])

    @property
    def frames_to_check(self):
        with (self.folder / "frames_to_check.csv").open(newline="") as file:
            return [int(row["frame"]) for row in csv.DictReader(file)]


@pytest.fixture
def recording(moving_square_sequence):
    """The moving square as a folder of images, without ground truth."""
    return moving_square_sequence / "img"


@pytest.fixture
def run(recording, track, tmp_path):
    """Runs `track` on the recording."""

    def start(*arguments):
        folder = tmp_path / "output"
        return Run(*track(recording, "--output", folder, *QUICK, *arguments), folder)

    return start


@pytest.fixture
def truth(moving_square):
    return moving_square.boxes


@pytest.fixture
def write_target_file(tmp_path):
    """Writes a target file, and returns its path."""

    def write(document):
        is_text = isinstance(document, str)
        path = tmp_path / ("given.txt" if is_text else "given.yaml")
        path.write_text(document if is_text else yaml.safe_dump(document))
        return path

    return write


def entries(keyframes):
    """Keyframes of a target file."""
    return [
        {"frame": frame, **({"absent": True} if box is None else {"box": box.tolist()})}
        for frame, box in keyframes.items()
    ]


def write_format(folder, kind, boxes):
    """Write boxes that a person has given in a format, and return the path."""
    info = RecordingInfo("img", 20, {0: (160, 120)})
    labeled = {frame: LabeledBox(tuple(box)) for frame, box in boxes.items()}
    for name, write in FORMATS[kind].items():
        write(folder / name, [BoxTrack(1, "square", labeled)], info)
    path = folder / next(iter(FORMATS[kind]))
    # Written tracks are absent between their boxes.
    if kind == "cvat":
        path.write_text(re.sub(r'<box frame="\d+" outside="1".*', "", path.read_text()))
    if kind == "coco":
        document = json.loads(path.read_text())
        document["images"] = [one for one in document["images"] if one["frame_id"] in boxes]
        path.write_text(json.dumps(document))
    return path


@pytest.mark.parametrize("kind", ["target", *FORMATS])
def test_keyframes_of_each_format_are_met(run, truth, write_target_file, tmp_path, kind):
    given = {frame: truth[frame] + (1.5, -0.5, 1.0, 0.0) for frame in (2, 9, LAST)}
    if kind == "target":
        file = write_target_file({"keyframes": entries(given), "label": "square"})
    else:
        file = write_format(tmp_path, kind, given)
    done = run("--keyframes", file)
    assert done.code == 0, done.errors
    boxes = done.boxes
    for frame, box in given.items():
        np.testing.assert_allclose(boxes[frame], box, atol=2e-3)
        assert float(done.rows[frame]["confidence"]) == 1.0
    assert [row["state"] for row in done.rows[:2]] == ["idle", "idle"]
    assert overlap(boxes[2:], truth[2:]).min() > 0.6
    assert "keyframes: 3, and 15 boxes in between" in done.output


def test_passes_on_different_objects_are_listed(run, truth, tmp_path):
    """The first keyframe is on the ground: only the backward pass is on the square."""
    boxes = {0: np.array((100.0, 5.0, 24.0, 24.0)), LAST: truth[LAST]}
    done = run("--keyframes", write_format(tmp_path, "mot", boxes))
    assert done.code == 0, done.errors
    assert overlap(done.boxes[12:], truth[12:]).min() > 0.6
    assert done.frames_to_check == [*range(1, LAST)]
    assert "frames to check: 18: 1-18 (" in done.output
    assert "clicks saved: 0," in done.output


def test_an_absence_lasts_to_the_next_keyframe(run, truth, write_target_file):
    given = entries({0: truth[0], 6: None, 12: truth[12]})
    done = run("--keyframes", write_target_file({"keyframes": given}), "--format", "cvat,target")
    assert done.code == 0, done.errors
    assert [row["state"] for row in done.rows[6:12]] == ["lost"] * 6
    assert np.isnan(done.boxes[6:12]).all()
    assert overlap(done.boxes[[5, 13, LAST]], truth[[5, 13, LAST]]).min() > 0.6
    (labeled,) = read_tracks(done.folder / "boxes.cvat.xml")
    present = {frame for frame, one in labeled.boxes.items() if one.box is not None}
    assert present == {*range(6), *range(12, 20)}
    document = yaml.safe_load((done.folder / "boxes.target.yaml").read_text())
    assert document["keyframes"] == given
    # The square was there all the time. A frame that a person has given needs no check.
    assert {*range(7, 12)} <= {*done.frames_to_check}
    assert 6 not in done.frames_to_check


def test_a_track_is_corrected_in_cvat_and_comes_back(recording, run, truth, track, tmp_path):
    exported = tmp_path / "first" / "boxes.cvat.xml"
    box = ",".join(map(str, truth[0]))
    arguments = (recording, "--box", box, "--output", exported.parent, *QUICK)
    assert track(*arguments, "--format", "cvat")[0] == 0
    # A person moves the last box.
    corrected = tmp_path / "corrected.xml"
    moved = '<box frame="19" outside="0" occluded="0" keyframe="1" xtl="97" ytl="68" xbr="121" '
    corrected.write_text(
        re.sub(r'<box frame="19" .*>', f'{moved} ybr="92"></box>', exported.read_text())
    )
    done = run("--keyframes", corrected)
    assert done.code == 0, done.errors
    np.testing.assert_allclose(done.boxes[LAST], (97, 68, 24, 24))
    keyframes = [f for f, one in read_tracks(corrected)[0].boxes.items() if one.is_keyframe]
    np.testing.assert_allclose(
        done.boxes[keyframes], read_tracks(corrected)[0].ground_truth(20)[keyframes]
    )


def test_shares_of_yolo_are_of_the_image_of_each_frame(recording, truth, tmp_path):
    for path in sorted(recording.iterdir())[12:]:
        image = cv2.imread(str(path))
        cv2.imwrite(str(path), cv2.resize(image, None, fx=2.0, fy=2.0))
    boxes = {3: tuple(truth[3]), 15: tuple(2.0 * truth[15])}
    info = RecordingInfo("img", 20, {0: (160, 120), 12: (320, 240)})
    track = BoxTrack(1, "square", {frame: LabeledBox(box) for frame, box in boxes.items()})
    FORMATS["yolo"]["boxes.yolo.zip"](tmp_path / "boxes.zip", [track], info)
    (found,) = read_keyframes(tmp_path / "boxes.zip", open_recording(recording))
    assert found.keyframes == {frame: pytest.approx(box) for frame, box in boxes.items()}


def test_several_targets(run, truth, write_target_file):
    document = {
        "targets": [
            {"label": "a", "keyframes": entries({0: truth[0], 10: truth[10]})},
            {"label": "b", "keyframes": entries({4: truth[4], 8: truth[8], LAST: truth[LAST]})},
            {"target_box": truth[3].tolist(), "frame": 3},
        ]
    }
    outputs = ("--bag", "--report", "--format", "mot")
    done = run("--keyframes", write_target_file(document), *outputs)
    assert done.code == 0, done.errors
    firsts = {}
    for row in done.rows:
        firsts.setdefault((row["id"], row["label"]), int(row["frame"]))
    assert firsts == {("1", "a"): 0, ("2", "b"): 4, ("3", ""): 3}
    assert len(done.rows) == 20 + 16 + 17
    tracks = read_tracks(done.folder / "boxes.mot.txt")
    assert [track.label for track in tracks] == ["a", "b", ""]
    assert "clicks saved" in (done.folder / "report.html").read_text()
    assert "3 targets" in done.output


def test_the_target_file_beside_the_recording(recording, run, truth, track, tmp_path):
    given = {"keyframes": entries({5: truth[5], 12: truth[12]})}
    recording.with_name("img.target.yaml").write_text(yaml.safe_dump(given))
    done = run("--keyframes")
    assert done.code == 0, done.errors
    np.testing.assert_array_equal(done.boxes[[5, 12]], truth[[5, 12]])
    # Without the option, the first keyframe is the target, as in the node.
    assert track(recording, "--output", tmp_path / "other", *QUICK)[0] == 0
    other = Run(0, "", "", tmp_path / "other")
    assert [row["state"] for row in other.rows[4:6]] == ["idle", "tracking"]
    assert not np.array_equal(other.boxes[12], truth[12])


def test_a_recording_that_breaks_off_keeps_the_frames_so_far(recording, run, truth, tmp_path):
    file = write_format(tmp_path, "mot", {0: truth[0], 4: truth[4], LAST: truth[LAST]})
    (recording / "0013.png").write_bytes(b"no picture")
    done = run("--keyframes", file)
    assert done.code == 3
    assert len(done.rows) == 12
    assert overlap(done.boxes, truth[:12]).min() > 0.6


@pytest.mark.parametrize("absent_at", [None, 5])
def test_frames_of_another_size_or_without_an_image_are_skipped(moving_square, truth, absent_at):
    frames = []
    for index, image in enumerate(moving_square.images):
        shown = image if index < 8 else image[:, :-2]
        decoded = None if index in (3, 5, 14) else Frame(shown, index * 40_000_000)
        problem = "" if decoded else "broken"
        frames.append(RecordedFrame(index, index * 40_000_000, 0, "", decoded, problem, None))
    keyframes = {0: tuple(truth[0]), 12: tuple(truth[12])} | (
        {absent_at: None} if absent_at else {}
    )
    track = KeyframeTrack(1, "", dict(sorted(keyframes.items())), "given")
    values = preset_parameters("li2007") | {"particles": 60}
    recording = SimpleNamespace(frames=lambda: (one for one in frames))
    found = [*track_between_keyframes(recording, [track], parameters=values)]
    assert [tracked.frame.index for tracked in found] == [*range(20)]
    skipped = {3, 14} if absent_at else {3, 5, 14, *range(8, 12)}
    assert {tracked.frame.index for tracked in found if tracked.state == "skipped"} >= skipped
    seen = {tracked.frame.index: tracked.box for tracked in found if tracked.box is not None}
    assert seen.keys() == {*range(5 if absent_at else 8), *range(12, 20)} - {3, 5, 14}
    assert overlap([*seen.values()], truth[[*seen]]).min() > 0.6


@pytest.mark.parametrize(
    ("document", "message"),
    [
        ("1,1,1,1,5,5\n31,1,1,1,5,5\n", "has 20 frames: it belongs to"),
        ("5,1,900,1,5,5\n", "keyframe of target 1 in frame 4, counted from 0: the center of"),
        ("nothing", "begins with 'nothing'"),
        ({"keyframes": 3}, "'keyframes' is 3; allowed: a list of"),
        ({"keyframes": []}, "at least one with a box"),
        ({"keyframes": [{"frame": 1, "absent": True}]}, "at least one with a box"),
        ({"keyframes": [{"frame": 1}]}, "the entry of keyframe 1"),
        ({"keyframes": [{"frame": -1, "box": [0, 0, 1, 1]}]}, "'frame' of keyframe 1"),
        ({"keyframes": [{"frame": 1, "absent": 0}]}, "'absent' of keyframe 1 is 0"),
        ({"keyframes": [{"frame": 1, "box": [0, 0, 0, 1]}]}, "'box' of keyframe 1"),
        ({"keyframes": [], "frame": 3}, "'keyframes' replaces frame"),
        (
            {"keyframes": [{"frame": 1, "box": [0, 0, 1, n]} for n in (1, 2)]},
            "'frame' of keyframe 2",
        ),
        ({"target_box": [0, 0, 9, 9], "stamp": 5}, "keyframes need 'frame'"),
    ],
)
def test_wrong_keyframes_are_refused(refusal, recording, write_target_file, document, message):
    given = (recording, *QUICK, "--keyframes", write_target_file(document))
    assert message in refusal(*given, expected=WRONG_TARGET)


@pytest.mark.parametrize(
    "arguments", [("--box", "1,1,9,9"), ("--detector", "motion"), ("--format", "avi")]
)
def test_contradicting_options_are_refused(refusal, recording, write_target_file, arguments):
    file = write_target_file({"target_box": [20, 30, 24, 24]})
    assert arguments[0] in refusal(recording, *QUICK, "--keyframes", file, *arguments)
