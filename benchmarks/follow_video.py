"""A virtual camera that pans and tilts after a person in real footage, by the tracker's box.

    python benchmarks/follow_video.py --sequence MOT_DIR FRAMES --sequence MOT_DIR FRAMES

The camera sees a part of each image. It turns toward the box that the tracker gave one image
earlier, while `~/bearing` would be published; after two seconds without one it sweeps the image.
Those people are followed who are in most images, each from the first one to the last. A sequence
folder is one of the MOT challenge, as of `targets.py`.

in view: share of the images in which the camera sees the center of the person. right: share of
those in which the box is on the person. wrong: share of those called tracking with an IoU below
0.1. Rows: the box is drawn by hand; or a detector answers every half second, 0.3 s late, too.
"""

from __future__ import annotations

import argparse
import math
import os
import sys
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

# One thread for linear algebra; read when NumPy is imported.
os.environ["OPENBLAS_NUM_THREADS"] = "1"

import arguments as options_of
import cv2
import numpy as np
from follow_parts.chain import session
from follow_parts.detector import DELAY, INTERVAL
from numpy.typing import NDArray
from tables import Table
from targets import AnnotatedSequence, read_sequence

from pf_tracker_ros import Detections
from pf_tracker_ros.boxes import as_box, pairwise_iou
from pf_tracker_ros.footage import FootageError, open_footage
from pf_tracker_ros.frames import Frame
from pf_tracker_ros.localization.localizer_parameters import LocalizerParameters
from pf_tracker_ros.progress import progress_bar
from pf_tracker_ros.stamps import NANOSECONDS

Array = NDArray[np.float64]

# Share of the image in view, along each axis.
_SEEN = 0.5
# Of the camera: share of the offset that it turns in a second, largest turn and turn while it
# sweeps, in widths of its image a second, and seconds without a box after which it does.
_GAIN, _MAX_TURN, _SWEEP, _SWEEP_AFTER = 3.0, 1.0, 0.3, 2.0
_ON, _WRONG = 0.2, 0.1


@dataclass(frozen=True, eq=False)
class Person:
    """Somebody in a sequence.

    Attributes:
        id: In the ground truth.
        first: Their first image, counted from 0.
        boxes: (frames, 4) from there on, nan where there is none.
    """

    id: int
    first: int
    boxes: Array


def people_of(sequence: AnnotatedSequence) -> list[Person]:
    """Everybody, those in most images first."""
    people = []
    for id in np.unique(np.concatenate([one.ids for one in sequence.truth])).tolist():
        boxes = np.full((len(sequence.truth), 4), np.nan)
        for number, tracks in enumerate(sequence.truth):
            if id in tracks.ids:
                boxes[number] = tracks.boxes[tracks.ids == id][0]
        there = np.flatnonzero(np.isfinite(boxes[:, 0]))
        first, last = int(there[0]), int(there[-1])
        people.append(Person(int(id), first, boxes[first : last + 1]))
    return sorted(people, key=lambda one: (-len(one.boxes), one.id))


class VirtualCamera:
    """Sees a part of larger images.

    Attributes:
        corner: (2,) upper left corner of the part, pixels.
        size: (2,) width and height of it.

    Args:
        whole: (2,) width and height of the images.
        center: (2,) where it looks first.
    """

    def __init__(self, whole: Array, center: Array) -> None:
        self.size = np.floor(whole * _SEEN)
        self._room = whole - self.size
        self.corner = np.clip(center - self.size / 2.0, 0.0, self._room)
        self._unknown_for, self._sweep = 0.0, 1.0

    def see(self, image: NDArray[np.uint8]) -> NDArray[np.uint8]:
        """The part of an image in view, in whole pixels."""
        (x, y), (width, height) = self.corner.round().astype(int), self.size.astype(int)
        return np.ascontiguousarray(image[y : y + height, x : x + width])

    def turn(self, center: Array | None, interval: float) -> None:
        """Turn toward a (2,) point of the part, or sweep where there has been none for long."""
        self._unknown_for = 0.0 if center is not None else self._unknown_for + interval
        step = np.zeros(2)
        if center is not None:
            most = _MAX_TURN * self.size[0] * interval
            offset = center - self.size / 2.0
            step = np.clip(offset * min(1.0, _GAIN * interval), -most, most)
            self._sweep = math.copysign(1.0, offset[0])
        elif self._unknown_for > _SWEEP_AFTER:
            step[0] = self._sweep * _SWEEP * self.size[0] * interval
            if not 0.0 < self.corner[0] + step[0] < self._room[0]:
                self._sweep = -self._sweep
        self.corner = np.clip(self.corner + step, 0.0, self._room)


def follow(
    sequence: AnnotatedSequence,
    images: Sequence[NDArray[np.uint8]],
    person: Person,
    *,
    has_detector: bool,
) -> list[float]:
    """Follow a person; returns the shares in view, right and wrong.

    Args:
        sequence: Where they are.
        images: Its images.
        person: Whom to follow.
        has_detector: Whether the tracker gets the sequence's detections, too.
    """
    tracker = session(1, 0)
    trusted = LocalizerParameters().min_confidence
    whole = np.array(images[0].shape[1::-1], float)
    camera = VirtualCamera(whole, person.boxes[0, :2] + person.boxes[0, 2:] / 2.0)
    every = max(1, round(INTERVAL / sequence.interval))
    late: deque[tuple[float, int, Detections]] = deque()
    in_view, right, wrong = [], [], []
    for index, box in enumerate(person.boxes):
        number = person.first + index
        time, corner = index * sequence.interval, camera.corner.round()
        stamp, own = NANOSECONDS + round(time * NANOSECONDS), _moved(box[None], corner)
        if index == 0:
            tracker.request(as_box(own[0]), stamp)
        if has_detector and index % every == 0:
            found = _found(sequence.detections[number], corner, camera.size)
            late.append((time + DELAY, stamp, found))
        while late and late[0][0] <= time + 1e-6:
            tracker.add_detections(late[0][2], late.popleft()[1])
        tracker.process(Frame(camera.see(images[number]), stamp))
        estimate, center = tracker.estimate, None
        if estimate and estimate.state == "tracking" and estimate.confidence >= trusted:
            x, y, width, height = estimate.box
            center = np.array([x + width / 2.0, y + height / 2.0])
        if np.isfinite(box).all():
            middle = own[0, :2] + own[0, 2:] / 2.0
            is_seen = bool(((middle >= 0.0) & (middle < camera.size)).all())
            in_view.append(is_seen)
            tracks = sequence.truth[number]
            others = _moved(tracks.boxes[tracks.ids != person.id], corner)
            overlap = other = 0.0
            if estimate and estimate.state != "lost":
                given = np.array([estimate.box])
                overlap = float(pairwise_iou(given, own)[0, 0])
                other = float(pairwise_iou(given, others)[0].max(initial=0.0))
            if is_seen:
                right.append(overlap >= max(_ON, other))
            if estimate and estimate.state == "tracking":
                wrong.append(overlap < _WRONG)
        camera.turn(center, sequence.interval)
    return [float(np.mean(each)) if each else math.nan for each in (in_view, right, wrong)]


def _moved(boxes: Array, corner: Array) -> Array:
    """(N, 4) boxes as they are in the part of the image."""
    return boxes - [*corner, 0.0, 0.0]


def _found(rows: Array, corner: Array, size: Array) -> Detections:
    """The detections with their center in view, cut at its border."""
    begins = rows[:, :2] - corner
    ends = begins + rows[:, 2:4]
    is_seen = ((begins + ends > 0.0) & (begins + ends < 2.0 * size)).all(axis=1)
    begins, ends = np.clip(begins[is_seen], 0.0, size), np.clip(ends[is_seen], 0.0, size)
    boxes = [as_box(row) for row in np.hstack([begins, ends - begins])]
    return Detections(boxes, np.clip(rows[is_seen, 4], 0.0, 1.0), ["person"] * len(boxes))


def measured(options: argparse.Namespace) -> Table:
    """The table of all sequences."""
    sequences = [read_sequence(*map(Path, pair)) for pair in options.sequence]
    chosen = sorted(
        ((one, person) for one in sequences for person in people_of(one)),
        key=lambda pair: -len(pair[1].boxes),
    )[: options.people]
    groups = []
    with progress_bar(2 * len(chosen), "people") as on_progress:
        for sequence in sequences:
            images = [frame.image for frame in open_footage(sequence.frames).frames()]
            people = [person for one, person in chosen if one is sequence]
            for has_detector, name in ((False, "by hand"), (True, "with detector")):
                shares = []
                for person in people:
                    shares.append(follow(sequence, images, person, has_detector=has_detector))
                    on_progress(f"{sequence.name} {person.id}", 1)
                rows = [
                    [sequence.name, name, str(person.id), *(f"{one:.2f}" for one in figures)]
                    for person, figures in zip(people, shares, strict=True)
                ]
                means = [f"{one:.3f}" for one in np.nanmean(shares, axis=0)] if shares else []
                groups.append([*rows, [sequence.name, name, "mean", *means]] if means else rows)
    headings = ("sequence", "way", "person", "in view", "right", "wrong")
    return Table("A camera that follows people in real footage", headings, groups, names=3)


def main(argv: Sequence[str] | None = None) -> int:
    """Measure, print, and write `follow_video.md`."""
    cv2.setNumThreads(1)
    parser = options_of.parser(__doc__)
    parser.add_argument(
        "--sequence",
        nargs=2,
        action="append",
        required=True,
        metavar=("MOT_DIR", "FRAMES"),
        help="may be repeated",
    )
    parser.add_argument(
        "--people", type=options_of.at_least(1), default=20, metavar="N", help="[%(default)s]"
    )
    options_of.add_folder(parser)
    options = parser.parse_args(argv)
    try:
        table = measured(options)
        table.show()
        options.output.mkdir(parents=True, exist_ok=True)
        lines = [f"## {table.title}", "", *table.markdown(), ""]
        (options.output / "follow_video.md").write_text("\n".join(lines), encoding="utf-8")
    except (OSError, ValueError, FootageError) as error:
        parser.error(" ".join(str(error).split()))
    return 0


if __name__ == "__main__":
    sys.exit(main())
