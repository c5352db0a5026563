"""The interface of an appearance: extract, compare, average and search for descriptors."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from pf_tracker_ros.frames import Frame
from pf_tracker_ros.parameters import declared, parts
from pf_tracker_ros.registry import Registry

# (D,) descriptor of one box.
Descriptor = NDArray[np.float32]


class Appearance(Protocol):
    """Computes and compares descriptors of boxes.

    It is stateless; descriptors are values, stored in the tracks.
    """

    @abstractmethod
    def extract(self, frame: Frame, boxes: NDArray[np.float64]) -> NDArray[np.float32]:
        """(N, D) descriptors of (N, 4) boxes with centers inside the image.

        It is called once for all detections of a frame.
        """

    @abstractmethod
    def distance(self, descriptor: Descriptor, others: NDArray[np.float32]) -> NDArray[np.float64]:
        """(N,) distances, 0 (equal) to 1, of a (D,) descriptor from (N, D) others.

        Every kind has the same scale: descriptors of one target usually differ by about 0.12 and
        rarely by more than 0.25; those of two targets mostly by more.
        """

    @abstractmethod
    def blend(self, descriptor: Descriptor, other: Descriptor, share: float) -> Descriptor:
        """A weighted mean of two descriptors; `share`, 0 to 1, is the weight of the other."""

    def find(
        self,
        frame: Frame,
        descriptor: Descriptor,
        size: NDArray[np.float64],
        excluded: NDArray[np.float64],
        max_count: int,
    ) -> Sequence[NDArray[np.float64]]:
        """(4,) boxes in an image that match a descriptor, the best first.

        Optional, for a kind that can search a whole image within a frame's time. By default none.

        Args:
            frame: Frame to search.
            descriptor: Descriptor of the target.
            size: (2,) width and height of the boxes, pixels.
            excluded: (K, 4) boxes of other objects; boxes that overlap them are skipped.
            max_count: Largest number of boxes; they are apart by half a side or more.
        """
        return ()


APPEARANCES = Registry[Appearance]("appearance", group="pf_tracker_ros.appearances")


@dataclass(frozen=True)
class AppearanceParameters:
    """The appearance that identifies targets over a long time."""

    kind: str = declared(
        "color_stripes",
        "Appearance that identifies targets: color_stripes uses color histograms of horizontal "
        "stripes of their boxes; embedding uses a network that you supply.",
        choices=APPEARANCES,
        read_only=True,
    )
    of_kinds: dict[str, Any] = parts("kind", APPEARANCES)


def build_appearance(parameters: AppearanceParameters) -> Appearance:
    """The appearance that the parameters describe."""
    return APPEARANCES.make(parameters.kind, parameters.of_kinds[parameters.kind])
