"""The drawn streets of the demo: people who walk along shops, a parked van, trees.

Drawn with `benchmarks/scenes`, in the size in which they are shown. The same bits in every run.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pf_tracker_ros.footage.base import frame_stamp
from pf_tracker_ros.frames import Frame

sys.path.append(str(Path(__file__).resolve().parents[1] / "benchmarks"))

from scenes.camera import HandheldCamera
from scenes.sprites import Color, Drawing
from scenes.stage import Actor, Stage
from scenes.street import Street
from scenes.textures import fractal_noise, smooth_path
from scenes.trees import Tree, plant
from scenes.walkers import Person

WIDTH, HEIGHT = 800, 450
RATE, FRAMES = 20.0, 240
_MARGIN = 16
_SIZE = WIDTH + 2 * _MARGIN, HEIGHT + 2 * _MARGIN
# Rows of the stage: the top of the shops, the foot of the houses and the curb.
_STOREY, _HOUSE_LINE, _CURB = 132, 262, 372
_ACCENTS: tuple[Color, ...] = (
    (60, 70, 170),
    (150, 110, 50),
    (70, 140, 90),
    (60, 160, 200),
    (190, 190, 190),
)
# Pixels of a person's height at the houses, and more for each row below.
_FARTHEST, _GROWTH = 100.0, 0.45


class Walk(NamedTuple):
    """Somebody who walks through the street.

    Attributes:
        start: Column of the feet in the first frame, pixels of the image.
        speed: Pixels per second, negative to the left.
        lane: Row of the feet; those below are nearer and larger.
        coat: Color, BGR.
        trousers: Color, BGR.
    """

    start: float
    speed: float
    lane: float
    coat: Color
    trousers: Color


class StreetFootage:
    """A drawn street as `Footage`.

    Args:
        name: Of the clip.
        walks: The people.
        foreground: (H, W, 4) float32, what stands before them.
        seed: Of houses, camera and cloth.
    """

    ground_truth = None
    frame_count = FRAMES
    nominal_interval = 1.0 / RATE

    def __init__(
        self, name: str, walks: Sequence[Walk], foreground: NDArray[np.float32], seed: int
    ) -> None:
        self.name = name
        houses, cloth, camera = np.random.default_rng(seed).spawn(3)
        backdrop = Street(_SIZE, _STOREY, _HOUSE_LINE, _CURB, _ACCENTS).draw(houses)
        people = sorted(walks, key=lambda one: one.lane)
        self._stage = Stage(backdrop, tuple(_actor(cloth, one) for one in people), foreground)
        self._camera = HandheldCamera(
            camera,
            size=(WIDTH, HEIGHT),
            margin=_MARGIN,
            frames=FRAMES,
            shake=2.0,
            lighting=0.02,
            noise=2.0,
        )

    def frames(self) -> Iterator[Frame]:
        """The frames; each call starts from the first."""
        for index in range(FRAMES):
            image = self._camera.shoot(self._stage.paint(index), index)
            yield Frame(image, frame_stamp(index, self.nominal_interval))


def hidden() -> StreetFootage:
    """Somebody in red walks behind a parked van; others pass before and afterwards."""
    red, blue = (50.0, 45.0, 190.0), (150.0, 95.0, 50.0)
    walks = (
        Walk(64.0, 56.0, 336.0, red, (60.0, 50.0, 45.0)),
        Walk(250.0, -48.0, 326.0, blue, (80.0, 70.0, 60.0)),
        Walk(600.0, 62.0, 330.0, (95.0, 130.0, 75.0), (55.0, 55.0, 60.0)),
        Walk(1290.0, -70.0, 328.0, (70.0, 150.0, 185.0), (90.0, 60.0, 50.0)),
    )
    return StreetFootage("hidden", walks, _van(310.0, 424.0), seed=1)


def people() -> StreetFootage:
    """Seven people who pass each other, and trees before them."""
    walks = (
        Walk(90.0, 58.0, 334.0, (60.0, 60.0, 185.0), (70.0, 55.0, 50.0)),
        Walk(700.0, -66.0, 340.0, (165.0, 100.0, 45.0), (60.0, 65.0, 70.0)),
        Walk(330.0, 34.0, 348.0, (190.0, 195.0, 200.0), (95.0, 65.0, 45.0)),
        Walk(560.0, -40.0, 356.0, (85.0, 140.0, 70.0), (50.0, 50.0, 55.0)),
        Walk(-120.0, 78.0, 366.0, (60.0, 165.0, 205.0), (75.0, 80.0, 85.0)),
        Walk(960.0, -72.0, 378.0, (140.0, 75.0, 125.0), (55.0, 50.0, 45.0)),
        Walk(-330.0, 84.0, 345.0, (110.0, 120.0, 60.0), (60.0, 75.0, 100.0)),
    )
    generator = np.random.default_rng(3)
    trees = tuple(
        Tree(x=x, ground=_CURB + 6.0, height=330.0, trunk=18.0, crown=80.0, hanging=110.0)
        for x in (215.0, 640.0)
    )
    return StreetFootage("people", walks, plant(generator, _SIZE, trees), seed=2)


SCENES: dict[str, Callable[[], StreetFootage]] = {"hidden": hidden, "people": people}
"""By the name of the clip."""


def _actor(generator: np.random.Generator, walk: Walk) -> Actor:
    height = _FARTHEST + _GROWTH * (walk.lane - _HOUSE_LINE)
    facing = 1 if walk.speed > 0.0 else -1
    cloth = fractal_noise(generator, (240, 200), 14.0)
    times = np.arange(FRAMES) / RATE
    columns = _MARGIN + walk.start + walk.speed * times
    columns += 3.0 * smooth_path(generator, FRAMES, period=40.0)[:, 0]
    feet = np.stack([columns, np.full(FRAMES, walk.lane)], axis=1)
    person = Person(height, walk.coat, walk.trousers, facing)
    return person.walking(feet, 1.0 + 0.35 * (cloth - cloth.mean()))


def _van(left: float, ground: float) -> NDArray[np.float32]:
    """A delivery van at the curb, its front to the right."""
    drawing = Drawing(*_SIZE)
    white, dark, glass = (205.0, 208.0, 204.0), (38.0, 38.0, 40.0), (120.0, 112.0, 98.0)

    def shape(points: Sequence[tuple[float, float]], color: Color) -> None:
        drawing.polygon([(left + x, ground - 1.28 * y) for x, y in points], color)

    drawing.ellipse((left + 122.0, ground - 1.0), (134.0, 7.0), (52.0, 52.0, 54.0))
    # From the rear bumper along the roof to the bonnet.
    shape(
        [
            *((0, 22), (0, 168), (6, 178), (172, 178), (186, 170), (214, 112)),
            *((238, 98), (246, 86), (248, 22)),
        ],
        white,
    )
    shape([(0, 22), (0, 44), (248, 44), (248, 22)], (120.0, 80.0, 40.0))
    shape([(154, 162), (180, 162), (206, 112), (154, 112)], glass)
    shape([(150, 162), (154, 162), (154, 44), (150, 44)], (170.0, 172.0, 168.0))
    shape([(14, 160), (138, 160), (138, 92), (14, 92)], (130.0, 95.0, 55.0))
    shape([(26, 132), (126, 132), (126, 124), (26, 124)], white)
    shape([(26, 116), (96, 116), (96, 108), (26, 108)], white)
    shape([(160, 96), (176, 96), (176, 92), (160, 92)], dark)
    shape([(238, 74), (248, 74), (248, 58), (238, 58)], (150.0, 220.0, 240.0))
    for wheel in (50.0, 200.0):
        center = left + wheel, ground - 22.0
        for radius, color in (
            (27.0, dark),
            (23.0, (25.0, 25.0, 26.0)),
            (11.0, (165.0, 165.0, 168.0)),
        ):
            drawing.ellipse(center, (radius, radius), color)
    return drawing.pixels()
