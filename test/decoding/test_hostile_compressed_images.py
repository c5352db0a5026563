"""Decompression bombs: refused, or decoded correctly at low cost."""

import functools
import io
import json
import re
import struct
import zlib
from array import array

import cv2
import numpy as np
import pytest
from common import run_python
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


def decoded(data):
    return decode_compressed(CompressedImage(format="", data=array("B", data)), LARGEST)


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


def png(*chunks, **fields):
    return header(**fields) + b"".join(chunks) + END


def animation():
    frames = chunk(b"fcTL", struct.pack(">IIIIIHHBB", 0, 8, 8, 0, 0, 1, 100, 0, 0)) + PIXELS
    for number in range(1, 800, 2):
        place = struct.pack(">IIIIIHHBB", number, 8, 8, 0, 0, 1, 100, 0, 0)
        data = struct.pack(">I", number + 1) + zlib.compress(rows(GRAY))
        frames += chunk(b"fcTL", place) + chunk(b"fdAT", data)
    return png(chunk(b"acTL", struct.pack(">II", 2**31 - 1, 0)), frames)


def more_pixels(size):
    """More than declared, in chunks of a size."""
    stream = inflating_to(400, rows(GRAY))
    return png(*(chunk(b"IDAT", stream[at : at + size]) for at in range(0, len(stream), size)))


TEXT = b"Comment\0\0"
INTERNATIONAL = b"Comment\0\1\0\0\0"
WRONG = chunk(b"sBIT", b"\0" * 9) + chunk(b"gAMA", b"\0" * 4, checksum=1)
STREAM = zlib.compress(rows(GRAY))
# Name to what makes the file, and the image in it or why it is refused.
PNG_BOMBS = {
    "texts": (lambda: png(300 * chunk(b"zTXt", TEXT + inflating_to(4)), PIXELS), GRAY),
    "international texts": (
        lambda: png((text := 150 * chunk(b"iTXt", INTERNATIONAL + inflating_to(4))), PIXELS, text),
        GRAY,
    ),
    "a color profile": (
        lambda: png(chunk(b"iCCP", b"profile\0\0" + inflating_to(400)), PIXELS), GRAY,
    ),
    "wrong chunks": (lambda: png(2000 * (WRONG + chunk(b"tEXt", bytes(4000))), PIXELS), GRAY),
    "an animation": (animation, GRAY),
    "more pixels": (lambda: more_pixels(10**9), "inflates to more than its declared size"),
    "more pixels in chunks": (lambda: more_pixels(8192), "inflates to more than its declared size"),
    "empty chunks": (lambda: png(200_000 * chunk(b"IDAT", b""), PIXELS), "too many chunks"),
    "palettes": (lambda: png(2000 * chunk(b"PLTE", bytes(768)), PIXELS, color_type=3), "damaged"),
    "another header": (lambda: png(header(4096, 4096)[8:], PIXELS), "damaged"),
    "interlaced without pixels": (
        lambda: png(PIXELS, width=4096, height=4096, depth=16, color_type=6, interlacing=1),
        "damaged",
    ),
    "interlaced in no known way": (lambda: png(PIXELS, interlacing=7), "damaged"),
    "a wrong checksum": (lambda: png(chunk(b"IDAT", STREAM, checksum=1)), "damaged"),
    "data behind the stream": (lambda: png(chunk(b"IDAT", STREAM + bytes(4_000_000))), "damaged"),
}  # fmt: skip


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


def another_frame():
    frame = BASELINE.index(b"\xff\xc0")
    return inserted(BASELINE, declaring(BASELINE, 4096, 4096)[frame : frame + 19])


def many_components():
    frame = struct.pack(">BHHB", 8, 4096, 4096, 80) + b"\1\x44\0" * 80
    return BASELINE[: BASELINE.index(b"\xff\xc0")] + segment(0xC0, frame) + BASELINE[-500:]


HEAD = BASELINE[: BASELINE.index(b"\xff\xda") + 14]
SCAN = BASELINE[len(HEAD) :]
SCANS = PROGRESSIVE[PROGRESSIVE.index(b"\xff\xda") : -2]
THIRD = PROGRESSIVE[: len(PROGRESSIVE) // 3]
TABLES = BASELINE[BASELINE.index(b"\xff\xc4") : BASELINE.index(b"\xff\xda")]
RESTARTING = inserted(HEAD, segment(0xDD, b"\xff\xff"))
THUMBNAIL = segment(0xE1, (b"Exif\0\0" + BASELINE)[:65000])
JPEG_BOMBS = {
    "thumbnails": (lambda: BASELINE[:2] + 400 * THUMBNAIL + BASELINE[2:], JPEG_PIXELS),
    "images behind": (lambda: BASELINE + 500 * BASELINE, JPEG_PIXELS),
    "filling": (lambda: inserted(BASELINE, b"\xff" * 5_000_000), JPEG_PIXELS),
    "escapes": (lambda: BASELINE[:-2] + b"\xff\0" * 2_000_000 + BASELINE[-2:], JPEG_PIXELS),
    "restarts": (lambda: RESTARTING + b"\xff\xd3" * 1_000_000 + SCAN, None),
    "scans": (lambda: PROGRESSIVE[:-2] + 9 * SCANS + PROGRESSIVE[-2:], "more than 18 scans"),
    "many pixels": (lambda: declaring(BASELINE, 4096, 4096), "truncated"),
    "truncated and closed": (lambda: declaring(THIRD + b"\xff\xd9", 4096, 4096), "truncated"),
    "another frame": (another_frame, "not a whole JPEG image"),
    "many thumbnails": (
        lambda: BASELINE[:2] + 200_000 * segment(0xE1, b"Exif\0\0") + BASELINE[2:],
        "too many segments",
    ),
    "another start": (lambda: inserted(BASELINE, b"\xff\xd8"), "not a whole JPEG image"),
    "tables": (lambda: inserted(BASELINE, 5000 * TABLES), "too many segments"),
    "endless filling": (lambda: HEAD + b"\xff" * 5_000_000 + b"\0", "truncated"),
    "arithmetic codes": (
        lambda: BASELINE.replace(b"\xff\xc0", b"\xff\xc9", 1), "not a whole JPEG image",
    ),
    "components": (many_components, "80 components"),
}  # fmt: skip
BOMBS = PNG_BOMBS | JPEG_BOMBS


@pytest.mark.parametrize("name", BOMBS)
def test_a_bomb_is_refused_or_decoded_to_its_image(name):
    make, outcome = BOMBS[name]
    data = make()
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
    files = {"ordinary": BASELINE} | {name: make() for name, (make, _) in BOMBS.items()}
    for name, data in files.items():
        (tmp_path / name).write_bytes(data)
    process = run_python(MEASURE, *(tmp_path / name for name in files))
    lines = process.stderr.splitlines()
    assert process.returncode == 0, lines[-5:]
    grown = json.loads(process.stdout)
    assert grown.keys() == BOMBS.keys()
    assert max(grown.values()) < 100, grown
    assert len(lines) <= len(BOMBS), lines[:5]


# Files of ordinary encoders


def interlaced(image):
    """An interlaced PNG file, as Pillow and OpenCV write none."""
    passes = [image[::8, ::8], image[::8, 4::8], image[4::8, ::4], image[::4, 2::4]]
    passes += [image[2::4, ::2], image[::2, 1::2], image[1::2]]
    height, width, *channels = image.shape
    raw = b"".join(b"\0" + row.tobytes() for part in passes for row in part if part.size)
    color_type = 2 if channels else 0
    pixels = chunk(b"IDAT", zlib.compress(raw))
    return header(width, height, color_type=color_type, interlacing=1) + pixels + END


def files_of_pillow():
    picture = Picture.fromarray(PHOTOGRAPH[:37, :53])
    transparent = Picture.fromarray(np.dstack([PHOTOGRAPH, PHOTOGRAPH[..., 0]])[:37, :53])
    palette, flat = picture.quantize(16), Picture.new("RGB", (640, 480), (90, 90, 90))
    described = PngImagePlugin.PngInfo()
    described.add_text("Comment", "A photograph. " * 100, zip=True)
    deep = Picture.fromarray(PHOTOGRAPH[:37, :53, 0].astype(np.uint16) * 200)
    yield from ((f"PNG {mode}", picture.convert(mode), "PNG", {}) for mode in ("1", "L", "LA"))
    yield from (
        ("PNG RGB", picture, "PNG", {}),
        ("PNG RGBA", transparent, "PNG", {}),
        ("PNG 16 bit", deep, "PNG", {}),
        ("PNG palette", palette, "PNG", {}),
        ("PNG of 3 colors", picture.quantize(3), "PNG", {}),
        ("PNG transparent palette", palette, "PNG", {"transparency": bytes(range(16))}),
        ("PNG transparent gray", picture.convert("L"), "PNG", {"transparency": 7}),
        ("PNG described", picture, "PNG", {"pnginfo": described, "dpi": (300, 300)}),
        ("PNG not compressed", picture, "PNG", {"compress_level": 0}),
        ("JPEG 4:4:4", picture, "JPEG", {"subsampling": 0}),
        ("JPEG described", picture, "JPEG", {"comment": "x" * 60000, "icc_profile": bytes(9999)}),
    )
    for progressive in (False, True):
        options = {"progressive": progressive, "optimize": progressive, "quality": 90}
        for mode in ("L", "RGB", "CMYK"):
            yield f"JPEG {mode} {progressive}", picture.convert(mode), "JPEG", options
        yield f"JPEG flat {progressive}", flat, "JPEG", {"progressive": progressive}
        optimized = {"progressive": progressive, "optimize": True, "quality": 5}
        yield f"JPEG flat optimized {progressive}", flat, "JPEG", optimized


# Its PNG files are those of test_compressed_decoding.py.
def files_of_opencv():
    color = PHOTOGRAPH[:41, :55]
    for name in ("RST_INTERVAL", "PROGRESSIVE", "OPTIMIZE"):
        for channels, image in (("color", color), ("gray", color[..., 0])):
            options = (getattr(cv2, f"IMWRITE_JPEG_{name}"), 1)
            yield f"JPEG {channels} {name}", ".jpg", image, options


ORDINARY = {
    **{f"Pillow {name}": by_pillow(*made, **options) for name, *made, options in files_of_pillow()},
    **{f"OpenCV {name}": cv2.imencode(*made)[1].tobytes() for name, *made in files_of_opencv()},
    "PNG interlaced gray": interlaced(PHOTOGRAPH[:13, :11, 0]),
    "PNG interlaced color": interlaced(PHOTOGRAPH[:30, :41]),
    "PNG interlaced, one column": interlaced(PHOTOGRAPH[:30, :1]),
    "PNG interlaced, one pixel": interlaced(PHOTOGRAPH[:1, :1, 0]),
}


@pytest.mark.parametrize("name", ORDINARY)
def test_files_of_ordinary_encoders_are_decoded_as_by_opencv_to_the_bit(name):
    data = ORDINARY[name]
    expected = PHOTOGRAPH[:13, :11, 0] if name == "PNG interlaced gray" else by_opencv(data)
    np.testing.assert_array_equal(decoded(data), expected)
