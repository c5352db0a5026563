"""A source of random numbers as a value."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.random.bit_generator import ISeedSequence
from numpy.typing import DTypeLike, NDArray


class _AnySeed(ISeedSequence):
    """To make a generator of, whose state is then replaced: a true seed would take far longer."""

    def generate_state(
        self, n_words: int, dtype: DTypeLike = np.uint32
    ) -> NDArray[np.uint32 | np.uint64]:
        return np.zeros(n_words, dtype)


_ANY_SEED = _AnySeed()


@dataclass(frozen=True, eq=False)
class Randomness:
    """Where a source of random numbers stands; what is drawn from it leaves it as it is.

    Attributes:
        state: Of a PCG64 bit generator, as NumPy describes it.
    """

    state: Mapping[str, Any]

    @classmethod
    def of(cls, generator: np.random.Generator) -> Randomness:
        """Where a generator, as `numpy.random.default_rng` makes it, stands."""
        return cls(generator.bit_generator.state)

    def generator(self) -> np.random.Generator:
        """A generator that goes on from here, the same numbers at every call."""
        bits = np.random.PCG64(_ANY_SEED)  # type: ignore[arg-type]
        bits.state = self.state  # type: ignore[assignment]
        return np.random.Generator(bits)
