"""Numbers as people read them. A "-" stays ASCII, so that a value can be copied and typed."""

from __future__ import annotations

from orthoglide_cal.outcome.rounding import decimals_for


def plain(value: float, decimals: int) -> str:
    """Fixed decimals, never "-0.00".

    >>> plain(-0.001, 2), plain(0.256, 2)
    ('0.00', '0.26')
    """
    written = f"{value:.{decimals}f}"
    return written.lstrip("-") if not float(written) else written


def signed(value: float, decimals: int) -> str:
    """Fixed decimals with "+" or "-"; zero has no sign."""
    written = plain(value, decimals)
    return written if written.startswith("-") or not float(written) else f"+{written}"


def two_figures(value: float) -> str:
    """Two significant figures, at most four decimals.

    >>> two_figures(0.02144), two_figures(1.96), two_figures(0.0)
    ('0.021', '2.0', '0')
    """
    return plain(value, decimals_for(value)) if value else "0"


def with_uncertainty(value: float, expanded: float) -> str:
    """ "-0.530 ± 0.021": the value ends at the digit of its uncertainty."""
    decimals = decimals_for(expanded)
    return f"{signed(value, decimals)} ± {plain(expanded, decimals)}"


def chance(probability: float) -> str:
    """A p-value: "p = 0.43" or "p < 0.001"."""
    return f"p = {probability:.2g}" if probability >= 0.001 else "p < 0.001"


def percent(share: float) -> str:
    """A share of one as "97 %"; "> 99 %" instead of a false 100."""
    if 0.99 < share < 1.0 - 1e-9:
        return "> 99 %"
    return f"{100.0 * share:.0f} %" if share >= 0.01 or share == 0.0 else "< 1 %"


def counted(number: int, noun: str) -> str:
    """ "1 reading", "60 readings"."""
    return f"{number} {noun}" + ("" if number == 1 else "s")
