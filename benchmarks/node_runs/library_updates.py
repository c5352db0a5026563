"""CPU time of `Tracker.update` in a process without ROS, frames at the rate of a camera.

    python benchmarks/node_runs/library_updates.py 768 576 30 300

prints the mean milliseconds of an update.
"""

from __future__ import annotations

import itertools
import os
import sys
import time

os.environ["OPENBLAS_NUM_THREADS"] = "1"

import cv2
from moving_square import BOX, moving_square

from pf_tracker_ros import Tracker

_WARM_UP = 60


def main() -> None:
    """Measure and print."""
    width, height, rate, count = (int(argument) for argument in sys.argv[1:])
    cv2.setNumThreads(1)
    images = moving_square(width, height)
    tracker = Tracker.from_preset("default", seed=0)
    tracker.start(images[0], BOX)
    spent, due = 0.0, time.monotonic()
    for number, image in enumerate(itertools.islice(itertools.cycle(images), 1, _WARM_UP + count)):
        time.sleep(max(0.0, due - time.monotonic()))
        due = max(due + 1.0 / rate, time.monotonic())
        began = time.process_time()
        tracker.update(image, 1.0 / rate)
        if number >= _WARM_UP:
            spent += time.process_time() - began
    print(1e3 * spent / (count - 1))


if __name__ == "__main__":
    main()
