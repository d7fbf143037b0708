"""The session file's schema: what `measure` writes and every command reads."""

from __future__ import annotations

from typing import Annotated, Any

from pydantic import AfterValidator, ConfigDict, field_validator, model_validator

from orthoglide_cal.axes import AXES
from orthoglide_cal.data.machine_schema import MachineModel
from orthoglide_cal.data.numbers import MM_PER_INCH
from orthoglide_cal.data.schema import (
    Count,
    Moment,
    NotNegative,
    Number,
    Positive,
    Strict,
    Text,
    Version,
    Word,
    as_number,
    fault,
)


def _axis(value: str) -> str:
    if value.lower() not in AXES:
        raise fault("This is not an axis.", "Write x, y or z.")
    return value.lower()


def _end(value: str) -> str:
    if value.lower() not in ("joint", "tool"):
        raise fault("This is not an end of the leg.", "Write joint or tool.")
    return value.lower()


Axis = Annotated[Text, AfterValidator(_axis)]
End = Annotated[Text, AfterValidator(_end)]


class Lenient(Strict):
    """A group of keys; unknown ones are left out (the reader reports them)."""

    model_config = ConfigDict(extra="ignore", frozen=True)


class SessionGauge(Lenient):
    """A gauge as it stands in the report; unknown particulars stay None.

    Attributes:
        id: label that the readings' `gauge` refers to.
        certificate: of its calibration.
        resolution: [mm]; `resolution_mm` is read as well.
    """

    id: Word
    certificate: Text | None = None
    resolution: Positive | None = None

    @model_validator(mode="before")
    @classmethod
    def _with_unit(cls, value: Any) -> Any:
        if isinstance(value, dict) and "resolution" not in value and "resolution_mm" in value:
            return {**value, "resolution": value["resolution_mm"]}
        return value


class Step(Lenient):
    """Where a gauge stands: the part that readings and skipped steps share."""

    leg: Axis
    posture: Word
    direction: Axis
    end: End | None = None
    cycle: Count | None = None


class SkippedStep(Step):
    """A step that the operator left out, and why."""

    reason: Text = ""


class SessionReading(Step):
    """One reading, with the columns of the readings CSV and the time of day.

    Attributes:
        reading_mm: as the gauge showed it [mm]; `reading_in` is converted.
        seq: order in time.
        minutes: since the session began.
        temperature_c: [°C].
        gauge: id of a gauge, "" if not given.
        gauge_at: fraction of the leg from the carriage joint at the isotropic posture.
        note: remark.
        timestamp: ISO 8601.
    """

    reading_mm: Number
    seq: int | None = None
    minutes: NotNegative | None = None
    temperature_c: Number | None = None
    gauge: Text = ""
    gauge_at: Number | None = None
    note: Text = ""
    timestamp: Moment | None = None

    @model_validator(mode="before")
    @classmethod
    def _in_millimetres(cls, value: Any) -> Any:
        if isinstance(value, dict) and "reading_mm" not in value and "reading_in" in value:
            return {**value, "reading_mm": as_number(value["reading_in"]) * MM_PER_INCH}
        return value

    @field_validator("gauge", "note", mode="before")
    @classmethod
    def _null_is_empty(cls, value: Any) -> Any:
        return "" if value is None else value


class RetakenReading(SessionReading):
    """A reading that was replaced, and why."""

    reason: Text = ""


class SessionRecord(Lenient):
    """A session file.

    Attributes:
        machine: copy of the machine file in force.
        protocol: "double-posture", "single-posture", or a name of one's own.
        operator: None if not given.
        gauges: used in the session.
        started, finished: ISO 8601; `finished` is None for an interrupted session.
        environment: name → text, e.g. temperature_c.
        readings: those that count, in any order.
        retaken: those that were replaced.
        skipped: steps left out.
    """

    schema_version: Version = 1
    machine: MachineModel
    protocol: Text = ""
    operator: Text | None = None
    gauges: tuple[SessionGauge, ...] = ()
    started: Moment | None = None
    finished: Moment | None = None
    environment: dict[Word, Text | None] | None = None
    readings: tuple[SessionReading, ...]
    retaken: tuple[RetakenReading, ...] = ()
    skipped: tuple[SkippedStep, ...] = ()

    @field_validator("environment", mode="before")
    @classmethod
    def _text_is_a_note(cls, value: Any) -> Any:
        return {"note": value} if isinstance(value, str) else value

    @field_validator("gauges", "readings", "retaken", "skipped", mode="before")
    @classmethod
    def _null_is_none_given(cls, value: Any) -> Any:
        return () if value is None else value

    @field_validator("protocol", mode="before")
    @classmethod
    def _null_is_empty(cls, value: Any) -> Any:
        return "" if value is None else value
