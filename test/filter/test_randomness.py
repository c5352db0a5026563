"""A source of random numbers as a value."""

import copy
import pickle

import numpy as np
import pytest

from pf_tracker_ros.filter.particles import GeneratorState

SEEDS = [0, 7, 2**40]


def drawn(generator, count=100):
    """Numbers of each kind that the tracker draws, in one stream."""
    return np.concatenate(
        [
            generator.standard_normal(count),
            generator.random(count),
            generator.integers(0, 9, count),
            generator.standard_exponential(count, dtype=np.float32),
        ]
    )


@pytest.mark.parametrize("seed", SEEDS)
def test_the_numbers_are_those_of_numpy_s_default_generator(seed):
    generator_state = GeneratorState.of(np.random.default_rng(seed))
    np.testing.assert_array_equal(
        drawn(generator_state.generator()), drawn(np.random.default_rng(seed))
    )


def test_it_stands_where_the_generator_stood():
    """Wherever that is: after the first of two 32-bit numbers that one of 64 bits gives, too."""
    generator = np.random.default_rng(3)
    generator.integers(0, 9, dtype=np.uint32)
    generator_state = GeneratorState.of(generator)
    np.testing.assert_array_equal(drawn(generator_state.generator()), drawn(generator))


def test_what_is_drawn_leaves_it_as_it_is():
    original = np.random.default_rng(5)
    generator_state = GeneratorState.of(original)
    state = copy.deepcopy(generator_state.state)
    first = drawn(generator_state.generator())
    drawn(original)
    assert generator_state.state == state
    np.testing.assert_array_equal(drawn(generator_state.generator()), first)


def test_two_generators_of_one_source_do_not_disturb_each_other():
    generator_state = GeneratorState.of(np.random.default_rng(5))
    one, other = generator_state.generator(), generator_state.generator()
    expected = drawn(generator_state.generator())
    drawn(one)
    np.testing.assert_array_equal(drawn(other), expected)


def test_steps_of_a_stream_are_the_stream():
    """As a target draws: from where the last frame left off."""
    generator_state, parts = GeneratorState.of(np.random.default_rng(11)), []
    for count in (3, 1, 17):
        generator = generator_state.generator()
        parts.append(generator.standard_normal(count))
        generator_state = GeneratorState.of(generator)
    np.testing.assert_array_equal(
        np.concatenate(parts), np.random.default_rng(11).standard_normal(21)
    )


@pytest.mark.parametrize(
    "copied", [copy.copy, copy.deepcopy, lambda one: pickle.loads(pickle.dumps(one))]
)
def test_a_copy_goes_on_with_the_same_numbers_and_on_its_own(copied):
    generator_state = GeneratorState.of(np.random.default_rng(9))
    other = copied(generator_state)
    expected = drawn(generator_state.generator())
    np.testing.assert_array_equal(drawn(other.generator()), expected)
    np.testing.assert_array_equal(drawn(generator_state.generator()), expected)


def test_it_cannot_be_set_elsewhere():
    generator_state = GeneratorState.of(np.random.default_rng(1))
    with pytest.raises(AttributeError):
        generator_state.state = {}
