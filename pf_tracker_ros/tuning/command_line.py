"""The command line of `tune`."""

from __future__ import annotations

import argparse
from pathlib import Path

from pf_tracker_ros.command_lines import Parser
from pf_tracker_ros.evaluation.command_line import add_tracker_options, positive, seed

_DESCRIPTION = """\
Tune a preset on sequences with ground truth, and write a ROS parameter file with the values that
differ from it. Optuna searches the largest mean success AUC, see `evaluate --help`. The search is
repeated without each group of sequences, and its values are tested on them. If the gain on these
sequences left out is not above 0 in its 95 % interval, the file has the preset's values.

Parameters of --parameter or --params-file that are tuned are values to start from; others are kept.

With --confidence, no values are searched. The probability that the box is on the target is fitted
to the sequences, and tested in the same way.
"""

_EPILOG = """\
examples:
  tune sequences --trials 100 --jobs 4 --output mine.yaml
  tracker --ros-args --params-file mine.yaml
  tune sequences --confidence --params-file mine.yaml --output calibrated.yaml

Beside mine.yaml are mine.html, a report, and mine.journal, all trials. The same command continues
an interrupted run from the journal; with more trials, it extends a finished one.

exit codes:
  0    success, also if nothing is better than the preset
  1    a sequence or a trial could not be evaluated (the others were), or an output could not be
       written; see standard error
  2    invalid request; nothing was evaluated
  130  interrupted (Ctrl-C); the file has the best values so far
  143  terminated; likewise
"""


DEFAULT_TRIALS = 100
"""Trials without --trials."""


def parser() -> argparse.ArgumentParser:
    """The parser of the command line."""
    parser = Parser("tune", description=_DESCRIPTION, epilog=_EPILOG)
    parser.add_argument(
        "sequences",
        nargs="+",
        metavar="SEQUENCE_DIR",
        help="sequence folder (groundtruth.txt or groundtruth_rect.txt, and frames), or folder of "
        "such folders; at least 2 sequences",
    )
    parser.add_argument(
        "--output",
        type=Path,
        required=True,
        metavar="FILE.yaml",
        help="ROS parameter file to write",
    )
    add_tracker_options(parser)
    parser.add_argument(
        "--confidence",
        action="store_true",
        help="fit track.confidence_calibration, which makes the reported confidence the "
        "probability that the box is on the target, instead of searching values",
    )
    parser.add_argument(
        "--only",
        action="append",
        default=[],
        metavar="NAME",
        help="tune only this parameter; may be repeated (default: all with a measured effect)",
    )
    parser.add_argument(
        "--trials",
        type=positive,
        metavar="N",
        help=f"trials of each search (default: {DEFAULT_TRIALS})",
    )
    parser.add_argument(
        "--seeds",
        type=positive,
        default=2,
        metavar="N",
        help="seeds of the tracker in each trial (default: %(default)s)",
    )
    parser.add_argument(
        "--folds",
        type=_folds,
        default=4,
        metavar="N",
        help="groups of sequences that are left out in turn, in the order given; at most one for "
        "each sequence (default: %(default)s)",
    )
    parser.add_argument(
        "--seed",
        type=seed,
        default=0,
        metavar="N",
        help="seed of the search; the same seed gives the same result (default: %(default)s)",
    )
    parser.add_argument(
        "--jobs",
        type=positive,
        metavar="N",
        help="parallel evaluations (default: 1; with --ray: one per core)",
    )
    parser.add_argument(
        "--ray",
        metavar="ADDRESS",
        help="distribute the evaluations over a Ray cluster: auto or HOST:PORT of a running "
        "cluster, whose machines have the sequences at the same paths, or local to start one on "
        "this machine (needs ray)",
    )
    return parser


def _folds(text: str) -> int:
    if not text.isdecimal() or int(text) < 2:
        raise argparse.ArgumentTypeError(f"{text!r}; allowed: whole numbers from 2")
    return int(text)
