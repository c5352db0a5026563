"""What every kind of features can do."""

from __future__ import annotations

from typing import ClassVar, Protocol

import numpy as np
from numpy.typing import NDArray

from pf_tracker_ros.registry import Registry


class Features(Protocol):
    """Turns windows of the image into channels, one value for each cell of them.

    Attributes:
        stride: Pixels along each side of a cell.
    """

    stride: ClassVar[int]

    def extract(self, windows: NDArray[np.uint8]) -> NDArray[np.float32]:
        """The channels of windows, each as if there were no other.

        Args:
            windows: (K, P, P, 3) BGR or (K, P, P) gray, P a multiple of `stride`.

        Returns:
            (K, channels, P / stride, P / stride). The number of channels may differ between colored
            and gray windows, and in nothing else.
        """


FEATURES = Registry[Features]("kind of features")
