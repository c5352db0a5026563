"""The part of a PNG file that holds its pixels, checked before a decoder sees it.

A decoder inflates texts and color profiles too, and image data far beyond the size that the header
announces: a file of megabytes then takes gigabytes, or many seconds. So the image data is inflated
here, to its size and no further, and handed on without compression.

Source: ISO/IEC 15948, Portable Network Graphics, sections 5, 8 and 11.
"""

from __future__ import annotations

import struct
import zlib
from collections.abc import Iterator, Sequence

from pf_tracker_ros.decoding.image_decoding import ImageError, SizeCheck
from pf_tracker_ros.plurals import counted

SIGNATURE = b"\x89PNG\r\n\x1a\n"

_HEADER = struct.Struct(">IIBBBBB")
_PALETTE_COLOR = 3
# Color type to (samples a pixel, bits that a sample may have).
_COLOR_TYPES = {
    0: (1, (1, 2, 4, 8, 16)),
    2: (3, (8, 16)),
    _PALETTE_COLOR: (1, (1, 2, 4, 8)),
    4: (2, (8, 16)),
    6: (4, (8, 16)),
}
# (first column, first row, step of columns, step of rows) of each pass of an interlaced image.
_PASSES = (
    (0, 0, 8, 8),
    (4, 0, 8, 8),
    (0, 4, 4, 8),
    (2, 0, 4, 4),
    (0, 2, 2, 4),
    (1, 0, 2, 2),
    (0, 1, 1, 2),
)
# Encoders make chunks of several kilobytes, and a few others: more are there to keep us busy.
_MOST_CHUNKS = 1000
_LEAST_CHUNK = 1024
# Bytes that are inflated at once, and of those given to it.
_INFLATED = 2**20
_DEFLATED = 2**16


def pixel_data_of_png(data: memoryview, check_size: SizeCheck) -> bytes:
    """The same image in a PNG file of header, palette, pixels and end, not compressed.

    What else a file may hold, such as texts, thumbnails, color profiles, transparency and frames of
    an animation, is left out and not looked at.

    Args:
        data: A file that begins with `SIGNATURE`.
        check_size: Refuses a width and height; called before the pixels are inflated.

    Raises:
        ImageError: The file is damaged or cut off, its size is refused, or its pixels are more or
            less than the header announces.
    """
    if len(data) < len(SIGNATURE) + _HEADER.size + 12 or bytes(data[12:16]) != b"IHDR":
        raise ImageError(
            "data", f"its data, {counted(len(data), 'byte')}, is not a whole PNG image"
        )
    width, height, depth, color_type, *methods = _HEADER.unpack(data[16 : 16 + _HEADER.size])
    check_size(width, height)
    samples, depths = _COLOR_TYPES.get(color_type, (0, ()))
    *unused, interlacing = methods
    if depth not in depths or any(unused) or interlacing > 1:
        raise _damaged(data)
    needed, pixels = [], []
    for kind, content, checksum in _chunks(data):
        is_needed = kind[:1].isupper() and (kind != b"PLTE" or color_type == _PALETTE_COLOR)
        if not is_needed:
            continue
        if _checksum(kind, content) != checksum:
            raise _damaged(data)
        if kind == b"IDAT":
            pixels.append(content)
        needed.append((kind, content))
    palette = [content for kind, content in needed if kind == b"PLTE"]
    order = [b"IHDR", *[b"PLTE"] * len(palette), *[b"IDAT"] * len(pixels), b"IEND"]
    is_complete = len(palette) == (color_type == _PALETTE_COLOR) and pixels
    if [kind for kind, _ in needed] != order or not is_complete:
        raise _damaged(data)
    size = _raw_size(width, height, samples * depth, interlacing == 1)
    return b"".join(
        [
            SIGNATURE,
            *_chunk(b"IHDR", needed[0][1]),
            *(part for content in palette for part in _chunk(b"PLTE", content)),
            *(part for content in _stored(pixels, size, data) for part in _chunk(b"IDAT", content)),
            *_chunk(b"IEND", b""),
        ]
    )


def _chunks(data: memoryview) -> Iterator[tuple[bytes, memoryview, int]]:
    """Kind, content and checksum of each chunk up to the end; each is whole."""
    position = len(SIGNATURE)
    for _ in range(_MOST_CHUNKS + len(data) // _LEAST_CHUNK):
        start = position + 8
        end = start + int.from_bytes(data[position : position + 4], "big")
        position = end + 4
        if position > len(data):
            raise ImageError(
                "data", f"its data, {counted(len(data), 'byte')}, is cut off before the end"
            )
        kind = bytes(data[start - 4 : start])
        yield kind, data[start:end], int.from_bytes(data[end:position], "big")
        if kind == b"IEND":
            return
    raise ImageError(
        "data", f"its data, {counted(len(data), 'byte')}, has more chunks than an image takes"
    )


def _chunk(kind: bytes, content: bytes | memoryview) -> Iterator[bytes | memoryview]:
    """The parts of a chunk in a file."""
    yield struct.pack(">I", len(content)) + kind
    yield content
    yield struct.pack(">I", _checksum(kind, content))


def _checksum(kind: bytes, content: bytes | memoryview) -> int:
    return zlib.crc32(content, zlib.crc32(kind))


def _raw_size(width: int, height: int, bits: int, is_interlaced: bool) -> int:
    """Bytes of all rows, each with the byte that names its filter."""
    passes = _PASSES if is_interlaced else ((0, 0, 1, 1),)
    total = 0
    for first_column, first_row, column_step, row_step in passes:
        columns = max(0, -(-(width - first_column) // column_step))
        rows = max(0, -(-(height - first_row) // row_step))
        if columns:
            total += rows * (1 + -(-columns * bits // 8))
    return total


def _stored(pixels: Sequence[memoryview], expected: int, data: memoryview) -> Iterator[bytes]:
    """The same stream without compression, in parts.

    Args:
        pixels: The compressed stream, in parts.
        expected: Bytes that it inflates to.
        data: The file, for errors.

    Raises:
        ImageError: It inflates to less or more, which is found before it is inflated further.
    """
    inflater, storer = zlib.decompressobj(), zlib.compressobj(zlib.Z_NO_COMPRESSION)
    size = 0
    for part in _parts(pixels):
        if inflater.eof:
            raise _damaged(data)
        deflated: memoryview | bytes = part
        while deflated:
            try:
                raw = inflater.decompress(deflated, min(_INFLATED, expected + 1 - size))
            except zlib.error as error:
                raise _damaged(data) from error
            size += len(raw)
            if size > expected:
                raise ImageError("data", "its data inflates to more than its size announces")
            yield storer.compress(raw)
            deflated = inflater.unconsumed_tail
    if size < expected or not inflater.eof or inflater.unused_data:
        raise _damaged(data)
    yield storer.flush()


def _parts(pixels: Sequence[memoryview]) -> Iterator[memoryview]:
    for content in pixels:
        for start in range(0, len(content), _DEFLATED):
            yield content[start : start + _DEFLATED]


def _damaged(data: memoryview) -> ImageError:
    return ImageError("data", f"its data, {counted(len(data), 'byte')}, is damaged")
