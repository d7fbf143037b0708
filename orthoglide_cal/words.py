"""Words, numbers and units as people read them: each stands here once, for everyone.

An uncertainty has two significant figures, and its value ends at the same digit. What is only read
has a true minus (`signed`); what may be typed or pasted has an ASCII "-" (`plain`).
"""

import math
import textwrap
from collections.abc import Iterable, Mapping, Sequence
from datetime import datetime
from enum import StrEnum

# The first line of all that is made of simulated readings.
SIMULATED = "SIMULATED: no machine was measured."
MOST_DECIMALS = 4  # neither gauges here nor controllers have more than tenths of a micrometre
ENTERED_DECIMALS = 3  # at least: a controller takes micrometres, however large U is


# --- units ------------------------------------------------------------------------------------


class Unit(StrEnum):
    """Unit of a length that somebody reads from a gauge."""

    MM = "mm"
    INCH = "in"


# One of each unit of length, under every name that it is written with, in mm.
MM: Mapping[str, float] = {
    "mm": 1.0,
    **dict.fromkeys(("in", "inch"), 25.4),
    **dict.fromkeys(("um", "µm", "μm", "micron", "microns", "micrometre", "micrometer"), 1e-3),
    **dict.fromkeys(("mil", "mils", "thou"), 0.0254),
    "cm": 10.0,
    "m": 1e3,
    "nm": 1e-6,
}
MM_PER_INCH = MM["in"]


def unit_words(unit: str) -> str:
    """The unit as a technician knows it."""
    return "mm/m" if unit == "1e-3" else unit


# --- numbers ----------------------------------------------------------------------------------


def decimals_for(uncertainty: float) -> int:
    """Decimals of two figures of an uncertainty, and of its value: 0 … `MOST_DECIMALS`.

    >>> decimals_for(0.0214), decimals_for(0.21), decimals_for(0.0996), decimals_for(3.2)
    (3, 2, 2, 1)
    """
    if not 0.0 < uncertainty < math.inf:
        return MOST_DECIMALS
    # Rounding first: 0.0996 becomes 0.10, which needs one decimal less than 0.099.
    exponent = int(f"{uncertainty:.1e}".partition("e")[2])
    return min(max(1 - exponent, 0), MOST_DECIMALS)


def entered_decimals(expanded: Iterable[float], active: Iterable[float]) -> int:
    """Decimals of joint offsets that are to be entered, by the smallest U (`expanded`).

    The digits of those in the controller so far (`active`, at most six) are kept.
    """
    written = (len(f"{value:.6f}".rstrip("0").partition(".")[2]) for value in active)
    return max(decimals_for(min(expanded)), ENTERED_DECIMALS, *written)


def difference_decimals(averaged: bool, resolution_mm: float = 0.01) -> int:
    """Decimals of a difference of readings: the gauge's, and one more if it averages several."""
    return max(2, math.ceil(-math.log10(resolution_mm) - 1e-9)) + averaged


def plain(value: float, decimals: int) -> str:
    """Fixed decimals, never "-0.00"."""
    return f"{value:z.{decimals}f}"


def short(value: float, decimals: int) -> str:
    """At most these decimals, without zeros at the end: "60", "-12.5"."""
    written = plain(value, decimals)
    return written.rstrip("0").rstrip(".") if "." in written else written


def signed(value: float, decimals: int) -> str:
    """Fixed decimals with "+" or "−": "−0.30"; zero has no sign."""
    return typed(value, decimals).replace("-", "−")


def typed(value: float, decimals: int) -> str:
    """The same to be typed or pasted, with an ASCII "-"."""
    written = plain(value, decimals)
    return written if written.startswith("-") or not float(written) else f"+{written}"


def number(value: float) -> str:
    """Number with as few digits as it has: the number of an axis, or one that somebody stated."""
    return f"{value:g}".replace("-", "−")


def two_figures(value: float) -> str:
    """Two significant figures, at most four decimals: "0.021", "2.0", "0"."""
    return plain(value, decimals_for(value)) if value else "0"


def value_text(value_mm: float, unit: Unit, sign: str = "+") -> str:
    """A reading in a unit: "+0.127 mm", "+0.0050 in (+0.127 mm)"; without `sign` a size."""
    metric = f"{typed(value_mm, 3) if sign else plain(value_mm, 3)} mm"
    if unit is Unit.MM:
        return metric
    inches = f"{value_mm / MM_PER_INCH:{sign}.5f}"  # no dial divides an inch more finely
    return f"{inches.removesuffix('0')} in ({metric})"


def in_unit(value_mm: float, unit: Unit, form: str = "g") -> str:
    """Another length in a unit: "10 mm", "0.393701 in (10 mm)"."""
    metric = f"{value_mm:{form}} mm"
    return metric if unit is Unit.MM else f"{value_mm / MM_PER_INCH:{form}} in ({metric})"


def with_uncertainty(value: float, uncertainty: float) -> str:
    """ "−0.530 ± 0.021": the value ends at the digit of its uncertainty."""
    decimals = decimals_for(uncertainty)
    return f"{signed(value, decimals)} ± {plain(uncertainty, decimals)}"


def chance(probability: float) -> str:
    """A p-value: "p = 0.43", "p < 0.001" or "p > 0.99"."""
    if probability > 0.99:
        return "p > 0.99"
    return f"p = {probability:.2g}" if probability >= 0.001 else "p < 0.001"


def percent(share: float, decimals: int = 0) -> str:
    """A share of one as "97 %"; "> 99 %" instead of a false 100.

    >>> percent(0.217, 1), percent(0.9999, 1), percent(0.004)
    ('21.7 %', '> 99.9 %', '< 1 %')
    """
    step = 10.0 ** -(2 + decimals)
    if 1.0 - step < share < 1.0 - 1e-9:
        return f"> {100.0 * (1.0 - step):.{decimals}f} %"
    if 0.0 < share < step:
        return f"< {100.0 * step:.{decimals}f} %"
    return f"{100.0 * share:.{decimals}f} %"


def moment_words(time: datetime) -> str:
    """Date, time to the minute, and the zone if it is known: "2026-03-02 08:15 +01:00"."""
    zone = "" if time.tzinfo is None else f" {str(time)[-6:]}".replace("+00:00", "UTC")
    return f"{time:%Y-%m-%d %H:%M}{zone}"


# --- words ------------------------------------------------------------------------------------


def counted(number: int, noun: str) -> str:
    """ "1 reading", "60 readings"."""
    return f"{number} {noun}" + ("" if number == 1 else "s")


def capitalized(text: str) -> str:
    """The text as a sentence begins."""
    return text[:1].upper() + text[1:]


def uncapitalized(text: str) -> str:
    """The text as it goes on behind a comma or colon."""
    return text[:1].lower() + text[1:]


def shortened(text: str) -> str:
    """A text from outside for a message: no more than fits beside its place and the remedy."""
    return text if len(text) <= 60 else f"{text[:59]}…"


def listed(names: Sequence[str]) -> str:
    """Names for a message, with commas; the first ten where there are more."""
    more = f" and {len(names) - 10} more" if len(names) > 10 else ""
    return ", ".join(map(shortened, names[:10])) + more


def together(ids: Sequence[str], none: str = "a sound machine") -> str:
    """Causes that act together, "axis_gap with backlash and misread"; without any, `none`."""
    return " with ".join(filter(None, (*ids[:1], " and ".join(ids[1:])))) or none


def wrapped(text: str, columns: int) -> str:
    """Text whose lines end where a screen does, and go on indented as they began.

    A command at the end of a line stays whole, on a line of its own.
    """
    lines = list[str]()
    for line in text.split("\n"):
        if len(line) < columns:
            lines.append(line)
            continue
        words, colon, typed = line.partition(": orthocal ")
        indent = " " * min(len(line) - len(line.lstrip()), columns // 2)
        lines += textwrap.wrap(
            words + colon[:1], columns - 1, subsequent_indent=indent,
            break_long_words=False, break_on_hyphens=False,
        )  # fmt: skip
        lines += [f"  orthocal {typed}"] if typed else []
    return "\n".join(lines)
