"""The loop: the world is seen, tracked and located, and the robot drives by what is published."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from follow_parts.chain import LibraryChain, Report, stamp_at
from follow_parts.controller import FollowController
from follow_parts.detector import DELAY, INTERVAL, detect
from follow_parts.scenarios import Scenario
from follow_parts.world import RATE, Motion, Truth, World
from pf_tracker_ros import Detections
from pf_tracker_ros.boxes import Box, iou

if TYPE_CHECKING:
    # ROS is not installed everywhere.
    from follow_parts.nodes import NodeChain

# Frames from an image to the command that follows from it: 100 ms.
_COMMAND_DELAY = 2
# Generators of a seed: that of the world, and that of the detector.
_DETECTOR = 1
_SELECTED_ABOVE = 0.5


@dataclass(frozen=True, eq=False)
class Moment:
    """What was true at a frame, and what was said."""

    truth: Truth  # where everybody is
    report: Report  # what was published


@dataclass(eq=False)
class _User:
    """Chooses the right person once, by hand, by the first detection or by selection."""

    scenario: Scenario
    chain: LibraryChain | NodeChain
    has_chosen: bool = field(default=False, init=False)

    def draw(self, truth: Truth) -> None:
        """Draw a box, where the scenario wants it."""
        box = truth.view.people[0].box_in_image
        if self.scenario.is_by_hand and not self.has_chosen and box:
            self.chain.session.request(box, stamp_at(truth.time))
            self.has_chosen = True

    def filter(self, detections: Detections, box: Box | None) -> Detections:
        """The detections that the tracker gets: a single target starts with the right person."""
        if self.has_chosen or self.scenario.max_targets > 1:
            return detections
        kept = [
            index
            for index, one in enumerate(detections.boxes)
            if box and iou(np.array(one), np.array(box)) > _SELECTED_ABOVE
        ]
        self.has_chosen = bool(kept)
        return Detections(
            [detections.boxes[index] for index in kept],
            [detections.scores[index] for index in kept],
            ["person"] * len(kept),
        )

    def select(self, truth: Truth, report: Report) -> None:
        """Select the right one of several targets when it is first reported."""
        box = truth.view.people[0].box_in_image
        if self.has_chosen or self.scenario.max_targets == 1 or not box:
            return
        for id, one in report.targets.items():
            if iou(np.array(one), np.array(box)) > _SELECTED_ABOVE:
                self.chain.session.select(id)
                self.has_chosen = True
                return


def moments(
    world: World, scenario: Scenario, seed: int, seconds: float, chain: LibraryChain | NodeChain
) -> Iterator[Moment]:
    """Run a scenario in a world, frame by frame; the seed is that of the detector."""
    controller, user = FollowController(), _User(scenario, chain)
    generator = np.random.default_rng([seed, _DETECTOR])
    late: deque[tuple[float, float, Box | None, Detections]] = deque()
    commands = deque([(0.0, 0.0)] * _COMMAND_DELAY)
    chain.take_motion(Motion(0.0, world.robot.odometry, world.acceleration(0.0, 0.0)))
    for number in range(round(seconds * RATE)):
        truth = world.observe()
        time, people = truth.time, truth.view.people
        user.draw(truth)
        if scenario.has_detector and number % round(INTERVAL * RATE) == 0:
            late.append((time + DELAY, time, people[0].box_in_image, detect(people, generator)))
        if late and late[0][0] <= time + 1e-6:
            _, seen_at, box, detections = late.popleft()
            chain.session.add_detections(user.filter(detections, box), stamp_at(seen_at))
        depth = truth.view.depth if scenario.has_depth else None
        report = chain.process(truth.view.image, depth, time)
        user.select(truth, report)
        yield Moment(truth, report)
        controller.take(time, truth.odometry, report)
        commands.append(controller.command(time, truth.odometry, world.is_free))
        for motion in world.advance(*commands.popleft()):
            chain.take_motion(motion)
