"""What every kind of appearance can do."""

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

# (D,) of one box.
Descriptor = NDArray[np.float32]


class Appearance(Protocol):
    """Describes what is in boxes, and compares descriptions.

    It is stateless: it is made once, for all targets, which own their descriptors.
    """

    @abstractmethod
    def extract(self, frame: Frame, boxes: NDArray[np.float64]) -> NDArray[np.float32]:
        """(N, D) descriptors of what is in (N, 4) boxes whose centers are inside the image.

        Those of all detections of a frame are asked for at once.
        """

    @abstractmethod
    def distance(self, descriptor: Descriptor, others: NDArray[np.float32]) -> NDArray[np.float64]:
        """(N,) how far a (D,) descriptor and (N, D) others differ, 0 (not at all) to 1.

        The scale is the same for every kind: two views of one target usually differ by about 0.12
        and hardly by more than 0.25, those of two targets mostly by more than that.
        """

    @abstractmethod
    def blend(self, descriptor: Descriptor, seen: Descriptor, share: float) -> Descriptor:
        """A descriptor moved to another by a share, 0 to 1."""

    def find(
        self,
        frame: Frame,
        descriptor: Descriptor,
        size: NDArray[np.float64],
        excluded: NDArray[np.float64],
        max_count: int,
    ) -> Sequence[NDArray[np.float64]]:
        """Where in an image it may be like a descriptor, the likeliest first, each a (4,) box.

        For a kind that can search a whole image within a frame's time; others find nothing.

        Args:
            frame: To be searched.
            descriptor: Looked for.
            size: (2,) width and height of the boxes, pixels.
            excluded: (K, 4) boxes of what is something else: what overlaps these is passed over.
            max_count: Boxes, which do not overlap each other by half; less where there is no room.
        """
        return ()


APPEARANCES = Registry[Appearance]("appearance", group="pf_tracker_ros.appearances")


@dataclass(frozen=True)
class AppearanceParameters:
    """What targets are told apart by over a long time."""

    kind: str = declared(
        "color_stripes",
        "What detections and targets are told apart by: color_stripes by the colors in stripes of "
        "their boxes.",
        choices=APPEARANCES,
        read_only=True,
    )
    of_kinds: dict[str, Any] = parts("kind", APPEARANCES)


def build_appearance(parameters: AppearanceParameters) -> Appearance:
    """The appearance that the parameters describe."""
    return APPEARANCES.make(parameters.kind, parameters.of_kinds[parameters.kind])
