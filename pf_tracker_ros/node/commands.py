"""The executables. A signal that comes while they are still importing ends them as any other."""

from __future__ import annotations

from pf_tracker_ros.node.signals import hold_signals


def tracker() -> None:
    """Run the tracker node."""
    hold_signals()
    from pf_tracker_ros.node.tracker_node import main

    main()


def replay() -> int:
    """Run the replay publisher, and return its exit code."""
    hold_signals()
    from pf_tracker_ros.node.replay_node import main

    return main()
