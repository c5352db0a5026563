"""Decoding of videos: frames per second of CPU time with PyAV and with OpenCV.

    python benchmarks/videos.py VIDEO... --runs 5

Each run is a process of its own that reads ahead as `track` does, and both decoders take turns. The
best run counts.
"""

from __future__ import annotations

import argparse
import subprocess
import sys
import time
from contextlib import closing
from pathlib import Path

import arguments
import cv2
from tables import Table

from pf_tracker_ros.footage.prefetch import Prefetch
from pf_tracker_ros.footage.video_decoding_opencv import OpencvVideo
from pf_tracker_ros.footage.video_decoding_pyav import PyavVideo

_DECODERS = {"PyAV": PyavVideo, "OpenCV": OpencvVideo}


def rate(path: Path, decoder: str) -> float:
    """Frames per second of CPU time, without those for opening."""
    cv2.setNumThreads(1)
    video = _DECODERS[decoder](path)
    with closing(Prefetch(video.pictures())) as pictures:
        iterator = iter(pictures)
        next(iterator)
        before = time.process_time()
        count = sum(1 for _ in iterator)
        return count / (time.process_time() - before)


def _rate_in_process(path: Path, decoder: str) -> float:
    command = [sys.executable, __file__, str(path), "--decoder", decoder]
    return float(subprocess.run(command, check=True, capture_output=True, text=True).stdout)


def main() -> None:
    """Run the command."""
    parser = arguments.parser(__doc__)
    parser.add_argument("videos", nargs="+", type=Path, metavar="VIDEO")
    parser.add_argument(
        "--runs", type=arguments.at_least(1), default=5, metavar="N", help="[%(default)s]"
    )
    parser.add_argument("--decoder", choices=_DECODERS, help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.decoder:
        print(rate(options.videos[0], options.decoder))
        return
    rows = []
    for path in options.videos:
        rates = [
            [_rate_in_process(path, decoder) for decoder in _DECODERS] for _ in range(options.runs)
        ]
        best = [max(each) for each in zip(*rates, strict=True)]
        rows.append([path.name, *(f"{each:.0f}" for each in best), f"{best[0] / best[1]:.2f}"])
    Table("frames per second of CPU time", ("video", *_DECODERS, "PyAV / OpenCV"), [rows]).show()


if __name__ == "__main__":
    main()
