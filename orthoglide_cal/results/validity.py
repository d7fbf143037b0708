"""Under which conditions a result holds, what a reader has to know before signing, its number."""

import hashlib
from collections.abc import Iterable, Iterator, Sequence
from datetime import UTC, datetime

from pydantic import AwareDatetime, Field

from orthoglide_cal import __version__
from orthoglide_cal.files.input import Input
from orthoglide_cal.files.machine_file import machine_values
from orthoglide_cal.files.readings import GaugeIdentity
from orthoglide_cal.model.machine import OwnGauge
from orthoglide_cal.model.measured import CAUTIONS
from orthoglide_cal.schema import Reason, Schema, Sentence

STEP_K = 2.0  # a change of temperature beyond this is said next to the verdict


class UsedGauge(GaugeIdentity):
    """A gauge of a session; what the session does not say of it, the machine file may."""

    resolution_mm: float | None = None
    overdue: bool = Field(description="that day was past when it was used")


class Validity(Schema):
    """Conditions of one measurement; null or empty where nobody recorded them."""

    measured: str | None = Field(description="when it ended, else began")
    operator: str | None
    gauges: tuple[UsedGauge, ...]
    temperature_start_c: float | None
    temperature_end_c: float | None
    reservations: tuple[Sentence, ...] = Field(description="what to know before relying on it")

    @property
    def cautions(self) -> tuple[Reason, ...]:
        """The reservations that concern the result itself, not only its papers."""
        return tuple(r for r in self.reservations if r.code != "not_recorded")


def validity(given: Input) -> Validity:
    """Conditions of one input."""
    conditions, machine = given.conditions, given.model.machine
    measured = conditions.finished or conditions.started
    owned = {gauge.id: gauge for gauge in reversed(machine.gauges)}
    gauges = []
    for gauge in conditions.gauges:
        known = dict(owned.get(gauge.id, OwnGauge(id=gauge.id)))
        if gauge.certificate and known["certificate"] not in (None, gauge.certificate):
            known = dict(OwnGauge(id=gauge.id))  # that is of another time
        known |= {name: value for name, value in gauge if value}
        due = known["due"] = known["due"] or machine.report.gauge_due
        used, last = (day and datetime.fromisoformat(day).date() for day in (measured, due))
        gauges.append(UsedGauge(**known, overdue=bool(used and last and used > last)))
    start, end = conditions.temperature_ends_c
    return Validity(
        measured=measured,
        operator=conditions.operator,
        gauges=tuple(gauges),
        temperature_start_c=start,
        temperature_end_c=end,
        reservations=tuple(_reservations(given, gauges)),
    )


def _reservations(given: Input, gauges: Sequence[UsedGauge]) -> Iterator[Reason]:
    conditions = given.conditions
    for gauge in gauges:
        if gauge.overdue:
            yield Reason.of("overdue_gauge", id=gauge.id, due=gauge.due)
    for remark in given.measured.remarks:
        if remark.code in CAUTIONS:
            yield remark
        elif remark.code == "nozzle_lowered":
            yield Reason.of("nozzle_lower", **remark.data)
    known = conditions.temperatures_c
    if known and max(known) - min(known) > STEP_K:
        yield Reason.of("temperature_changed", kelvin=max(known) - min(known))
    stated = {
        "date": conditions.finished or conditions.started,
        "operator": conditions.operator,
        "temperature": conditions.temperature_ends_c[0] is not None,
        "gauges": gauges,
    }
    missing = [name for name in given.model.machine.noted if not stated[name]]
    for gauge in gauges:
        if not gauge.certificate:
            missing.append(f"certificate of gauge {gauge.id}")
        if not gauge.due:
            missing.append(f"due date of gauge {gauge.id}")
    if missing and not given.measured.source.simulated:
        yield Reason.of("not_recorded", missing=missing)


def compare_reservations(before: Validity, after: Validity) -> Iterator[Reason]:
    """Reservations of two measurements together: of each, and of both."""
    for when, conditions, other in (("Before", before, after), ("After", after, before)):
        for reason in conditions.reservations:
            both = reason in other.reservations
            if not both or conditions is before:
                session = "Before and after" if both else when
                yield Reason.of("of_session", when=session, reason=reason)
    ids = [[gauge.id for gauge in conditions.gauges] for conditions in (before, after)]
    if all(ids) and set(ids[0]) != set(ids[1]):
        yield Reason.of("other_gauges", before=ids[0], after=ids[1])
    ends = ((one.temperature_start_c, one.temperature_end_c) for one in (before, after))
    known = [[end for end in pair if end is not None] for pair in ends]
    if all(known):
        first, second = (sum(pair) / len(pair) for pair in known)
        if abs(second - first) > STEP_K:
            yield Reason.of("temperatures_differ", before_c=first, after_c=second)


class Identity(Schema):
    """The number that makes a report unique, its date and program."""

    number: str = Field(description="the same for the same inputs and options")
    issued: AwareDatetime
    software: str


def identify(inputs: Iterable[Input], *options: object, issued: datetime | None = None) -> Identity:
    """Identity of a result: another number for whatever a report shows otherwise.

    Of each file, with the machine that it is judged by, and of all options that change the content
    (their `str` distinguishes them). It is issued now if no time is given.
    """
    software = f"orthocal {__version__}"
    parts = []
    for given in inputs:
        source, model = given.measured.source, given.model
        data = [source.excerpt.data] if source.excerpt else []
        judged = *model.ruled_out, machine_values(model)
        parts.append((source.path, source.sha256, *data, *judged))
    made_of = repr((software, parts, [str(option) for option in options]))
    digest = hashlib.sha256(made_of.encode()).hexdigest()[:12].upper()
    return Identity(
        number=f"OC-{digest[:6]}-{digest[6:]}",
        issued=issued or datetime.now(UTC),
        software=software,
    )
