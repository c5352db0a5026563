"""The demo as a user runs it, and what it says when a step fails."""

import csv
import json
import re
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from common import overlap

pytest.importorskip("rclpy", reason="needs ROS 2")
pytest.importorskip("rosbags", reason="a ROS from apt has no rosbags, which bags are written with")

from rosbags.highlevel import AnyReader

REPOSITORY = Path(__file__).resolve().parents[2]
DEMO = REPOSITORY / "demo"
TIMEOUT = 300.0

# The clip of somebody who is hidden for a while, and the clip of several targets.
HIDDEN, STREET, FRAMES = "hidden", "people", 240
CLIPS = (HIDDEN, STREET)
# Where the person in red is drawn in the last frame, and three men in a frame of the other clip.
LAST_BOX, MEN_FRAME = (707, 188, 53, 132), 109
MEN = [(314, 199, 57, 142), (276, 203, 59, 147), (379, 186, 53, 132)]


def run_demo(output):
    return subprocess.run(
        [sys.executable, DEMO / "run.py", "--output", output],
        capture_output=True,
        text=True,
        timeout=TIMEOUT,
        check=False,
    )


@pytest.fixture(scope="module")
def demo(tmp_path_factory):
    """The demo's results: their folder, and what it printed."""
    output = tmp_path_factory.mktemp("demo")
    process = run_demo(output)
    assert process.returncode == 0, process.stdout + process.stderr
    return output, process.stdout


@pytest.fixture
def demo_modules(monkeypatch):
    """Makes the demo's modules importable."""
    monkeypatch.syspath_prepend(str(DEMO))


def frames_of(demo, clip):
    return json.loads((demo[0] / clip / "result.json").read_text())["frames"]


def messages_of(bag, *names):
    """The tracker's messages on some topics: stamp to the only one of that time, by topic."""
    found = {f"/pf_tracker/{name}": {} for name in names}
    with AnyReader([bag]) as reader:
        connections = [one for one in reader.connections if one.topic in found]
        for connection, log_time, data in reader.messages(connections):
            assert log_time not in found[connection.topic]
            message = reader.deserialize(data, connection.msgtype)
            found[connection.topic][log_time] = message
    return list(found.values())


def test_every_frame_has_its_answer(demo):
    frames = frames_of(demo, HIDDEN)
    assert len(frames) == FRAMES
    assert overlap(frames[-1]["box"], LAST_BOX) > 0.5
    stamps = [frame["stamp"] for frame in frames]
    assert stamps[0] == 1.0
    assert stamps == sorted(set(stamps))
    for frame in frames:
        assert frame["state"] in ("tracking", "occluded", "lost")
        assert 0 <= frame["confidence"] <= 1
        assert (frame["box"] is None) == (frame["state"] == "lost")


class Truth:
    """Where a man of the drawn street is, and how much of him is seen."""

    def __init__(self, man):
        import street_scenes

        footage = street_scenes.people()
        self._stage = footage._stage
        feet = np.array([one.positions for one in self._stage.actors])
        self._feet = feet - footage._camera.offsets
        x, y, width, height = man
        offsets = self._feet[:, MEN_FRAME] - [x + width / 2, y + height]
        self._number = int(np.hypot(*offsets.T).argmin())

    def feet(self, index):
        return self._feet[self._number, index]

    def visible(self, index):
        """The share of him that nothing covers, 0 to 1; he in white, all before him in black."""
        canvas = np.zeros(self._stage.backdrop.shape, np.float32)
        he, *others = (actor.placed(index) for actor in self._stage.actors[self._number :])
        replace(he, pixels=np.repeat(he.pixels[..., 3:], 4, axis=2)).draw(canvas)
        alone = canvas.sum()
        for other in others:
            replace(other, pixels=other.pixels * np.float32([0, 0, 0, 1])).draw(canvas)
        canvas *= 1.0 - self._stage.foreground[..., 3:]
        return float(canvas.sum() / max(alone, 1.0))


def test_several_targets_start_without_a_hand_and_keep_their_ids(demo, demo_modules):
    frames = frames_of(demo, STREET)
    assert len(frames) == FRAMES
    assert frames[0]["targets"] == []
    last = frames[MEN_FRAME]["targets"]
    ids = []
    for man in MEN:
        best = max(last, key=lambda one: overlap(one["box"], man))
        assert overlap(best["box"], man) > 0.4
        ids.append(best["id"])
    assert len(set(ids)) == len(MEN)
    # Until then they come into view one after the other, and later they leave it.
    until_then = slice(MEN_FRAME - 75, MEN_FRAME + 1)
    for id, man in zip(ids, MEN, strict=True):
        truth = Truth(man)
        boxes = [
            next((one["box"] for one in frame["targets"] if one["id"] == id), None)
            for frame in frames
        ]
        followed = np.array([box is not None for box in boxes])
        first, end = followed.argmax(), len(followed) - followed[::-1].argmax()
        is_seen = np.array([truth.visible(index) > 0.5 for index in range(first, end)])
        assert is_seen.sum() > 0.8 * (end - first)
        assert followed[first:end][is_seen].mean() > 0.8
        assert followed[until_then].sum() > 76 / 2
        for index in np.flatnonzero(is_seen & followed[first:end]) + first:
            x, y, width, height = boxes[index]
            offset = np.abs(np.array([x + width / 2, y + height]) - truth.feet(index))
            assert (offset < [0.5 * width, 0.2 * height]).all()


def test_every_frame_of_several_targets_has_its_answer(demo):
    for frame in frames_of(demo, STREET):
        assert frame["state"] in ("idle", "tracking", "occluded", "lost")
        ids = [one["id"] for one in frame["targets"]]
        assert ids == sorted(set(ids))
        for one in frame["targets"]:
            assert one["label"] == "person"
            assert 0 <= one["confidence"] <= 1
            assert (one["box"] is None) == (one["state"] == "lost")


def test_the_recorded_bag_holds_the_boxes_of_all_targets(demo):
    published = messages_of(demo[0] / STREET / "result.mcap", "status", "overlay", "boxes")
    assert [len(messages) for messages in published] == [FRAMES] * 3
    for frame in frames_of(demo, STREET):
        markers = published[2][round(frame["stamp"] * 1e9)].markers
        boxes = [one.id for one in markers if one.ns == "boxes"]
        assert boxes == [one["id"] for one in frame["targets"] if one["box"]]


def test_the_recorded_bag_holds_what_the_tracker_published(demo):
    frames = frames_of(demo, HIDDEN)
    bag = demo[0] / HIDDEN / "result.mcap"
    statuses, overlays, boxes = messages_of(bag, "status", "overlay", "box")
    assert len(statuses) == len(overlays) == len(frames)
    shown = {round(frame["stamp"] * 1e9): frame["box"] for frame in frames if frame["box"]}
    assert boxes.keys() == shown.keys()
    for stamp, box in shown.items():
        corner = boxes[stamp].polygon.points[0]
        assert (corner.x, corner.y) == pytest.approx(box[:2], abs=0.001)


def test_track_finds_in_the_recording_what_the_node_published(demo):
    def in_words(message):
        return repr(message) + str(getattr(message, "data", np.empty(0)).tobytes())

    folder = demo[0] / HIDDEN
    for name in ("box", "particles", "overlay"):
        (published,) = messages_of(folder / "result.mcap", name)
        (found,) = messages_of(folder / "tracked" / "topics.mcap", name)
        assert len(published) > FRAMES / 2
        assert found.keys() == published.keys()
        for stamp, message in published.items():
            assert in_words(found[stamp]) == in_words(message)
    with (folder / "tracked" / "boxes.csv").open(newline="") as file:
        told = [(row["state"], float(row["confidence"])) for row in csv.DictReader(file)]
    assert told == [(frame["state"], frame["confidence"]) for frame in frames_of(demo, HIDDEN)]


@pytest.mark.parametrize("clip", CLIPS)
def test_video_and_contact_sheet_can_be_looked_at(demo, clip):
    capture = cv2.VideoCapture(str(demo[0] / clip / "overlay.mp4"))
    # H.264 is what browsers play.
    assert int(capture.get(cv2.CAP_PROP_FOURCC)).to_bytes(4, "little") == b"h264"
    grabbed = 0
    while capture.grab():
        grabbed += 1
    assert grabbed == FRAMES
    assert FRAMES / capture.get(cv2.CAP_PROP_FPS) >= 10.0
    sheet = cv2.imread(str(demo[0] / clip / "contact_sheet.png"))
    assert sheet is not None
    assert sheet.shape[1] == 1920


@pytest.mark.parametrize("clip", CLIPS)
def test_the_table_names_the_clip(demo, clip):
    (row,) = [line for line in demo[1].splitlines() if line.startswith(f"│ {clip}")]
    assert str(FRAMES) in row


def test_the_demo_ends_with_a_page_of_files_beside_it(demo):
    page = demo[0] / "index.html"
    assert demo[1].splitlines()[-1].endswith(page.resolve().as_uri())
    text = page.read_text()
    # Without those of parts of a plot.
    addresses = set(re.findall(r'(?:src|href)="([^"#][^"]*)"', text)) - {"data:,"}
    assert {f"{clip}/overlay.mp4" for clip in CLIPS} < addresses
    assert {f"{clip}/tracked/report.html" for clip in CLIPS} < addresses
    assert [one for one in sorted(addresses) if not (page.parent / one).is_file()] == []
    # In styles as well, nothing of another host; a plot names its standards.
    named = re.sub(r'xmlns(:\w+)?="[^"]*"', "", text)
    assert not re.search(r"https?://|@import", named)
    assert "track " in text
    assert "--detector people" in text


def test_somebody_hidden_is_found_again(demo):
    frames = frames_of(demo, HIDDEN)
    states = [frame["state"] for frame in frames]
    assert set(states) == {"tracking", "occluded", "lost"}
    hidden = slice(100, 160)
    assert "tracking" not in states[hidden]
    assert states[-40:] == ["tracking"] * 40
    # As the page says: the man in yellow, right of the person in red, is a guess of the search.
    guesses = [frame for frame in frames[100:180] if frame["box"] and frame["box"][0] > 600]
    assert {frame["state"] for frame in guesses} == {"occluded"}
    assert max(frame["confidence"] for frame in guesses) < 0.5


def test_the_demo_ends_with_a_robot_that_follows(demo):
    folder = demo[0] / "follower"
    for video, size in (("follower.mp4", (1140, 480)), ("follower_narrow.mp4", (640, 960))):
        capture = cv2.VideoCapture(str(folder / video))
        assert int(capture.get(cv2.CAP_PROP_FOURCC)).to_bytes(4, "little") == b"h264"
        assert capture.get(cv2.CAP_PROP_FRAME_COUNT) == 320
        assert 320 / capture.get(cv2.CAP_PROP_FPS) >= 10.0
        assert capture.read()[1].shape[1::-1] == size
    with (folder / "tracked" / "boxes.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    assert sum(bool(row["position_x"]) for row in rows) > 240
    page = (demo[0] / "index.html").read_text()
    shown = page[page.index("A robot that follows") :]
    error = re.search(r"positions are (\d\.\d+) m off the true ones in the median", shown)
    assert float(error[1]) < 0.2
    assert error[0] in demo[1].replace("\n", "")
    assert "0.05 m of it because depth shows the surface of a body" in shown
    assert "x in odom, m" in shown
    assert "track demo/follower" in page or f"track {folder}" in page


def test_a_failed_step_is_named_with_its_reason(demo, tmp_path):
    (tmp_path / "hidden").write_text("in the way")
    process = run_demo(tmp_path)
    assert process.returncode == 1
    assert "failed hidden: drawing the bag:" in process.stdout
    assert "Traceback" not in process.stdout + process.stderr


@pytest.mark.usefixtures("demo_modules", "ros_domain")
def test_an_error_of_a_process_shows_the_end_of_its_log(tmp_path):
    from failure import DemoError
    from processes import NodeProcess

    def check_until_the_deadline():
        deadline = time.monotonic() + TIMEOUT
        while time.monotonic() < deadline:
            process.check()

    with NodeProcess("replay", tmp_path / "replay.log", source="/nowhere/at_all") as process:
        with pytest.raises(DemoError, match="`replay` reported an error") as caught:
            check_until_the_deadline()
        assert process.exit_code is None
    assert "there is no /nowhere/at_all" in caught.value.details


@pytest.mark.usefixtures("demo_modules")
def test_a_missing_executable_is_named(tmp_path):
    from failure import DemoError
    from processes import NodeProcess

    with pytest.raises(DemoError, match=r"no .*/bin/trackr; `make setup` installs it"):
        NodeProcess("trackr", tmp_path / "log")


@pytest.mark.usefixtures("ros_domain")
def test_a_tracker_is_met_that_hears_late_of_who_takes_its_overlay(monkeypatch, tmp_path):
    monkeypatch.syspath_prepend(DEMO)
    from processes import NodeProcess
    from recording import _TOPICS_OF_ALL, OVERLAY, STATUS, Recorder

    with Recorder() as recorder, NodeProcess("tracker", tmp_path / "log") as tracker:
        node = recorder._node
        (overlay,) = [one for one in node.subscriptions if one.topic_name == OVERLAY]
        node.destroy_subscription(overlay)
        late = []

        def listen_once_the_tracker_has_answered():
            tracker.check()
            if recorder.messages[STATUS] and not late:
                image, _ = _TOPICS_OF_ALL[OVERLAY]
                keep = recorder._keep(OVERLAY)
                late.append(node.create_subscription(image, OVERLAY, keep, 10, raw=True))

        assert recorder.meet_tracker(30.0, listen_once_the_tracker_has_answered)
        assert late
