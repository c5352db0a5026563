import contextlib
import tempfile
from pathlib import Path

import pytest

from pf_tracker_ros.footage import FootageError, bag_reading, is_bag, open_bag

IMAGE = "sensor_msgs/msg/Image"
COMPRESSED = "sensor_msgs/msg/CompressedImage"
POLYGON = "geometry_msgs/msg/PolygonStamped"

KINDS = [
    ("SQLITE3", "NONE"),
    ("SQLITE3", "FILE"),
    ("SQLITE3", "MESSAGE"),
    ("MCAP", "NONE"),
    ("MCAP", "FILE"),
    ("MCAP", "MESSAGE"),
    ("MCAP", "STORAGE"),
]


@pytest.fixture
def rows(make_message):
    """Three images, recorded 7 ns after their stamps, with boxes for the first and the last."""
    stamps = [2_000_000_000, 2_100_000_000, 2_200_000_000]
    images = [("/eye/image", IMAGE, stamp + 7, make_message(IMAGE, stamp)) for stamp in stamps]
    boxes = [
        ("/eye/ground_truth", POLYGON, stamp + 9, make_message(POLYGON, stamp))
        for stamp in (stamps[0], stamps[2])
    ]
    other = make_message(POLYGON, stamps[0])
    return [*images, *boxes, ("/eye/area", POLYGON, stamps[0], other)]


@pytest.fixture
def write_rows(tmp_path, write_bag, rows):
    """Writes these and further rows into a bag."""
    return lambda *further: write_bag(tmp_path / "talk", [*rows, *further])


@pytest.mark.parametrize(("storage", "compression"), KINDS)
def test_every_kind_of_bag_keeps_its_bytes(tmp_path, write_bag, rows, storage, compression):
    path = write_bag(tmp_path / "talk", rows, storage, compression)
    bag = open_bag(path)
    assert (bag.image_topic, bag.image_type, bag.image_count) == ("/eye/image", IMAGE, 3)
    images = list(bag.images())
    assert [image.message for image in images] == [row[3] for row in rows[:3]]
    assert [image.log_time for image in images] == [row[2] for row in rows[:3]]
    assert [image.stamp for image in images] == [2_000_000_000, 2_100_000_000, 2_200_000_000]
    assert list(bag.images()) == images


@pytest.mark.parametrize("compression", ["NONE", "STORAGE", "MESSAGE"])
def test_a_bare_mcap_file_is_enough_unless_compressed(tmp_path, write_bag, rows, compression):
    folder = write_bag(tmp_path / "talk", rows, "MCAP", compression)
    (folder / "metadata.yaml").unlink()
    path = folder / "talk.mcap"
    assert is_bag(path)
    if compression == "MESSAGE":
        with pytest.raises(FootageError, match="give the rosbag2 folder"):
            list(open_bag(path).images())
    else:
        assert [image.message for image in open_bag(path).images()] == [row[3] for row in rows[:3]]


def test_ground_truth_is_found_or_named_and_matched_by_stamp(tmp_path, write_bag, rows):
    path = write_bag(tmp_path / "talk", rows)
    bag = open_bag(path)
    assert bag.ground_truth_topic == "/eye/ground_truth"
    assert [image.ground_truth for image in bag.images()] == [rows[3][3], None, rows[4][3]]
    bag = open_bag(path, ground_truth_topic="/eye/area")
    assert [image.ground_truth is None for image in bag.images()] == [False, True, True]
    with pytest.raises(FootageError, match=r"no topic /eye/image of type geometry_msgs.*eye/area"):
        open_bag(path, ground_truth_topic="/eye/image")


@pytest.mark.parametrize(
    ("topic", "kind", "reason"),
    [
        ("/ear/ground_truth", POLYGON, r"choose one: /ear/ground_truth, /eye/ground"),
        ("/ear/image/compressed", COMPRESSED, "choose one: /ear/image/compressed, /eye/image"),
        # It is chosen by its name alone.
        ("/depth/image/compressed", COMPRESSED, ""),
    ],
)
def test_an_ambiguous_topic_is_refused(write_rows, make_message, topic, kind, reason):
    path = write_rows((topic, kind, 5, make_message(kind, 5)))
    if reason:
        with pytest.raises(FootageError, match=reason):
            open_bag(path)
    else:
        assert open_bag(path).image_topic == "/eye/image"
    if kind == COMPRESSED:
        assert open_bag(path, topic).image_type == COMPRESSED
        assert len(list(open_bag(path, "/eye/image").images())) == 3


def test_a_topic_or_a_bag_without_images_is_refused(tmp_path, write_bag, rows):
    for topic in ("/eye/area", "/nose"):
        reason = f"no image topic {topic}; image topics are: /eye/image"
        with pytest.raises(FootageError, match=reason):
            open_bag(write_bag(tmp_path / topic[1:3], rows), topic)
    path = write_bag(tmp_path / "blind", rows[-1:])
    with pytest.raises(FootageError, match=r"no topic of type .*there are: /eye/area \(geometry_"):
        open_bag(path)


@pytest.mark.parametrize("storage", ["SQLITE3", "MCAP"])
def test_a_topic_without_messages_is_refused(tmp_path, write_bag, rows, storage):
    path = write_bag(tmp_path / "talk", [("/image", IMAGE, 0, None), rows[-1]], storage)
    with pytest.raises(FootageError, match="no message on topic /image"):
        list(open_bag(path).images())


@pytest.mark.parametrize("kind", [KINDS[0], KINDS[3], KINDS[4]])
@pytest.mark.parametrize("damage", ["cut", "garbage", "empty", "gone"])
def test_a_damaged_bag_is_refused(tmp_path, write_bag, rows, kind, damage):
    path = write_bag(tmp_path / "talk", rows, *kind)
    (data,) = (entry for entry in path.iterdir() if entry.name != "metadata.yaml")
    content = data.read_bytes()
    if damage == "gone":
        data.unlink()
    else:
        damaged = {"cut": content[: len(content) // 3], "garbage": b"?" * len(content)}
        data.write_bytes(damaged.get(damage, b""))
    with pytest.raises(FootageError, match="talk"):
        list(open_bag(path).images())


@pytest.mark.parametrize("content", ["", "{", "rosbag2_bagfile_information: 3", "- 1"])
def test_damaged_metadata_is_refused(tmp_path, write_bag, rows, content):
    path = write_bag(tmp_path / "talk", rows)
    (path / "metadata.yaml").write_text(content)
    with pytest.raises(FootageError, match=r"talk cannot be read .*accepted are rosbag2 folders"):
        open_bag(path)


def test_a_message_that_is_not_cdr_is_refused(tmp_path, write_bag):
    path = write_bag(tmp_path / "talk", [("/image", IMAGE, 5, b"\xff\xff\xff\xff" + bytes(20))])
    with pytest.raises(FootageError, match="is not CDR"):
        list(open_bag(path).images())


def open_files(folder):
    """Files of a folder that this process has open."""
    links = Path("/proc/self/fd").iterdir()
    paths = (path for link in links for path in [_target(link)] if path.is_relative_to(folder))
    return sorted(path.name for path in paths)


def _target(link):
    # The descriptor of the listing itself is closed by now.
    with contextlib.suppress(OSError):
        return link.readlink()
    return link


def noting(function, results):
    """Wrap a function to append its results to a list."""

    def call(*arguments):
        results.append(function(*arguments))
        return results[-1]

    return call


@pytest.mark.skipif(not Path("/proc/self/fd").is_dir(), reason="only Linux tells the open files")
@pytest.mark.parametrize("kind", KINDS)
def test_reading_that_ends_early_closes_its_files(tmp_path, write_bag, rows, monkeypatch, kind):
    bag = open_bag(write_bag(tmp_path / "talk", rows, *kind))
    # A bag compressed by file is read from a copy in the folder for temporary files.
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    before = sorted(tmp_path.rglob("*"))
    # References, or garbage collection of the readers would close their files.
    readers = []
    monkeypatch.setattr(bag_reading, "_open", noting(bag_reading._open, readers))
    images = bag.images()
    first = next(images)
    assert readers
    assert open_files(tmp_path)
    images.close()
    assert open_files(tmp_path) == []
    assert sorted(tmp_path.rglob("*")) == before
    assert next(bag.images()) == first
