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
    # colors of signs, awnings, goods, flowers and bicycles, drawn with equal chance
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
        first = int(generator.integers(-80, 0))
        for left in range(first, width, 110):
            corners = np.array([[left, height - 50], [left + 60, height - 50]])
            mark = np.concatenate([corners, corners[::-1] + np.array([-6, 9])])
            cv2.fillPoly(image, [mark], (188, 192, 194), cv2.LINE_AA)

    def _draw_houses(self, generator: np.random.Generator, image: Image) -> None:
        width, _ = self.size
        left = -int(generator.integers(0, 120))
        while left < width:
            right = left + int(generator.integers(190, 300))
            wall = _varied(generator, _WALLS[generator.integers(len(_WALLS))], 0.12)
            _textured(generator, image, (left, 0, right, self.house_line), wall, 0.16)
            if generator.random() < 0.6:
                self._draw_bricks(image, left, right, wall)
            self._draw_windows(generator, image, left, right)
            middle = left + int((right - left) * generator.uniform(0.4, 0.6))
            for start, end in ((left + 4, middle - 3), (middle + 3, right - 4)):
                self._draw_shop(generator, image, start, end)
            cv2.line(image, (right, 0), (right, self.house_line), (70, 75, 80), 2)
            left = right

    def _draw_bricks(self, image: Image, left: int, right: int, wall: Color) -> None:
        mortar = tuple(min(channel * 1.16, 255.0) for channel in wall)
        for course, row in enumerate(range(0, self.storey, 6)):
            cv2.line(image, (left, row), (right, row), mortar, 1)
            for x in range(left + 7 * (course % 2), right, 14):
                cv2.line(image, (x, row), (x, row + 6), mortar, 1)

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
                if generator.random() < 0.6:
                    curtain = _varied(generator, (170, 178, 185), 0.15)
                    fall = int(generator.integers(8, 30))
                    cv2.rectangle(
                        image, (x, bottom - 58), (x + 30, bottom - 58 + fall), curtain, -1
                    )
                cv2.line(image, (x + 15, bottom - 58), (x + 15, bottom), frame, 2)
                cv2.line(image, (x, bottom - 34), (x + 30, bottom - 34), frame, 2)
                cv2.rectangle(image, (x - 4, bottom + 2), (x + 34, bottom + 6), frame, -1)
                if generator.random() < 0.35:
                    self._draw_flowers(generator, image, (x - 2, bottom - 3, x + 32, bottom + 5))

    def _draw_flowers(
        self, generator: np.random.Generator, image: Image, area: tuple[int, int, int, int]
    ) -> None:
        left, top, right, bottom = area
        accent = self._accent(generator)
        for color, count in (((45, 100, 55), 1.0), (accent, 0.7)):
            for _ in range(int((right - left) * count)):
                place = (int(generator.integers(left, right)), int(generator.integers(top, bottom)))
                cv2.circle(image, place, 2, _varied(generator, color, 0.25), -1, cv2.LINE_AA)

    def _draw_shop(
        self, generator: np.random.Generator, image: Image, left: int, right: int
    ) -> None:
        top, bottom = self.storey, self.house_line
        accent = self._accent(generator)
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
        self._draw_sign(generator, image, (left, top - 16, right, top + 2), accent)
        if generator.random() < 0.6:
            self._draw_awning(generator, image, (left - 2, top + 2, right + 2, top + 27), accent)

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
        self,
        generator: np.random.Generator,
        image: Image,
        area: tuple[int, int, int, int],
        color: Color,
    ) -> None:
        left, top, right, bottom = area
        cv2.rectangle(image, (left, top), (right, bottom), color, -1)
        dark = sum(color) > 330
        ink: Color = (40, 40, 45) if dark else (225, 230, 232)
        letters = generator.integers(65, 91, int(generator.integers(5, 9)))
        text = "".join(chr(letter) for letter in letters)
        place = (left + 10, bottom - 4)
        cv2.putText(image, text, place, cv2.FONT_HERSHEY_DUPLEX, 0.48, ink, 1, cv2.LINE_AA)

    def _draw_awning(
        self,
        generator: np.random.Generator,
        image: Image,
        area: tuple[int, int, int, int],
        color: Color,
    ) -> None:
        left, top, right, bottom = area
        stripe = int(generator.integers(8, 15))
        pale = _varied(generator, (205, 212, 215), 0.08)
        for number, x in enumerate(range(left, right, stripe)):
            end = min(x + stripe, right)
            corners = np.array([[x, top], [end, top], [end + 3, bottom], [x + 3, bottom]])
            cv2.fillPoly(image, [corners], color if number % 2 else pale, cv2.LINE_AA)
        cv2.line(image, (left, bottom), (right + 3, bottom), (70, 70, 75), 2)

    def _draw_pavement_clutter(self, generator: np.random.Generator, image: Image) -> None:
        """Hedges, flower tubs, bicycles, boards and lamp posts before the houses."""
        width, _ = self.size
        kinds = (self._draw_hedge, self._draw_tub, self._draw_bicycle, self._draw_board)
        x = int(generator.integers(0, 30))
        while x < width:
            draw = kinds[generator.integers(len(kinds))]
            x += draw(generator, image, x) + int(generator.integers(6, 34))
        for x in generator.integers(0, width, 3):
            foot = self.house_line + 20
            cv2.line(image, (int(x), foot), (int(x), foot - 190), (52, 55, 58), 4, cv2.LINE_AA)
            cv2.circle(image, (int(x), foot - 192), 8, (190, 210, 215), -1, cv2.LINE_AA)

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

    def _draw_tub(self, generator: np.random.Generator, image: Image, left: int) -> int:
        wide, ground = int(generator.integers(26, 44)), self.house_line + 12
        clay = _varied(generator, (70, 95, 140), 0.15)
        body = [
            [left, ground - 18],
            [left + wide, ground - 18],
            [left + wide - 5, ground],
            [left + 5, ground],
        ]
        cv2.fillPoly(image, [np.array(body)], clay, cv2.LINE_AA)
        for _ in range(2):
            self._draw_flowers(
                generator, image, (left - 3, ground - 42, left + wide + 3, ground - 16)
            )
        return wide

    def _draw_bicycle(self, generator: np.random.Generator, image: Image, left: int) -> int:
        ground, paint = self.house_line + 14, self._accent(generator)
        rear, front = (left + 13, ground - 13), (left + 47, ground - 13)
        for wheel in (rear, front):
            cv2.circle(image, wheel, 13, (35, 35, 38), 2, cv2.LINE_AA)
            for angle in np.arange(0.0, np.pi, np.pi / 4):
                reach = np.array([np.cos(angle), np.sin(angle)]) * 12
                ends = [
                    tuple(np.round(np.add(wheel, sign * reach)).astype(int)) for sign in (1, -1)
                ]
                cv2.line(image, ends[0], ends[1], (120, 122, 124), 1, cv2.LINE_AA)
        pedals, seat, bar = (
            (left + 27, ground - 12),
            (left + 22, ground - 34),
            (left + 42, ground - 34),
        )
        frame = np.array([rear, pedals, bar, seat, rear, seat, pedals])
        cv2.polylines(image, [frame, np.array([front, bar])], False, paint, 2, cv2.LINE_AA)
        cv2.line(image, (left + 17, ground - 37), (left + 27, ground - 37), (30, 30, 32), 3)
        cv2.line(image, bar, (left + 44, ground - 42), (60, 60, 62), 2, cv2.LINE_AA)
        return 60

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
