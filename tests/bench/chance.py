"""Binomial chances, exactly: what a statistical test states about its own false failures."""

from math import exp, lgamma, log


def chance_of(hits: int, tries: int, rate: float) -> float:
    """Chance of exactly `hits` successes in `tries` at this rate."""
    if rate in (0.0, 1.0):
        return float(hits == rate * tries)
    ways = lgamma(tries + 1) - lgamma(hits + 1) - lgamma(tries - hits + 1)
    return exp(ways + hits * log(rate) + (tries - hits) * log(1.0 - rate))


def chance_at_most(hits: int, tries: int, rate: float) -> float:
    """Chance of at most `hits` successes in `tries`.

    >>> round(chance_at_most(1, 2, 0.5), 6)
    0.75
    """
    return min(1.0, sum(chance_of(k, tries, rate) for k in range(hits + 1)))


def chance_below(share: float, tries: int, rate: float) -> float:
    """Chance that a method with this true rate shows less than `share` in `tries`."""
    allowed = -1
    while allowed + 1 < share * tries - 1e-9:
        allowed += 1
    return chance_at_most(allowed, tries, rate) if allowed >= 0 else 0.0


def band(tries: int, low: float, high: float, chance: float = 1e-3) -> tuple[float, float]:
    """Shares that a true rate between `low` and `high` shows, but for `chance` at either end."""
    if tries == 0:
        return 0.0, 1.0
    least = next(k for k in range(tries + 1) if chance_at_most(k, tries, low) > chance)
    most = next(
        k for k in range(tries, -1, -1) if chance_at_most(tries - k, tries, 1.0 - high) > chance
    )
    return least / tries, most / tries
