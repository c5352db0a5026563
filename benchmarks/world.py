r"""Accuracy of positions in meters: errors, and whether the covariances are true.

    python benchmarks/world.py --kitti FOLDER --pets FOLDER --calibration View_001.xml \
        --depth FOLDER --cost

Each adds a table; the files of `world_parts/` say what it contains. `follow.py` measures positions
by the tracker's boxes.

NEES: normalized estimation error squared over its degrees of freedom, 1 for a true covariance.
Inside: share of the frames whose truth is in the 90 % region.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator, Sequence
from pathlib import Path

import arguments as options_of
import cv2
from tables import Table
from world_parts.cost import cost_table
from world_parts.depth_camera import depth_table
from world_parts.ground_from_people import plane_table
from world_parts.kitti import kitti_table, read_kitti
from world_parts.pets import RATE, pets_table, read_ground_tracks, read_tsai

from pf_tracker_ros.footage import FootageError
from pf_tracker_ros.progress import OnProgress, progress_bar


def measured(options: argparse.Namespace, on_progress: OnProgress) -> Iterator[Table]:
    """The tables that the options ask for."""
    if options.kitti:
        paths = sorted(options.kitti.glob("*.csv"))
        if not paths:
            raise FootageError(f"{options.kitti} has no tables of KITTI labels (*.csv)")
        yield kitti_table([read_kitti(path) for path in paths], on_progress)
    if options.pets:
        if not options.calibration:
            raise FootageError("--pets needs --calibration, the Tsai calibration of its view")
        camera = read_tsai(options.calibration)
        tracks = read_ground_tracks(options.pets, RATE)
        yield pets_table(camera, tracks, on_progress)
        yield plane_table(camera, tracks, on_progress)
    if options.depth:
        yield depth_table(options.depth, on_progress)
    if options.cost:
        yield cost_table(on_progress)


def main(arguments: Sequence[str] | None = None) -> None:
    """Measure and print the tables."""
    cv2.setNumThreads(1)
    parser = options_of.parser(__doc__)
    for name, what in (
        ("--kitti", "folder with tables of KITTI tracking labels"),
        ("--pets", "folder with gt.txt and det.txt of PETS09-S2L1"),
        ("--calibration", "Tsai calibration of PETS"),
        ("--depth", "folder with frames of a depth camera"),
    ):
        parser.add_argument(name, type=Path, metavar="PATH", help=what)
    parser.add_argument("--cost", action="store_true", help="CPU time of a position")
    options = parser.parse_args(arguments)
    with options_of.told_errors(parser), progress_bar(None, "boxes") as on_progress:
        for table in measured(options, on_progress):
            table.show()


if __name__ == "__main__":
    main()
