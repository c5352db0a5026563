"""The executable `evaluate`: whether there is an OpenCV is asked before anything imports it."""

from __future__ import annotations

import sys

from pf_tracker_ros.opencv import require_opencv


def evaluate() -> int:
    """Run the command, and return its exit code; see `pf_tracker_ros.evaluation.__main__.main`."""
    try:
        require_opencv()
    except ModuleNotFoundError as error:
        print(f"evaluate: error: {error}", file=sys.stderr)
        return 2
    from pf_tracker_ros.evaluation.__main__ import main

    return main()
