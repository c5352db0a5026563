"""How long a target stays in doubt after it was out of sight; values by the equation."""

import math

import pytest

from pf_tracker_ros.localization.trust import Trust, log_odds_by_place

SECOND = 1_000_000_000
# Of a place that says as much for the target as for another one: one in 20 square meters.
EVEN = math.log(0.05)
RULES = {"min_confidence": 0.5, "hold": 2.0}


def test_it_is_in_doubt_while_it_is_hidden_and_after_a_contradiction():
    trust = Trust()
    trust.measure(0, 0.0, 0.5, **RULES)
    assert trust.doubted_for == 0.0
    # Not with a low confidence alone.
    trust.lose_sight(is_hidden=False)
    assert trust.doubted_for == 0.0
    trust.lose_sight(is_hidden=True)
    assert trust.doubted_for == math.inf
    trust = Trust()
    trust.contradict(0)
    trust.measure(0, 10.0, 0.5, **RULES)
    assert trust.doubted_for == pytest.approx(2.0)


@pytest.mark.parametrize(
    ("by_place", "confidence", "seconds"),
    [
        (0.1, 0.5, 0.0),
        # Log odds of -2 of at least -4: half of the time.
        (-2.0, 0.5, 1.0),
        (-4.0, 0.5, 2.0),
        # Odds of 3 to 1 by the confidence.
        (-2.0, 0.75, 0.5 * (2.0 - math.log(3.0))),
        (-2.0, 0.9, 0.0),
    ],
)
def test_the_place_and_the_confidence_decide_how_long(by_place, confidence, seconds):
    trust = Trust()
    trust.lose_sight(is_hidden=True)
    trust.measure(0, by_place, confidence, **RULES)
    assert trust.doubted_for == pytest.approx(seconds)
    if seconds:
        # Later places are predicted from the first one, and say nothing new.
        trust.measure(round((seconds - 0.25) * SECOND), 10.0, confidence, **RULES)
        assert trust.doubted_for == pytest.approx(0.25)
        trust.measure(round(seconds * SECOND), 10.0, confidence, **RULES)
        assert trust.doubted_for == 0.0
        # Without another loss, a place says nothing any more.
        trust.measure(5 * SECOND, -50.0, confidence, **RULES)
        assert trust.doubted_for == 0.0


@pytest.mark.parametrize("is_hidden", [False, True])
def test_a_weak_frame_does_not_end_a_doubt(is_hidden):
    """The filter has taken the doubted place for the target's, so the next one agrees with it."""
    trust = Trust()
    trust.contradict(0)
    trust.measure(0, 0.0, 0.5, **RULES)
    trust.lose_sight(is_hidden=is_hidden)
    trust.measure(SECOND, 10.0, 0.5, **RULES)
    # It counts anew where it was not tracked at all.
    assert trust.doubted_for == pytest.approx(2.0 if is_hidden else 1.0)
    # A new doubt begins without the old one, be it settled, or older than it could have been.
    trust.lose_sight(is_hidden=True)
    trust.measure(4 * SECOND, 0.1, 0.5, **RULES)
    assert trust.doubted_for == 0.0


def test_the_odds_by_a_place():
    assert log_odds_by_place(None, None) == 0.0
    # A narrow prediction, by which others are less likely there.
    assert log_odds_by_place(EVEN + 1.0, 0.5) == pytest.approx(1.0)
    assert log_odds_by_place(EVEN - 3.0, 8.0) == pytest.approx(-3.0)
    assert log_odds_by_place(-1e9, 2e9) == -4.0
    # A wide one: whoever is where it is likeliest may be it as well.
    assert log_odds_by_place(EVEN - 7.0, 0.0) == 0.0
    assert log_odds_by_place(EVEN - 7.0, 5.0) == pytest.approx(-2.5)
