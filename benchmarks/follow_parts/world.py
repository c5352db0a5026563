"""A world drawn from a seed: room, light, people, robot and camera."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from follow_parts.actors import Cast, Walker, drawn_crossings
from follow_parts.layout import Layout
from follow_parts.people import Body, Clothes, Sprites
from follow_parts.rendering import CameraState, Renderer, View, camera_pose
from follow_parts.robot import Pose2D, Robot
from follow_parts.scenarios import Scenario

Array = NDArray[np.float64]

RATE = 20.0
"""Frames per second."""
INTERVAL = 1.0 / RATE
ODOMETRY_INTERVAL = 0.025
_STEP = 0.0125
_GRAVITY = 9.81
ACCELERATION_NOISE = 0.05
"""Standard deviation of the accelerometer along each axis, m/s^2."""
# Half of the width of the robot, with a margin, meters, and the radius of a person.
_HALF_WIDTH, _PERSON = 0.3, 0.25


@dataclass(frozen=True, eq=False)
class Truth:
    """Where everybody is at a frame."""

    time: float  # seconds
    view: View  # what the camera sees, and how everybody is seen
    positions: Array  # (N, 2) of everybody in the room, meters; the first is followed
    robot: Pose2D  # the robot in the room
    odometry: Pose2D  # the robot by its odometry
    velocity: Array  # (2,) of the followed person, m/s
    stands_for: float  # seconds for which the followed person stands

    def in_odometry(self, position: Array) -> Array:
        """A (2,) place in the room as it is in the frame of the odometry now."""
        return self.odometry.outward(self.robot.inward(position))

    def in_room(self, position: Array) -> Array:
        """A (2,) place in the frame of the odometry as it is in the room now."""
        return self.robot.outward(self.odometry.inward(position))


class Motion(NamedTuple):
    """What the robot's sensors say of its motion."""

    time: float  # seconds
    odometry: Pose2D  # pose by its wheels
    acceleration: Array  # (3,) of an accelerometer in camera coordinates, m/s^2, upward at rest


class World:
    """A room with a robot and people, the first of whom is followed; the time is in seconds.

    The tilt of a camera without an accelerometer is known by its drawing.
    """

    def __init__(
        self,
        layout: Layout,
        renderer: Renderer,
        robot: Robot,
        cast: Cast,
        generator: np.random.Generator,
    ) -> None:
        self.layout, self.robot, self.cast = layout, robot, cast
        self.time, self.has_imu = 0.0, bool(generator.random() < 0.5)
        self._renderer = renderer
        self._generator = generator
        # Mean and size of its change, period and phase.
        self._light = (
            generator.uniform(0.6, 1.05),
            generator.uniform(0.0, 0.15),
            generator.uniform(15.0, 60.0),
            generator.uniform(0.0, 2.0 * math.pi),
        )

    @classmethod
    def draw(cls, seed: int, scenario: Scenario, seconds: float) -> World:
        """The world of a seed; crossings are spread over the seconds."""
        # Independent generators: a change in one part leaves the others as they are.
        generators = np.random.default_rng(seed).spawn(8)
        layout = Layout.draw(generators[0], scenario.hides)
        renderer = Renderer(layout, generators[1], seed)
        start, person = _beginning(layout, generators[2], scenario)
        robot = Robot(start, generators[3])
        walkers = _walkers(layout, start, person, generators[4], scenario)
        crossings = drawn_crossings(generators[5], seconds) if scenario.crosses else []
        cast = Cast(layout, walkers, crossings, scenario.hides, generators[6])
        return cls(layout, renderer, robot, cast, generators[7])

    def observe(self) -> Truth:
        """The next frame."""
        robot, (pitch, roll) = self.robot, self.robot.tilt
        pose = robot.pose
        camera = CameraState(pose.x, pose.y, pose.yaw, pitch, roll, robot.turn)
        mean, size, period, phase = self._light
        light = mean * (1.0 + size * math.sin(2.0 * math.pi * self.time / period + phase))
        people = [walker.placed for walker in self.cast.walkers]
        return Truth(
            self.time,
            self._renderer.render(camera, people, light),
            np.array([walker.position for walker in self.cast.walkers]),
            pose,
            robot.odometry,
            self.cast.walkers[0].velocity.copy(),
            self.cast.walkers[0].stands_for,
        )

    def advance(self, speed: float, turn: float) -> list[Motion]:
        """Go on to the next frame, as is wanted in m/s and rad/s; returns the motion in between."""
        ranges = self._free_ahead()
        self.cast.advance(self.time, INTERVAL, self.robot.pose)
        measured = []
        first = round(self.time / _STEP)
        for step in range(first + 1, first + round(INTERVAL / _STEP) + 1):
            before = self.robot.speed
            self.robot.drive(_STEP, speed, turn, ranges)
            if step % round(ODOMETRY_INTERVAL / _STEP) == 0:
                forward = (self.robot.speed - before) / _STEP
                acceleration = self.acceleration(forward, self.robot.speed * self.robot.turn)
                measured.append(Motion(step * _STEP, self.robot.odometry, acceleration))
        self.time = (first + round(INTERVAL / _STEP)) * _STEP
        return measured

    def acceleration(self, forward: float, left: float) -> Array:
        """What an accelerometer in the camera measures while the robot accelerates."""
        pitch, roll = self.robot.tilt
        rotation = camera_pose(CameraState(0.0, 0.0, 0.0, pitch, roll)).rotation
        noise = self._generator.normal(0.0, ACCELERATION_NOISE, 3)
        return np.asarray(rotation.T @ [forward, left, _GRAVITY] + noise)

    def is_free(self, angle: float, distance: float) -> bool:
        """Whether the robot can go straight on at an angle to its left, radians, so many meters."""
        pose = self.robot.pose
        way = pose.moved(0.0, angle)
        end = self.robot.pose.position + distance * np.array([math.cos(way.yaw), math.sin(way.yaw)])
        places = [way.inward(walker.position) for walker in self.cast.walkers[1:]]
        return self.layout.is_open(self.robot.pose.position, end, _HALF_WIDTH + 0.1) and not any(
            0.0 < x < distance + _PERSON and abs(y) < _HALF_WIDTH + _PERSON for x, y in places
        )

    def _free_ahead(self) -> tuple[float, float]:
        """Free distances ahead and behind of the robot, meters."""
        pose = self.robot.pose
        angles = pose.yaw + np.linspace(-1.2, 1.2, 31)
        free = []
        for turn in (0.0, math.pi):
            rays = np.stack([np.cos(angles + turn), np.sin(angles + turn)], axis=1)
            ranges, _ = self.layout.ranges(self.robot.pose.position, rays)
            along = ranges * np.cos(angles - pose.yaw)
            across = ranges * np.abs(np.sin(angles - pose.yaw))
            ahead = float(along[across < _HALF_WIDTH].min(initial=20.0))
            for walker in self.cast.walkers:
                x, y = pose.inward(walker.position)
                x *= -1.0 if turn else 1.0
                if x > 0.0 and abs(y) < _HALF_WIDTH + _PERSON:
                    ahead = min(ahead, float(x) - _PERSON)
            free.append(ahead)
        return free[0], free[1]


def _beginning(
    layout: Layout, generator: np.random.Generator, scenario: Scenario
) -> tuple[Pose2D, Array]:
    """Where the robot begins, and the person 2 m before it."""
    part = 0.5 if scenario.hides == "door" else 1.0
    while True:
        point = layout.free_point(generator, 1.0, part)
        yaw = generator.uniform(-math.pi, math.pi)
        person = point + 2.0 * np.array([math.cos(yaw), math.sin(yaw)])
        if layout.clearance(person) > 0.6 and layout.is_open(point, person, 0.4):
            return Pose2D(float(point[0]), float(point[1]), yaw), person


def _walkers(
    layout: Layout,
    start: Pose2D,
    person: Array,
    generator: np.random.Generator,
    scenario: Scenario,
) -> list[Walker]:
    """The followed person and 3 to 6 others, at most two in a corridor."""
    walkers: list[Walker] = []
    clothes = Clothes.draw(generator)
    others = int(generator.integers(3, 7)) // (3 if scenario.hides == "corner" else 1)
    for number in range(1 + others):
        body, own = Body.draw(generator), Clothes.draw(generator)
        if number == 0 or scenario.is_alike:
            own = clothes
        if scenario.is_alike and walkers:
            first = walkers[0].sprites.body
            body = replace(body, hair=first.hair, has_long_hair=first.has_long_hair)
        seed = 0 if scenario.is_alike else int(generator.integers(2**31))
        position = person
        while number and (
            np.hypot(*(position - start.position)) < 2.5
            or any(np.hypot(*(position - one.position)) < 1.2 for one in walkers)
        ):
            position = layout.free_point(generator, 0.6)
        sprites = Sprites(body, own, seed)
        pace = generator.uniform(0.9, 1.1) if number == 0 else generator.uniform(0.6, 1.2)
        walkers.append(Walker(sprites, position.copy(), pace, generator.uniform(-3.1, 3.1)))
    return walkers
