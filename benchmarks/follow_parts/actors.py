"""Where people walk: the followed person, those who walk in between, and the others."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from itertools import islice, pairwise

import numpy as np
from numpy.typing import ArrayLike, NDArray

from follow_parts.layout import Layout, distance_to_walls
from follow_parts.people import Sprites
from follow_parts.rendering import Placed
from follow_parts.robot import Pose2D

Array = NDArray[np.float64]

# Acceleration of people, m/s^2, and speed below which they stand, m/s.
_ACCELERATION, _STANDS_BELOW = 2.5, 0.12
# How near people come to each other, meters.
_APART = 0.65
# Half of the width of the corridor between robot and person that others keep out of, meters.
_CORRIDOR = 0.75
# How near the followed person passes the robot where the room allows it, meters.
_PASSES = 1.4
# Seconds after which somebody gives up whom the robot still sees, how much faster they go to hide,
# and how many places they try.
_HIDES_WITHIN, _HURRY, _PLACES = 10.0, 1.6, 8
# Durations of absences, seconds.
_ABSENCES = (5.0, 15.0)
# How far the robot may fall behind, meters, and for how long it may look elsewhere, seconds, until
# the person returns.
_LEFT_BEHIND, _PATIENCE = 4.5, 3.0


@dataclass(eq=False)
class Walker:
    """Somebody who walks."""

    sprites: Sprites  # what they look like
    position: Array  # (2,) meters
    pace: float  # usual speed, m/s
    heading: float  # radians
    velocity: Array = field(default_factory=lambda: np.zeros(2))  # (2,) m/s
    phase: float = 0.0  # of the gait
    way: list[Array] = field(default_factory=list)  # corners of the way ahead
    pause: float = 0.0  # seconds to stand
    stands_for: float = 0.0  # seconds since the last step

    @property
    def is_walking(self) -> bool:
        """Whether they walk."""
        return bool(np.hypot(*self.velocity) > _STANDS_BELOW)

    @property
    def placed(self) -> Placed:
        """For the renderer."""
        x, y = self.position.tolist()
        return Placed(self.sprites, x, y, self.heading, self.phase, self.is_walking)

    def advance(self, interval: float, layout: Layout, push: Array, speed: float) -> None:
        """Walk along the way for some seconds at a speed, pushed by others with (2,) m/s."""
        wanted = np.zeros(2)
        while self.way and np.hypot(*(self.way[0] - self.position)) < 0.15:
            self.way.pop(0)
        if self.way and self.pause <= 0.0:
            ahead = self.way[0] - self.position
            wanted = speed * ahead / max(float(np.hypot(*ahead)), 1e-6)
        self.pause = max(self.pause - interval, 0.0)
        wanted = wanted + push
        change = wanted - self.velocity
        size = float(np.hypot(*change))
        self.velocity = self.velocity + change * min(
            1.0, _ACCELERATION * interval / max(size, 1e-9)
        )
        # Along the walls, if not straight on.
        for velocity in (self.velocity, self.velocity * (1.0, 0.0), self.velocity * (0.0, 1.0)):
            step = self.position + interval * velocity
            here, there = layout.clearance(self.position), layout.clearance(step)
            if there >= 0.28 or there > here:
                self.position, self.velocity = step, velocity
                break
        else:
            self.velocity = np.zeros(2)
        pace = float(np.hypot(*self.velocity))
        if pace > _STANDS_BELOW:
            self.stands_for = 0.0
            self.phase = (self.phase + pace * interval / self.sprites.body.stride) % 1.0
            turn = math.atan2(self.velocity[1], self.velocity[0]) - self.heading
            turn = (turn + math.pi) % (2.0 * math.pi) - math.pi
            self.heading += float(np.clip(turn, -4.0 * interval, 4.0 * interval))
        else:
            self.stands_for += interval


def _between(begin: Array, end: Array) -> tuple[float, Array, Array]:
    """Distance of two points, and (2,) directions to the second one and to the left of that."""
    ahead = end - begin
    distance = float(np.hypot(*ahead))
    ahead = ahead / max(distance, 1e-6)
    return distance, ahead, np.array([-ahead[1], ahead[0]])


@dataclass(frozen=True)
class Crossing:
    """Somebody walks between robot and person."""

    time: float  # seconds
    before: float  # distance in front of the person, meters; 0 for halfway
    lingers: float  # seconds for which they stand there
    pace: float  # m/s


def drawn_crossings(generator: np.random.Generator, seconds: float) -> list[Crossing]:
    """3 to 7 crossings in 100 s, the first after 8 s."""
    count = max(1, round(int(generator.integers(3, 8)) * min(seconds, 100.0) / 100.0))
    slots = np.linspace(8.0, max(seconds - 6.0, 9.0), count + 1)
    crossings = []
    for begin, end in pairwise(slots.tolist()):
        before = float(generator.uniform(0.5, 1.2)) if generator.random() < 0.6 else 0.0
        lingers = 2.5 if generator.random() < 0.5 else 0.0
        time = generator.uniform(begin, begin + 0.5 * (end - begin))
        crossings.append(Crossing(time, before, lingers, generator.uniform(0.9, 1.4)))
    return crossings


@dataclass(eq=False)
class Passage:
    """A crossing that takes place."""

    walker: int  # number of the person
    crossing: Crossing  # what was drawn
    side: float  # 1 if they come from the left of the direction to the person, else -1
    stage: str  # `approach`, `cross`, `linger` or `leave`
    since: float  # time since when the stage lasts, seconds


class Cast:
    """Moves everybody; the first is followed."""

    def __init__(
        self,
        layout: Layout,
        walkers: list[Walker],
        crossings: list[Crossing],
        hides: str,
        generator: np.random.Generator,
    ) -> None:
        self.walkers = walkers
        self._layout = layout
        self._crossings = list(crossings)
        self._generator = generator
        self._passage: Passage | None = None
        self._hiding = _Hiding(layout, hides, generator) if hides else None
        self._alone_for = 0.0
        walkers[0].pause = 3.0

    def advance(self, time: float, interval: float, robot: Pose2D) -> None:
        """Move everybody; times are seconds since the start, and of the step."""
        self._move_followed(time, interval, robot)
        place = robot.position
        self._begin_crossing(time, place)
        for number in range(1, len(self.walkers)):
            passage = self._passage
            if passage and passage.walker == number:
                self._cross(passage, time, interval, place)
            else:
                self._wander(number, interval, place)

    # The followed person

    def _move_followed(self, time: float, interval: float, robot: Pose2D) -> None:
        """Hide, or else wait where the robot sees them while it does not look, or else go on."""
        person, place = self.walkers[0], robot.position
        is_followed = self._is_followed(robot)
        self._alone_for = 0.0 if is_followed else self._alone_for + interval
        if self._hiding and self._hiding.advance(person, time, interval, place, is_followed):
            # Afterwards they come back at once.
            self._alone_for = _PATIENCE
        elif self._alone_for > _PATIENCE:
            if not person.way and not self._is_near(person.position, place):
                person.way, person.pause = self._way_near(person, place), 0.0
            elif person.way and self._is_near(person.position, place):
                person.way, person.pause = [], 2.0
        elif not person.way and person.pause <= 0.0:
            person.way = self._next_way(person, place)
            person.pause = self._generator.choice([0.0, 1.0], p=[0.4, 0.6])
            person.pause *= self._generator.uniform(2.0, 6.0)
        pace = person.pace * (_HURRY if self._hiding and self._hiding.is_hiding else 1.0)
        person.advance(interval, self._layout, _away(person.position, place, 0.9), pace)

    def _is_followed(self, robot: Pose2D) -> bool:
        """Whether the robot looks at the person from nearby."""
        x, y = robot.inward(self.walkers[0].position)
        is_ahead = x > 0.0 and abs(y) < 0.7 * x and np.hypot(x, y) < _LEFT_BEHIND
        return bool(is_ahead and self._layout.sees(robot.position, self.walkers[0].position))

    def _is_near(self, position: Array, robot: Array) -> bool:
        distance = float(np.hypot(*(position - robot)))
        return 1.6 < distance < 2.6 and self._layout.sees(robot, position)

    def _way_near(self, person: Walker, robot: Array) -> list[Array]:
        """A way to the nearest place near the robot."""
        points = self._layout.free_points(0.5)
        for index in np.argsort(np.hypot(*(points - person.position).T)):
            if self._is_near(points[index], robot):
                return self._layout.way(person.position, points[index], [robot])
        return []

    def _next_way(self, person: Walker, robot: Array) -> list[Array]:
        """A way of 2 to 8 m that the robot sees and that passes it at a distance, if possible."""
        part = 0.55 if self._layout.opening else 1.0
        best: tuple[float, list[Array]] = (-math.inf, [])
        for _ in range(16):
            goal = self._layout.free_point(self._generator, part=part)
            if 2.0 < np.hypot(*(goal - person.position)) < 8.0:
                way = self._layout.way(person.position, goal, [robot])
                if not way:
                    continue
                corners = np.array([person.position, *way])
                middles = (corners[1:] + corners[:-1]) / 2.0
                good = min(_nearest(person.position, way, robot), _PASSES)
                good -= _PASSES * (not all(self._layout.sees(robot, one) for one in middles))
                good -= _PASSES * (not all(self._layout.sees(robot, one) for one in way))
                best = max(best, (good, way), key=lambda one: one[0])
                if good == _PASSES:
                    break
        return best[1]

    # Those who walk in between

    def _begin_crossing(self, time: float, robot: Array) -> None:
        if self._passage or not self._crossings or time < self._crossings[0].time:
            return
        person = self.walkers[0].position
        distance, _, across = _between(robot, person)
        if not 1.3 < distance < 4.5 or not self._layout.sees(robot, person):
            return
        crossing = self._crossings[0]
        middle = self._crossed_at(crossing, robot)
        best: tuple[float, int, float] | None = None
        for side in (1.0, -1.0):
            if not self._layout.is_open(middle + side * across, middle - side * across, 0.35):
                continue
            for number, walker in enumerate(self.walkers[1:], 1):
                offset = walker.position - middle
                far = float(np.hypot(*offset))
                wrong = 3.0 * (float(side * (offset @ across)) < 0.3)
                if best is None or far + wrong < best[0]:
                    best = far + wrong, number, side
        if best is None:
            return
        self._crossings.pop(0)
        self._passage = Passage(best[1], crossing, best[2], "approach", time)
        self.walkers[best[1]].way, self.walkers[best[1]].pause = [], 0.0

    def _crossed_at(self, crossing: Crossing, robot: Array) -> Array:
        """Where the line from robot to person is crossed now."""
        ahead = self.walkers[0].position - robot
        distance = float(np.hypot(*ahead))
        before = crossing.before or distance / 2.0
        # Not into the robot.
        along = max(distance - before, min(0.7, 0.6 * distance))
        return np.asarray(robot + ahead * along / max(distance, 1e-6))

    def _cross(self, passage: Passage, time: float, interval: float, robot: Array) -> None:
        walker, layout = self.walkers[passage.walker], self._layout
        _, _, across = _between(robot, self.walkers[0].position)
        middle = self._crossed_at(passage.crossing, robot)
        lasted = time - passage.since
        lateral = passage.side * float((walker.position - middle) @ across)

        def to(stage: str) -> None:
            passage.stage, passage.since = stage, time

        speed = passage.crossing.pace
        if passage.stage == "approach":
            goal = middle + passage.side * 1.0 * across
            if not walker.way or lasted % 0.5 < interval:
                avoid = [robot, self.walkers[0].position]
                walker.way = layout.way(walker.position, goal, avoid)[:3]
            speed = 1.5
            if np.hypot(*(goal - walker.position)) < 0.3:
                to("cross")
            elif lasted > 10.0:
                self._passage = None
        elif passage.stage == "cross":
            walker.way = [middle - passage.side * 0.2 * across]
            if lateral < 0.05:
                to("linger" if passage.crossing.lingers else "leave")
            elif lasted > 4.0:
                to("leave")
        elif passage.stage == "linger":
            walker.way = []
            if lasted > passage.crossing.lingers:
                to("leave")
        elif passage.stage == "leave":
            walker.way = [middle - passage.side * 1.6 * across]
            blocked = not layout.is_open(walker.position, walker.way[0], 0.25)
            if lateral < -1.2 or lasted > 3.0 or (blocked and lateral < -0.6):
                walker.way, self._passage = [], None
        push = self._separation(passage.walker, 0.45)
        push += _away(walker.position, robot, 0.6)
        walker.advance(interval, layout, push, speed)

    # The others

    def _wander(self, number: int, interval: float, robot: Array) -> None:
        walker = self.walkers[number]
        if not walker.way and walker.pause <= 0.0:
            walker.pause = self._generator.uniform(1.0, 8.0)
            goal = self._layout.free_point(self._generator)
            person = self.walkers[0].position
            walker.way = self._layout.way(walker.position, goal, [robot, person])
        push = self._separation(number, _APART) + _away(walker.position, robot, 1.0)
        speed = walker.pace
        leave = self._leave_corridor(walker.position, robot)
        if leave.any():
            speed, push = 0.0, push + leave
        elif walker.way:
            ahead = walker.way[0] - walker.position
            step = walker.position + 0.4 * ahead / max(float(np.hypot(*ahead)), 1e-6)
            if self._leave_corridor(step, robot).any():
                # They wait, or go elsewhere.
                speed = 0.0
                if self._generator.random() < 0.3 * interval:
                    walker.way = []
        walker.advance(interval, self._layout, push, speed)

    def _leave_corridor(self, point: Array, robot: Array) -> Array:
        """(2,) velocity out of the corridor between robot and person; 0 outside of it."""
        distance, ahead, across = _between(robot, self.walkers[0].position)
        if distance < 1e-3:
            return np.zeros(2)
        along = float((point - robot) @ ahead)
        lateral = float((point - robot) @ across)
        if not -0.3 < along < distance + 0.4 or abs(lateral) > _CORRIDOR:
            return np.zeros(2)
        return (1.3 if lateral >= 0.0 else -1.3) * across

    def _separation(self, number: int, apart: float) -> Array:
        """(2,) m/s away from the others."""
        position, push = self.walkers[number].position, np.zeros(2)
        for other, walker in enumerate(self.walkers):
            if other != number:
                push += _away(position, walker.position, apart)
        return push


class _Hiding:
    """Lets the followed person go and hide, time and again."""

    def __init__(self, layout: Layout, kind: str, generator: np.random.Generator) -> None:
        self.is_hiding = False
        self._layout, self._kind, self._generator = layout, kind, generator
        self._next = generator.uniform(9.0, 13.0)
        self._count = int(generator.integers(2))
        self._hidden_for = self._since = self._planned_at = self._lasts = 0.0

    def advance(
        self, person: Walker, time: float, interval: float, robot: Array, is_followed: bool
    ) -> bool:
        """Lead the person; returns whether they hide."""
        if not self.is_hiding:
            if time < self._next or not is_followed:
                return False
            if not self._go(person, robot, time):
                self._next = time + 1.0
                return False
            self.is_hiding, self._hidden_for, self._since = True, 0.0, time
            self._count += 1
            self._lasts = _ABSENCES[self._count % 2]
            if self._kind == "pillar":
                self._lasts = self._generator.uniform(*_ABSENCES)
        if not self._layout.sees(robot, person.position):
            self._hidden_for += interval
        elif time - self._planned_at > 0.5 and (not person.way or self._kind == "pillar"):
            self._go(person, robot, time)
        if self._hidden_for >= self._lasts or time - self._since > self._lasts + _HIDES_WITHIN:
            self.is_hiding, person.way = False, []
            self._next = time + self._generator.uniform(12.0, 18.0)
        return self.is_hiding

    def _go(self, person: Walker, robot: Array, time: float) -> bool:
        """Send the person to the nearest place that the robot does not see, if there is one."""
        layout = self._layout
        points = layout.free_points(0.4)
        if self._kind == "pillar":
            near = [
                np.hypot(*(points - pillar.center).T) < pillar.radius + 0.9
                for pillar in layout.pillars
            ]
            points = points[np.any(near, axis=0)]
        elif layout.opening:
            x, y = layout.opening
            offset = (1.0 if robot[0] < x else -1.0) * (points[:, 0] - x)
            points = points[(offset > 0.5) & (offset < 2.0) & (np.abs(points[:, 1] - y) < 3.0)]
        self._planned_at = time
        order = np.argsort(np.hypot(*(points - person.position).T))[::3]
        hidden = (point for point in points[order] if self._is_hidden(robot, point))
        for point in islice(hidden, _PLACES):
            way = layout.way(person.position, point, [robot])
            if way and _nearest(person.position, way, robot) > 0.9:
                person.way, person.pause = way, 0.0
                return True
        return False

    def _is_hidden(self, robot: Array, point: Array) -> bool:
        _, _, across = _between(robot, point)
        return not any(
            self._layout.sees(robot, point + lateral * across) for lateral in (-0.3, 0.0, 0.3)
        )


def _nearest(begin: Array, way: list[Array], point: Array) -> float:
    """Least distance of a way to a point."""
    walls = np.array(list(pairwise([begin, *way])))
    return distance_to_walls(walls, point)


def _away(position: ArrayLike, other: ArrayLike, apart: float) -> Array:
    """(2,) m/s away from somebody nearer than `apart`."""
    offset = np.subtract(position, other)
    distance = float(np.hypot(*offset))
    if distance >= apart:
        return np.zeros(2)
    return 2.0 * (apart - distance) / apart * offset / max(distance, 1e-6)
