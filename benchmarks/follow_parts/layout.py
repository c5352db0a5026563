"""Rooms drawn at random: walls, pillars, an inner wall with an opening, and the ways through them.

Coordinates are meters in a fixed frame, x and y on the floor.
"""

from __future__ import annotations

import heapq
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import cv2
import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]

# Cells in a meter of the map of clearances, and side of a cell of the map of ways, meters.
_CELLS, _STEP = 20, 0.2
_MARGIN = 0.5
# Clearance that ways keep, and that from which more clearance is no better, meters.
_CLEAR, _COMFORTABLE = 0.4, 0.8
_PILLAR_SIDES = 8


@dataclass(frozen=True)
class Pillar:
    """A pillar from floor to ceiling."""

    center: tuple[float, float]  # (x, y), meters
    radius: float  # meters


@dataclass(frozen=True, eq=False)
class Layout:
    """Walls of a room, all from floor to ceiling."""

    outline: Array  # (N, 2) corners of the room, counterclockwise
    # (W, 2, 2) begin and end of each wall, those of pillars and inner walls among them
    walls: Array
    # (W,) number of the surface of each wall; walls of one surface look alike
    surfaces: NDArray[np.int_]
    pillars: tuple[Pillar, ...]  # the pillars
    # center of the opening in the inner wall; None without
    opening: tuple[float, float] | None = None

    @cached_property
    def _clearance(self) -> NDArray[np.float32]:
        size = np.ceil((self.outline.max(axis=0) + _MARGIN) * _CELLS).astype(int)
        free = np.zeros((size[1], size[0]), np.uint8)
        cv2.fillPoly(free, [np.rint(self.outline * _CELLS).astype(np.int32)], 255)
        for begin, end in np.rint(self.walls * _CELLS).astype(int).tolist():
            cv2.line(free, begin, end, 0, 1)
        for pillar in self.pillars:
            center = np.rint(np.multiply(pillar.center, _CELLS)).astype(int).tolist()
            cv2.circle(free, center, round(pillar.radius * _CELLS), 0, -1)
        return cv2.distanceTransform(free, cv2.DIST_L2, 5) / np.float32(_CELLS)

    @cached_property
    def _ways(self) -> NDArray[np.float32]:
        stride = round(_STEP * _CELLS)
        return self._clearance[::stride, ::stride]

    @classmethod
    def draw(cls, generator: np.random.Generator, kind: str) -> Layout:
        """A room of 8 to 16 m with two pillars, or a corridor.

        The kind is `door` for a room that a wall with an opening divides, `corner` for a corridor
        with a corner; else a room, which may have a short inner wall.
        """
        if kind == "corner":
            outline = _corridor(generator)
            return cls(outline, *walls_of([outline]), ())
        while True:
            width, depth = generator.uniform(9.0, 15.5), generator.uniform(8.0, 11.0)
            if kind == "door":
                width = generator.uniform(12.0, 15.5)
            outline = _room(generator, width, depth)
            loops, opening, part = [outline], None, 1.0
            if kind == "door":
                x, y = width * generator.uniform(0.6, 0.66), depth * generator.uniform(0.35, 0.65)
                gap = generator.uniform(1.2, 1.6)
                opening, part = (x, y), 0.6
                loops += [_box(x, -1.0, y - gap / 2), _box(x, y + gap / 2, depth + 2.0)]
            elif generator.random() < 0.6:
                x, end = width * generator.uniform(0.4, 0.6), generator.uniform(1.5, 0.35 * depth)
                is_low = generator.random() < 0.5
                loops.append(_box(x, -1.0, end) if is_low else _box(x, depth - end, depth + 2.0))
            pillars = _pillars(generator, (part * width, depth), walls_of(loops)[0])
            if len(pillars) == 2:
                loops += [circle(one) for one in pillars]
                return cls(outline, *walls_of(loops), tuple(pillars), opening)

    def clearance(self, point: ArrayLike) -> float:
        """Distance of a (2,) point to the nearest wall; 0 outside of the room."""
        x, y = np.rint(np.multiply(point, _CELLS)).astype(int).tolist()
        rows, columns = self._clearance.shape
        return float(self._clearance[y, x]) if 0 <= x < columns and 0 <= y < rows else 0.0

    def is_open(self, begin: ArrayLike, end: ArrayLike, clearance: float = 0.3) -> bool:
        """Whether all of a straight line keeps a clearance, meters."""
        begin, end = np.asarray(begin, float), np.asarray(end, float)
        count = max(int(np.linalg.norm(end - begin) / 0.1), 1)
        shares = np.linspace(0.0, 1.0, count + 1)
        cells = np.rint((begin + shares[:, None] * (end - begin)) * _CELLS).astype(int)
        rows, columns = self._clearance.shape
        inside = ((cells >= 0) & (cells < (columns, rows))).all()
        return bool(inside and (self._clearance[cells[:, 1], cells[:, 0]] >= clearance).all())

    def sees(self, begin: ArrayLike, end: ArrayLike) -> bool:
        """Whether no wall is between two points."""
        begin = np.asarray(begin, float)
        direction = np.asarray(end, float) - begin
        return bool(self.ranges(begin, direction[None])[0][0] >= 1.0)

    def ranges(self, origin: ArrayLike, directions: Array) -> tuple[Array, NDArray[np.int_]]:
        """Where (N, 2) rays, of any length, meet the first wall.

        Returns:
            (N,) distances in lengths of the directions, infinite without a wall, and (N,) the
            numbers of the walls.
        """
        range_, share = crossings(self.walls, np.asarray(origin), directions)
        range_[~((share >= 0.0) & (share <= 1.0) & (range_ > 1e-6))] = np.inf
        first = range_.argmin(axis=1)
        return range_[np.arange(len(first)), first], first

    def free_point(
        self, generator: np.random.Generator, clearance: float = 0.7, part: float = 1.0
    ) -> Array:
        """A random point with a clearance, in a left part of the room."""
        low, high = self.outline.min(axis=0), self.outline.max(axis=0)
        high = np.array([low[0] + part * (high[0] - low[0]), high[1]])
        while True:
            point = generator.uniform(low, high)
            if self.clearance(point) >= clearance:
                return point

    def free_points(self, clearance: float = 0.45) -> Array:
        """(N, 2) points of a grid with a clearance."""
        rows, columns = np.nonzero(self._ways >= clearance)
        return np.stack([columns, rows], axis=1) * _STEP

    def way(self, begin: ArrayLike, end: ArrayLike, avoid: Sequence[ArrayLike] = ()) -> list[Array]:
        """Corners of a short way that keeps clear of walls, without its begin; empty without a way.

        It keeps away from the points to avoid, by a meter where that is possible.
        """
        end = np.asarray(end, float)
        cost = np.where(self._ways >= _CLEAR, 1.0, np.where(self._ways >= 0.25, 6.0, np.inf))
        cost += np.clip(_COMFORTABLE - self._ways, 0.0, None)
        rows, columns = np.indices(cost.shape)
        for one in avoid:
            x, y = np.divide(one, _STEP)
            cost += 8.0 * (np.hypot(columns - x, rows - y) < 1.0 / _STEP)
        start, goal = self._cell(begin), self._cell(end)
        cost[start] = cost[goal] = 1.0
        cells = _cheapest(cost, start, goal)
        points = [np.array([column, row]) * _STEP for row, column in cells]
        if not points:
            return []
        points[-1] = end
        return self._straightened(np.asarray(begin, float), points, avoid)

    def _cell(self, point: ArrayLike) -> tuple[int, int]:
        x, y = np.rint(np.divide(point, _STEP)).astype(int).tolist()
        rows, columns = self._ways.shape
        return min(max(y, 0), rows - 1), min(max(x, 0), columns - 1)

    def _straightened(
        self, begin: Array, points: list[Array], avoid: Sequence[ArrayLike]
    ) -> list[Array]:
        corners, here, index = [], begin, 0
        while index < len(points):
            last = index
            for further in range(min(len(points) - 1, index + 25), index, -1):
                way = np.array([[here, points[further]]])
                is_clear = all(distance_to_walls(way, one) > 0.9 for one in avoid)
                if is_clear and self.is_open(here, points[further], 0.38):
                    last = further
                    break
            here = points[last]
            corners.append(here)
            index = last + 1
        return corners


def _cheapest(cost: Array, start: tuple[int, int], goal: tuple[int, int]) -> list[tuple[int, int]]:
    """Cells of the cheapest way on a grid (A*), without its start."""
    rows, columns = cost.shape
    came: dict[tuple[int, int], tuple[int, int]] = {}
    best = {start: 0.0}
    queue = [(0.0, start)]
    done = set()
    while queue:
        _, cell = heapq.heappop(queue)
        if cell == goal:
            cells = [cell]
            while cell in came and came[cell] != start:
                cell = came[cell]
                cells.append(cell)
            return cells[::-1]
        if cell in done:
            continue
        done.add(cell)
        for down in (-1, 0, 1):
            for right in (-1, 0, 1):
                row, column = cell[0] + down, cell[1] + right
                if not (0 <= row < rows and 0 <= column < columns) or not (down or right):
                    continue
                total = best[cell] + float(cost[row, column]) * (1.414 if down and right else 1.0)
                if total < best.get((row, column), np.inf):
                    best[row, column], came[row, column] = total, cell
                    left = float(np.hypot(goal[0] - row, goal[1] - column))
                    heapq.heappush(queue, (total + left, (row, column)))
    return []


def crossings(walls: Array, origin: Array, directions: Array) -> tuple[Array, Array]:
    """Where the lines of rays, (N, 2) directions from a (2,) origin, meet those of (W, 2, 2) walls.

    Returns:
        (N, W) distances in lengths of the directions, and (N, W) shares of the walls.
    """
    begins, along = walls[:, 0] - origin, walls[:, 1] - walls[:, 0]
    x, y = directions[:, None, 0], directions[:, None, 1]
    crossed = x * along[:, 1] - y * along[:, 0]
    with np.errstate(divide="ignore", invalid="ignore"):
        ranges = (begins[:, 0] * along[:, 1] - begins[:, 1] * along[:, 0]) / crossed
        return ranges, (begins[:, 0] * y - begins[:, 1] * x) / crossed


def distance_to_walls(walls: Array, point: ArrayLike) -> float:
    """Distance of a point to the nearest of (W, 2, 2) walls."""
    point = np.asarray(point, float)
    along = walls[:, 1] - walls[:, 0]
    length = np.maximum((along**2).sum(axis=1), 1e-12)
    share = np.clip(((point - walls[:, 0]) * along).sum(axis=1) / length, 0.0, 1.0)
    return float(np.linalg.norm(walls[:, 0] + share[:, None] * along - point, axis=1).min())


def _room(generator: np.random.Generator, width: float, depth: float) -> Array:
    """Corners of a skew room; half of them have a corner cut off."""
    skew = generator.uniform(0.0, 0.7, (4, 2))
    corners = np.array([[0.0, 0.0], [width, 0.0], [width, depth], [0.0, depth]])
    corners += np.array([[1, 1], [-1, 1], [-1, -1], [1, -1]]) * skew + _MARGIN
    if generator.random() < 0.5:
        return corners
    which, size = int(generator.integers(4)), generator.uniform(1.0, 2.0)
    here = corners[which]
    around = [corners[which - 1] - here, corners[(which + 1) % 4] - here]
    cut = [here + size * one / np.linalg.norm(one) for one in around]
    return np.asarray(np.insert(np.delete(corners, which, 0), which, cut, axis=0), float)


def _corridor(generator: np.random.Generator) -> Array:
    """Corners of a corridor that turns at a right angle."""
    (width, depth), wide = generator.uniform(8.0, 13.0, 2), generator.uniform(2.6, 3.4, 2)
    x, y = width - wide[0], wide[1]
    corners = np.array([[0, 0], [width, 0], [width, depth], [x, depth], [x, y], [0, y]])
    if generator.random() < 0.5:
        # Mirrored, still counterclockwise.
        corners = ([width, 0.0] + corners * [-1.0, 1.0])[::-1]
    return corners + _MARGIN


def _pillars(
    generator: np.random.Generator, size: tuple[float, float], walls: Array
) -> list[Pillar]:
    """Two pillars, or fewer without space."""
    pillars: list[Pillar] = []
    for _ in range(200):
        center = (generator.uniform(2.0, size[0] - 1.5), generator.uniform(2.0, size[1] - 1.5))
        pillar = Pillar(center, generator.uniform(0.3, 0.4))
        apart = [np.hypot(*np.subtract(center, one.center)) > 2.5 for one in pillars]
        is_free = distance_to_walls(walls, center) > pillar.radius + 1.2
        if len(pillars) < 2 and all(apart) and is_free:
            pillars.append(pillar)
    return pillars


def circle(pillar: Pillar) -> Array:
    """(8, 2) corners of a pillar."""
    turns = np.linspace(0.0, 2.0 * np.pi, _PILLAR_SIDES, endpoint=False)
    return pillar.center + pillar.radius * np.stack([np.cos(turns), np.sin(turns)], axis=1)


def _box(x: float, low: float, high: float, thickness: float = 0.2) -> Array:
    """(4, 2) corners of an inner wall along y."""
    half = thickness / 2.0
    return np.array([[x - half, low], [x + half, low], [x + half, high], [x - half, high]])


def walls_of(loops: Sequence[Array]) -> tuple[Array, NDArray[np.int_]]:
    """The walls between the corners of each loop, and their surfaces.

    Each wall of the outline has a surface, and each inner wall and each pillar.
    """
    walls, surfaces, number = [], [], 0
    for index, loop in enumerate(loops):
        for begin, end in zip(loop, np.roll(loop, -1, axis=0), strict=True):
            walls.append([begin, end])
            surfaces.append(number)
            number += index == 0
        number += index > 0
    return np.array(walls), np.array(surfaces)
