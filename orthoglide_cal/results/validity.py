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
from orthoglide_cal.schema import Schema
from orthoglide_cal.words import plain

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
    reservations: tuple[str, ...] = Field(description="what to know before relying on it")


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


def _reservations(given: Input, found: Validity) -> Iterator[str]:
    if found.simulated:
        yield "Simulated: no machine was measured."
    for gauge in found.gauges:
        if gauge.overdue:
            yield f"Gauge {gauge.id} is overdue: its calibration was due on {gauge.due}."
    known = given.conditions.temperatures_c
    if known and max(known) - min(known) > STEP_K:
        yield f"The temperature changed by {plain(max(known) - min(known), 1)} K while measuring."
    stated = {
        "date": found.measured,
        "operator": found.operator,
        "temperature": found.temperature_start_c is not None,
        "gauges": found.gauges,
    }
    missing = [name for name in given.model.machine.noted if not stated[name]]
    for gauge in found.gauges:
        if not gauge.certificate:
            missing.append(f"certificate of gauge {gauge.id}")
        if not gauge.due:
            missing.append(f"due date of gauge {gauge.id}")
    if missing and not found.simulated:
        yield f"Not recorded: {', '.join(missing)}."


def compared_reservations(before: Validity, after: Validity) -> tuple[str, ...]:
    """What to know of two measurements together: of each, and of both."""
    said = []
    for when, own, other in (("Before", before, after), ("After", after, before)):
        for each in own.reservations:
            both = each in other.reservations
            if not both or own is before:
                said.append(f"{'Before and after' if both else when}, {each[0].lower()}{each[1:]}")
    used = [[gauge.id for gauge in each.gauges] for each in (before, after)]
    if all(used) and set(used[0]) != set(used[1]):
        said.append(
            f"Other gauges were used: {', '.join(used[0])} before, {', '.join(used[1])} after."
        )
    ends = [
        [each for each in (one.temperature_start_c, one.temperature_end_c) if each is not None]
        for one in (before, after)
    ]
    if all(ends):
        first, second = (sum(each) / len(each) for each in ends)
        if abs(second - first) > STEP_K:
            step = f"{plain(first, 1)} °C before, {plain(second, 1)} °C after"
            said.append(f"The temperature differed: {step}.")
    return tuple(said)


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
