"""Bag readers, and the advice for truncated bags."""

import sys
from types import ModuleType, SimpleNamespace

import pytest

from pf_tracker_ros.footage import FootageError, open_bag, open_footage

IMAGE = "sensor_msgs/msg/Image"
POLYGON = "geometry_msgs/msg/PolygonStamped"


class DocumentedRosbag2(ModuleType):
    """A stand-in for `rosbag2_py`, which is on no package index: its documented interface.

    It has one bag in memory and records how it is opened.
    """

    def __init__(self, topics, messages, compression_format="", paths=()):
        super().__init__("rosbag2_py")
        self.opened = opened = []
        infos = [
            SimpleNamespace(topic_metadata=SimpleNamespace(name=name, type=kind), message_count=n)
            for name, kind, n in topics
        ]
        metadata = SimpleNamespace(
            topics_with_message_count=infos,
            compression_format=compression_format,
            relative_file_paths=list(paths),
        )

        class Reader:
            def open(self, storage, converter):
                assert converter == ("cdr", "cdr")
                assert isinstance(storage.uri, str)
                opened.append((type(self).__name__, storage.uri, storage.storage_id))
                self.left = list(messages)

            def get_metadata(self):
                return metadata

            def set_filter(self, storage_filter):
                self.left = [row for row in self.left if row[0] in storage_filter.topics]

            def has_next(self):
                return bool(self.left)

            def read_next(self):
                row = self.left.pop(0)
                if isinstance(row[1], Exception):
                    raise row[1]
                return row

        self.StorageOptions = self.StorageFilter = SimpleNamespace
        self.ConverterOptions = lambda input_format, output_format: (input_format, output_format)
        self.MetadataIo = lambda: SimpleNamespace(read_metadata=lambda uri: metadata)
        self.SequentialReader = type("SequentialReader", (Reader,), {})
        self.SequentialCompressionReader = type("SequentialCompressionReader", (Reader,), {})


TOPICS = [("/eye/image", IMAGE, 1), ("/eye/image", IMAGE, 1), ("/eye/ground_truth", POLYGON, 1)]


@pytest.fixture
def messages(make_message):
    return [
        ("/eye/image", make_message(IMAGE, 10), 17),
        ("/eye/image", make_message(IMAGE, 20), 27),
        ("/eye/ground_truth", make_message(POLYGON, 20), 28),
    ]


@pytest.fixture
def bag_folder(tmp_path):
    (tmp_path / "talk").mkdir()
    (tmp_path / "talk" / "metadata.yaml").touch()
    return tmp_path / "talk"


def test_rosbag2_py_is_preferred(bag_folder, messages, monkeypatch):
    library = DocumentedRosbag2(TOPICS, messages)
    monkeypatch.setitem(sys.modules, "rosbag2_py", library)
    bag = open_bag(bag_folder)
    assert (bag.image_topic, bag.image_type, bag.image_count) == ("/eye/image", IMAGE, 2)
    assert bag.ground_truth_topic == "/eye/ground_truth"
    images = list(bag.images())
    assert [(image.stamp, image.log_time) for image in images] == [(10, 17), (20, 27)]
    assert [image.message for image in images] == [row[1] for row in messages[:2]]
    assert [image.ground_truth for image in images] == [None, messages[2][1]]
    assert list(bag.images()) == images
    assert set(library.opened) == {("SequentialReader", str(bag_folder), "")}


@pytest.mark.parametrize(
    "case",
    [
        ("talk.mcap", "", ("SequentialReader", "mcap")),
        ("talk.db3", "", ("SequentialReader", "sqlite3")),
        ("talk", "zstd", ("SequentialCompressionReader", "")),
    ],
)
def test_rosbag2_py_receives_the_storage_of_a_file_and_decompresses(
    bag_folder, messages, monkeypatch, case
):
    name, compression, opened = case
    library = DocumentedRosbag2(TOPICS, messages, compression_format=compression)
    monkeypatch.setitem(sys.modules, "rosbag2_py", library)
    path = bag_folder.with_name(name)
    path.touch()
    assert len(list(open_bag(path).images())) == 2
    assert set(library.opened) == {(opened[0], str(path), opened[1])}


@pytest.mark.parametrize("name", ["../other.mcap", "/etc/passwd"])
def test_a_bag_that_names_a_file_elsewhere_is_refused(bag_folder, messages, monkeypatch, name):
    library = DocumentedRosbag2(TOPICS, messages, paths=["talk_0.mcap", name])
    monkeypatch.setitem(sys.modules, "rosbag2_py", library)
    with pytest.raises(FootageError, match=f"the file {name}, which is not in its folder"):
        open_bag(bag_folder)


def test_errors_of_rosbag2_py_become_footage_errors(bag_folder, messages, monkeypatch):
    broken = [messages[0], ("/eye/image", RuntimeError("No storage\nat all"), 0)]
    monkeypatch.setitem(sys.modules, "rosbag2_py", DocumentedRosbag2(TOPICS[:1], broken))
    images = open_bag(bag_folder).images()
    next(images)
    with pytest.raises(FootageError, match=r"talk cannot be read \(No storage\); accepted are"):
        next(images)


@pytest.mark.parametrize("missing", ["rosbags", "rosbags.rosbag2"])
def test_without_any_reader_both_packages_are_named(bag_folder, monkeypatch, missing):
    monkeypatch.setitem(sys.modules, "rosbag2_py", None)
    monkeypatch.delitem(sys.modules, "rosbags.rosbag2", raising=False)
    monkeypatch.setitem(sys.modules, missing, None)
    with pytest.raises(FootageError, match=r"ros-jazzy-rosbag2-py.*pip install rosbags\)$"):
        open_bag(bag_folder)


@pytest.fixture
def recording(tmp_path, write_bag, make_message):
    rows = [("/image", IMAGE, stamp, make_message(IMAGE, stamp)) for stamp in range(1, 50)]
    return write_bag(tmp_path / "talk", rows)


@pytest.mark.parametrize("kept", [9, 0.5, 0.99])
def test_the_error_of_a_truncated_mcap_file_has_the_recovery(recording, kept):
    path = recording / "talk.mcap"
    content = path.read_bytes()
    path.write_bytes(content[: kept if kept > 1 else int(kept * len(content))])
    with pytest.raises(FootageError, match=r"truncated.*`mcap recover talk\.mcap") as error:
        open_bag(path)
    assert "reindex" not in str(error.value)
    with pytest.raises(FootageError, match=r"`mcap recover talk\.mcap.*`ros2 bag reindex talk`"):
        open_bag(recording)
    (recording / "metadata.yaml").unlink()
    with pytest.raises(FootageError, match=r"no metadata\.yaml.*mcap recover.*bag reindex talk`"):
        open_footage(recording)


def test_other_damage_is_not_called_truncated(recording):
    path = recording / "talk.mcap"
    content = bytearray(path.read_bytes())
    content[20:-8] = bytes(len(content) - 28)
    path.write_bytes(content)
    for bag in (path, recording):
        with pytest.raises(FootageError, match="accepted are rosbag2 folders") as error:
            list(open_bag(bag).images())
        assert "recover" not in str(error.value)
