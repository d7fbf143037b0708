"""Sensible digits: an uncertainty has two significant figures, its value ends at the same digit."""

from __future__ import annotations

import math

SIGNIFICANT = 2
# No gauge here tells more than tenths of a micrometre, and no controller takes more.
MOST_DECIMALS = 4


def decimals_for(uncertainty: float) -> int:
    """Decimals at which a value with this uncertainty ends, 0 … `MOST_DECIMALS`.

    >>> decimals_for(0.0214), decimals_for(0.21), decimals_for(0.0996), decimals_for(3.2)
    (3, 2, 2, 1)
    """
    if not 0.0 < uncertainty < math.inf:
        return MOST_DECIMALS
    # Rounding first: 0.0996 becomes 0.10, which needs one decimal less than 0.099.
    exponent = int(f"{uncertainty:.{SIGNIFICANT - 1}e}".partition("e")[2])
    return min(max(SIGNIFICANT - 1 - exponent, 0), MOST_DECIMALS)


def rounded(value: float, decimals: int) -> float:
    """The value rounded, without a negative zero."""
    return round(value, decimals) + 0.0
