"""Binomial chances, exactly: what a statistical test states about its own false failures."""

from math import ceil

from scipy.stats import binom


def chance_at_most(hits: int, tries: int, rate: float) -> float:
    """Chance of at most `hits` successes in `tries` at this rate."""
    return float(binom.cdf(hits, tries, rate))


def chance_below(share: float, tries: int, rate: float) -> float:
    """Chance that a method with this true rate shows less than `share` in `tries`."""
    return chance_at_most(ceil(share * tries - 1e-9) - 1, tries, rate)


def band(tries: int, low: float, high: float, chance: float = 1e-3) -> tuple[float, float]:
    """Shares that a true rate between `low` and `high` shows, but for `chance` at either end."""
    if tries == 0:
        return 0.0, 1.0
    least, fewest_misses = binom.ppf(chance, tries, (low, 1.0 - high))
    return float(least / tries), float(1.0 - fewest_misses / tries)
