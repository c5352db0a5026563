"""Several targets in one recording with the command `track`, given or detected."""

import cv2
import numpy as np
import pytest
from common import QUICK, one_sentence, read_boxes

from pf_tracker_ros import Detections
from pf_tracker_ros.recordings.errors import WRONG_DETECTIONS, WRONG_TARGET
from pf_tracker_ros.targets.built_in_detectors import DETECTORS

COUNT = 16
NAMES = ("x", "y", "width", "height")


def test_several_boxes_have_a_row_each_to_the_bits_of_the_library(tracked, source, library):
    boxes = library.boxes[0]
    given = [f"--box={','.join(map(str, box))}" for box in boxes]
    code, errors, found = tracked(source, "--seed", 5, *given)
    assert (code, errors) == (0, "")
    found = library.target_rows(found)
    assert found == library.track(boxes, seed=5)
    assert [row[2] for row in found] == [1, 2] * COUNT
    assert len({row[3] for row in found}) > COUNT


def test_the_targets_of_a_file_begin_on_their_own_frames(track, source, library, tmp_path):
    boxes = library.boxes
    file = source.with_name("img.target.yaml")
    file.write_text(
        "recording: img\nimage_size: [240, 160]\ntargets:\n"
        f"  - {{target_box: {list(boxes[6][1])}, frame: 6, label: blue}}\n"
        f"  - {{target_box: {list(boxes[2][0])}, stamp: {library.at(2)}, label: red}}\n"
    )
    output = tmp_path / "out"
    few = ("--parameter", "max_targets=2", "--report", "--bag")
    code, said, _ = track(source, "--output", output, *QUICK, *few)
    assert code == 0
    assert "(best state in each frame: " in said
    assert "), 2 targets, " in said
    found = read_boxes(output)
    idle = [("0", "", "idle"), ("1", "", "idle")]
    assert [(row["frame"], row["id"], row["state"]) for row in found[:2]] == idle
    assert found[0]["x"] == found[0]["confidence"] == ""
    assert next(row["frame"] for row in found if row["id"] == "2") == "6"
    first = next(row for row in found if row["id"] == "1")
    assert (first["frame"], [float(first[n]) for n in NAMES]) == ("2", list(boxes[2][0]))
    assert {(row["id"], row["label"]) for row in found} == {("", ""), ("1", "red"), ("2", "blue")}
    page = (output / "report.html").read_text()
    assert page.count('<section class="sequence"') == 2
    assert "target 1 red" in page
    assert "target 2 blue" in page
    assert f"Frames 2 to {COUNT - 1}:" in page
    assert f"Frames 6 to {COUNT - 1}:" in page
    assert '<span class="mark unreported"></span> not reported: ' in page


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("targets: []", "'targets' is []; allowed: a list with a mapping for each target"),
        ("targets: [1]", "the entry of target 1 is 1; allowed: a mapping"),
        ("targets: [{target_box: [1, 2, 30]}]", "'target_box' of target 1 is [1, 2, 30]"),
        ("targets: [{target_box: [1, 2, 30, 40]}, {age: 3}]", "unknown key age of target 2"),
        ("targets: []\ntarget_box: [1, 2, 30, 40]", "unknown key target_box; allowed: image_s"),
        ("recording: other\ntargets: [{target_box: [1, 2, 30, 40]}]", "is for 'other', not for"),
        ("targets: [{target_box: [1, 2, 9, 9]}, {target_box: [900, 2, 9, 9]}]", "is outside"),
        (
            "targets: [{target_box: [1, 2, 9, 9]}, {target_box: [1, 2, 9, 9], frame: 900}]",
            "is for the frame with number 900, which this recording does not have",
        ),
    ],
)
def test_an_invalid_file_of_several_targets(track, source, tmp_path, text, said):
    source.with_name("img.target.yaml").write_text(text)
    code, _, errors = track(source, "--output", tmp_path / "out", *QUICK)
    assert (code, said in one_sentence(errors)) == (WRONG_TARGET, True)


@pytest.mark.parametrize("label", ["", ",-1,-1,-1", ",walker"])
def test_detections_of_a_file_correct_targets(tracked, source, library, write_detections, label):
    file = write_detections((3, 7, 11), label=label)
    # No detections in frame 14.
    file.write_text(file.read_text() + "15\n")
    code, errors, found = tracked(source, "--detections", file)
    assert (code, errors) == (0, "")
    arrivals = {number: [(library.detections(number), number)] for number in (3, 7, 11)}
    if "walker" not in label:
        arrivals = {
            n: [(Detections(each.boxes, each.scores), n)] for n, [(each, _)] in arrivals.items()
        }
    arrivals[14] = [(Detections([]), 14)]
    assert library.target_rows(found) == library.track((), arrivals)
    assert [(row["frame"], row["id"], row["state"]) for row in found[:3]] == [
        (str(number), "", "idle") for number in range(3)
    ]
    assert {row["id"] for row in found[3:]} >= {"1", "2"}


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("", "is empty; allowed: lines frame,id,x,y,width,height,score"),
        ("frame,id,x,y,w,h,score", "line 1: the frame is 'frame'; allowed: lines frame,id,x,y"),
        ("1,-1,2,3,4,5,0.9\n1 -1 2 3 4 5 0.9", "line 2: the frame is '1 -1 2 3 4 5 0.9'"),
        ("1,-1,2,3,4,5", "line 1: it has 6 columns"),
        ("0,-1,2,3,4,5,0.9", "the frame is 0; allowed: whole numbers from 1"),
        ("1.5,-1,2,3,4,5,0.9", "the frame is 1.5; allowed: whole numbers from 1"),
        ("\n\n1,-1,2,nan,4,5,0.9", "line 3: y is nan; allowed: finite numbers"),
        ("1,-1,2,3,inf,5,0.9", "the width is inf; allowed: finite numbers"),
        ("1,-1,2,3,4,0,0.9", "the box is 4 x 0 px; allowed: above 0"),
        ("1,-1,2,3,4,5,62.1", "the score is 62.1; allowed: 0 to 1"),
        ("1,-1,2,3,4,5,high", "the score is 'high'"),
        ("\x00\xff", "line 1: the frame is"),
        ("1,-1,2,3,4,5,0.9,car, red", 'the label is car, red; allowed: "car, red", in quotes'),
        ('1,-1,2,3,4,5,0.9,"car\n2,-1,2,3,4,5,0.9\n', "cannot be read (unexpected end of data)"),
    ],
)
def test_an_invalid_detection_file(refusal, source, tmp_path, text, said):
    file = tmp_path / "detections.csv"
    file.write_text(text)
    error = refusal(source, "--detections", file, expected=WRONG_DETECTIONS)
    assert said in error
    assert str(file) in error


@pytest.mark.parametrize(
    ("name", "said"),
    [("none", "none cannot be read"), (".", "is a folder"), ("bytes.csv", "utf-8")],
)
def test_an_unreadable_detection_file(refusal, source, tmp_path, name, said):
    (tmp_path / "bytes.csv").write_bytes(b"\xff\xfe\x80")
    assert said in refusal(source, "--detections", tmp_path / name, expected=WRONG_DETECTIONS)


def test_detections_after_the_last_frame_are_an_error(track, source, write_detections, tmp_path):
    file = write_detections((0, 4, 8))
    assert track(source, *QUICK, "--output", tmp_path / "right", "--detections", file)[0] == 0
    file.write_text(file.read_text() + "17,-1,20,20,24,40,0.9\n")
    code, _, errors = track(source, *QUICK, "--output", tmp_path / "out", "--detections", file)
    assert code == WRONG_DETECTIONS
    line = one_sentence(errors)
    assert "has detections in frame 17, but the recording has 16 frames" in line
    assert line.endswith(f"; {COUNT} frames were tracked")
    assert read_boxes(tmp_path / "out") == read_boxes(tmp_path / "right")


def test_every_output_has_several_targets(tracked, source, write_detections, typestore, tmp_path):
    parquet = pytest.importorskip("pyarrow.parquet", reason="needs pyarrow")
    from rosbags.rosbag2 import Reader

    output = tmp_path / "out"
    asked = ("--video", "--parquet", "--bag", "--report")
    file = write_detections((3, 7, 11), label=",<b>person")
    code, _, found = tracked(source, "--detections", file, *asked)
    assert code == 0
    assert [*found[0]][-2:] == ["confidence", "label"]
    assert {(row["id"] != "", row["label"]) for row in found} == {(False, ""), (True, "<b>person")}
    table = parquet.read_table(output / "boxes.parquet").to_pylist()
    texts = [{n: "" if v is None else str(v) for n, v in row.items()} for row in table]
    assert texts == found
    capture = cv2.VideoCapture(str(output / "overlay.mp4"))
    assert capture.get(cv2.CAP_PROP_FRAME_COUNT) == COUNT
    page = (output / "report.html").read_text()
    assert "target 1 &lt;b&gt;person" in page
    assert "<figcaption>frame 3, tracking, confidence 1.00</figcaption>" in page
    assert page.count("data:image/jpeg;base64,") >= 16
    ids = {}
    numbers = {int(row["stamp"]): int(row["frame"]) for row in found}
    with Reader(output / "topics.mcap") as reader:
        names = ("box", "boxes", "overlay", "particles", "status")
        assert sorted(reader.topics) == [f"/pf_tracker/{name}" for name in names]
        for connection, _, data in reader.messages():
            message = typestore.deserialize_cdr(data, connection.msgtype)
            # No target is selected.
            assert connection.topic != "/pf_tracker/box"
            if connection.topic == "/pf_tracker/status":
                node, *targets = message.status
                values = {pair.key: pair.value for pair in node.values}
                assert (int(values["targets"]), values["selected"]) == (len(targets), "0")
            if connection.topic == "/pf_tracker/boxes":
                stamp = message.markers[0].header.stamp
                number = numbers[stamp.sec * 10**9 + stamp.nanosec]
                ids[number] = [one.id for one in message.markers if one.ns == "boxes"]
    assert sorted(ids) == list(range(COUNT))
    for number, published in ids.items():
        rows = [row for row in found if row["frame"] == str(number)]
        assert published == [int(row["id"]) for row in rows if row["x"]]


def test_a_label_stays_in_its_cell(tracked, source, write_detections, tmp_path):
    file = write_detections((0,), count=1, label=',"car, ""red""\r\nor\tnot\x7f"')
    code, _, found = tracked(source, "--detections", file)
    assert code == 0
    assert {row["label"] for row in found} == {'car, "red"  or not '}
    assert len((tmp_path / "out" / "boxes.csv").read_text().splitlines()) == 1 + COUNT


def test_a_video_without_images_says_why_it_is_none(track, make_stamped, write_bag, tmp_path):
    message = make_stamped(
        "sensor_msgs/msg/Image", 10**9, height=2, width=2, encoding="64FC1", is_bigendian=0,
        step=16, data=np.zeros(32, np.uint8),
    )  # fmt: skip
    bag = write_bag(tmp_path / "drive", [("/eye", "sensor_msgs/msg/Image", 10**9, message)])
    output = tmp_path / "out"
    code, _, errors = track(bag, "--output", output, "--detector", "motion", "--video", *QUICK)
    assert code == 3
    assert "overlay.mp4 was not written, because no frame has an image: " in one_sentence(errors)
    assert "64FC1" in errors
    assert [path.name for path in output.iterdir()] == ["boxes.csv"]
    assert [row["state"] for row in read_boxes(output)] == ["skipped"]


def test_a_recording_without_targets_has_results(track, source, tmp_path):
    file = tmp_path / "none.csv"
    file.write_text("5\n")
    output = tmp_path / "out"
    given = ("--detections", file, "--report", "--bag", "--video", "--parquet")
    code, said, errors = track(source, "--output", output, *given)
    assert (code, errors) == (0, "")
    assert f"{COUNT} frames (100% idle), 0 targets, " in said
    assert [(row["id"], row["state"]) for row in read_boxes(output)] == [("", "idle")] * COUNT
    assert "<dt>targets</dt><dd>0</dd>" in (output / "report.html").read_text()


def test_a_built_in_detector_does_not_depend_on_the_machine(
    tracked, source, monkeypatch, walkers, library
):
    class Detector:
        """Finds the walkers, and fails once."""

        def __init__(self):
            self.frames = []

        def detect(self, image, interval=0.04):
            (number,) = (n for n, one in enumerate(walkers[0]) if np.array_equal(one, image))
            self.frames.append(number)
            if number == 8:
                raise RuntimeError("blind")
            return library.detections(number)

    detector = Detector()
    monkeypatch.setitem(DETECTORS._factories, "motion", lambda: detector)
    code, errors, found = tracked(source, "--detector", "motion", "--detector-rate", "7")
    assert code == 0
    # Every fourth frame of 25 per second is due, and its detections arrive before the next one.
    assert detector.frames == [0, 4, 8, 12]
    arrivals = {number + 1: [(library.detections(number), number)] for number in (0, 4, 12)}
    assert library.target_rows(found) == library.track((), arrivals)
    (line,) = errors.splitlines()
    assert line.startswith("track: 1 warning on detections and targets, first: frame 9: the detec")
    assert "'motion' failed in frame 8: RuntimeError: blind" in line


@pytest.mark.parametrize(
    ("name", "finds"),
    [("motion", "moving objects in front of a static camera"), ("people", "at least 100 px high")],
)
def test_a_built_in_detector_without_detections_is_reported(tracked, source, name, finds):
    code, errors, found = tracked(source, "--detector", name, "--detector-rate", "5")
    assert code == 0
    (line,) = errors.splitlines()
    assert line.startswith(f"track: the detector '{name}' found nothing in 4 frames; it finds ")
    assert finds in line
    assert "raise --detector-rate to process more frames" in line
    assert [(row["id"], row["state"]) for row in found] == [("", "idle")] * COUNT


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["--detector", "eyes"], "people"),
        (["--detector", "motion", "--detector-rate", "0"], "0.01 to 100"),
        (["--detector", "motion", "--detections", "d.csv"], "not allowed with argument"),
        (["--detector", "motion", "--parameter", "max_targets=0"], "'max_targets' is 0; allowed"),
        (["--detector", "motion", "--parameter", "max_targets=no"], "'max_targets' is 'no'"),
        (["--detector", "motion", "--parameter", "targets.least=1"], "targets.least"),
        ([*2 * ["--box", "1,2,9,9"], "--parameter", "max_targets=1"], "there are 2 targets, but"),
        (["--detections"], "; write img.detections.csv beside it, or give --detections FILE"),
    ],
)
def test_a_request_that_cannot_be_carried_out(refusal, source, arguments, said):
    codes = {"--box": WRONG_TARGET, "--detections": WRONG_DETECTIONS}
    assert said in refusal(source, *arguments, expected=codes.get(arguments[0], 2))
