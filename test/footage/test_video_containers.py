"""Videos as phones, cameras for surveillance and editors write them."""

import re
import struct
from fractions import Fraction
from itertools import pairwise

import cv2
import numpy as np
import pytest

from pf_tracker_ros.footage import (
    FootageError,
    PartialFootageError,
    open_footage,
    video_decoding,
)
from pf_tracker_ros.footage.videos import VideoFootage

STEADY = range(0, 4000, 40)
GAP = [*range(0, 1000, 40), *range(5000, 6000, 40)]
SLOWER = [*range(0, 1000, 40), *range(1000, 6000, 200)]
B_FRAMES = {"g": "25", "bf": "2"}


@pytest.fixture(scope="module")
def shifts():
    """A hundred pictures of a ground that shifts, each another one."""
    coarse = np.random.default_rng(3).integers(0, 256, (12, 16, 3), dtype=np.uint8)
    ground = cv2.resize(coarse, (160, 120), interpolation=cv2.INTER_CUBIC)
    return [np.roll(ground, index, axis=1) for index in range(100)]


def read(path):
    """The frames of a video, and the message of the error after the last one, or empty."""
    frames = []
    try:
        for frame in open_footage(path).frames():
            frames.append(frame)
    except PartialFootageError as error:
        return frames, str(error)
    return frames, ""


def milliseconds(frames):
    """Times from the first frame."""
    return [(frame.stamp - 1_000_000_000) / 1e6 for frame in frames]


def cut(source, target, start, title=""):
    """Copy a video from the key frame before a time in seconds, without encoding it again."""
    av = pytest.importorskip("av")
    with av.open(str(source)) as whole, av.open(str(target), "w") as part:
        stream = whole.streams.video[0]
        copy = part.add_stream_from_template(stream)
        part.metadata["title"] = title
        offset = int(start / stream.time_base)
        whole.seek(offset, stream=stream)
        for packet in whole.demux(stream):
            if packet.dts is not None:
                packet.stream = copy
                packet.pts -= offset
                packet.dts -= offset
                part.mux(packet)
    return target


@pytest.mark.usefixtures("video_decoder")
@pytest.mark.parametrize("suffix", ["mp4", "mkv"])
@pytest.mark.parametrize("times", [GAP, SLOWER], ids=["gap", "slower"])
def test_stamps_are_the_times_of_the_container(tmp_path, shifts, write_clip, times, suffix):
    frames, error = read(write_clip(tmp_path / f"clip.{suffix}", shifts[:50], times))
    assert milliseconds(frames) == times
    # OpenCV only guesses how many frames are in this container.
    assert not error or (suffix == "mkv" and "may be damaged: OpenCV read 50 of" in error)


@pytest.mark.parametrize(("suffix", "codec"), [("mp4", "mpeg4"), ("mkv", "ffv1")])
def test_number_and_mean_interval_of_frames_are_known(tmp_path, shifts, write_clip, suffix, codec):
    clip = write_clip(tmp_path / f"clip.{suffix}", shifts[:50], GAP, codec)
    footage = open_footage(clip)
    assert footage.frame_count == 50
    assert footage.nominal_interval == pytest.approx(GAP[-1] / 49e3, rel=0.05)
    # A range counts its stamps from its first frame.
    frames = list(VideoFootage(clip, first_frame=24, frame_count=3).frames())
    assert milliseconds(frames) == [0, 4040, 4080]


@pytest.mark.parametrize("suffix", ["mp4", "mkv", "avi", "mov", "ts"])
def test_both_decoders_give_the_same_in_the_order_of_display(
    tmp_path, shifts, write_clip, monkeypatch, suffix
):
    clip = write_clip(tmp_path / f"clip.{suffix}", shifts, STEADY, codec_options=B_FRAMES)
    frames, error = read(clip)
    assert (milliseconds(frames), error) == (list(STEADY), "")
    for frame, picture in zip(frames, shifts, strict=True):
        assert np.abs(frame.image.astype(int) - picture).mean() < 8
    monkeypatch.setattr(video_decoding, "has_pyav", lambda: False)
    others, error = read(clip)
    assert (milliseconds(others), error) == (list(STEADY), "")
    for frame, other in zip(frames, others, strict=True):
        np.testing.assert_array_equal(frame.image, other.image)


@pytest.mark.parametrize("turns", [1, 2, 3])
@pytest.mark.usefixtures("video_decoder")
def test_a_rotated_video_is_shown_upright(tmp_path, shifts, write_clip, turns):
    upright = write_clip(tmp_path / "upright.mp4", shifts[:3], STEADY[:3])
    content = bytearray(upright.read_bytes())
    # The matrix of the track header, ISO/IEC 14496-12, 8.3.2; 16.16 fixed point.
    cosine, sine = ((0, 1), (-1, 0), (0, -1))[turns - 1]
    rows = ((cosine, sine, 0), (-sine, cosine, 0))
    values = [int(value * 65536) for row in rows for value in row] + [0, 0, 1 << 30]
    begin = content.index(b"tkhd") + 44
    content[begin : begin + 36] = struct.pack(">9i", *values)
    phone = tmp_path / "phone.mp4"
    phone.write_bytes(content)
    for frame, turned in zip(*(read(each)[0] for each in (upright, phone)), strict=True):
        # Clockwise, as the phone was held.
        np.testing.assert_array_equal(turned.image, np.rot90(frame.image, -turns))


@pytest.mark.parametrize(
    ("suffix", "start"), [("mp4", "0.6"), ("mp4", "2"), ("mkv", "1.4"), ("ts", "1.4")]
)
def test_a_clip_that_was_cut_is_whole(tmp_path, shifts, write_clip, suffix, start):
    whole = write_clip(
        tmp_path / f"whole.{suffix}", shifts, STEADY, "libx264", codec_options=B_FRAMES
    )
    footage = open_footage(cut(whole, tmp_path / f"cut.{suffix}", Fraction(start)))
    frames = list(footage.frames())
    assert set(np.diff(milliseconds(frames))) <= {40.0, 80.0, 120.0}
    if suffix == "mp4":
        # An edit list hides the frames from the key frame to the cut.
        assert len(frames) == footage.frame_count <= 101 - round(25 * float(start))
        difference = np.abs(frames[-1].image.astype(int) - shifts[99]).mean()
        assert difference < 8


def test_a_recording_that_begins_late_is_whole(tmp_path, shifts, write_clip):
    times = [100_000 + time for time in STEADY]
    footage = open_footage(write_clip(tmp_path / "late.mkv", shifts, times, "ffv1"))
    assert milliseconds(footage.frames()) == list(STEADY)
    assert footage.frame_count == 100
    assert footage.nominal_interval == pytest.approx(0.04)


@pytest.mark.parametrize(
    ("suffix", "message"),
    [
        ("mp4", r"is damaged: it contains \d+ of its 100 frames"),
        ("avi", r"is damaged: it contains \d+ of its 100 frames"),
        ("mkv", r"is damaged: it ends after 2\.\d\d of 4\.00 s"),
    ],
)
def test_a_truncated_video_is_read_as_far_as_it_goes(tmp_path, shifts, write_clip, suffix, message):
    # The index of the MP4 file is at its beginning, as in files for the web.
    first = {"movflags": "faststart"} if suffix == "mp4" else {}
    whole = write_clip(tmp_path / f"whole.{suffix}", shifts, STEADY, container_options=first)
    content = whole.read_bytes()
    path = tmp_path / f"half.{suffix}"
    path.write_bytes(content[: len(content) * 6 // 10])
    frames, error = read(path)
    assert 40 < len(frames) < 80
    assert milliseconds(frames) == list(STEADY)[: len(frames)]
    assert re.search(message, error)


@pytest.mark.parametrize("suffix", ["mp4", "mov"])
def test_a_video_with_a_hole_is_read_to_its_end(tmp_path, shifts, write_clip, suffix):
    path = write_clip(tmp_path / f"a.{suffix}", shifts, STEADY, codec_options={"g": "10"})
    content = bytearray(path.read_bytes())
    third = len(content) // 3
    content[third : third + len(content) // 5] = bytes(len(content) // 5)
    path.write_bytes(content)
    frames, error = read(path)
    assert "could not be decoded, the first near frame" in error
    times = milliseconds(frames)
    assert set(times) < set(STEADY)
    assert times[-1] == STEADY[-1]


def test_a_video_whose_time_goes_back_is_read_on(tmp_path, shifts, write_clip):
    part = write_clip(tmp_path / "part.ts", shifts[:10], STEADY[:10], "mpeg2video")
    path = tmp_path / "joined.ts"
    path.write_bytes(part.read_bytes() * 2)
    frames, error = read(path)
    assert f"{path} is damaged: " in error
    assert len(frames) >= 19
    assert all(after > before for before, after in pairwise(frame.stamp for frame in frames))


@pytest.mark.parametrize(
    "case",
    [
        ("mkv", GAP, "frame 25 of clip.mkv comes 4.04 s after the one before: "),
        ("mkv", SLOWER, ""),
        ("mp4", GAP, ""),
        ("mkv", [0, 150_000, 300_000], "the frames of clip.mkv are 150 s apart on average, "),
    ],
)
def test_a_gap_is_noted_where_no_list_tells_whether_frames_are_missing(
    shifts, write_clip, tmp_path, case
):
    suffix, times, note = case
    footage = open_footage(write_clip(tmp_path / f"clip.{suffix}", shifts[: len(times)], times))
    frames = list(footage.frames())
    assert milliseconds(frames) == ([0, 40, 80] if len(times) == 3 else times)
    assert footage.note.startswith(note)
    assert bool(footage.note) == bool(note)


def test_a_title_that_is_not_utf_8_does_not_matter(tmp_path, shifts, write_clip):
    source = write_clip(tmp_path / "clip.avi", shifts[:5], STEADY[:5])
    titled = cut(source, tmp_path / "titled.avi", 0, title="stra_e")
    content = titled.read_bytes()
    assert b"stra_e" in content
    titled.write_bytes(content.replace(b"stra_e", "stra\xdfe".encode("latin-1")))
    frames, error = read(titled)
    assert (len(frames), error) == (5, "")


def test_a_file_with_sound_alone_is_refused(tmp_path):
    av = pytest.importorskip("av")
    path = tmp_path / "sound.mka"
    with av.open(str(path), "w") as container:
        stream = container.add_stream("pcm_s16le", rate=8000, layout="mono")
        frame = av.AudioFrame.from_ndarray(np.zeros((1, 800), np.int16), "s16", "mono")
        frame.sample_rate = 8000
        container.mux(stream.encode(frame))
        container.mux(stream.encode())
    with pytest.raises(FootageError, match=r"sound\.mka is not a video.*it has no pictures"):
        open_footage(path)


def test_an_avi_whose_header_gives_two_intervals_is_noted(tmp_path, shifts, write_clip):
    """Only one of them is used, and nothing tells which one was changed."""
    pytest.importorskip("av")
    clip = write_clip(tmp_path / "clip.avi", shifts[:20], STEADY[:20])
    assert open_footage(clip).note == ""
    content = bytearray(clip.read_bytes())
    for begin in (content.index(b"avih") + 9, content.index(b"strh") + 8 + 20):
        changed = bytearray(content)
        changed[begin] ^= 3
        (tmp_path / "changed.avi").write_bytes(changed)
        note = open_footage(tmp_path / "changed.avi").note
        assert "changed.avi gives two intervals between frames" in note


@pytest.mark.parametrize("place", [0.3, 0.5, 0.9])
def test_damage_inside_of_a_motion_jpeg_picture_is_told(tmp_path, shifts, write_clip, place):
    av = pytest.importorskip("av")
    clip = write_clip(tmp_path / "clip.avi", shifts[:20], STEADY[:20], codec="mjpeg")
    whole, error = read(clip)
    assert error == ""
    with av.open(str(clip)) as container:
        packets = [(packet.pos, packet.size) for packet in container.demux(video=0) if packet.size]
    position, size = packets[7]
    content = bytearray(clip.read_bytes())
    begin = position + int(place * size)
    # Ones are no code of a Huffman table, and no marker follows.
    content[begin : begin + 40] = b"\xff\x00" * 20
    clip.write_bytes(content)
    frames, error = read(clip)
    assert "it has 1 damaged frame, the first is frame 7" in error
    assert milliseconds(frames) == milliseconds(whole)
    for index, (frame, other) in enumerate(zip(frames, whole, strict=True)):
        assert np.array_equal(frame.image, other.image) == (index != 7)
