"""Runs the command `track` in this process or another one; recordings and detections for it."""

import contextlib
import io
import shutil
from functools import partial
from pathlib import Path

import numpy as np
import pytest
from archives import TARGET
from common import QUICK, one_sentence, read_boxes, run_command, two_walkers
from make_vision_msgs import DEFINITIONS
from subprocesses import wait_until

from pf_tracker_ros import Detections
from pf_tracker_ros.frames import Frame
from pf_tracker_ros.recordings.__main__ import main
from pf_tracker_ros.recordings.archives import executors, results
from pf_tracker_ros.targets.session import Session
from pf_tracker_ros.tracking.presets import preset_parameters

_INTERVAL = 40_000_000
_NAMES = ("x", "y", "width", "height")


@pytest.fixture
def track(capsys):
    """Runs the command in this process; returns its exit code, output and errors."""

    def run(*arguments):
        return run_command(main, arguments, capsys)

    return run


@pytest.fixture
def refusal(track, tmp_path):
    """Runs the command, which must refuse and write nothing into a folder `out`; its error."""

    def run(*arguments, expected=2):
        code, said, errors = track(*arguments, "--output", tmp_path / "out")
        assert (code, said) == (expected, ""), errors
        assert not (tmp_path / "out").exists()
        return one_sentence(errors)

    return run


@pytest.fixture
def start_track(start_module):
    """Starts the command as a process, which is killed after the test."""
    return partial(start_module, "recordings")


@pytest.fixture
def write_images_bag(make_image_message, write_bag, tmp_path):
    """Writes images at their stamps into a bag, in the given order."""

    def write(name, images, order=None, storage="MCAP", *, interval=_INTERVAL):
        order = range(len(images)) if order is None else order
        messages = [
            ("/eye", "sensor_msgs/msg/Image", 2 * 10**9 + position,
             make_image_message(10**9 + index * interval, images[index]))
            for position, index in enumerate(order)
        ]  # fmt: skip
        return write_bag(tmp_path / name, messages, storage)

    return write


@pytest.fixture(scope="session")
def long_sequence(write_sequence_in, walk, tmp_path_factory):
    """The moving square there and back, for a thousand frames; not to change."""
    return write_sequence_in(tmp_path_factory.mktemp("shared"), "walk", *walk(1000))


@pytest.fixture(scope="session")
def archive(write_sequence_in, moving_square, tmp_path_factory):
    """Ten recordings and three that are broken, each in another way; the folder, not to change."""
    folder = tmp_path_factory.mktemp("shared") / "archive"
    sequence = (moving_square.images, moving_square.boxes)
    for number in range(10):
        write_sequence_in(folder / f"day_{number % 2}", f"drive_{number}", *sequence)
    images = write_sequence_in(folder, "pictures", *sequence)
    (images / "img").rename(folder / "shots")
    shutil.rmtree(images)
    (folder / "shots.target.yaml").write_text(TARGET.replace("20, 30", "900, 30"))
    (folder / "noise.mp4").write_bytes(b"\x00no video")
    (folder / "noise.target.yaml").write_text(TARGET)
    broken = write_sequence_in(folder, "broken", *sequence)
    (broken / "img" / "0013.png").write_bytes(b"no picture")
    return folder


@pytest.fixture
def own_archive(archive, tmp_path):
    """A copy of the archive, to be changed."""
    return Path(shutil.copytree(archive, tmp_path / "archive"))


@pytest.fixture(scope="session")
def serial(archive, tmp_path_factory):
    """The archive tracked by one process: the folder of the results, and what `track` returned."""
    output = tmp_path_factory.mktemp("shared") / "serial"
    with (
        contextlib.redirect_stdout(io.StringIO()) as said,
        contextlib.redirect_stderr(io.StringIO()) as errors,
    ):
        code = main(["--archive", str(archive), "--output", str(output), *QUICK])
    return output, (code, said.getvalue(), errors.getvalue())


@pytest.fixture
def memory(monkeypatch):
    """An empty store in memory that takes results."""
    fsspec = pytest.importorskip("fsspec")
    monkeypatch.setattr(results, "_OBJECT_STORES", ("memory",))
    store = fsspec.filesystem("memory")
    store.store.clear()
    store.pseudo_dirs[:] = [""]
    yield store
    store.store.clear()


@pytest.fixture
def in_this_process(monkeypatch):
    """Archives are tracked in this process, not in workers."""

    def run(work, tasks, processes):
        for number, task in enumerate(tasks):
            yield number, work(task)

    monkeypatch.setattr(executors, "run_parallel", run)


@pytest.fixture
def wait_for_rows():
    """Waits until a process has written more than so many rows of boxes.csv into its draft."""

    def wait(process, output, count):
        def is_written():
            assert process.poll() is None, process.communicate()
            drafts = output.glob(".track_*/boxes.csv")
            return any(path.read_bytes().count(b"\n") > count for path in drafts)

        wait_until(is_written)

    return wait


@pytest.fixture(scope="session")
def walkers():
    """(images, boxes (frames, 2, 4)) of two colored walkers on a textured ground."""
    return two_walkers(160, 240, (20, 100), 180)


@pytest.fixture
def source(walkers, write_sequence):
    """The walkers as a folder of images, without any truth."""
    images, boxes = walkers
    return write_sequence("walkers", images, np.array(boxes)[:, 0]) / "img"


@pytest.fixture
def write_detections(walkers, tmp_path):
    """Writes a detection file with the first `count` walkers in some frames."""

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
    """The results of the library for the walkers.

    Attributes:
        boxes: (frames, 2, 4) true boxes.
    """

    def __init__(self, images, boxes):
        self.boxes = boxes
        self._images = images

    @staticmethod
    def at(number):
        """The stamp of a frame."""
        return 10**9 + number * _INTERVAL

    @staticmethod
    def target_rows(rows):
        """Rows of boxes.csv with targets, as values."""
        return [
            (int(row["frame"]), int(row["stamp"]), int(row["id"]), *(float(row[n]) for n in _NAMES),
             row["state"], float(row["confidence"]))
            for row in rows if row["id"]
        ]  # fmt: skip

    def detections(self, number):
        """The detections in a frame."""
        return Detections(self.boxes[number], [0.9, 0.9], ["walker"] * 2)

    def track(self, boxes=(), arrivals=None, seed=0):
        """The rows for boxes in the first frame and detections.

        `arrivals` maps a frame to the detections that arrive before it, each with its own frame.
        """
        session = Session(preset_parameters("li2007", 32), seed)
        session.frame_buffer.limit(120, 64.0)
        found = []
        for number, image in enumerate(self._images):
            for detections, frame in (arrivals or {}).get(number, ()):
                session.add_detections(detections, self.at(frame))
            for box in boxes if number == 0 else ():
                session.request(box, self.at(0))
            found += [
                (number, self.at(number), target.id, *target.estimate.box, target.estimate.state,
                 target.estimate.confidence)
                for target in session.process(Frame(image, self.at(number))).targets
            ]  # fmt: skip
        return found


@pytest.fixture
def library(walkers):
    """The results of the library for the walkers."""
    return Library(*walkers)


@pytest.fixture
def tracked(track, tmp_path):
    """Runs the command, as `Library`, into a folder `out`; its exit code, errors and rows."""

    def run(*arguments):
        code, _, errors = track(*arguments, "--preset", "li2007", "--output", tmp_path / "out")
        return code, errors, read_boxes(tmp_path / "out")

    return run


@pytest.fixture
def vision(typestore):
    """The message types of rosbags with those of vision_msgs."""
    from rosbags.typesys import Stores, get_types_from_msg, get_typestore

    store = get_typestore(Stores.ROS2_JAZZY)
    types = {}
    for name, text in DEFINITIONS.items():
        types |= get_types_from_msg(text, f"vision_msgs/msg/{name}")
    store.register(types)
    return store


@pytest.fixture
def detections_message(vision):
    """Serializes detections as a vision_msgs/Detection2DArray, without the code under test."""

    def new(name, package="vision_msgs", **fields):
        return vision.types[f"{package}/msg/{name}"](**fields)

    def make(stamp, boxes, *, little_endian=True):
        seconds, nanoseconds = divmod(stamp, 10**9)
        time = new("Time", "builtin_interfaces", sec=seconds, nanosec=nanoseconds)
        header = new("Header", "std_msgs", stamp=time, frame_id="lens")
        place = new("Point", "geometry_msgs", x=0.0, y=0.0, z=0.0)
        turn = new("Quaternion", "geometry_msgs", x=0.0, y=0.0, z=0.0, w=1.0)
        pose = new("Pose", "geometry_msgs", position=place, orientation=turn)
        pose = new("PoseWithCovariance", "geometry_msgs", pose=pose, covariance=np.zeros(36))
        detections = []
        for number, (x, y, width, height) in enumerate(boxes):
            results = [
                new("ObjectHypothesisWithPose", pose=pose,
                    hypothesis=new("ObjectHypothesis", class_id=label, score=score))
                for label, score in (("tree", 0.1), ("walker", 0.9))
            ]  # fmt: skip
            point = new("Point2D", x=x + width / 2, y=y + height / 2)
            center = new("Pose2D", position=point, theta=0.0)
            box = new("BoundingBox2D", center=center, size_x=width, size_y=height)
            detections.append(
                new("Detection2D", header=header, results=results, bbox=box, id="x" * number)
            )
        message = new("Detection2DArray", header=header, detections=detections)
        kind = "vision_msgs/msg/Detection2DArray"
        return bytes(vision.serialize_cdr(message, kind, little_endian=little_endian))

    return make


@pytest.fixture
def write_walkers(walkers, vision, make_image_message, write_bag, tmp_path):
    """Writes a bag of the walkers and of messages of a detector (log time, octets)."""

    def write(messages, kind="vision_msgs/msg/Detection2DArray"):
        rows = [("/found", kind, log_time, octets) for log_time, octets in messages]
        for number, image in enumerate(walkers[0]):
            stamp = Library.at(number)
            octets = make_image_message(stamp, image)
            rows.append(("/eye", "sensor_msgs/msg/Image", stamp + 1000, octets))
        rows.sort(key=lambda row: (row[2], row[0] == "/eye"))
        return write_bag(tmp_path / "drive", rows, types=vision)

    return write
