"""Under which conditions a result holds, what a reader has to know before signing, its number."""

import hashlib
from collections.abc import Iterable, Iterator
from datetime import UTC, datetime

from pydantic import AwareDatetime, Field

from orthoglide_cal import __version__
from orthoglide_cal.files.input import Input
from orthoglide_cal.files.machine_file import machine_values
from orthoglide_cal.model.measured import Source
from orthoglide_cal.model.model import Model
from orthoglide_cal.schema import Reason, Schema, Sentence

STEP_K = 2.0  # a change of temperature beyond this is said next to the verdict
_MADE_UP = "simulated"


class UsedGauge(Schema):
    """A gauge of a session; what the session does not say of it, the machine file may."""

    id: str
    certificate: str | None = None
    due: str | None = Field(None, description="day on which it is to be calibrated again")
    overdue: bool = Field(description="that day was past when it was used")
    resolution_mm: float | None = None


class Validity(Schema):
    """Conditions of one measurement; null or empty where nobody recorded them."""

    measured: str | None = Field(description="when it ended, else began")
    operator: str | None
    gauges: tuple[UsedGauge, ...]
    temperature_start_c: float | None
    temperature_end_c: float | None
    simulated: bool
    reservations: tuple[Sentence, ...] = Field(description="what to know before relying on it")

    @property
    def cautions(self) -> tuple[Reason, ...]:
        """The reservations that concern the result itself, not only its papers."""
        return tuple(each for each in self.reservations if each.code != "not_recorded")


def validity(given: Input) -> Validity:
    """Of one input."""
    conditions, machine = given.conditions, given.model.machine
    measured = conditions.finished or conditions.started
    gauges = []
    for gauge in conditions.gauges:
        own = next((each for each in machine.gauges if each.id == gauge.id), None)
        due = gauge.due or (own.due if own else None) or machine.report.gauge_due
        certificate = gauge.certificate or (own.certificate if own else None)
        used, last = (each and datetime.fromisoformat(each).date() for each in (measured, due))
        gauges.append(
            UsedGauge(
                id=gauge.id, certificate=certificate, due=due,
                overdue=bool(used and last and used > last), resolution_mm=gauge.resolution_mm,
            )
        )  # fmt: skip
    said = dict(conditions.environment)
    sources = (said.get(name) or "" for name in ("readings_from", "source"))
    found = Validity(
        measured=measured,
        operator=conditions.operator,
        gauges=tuple(gauges),
        temperature_start_c=conditions.temperature_start_c,
        temperature_end_c=conditions.temperature_end_c,
        simulated=any(each.startswith(_MADE_UP) for each in sources),
        reservations=(),
    )
    return found.changed(reservations=tuple(_reservations(given, found)))


def _reservations(given: Input, conditions: Validity) -> Iterator[Reason]:
    if conditions.simulated:
        yield Reason.of("simulated")
    for gauge in conditions.gauges:
        if gauge.overdue:
            yield Reason.of("overdue_gauge", id=gauge.id, due=gauge.due)
    excerpt = given.measured.source.excerpt
    if excerpt and excerpt.stale:
        yield Reason.of("stale_mesh", text=excerpt.stale)
    known = given.conditions.temperatures_c
    if known and max(known) - min(known) > STEP_K:
        yield Reason.of("temperature_changed", kelvin=max(known) - min(known))
    stated = {
        "date": conditions.measured,
        "operator": conditions.operator,
        "temperature": conditions.temperature_start_c is not None,
        "gauges": conditions.gauges,
    }
    missing = [name for name in given.model.machine.noted if not stated[name]]
    for gauge in conditions.gauges:
        if not gauge.certificate:
            missing.append(f"certificate of gauge {gauge.id}")
        if not gauge.due:
            missing.append(f"due date of gauge {gauge.id}")
    if missing and not conditions.simulated:
        yield Reason.of("not_recorded", missing=missing)


def compare_reservations(before: Validity, after: Validity) -> Iterator[Reason]:
    """What to know of two measurements together: of each, and of both."""
    for when, conditions, other in (("Before", before, after), ("After", after, before)):
        for reason in conditions.reservations:
            both = reason in other.reservations
            if not both or conditions is before:
                session = "Before and after" if both else when
                yield Reason.of("of_session", when=session, reason=reason)
    ids = [[gauge.id for gauge in each.gauges] for each in (before, after)]
    if all(ids) and set(ids[0]) != set(ids[1]):
        yield Reason.of("other_gauges", before=ids[0], after=ids[1])
    ends = [
        [each for each in (one.temperature_start_c, one.temperature_end_c) if each is not None]
        for one in (before, after)
    ]
    if all(ends):
        first, second = (sum(each) / len(each) for each in ends)
        if abs(second - first) > STEP_K:
            yield Reason.of("temperatures_differ", before_c=first, after_c=second)


class Identity(Schema):
    """What makes a report unique."""

    number: str = Field(description="the same for the same inputs and options")
    issued: AwareDatetime
    software: str


def identify(
    inputs: Iterable[tuple[Source, Model]], *options: object, issued: datetime | None = None
) -> Identity:
    """Who this result is.

    What was entered in the controller later changes no result: it is not part of the number.

    Args:
        inputs: each file, with the machine that it is judged by.
        options: whatever else changes the result; their `str` distinguishes them.
        issued: time of issue; now if None.
    """
    software = f"orthocal {__version__}"
    parts = [
        (
            source.sha256,
            *([source.excerpt.data] if source.excerpt else []),
            *model.ruled_out,
            {name: said for name, said in machine_values(model).items() if name != "history"},
        )
        for source, model in inputs
    ]
    made_of = repr((software, parts, [str(option) for option in options]))
    digest = hashlib.sha256(made_of.encode()).hexdigest()[:12].upper()
    return Identity(
        number=f"OC-{digest[:6]}-{digest[6:]}",
        issued=issued or datetime.now(UTC),
        software=software,
    )
