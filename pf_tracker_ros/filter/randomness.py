"""A source of random numbers as a value."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

# To make a generator of, whose state is then replaced; drawing entropy would take far longer.
_ANY_SEED = np.random.SeedSequence(0)


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
        bits = np.random.PCG64(_ANY_SEED)
        bits.state = self.state  # type: ignore[assignment]
        return np.random.Generator(bits)
