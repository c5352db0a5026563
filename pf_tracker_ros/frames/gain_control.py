"""Automatic gain control: which values of a camera's images its 8-bit view spans, over time."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from pf_tracker_ros.frames.gray_range import GrayRange, Values, adapt_range, range_of, sample

# Seconds that images unlike those before must last, and be like each other: a shutter, a glitch on
# the wire or a flash leave the range alone.
_PATIENCE = 0.5
# An image suits a range that holds this share of its values, ...
_SHARE_INSIDE = 0.5
# ... and is at most so many times as wide, or as narrow, as the image's own: 32 grays are left to
# the narrower one.
_CONTRAST = 8.0


@dataclass(frozen=True)
class GainControl:
    """The gray range of a stream of images, and what it takes to move it; a value.

    The range follows slowly, so that templates see no jump while a sensor warms up. An image that
    is far outside of the range, fills next to nothing of it or exceeds it by far leaves it as it
    was, and so is shown clipped, or flat. Once such images have lasted, the range moves to where
    they are: at once if they were not to be seen, and slowly if they were. Where an image is seen
    well in the range before that, as after a shutter, it returns at once.

    Attributes:
        span: In use; None before the first image with values, and for images of 8 bit.
        earlier: The last one that was left at once; None if there is none.
        other: Of the last image, if that was unlike those before; else None.
        lasted: Seconds for which images have been unlike those before, and like each other.
    """

    span: GrayRange | None = None
    earlier: GrayRange | None = None
    other: GrayRange | None = None
    lasted: float = 0.0

    def follow(self, image: NDArray[np.generic], interval: float) -> GainControl:
        """The gain control as it is for this image.

        Args:
            image: (H, W) uint16 or float32, where pixels that are not finite are left out; images
                of 8 bit have no range.
            interval: Seconds since the image before.
        """
        if image.dtype == np.uint8:
            return self
        values = sample(image)
        if values.size == 0:
            return self
        own = range_of(values)
        if self.span is None:
            return GainControl(own)
        if _suits(self.span, values, own):
            return GainControl(adapt_range(self.span, own, interval), self.earlier)
        if self.earlier and _suits(self.earlier, values, own):
            return GainControl(adapt_range(self.earlier, own, interval), self.span)
        lasts = self.other is not None and _suits(self.other, values, own)
        lasted = self.lasted + interval if lasts else 0.0
        waiting = replace(self, other=own, lasted=lasted)
        return waiting if lasted < _PATIENCE else waiting._moved(self.span, values, own, interval)

    def _moved(
        self, span: GrayRange, values: Values, own: GrayRange, interval: float
    ) -> GainControl:
        """After an image unlike those before, of which there were others."""
        if not _holds(span, values):
            return GainControl(own, span)
        if _width(own) > _width(span):
            return replace(self, span=adapt_range(span, own, interval))
        # No range shows more of an image of one value.
        return self if values.min() == values.max() else GainControl(own, span)


def _suits(span: GrayRange, values: Values, own: GrayRange) -> bool:
    """Whether values, with a range of their own, are seen well in a range, and fill it."""
    ratio = _width(own) / _width(span)
    return 1.0 / _CONTRAST <= ratio <= _CONTRAST and _holds(span, values)


def _holds(span: GrayRange, values: Values) -> bool:
    with np.errstate(over="ignore"):
        inside = (values >= span[0]) & (values <= span[1])
    return bool(np.count_nonzero(inside) >= _SHARE_INSIDE * values.size)


def _width(span: GrayRange) -> float:
    return span[1] - span[0]
