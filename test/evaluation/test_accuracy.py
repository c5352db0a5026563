"""Lower bounds of the presets' accuracy on real footage, where available."""

import functools

import pytest

from pf_tracker_ros import Tracker
from pf_tracker_ros.evaluation.one_pass import evaluate_sequences
from pf_tracker_ros.evaluation.results import mean_scores
from pf_tracker_ros.evaluation.sequences import read_sequences

# Preset, sequences, mean success AUC.
FLOORS = [("default", "*", 0.6), ("li2007", "*", 0.40), ("zhang2015", "*ir_*", 0.55)]


@pytest.mark.parametrize(("preset", "names", "floor"), FLOORS)
def test_mean_success_auc_over_the_development_sequences(preset, names, floor, sequences_directory):
    sequences = read_sequences(
        path.parent for path in sequences_directory.glob(f"{names}/groundtruth.txt")
    )
    make_tracker = functools.partial(Tracker.from_preset, preset)
    results = evaluate_sequences(sequences, make_tracker, range(1), jobs=2)
    assert mean_scores(results).success_auc >= floor
