"""The clips of demo and console: drawn streets, and the targets in them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from street_scenes import SCENES, StreetFootage


@dataclass(frozen=True)
class Clip:
    """A drawn street and the target in it.

    Attributes:
        name: Key of `SCENES`, name of the folder of the clip.
        title: Heading on the page of the results.
        description: What it shows, for the page of the results.
        box: (x, y, width, height) of the target in the first frame, pixels; None if a detector
            starts several targets.
        parameters: Tracker parameters of the clip that differ from the preset.
    """

    name: str
    title: str
    description: str
    box: tuple[float, float, float, float] | None
    parameters: Mapping[str, float | str] = field(default_factory=dict)

    @property
    def bag(self) -> str:
        """Name of the file of its recording."""
        return f"{self.name}.mcap"

    def draw(self) -> StreetFootage:
        """The frames of the clip."""
        return SCENES[self.name]()


CLIPS = (
    Clip(
        name="hidden",
        title="Hidden and found again",
        description="A person in red walks behind a parked van: hidden for three seconds, and "
        "partly for longer. The tracker says so. Its search first tries a man in yellow: the box "
        "is orange and the confidence below 0.5, so this is a guess. It is sure of the person in "
        "red again once they are in full view.",
        box=(42.0, 188.0, 44.0, 132.0),
    ),
    Clip(
        name="people",
        title="Several people",
        description="Seven people pass each other and two trees. The built-in detector of people, "
        "five times a second, starts the targets once it has seen them twice; filters track them "
        "in between.",
        box=None,
        parameters={
            "max_targets": 8,
            "built_in_detector": "people",
            "built_in_detector_rate": 5.0,
        },
    ),
)
