"""What all pages say alike: of which data, by which method, of whose machine, for what it holds."""

from __future__ import annotations

from collections.abc import Mapping
from datetime import datetime

from orthoglide_cal.estimation import Method
from orthoglide_cal.model import DataKind, Machine, Source
from orthoglide_cal.report import document as doc
from orthoglide_cal.words import counted

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
# What the owner of a machine wrote for its reports: who and which; how and with what.
_OWNED = {
    "organisation": "Organisation",
    "place": "Place",
    "customer": "Customer",
    "serial_number": "Serial number",
}
_MEASURED = {
    "method": "Method",
    "traceability": "Traceability",
    "authorised_by": "Authorised by",
}


def scope(machine: Machine) -> str:
    """What a report holds for, and what not."""
    words = machine.vocabulary
    return (
        f"This report holds for the machine and the {words.instruments} that it names, as they were"
        f" when they were measured, and for the {words.positions} and conditions stated in it; for"
        " nothing else. It is valid only with all its pages."
    )


def data_words(source: Source | None, kind: str, count: int) -> str:
    """How much of what.

    >>> data_words(None, "six", 6), data_words(None, "session", 1)
    ('6 differences, max − min', '1 reading of a session')
    """
    if source is not None and source.excerpt is not None:
        return source.excerpt.words
    noun, of_what = _DATA[kind]
    return counted(count, noun) + of_what


def comparison_words(single: bool) -> tuple[str, str]:
    """What the differences of an expected-improvement table are, and how their names are meant."""
    if single:
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
    due = due_words(machine.report.gauge_due, measured)
    return (*_written(machine, _MEASURED), *([] if due is None else [("Gauge due", due)]))


def due_words(due: str | None, measured: str | None) -> doc.Blank:
    """When a gauge is to be calibrated again, marked where that was past on the day; or blank."""
    if due is None or measured is None or not _past(due, measured):
        return None if due is None else doc.Given(due)
    return doc.Given(due), ": ", doc.Strong("past on the day of the measurement")


def _past(due: str, measured: str) -> bool:
    try:
        return datetime.fromisoformat(measured).date() > datetime.fromisoformat(due).date()
    except ValueError:
        return False  # a time that somebody wrote in words


def _written(machine: Machine, names: Mapping[str, str]) -> tuple[tuple[str, doc.Given], ...]:
    said = ((word, getattr(machine.report, name)) for name, word in names.items())
    return tuple((word, doc.Given(text)) for word, text in said if text is not None)


def moment(written: str | None) -> doc.Given | None:
    """An ISO 8601 time with a blank for the "T", to the second, its zone set off."""
    if written is None:
        return None
    try:
        time = datetime.fromisoformat(written)
    except ValueError:
        return doc.Given(written)
    zone = f" {time:%z}" if time.tzinfo else ""
    return doc.Given(f"{time:%Y-%m-%d %H:%M:%S}{zone[:4]}{':' if zone else ''}{zone[4:6]}")
