"""Decompression bombs: refused, or decoded correctly at low cost."""

import functools
import io
import json
import re
import struct
import subprocess
import sys
import zlib
from array import array

import cv2
import numpy as np
import pytest
from PIL import Image as Picture
from PIL import ImageFile, PngImagePlugin
from sensor_msgs.msg import CompressedImage

from pf_tracker_ros.decoding.image_decoding import ImageError, decode_compressed

# The default of `max_image_pixels`.
LARGEST = 2**24
MEGABYTE = 2**20

GRAY = np.arange(64, dtype=np.uint8).reshape(8, 8)
PHOTOGRAPH = cv2.GaussianBlur(
    np.random.default_rng(0).integers(0, 256, (240, 320, 3), dtype=np.uint8), (5, 5), 2.0
)


def decoded(data, max_pixels=LARGEST):
    return decode_compressed(CompressedImage(format="", data=array("B", data)), max_pixels)


def by_opencv(data):
    flags = cv2.IMREAD_ANYDEPTH | cv2.IMREAD_ANYCOLOR | cv2.IMREAD_IGNORE_ORIENTATION
    return cv2.imdecode(np.frombuffer(data, np.uint8), flags)


def by_pillow(image, kind, **options):
    file = io.BytesIO()
    with pytest.MonkeyPatch.context() as patch:
        # Pillow 12, the last for Python 3.10, writes all JPEG metadata in one block.
        patch.setattr(ImageFile, "MAXBLOCK", 2**17)
        image.save(file, kind, **options)
    return file.getvalue()


# PNG


def chunk(kind, content, checksum=None):
    checksum = zlib.crc32(kind + content) if checksum is None else checksum
    return struct.pack(">I", len(content)) + kind + content + struct.pack(">I", checksum)


def header(width=8, height=8, depth=8, color_type=0, interlacing=0):
    fields = (width, height, depth, color_type, 0, 0, interlacing)
    return b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", struct.pack(">IIBBBBB", *fields))


def rows(image):
    return np.insert(image, 0, 0, axis=1).tobytes()


PIXELS = chunk(b"IDAT", zlib.compress(rows(GRAY)))
END = chunk(b"IEND", b"")


@functools.cache
def inflating_to(megabytes, begin=b""):
    """A stream that inflates to a number of megabytes after its beginning."""
    deflater = zlib.compressobj()
    parts = [deflater.compress(begin)]
    parts += [deflater.compress(b" " * MEGABYTE) for _ in range(megabytes)]
    return b"".join(parts) + deflater.flush()


def with_texts():
    text = chunk(b"zTXt", b"Comment\0\0" + inflating_to(4))
    return header() + 300 * text + PIXELS + END


def with_international_texts():
    text = chunk(b"iTXt", b"Comment\0\1\0\0\0" + inflating_to(4))
    return header() + 150 * text + PIXELS + 150 * text + END


def with_a_color_profile():
    return header() + chunk(b"iCCP", b"profile\0\0" + inflating_to(400)) + PIXELS + END


def with_wrong_chunks():
    wrong = chunk(b"sBIT", b"\0" * 9) + chunk(b"gAMA", b"\0" * 4, checksum=1)
    return header() + 2000 * (wrong + chunk(b"tEXt", bytes(4000))) + PIXELS + END


def with_more_pixels_than_declared():
    return header() + chunk(b"IDAT", inflating_to(400, rows(GRAY))) + END


def with_more_pixels_in_many_chunks():
    stream = inflating_to(400, rows(GRAY))
    parts = [stream[start : start + 8192] for start in range(0, len(stream), 8192)]
    return header() + b"".join(chunk(b"IDAT", part) for part in parts) + END


def with_empty_chunks():
    return header() + 200_000 * chunk(b"IDAT", b"") + PIXELS + END


def with_many_palettes():
    palette = chunk(b"PLTE", bytes(768))
    return header(color_type=3) + 2000 * palette + PIXELS + END


def with_another_header():
    return header() + header(4096, 4096)[8:] + PIXELS + END


def with_an_animation():
    frames = chunk(b"fcTL", struct.pack(">IIIIIHHBB", 0, 8, 8, 0, 0, 1, 100, 0, 0)) + PIXELS
    for number in range(1, 800, 2):
        place = struct.pack(">IIIIIHHBB", number, 8, 8, 0, 0, 1, 100, 0, 0)
        data = struct.pack(">I", number + 1) + zlib.compress(rows(GRAY))
        frames += chunk(b"fcTL", place) + chunk(b"fdAT", data)
    return header() + chunk(b"acTL", struct.pack(">II", 2**31 - 1, 0)) + frames + END


def interlaced_without_pixels():
    return header(4096, 4096, depth=16, color_type=6, interlacing=1) + PIXELS + END


def interlaced_in_no_known_way():
    return header(interlacing=7) + PIXELS + END


def with_a_wrong_checksum():
    return header() + chunk(b"IDAT", zlib.compress(rows(GRAY)), checksum=1) + END


def with_data_behind_the_stream():
    return header() + chunk(b"IDAT", zlib.compress(rows(GRAY)) + bytes(4_000_000)) + END


PNG_BOMBS = {
    with_texts: GRAY,
    with_international_texts: GRAY,
    with_a_color_profile: GRAY,
    with_wrong_chunks: GRAY,
    with_an_animation: GRAY,
    with_more_pixels_than_declared: "inflates to more than its declared size",
    with_more_pixels_in_many_chunks: "inflates to more than its declared size",
    with_empty_chunks: "too many chunks",
    with_many_palettes: "damaged",
    with_another_header: "damaged",
    interlaced_without_pixels: "damaged",
    interlaced_in_no_known_way: "damaged",
    with_a_wrong_checksum: "damaged",
    with_data_behind_the_stream: "damaged",
}


# JPEG


def segment(marker, content):
    return bytes((0xFF, marker)) + struct.pack(">H", len(content) + 2) + content


def jpeg(*options):
    return cv2.imencode(".jpg", PHOTOGRAPH, list(options))[1].tobytes()


BASELINE = jpeg()
PROGRESSIVE = jpeg(cv2.IMWRITE_JPEG_PROGRESSIVE, 1)
JPEG_PIXELS = by_opencv(BASELINE)


def inserted(data, what, before=b"\xff\xda"):
    position = data.index(before)
    return data[:position] + what + data[position:]


def declaring(data, width, height):
    for marker in (b"\xff\xc0", b"\xff\xc2"):
        position = data.find(marker)
        if position > 0:
            size = struct.pack(">HH", height, width)
            return data[: position + 5] + size + data[position + 9 :]
    raise AssertionError


def with_many_scans():
    scans = PROGRESSIVE[PROGRESSIVE.index(b"\xff\xda") : -2]
    return PROGRESSIVE[:-2] + 9 * scans + PROGRESSIVE[-2:]


def with_many_pixels_declared():
    return declaring(BASELINE, 4096, 4096)


def truncated_and_closed():
    return declaring(PROGRESSIVE[: len(PROGRESSIVE) // 3] + b"\xff\xd9", 4096, 4096)


def with_another_frame():
    frame = BASELINE.index(b"\xff\xc0")
    larger = declaring(BASELINE, 4096, 4096)[frame : frame + 19]
    return inserted(BASELINE, larger)


def with_restarts():
    scan = BASELINE.index(b"\xff\xda") + 14
    interval = segment(0xDD, b"\xff\xff")
    return inserted(BASELINE[:scan], interval) + b"\xff\xd3" * 1_000_000 + BASELINE[scan:]


def with_thumbnails():
    exif = segment(0xE1, (b"Exif\0\0" + BASELINE)[:65000])
    return BASELINE[:2] + 400 * exif + BASELINE[2:]


def with_many_thumbnails():
    return BASELINE[:2] + 200_000 * segment(0xE1, b"Exif\0\0") + BASELINE[2:]


def with_images_behind():
    return BASELINE + 500 * BASELINE


def with_another_start():
    return inserted(BASELINE, b"\xff\xd8")


def with_many_tables():
    tables = BASELINE[BASELINE.index(b"\xff\xc4") : BASELINE.index(b"\xff\xda")]
    return inserted(BASELINE, 5000 * tables)


def with_filling():
    return inserted(BASELINE, b"\xff" * 5_000_000)


def with_endless_filling():
    scan = BASELINE.index(b"\xff\xda") + 14
    return BASELINE[:scan] + b"\xff" * 5_000_000 + b"\0"


def with_escapes():
    return BASELINE[:-2] + b"\xff\0" * 2_000_000 + BASELINE[-2:]


def with_arithmetic_codes():
    return BASELINE.replace(b"\xff\xc0", b"\xff\xc9", 1)


def with_many_components():
    frame = struct.pack(">BHHB", 8, 4096, 4096, 80) + b"\1\x44\0" * 80
    return BASELINE[: BASELINE.index(b"\xff\xc0")] + segment(0xC0, frame) + BASELINE[-500:]


JPEG_BOMBS = {
    with_thumbnails: JPEG_PIXELS,
    with_images_behind: JPEG_PIXELS,
    with_filling: JPEG_PIXELS,
    with_escapes: JPEG_PIXELS,
    with_restarts: None,
    with_many_scans: "more than 18 scans",
    with_many_pixels_declared: "truncated",
    truncated_and_closed: "truncated",
    with_another_frame: "not a whole JPEG image",
    with_many_thumbnails: "too many segments",
    with_another_start: "not a whole JPEG image",
    with_many_tables: "too many segments",
    with_endless_filling: "truncated",
    with_arithmetic_codes: "not a whole JPEG image",
    with_many_components: "80 components",
}

BOMBS = {bomb.__name__: (bomb, outcome) for bomb, outcome in (PNG_BOMBS | JPEG_BOMBS).items()}


@pytest.mark.parametrize("name", BOMBS)
def test_a_bomb_is_refused_or_decoded_to_its_image(name):
    bomb, outcome = BOMBS[name]
    data = bomb()
    if isinstance(outcome, str):
        with pytest.raises(ImageError, match=re.escape(outcome)):
            decoded(data)
    else:
        image = decoded(data)
        assert outcome is None or np.array_equal(image, outcome)


MEASURE = """
import json, pathlib, re, resource, sys
from array import array
from sensor_msgs.msg import CompressedImage
from pf_tracker_ros.decoding.image_decoding import decode_compressed
from pf_tracker_ros.decoding.image_decoding import ImageError

def peak():
    # In megabytes; ru_maxrss would include the parent process.
    status = pathlib.Path("/proc/self/status").read_text()
    return int(re.search(r"VmHWM:\\s+([0-9]+) kB", status)[1]) // 1024

def decode(path):
    message = CompressedImage(format="", data=array("B", path.read_bytes()))
    before = peak()
    try:
        decode_compressed(message, 2**24)
    except ImageError:
        pass
    return peak() - before

ordinary, *bombs = (pathlib.Path(name) for name in sys.argv[1:])
decode(ordinary)
# Limits the memory, so that a failure does not make the machine swap.
resource.setrlimit(resource.RLIMIT_DATA, (2**31, 2**31))
print(json.dumps({bomb.name: decode(bomb) for bomb in bombs}))
"""


def test_no_bomb_takes_much_memory_or_fills_the_log(tmp_path):
    files = {"ordinary": BASELINE} | {name: bomb() for name, (bomb, _) in BOMBS.items()}
    for name, data in files.items():
        (tmp_path / name).write_bytes(data)
    arguments = [sys.executable, "-c", MEASURE, *(tmp_path / name for name in files)]
    process = subprocess.run(arguments, capture_output=True, text=True, check=False)
    lines = process.stderr.splitlines()
    assert process.returncode == 0, lines[-5:]
    grown = json.loads(process.stdout)
    assert grown.keys() == BOMBS.keys()
    assert max(grown.values()) < 100, grown
    assert len(lines) <= len(BOMBS), lines[:5]


# Files of ordinary encoders


def interlaced(image):
    """An interlaced PNG file, as Pillow and OpenCV write none."""
    passes = (
        image[::8, ::8],
        image[::8, 4::8],
        image[4::8, ::4],
        image[::4, 2::4],
        image[2::4, ::2],
        image[::2, 1::2],
        image[1::2],
    )
    height, width, *channels = image.shape
    raw = b"".join(b"\0" + row.tobytes() for part in passes for row in part if part.size)
    color_type = 2 if channels else 0
    pixels = chunk(b"IDAT", zlib.compress(raw))
    return header(width, height, color_type=color_type, interlacing=1) + pixels + END


def described():
    information = PngImagePlugin.PngInfo()
    information.add_text("Comment", "A photograph. " * 100, zip=True)
    return {"pnginfo": information, "dpi": (300, 300)}


def files_of_pillow():
    picture = Picture.fromarray(PHOTOGRAPH[:37, :53])
    transparent = Picture.fromarray(np.dstack([PHOTOGRAPH, PHOTOGRAPH[..., 0]])[:37, :53])
    palette = picture.quantize(16)
    deep = Picture.fromarray(PHOTOGRAPH[:37, :53, 0].astype(np.uint16) * 200)
    for mode in ("1", "L", "LA", "RGB"):
        yield f"PNG {mode}", by_pillow(transparent.convert("RGB").convert(mode), "PNG")
    yield "PNG RGBA", by_pillow(transparent, "PNG")
    yield "PNG 16 bit", by_pillow(deep, "PNG")
    yield "PNG palette", by_pillow(palette, "PNG")
    yield "PNG of 3 colors", by_pillow(picture.quantize(3), "PNG")
    yield "PNG transparent palette", by_pillow(palette, "PNG", transparency=bytes(range(16)))
    yield "PNG transparent gray", by_pillow(picture.convert("L"), "PNG", transparency=7)
    yield "PNG described", by_pillow(picture, "PNG", **described())
    yield "PNG not compressed", by_pillow(picture, "PNG", compress_level=0)
    for mode in ("L", "RGB", "CMYK"):
        for progressive in (False, True):
            options = {"progressive": progressive, "optimize": progressive, "quality": 90}
            name = f"JPEG {mode} {'progressive' if progressive else 'baseline'}"
            yield name, by_pillow(picture.convert(mode), "JPEG", **options)
    yield "JPEG 4:4:4", by_pillow(picture, "JPEG", subsampling=0)
    yield "JPEG described", by_pillow(picture, "JPEG", comment="x" * 60000, icc_profile=bytes(9999))
    flat = Picture.new("RGB", (640, 480), (90, 90, 90))
    for progressive in (False, True):
        yield f"JPEG flat {progressive}", by_pillow(flat, "JPEG", progressive=progressive)
        yield (
            f"JPEG flat optimized {progressive}",
            by_pillow(flat, "JPEG", progressive=progressive, optimize=True, quality=5),
        )


def files_of_opencv():
    color = PHOTOGRAPH[:41, :55]
    deep = color.astype(np.uint16) * 201
    alpha = np.dstack([color, color[..., 0]])
    for name, image in (("color", color), ("gray", color[..., 0]), ("alpha", alpha)):
        yield f"PNG {name}", cv2.imencode(".png", image)[1].tobytes()
    for name, image in (("color", deep), ("gray", deep[..., 0])):
        yield f"PNG 16 bit {name}", cv2.imencode(".png", image)[1].tobytes()
    for name, options in {
        "restarts": (cv2.IMWRITE_JPEG_RST_INTERVAL, 1),
        "progressive": (cv2.IMWRITE_JPEG_PROGRESSIVE, 1),
        "optimized": (cv2.IMWRITE_JPEG_OPTIMIZE, 1),
    }.items():
        for channels, image in (("color", color), ("gray", color[..., 0])):
            yield f"JPEG {channels} {name}", cv2.imencode(".jpg", image, options)[1].tobytes()


ORDINARY = {
    **{f"Pillow {name}": data for name, data in files_of_pillow()},
    **{f"OpenCV {name}": data for name, data in files_of_opencv()},
    "PNG interlaced gray": interlaced(PHOTOGRAPH[:13, :11, 0]),
    "PNG interlaced color": interlaced(PHOTOGRAPH[:30, :41]),
    "PNG interlaced, one column": interlaced(PHOTOGRAPH[:30, :1]),
    "PNG interlaced, one pixel": interlaced(PHOTOGRAPH[:1, :1, 0]),
}


@pytest.mark.parametrize("name", ORDINARY)
def test_files_of_ordinary_encoders_are_decoded_as_by_opencv_to_the_bit(name):
    data = ORDINARY[name]
    expected = by_opencv(data)
    if expected.ndim == 3 and expected.dtype == np.uint16:
        expected = (expected >> 8).astype(np.uint8)
    np.testing.assert_array_equal(decoded(data), expected)


def test_interlaced_images_keep_every_pixel():
    np.testing.assert_array_equal(decoded(ORDINARY["PNG interlaced gray"]), PHOTOGRAPH[:13, :11, 0])


def test_the_size_is_refused_before_the_pixels_are_inflated(monkeypatch):
    monkeypatch.delattr(zlib, "decompressobj")
    with pytest.raises(ImageError, match="declares 8 x 8 px; allowed: 63 px"):
        decoded(header() + PIXELS + END, max_pixels=63)
