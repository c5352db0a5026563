"""What differs between the rows of the table."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Scenario:
    """A kind of run."""

    name: str  # of the row
    has_depth: bool = True  # whether there are depth images
    has_detector: bool = False  # whether a detector runs
    # of the tracker; above 1, the detector starts all targets, and the right one is selected when
    # it is first reported
    max_targets: int = 1
    crosses: bool = True  # whether others walk between robot and person
    is_alike: bool = False  # whether all wear the same
    hides: str = ""  # behind what the person hides: a `door`, `corner` or `pillar`; empty for never
    is_by_hand: bool = True  # whether the target is drawn by hand; else the detector starts it


SCENARIOS = {
    one.name: one
    for one in (
        Scenario("depth_alone", crosses=False),
        Scenario("depth_hand"),
        Scenario("depth_detector", has_detector=True, is_by_hand=False),
        Scenario("depth_select", has_detector=True, is_by_hand=False, max_targets=32),
        Scenario("image_alone", has_depth=False, crosses=False),
        Scenario("image_hand", has_depth=False),
        Scenario("image_detector", has_depth=False, has_detector=True, is_by_hand=False),
        Scenario("alike", has_detector=True, is_by_hand=False, is_alike=True),
        Scenario("door", has_detector=True, is_by_hand=False, crosses=False, hides="door"),
        Scenario("corner", has_detector=True, is_by_hand=False, crosses=False, hides="corner"),
        Scenario("pillar", has_detector=True, crosses=False, hides="pillar"),
    )
}
"""By name."""
