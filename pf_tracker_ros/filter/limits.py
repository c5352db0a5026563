"""What keeps a state sane: centers inside the image, sizes to look at, times to predict over."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

# Smaller boxes hold too few pixels to tell a target from its surroundings.
SMALLEST_SIDE = 6.0
# Seconds that one step of an equation of motion stands for, where it counts steps and not time.
MODEL_STEP = 0.04
# So many steps of a motion model at once are an age; more would overflow where it diverges.
_MOST_STEPS = 200.0
# Seconds after which a prediction covers all that can be; numbers would overflow in the end.
LONGEST_PREDICTION = 60.0


def model_steps(interval: float) -> float:
    """How many steps of an equation of motion an interval in seconds is, if not an age."""
    return min(interval / MODEL_STEP, _MOST_STEPS)


def limit_centers(states: NDArray[np.float64], image_size: tuple[int, int]) -> NDArray[np.float64]:
    """(N, D) states with the centers, columns 0 and 1, moved into an image of (width, height)."""
    limited = states.copy()
    # Column by column: over many rows of two numbers it would take five times as long.
    for axis, length in enumerate(image_size):
        centers = limited[:, axis]
        np.maximum(centers, 0.0, out=centers)
        np.minimum(centers, length, out=centers)
    return limited


def limit_sizes(
    sizes: NDArray[np.float64], first_size: ArrayLike, image_size: tuple[int, int]
) -> NDArray[np.float64]:
    """(N, 2) sizes brought between `SMALLEST_SIDE` and the image's.

    A target whose first (width, height) is smaller may stay so.
    """
    smallest = np.minimum(SMALLEST_SIDE, first_size)
    return np.minimum(np.maximum(sizes, smallest), np.maximum(image_size, smallest))
