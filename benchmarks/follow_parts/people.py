"""People as sprites: drawn clothes and builds, seen from all sides in all phases of their gait.

A sprite is what a camera sees of a person from one of `VIEWS` directions in one of `PHASES` phases,
with premultiplied colors and the coverage of each pixel.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray
from scenes.sprites import Color, shaded
from scenes.textures import fractal_noise

Array = NDArray[np.float64]

VIEWS, PHASES = 12, 10
# Pixels in a meter of a sprite, and size of its canvas in heights.
SCALE = 150.0
_ABOVE, _ASIDE = 1.06, 0.4
# Fractional bits of coordinates in OpenCV's drawing.
_SHIFT = 4


def _colors(digits: str) -> tuple[Color, ...]:
    """Colors of two hexadecimal digits each for blue, green and red."""
    blues, greens, reds = (tuple(bytes.fromhex(digits))[first::3] for first in range(3))
    return tuple(zip(blues, greens, reds, strict=True))


_SHIRTS = _colors("2828be aa501e 3c8232 28282d d7d7d7 32b4dc 823c78 96963c 5a6e8c 6e6e73")
_TROUSERS = _colors("6e462d 282624 50555a 466482 96a0a5 3c2d46")
_HAIRS = _colors("191e23 233c5f 508cb4 a0a5aa")
_SKINS = _colors("96b4e1 6e96c8 466496 324664")
_SHOES = _colors("1e1e1e c8c8c8 283c64")


@dataclass(frozen=True)
class Clothes:
    """What somebody wears."""

    shirt: Color  # color, BGR
    second: Color  # second color of the shirt's pattern
    pattern: str  # `plain`, `stripes`, `columns`, `halves` or `print`
    trousers: Color  # color
    shoes: Color  # color
    sleeves: float  # share of the arm that the sleeve covers
    has_backpack: bool  # whether there is a backpack in the second color

    @classmethod
    def draw(cls, generator: np.random.Generator) -> Clothes:
        """Random clothes."""
        shirt, second = (_varied(generator, _SHIRTS) for _ in range(2))
        return cls(
            shirt,
            second,
            str(generator.choice(["plain", "stripes", "columns", "halves", "print"])),
            _varied(generator, _TROUSERS),
            _varied(generator, _SHOES),
            float(generator.choice([0.35, 1.0])),
            bool(generator.random() < 0.25),
        )


def _varied(generator: np.random.Generator, colors: tuple[Color, ...]) -> Color:
    """One of some colors, changed a little."""
    color = np.array(colors[int(generator.integers(len(colors)))])
    varied = np.clip(color * generator.uniform(0.8, 1.2) + generator.normal(0.0, 8.0, 3), 10, 240)
    blue, green, red = varied.tolist()
    return blue, green, red


@dataclass(frozen=True)
class Body:
    """A person's build and gait."""

    height: float  # meters
    girth: float  # width relative to the mean
    hair: Color  # color, BGR
    skin: Color  # color
    has_long_hair: bool  # whether the hair covers the neck
    leg_swing: float  # largest angle of a leg, radians
    arm_swing: float  # largest angle of an arm, radians
    bob: float  # vertical motion while walking, in heights
    stride: float  # meters in which the gait repeats

    @classmethod
    def draw(cls, generator: np.random.Generator) -> Body:
        """A random build of 1.55 to 1.9 m."""
        height = float(np.clip(generator.normal(1.73, 0.09), 1.55, 1.9))
        return cls(
            height,
            generator.uniform(0.88, 1.15),
            _varied(generator, _HAIRS),
            _varied(generator, _SKINS),
            bool(generator.random() < 0.4),
            generator.uniform(0.3, 0.45),
            generator.uniform(0.2, 0.45),
            generator.uniform(0.005, 0.015),
            0.8 * height * generator.uniform(0.9, 1.1),
        )


class Sprite(NamedTuple):
    """A person from one side."""

    pixels: NDArray[np.uint8]  # (H, W, 4) uint8, BGR times coverage, and coverage
    # (x, y) of the point on the floor below the body, pixels of the sprite
    foot: tuple[float, float]
    box: tuple[float, float, float, float]  # x, y, width, height of what is covered


@dataclass(eq=False)
class Sprites:
    """The sprites of one person, drawn when they are first needed."""

    body: Body  # build and gait
    clothes: Clothes  # clothes
    seed: int  # of the texture of the clothes
    _known: dict[tuple[int, int, bool, bool], Sprite] = field(default_factory=dict, init=False)

    def __post_init__(self) -> None:
        self._torso = _torso_texture(self.clothes, self.seed)
        side = round(_ABOVE * self.body.height * SCALE)
        grain = fractal_noise(np.random.default_rng(self.seed), (side, side), 10.0, 3)
        self._grain = (0.8 + 0.35 * grain).astype(np.float32)

    def seen(self, angle: float, phase: float, *, is_walking: bool, is_far: bool) -> Sprite:
        """The sprite nearest to a view.

        The angle is that of the heading to the direction to the camera, radians; pi / 2 goes to the
        right. The phase of the gait is 0 to 1; whoever is far has half the resolution.
        """
        view = round(angle / (2.0 * np.pi) * VIEWS) % VIEWS
        number = round(phase * PHASES) % PHASES if is_walking else 0
        key = view, number, is_walking, is_far
        if key not in self._known:
            if is_far:
                near = self.seen(angle, phase, is_walking=is_walking, is_far=False)
                self._known[key] = _halved(near)
            else:
                turn, share = 2.0 * np.pi * view / VIEWS, number / PHASES
                self._known[key] = self._draw(turn, share, is_walking=is_walking)
        return self._known[key]

    def _draw(self, turn: float, phase: float, *, is_walking: bool) -> Sprite:
        swing = float(np.sin(2.0 * np.pi * phase)) if is_walking else 0.0
        lift = self.body.bob * (1.0 - abs(swing)) if is_walking else 0.0
        figure = _Figure(self.body, self.clothes, turn, swing, lift)
        along = np.sin(turn)
        # The person's left side is farther from the camera when going to the right of the image.
        far = 1.0 if along > 0.0 else -1.0
        is_sideways = bool(abs(along) > 0.4)
        figure.arm(far, is_far=is_sideways)
        figure.leg(far, is_far=is_sideways)
        figure.leg(-far, is_far=False)
        if not is_sideways:
            figure.arm(-far, is_far=False)
        figure.dress(self._torso)
        figure.head()
        if is_sideways:
            figure.arm(-far, is_far=False)
        colors = figure.pixels[..., :3]
        rows, columns = colors.shape[:2]
        colors[:] = np.clip(colors * self._grain[:rows, :columns, None], 0, figure.pixels[..., 3:])
        return _cropped(figure.pixels, (figure.middle, figure.floor))


class _Figure:
    """A person that is being drawn.

    Attributes:
        pixels: (H, W, 4) as those of a sprite.
        size: Height of the person, pixels.
        middle: Column of the body's axis.
        floor: Row of the floor.
        turn: Of the heading to the direction to the camera, radians.
        swing: Of the left leg, -1 to 1.
        lift: Of the body, in heights.
    """

    def __init__(
        self, body: Body, clothes: Clothes, turn: float, swing: float, lift: float
    ) -> None:
        self.body, self.clothes, self.turn, self.swing, self.lift = body, clothes, turn, swing, lift
        self.size = body.height * SCALE
        rows, columns = round(_ABOVE * self.size), round(2.0 * _ASIDE * self.size)
        self.pixels = np.zeros((rows, columns, 4), np.uint8)
        self.middle, self.floor = columns / 2.0, rows - 0.02 * self.size

    def place(self, lateral: float, forward: float, up: float) -> tuple[float, float]:
        """Pixel of a point in heights: to the person's left, forward and up."""
        # Facing the camera, the left side is on the right of the image.
        x = lateral * np.cos(self.turn) + forward * np.sin(self.turn)
        return self.middle + self.size * x, self.floor - self.size * (up + self.lift)

    def leg(self, side: float, *, is_far: bool) -> None:
        """Draw the left leg, side 1, or the right one, side -1."""
        body, clothes, size, place = self.body, self.clothes, self.size, self.place
        angle = side * self.swing * body.leg_swing
        bend = 0.7 * max(-angle, 0.0) + 0.1 * abs(angle)
        shade = 0.72 if is_far else 1.0
        hip = place(0.05 * side * body.girth, 0.0, 0.5)
        knee_up = 0.5 - 0.24 * np.cos(angle)
        knee_forward = 0.24 * np.sin(angle)
        lower = angle - bend
        ankle_up = max(knee_up - 0.22 * np.cos(lower), 0.03)
        ankle_forward = knee_forward + 0.22 * np.sin(lower)
        knee = place(0.05 * side * body.girth, knee_forward, knee_up)
        ankle = place(0.05 * side * body.girth, ankle_forward, ankle_up)
        # Toes point forward; to the camera, the nearer foot is lower in the image.
        toe = place(0.055 * side * body.girth, ankle_forward + 0.06, max(ankle_up - 0.025, 0.008))
        toe = toe[0], toe[1] + 0.012 * size * np.cos(self.turn)
        self._limb((ankle, toe), (0.022 * size, 0.018 * size), shaded(clothes.shoes, shade))
        color, girth = shaded(clothes.trousers, shade), body.girth
        self._limb((hip, knee), (0.052 * size * girth, 0.04 * size * girth), color)
        self._limb((knee, ankle), (0.04 * size * girth, 0.026 * size), shaded(color, 0.95))

    def arm(self, side: float, *, is_far: bool) -> None:
        """Draw the left arm, side 1, or the right one, side -1."""
        body, clothes, size, place = self.body, self.clothes, self.size, self.place
        angle = -side * self.swing * body.arm_swing + 0.03
        shade = 0.75 if is_far else 0.95
        lateral = 0.118 * side * body.girth
        shoulder = place(lateral, 0.0, 0.79)
        elbow_forward, elbow_up = 0.17 * np.sin(angle), 0.79 - 0.17 * np.cos(angle)
        elbow = place(lateral + 0.012 * side, elbow_forward, elbow_up)
        lower = angle + 0.25
        hand_forward = elbow_forward + 0.15 * np.sin(lower)
        hand = place(lateral + 0.015 * side, hand_forward, elbow_up - 0.15 * np.cos(lower))
        sleeve, skin = shaded(clothes.shirt, shade), shaded(body.skin, shade)
        if clothes.pattern == "halves":
            sleeve = shaded(clothes.second, shade)
        self._limb((elbow, hand), (0.024 * size, 0.02 * size), skin)
        if clothes.sleeves == 1.0:
            wrist = tuple(np.add(elbow, np.multiply(0.8, np.subtract(hand, elbow))))
            self._limb((elbow, wrist), (0.027 * size, 0.024 * size), sleeve)
        self._limb((shoulder, elbow), (0.034 * size, 0.027 * size), sleeve)

    def dress(self, torso: NDArray[np.float32]) -> None:
        """Draw the torso in a texture that goes around it."""
        canvas, size, turn, place = self.pixels, self.size, self.turn, self.place
        across, along, girth = abs(np.cos(turn)), abs(np.sin(turn)), self.body.girth
        shoulder = size * girth * np.hypot(0.125 * across, 0.075 * along)
        waist = size * girth * np.hypot(0.092 * across, 0.07 * along)
        (center, top), (_, bottom) = place(0.0, 0.0, 0.83), place(0.0, 0.0, 0.46)
        if self.clothes.has_backpack and np.cos(turn) < 0.9:
            x, y = place(0.0, -0.1, 0.67)
            half = size * np.hypot(0.1 * across, 0.055 * along)
            sides = np.array([(-1, -1), (1, -1), (1, 1), (-1, 1)])
            corners = (x, y) + sides * (half, 0.13 * size)
            if np.cos(turn) > -0.5:
                self._polygon(corners, shaded(self.clothes.second, 0.8))
        neck = 0.4 * shoulder
        halves = np.array([neck, shoulder, 0.98 * shoulder, waist, 1.04 * waist])
        rows = np.array([top - 0.012 * size, top + 0.035 * size, top + 0.1 * size])
        rows = np.append(rows, [bottom - 0.08 * size, bottom])
        right, left = (np.stack([center + side * halves, rows], axis=1) for side in (1.0, -1.0))
        outline = np.concatenate([left[:1], right, left[:0:-1]])
        mask = np.zeros(canvas.shape[:2], np.uint8)
        cv2.fillPoly(mask, [_fixed(outline)], 255, cv2.LINE_AA, _SHIFT)
        y0, y1 = int(top - 0.03 * size), int(bottom + 3)
        x0, x1 = int(center - shoulder - 3), int(center + shoulder + 4)
        # The shirt around the body: the middle of the texture is the chest.
        offsets = np.clip((np.arange(x0, x1) - center) / shoulder, -0.99, 0.99)
        angles = np.arcsin(offsets) - turn
        rows, columns = torso.shape[:2]
        map_x = np.broadcast_to(
            (angles / (2.0 * np.pi) + 0.5) % 1.0 * (columns - 1), (y1 - y0, x1 - x0)
        )
        level = np.clip((np.arange(y0, y1) - top) / (bottom - top), 0.0, 1.0) * (rows - 1)
        map_y = np.broadcast_to(level[:, None], map_x.shape)
        texture = cv2.remap(
            torso, map_x.astype(np.float32), map_y.astype(np.float32), cv2.INTER_LINEAR
        )
        texture = texture * (1.0 - 0.35 * offsets**2)[None, :, None]
        part = canvas[y0:y1, x0:x1].astype(np.float32)
        share = mask[y0:y1, x0:x1, None] / np.float32(255.0)
        opaque = np.dstack([texture, np.full(texture.shape[:2], 255.0)])
        canvas[y0:y1, x0:x1] = np.rint(part * (1.0 - share) + opaque * share)
        if self.clothes.has_backpack and np.cos(turn) <= -0.5:
            self._polygon(corners, shaded(self.clothes.second, 0.9))

    def head(self) -> None:
        """Draw neck, head, face and hair."""
        size, turn, place, body = self.size, self.turn, self.place, self.body
        neck = place(0, 0, 0.8), place(0, 0.01, 0.88)
        self._limb(neck, (0.03 * size, 0.028 * size), shaded(body.skin, 0.8))
        x, y = place(0.0, 0.012, 0.925)
        half = size * np.hypot(0.046 * np.cos(turn), 0.056 * np.sin(turn))
        tall = 0.068 * size
        if body.has_long_hair:
            back_x, _ = place(0.0, -0.02, 0.0)
            self._ellipse((back_x, y + 0.02 * size), (1.12 * half, 1.35 * tall), body.hair)
        self._ellipse((x, y), (half, tall), body.skin)
        facing = np.cos(turn)
        # The hair covers the top, and what is away from the face.
        hair_x = x - 0.55 * half * np.sin(turn)
        if facing > 0.3:
            self._ellipse((x, y - 0.45 * tall), (1.02 * half, 0.6 * tall), body.hair)
            for side in (-1.0, 1.0):
                eye = x + half * (0.4 * side * facing + 0.5 * np.sin(turn)), y + 0.05 * tall
                self._ellipse(eye, (0.1 * half, 0.07 * tall), (30, 30, 40))
        elif facing > -0.3:
            self._ellipse((hair_x, y - 0.2 * tall), (0.75 * half, 0.85 * tall), body.hair)
        else:
            self._ellipse((x, y - 0.1 * tall), (1.03 * half, 0.95 * tall), body.hair)

    def _polygon(self, corners: Array, color: Color) -> None:
        cv2.fillPoly(self.pixels, [_fixed(corners)], (*color, 255.0), cv2.LINE_AA, _SHIFT)

    def _ellipse(
        self, center: tuple[float, float], axes: tuple[float, float], color: Color
    ) -> None:
        middle, size = _fixed(np.array(center)).tolist(), _fixed(np.array(axes)).tolist()
        shade = (*color, 255.0)
        cv2.ellipse(self.pixels, middle, size, 0, 0, 360, shade, -1, cv2.LINE_AA, _SHIFT)

    def _limb(
        self,
        ends: tuple[tuple[float, float], tuple[float, float]],
        widths: tuple[float, float],
        color: Color,
    ) -> None:
        """Draw a limb with round ends; widths are half the thickness, pixels."""
        begin, end = np.array(ends)
        along = end - begin
        length = float(np.linalg.norm(along))
        if length > 0.5:
            normals = np.outer([*widths], [-along[1], along[0]]) / length
            corners = [begin + normals[0], end + normals[1], end - normals[1], begin - normals[0]]
            self._polygon(np.array(corners), color)
        for place, width in zip(ends, widths, strict=True):
            self._ellipse(place, (width, width), color)


def _torso_texture(clothes: Clothes, seed: int) -> NDArray[np.float32]:
    """(96, 256, 3) colors around the body from the neck to the hip."""
    generator = np.random.default_rng(seed)
    rows, columns = 96, 256
    y, x = np.indices((rows, columns))
    shirt, second = np.array(clothes.shirt), np.array(clothes.second)
    is_second = np.zeros((rows, columns), bool)
    if clothes.pattern == "stripes":
        is_second = (y // int(generator.integers(6, 14))) % 2 == 1
    elif clothes.pattern == "columns":
        is_second = (x // int(generator.integers(8, 20))) % 2 == 1
    elif clothes.pattern == "halves":
        is_second = y < generator.uniform(30, 50)
    elif clothes.pattern == "print":
        is_second = (np.abs(x - columns / 2) < 30) & (y > 20) & (y < generator.uniform(40, 65))
    texture = np.where(is_second[..., None], second, shirt)
    wrinkles = fractal_noise(generator, (rows, columns), 32.0, 3)
    return (texture * (0.78 + 0.4 * wrinkles[..., None])).clip(0, 255).astype(np.float32)


def _fixed(points: Array) -> NDArray[np.int32]:
    """Points in OpenCV's fixed-point format."""
    return np.rint(np.asarray(points) * 2**_SHIFT).astype(np.int32)


def _cropped(canvas: NDArray[np.uint8], foot: tuple[float, float]) -> Sprite:
    """The covered part of a canvas with a margin, and the point below the body."""
    covered = canvas[..., 3] > 127
    rows, columns = np.flatnonzero(covered.any(axis=1)), np.flatnonzero(covered.any(axis=0))
    top, bottom = max(int(rows[0]) - 3, 0), min(int(rows[-1]) + 4, canvas.shape[0])
    left, right = max(int(columns[0]) - 3, 0), min(int(columns[-1]) + 4, canvas.shape[1])
    box = (
        float(columns[0] - left),
        float(rows[0] - top),
        float(columns[-1] - columns[0] + 1),
        float(rows[-1] - rows[0] + 1),
    )
    pixels = np.ascontiguousarray(canvas[top:bottom, left:right])
    return Sprite(pixels, (foot[0] - left, foot[1] - top), box)


def _halved(sprite: Sprite) -> Sprite:
    """A sprite in half the resolution."""
    rows, columns = (number // 2 * 2 for number in sprite.pixels.shape[:2])
    pixels = cv2.resize(
        sprite.pixels[:rows, :columns], (columns // 2, rows // 2), interpolation=cv2.INTER_AREA
    )
    x, y, width, height = sprite.box
    return Sprite(
        pixels,
        (sprite.foot[0] / 2.0, sprite.foot[1] / 2.0),
        (x / 2.0, y / 2.0, width / 2.0, height / 2.0),
    )
