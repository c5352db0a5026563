"""Positions of rendered people before a depth camera."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from tables import Table
from world_scenes import Person, Renderer, box_around, corrupted

from pf_tracker_ros.progress import OnProgress
from pf_tracker_ros.world import CameraModel, GroundPlane, Localizer
from world_parts.errors import Array, auroc, position_errors

FRAMES = 200
CAMERA, PITCH = CameraModel(525.0, 525.0, 319.5, 239.5, 640, 480), 0.05
# Standard deviation of center and size of the boxes of rendered people, pixels.
BOX_SD = 3.0


def rendered_table(on_progress: OnProgress, frames: int = FRAMES) -> Table:
    """Rendered people with 30 % holes and background in half of the box."""
    rows = []
    for name, height in (("camera at 1.2 m", 1.2), ("ground unknown", None)):
        localizer = Localizer(CAMERA, height, PITCH)
        # Both rows of a camera draw from one generator.
        people = RenderedPeople(np.random.default_rng(0))
        for label, has_occluder in (("", False), (", occluder", True)):
            samples = [people.sample(index, has_occluder) for index in range(frames)]
            rows.append([name + label, *_cells(localizer, samples, has_occluder, on_progress)])
    headings = (
        "",
        "located",
        "range median %",
        "90 %",
        "position median %",
        "90 %",
        "NEES",
        "inside",
        "no place",
        "AUROC",
    )
    return Table("Rendered people, 30 % holes, background in half of the box", headings, [rows])


@dataclass(frozen=True, eq=False)
class Sample:
    """A rendered person.

    Attributes:
        box: x, y, width, height in pixels.
        depth: (H, W) depth image, meters.
        position: (3,) the person's lower center in camera coordinates, meters.
        is_hidden: Whether another person hides more than a twentieth of it.
    """

    box: Array
    depth: NDArray[np.float32]
    position: Array
    is_hidden: bool


class RenderedPeople:
    """Draws people before a wall at 9 m.

    Args:
        generator: What is drawn from.
    """

    def __init__(self, generator: np.random.Generator) -> None:
        self._generator = generator
        self._renderer = Renderer(CAMERA, GroundPlane.from_angles(1.2, PITCH), 9.0)
        self._rays, self._background = self._renderer.background()

    def sample(self, index: int, has_occluder: bool) -> Sample:
        """The next person, in every second sample behind another one."""
        generator = self._generator
        person = Person(
            generator.uniform(3.5, 7.0),
            generator.uniform(-0.3, 0.3),
            generator.normal(1.75, 0.08),
            generator.uniform(-np.pi, np.pi),
        )
        depth = self._background.copy()
        mask = self._renderer.add(self._rays, depth, person)
        x, y, width, height = box_around(mask)
        dx, dy, dw, dh = generator.normal(0.0, BOX_SD, 4)
        box = np.array([x - width / 2.0, y, 2.0 * width, height])
        box += (dx - dw / 2.0, dy - dh / 2.0, dw, dh)
        is_hidden = False
        if has_occluder and index % 2:
            other = Person(0.6 * person.distance, person.bearing + 0.04, 1.7, np.pi / 2.0)
            hidden = self._renderer.add(self._rays, depth, other) & mask
            is_hidden = bool(hidden.sum() / mask.sum() > 0.05)
        holed = corrupted(depth, 0.3, generator)
        return Sample(box, holed, self._renderer.position(person), is_hidden)


def _cells(
    localizer: Localizer, samples: Sequence[Sample], has_occluder: bool, on_progress: OnProgress
) -> list[str]:
    """The cells of a row after its name."""
    places = []
    for sample in samples:
        prediction = (float(np.linalg.norm(sample.position)), 0.2) if has_occluder else None
        places.append(
            localizer.locate(
                sample.box,
                BOX_SD**2 * np.eye(4),
                depth=sample.depth,
                predicted_range=prediction,
            )
        )
        on_progress("rendered", 1)
    positions = np.array([sample.position for sample in samples])
    ranges, errors, missing = position_errors(places, positions, np.ones(len(places), dtype=bool))
    evidence = [0.0 if place is None else place.occlusion or 0.0 for place in places]
    hidden = np.array([sample.is_hidden for sample in samples])
    return [
        *ranges.cells(100.0)[:3],
        *errors.cells(100.0)[1:],
        str(missing),
        auroc(np.array(evidence), hidden) if has_occluder else "-",
    ]
