"""The part of a JPEG file that holds its pixels, checked before a decoder sees it.

Each scan of a progressive image costs as much as a whole image, and a decoder fills up what a file
announces and does not hold: bytes cost little to send and much to decode.

Source: ITU-T T.81, annex B; T.871 for the JFIF and Adobe segments, which tell the color space.
"""

from __future__ import annotations

import re
import struct

import numpy as np

from pf_tracker_ros.decoding.image_decoding import ImageError, SizeCheck
from pf_tracker_ros.plurals import counted

SIGNATURE = b"\xff\xd8\xff"

_START = b"\xff\xd8"
_END = 0xD9
_SCAN = 0xDA
# Baseline, extended and progressive frames with Huffman codes; cameras make no others.
_SEQUENTIAL = (0xC0, 0xC1)
_FRAMES = (*_SEQUENTIAL, 0xC2)
# Tables of codes and of quantization, and the restart interval.
_TABLES = (0xC4, 0xDB, 0xDD)
_COLOR_SPACES = {0xE0: b"JFIF\0", 0xEE: b"Adobe"}
# Segments of applications, such as thumbnails and positions, and comments.
_LEFT_OUT = (*range(0xE0, 0xF0), 0xFE)

_ANY_MARKER = re.compile(rb"\xff+([^\x00\xff])")
# Bytes of a scan that are looked at at once.
_BLOCK = 2**16

# libjpeg makes 10 scans of a color image and 18 of one with four components; encoders that search
# for the smallest file, such as mozjpeg, end between these.
_MOST_SCANS = 18
# Color profiles and descriptions take up to some hundreds, each scan a few.
_MOST_SEGMENTS = 1000


def pixel_data_of_jpeg(data: memoryview, check_size: SizeCheck) -> bytes:
    """The same image in the least JPEG file: tables, frame, scans, and what tells its colors.

    What else a file may hold, such as thumbnails, positions, color profiles, comments and whatever
    follows after the image, is left out and not looked at.

    Args:
        data: A file that begins with `SIGNATURE`.
        check_size: Refuses a width and height; called before anything is decoded.

    Raises:
        ImageError: The file is damaged or cut off, its size is refused, it has more scans than
            encoders make, or holds less than its size takes.
    """
    kept: list[bytes | memoryview] = [_START]
    position, scans, scanned, least = len(_START), 0, 0, 0
    for _ in range(_MOST_SEGMENTS):
        marker = _ANY_MARKER.match(data, position)
        if marker is None:
            raise _unusable(data, scans)
        kind, start = marker[1][0], marker.end()
        if kind == _END and scans:
            if scanned < least:
                raise ImageError(
                    "data", f"its data, {counted(len(data), 'byte')}, is cut off before the end"
                )
            return b"".join([*kept, bytes((0xFF, _END))])
        end = start + int.from_bytes(data[start : start + 2], "big")
        if end > len(data) or end < start + 2:
            raise _unusable(data, scans)
        content = data[start + 2 : end]
        position = end
        if kind in _FRAMES and not least:
            least = _least_scanned(kind, content, check_size, data)
        elif kind == _SCAN and least:
            scans += 1
            if scans > _MOST_SCANS:
                raise ImageError("data", f"its data has more than {_MOST_SCANS} scans")
            position = _end_of_scan(data, end)
            scanned += position - end
        elif kind not in _TABLES:
            if kind not in _LEFT_OUT:
                raise _unusable(data, scans)
            name = _COLOR_SPACES.get(kind)
            if name is None or bytes(content[: len(name)]) != name:
                continue
        kept += [bytes((0xFF, kind)), data[start:position]]
    raise ImageError(
        "data", f"its data, {counted(len(data), 'byte')}, has more segments than an image takes"
    )


def _least_scanned(kind: int, content: memoryview, check_size: SizeCheck, data: memoryview) -> int:
    """Fewest bytes that all blocks of a frame take in its scans, at least 1."""
    if len(content) < 6:
        raise _unusable(data, 0)
    depth, height, width, components = struct.unpack(">BHHB", content[:6])
    check_size(width, height)
    if depth != 8 or components not in (1, 3, 4) or len(content) != 6 + 3 * components:
        raise ImageError(
            "data",
            f"its data has {components} components of {depth} bits; allowed: 1, 3 or 4 of 8 bits",
        )
    factors = [(content[at] >> 4, content[at] & 15) for at in range(7, len(content), 3)]
    widest, highest = (max(column) for column in zip(*factors, strict=True))
    if not all(1 <= factor <= 4 for pair in factors for factor in pair):
        raise _unusable(data, 0)
    blocks = sum(
        -(-width * across // (8 * widest)) * -(-height * down // (8 * highest))
        for across, down in factors
    )
    # No code is shorter than a bit: a block has one for its mean, and, where they are not in scans
    # of their own, one that ends its other coefficients.
    return -(-blocks * (2 if kind in _SEQUENTIAL else 1) // 8)


def _end_of_scan(data: memoryview, start: int) -> int:
    """Where the marker is that follows a scan's data: those of restarts belong to the scan."""
    octets = np.frombuffer(data, np.uint8)
    for begin in range(start, len(octets) - 1, _BLOCK):
        after = octets[begin + 1 : begin + 1 + _BLOCK]
        # Neither 0, an escaped 255, nor 255, a filling, nor 208 to 215: octets wrap around.
        is_kind = (after - np.uint8(1) < 207) | (after - np.uint8(216) < 39)
        markers = np.flatnonzero(is_kind & (octets[begin : begin + len(after)] == 0xFF))
        if markers.size:
            return begin + int(markers[0])
    raise ImageError("data", f"its data, {counted(len(data), 'byte')}, is cut off before the end")


def _unusable(data: memoryview, scans: int) -> ImageError:
    whole = "is damaged" if scans else "is not a whole JPEG image"
    return ImageError("data", f"its data, {counted(len(data), 'byte')}, {whole}")
