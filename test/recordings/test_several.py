"""Several targets and detections with the command `track`: the boxes, and what is refused."""

import csv
import json
import sys

import cv2
import numpy as np
import pytest

from pf_tracker_ros import Detections
from pf_tracker_ros.recordings.archives.memory import needed_memory
from pf_tracker_ros.recordings.archives.results import results_at
from pf_tracker_ros.recordings.archives.tasks import make_tasks
from pf_tracker_ros.recordings.detections import built_in
from pf_tracker_ros.recordings.errors import WRONG_DETECTIONS, WRONG_TARGET
from pf_tracker_ros.targets.built_in_detectors import DETECTORS
from pf_tracker_ros.targets.parameters import multi_preset_parameters
from pf_tracker_ros.targets.session import MultiSession

QUICK = ("--preset", "li2007", "--parameter", "particles=20")
COUNT = 16
INTERVAL = 40_000_000
NAMES = ("x", "y", "width", "height")
# As the repository of vision_msgs has them.
DEFINITIONS = {
    "vision_msgs/msg/Point2D": "float64 x\nfloat64 y",
    "vision_msgs/msg/Pose2D": "vision_msgs/Point2D position\nfloat64 theta",
    "vision_msgs/msg/BoundingBox2D": "vision_msgs/Pose2D center\nfloat64 size_x\nfloat64 size_y",
    "vision_msgs/msg/ObjectHypothesis": "string class_id\nfloat64 score",
    "vision_msgs/msg/ObjectHypothesisWithPose": (
        "vision_msgs/ObjectHypothesis hypothesis\ngeometry_msgs/PoseWithCovariance pose"
    ),
    "vision_msgs/msg/Detection2D": (
        "std_msgs/Header header\nvision_msgs/ObjectHypothesisWithPose[] results\n"
        "vision_msgs/BoundingBox2D bbox\nstring id"
    ),
    "vision_msgs/msg/Detection2DArray": (
        "std_msgs/Header header\nvision_msgs/Detection2D[] detections"
    ),
}


def at(number):
    return 10**9 + number * INTERVAL


@pytest.fixture(scope="session")
def walkers():
    """(images, boxes (frames, 2, 4)) of two colored walkers on a textured ground."""
    rng = np.random.default_rng(4)
    ground = rng.integers(90, 150, (160, 240, 3)).astype(np.uint8)
    sprites = [rng.integers(0, 120, (40, 24, 3)).astype(np.uint8) for _ in range(2)]
    sprites[0][..., 2] = 240
    sprites[1][..., 0] = 240
    images, boxes = [], []
    for frame in range(COUNT):
        image = ground.copy()
        corners = [(30 + 3 * frame, 20), (180 - 3 * frame, 100)]
        for (x, y), sprite in zip(corners, sprites, strict=True):
            image[y : y + 40, x : x + 24] = sprite
        images.append(image)
        boxes.append([(float(x), float(y), 24.0, 40.0) for x, y in corners])
    return images, boxes


@pytest.fixture
def source(walkers, write_sequence):
    """The walkers as a folder of images, without any truth."""
    images, boxes = walkers
    return write_sequence("walkers", images, np.array(boxes)[:, 0]) / "img"


@pytest.fixture
def write_detections(walkers, tmp_path):
    """Writes what a detector finds in some frames, of so many of the walkers."""

    def write(numbers, count=2, label=""):
        lines = []
        for number in numbers:
            for x, y, width, height in walkers[1][number][:count]:
                lines.append(f"{number + 1},-1,{x + 1},{y + 1},{width},{height},0.9{label}\n")
        path = tmp_path / "detections.csv"
        path.write_text("".join(lines))
        return path

    return write


class Library:
    """What the library alone makes of the walkers.

    Attributes:
        boxes: (frames, 2, 4) where they are.
    """

    def __init__(self, images, boxes):
        self.boxes = boxes
        self._images = images

    def said(self, number):
        """What a detector says of them in a frame."""
        return Detections(self.boxes[number], [0.9, 0.9], ["walker"] * 2)

    def track(self, boxes=(), heard=None, seed=0):
        """The rows for boxes in the first frame, and what is heard before each frame of which."""
        session = MultiSession(multi_preset_parameters("default"), seed)
        session.history.limit(120, 64.0)
        found = []
        for number, image in enumerate(self._images):
            for detections, seen in (heard or {}).get(number, ()):
                session.add_detections(detections, at(seen))
            for box in boxes if number == 0 else ():
                session.request(box, at(0))
            found += [
                (number, at(number), target.id, *target.estimate.box, target.estimate.state,
                 target.estimate.confidence)
                for target in session.process(image, at(number)).targets
            ]  # fmt: skip
        return found


@pytest.fixture
def library(walkers):
    """The library, shown the walkers."""
    return Library(*walkers)


@pytest.fixture
def tracked(track, rows, tmp_path):
    """Runs the command into a folder `out`; its exit code, errors and rows."""

    def run(*arguments):
        code, _, errors = track(*arguments, "--output", tmp_path / "out")
        return code, errors, rows(tmp_path / "out")

    return run


def as_told(rows):
    """Rows of boxes.csv with targets, as values."""
    return [
        (int(row["frame"]), int(row["stamp"]), int(row["id"]), *(float(row[n]) for n in NAMES),
         row["state"], float(row["confidence"]))
        for row in rows if row["id"]
    ]  # fmt: skip


def box_text(box):
    return ",".join(map(str, box))


def one_sentence(errors):
    (line,) = errors.splitlines()
    assert line.startswith("track: error: ")
    return line


def test_several_boxes_have_a_row_each_to_the_bits_of_the_library(tracked, source, library):
    boxes = library.boxes[0]
    given = [argument for box in boxes for argument in ("--box", box_text(box))]
    code, errors, found = tracked(source, "--seed", 5, *given)
    assert (code, errors) == (0, "")
    found = as_told(found)
    assert found == library.track(boxes, seed=5)
    assert [row[2] for row in found] == [1, 2] * COUNT
    assert len({row[3] for row in found}) > COUNT


def test_the_targets_of_a_file_begin_on_their_own_frames(track, rows, source, walkers, tmp_path):
    boxes = walkers[1]
    file = source.with_name("img.target.yaml")
    file.write_text(
        "recording: img\nimage_size: [240, 160]\ntargets:\n"
        f"  - {{target_box: {list(boxes[6][1])}, frame: 6, label: blue}}\n"
        f"  - {{target_box: {list(boxes[2][0])}, stamp: {at(2)}, label: red}}\n"
    )
    output = tmp_path / "out"
    # A parameter of several targets alone.
    few = ("--parameter", "targets.most=2", "--report", "--bag")
    assert track(source, "--output", output, *QUICK, *few)[0] == 0
    found = rows(output)
    assert [(row["frame"], row["id"], row["state"]) for row in found[:2]] == [
        ("0", "", "idle"),
        ("1", "", "idle"),
    ]
    assert found[0]["x"] == found[0]["confidence"] == ""
    assert next(row["frame"] for row in found if row["id"] == "2") == "6"
    first = next(row for row in found if row["id"] == "1")
    assert (first["frame"], [float(first[n]) for n in NAMES]) == ("2", list(boxes[2][0]))
    page = (output / "report.html").read_text()
    assert page.count("<section") == 2
    assert "target 1 red" in page
    assert "target 2 blue" in page


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("targets: []", "'targets' is []; allowed: a list with a mapping for each target"),
        ("targets: [1]", "the entry of target 1 is 1; allowed: a mapping"),
        ("targets: [{target_box: [1, 2, 30]}]", "'target_box' of target 1 is [1, 2, 30]"),
        (
            "targets: [{target_box: [1, 2, 30, 40]}, {target_box: [1, 2, 30, 40], age: 3}]",
            "has age of target 2; allowed: frame, image_size",
        ),
        ("targets: []\ntarget_box: [1, 2, 30, 40]", "has target_box; allowed: image_size"),
        ("recording: other\ntargets: [{target_box: [1, 2, 30, 40]}]", "the target of 'other'"),
        (
            "targets: [{target_box: [1, 2, 30, 40]}, {target_box: [900, 2, 30, 40]}]",
            "target refused: the center of box (900, 2, 30, 40) is outside",
        ),
        (
            "targets: [{target_box: [1, 2, 30, 40], frame: 7}, {target_box: [1, 2, 9, 9], "
            "frame: 900}]",
            "of target 2 is of a frame number 900, which this recording does not have",
        ),
    ],
)
def test_a_file_of_several_targets_that_is_wrong(track, source, tmp_path, text, said):
    source.with_name("img.target.yaml").write_text(text)
    code, _, errors = track(source, "--output", tmp_path / "out", *QUICK)
    assert code == WRONG_TARGET
    assert said in one_sentence(errors)


@pytest.mark.parametrize("label", ["", ",-1,-1,-1", ",walker"])
def test_detections_of_a_file_start_and_correct_targets(
    tracked, source, library, write_detections, label
):
    file = write_detections((3, 7, 11), label=label)
    # It has seen the frame 14, and found nothing.
    file.write_text(file.read_text() + "15\n")
    code, errors, found = tracked(source, "--detections", file)
    assert (code, errors) == (0, "")
    heard = {number: [(library.said(number), number)] for number in (3, 7, 11)}
    if "walker" not in label:
        heard = {n: [(Detections(one.boxes, one.scores), n)] for n, [(one, _)] in heard.items()}
    heard[14] = [(Detections([]), 14)]
    assert as_told(found) == library.track((), heard)
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
        ('1,-1,2,3,4,5,0.9,"car\n2,-1,2,3,4,5,0.9\n', "cannot be read (unexpected end of data)"),
    ],
)
def test_a_file_of_detections_that_is_wrong(track, source, tmp_path, text, said):
    file = tmp_path / "detections.csv"
    file.write_text(text)
    code, _, errors = track(source, "--output", tmp_path / "out", "--detections", file)
    assert code == WRONG_DETECTIONS
    assert said in one_sentence(errors)
    assert str(file) in errors
    assert not (tmp_path / "out").exists()


def test_files_of_detections_that_cannot_be_read(track, source, tmp_path):
    (tmp_path / "octets").write_bytes(b"\xff\xfe\x80")
    for name, said in (("none", "none cannot be read"), (".", "is a folder"), ("octets", "utf-8")):
        given = ("--detections", tmp_path / name)
        code, _, errors = track(source, "--output", tmp_path / "out", *given)
        assert code == WRONG_DETECTIONS
        assert said in one_sentence(errors)


def test_detections_beyond_the_end_are_told_and_cost_nothing(
    track, rows, source, write_detections, tmp_path
):
    file = write_detections((0, 4, 8))
    assert track(source, "--output", tmp_path / "right", "--detections", file)[0] == 0
    file.write_text(file.read_text() + "17,-1,20,20,24,40,0.9\n")
    code, _, errors = track(source, "--output", tmp_path / "out", "--detections", file)
    assert code == WRONG_DETECTIONS
    line = one_sentence(errors)
    assert "has detections of frame 17, and the recording has 16" in line
    assert line.endswith(f"; {COUNT} frames were tracked")
    assert rows(tmp_path / "out") == rows(tmp_path / "right")


def test_every_output_tells_of_several_targets(
    tracked, source, write_detections, typestore, tmp_path
):
    parquet = pytest.importorskip("pyarrow.parquet", reason="needs pyarrow")
    from rosbags.rosbag2 import Reader

    output = tmp_path / "out"
    asked = ("--video", "--parquet", "--bag", "--report")
    file = write_detections((3, 7, 11), label=",<b>person")
    code, _, found = tracked(source, "--detections", file, *asked)
    assert code == 0
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
    with Reader(output / "topics.mcap") as reader:
        for connection, _, data in reader.messages():
            message = typestore.deserialize_cdr(data, connection.msgtype)
            if connection.topic == "/pf_tracker/boxes":
                stamp = message.markers[0].header.stamp
                number = (stamp.sec * 10**9 + stamp.nanosec - at(0)) // INTERVAL
                ids[number] = [one.id for one in message.markers if one.ns == "boxes"]
    assert sorted(ids) == list(range(COUNT))
    for number, told in ids.items():
        own = [int(row["id"]) for row in found if row["frame"] == str(number) and row["x"]]
        assert told == own


def test_a_video_without_any_picture_says_why_there_is_none(
    track, rows, make_stamped, write_bag, tmp_path
):
    message = make_stamped(
        "sensor_msgs/msg/Image", at(0), height=2, width=2, encoding="64FC1", is_bigendian=0,
        step=16, data=np.zeros(32, np.uint8),
    )  # fmt: skip
    bag = write_bag(tmp_path / "drive", [("/eye", "sensor_msgs/msg/Image", at(0), message)])
    output = tmp_path / "out"
    code, _, errors = track(bag, "--output", output, "--detector", "motion", "--video", *QUICK)
    assert code == 3
    assert "there is no overlay.mp4, as no frame has an image: " in one_sentence(errors)
    assert "64FC1" in errors
    assert [path.name for path in output.iterdir()] == ["boxes.csv"]
    assert [row["state"] for row in rows(output)] == ["skipped"]


def test_nothing_found_at_all_is_a_result(track, rows, source, tmp_path):
    file = tmp_path / "none.csv"
    file.write_text("5\n")
    output = tmp_path / "out"
    given = ("--detections", file, "--report", "--bag", "--video", "--parquet")
    code, said, errors = track(source, "--output", output, *given)
    assert (code, errors) == (0, "")
    assert f"{COUNT} frames (100% idle)" in said
    assert [(row["id"], row["state"]) for row in rows(output)] == [("", "idle")] * COUNT
    assert "<dt>targets</dt><dd>0</dd>" in (output / "report.html").read_text()


def test_what_a_built_in_detector_finds_does_not_hang_on_the_machine(
    tracked, source, monkeypatch, walkers, library
):
    class Eyes:
        """Finds the walkers, and fails once."""

        def __init__(self):
            self.seen = []

        def detect(self, image, interval=0.04):
            (number,) = (n for n, one in enumerate(walkers[0]) if np.array_equal(one, image))
            self.seen.append(number)
            if number == 10:
                raise RuntimeError("blind")
            return library.said(number)

    eyes = Eyes()
    monkeypatch.setattr(built_in, "DETECTORS", {**DETECTORS, "motion": lambda: eyes})
    code, errors, found = tracked(source, "--detector", "motion", "--detector-rate", "5")
    assert code == 0
    # Every fifth frame of 25 a second is due, and its answer is heard before the next.
    assert eyes.seen == [0, 5, 10, 15]
    heard = {number + 1: [(library.said(number), number)] for number in (0, 5)}
    assert as_told(found) == library.track((), heard)
    assert "frame 11: the detector 'motion' failed: blind" in errors


@pytest.fixture
def vision(typestore):
    """The message types of rosbags with those of vision_msgs."""
    from rosbags.typesys import Stores, get_types_from_msg, get_typestore

    store = get_typestore(Stores.ROS2_JAZZY)
    types = {}
    for name, text in DEFINITIONS.items():
        types |= get_types_from_msg(text, name)
    store.register(types)
    return store


@pytest.fixture
def detections_message(vision):
    """Serializes detections as a vision_msgs/Detection2DArray, without the code under test."""
    types = vision.types

    def header(stamp):
        seconds, nanoseconds = divmod(stamp, 10**9)
        time = types["builtin_interfaces/msg/Time"](sec=seconds, nanosec=nanoseconds)
        return types["std_msgs/msg/Header"](stamp=time, frame_id="lens")

    def make(stamp, boxes, *, little_endian=True):
        pose = types["geometry_msgs/msg/Pose"](
            position=types["geometry_msgs/msg/Point"](x=0.0, y=0.0, z=0.0),
            orientation=types["geometry_msgs/msg/Quaternion"](x=0.0, y=0.0, z=0.0, w=1.0),
        )
        pose = types["geometry_msgs/msg/PoseWithCovariance"](pose=pose, covariance=np.zeros(36))
        detections = []
        for number, (x, y, width, height) in enumerate(boxes):
            results = [
                types["vision_msgs/msg/ObjectHypothesisWithPose"](
                    hypothesis=types["vision_msgs/msg/ObjectHypothesis"](
                        class_id=label, score=score
                    ),
                    pose=pose,
                )
                for label, score in (("tree", 0.1), ("walker", 0.9))
            ]
            point = types["vision_msgs/msg/Point2D"](x=x + width / 2, y=y + height / 2)
            bbox = types["vision_msgs/msg/BoundingBox2D"](
                center=types["vision_msgs/msg/Pose2D"](position=point, theta=0.0),
                size_x=width,
                size_y=height,
            )
            detections.append(
                types["vision_msgs/msg/Detection2D"](
                    header=header(stamp), results=results, bbox=bbox, id="x" * number
                )
            )
        kind = "vision_msgs/msg/Detection2DArray"
        message = types[kind](header=header(stamp), detections=detections)
        return bytes(vision.serialize_cdr(message, kind, little_endian=little_endian))

    return make


@pytest.fixture
def write_walkers(walkers, vision, make_stamped, tmp_path):
    """Writes a bag of the walkers and of messages of a detector (log time, octets)."""

    def write(answers, kind="vision_msgs/msg/Detection2DArray"):
        from rosbags.rosbag2 import StoragePlugin, Writer

        rows = [(moment, 0, kind, octets) for moment, octets in answers]
        for number, image in enumerate(walkers[0]):
            height, width = image.shape[:2]
            octets = make_stamped(
                "sensor_msgs/msg/Image", at(number), height=height, width=width, encoding="bgr8",
                is_bigendian=0, step=3 * width, data=image.reshape(-1),
            )  # fmt: skip
            rows.append((at(number) + 1000, 1, "sensor_msgs/msg/Image", octets))
        path = tmp_path / "drive"
        with Writer(path, version=9, storage_plugin=StoragePlugin.MCAP) as writer:
            topics = {}
            for moment, which, message_type, octets in sorted(rows):
                if message_type not in topics:
                    topics[message_type] = writer.add_connection(
                        ("/found", "/eye")[which], message_type, typestore=vision
                    )
                writer.write(topics[message_type], moment, octets)
        return path

    return write


@pytest.mark.parametrize("little_endian", [True, False])
def test_detections_of_a_bag_count_by_their_stamps_when_they_were_heard(
    tracked, write_walkers, detections_message, library, little_endian
):
    boxes = library.boxes
    # Of frame 0 as that came, of frame 4 two frames late, of frame 9 together with frame 10.
    heard = ((0, 0), (4, 6), (9, 10))
    bag = write_walkers(
        [
            (
                at(told) + 1000,
                detections_message(at(seen), boxes[seen], little_endian=little_endian),
            )
            for seen, told in heard
        ]
    )
    code, errors, found = tracked(bag, "--detections-topic", "/found", "--seed", 2)
    assert (code, errors) == (0, "")
    expected = {told: [(library.said(seen), seen)] for seen, told in heard}
    assert as_told(found) == library.track((), expected, seed=2)
    assert len(found) == 2 * COUNT


def test_a_detector_of_another_clock_is_told_of_and_left_out(
    tracked, write_walkers, detections_message, library
):
    boxes = library.boxes
    bag = write_walkers(
        [
            (at(0), detections_message(at(0), boxes[0])),
            (at(5), detections_message(at(5) + 3600 * 10**9, boxes[5])),
            (at(6), detections_message(at(6), [boxes[6][0]] * 1500)),
        ]
    )
    code, errors, found = tracked(bag, "--detections-topic", "/found")
    assert code == 0
    (line,) = errors.splitlines()
    assert "of 2 remarks" in line
    assert "frame 5: detections refused: its stamp is 3600 s after" in line
    assert len(found) == 2 * COUNT


def test_topics_that_are_no_detections(track, write_walkers, detections_message, source):
    octets = detections_message(at(0), [(1.0, 2.0, 30.0, 40.0)])
    bag = write_walkers([(at(0), octets), (at(8), octets[:-30])])
    output = bag.parent / "out"
    code, _, errors = track(bag, "--output", output, "--detections-topic", "/none")
    assert code == WRONG_DETECTIONS
    assert "has no topic /none of type vision_msgs/msg/Detection2DArray; there are: /found" in (
        one_sentence(errors)
    )
    code, _, errors = track(bag, "--output", output, "--detections-topic", "/eye")
    assert code == WRONG_DETECTIONS
    code, _, errors = track(source, "--output", output, "--detections-topic", "/eye")
    assert code == 2
    assert "is for a bag" in one_sentence(errors)
    assert not output.exists()
    code, _, errors = track(bag, "--output", output, "--detections-topic", "/found")
    assert code == 3
    line = one_sentence(errors)
    assert "topic /found, message 1: a message of" in line
    assert line.endswith("; 8 frames were tracked")


def test_an_archive_takes_targets_of_several_and_counts_frames(
    track, rows, walkers, write_sequence, tmp_path
):
    images, boxes = walkers
    archive = tmp_path / "archive"
    source = write_sequence("pair", images, np.array(boxes)[:, 0], archive)
    entries = "".join(f"\n  - target_box: {list(box)}" for box in boxes[0])
    source.with_name("pair.target.yaml").write_text(f"targets:{entries}\nimage_size: [240, 160]\n")
    write_sequence("one", images, np.array(boxes)[:, 0], archive)
    output = tmp_path / "out"
    given = ("--archive", archive, "--output", output, *QUICK)
    code, said, _ = track(*given, "--dry-run")
    assert code == 0
    assert "2 of 2 recordings, 32 frames" in said
    assert track(*given)[0] == 0
    entries = {entry["name"]: entry for entry in json.loads((output / "archive.json").read_text())}
    assert entries["pair"]["frames"] == sum(entries["pair"]["states"].values()) == COUNT
    assert {row["id"] for row in rows(output / "pair")} == {"1", "2"}
    assert {row["id"] for row in rows(output / "one")} == {"1"}
    code, _, errors = track(*given, "--detections", "d.csv")
    assert code == 2
    assert "detections is for one recording; allowed here: --detections alone" in errors


def test_several_targets_are_given_more_memory(write_sequence, walkers, tmp_path):
    images, boxes = walkers
    source = write_sequence("pair", images, np.array(boxes)[:, 0])
    results = results_at(tmp_path / "out")

    def needed(text, *arguments):
        source.with_name("pair.target.yaml").write_text(text)
        return needed_memory(make_tasks({"pair": source}, results, arguments)[0])

    one = "{target_box: [1, 2, 30, 40], image_size: [240, 160]}"
    alone = needed(one)
    assert needed(f"targets: [{one}, {one}]") == needed(one, "--detector=motion") > 1.2 * alone


def test_an_archive_may_have_a_detector(track, walkers, write_sequence, tmp_path):
    images, boxes = walkers
    source = write_sequence("pair", images, np.array(boxes)[:, 0])
    (tmp_path / "list.txt").write_text(f"{source.name}/img\n")
    given = ("--archive", tmp_path / "list.txt", "--output", tmp_path / "out", *QUICK)
    assert track(*given, "--detector", "motion", "--detector-rate", "25")[0] == 0
    with (tmp_path / "out" / source.name / "img" / "boxes.csv").open() as file:
        assert {row["frame"] for row in csv.DictReader(file)} == {str(n) for n in range(COUNT)}
    # With another detector it is not the same work.
    code, said, _ = track(*given, "--detector", "motion", "--detector-rate", "25")
    assert "1 done before" in said
    code, said, _ = track(*given, "--detector", "motion", "--detector-rate", "5")
    assert (code, "1 tracked" in said) == (0, True)


@pytest.fixture
def detected_archive(walkers, write_sequence, write_detections, tmp_path):
    """Two folders of images with detections beside them, one without, and what is no recording."""
    images, boxes = walkers
    archive = tmp_path / "archive"
    for name, numbers in (("day_0/pair", (3, 7, 11)), ("day_1/late", (5, 9)), ("none", ())):
        folder = write_sequence(name.replace("/", "_"), images, np.array(boxes)[:, 0]) / "img"
        (archive / name).parent.mkdir(parents=True, exist_ok=True)
        folder.rename(archive / name)
        if numbers:
            write_detections(numbers, label=",walker").rename(archive / f"{name}.detections.csv")
    (archive / "logo.png").write_bytes(b"no image")
    (archive / "notes.txt").write_text("no recording")
    return archive


def test_an_archive_is_labeled_from_the_detections_beside_its_recordings(
    track, rows, detected_archive, library, tmp_path
):
    output = detected_archive / "boxes"
    given = ("--archive", detected_archive, "--output", output, "--detections")
    code, said, _ = track(*given, "--dry-run")
    assert code == 0
    lines = said.splitlines()
    none = f"no detections for {detected_archive / 'none'}: write none.detections.csv beside it"
    assert [line for line in lines if "would fail" in line] == [
        f"would fail: {none}, or give --detections FILE"
    ]
    assert lines[-1].startswith("3 of 3 recordings, 32 frames; about ")
    code, said, errors = track(*given)
    assert code == 1
    assert none in one_sentence(errors)
    assert "3 recordings: 2 tracked, 0 done before, 1 failed" in said
    manifest = json.loads((output / "archive.json").read_text())
    assert {entry["name"]: entry["exit_code"] for entry in manifest} == {
        "day_0/pair": 0,
        "day_1/late": 0,
        "none": WRONG_DETECTIONS,
    }
    assert {row["id"] for row in rows(output / "day_0/pair")} == {"", "1", "2"}
    for name, numbers in (("day_0/pair", (3, 7, 11)), ("day_1/late", (5, 9))):
        heard = {number: [(library.said(number), number)] for number in numbers}
        assert as_told(rows(output / name)) == library.track((), heard)
        # The same as for that recording alone, with the file found beside it or named.
        for number, file in enumerate(([], [detected_archive / f"{name}.detections.csv"])):
            alone = tmp_path / f"{numbers[0]}_{number}"
            source = detected_archive / name
            assert track(source, "--output", alone, "--detections", *file)[0] == 0
            found = (output / name / "boxes.csv").read_bytes()
            assert found == (alone / "boxes.csv").read_bytes()


def test_only_where_the_detections_have_changed_it_is_done_again(track, detected_archive, tmp_path):
    output = tmp_path / "out"
    given = ("--archive", detected_archive, "--output", output, "--detections", *QUICK)
    assert "2 tracked, 0 done before, 1 failed" in track(*given)[1]
    before = {path: path.stat().st_mtime_ns for path in output.rglob("boxes.csv")}
    assert "0 tracked, 2 done before, 1 failed" in track(*given)[1]
    file = detected_archive / "day_1" / "late.detections.csv"
    file.write_text("".join(file.read_text().splitlines(keepends=True)[:-1]))
    file.with_name("none.detections.csv").write_text("1\n")
    assert "1 tracked, 1 done before, 1 failed" in track(*given)[1]
    changed = {path for path, at in before.items() if path.stat().st_mtime_ns != at}
    assert changed == {output / "day_1" / "late" / "boxes.csv"}
    # Where they are not asked for they are no input.
    (tmp_path / "list.txt").write_text("archive/day_1/late\n")
    box = detected_archive / "day_1" / "late.target.yaml"
    box.write_text("target_box: [30, 20, 24, 40]")
    given = ("--archive", tmp_path / "list.txt", "--output", tmp_path / "plain", *QUICK)
    assert "1 tracked" in track(*given)[1]
    file.write_text("1\n")
    assert "1 done before" in track(*given)[1]


def test_an_archive_of_bags_takes_detections_of_a_topic(
    track, rows, write_walkers, detections_message, library
):
    bag = write_walkers([])
    archive = bag.with_name("archive")
    archive.mkdir()
    bag.rename(archive / "unheard")
    answers = [(at(4) + 1000, detections_message(at(4), library.boxes[4]))]
    write_walkers(answers).rename(archive / "heard")
    (archive / "clip.mp4").write_bytes(b"no bag")
    output = archive / "boxes"
    given = ("--archive", archive, "--output", output, "--detections-topic", "/found", "--bag")
    code, _, errors = track(*given)
    assert code == 1
    assert "unheard has no topic /found of type" in one_sentence(errors)
    heard = {4: [(library.said(4), 4)]}
    assert as_told(rows(output / "heard")) == library.track((), heard)
    # The bag of the results is no recording.
    assert "0 tracked, 1 done before, 1 failed" in track(*given)[1]


def test_a_detector_is_asked_about_every_recording_of_a_folder(track, walkers, source):
    archive = source.parents[1] / "archive"
    (archive / "empty").mkdir(parents=True)
    source.rename(archive / "images")
    path = str(archive / "clip.avi")
    video = cv2.VideoWriter(path, cv2.VideoWriter_fourcc(*"MJPG"), 25.0, (240, 160))
    for image in walkers[0]:
        video.write(image)
    video.release()
    (archive / "clip.txt").write_text("about the clip")
    output = archive / "boxes"
    given = ("--archive", archive, "--output", output, "--detector", "motion", "--video", *QUICK)
    code, said, _ = track(*given)
    assert (code, "2 recordings: 2 tracked" in said) == (0, True)
    manifest = json.loads((output / "archive.json").read_text())
    assert [entry["name"] for entry in manifest] == ["clip.avi", "images"]
    # The videos of the results are no recordings.
    assert "2 recordings: 0 tracked, 2 done before" in track(*given)[1]


def test_where_nothing_can_be_detected_it_says_in_what(track, tmp_path):
    (tmp_path / "archive").mkdir()
    (tmp_path / "archive" / "notes.txt").write_text("no recording")
    for option, said in (
        (["--detections"], "folders of images, with detections beside them, such as drive.det"),
        (["--detections-topic", "/found"], "; detections are looked for in bags"),
        (["--detector", "people"], "; detections are looked for in bags, videos and folders"),
    ):
        given = ("--archive", tmp_path / "archive", "--output", tmp_path / "out", *option)
        code, _, errors = track(*given)
        assert code == 2
        assert said in one_sentence(errors)


def test_the_detections_of_a_recording_are_no_place_for_results(track, detected_archive, tmp_path):
    (tmp_path / "list.txt").write_text("archive/day_0/pair\n/nowhere/pair.detections.csv\n")
    given = ("--archive", tmp_path / "list.txt", "--output", detected_archive / "day_0")
    code, _, errors = track(*given, "--detections")
    assert code == 2
    assert "which is, contains or lies in what belongs to" in one_sentence(errors)


def test_without_detections_beside_it_says_where_they_would_be(track, source, tmp_path):
    code, _, errors = track(source, "--output", tmp_path / "out", "--detections")
    assert code == WRONG_DETECTIONS
    assert one_sentence(errors).endswith(
        f"no detections for {source}: write img.detections.csv beside it, or give --detections FILE"
    )
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["--detector", "eyes"], "people"),
        (["--detector", "motion", "--detector-rate", "0"], "0.01 to 100"),
        (["--detector", "motion", "--detections", "d.csv"], "not allowed with argument"),
        (["--detector", "motion", "--parameter", "targets.most=0"], "targets.most"),
        (["--detector", "motion", "--parameter", "targets.least=1"], "targets.least"),
        (["--box", "1,2,30,40", "--parameter", "targets.most=3"], "targets.most"),
        (
            ["--box", "1,2,30,40", "--box", "50,2,30,40", "--parameter", "targets.most=1"],
            "box from --box: there are 1 targets, as many as there may be",
        ),
    ],
)
def test_a_request_that_cannot_be_carried_out(track, source, tmp_path, arguments, said):
    code, _, errors = track(source, "--output", tmp_path / "out", *arguments)
    assert code in (2, WRONG_TARGET)
    assert said in one_sentence(errors)
    assert not (tmp_path / "out").exists()


def test_without_scipy_it_says_what_is_missing(track, source, monkeypatch, tmp_path):
    monkeypatch.setitem(sys.modules, "scipy", None)
    code, _, errors = track(source, "--output", tmp_path / "out", "--detector", "motion")
    assert code == 2
    assert "scipy is not installed: pip install scipy, or '.[targets]' in the sources" in errors
    assert len(errors.splitlines()) == 1
