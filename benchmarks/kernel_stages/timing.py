"""CPU times of alternating calls, so that other load slows all of them."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from statistics import median
from typing import Any, NamedTuple

# A turn calls as often as it takes for the clock not to matter, seconds.
_SHORTEST_TURN = 2e-3
_MOST_CALLS = 200


class Timed(NamedTuple):
    """A call to be timed.

    Attributes:
        call: Takes what was prepared.
        prepare: Makes what one call needs and no other may have used; not timed.
    """

    call: Callable[[Any], object]
    prepare: Callable[[], Any] = lambda: None


def by_turns(timed: Sequence[Timed], turns: int) -> list[float]:
    """Median milliseconds of CPU time of one call of each.

    The first call of a turn finds the caches full of the others' data and is not counted.
    """
    counts = [_calls(one) for one in timed]
    found: list[list[float]] = [[] for _ in timed]
    for _ in range(turns):
        for one, count, times in zip(timed, counts, found, strict=True):
            times.append(_mean(one, count))
    return [median(times) for times in found]


def each_call(call: Callable[[], object], count: int) -> list[float]:
    """Milliseconds of CPU time of each of some calls."""
    times = []
    for _ in range(count):
        began = time.process_time()
        call()
        times.append(1e3 * (time.process_time() - began))
    return times


def _calls(one: Timed) -> int:
    shortest = min(_mean(one, 1) for _ in range(3))
    return min(max(round(_SHORTEST_TURN / max(1e-3 * shortest, 1e-7)), 1), _MOST_CALLS)


def _mean(one: Timed, count: int) -> float:
    first, *others = (one.prepare() for _ in range(count + 1))
    one.call(first)
    began = time.process_time()
    for prepared in others:
        one.call(prepared)
    return 1e3 * (time.process_time() - began) / count
