r"""Accuracy of positions in meters: errors, and whether the covariances are true.

    python benchmarks/world.py --kitti FOLDER --pets FOLDER --calibration View_001.xml \
        --depth FOLDER --output world.md

Each folder adds a table; the files of `world_parts/` say what it contains. The CPU time of a
position needs no data. `follow.py` measures positions by the tracker's boxes.

NEES: normalized estimation error squared over its degrees of freedom, 1 for a true covariance.
Inside: share of the frames whose truth is in the 90 % region.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterable, Sequence
from pathlib import Path

import arguments as options_of
import cv2
from tables import Table, publish
from world_parts.cost import cost_table
from world_parts.depth_camera import depth_table
from world_parts.ground_from_people import plane_table
from world_parts.kitti import kitti_table, read_kitti
from world_parts.pets import RATE, pets_table, read_ground_tracks, read_tsai

from pf_tracker_ros.progress import OnProgress, progress_bar

PARTS = ("kitti", "pets", "plane", "depth", "cost")


def measured(options: argparse.Namespace, on_progress: OnProgress) -> Iterable[Table]:
    """The tables that the options ask for."""
    parts = options.only or PARTS
    if options.kitti and "kitti" in parts:
        paths = sorted(options.kitti.glob("*.csv"))
        if not paths:
            raise ValueError(f"{options.kitti} has no tables of KITTI labels (*.csv)")
        yield kitti_table([read_kitti(path) for path in paths], on_progress)
    if options.pets and {"pets", "plane"}.intersection(parts):
        if not options.calibration:
            raise ValueError("--pets needs --calibration, the Tsai calibration of its view")
        camera = read_tsai(options.calibration)
        tracks = read_ground_tracks(options.pets, RATE)
        if "pets" in parts:
            yield pets_table(camera, tracks, on_progress)
        if "plane" in parts:
            yield plane_table(camera, tracks, on_progress)
    if options.depth and "depth" in parts:
        yield depth_table(options.depth, on_progress)
    if "cost" in parts:
        yield cost_table(on_progress)


def arguments() -> argparse.ArgumentParser:
    """The command line."""
    made = options_of.parts_parser(__doc__, PARTS)
    made.add_argument("--kitti", type=Path, metavar="DIR", help="tables of KITTI tracking labels")
    made.add_argument("--pets", type=Path, metavar="DIR", help="gt.txt and det.txt of PETS09-S2L1")
    made.add_argument("--calibration", type=Path, metavar="FILE", help="Tsai calibration of PETS")
    made.add_argument("--depth", type=Path, metavar="DIR", help="frames of a depth camera")
    return made


def main(argv: Sequence[str] | None = None) -> int:
    """Measure and print."""
    cv2.setNumThreads(1)
    parser = arguments()
    options = parser.parse_args(argv)
    try:
        with progress_bar(None, "boxes") as on_progress:
            tables = list(measured(options, on_progress))
        publish(options.output, tables)
    except (OSError, ValueError) as error:
        parser.error(" ".join(str(error).split()))
    return 0


if __name__ == "__main__":
    sys.exit(main())
