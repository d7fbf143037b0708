"""What all pages say alike: of which data, by which method, of whose machine, for what it holds."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from datetime import datetime

from orthoglide_cal.model.machine import Machine
from orthoglide_cal.model.measured import DataKind, Source
from orthoglide_cal.report import document as doc
from orthoglide_cal.results import Identity, Validity
from orthoglide_cal.results.answer import InputFile
from orthoglide_cal.words import counted, plain

# Kind of data, or of file → what one entry is, and of what.
_DATA: Mapping[str, tuple[str, str]] = {
    DataKind.READINGS: ("reading", ""),
    "session": ("reading", " of a session"),
    DataKind.SIX: ("difference", ", max − min"),
    DataKind.TWELVE: ("difference", " from the isotropic posture"),
    DataKind.SINGLE: ("difference", ", tool end − joint end"),
}
# What the owner of a machine wrote for its reports: who and which; how and with what.
OWNER = ("organisation", "place", "customer", "serial_number")
MEANS = ("method", "traceability", "authorised_by", "gauge_due")


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


def stated(machine: Machine, names: Sequence[str]) -> tuple[tuple[str, doc.Given], ...]:
    """What its owner wrote under these names, as far as the machine's file says so."""
    said = {name.replace("_", " ").capitalize(): getattr(machine.report, name) for name in names}
    return tuple((name, doc.Given(text)) for name, text in said.items() if text is not None)


def signed_page(
    kind: str,
    machine: Machine,
    identity: Identity,
    inputs: Sequence[tuple[InputFile, Validity]],
    *facts: tuple[str, doc.Blank],
) -> doc.Page:
    """What a numbered page begins with: what it is about, and under which conditions it holds.

    Its `inputs` are one measurement, or before and after; of simulated ones it is no report. The
    `facts` stand behind its number.
    """
    words = machine.vocabulary
    simulated = any(each.simulated for _, each in inputs)
    own = ("Number", doc.Code(identity.number)), *facts
    issued = ("Issued", f"{identity.issued:%Y-%m-%d %H:%M} UTC")
    first, *later = (dict(_conditions(*each, machine.noted)) for each in inputs)
    named = ((name.capitalize(), value) for name, value in first.items())
    strip: doc.Block = doc.Facts((*named, ("Software", identity.software)))
    if later:
        strip = doc.Grid(
            ("conditions", "before", "after"),
            [(name, value, later[0][name]) for name, value in first.items()],
            words=(0, 1, 2),
            caption=f"{identity.software}; data with the first digits of SHA-256.",
        )
    return doc.Page(
        kind="Practice report" if simulated else kind,
        title=machine.name,
        number=identity.number,
        facts=doc.Facts((*stated(machine, OWNER), *own, issued)),
        sheet=[doc.Section(None, strip)],
        scope=f"This report holds for the machine and the {words.instruments} that it names, as"
        f" they were when they were measured, and for the {words.positions} and conditions stated"
        " in it; for nothing else. It is valid only with all its pages: reproduce it only in full.",
        stamp="SIMULATED" if simulated else None,
    )


def reserved(notice: doc.Notice, reservations: Sequence[str]) -> doc.Notice:
    """The verdict with what a reader has to know before relying on it: never green then."""
    if not reservations:
        return notice
    good = notice.tone is doc.Tone.GOOD
    return doc.Notice(
        doc.Tone.WARN if good else notice.tone,
        f"{notice.title}, with a reservation" if good else notice.title,
        (*notice.lines, *map(doc.Doubtful, reservations)),
    )


def _conditions(
    of: InputFile, each: Validity, noted: Sequence[str]
) -> Iterator[tuple[str, doc.Blank]]:
    """Those of one measurement: when it was, what is `noted` at such a machine, and the data."""
    gauges: list[doc.Inline] = []
    for gauge in each.gauges:
        gauges += ["; " if gauges else "", doc.Given(gauge.id)]
        if gauge.certificate:
            gauges += [", certificate ", doc.Given(gauge.certificate)]
        due = f"due {gauge.due}" if gauge.due else "due date not given"
        gauges += [", ", doc.Doubtful(f"overdue: {due}") if gauge.overdue else due]
    known = {"start": each.temperature_start_c, "end": each.temperature_end_c}
    said = [f"{plain(c, 1)} °C at the {when}" for when, c in known.items() if c is not None]
    rows: dict[str, doc.Blank] = {
        "gauges": tuple(gauges) or None,
        "temperature": ", ".join(said) or None,
        "operator": each.operator and doc.Given(each.operator),
    }
    yield "measured", moment(each.measured)
    yield from ((name, row) for name, row in rows.items() if name in noted)
    yield "data", (f"{of.readings} {_DATA[of.kind][0]}s, ", doc.Code(of.sha256[:12]))


def moment(written: str | None) -> doc.Given | None:
    """An ISO 8601 time with a blank for the "T", to the second, its zone set off."""
    if written is None:
        return None
    try:
        time = datetime.fromisoformat(written)
    except ValueError:
        return doc.Given(written)
    zone = f" {str(time)[-6:]}" if time.tzinfo else ""
    return doc.Given(f"{time:%Y-%m-%d %H:%M:%S}{zone}")
