import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pf_tracker_ros.frames import Frame
from pf_tracker_ros.stamps import NANOSECONDS
from pf_tracker_ros.tracking.frame_history import FrameHistory

IMAGE = np.zeros((10, 100), np.uint8)
# No whole number of tenths of a second.
FIRST = 1_234_567_890_123_456_789
SHAPES = {"1080p": (1080, 1920, 3), "4K": (2160, 3840, 3)}


def filled(image, count, rate=30.0, frames=120, megabytes=64.0):
    """A history that has seen copies of an image, and their stamps."""
    history, stamps = FrameHistory(frames, megabytes), []
    for index in range(count):
        stamps.append(FIRST + round(index * NANOSECONDS / rate))
        history.add(image.copy(), stamps[-1])
    return history, stamps


def held(history):
    """Bytes of what is kept, as it is kept."""
    return sum(
        (frame.image if isinstance(frame, Frame) else frame.pixels).nbytes
        for frame in history.since(0)
    )


def test_the_newest_frames_are_kept_up_to_their_number():
    history = FrameHistory(frames=3, megabytes=1.0)
    for stamp in range(1, 6):
        history.add(IMAGE, stamp)
    assert history.stamps == [3, 4, 5]
    assert [frame.stamp for frame in history.since(4)] == [4, 5]
    assert history.since(6) == []


def test_the_newest_frames_are_kept_up_to_their_bytes():
    history = FrameHistory(frames=100, megabytes=0.0025)
    for stamp in range(1, 6):
        history.add(IMAGE, stamp)
    assert history.stamps == [4, 5]
    history.limit(100, 0.0015)
    assert history.stamps == [5]
    history.limit(100, 0.0005)
    history.add(IMAGE, 6)
    assert history.stamps == []


def test_an_image_counts_with_all_the_data_that_it_holds():
    history = FrameHistory(frames=100, megabytes=0.0025)
    for stamp in range(1, 6):
        # A pixel a row, and the rest of the data is padding, as a message may have it.
        padded = np.frombuffer(bytes(1000), np.uint8).reshape(10, 100)
        history.add(padded[:, :1], stamp)
    assert history.stamps == [4, 5]


def test_of_two_frames_with_one_stamp_the_first_is_kept():
    history = FrameHistory(frames=10, megabytes=1.0)
    history.add(IMAGE, 1)
    history.add(IMAGE, 2)
    history.add(IMAGE + 1, 2)
    assert history.stamps == [1, 2]
    assert np.array_equal(history.since(2)[0].image, IMAGE)


def test_time_that_goes_back_and_images_of_another_kind_begin_a_history():
    for image, stamp in ((IMAGE, 1), (IMAGE[:5], 2), (IMAGE[:5], 3), (IMAGE.astype(np.uint16), 3)):
        history = FrameHistory(frames=10, megabytes=1.0)
        history.add(IMAGE, 1)
        history.add(IMAGE, 2)
        history.add(image, stamp)
        assert history.stamps == [stamp]


def test_frames_that_nobody_can_name_are_not_kept():
    history = FrameHistory(frames=10, megabytes=1.0)
    history.add(IMAGE, 0)
    assert history.stamps == []
    FrameHistory().add(IMAGE, 1)


# Frames that are too large for all to be kept


@pytest.mark.parametrize("size", ["1080p", "4K"])
def test_large_frames_of_two_seconds_are_kept_thinned_out(size):
    history, stamps = filled(np.zeros(SHAPES[size], np.uint8), 90)
    assert set(history.stamps) <= set(stamps)
    assert history.stamps[-1] == stamps[-1]
    assert 2 * NANOSECONDS <= stamps[-1] - history.stamps[0] <= 2.3 * NANOSECONDS
    assert np.diff(history.stamps).max() <= 0.14 * NANOSECONDS
    assert held(history) <= 64e6
    # Whatever a box was drawn on in two seconds, a frame from no more than 0.07 s off is there.
    for stamp in stamps[30:]:
        assert abs(history.since(stamp)[0].stamp - stamp) <= 0.07 * NANOSECONDS


def test_the_newest_of_large_frames_are_the_images_themselves():
    history, images = FrameHistory(120, 64.0), []
    for index in range(90):
        images.append(np.zeros(SHAPES["1080p"], np.uint8))
        history.add(images[-1], FIRST + round(index * NANOSECONDS / 30))
        images = images[-4:]
    kept = history.since(0)[-4:]
    assert [frame.image is image for frame, image in zip(kept, images, strict=True)] == [True] * 4


@pytest.mark.parametrize("shape", [(90, 160, 3), (91, 163, 3), (93, 161)])
@pytest.mark.parametrize("dtype", [np.uint8, np.uint16, np.float32])
def test_a_frame_that_was_reduced_looks_as_it_did_at_every_place(shape, dtype):
    if len(shape) == 3 and dtype != np.uint8:
        shape = shape[:2]
    coarse = np.random.default_rng(0).uniform(50.0, 200.0, (6, 9, *shape[2:]))
    image = cv2.resize(coarse, shape[1::-1], interpolation=cv2.INTER_CUBIC).astype(dtype)
    history, _ = filled(image, 90, megabytes=30 * image.nbytes / 3 / 1e6)
    for frame in history.since(0):
        assert (frame.image.shape, frame.image.dtype) == (image.shape, image.dtype)
        error = np.abs(frame.image.astype(float) - image)[2:-2, 2:-2]
        assert error.max() < 4.0
    assert not np.array_equal(history.since(0)[0].image, image)


@settings(max_examples=50)
@given(
    st.tuples(st.integers(1, 60), st.integers(1, 60)),
    st.floats(1.0, 100.0),
    st.floats(2.0, 120.0),
    st.integers(1, 150),
)
def test_whatever_the_images_and_bounds_the_newest_is_kept_and_the_bounds_hold(
    shape, images_worth, rate, frames
):
    image = np.zeros(shape, np.uint8)
    megabytes = images_worth * image.nbytes / 1e6 * (1 + 1e-9)
    history, stamps = filled(image, 160, rate, frames, megabytes)
    kept = history.since(0)
    assert history.stamps == sorted(set(history.stamps))
    assert history.stamps[-1] == stamps[-1]
    assert kept[-1].image.nbytes == image.nbytes
    assert len(kept) <= frames
    assert held(history) <= megabytes * 1e6
    # What was dropped with all before it is older than what is kept.
    assert history.dropped_until < history.stamps[0]
    history.limit(1, megabytes)
    assert history.stamps == stamps[-1:]
    assert history.dropped_until < stamps[-1]


def test_frames_that_fit_are_kept_in_full_however_old():
    image = np.zeros((48, 64), np.uint8)
    history, stamps = filled(image, 50, rate=5.0, megabytes=1.0)
    assert history.stamps == stamps
    assert all(frame.image.nbytes == image.nbytes for frame in history.since(0))


def test_the_nearest_frame_stands_in_for_one_that_is_not_there():
    history = FrameHistory(frames=10, megabytes=1.0)
    for stamp in (100, 200, 300):
        history.add(IMAGE, stamp)
    firsts = {stamp: history.since(stamp)[0].stamp for stamp in (1, 100, 149, 150, 151, 260, 300)}
    assert firsts == {1: 100, 100: 100, 149: 100, 150: 200, 151: 200, 260: 300, 300: 300}
    assert history.since(301) == []
