"""Boxes: a part of an image, as four numbers."""

from __future__ import annotations

from collections.abc import Iterable

# (x, y, width, height) in pixels, (x, y) the top-left corner counted from 0; it covers
# [x, x + width) and [y, y + height).
Box = tuple[float, float, float, float]


def as_box(values: Iterable[float]) -> Box:
    """Four numbers as a box."""
    x, y, width, height = (float(value) for value in values)
    return x, y, width, height
