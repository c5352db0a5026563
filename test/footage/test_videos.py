import cv2
import numpy as np
import pytest

from pf_tracker_ros.footage import FootageError, open_footage
from pf_tracker_ros.footage.videos import VideoFootage


def test_frames_come_in_order_and_unchanged(tmp_path, pictures, write_video):
    footage = open_footage(write_video(tmp_path / "noise.avi", pictures))
    frames = list(footage.frames())
    assert len(frames) == len(pictures) == footage.frame_count
    for frame, picture in zip(frames, pictures, strict=True):
        np.testing.assert_array_equal(frame.image, picture)


def test_stamps_follow_the_frame_rate_of_the_file_from_one_second(tmp_path, pictures, write_video):
    footage = open_footage(write_video(tmp_path / "noise.avi", pictures, rate=50.0))
    assert footage.nominal_interval == pytest.approx(0.02)
    assert [frame.stamp for frame in footage.frames()] == [
        1_000_000_000,
        1_020_000_000,
        1_040_000_000,
        1_060_000_000,
        1_080_000_000,
    ]


def test_each_reading_starts_from_the_first_frame(tmp_path, pictures, write_video):
    footage = open_footage(write_video(tmp_path / "noise.avi", pictures))
    next(footage.frames())
    first, second = list(footage.frames()), list(footage.frames())
    assert [frame.stamp for frame in first] == [frame.stamp for frame in second]
    np.testing.assert_array_equal(first[0].image, second[0].image)


def test_a_stretch_begins_at_its_frame_with_the_first_stamp(tmp_path, pictures, write_video):
    path = write_video(tmp_path / "noise.avi", pictures)
    frames = list(VideoFootage(path, first_frame=2, frame_count=2).frames())
    assert frames[0].stamp == 1_000_000_000
    assert len(frames) == 2
    np.testing.assert_array_equal(frames[0].image, pictures[2])
    np.testing.assert_array_equal(frames[1].image, pictures[3])


@pytest.mark.parametrize(("first_frame", "frame_count"), [(3, 3), (9, 1)])
def test_a_stretch_past_the_end_is_refused(
    tmp_path, pictures, write_video, first_frame, frame_count
):
    path = write_video(tmp_path / "noise.avi", pictures)
    footage = VideoFootage(path, first_frame=first_frame, frame_count=frame_count)
    with pytest.raises(FootageError, match=rf"{frame_count} frames expected.*could be decoded"):
        list(footage.frames())


def test_a_file_that_is_no_video_is_refused(tmp_path):
    path = tmp_path / "notes.txt"
    path.write_text("nothing to see")
    with pytest.raises(FootageError, match=r"notes\.txt is not a video.*accepted are"):
        open_footage(path)


def test_a_truncated_video_is_refused(tmp_path, pictures):
    path = tmp_path / "cut.mp4"
    codec = cv2.VideoWriter_fourcc(*"mp4v")
    writer = cv2.VideoWriter(str(path), codec, 25.0, (32, 24))
    for picture in pictures:
        writer.write(picture)
    writer.release()
    path.write_bytes(path.read_bytes()[:300])
    with pytest.raises(FootageError, match=r"cut\.mp4"):
        open_footage(path)
