"""Words and numbers as people read them: each stands here once, for every document.

An uncertainty has two significant figures, and its value ends at the same digit. A "-" stays ASCII,
so that a value can be copied and typed.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from datetime import datetime

from orthoglide_cal.estimation import Method
from orthoglide_cal.estimation.accuracy import decimals_for
from orthoglide_cal.model import DataKind, Difference, Machine, Source
from orthoglide_cal.report import document as doc

# Kind of data, or of file → what one entry is, and of what.
_DATA: Mapping[str, tuple[str, str]] = {
    DataKind.READINGS: ("reading", ""),
    "session": ("reading", " of a session"),
    DataKind.SIX: ("difference", ", max − min"),
    DataKind.TWELVE: ("difference", " from the isotropic posture"),
    DataKind.SINGLE: ("difference", ", tool end − joint end"),
}
METHOD_WORDS: Mapping[Method, str] = {
    Method.READINGS: "all readings at once",
    Method.SIX: "eq. 25, six equations",
    Method.TWELVE: "eq. 25, twelve equations",
    Method.SIX_LINEAR: "eq. 17",
    Method.TWELVE_LINEAR: "eq. 16",
    Method.SINGLE: "eq. 10",
    Method.SINGLE_SEQUENTIAL: "eq. 11",
}
SCOPE = (
    "This report holds for the machine and the gauges that it names, as they were when they were"
    " measured, and for the postures and conditions stated in it; for nothing else. It is complete"
    " only up to its last line."
)
# What the owner of a machine wrote for its reports: who and which; how and with what.
_OWNED = {
    "organisation": "Organisation",
    "place": "Place",
    "customer": "Customer",
    "serial_number": "Serial number",
}
_MEASURED = {"method": "Method", "gauge_due": "Gauge due"}
# A technician reads "1e-3" better as millimetres per metre.
_UNITS = {"1e-3": "mm/m"}


def data_words(source: Source | None, kind: str, count: int) -> str:
    """How much of what.

    >>> data_words(None, "six", 6), data_words(None, "session", 1)
    ('6 differences, max − min', '1 reading of a session')
    """
    if source is not None and source.excerpt is not None:
        return source.excerpt.words
    noun, of_what = _DATA[kind]
    return counted(count, noun) + of_what


def comparison_words(differences: Sequence[Difference]) -> tuple[str, str]:
    """What the differences of an expected-improvement table are, and how their names are meant."""
    if differences[0].posture:
        return "tool end − joint end", "dz_x+ is along z on leg x at max."
    return "max − min", "dx_y is along x on leg y."


def owner_facts(machine: Machine) -> tuple[tuple[str, doc.Given], ...]:
    """Whose machine it is, as far as its file says so."""
    return _written(machine, _OWNED)


def method_facts(machine: Machine, measured: str | None = None) -> tuple[tuple[str, doc.Line], ...]:
    """How and with what it is measured, as far as its file says so.

    Args:
        machine: its `report` says it.
        measured: when, ISO 8601: a gauge that was due before is marked.
    """
    facts, due = _written(machine, _MEASURED), machine.report.gauge_due
    if due is None or measured is None or not _past(due, measured):
        return facts
    late = doc.Strong("past on the day of the measurement")
    return (*facts[:-1], (_MEASURED["gauge_due"], (doc.Given(due), ": ", late)))


def _past(due: str, measured: str) -> bool:
    try:
        return datetime.fromisoformat(measured).date() > datetime.fromisoformat(due).date()
    except ValueError:
        return False  # a time that somebody wrote in words


def _written(machine: Machine, names: Mapping[str, str]) -> tuple[tuple[str, doc.Given], ...]:
    said = ((word, getattr(machine.report, name)) for name, word in names.items())
    return tuple((word, doc.Given(text)) for word, text in said if text is not None)


def end_words(end: str | None) -> str:
    """End of the leg that was touched; nothing where the gauge stands still."""
    return f", {end} end" if end else ""


def unit_words(unit: str) -> str:
    """The unit as a technician knows it."""
    return _UNITS.get(unit, unit)


def coverage_words(k: float) -> str:
    """The factor from the standard uncertainty to the expanded one: "k = 1.96"."""
    return f"k = {k:.2f}"


def difference_decimals(averaged: bool, resolution_mm: float = 0.01) -> int:
    """Decimals of a difference of readings: the gauge's, and one more if it averages several."""
    return max(2, math.ceil(-math.log10(resolution_mm) - 1e-9)) + averaged


def plain(value: float, decimals: int) -> str:
    """Fixed decimals, never "-0.00".

    >>> plain(-0.001, 2), plain(0.256, 2)
    ('0.00', '0.26')
    """
    written = f"{value:.{decimals}f}"
    return written.lstrip("-") if not float(written) else written


def short(value: float, decimals: int) -> str:
    """At most these decimals, without zeros at the end.

    >>> short(60.0, 3), short(-12.5, 3)
    ('60', '-12.5')
    """
    written = plain(value, decimals)
    return written.rstrip("0").rstrip(".") if "." in written else written


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


def with_uncertainty(value: float, uncertainty: float) -> str:
    """ "-0.530 ± 0.021": the value ends at the digit of its uncertainty."""
    decimals = decimals_for(uncertainty)
    return f"{signed(value, decimals)} ± {plain(uncertainty, decimals)}"


def chance(probability: float) -> str:
    """A p-value: "p = 0.43" or "p < 0.001"."""
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


def counted(number: int, noun: str) -> str:
    """ "1 reading", "60 readings"."""
    return f"{number} {noun}" + ("" if number == 1 else "s")
