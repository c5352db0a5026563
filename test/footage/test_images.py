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


@given(st.lists(st.integers(0, 10**6), unique=True), st.randoms(use_true_random=False))
def test_numbers_sort_by_value_with_or_without_leading_zeros(numbers, shuffler):
    names = {number: f"take{shuffler.choice(['', '00'])}{number}.png" for number in numbers}
    shuffled = list(names.values())
    random.Random(0).shuffle(shuffled)
    assert sorted(shuffled, key=natural_order) == [names[number] for number in sorted(numbers)]


@given(st.lists(file_names, unique=True, max_size=6))
def test_natural_order_is_total(names):
    shuffled = random.Random(0).sample(names, len(names))
    assert sorted(names, key=natural_order) == sorted(shuffled, key=natural_order)


def test_folder_is_read_in_natural_order(tmp_path, pictures, write_images):
    names = ["frame1.png", "frame2.png", "frame10.png", "Frame11.PNG", "frame100.bmp"]
    write_images(tmp_path, dict(zip(names, pictures, strict=True)))
    (tmp_path / "readme.txt").write_text("not a frame")
    (tmp_path / ".frame3.png").write_bytes(b"hidden")
    footage = open_footage(tmp_path)
    assert footage.frame_count == 5
    for frame, picture in zip(footage.frames(), pictures, strict=True):
        np.testing.assert_array_equal(frame.image, picture)


def test_frame_rate_decides_the_stamps_of_images(tmp_path, pictures, write_images):
    write_images(tmp_path, {"1.png": pictures[0], "2.png": pictures[1]})
    footage = open_footage(tmp_path, frame_rate=4.0)
    assert footage.nominal_interval == 0.25
    assert [frame.stamp for frame in footage.frames()] == [1_000_000_000, 1_250_000_000]


@pytest.mark.parametrize("bit_depth", [np.uint8, np.uint16])
def test_gray_keeps_its_depth(tmp_path, write_images, bit_depth):
    largest = np.iinfo(bit_depth).max
    picture = np.linspace(0, largest, 12, dtype=bit_depth).reshape(3, 4)
    write_images(tmp_path, {"1.png": picture})
    (frame,) = open_footage(tmp_path).frames()
    assert frame.image.dtype == bit_depth
    np.testing.assert_array_equal(frame.image, picture)


def test_transparency_is_dropped(tmp_path, pictures, write_images):
    with_alpha = np.dstack([pictures[0], np.full((24, 32), 9, np.uint8)])
    write_images(tmp_path, {"1.png": with_alpha})
    (frame,) = open_footage(tmp_path).frames()
    np.testing.assert_array_equal(frame.image, pictures[0])


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


def test_an_image_that_does_not_decode_is_named(tmp_path, pictures, write_images):
    write_images(tmp_path, {"1.png": pictures[0]})
    (tmp_path / "2.png").write_bytes(b"not a picture")
    frames = open_footage(tmp_path).frames()
    next(frames)
    with pytest.raises(FootageError, match=r"2\.png cannot be decoded"):
        next(frames)


def test_an_image_with_too_many_pixels_is_named(tmp_path, pictures, write_images):
    write_images(tmp_path, {"1.png": pictures[0]})
    header = struct.pack(">2I5B", 40_000, 40_000, 8, 2, 0, 0, 0)
    chunks = ((b"IHDR", header), (b"IDAT", zlib.compress(bytes(100))), (b"IEND", b""))
    octets = b"".join(
        struct.pack(">I", len(content))
        + kind
        + content
        + struct.pack(">I", zlib.crc32(kind + content))
        for kind, content in chunks
    )
    (tmp_path / "2.png").write_bytes(b"\x89PNG\r\n\x1a\n" + octets)
    frames = open_footage(tmp_path).frames()
    next(frames)
    with pytest.raises(FootageError, match=r"2\.png cannot be decoded \(.*MAX_IMAGE_PIXELS\)"):
        next(frames)


def test_images_with_names_that_are_not_utf_8_are_read(tmp_path):
    picture = np.arange(48, dtype=np.uint8).reshape(4, 4, 3)
    path = Path(os.fsdecode(os.fsencode(tmp_path) + b"/\xe4.png"))
    path.write_bytes(cv2.imencode(".png", picture)[1].tobytes())
    np.testing.assert_array_equal(read_image(path), picture)
    (frame,) = open_footage(tmp_path).frames()
    np.testing.assert_array_equal(frame.image, picture)


@pytest.mark.parametrize("video_decoder", ["OpenCV"], indirect=True)
def test_opencv_refuses_a_video_whose_name_is_not_utf_8(tmp_path, video_decoder):
    path = Path(os.fsdecode(os.fsencode(tmp_path) + b"/\xe4.mp4"))
    path.write_bytes(bytes(100))
    with pytest.raises(FootageError, match="needs a file name in UTF-8"):
        open_footage(path)
