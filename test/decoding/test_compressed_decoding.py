import struct
import zlib
from array import array

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from sensor_msgs.msg import CompressedImage

from pf_tracker_ros.decoding.image_decoding import ImageError, decode_compressed

LARGEST = 10_000


def message(data, image_format="jpeg"):
    return CompressedImage(format=image_format, data=array("B", bytes(data)))


def encoded(image, extension, *options):
    return cv2.imencode(extension, image, list(options))[1].tobytes()


def decoded(data, **options):
    return decode_compressed(message(data, **options), LARGEST)


@pytest.mark.parametrize(
    ("channels", "kind"),
    [(1, np.uint8), (3, np.uint8), (4, np.uint8), (1, np.uint16), (3, np.uint16)],
)
def test_png_keeps_every_pixel_and_no_transparency(noise, channels, kind):
    image = noise(channels=channels, kind=kind)
    result = decoded(encoded(image, ".png"), image_format="png")
    # The tracker takes color of 8 bits only.
    expected = image // 256 if channels == 3 and kind == np.uint16 else image
    assert np.array_equal(result, expected[..., :3] if channels > 1 else expected)
    assert result.dtype == (kind if channels == 1 else np.uint8)


@pytest.mark.parametrize("progressive", [0, 1])
@pytest.mark.parametrize("channels", [1, 3])
def test_jpeg_is_close_to_the_image(channels, progressive):
    noise = np.random.default_rng(0).integers(0, 255, (48, 64, 3), dtype=np.uint8)
    image = cv2.GaussianBlur(noise if channels == 3 else noise[..., 0], (9, 9), 3.0)
    options = (cv2.IMWRITE_JPEG_QUALITY, 95, cv2.IMWRITE_JPEG_PROGRESSIVE, progressive)
    result = decoded(encoded(image, ".jpg", *options))
    assert result.shape == image.shape
    assert np.abs(result.astype(int) - image).mean() < 3


def test_an_orientation_tag_does_not_turn_the_image(noise):
    jpeg = encoded(noise(height=16, width=32), ".jpg")
    tag = struct.pack(">HHIHH", 0x0112, 3, 1, 6, 0)
    tiff = b"MM\0*" + struct.pack(">IH", 8, 1) + tag + bytes(4)
    exif = b"Exif\0\0" + tiff
    turned = jpeg[:2] + b"\xff\xe1" + struct.pack(">H", len(exif) + 2) + exif + jpeg[2:]
    assert cv2.imdecode(np.frombuffer(turned, np.uint8), cv2.IMREAD_COLOR).shape[:2] == (32, 16)
    assert decoded(turned).shape[:2] == (16, 32)


def test_the_format_field_does_not_matter(noise):
    png = encoded(noise(), ".png")
    for image_format in ("", "bgr8; png compressed bgr8", "nonsense" * 1000):
        assert decoded(png, image_format=image_format).shape == (48, 64, 3)


def png_header(width, height):
    content = b"IHDR" + struct.pack(">IIBBBBB", width, height, 8, 2, 0, 0, 0)
    chunk = struct.pack(">I", 13) + content + struct.pack(">I", zlib.crc32(content))
    return b"\x89PNG\r\n\x1a\n" + chunk + struct.pack(">I", 0) + b"IEND\xae\x42\x60\x82"


def jpeg_with_size(width, height):
    jpeg = bytearray(encoded(np.zeros((8, 8), np.uint8), ".jpg"))
    position = jpeg.index(b"\xff\xc0")
    jpeg[position + 5 : position + 9] = struct.pack(">HH", height, width)
    return bytes(jpeg)


@pytest.mark.parametrize("bomb", [png_header, jpeg_with_size])
def test_an_image_that_declares_too_many_pixels_is_refused_before_decoding(bomb, monkeypatch):
    monkeypatch.delattr(cv2, "imdecode")
    monkeypatch.delattr(zlib, "decompressobj")
    with pytest.raises(ImageError, match=r"declares 101 x 100 px; allowed: 10000 px in all"):
        decoded(bomb(101, 100))
    with pytest.raises(ImageError, match="width is 40000 px"):
        decoded(bomb(40_000, 1))
    with pytest.raises(ImageError, match="height is 0 px"):
        decoded(bomb(1, 0))


def test_a_real_image_above_the_limit_is_refused_and_one_at_the_limit_is_not(noise):
    assert decoded(encoded(noise(height=100, width=100), ".jpg")).shape == (100, 100, 3)
    with pytest.raises(ImageError) as refusal:
        decoded(encoded(noise(height=100, width=101), ".png"))
    assert refusal.value.field == "data"
    assert "max_image_pixels" in str(refusal.value)


def test_other_formats_are_refused_and_named(noise):
    image = noise()
    for data in (b"", b"\xff", b"RIFF", encoded(image, ".bmp"), encoded(image, ".webp")):
        with pytest.raises(ImageError, match="neither as JPEG nor as PNG") as refusal:
            decoded(data, image_format="\x1b[2J\n" + "x" * 500)
        assert refusal.value.field == "format"
        assert len(str(refusal.value)) < 200
        assert str(refusal.value).isprintable()
    with pytest.raises(ImageError, match="subscribe to another transport"):
        decoded(b"\0" * 12, image_format="16UC1; compressedDepth png")


@pytest.mark.parametrize("extension", [".jpg", ".png"])
def test_a_truncated_image_is_refused(noise, extension):
    data = encoded(noise(height=24, width=24), extension)
    for length in range(len(data) - 12):
        with pytest.raises(ImageError):
            decoded(data[:length])


IMAGES = [
    encoded(np.random.default_rng(1).integers(0, 255, shape, dtype=np.uint8), extension)
    for shape in ((9, 12), (12, 9, 3))
    for extension in (".jpg", ".png")
]


@given(
    st.sampled_from(IMAGES) | st.binary(max_size=100),
    st.lists(st.tuples(st.integers(0, 1000), st.integers(0, 255)), max_size=8),
    st.binary(max_size=10),
)
def test_any_bytes_give_an_image_within_the_limit_or_an_error(data, changes, tail):
    data = bytearray(data)
    for position, value in changes:
        if data:
            data[position % len(data)] = value
    try:
        image = decoded(bytes(data) + tail)
    except ImageError as error:
        refusal = str(error)
    else:
        refusal = ""
        assert 1 <= image.shape[0] * image.shape[1] <= LARGEST
        assert image.dtype in (np.uint8, np.uint16)
    assert not refusal or refusal.startswith("image refused: its ") or "declares" in refusal
