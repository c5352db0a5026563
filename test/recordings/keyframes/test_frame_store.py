import numpy as np
import pytest

from pf_tracker_ros.recordings.errors import DISK_FULL, RecordingError
from pf_tracker_ros.recordings.keyframes.frame_store import FrameStore


@pytest.fixture
def store():
    """A store with memory for two images of `images`."""
    made = FrameStore(limit=2 * 4 * 5 * 3)
    yield made
    made.close()


@pytest.fixture
def images(noise):
    return [noise(4, 5, seed=seed) for seed in range(6)]


def test_images_beyond_the_limit_come_back_from_the_file(store, images, noise):
    deep = noise(4, 5, 1, kind=np.uint16)
    for frame, image in enumerate([*images, deep]):
        store.add(frame, image)
    for frame, image in reversed([*enumerate([*images, deep])]):
        np.testing.assert_array_equal(store.find(frame), image)
        assert store.find(frame).dtype == image.dtype


def test_discarded_images_make_room(store, images):
    for frame, image in enumerate(images):
        store.add(frame, image)
        store.discard(frame - 2)
    assert store.find(3) is None
    np.testing.assert_array_equal(store.find(4), images[4])
    np.testing.assert_array_equal(store.find(5), images[5])


def test_the_file_is_reused(store, images):
    for turn in range(3):
        for frame, image in enumerate(images):
            store.add(10 * turn + frame, image)
        for frame, image in enumerate(images):
            np.testing.assert_array_equal(store.find(10 * turn + frame), image)
            store.discard(10 * turn + frame)


def test_a_full_disk_is_told(store, images, monkeypatch):
    def fail(*arguments, **options):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("tempfile.TemporaryFile", fail)
    store.add(0, images[0])
    store.add(1, images[1])
    with pytest.raises(RecordingError, match="set TMPDIR") as refusal:
        store.add(2, images[2])
    assert refusal.value.exit_code == DISK_FULL
