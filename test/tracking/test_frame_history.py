import numpy as np

from pf_tracker_ros.tracking.frame_history import FrameHistory

IMAGE = np.zeros((10, 100), np.uint8)


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


def test_time_that_goes_back_and_images_of_another_kind_begin_a_history():
    for image, stamp in ((IMAGE, 2), (IMAGE, 1), (IMAGE[:5], 3), (IMAGE.astype(np.uint16), 3)):
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
