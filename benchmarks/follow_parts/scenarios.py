"""What differs between the rows of the table."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Scenario:
    """A kind of run.

    Attributes:
        name: Of the row.
        has_depth: Whether there are depth images.
        has_detector: Whether a detector runs.
        max_targets: Of the tracker; above 1, the detector starts all targets, and the right one is
            selected when it is first reported.
        crosses: Whether others walk between robot and person.
        is_alike: Whether all wear the same.
        is_by_hand: Whether the target is drawn by hand; else the detector starts it.
        hides: Where the person goes to hide: `door`, `pillar`, or nowhere (empty).
    """

    name: str
    has_depth: bool = True
    has_detector: bool = False
    max_targets: int = 1
    crosses: bool = True
    is_alike: bool = False
    hides: str = ""
    is_by_hand: bool = True


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
        Scenario("pillar", has_detector=True, crosses=False, hides="pillar"),
    )
}
"""By name."""
