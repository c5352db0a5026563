"""The state of a random generator as a value."""

import copy
import pickle

import numpy as np
import pytest

from pf_tracker_ros.filter.particles import GeneratorState


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


def test_the_state_is_that_of_the_generator():
    """Also after the first 32-bit half of a 64-bit number."""
    generator = np.random.default_rng(3)
    generator.integers(0, 9, dtype=np.uint32)
    generator_state = GeneratorState.of(generator)
    np.testing.assert_array_equal(drawn(generator_state.generator()), drawn(generator))


def test_drawing_does_not_change_it():
    original = np.random.default_rng(5)
    generator_state = GeneratorState.of(original)
    state = copy.deepcopy(generator_state.state)
    first = drawn(generator_state.generator())
    drawn(original)
    assert generator_state.state == state
    np.testing.assert_array_equal(drawn(generator_state.generator()), first)


def test_a_sequence_drawn_in_steps_is_the_same_sequence():
    """As a target draws: each frame continues from the state of the last."""
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
def test_a_copy_is_independent_and_gives_the_same_numbers(copied):
    generator_state = GeneratorState.of(np.random.default_rng(9))
    other = copied(generator_state)
    expected = drawn(generator_state.generator())
    np.testing.assert_array_equal(drawn(other.generator()), expected)
    np.testing.assert_array_equal(drawn(generator_state.generator()), expected)


def test_it_cannot_be_changed():
    generator_state = GeneratorState.of(np.random.default_rng(1))
    with pytest.raises(AttributeError):
        generator_state.state = {}
