"""A street as a backdrop: houses with shops, a pavement full of things, a road in front."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from scenes.sprites import Color
from scenes.textures import fractal_noise

Image = NDArray[np.uint8]

_WALLS: tuple[Color, ...] = (
    (120, 150, 175),
    (95, 120, 160),
    (150, 165, 175),
    (110, 130, 140),
    (135, 140, 150),
    (85, 105, 150),
)


@dataclass(frozen=True)
class Street:
    """Where things are in a street, in rows of the image, and what colors stand out."""

    size: tuple[int, int]  # (width, height) in pixels
    storey: int  # row where the shops end and the upper storeys begin, going up
    house_line: int  # row where houses meet the pavement
    curb: int  # row where the pavement meets the road
    # colors of signs, goods and boards, drawn with equal chance
    accents: tuple[Color, ...]

    def draw(self, generator: np.random.Generator) -> Image:
        """Draw the street: (height, width, 3) uint8, blue, green, red."""
        width, height = self.size
        image = np.zeros((height, width, 3), np.uint8)
        self._draw_ground(generator, image)
        self._draw_houses(generator, image)
        self._draw_pavement_clutter(generator, image)
        grain = fractal_noise(generator, (height, width), coarsest=90.0, octaves=6)
        shaded = image * (0.8 + 0.4 * grain[..., None])
        return np.clip(shaded, 0, 255).astype(np.uint8)

    def _accent(self, generator: np.random.Generator) -> Color:
        return _varied(generator, self.accents[generator.integers(len(self.accents))], 0.12)

    def _draw_ground(self, generator: np.random.Generator, image: Image) -> None:
        width, height = self.size
        _textured(generator, image, (0, self.house_line, width, self.curb), (148, 152, 156), 0.12)
        row, step = float(self.house_line), 7.0
        while row < self.curb:
            cv2.line(image, (0, round(row)), (width, round(row)), (118, 121, 124), 1, cv2.LINE_AA)
            shift = generator.uniform(0, 30)
            for x in np.arange(-shift, width, 30.0):
                start, end = (round(x), round(row)), (round(x - 5), round(row + step))
                cv2.line(image, start, end, (124, 127, 130), 1, cv2.LINE_AA)
            row, step = row + step, step * 1.18
        _textured(generator, image, (0, self.curb, width, height), (92, 92, 94), 0.18)
        cv2.rectangle(image, (0, self.curb), (width, self.curb + 6), (165, 168, 170), -1)
        cv2.rectangle(image, (0, self.curb + 6), (width, self.curb + 9), (60, 62, 64), -1)

    def _draw_houses(self, generator: np.random.Generator, image: Image) -> None:
        width, _ = self.size
        left = -int(generator.integers(0, 120))
        while left < width:
            right = left + int(generator.integers(190, 300))
            wall = _varied(generator, _WALLS[generator.integers(len(_WALLS))], 0.12)
            _textured(generator, image, (left, 0, right, self.house_line), wall, 0.16)
            self._draw_windows(generator, image, left, right)
            middle = left + int((right - left) * generator.uniform(0.4, 0.6))
            for start, end in ((left + 4, middle - 3), (middle + 3, right - 4)):
                self._draw_shop(generator, image, start, end)
            cv2.line(image, (right, 0), (right, self.house_line), (70, 75, 80), 2)
            left = right

    def _draw_windows(
        self, generator: np.random.Generator, image: Image, left: int, right: int
    ) -> None:
        pitch = int(generator.integers(48, 66))
        frame = _varied(generator, (205, 210, 212), 0.1)
        for bottom in range(self.storey - 22, -40, -94):
            for x in range(left + 14, right - 38, pitch):
                glass = _varied(generator, (92, 82, 74), 0.3)
                cv2.rectangle(image, (x - 2, bottom - 60), (x + 32, bottom + 2), frame, -1)
                cv2.rectangle(image, (x, bottom - 58), (x + 30, bottom), glass, -1)
                cv2.line(image, (x + 15, bottom - 58), (x + 15, bottom), frame, 2)
                cv2.line(image, (x, bottom - 34), (x + 30, bottom - 34), frame, 2)

    def _draw_shop(
        self, generator: np.random.Generator, image: Image, left: int, right: int
    ) -> None:
        top, bottom = self.storey, self.house_line
        trim = _varied(generator, (75, 80, 88), 0.3)
        cv2.rectangle(image, (left, top - 16), (right, bottom), trim, -1)
        door_right = generator.random() < 0.5
        door = (right - 32, right - 4) if door_right else (left + 4, left + 32)
        pane = (left + 5, right - 37) if door_right else (left + 37, right - 5)
        glass = _varied(generator, (104, 98, 92), 0.25)
        _textured(generator, image, (pane[0], top + 8, pane[1], bottom - 14), glass, 0.3)
        self._draw_goods(generator, image, (pane[0], top + 26, pane[1], bottom - 14))
        cv2.rectangle(image, (door[0], top + 12), (door[1], bottom), (58, 60, 66), -1)
        cv2.rectangle(image, (door[0] + 4, top + 18), (door[1] - 4, bottom - 28), glass, -1)
        self._draw_sign(generator, image, (left, top - 16, right, top + 2))

    def _draw_goods(
        self, generator: np.random.Generator, image: Image, area: tuple[int, int, int, int]
    ) -> None:
        """Things in a shop window, on two shelves."""
        left, top, right, bottom = area
        for shelf in (top + (bottom - top) // 2, bottom):
            x = left + 2
            while x < right - 8:
                wide, tall = int(generator.integers(6, 18)), int(generator.integers(8, 30))
                color = self._accent(generator)
                if generator.random() < 0.5:
                    color = _varied(generator, (120, 130, 140), 0.5)
                if generator.random() < 0.7:
                    end = (min(x + wide, right - 1), shelf - 1)
                    cv2.rectangle(image, (x, shelf - tall), end, color, -1)
                else:
                    cv2.circle(image, (x + wide // 2, shelf - wide // 2), wide // 2, color, -1)
                x += wide + int(generator.integers(1, 9))
            cv2.line(image, (left, shelf), (right, shelf), (70, 74, 80), 2)

    def _draw_sign(
        self, generator: np.random.Generator, image: Image, area: tuple[int, int, int, int]
    ) -> None:
        (left, top, right, bottom), color = area, self._accent(generator)
        cv2.rectangle(image, (left, top), (right, bottom), color, -1)
        dark = sum(color) > 330
        ink: Color = (40, 40, 45) if dark else (225, 230, 232)
        letters = generator.integers(65, 91, int(generator.integers(5, 9)))
        text = "".join(chr(letter) for letter in letters)
        place = (left + 10, bottom - 4)
        cv2.putText(image, text, place, cv2.FONT_HERSHEY_DUPLEX, 0.48, ink, 1, cv2.LINE_AA)

    def _draw_pavement_clutter(self, generator: np.random.Generator, image: Image) -> None:
        """Hedges and boards before the houses."""
        width, _ = self.size
        x = int(generator.integers(0, 30))
        while x < width:
            draw = self._draw_hedge if generator.random() < 0.4 else self._draw_board
            x += draw(generator, image, x) + int(generator.integers(6, 34))

    def _draw_hedge(self, generator: np.random.Generator, image: Image, left: int) -> int:
        length, tall = int(generator.integers(50, 120)), int(generator.integers(26, 46))
        ground = self.house_line + 8
        for _ in range(length * 5):
            x = left + int(generator.integers(0, length))
            y = ground - int(tall * generator.random())
            light = generator.uniform(0.45, 1.2)
            leaf = (44 * light, 92 * light, 66 * light)
            cv2.circle(image, (x, y), int(generator.integers(1, 4)), leaf, -1, cv2.LINE_AA)
        return length

    def _draw_board(self, generator: np.random.Generator, image: Image, left: int) -> int:
        ground, wide = self.house_line + 10, int(generator.integers(24, 36))
        cv2.rectangle(image, (left, ground - 52), (left + wide, ground), (60, 75, 95), -1)
        face = (left + 3, ground - 49, left + wide - 3, ground - 6)
        cv2.rectangle(image, face[:2], face[2:], self._accent(generator), -1)
        for row in range(face[1] + 6, face[3] - 3, 7):
            end = int(generator.integers(face[0] + 8, face[2] - 1))
            cv2.line(image, (face[0] + 3, row), (end, row), (228, 230, 232), 2)
        return wide


def _varied(generator: np.random.Generator, color: Color, amount: float) -> Color:
    """A color of slightly different brightness and tint."""
    factors = generator.uniform(1 - amount, 1 + amount) * generator.uniform(
        1 - amount / 4, 1 + amount / 4, 3
    )
    blue, green, red = np.clip(np.asarray(color) * factors, 0, 255)
    return (float(blue), float(green), float(red))


def _textured(
    generator: np.random.Generator,
    image: Image,
    area: tuple[int, int, int, int],
    color: Color,
    contrast: float,
) -> None:
    """Fill the area (left, top, right, bottom), cut to the image, with an uneven color."""
    height, width = image.shape[:2]
    left, top = max(area[0], 0), max(area[1], 0)
    right, bottom = min(area[2], width), min(area[3], height)
    if left >= right or top >= bottom:
        return
    noise = fractal_noise(generator, (bottom - top, right - left), coarsest=24.0, octaves=5)
    filled = np.asarray(color) * (1.0 + contrast * (noise[..., None] - 0.5) * 2.0)
    image[top:bottom, left:right] = np.clip(filled, 0, 255)
