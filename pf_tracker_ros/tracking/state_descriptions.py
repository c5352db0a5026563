"""What the states of a track are called for people, and how bad each is."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType

SEVERITIES: Mapping[str, int] = MappingProxyType(
    {"idle": 0, "tracking": 0, "occluded": 1, "lost": 2}
)
"""State to level of diagnostic_msgs/DiagnosticStatus: 0 is OK, 1 WARN, 2 ERROR."""

DESCRIPTIONS: Mapping[str, str] = MappingProxyType(
    {
        "idle": "waiting for a target",
        "tracking": "tracking",
        "occluded": "the target is hidden; its place is a guess",
        "lost": "the target is lost",
    }
)
"""State to words."""
