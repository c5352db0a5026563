import itertools

import numpy as np
import pytest

from pf_tracker_ros.footage import FootageError, open_footage
from pf_tracker_ros.footage.videos import VideoFootage


def test_each_reading_has_all_frames_and_stamps_by_the_frame_rate(tmp_path, pictures, write_video):
    footage = open_footage(write_video(tmp_path / "noise.avi", pictures, rate=50.0))
    assert footage.nominal_interval == pytest.approx(0.02)
    next(footage.frames())
    for _ in range(2):
        frames = list(footage.frames())
        assert len(frames) == len(pictures) == footage.frame_count
        assert [frame.stamp for frame in frames] == [10**9 + n * 20_000_000 for n in range(5)]
        for frame, picture in zip(frames, pictures, strict=True):
            np.testing.assert_array_equal(frame.image, picture)


def test_a_range_begins_at_its_frame_with_the_first_stamp(tmp_path, pictures, write_video):
    path = write_video(tmp_path / "noise.avi", pictures)
    frames = list(VideoFootage(path, first_frame=2, frame_count=2).frames())
    assert frames[0].stamp == 1_000_000_000
    assert len(frames) == 2
    np.testing.assert_array_equal(frames[0].image, pictures[2])
    np.testing.assert_array_equal(frames[1].image, pictures[3])


@pytest.mark.parametrize(("first_frame", "frame_count"), [(3, 3), (9, 1)])
def test_a_range_past_the_end_is_refused(tmp_path, pictures, write_video, first_frame, frame_count):
    path = write_video(tmp_path / "noise.avi", pictures)
    footage = VideoFootage(path, first_frame=first_frame, frame_count=frame_count)
    expected = "1 frame" if frame_count == 1 else f"{frame_count} frames"
    with pytest.raises(FootageError, match=rf"{expected} expected.*could be decoded"):
        list(footage.frames())


# Long enough for FFmpeg to play it as terminal output, given a text's file name.
LONG_TEXT = b"10,20,30,40\n" * 100


@pytest.mark.parametrize(
    ("name", "content"),
    [
        ("notes.txt", b"nothing to see"),
        ("notes.txt", LONG_TEXT),
        ("notes.txt", LONG_TEXT + b"\0"),
        ("notes.nfo", LONG_TEXT.decode().encode("utf-16")),
        ("movie.mp4", LONG_TEXT),
        ("movie.mp4", b"#EXTM3U\n#EXTINF:9,\nhttp://127.0.0.1:9/x.ts\n"),
        ("movie.m3u8", b"\n#EXTM3U\n#\0\n#EXTINF:9,\nnoise.avi\n"),
        ("movie.mp4", b"ffconcat version 1.0\nfile noise.avi\n"),
        ("movie.mp4", b"v=0\nc=IN IP4 127.0.0.1\nm=video 9 RTP/AVP 32\n\0"),
        ("movie.sdp", b"v=0\r\nc=IN IP4 127.0.0.1\r\nm=video 9 RTP/AVP 32\r\n"),
    ],
    ids=itertools.count(),
)
def test_texts_and_playlists_are_not_played(tmp_path, pictures, write_video, name, content):
    write_video(tmp_path / "noise.avi", pictures)
    (tmp_path / name).write_bytes(content)
    with pytest.raises(FootageError, match=rf"{name} is not a video.*: it is a text or a play"):
        open_footage(tmp_path / name)


@pytest.mark.parametrize("name", ["groundtruth.txt", "groundtruth_rect.txt"])
def test_the_error_of_a_ground_truth_file_names_its_folder(tmp_path, name):
    (tmp_path / name).write_bytes(LONG_TEXT)
    with pytest.raises(FootageError, match=rf"{name} is the ground truth.*its folder, {tmp_path}$"):
        open_footage(tmp_path / name)


def test_raw_frames_that_look_like_text_are_a_video(tmp_path):
    picture = b"A" * (96 * 64) + b"B" * (48 * 32 * 2)
    (tmp_path / "dark.y4m").write_bytes(b"YUV4MPEG2 W96 H64 F25:1\n" + b"FRAME\n" + picture)
    (frame,) = open_footage(tmp_path / "dark.y4m").frames()
    assert frame.image.shape == (64, 96, 3)


@pytest.mark.parametrize("name", ["concat:noise.avi", "http:noise.avi"])
def test_a_file_name_is_never_an_address(tmp_path, monkeypatch, pictures, write_video, name):
    write_video(tmp_path / "noise.avi", pictures).rename(tmp_path / name)
    monkeypatch.chdir(tmp_path)
    assert len(list(open_footage(name).frames())) == 5


def test_what_is_no_video_is_refused(tmp_path, pictures, write_video):
    path = write_video(tmp_path / "cut.mp4", pictures, codec="mp4v")
    path.write_bytes(path.read_bytes()[:300])
    with pytest.raises(FootageError, match=r"cut\.mp4 is not a video.*accepted are"):
        open_footage(path)
