"""A motion model is one new file: `filter/random_walk.py`."""

import pytest

from pf_tracker_ros.filter import MOTION_MODELS


def test_exactly_its_own_parameters_are_active_with_it(extended):
    code = """
every = declarations(TrackerParameters)

def of_motion(model):
    chosen = values | {"motion.model": model}
    active = (name for name, one in every.items() if one.is_active(chosen))
    return [name for name in active if name.startswith("motion.")]

values = preset_parameters("li2007")
print(json.dumps({
    "own": of_motion("random_walk"),
    "other": of_motion("constant_velocity"),
    "condition": every["motion.vertical_share"].condition,
    "choices": every["motion.model"].choices,
}))
"""
    result = extended(code)
    own = ["motion.model", "motion.position_noise", "motion.vertical_share"]
    assert result["own"] == own
    assert result["other"] == ["motion.model", "motion.position_noise", "motion.velocity_noise"]
    assert result["condition"] == ["motion.model", ["random_walk"]]
    assert {*MOTION_MODELS, "random_walk"} <= set(result["choices"])
    assert "random_walk" not in MOTION_MODELS


def test_the_model_by_hand(extended):
    code = """
from pf_tracker_ros.filter import MOTION_MODELS

parameters = MOTION_MODELS.parameters_of("random_walk")(position_noise=0.5, vertical_share=0.2)
motion = MOTION_MODELS["random_walk"]((100.0, 50.0, 40.0, 10.0), parameters)
draw = np.random.default_rng(0)
states = np.tile([120.0, 55.0], (40_000, 1))
moved = motion.predict(states, 0.25, draw)
prior = motion.sample_prior(40_000, draw)
print(json.dumps({
    "mean": moved.mean(axis=0).tolist(),
    "std": moved.std(axis=0).tolist(),
    "prior": [prior.mean(axis=0).tolist(), prior.std(axis=0).tolist()],
    "boxes": motion.boxes(states[:1]).tolist(),
    "inside": motion.constrain(np.array([[-9.0, 900.0]]), (160, 90)).tolist(),
}))
"""
    result = extended(code)
    # 0.5 box sizes of 20 px per square root of a second, for 0.25 s.
    assert result["mean"] == pytest.approx([120.0, 55.0], abs=0.1)
    assert result["std"] == pytest.approx([5.0, 1.0], rel=0.02)
    mean, std = result["prior"]
    assert mean == pytest.approx([120.0, 55.0], abs=0.05)
    assert std == pytest.approx([1.0, 1.0], rel=0.02)
    assert result["boxes"] == [[100.0, 50.0, 40.0, 10.0]]
    assert result["inside"] == [[0.0, 90.0]]


def test_an_unsupported_proposal_is_rejected_with_models_that_can(extended):
    code = """
print(json.dumps([
    refusal(Tracker.from_preset, "default", parameters=choice | {"motion.model": "random_walk"})
    for choice in ({"proposal.method": "search"}, {"proposal.method": "kalman"})
]))
"""
    search, kalman = extended(code)
    assert search.startswith("parameter 'proposal.method' is 'search' with the motion model")
    assert kalman.startswith("parameter 'proposal.method' is 'kalman' with the motion model")
    models = "'transition', or the motion model"
    assert search.endswith(f"{models} 'constant_velocity' or 'constant_velocity_and_size'")
    assert kalman.endswith(f"{models} 'affine' or 'second_order_autoregressive'")
