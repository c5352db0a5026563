"""CPU time of a frame with eight targets, compared with one target and OpenCV's CSRT.

Eight people walk left and right in front of a street without occlusion, as occluded targets cost
next to nothing. Everything has one thread. Each setting has its own process, and all alternate, so
that other load slows all of them. The figures are medians over the rounds. The 99th percentile is
that of frames with detections, if any. CSRT tracks one of the people.

    python benchmarks/multi_target_cost.py --rounds 6 --size 1920x1080

In a larger image the people have the size and place of 640x480. CSRT needs
`opencv-contrib-python-headless`.
"""

from __future__ import annotations

import multiprocessing
import time
from collections.abc import Callable
from statistics import fmean, median

import arguments as options_of
import cv2
import numpy as np
from numpy.typing import NDArray
from scenes.camera import HandheldCamera
from scenes.scene import Scene
from scenes.stage import Stage
from scenes.street import Street
from scenes.walkers import Person, standing_boxes
from tables import Table

from pf_tracker_ros import Detections, MultiTracker

SIZES = ("640x480", "1920x1080")
FRAMES = 72
# The first frames build tables and learn the targets.
SETTLING = 12
INTERVAL = 1.0 / 30.0
PEOPLE = 8
_COLUMNS, _SPACING, _HEIGHT, _AMPLITUDE, _PERIOD = 4, 160.0, 84.0, 24.0, 60.0

Image = NDArray[np.uint8]
Step = Callable[[int, Image], object]


class People(Scene):
    """Eight people in two rows, who walk left and right in (people, frames, 4) boxes."""

    def __init__(self, size: tuple[int, int]) -> None:
        background, looks, camera = np.random.default_rng(0).spawn(3)
        actors, boxes = [], []
        time_of = np.arange(FRAMES)
        for number in range(PEOPLE):
            row, column = divmod(number, _COLUMNS)
            phase = 2.0 * np.pi * (time_of / _PERIOD + number / PEOPLE)
            across = (column + 0.5) * _SPACING + _AMPLITUDE * np.sin(phase)
            feet = np.stack([across, np.full(FRAMES, 230.0 + 190.0 * row)], axis=1)
            coat, trousers = looks.uniform(25.0, 220.0, (2, 3))
            actors.append(Person(_HEIGHT, tuple(coat), tuple(trousers), 1).walking(feet))
            boxes.append(standing_boxes(feet, _HEIGHT))
        street = Street(size, 150, 200, 300, ((40, 60, 200), (180, 120, 30), (40, 160, 60)))
        still = HandheldCamera(
            camera, size=size, margin=1, frames=FRAMES, shake=0.0, lighting=0.0, noise=2.5
        )
        still.offsets[:] = 0.0
        self.boxes = np.stack(boxes)
        stage = Stage(street.draw(background), tuple(actors))
        super().__init__("people", stage, still, self.boxes[0])


def _csrt(scene: People) -> Step:
    tracker = cv2.TrackerCSRT.create()

    def step(number: int, image: Image) -> object:
        if number == 0:
            return tracker.init(image, tuple(np.rint(scene.boxes[0, 0]).astype(int).tolist()))
        return tracker.update(image)

    return step


def _by_hand(count: int) -> Callable[[People], Step]:
    def make(scene: People) -> Step:
        tracker = MultiTracker.from_preset("default", seed=0)

        def step(number: int, image: Image) -> object:
            if number == 0:
                return [tracker.start(image, tuple(box)) for box in scene.boxes[:count, 0]]
            targets = tracker.update(image, INTERVAL)
            _check(len(targets), count)
            return targets

        return step

    return make


def _detected(every: int) -> Callable[[People], Step]:
    def make(scene: People) -> Step:
        tracker = MultiTracker.from_preset("default", seed=0)
        scores = np.full(PEOPLE, 0.9)

        def step(number: int, image: Image) -> object:
            # Detections in each of the first frames, as a start takes two.
            is_seen = number < 2 or number % every == 0
            found = Detections(scene.boxes[:, number], scores) if is_seen else None
            targets = tracker.update(image, INTERVAL, found)
            if number >= SETTLING:
                _check(len(targets), PEOPLE)
            return targets

        return step

    return make


def _check(count: int, wanted: int) -> None:
    if count != wanted:
        raise SystemExit(
            f"{count} targets are tracked instead of {wanted}, so the time is not comparable"
        )


WAYS: dict[str, Callable[[People], Step]] = {
    "CSRT, one target": _csrt,
    "one target": _by_hand(1),
    "8 by hand": _by_hand(PEOPLE),
    "8, a detector every 12th frame": _detected(12),
    "8, a detector every 5th frame": _detected(5),
}


def times_of(way: str, size: str) -> list[float]:
    """CPU time of each frame after the first ones, milliseconds."""
    cv2.setNumThreads(1)
    width, height = map(int, size.split("x"))
    scene = People((width, height))
    step = WAYS[way](scene)
    times = []
    for number, image in enumerate(scene.images):
        began = time.process_time()
        step(number, image)
        times.append(1e3 * (time.process_time() - began))
    return times[SETTLING:]


def main() -> None:
    """Run the command line."""
    parser = options_of.parser(__doc__)
    parser.add_argument("--rounds", type=options_of.at_least(1), default=6, metavar="N")
    parser.add_argument(
        "--size", choices=SIZES, default=SIZES[0], help="of the images [%(default)s]"
    )
    options = parser.parse_args()
    ways = [way for way in WAYS if way != "CSRT, one target" or hasattr(cv2, "TrackerCSRT")]
    jobs = [(way, options.size) for way in ways] * options.rounds
    with multiprocessing.get_context("spawn").Pool(1, maxtasksperchild=1) as pool:
        found = pool.starmap(times_of, jobs, chunksize=1)
    rows = []
    for number, way in enumerate(ways):
        rounds = found[number :: len(ways)]
        of_rounds = [(median(times), fmean(times), np.percentile(times, 99)) for times in rounds]
        rows.append([way, *(f"{value:.1f}" for value in np.median(of_rounds, axis=0))])
    headings = (options.size, "median", "mean", "99 %")
    Table(f"Several targets, {options.size}", headings, rows).show()


if __name__ == "__main__":
    main()
