import itertools
import os
import random
import struct
import zlib
from pathlib import Path

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pf_tracker_ros.footage import FootageError, open_footage
from pf_tracker_ros.footage.images import natural_order, read_image

# With digits that are no ASCII: superscript two and Arabic three.
file_names = st.text(st.sampled_from("aZ09-_. \u00e4\u00b2\u0663\u6f22\U0001f600"), max_size=8)


@given(st.lists(st.integers(0, 10**6), unique=True), st.lists(file_names, unique=True, max_size=6))
def test_numbers_sort_by_value_and_the_order_is_total(numbers, others):
    prefixes = itertools.cycle(["take", "take00"])
    names = [
        f"{prefix}{number}.png" for prefix, number in zip(prefixes, sorted(numbers), strict=False)
    ]
    for expected in (names, sorted(others, key=natural_order)):
        shuffled = random.Random(0).sample(expected, len(expected))
        assert sorted(shuffled, key=natural_order) == expected


def test_folder_is_read_in_natural_order(tmp_path, pictures, write_images):
    names = ["frame1.png", "frame2.png", "frame10.png", "Frame11.PNG", "frame100.bmp"]
    write_images(tmp_path, dict(zip(names, pictures, strict=True)))
    (tmp_path / "readme.txt").write_text("not a frame")
    (tmp_path / ".frame3.png").write_bytes(b"hidden")
    footage = open_footage(tmp_path)
    assert footage.frame_count == 5
    for frame, picture in zip(footage.frames(), pictures, strict=True):
        np.testing.assert_array_equal(frame.image, picture)
    # The frame rate decides the stamps.
    footage = open_footage(tmp_path, frame_rate=4.0)
    assert footage.nominal_interval == 0.25
    assert [frame.stamp for frame in footage.frames()][:2] == [1_000_000_000, 1_250_000_000]


@pytest.mark.parametrize("kind", ["8-bit gray", "16-bit gray", "transparent"])
def test_gray_keeps_its_depth_and_transparency_is_dropped(tmp_path, pictures, write_images, kind):
    if kind == "transparent":
        expected = pictures[0]
        written = np.dstack([expected, np.full((24, 32), 9, np.uint8)])
    else:
        depth = np.uint8 if kind == "8-bit gray" else np.uint16
        expected = written = np.linspace(0, np.iinfo(depth).max, 12, dtype=depth).reshape(3, 4)
    write_images(tmp_path, {"1.png": written})
    (frame,) = open_footage(tmp_path).frames()
    assert frame.image.dtype == expected.dtype
    np.testing.assert_array_equal(frame.image, expected)


def test_sixteen_bit_color_is_refused(tmp_path, pictures, write_images):
    write_images(tmp_path, {"1.png": pictures[0].astype(np.uint16) * 257})
    with pytest.raises(FootageError, match=r"1\.png is 32x24, 3 channel.*16-bit gray"):
        open_footage(tmp_path)


@pytest.mark.parametrize("change", ["size", "channels"])
def test_images_of_another_kind_are_read_as_from_a_camera(tmp_path, pictures, write_images, change):
    other = pictures[1][:20] if change == "size" else pictures[1][:, :, 0]
    write_images(tmp_path, {"1.png": pictures[0], "2.png": other})
    first, second = open_footage(tmp_path).frames()
    np.testing.assert_array_equal(first.image, pictures[0])
    np.testing.assert_array_equal(second.image, other)


def with_too_many_pixels():
    header = struct.pack(">2I5B", 40_000, 40_000, 8, 2, 0, 0, 0)
    octets = b"\x89PNG\r\n\x1a\n"
    for kind, content in (
        (b"IHDR", header), (b"IDAT", zlib.compress(bytes(100))), (b"IEND", b""),
    ):  # fmt: skip
        octets += struct.pack(">I", len(content)) + kind + content
        octets += struct.pack(">I", zlib.crc32(kind + content))
    return octets


@pytest.mark.parametrize(
    ("content", "reason"),
    [
        (b"not a picture", r"2\.png cannot be decoded"),
        (with_too_many_pixels(), r"2\.png cannot be decoded \(.*MAX_IMAGE_PIXELS\)"),
    ],
    ids=["no picture", "too many pixels"],
)
def test_an_image_that_does_not_decode_is_named(tmp_path, pictures, write_images, content, reason):
    write_images(tmp_path, {"1.png": pictures[0]})
    (tmp_path / "2.png").write_bytes(content)
    frames = open_footage(tmp_path).frames()
    next(frames)
    with pytest.raises(FootageError, match=reason):
        next(frames)


@pytest.mark.parametrize("video_decoder", ["OpenCV"], indirect=True)
def test_names_not_in_utf_8_are_read_for_images_but_not_by_opencv(tmp_path, video_decoder):
    picture = np.arange(48, dtype=np.uint8).reshape(4, 4, 3)
    path = Path(os.fsdecode(os.fsencode(tmp_path) + b"/\xe4.png"))
    path.write_bytes(cv2.imencode(".png", picture)[1].tobytes())
    np.testing.assert_array_equal(read_image(path), picture)
    (frame,) = open_footage(tmp_path).frames()
    np.testing.assert_array_equal(frame.image, picture)
    path.rename(path.with_suffix(".mp4"))
    with pytest.raises(FootageError, match="needs a file name in UTF-8"):
        open_footage(path.with_suffix(".mp4"))
