"""The readings that a session continues, and how both stand in one file."""

from __future__ import annotations

import math
import re
from collections import Counter
from dataclasses import dataclass
from datetime import datetime
from functools import cached_property

import numpy as np

from orthoglide_cal.errors import UsageError, visible
from orthoglide_cal.files import (
    Conditions,
    ReadingRow,
    read_input,
    reading_rows,
)
from orthoglide_cal.files.yaml_tree import load_tree
from orthoglide_cal.model import AXES, Floats, Model, Readings, Series
from orthoglide_cal.model.protocols import PlannedReading
from orthoglide_cal.model.readings import GaugePlan
from orthoglide_cal.planning.steps import planned_readings
from orthoglide_cal.session.events import Following

TICK_MIN = 1e-4  # to which times are written
_ORIGIN = "goes_on_from"


@dataclass(frozen=True, eq=False)
class PriorReadings:
    """The n readings that were there before a session began; part of it in every result."""

    following: Following
    readings: Readings
    conditions: Conditions
    is_session: bool

    @property
    def path(self) -> str:
        return self.following.data.path

    @cached_property
    def rows(self) -> list[ReadingRow]:
        """The readings as rows of a session, in the order of time."""
        rows, entries = reading_rows(self.readings), list[dict[str, str]]()
        if self.is_session:
            entries = load_tree(self.following.data).value["readings"]
        for index, row in enumerate(rows):
            # Steps are counted anew in each session: those of an earlier one cannot be retaken.
            note = re.sub(r" \(r [0-9]+\)", "", row.note or "")
            at = entries[index].get("timestamp") if entries else None
            rows[index] = row.model_copy(update={"timestamp": at, "note": note})
        return [rows[index] for index in self.readings.plan.in_time.tolist()]

    @property
    def environment(self) -> dict[str, str]:
        """What was written around them, and where they are from."""
        said, data, told = dict(self.conditions.environment), self.following.data, self.conditions
        counts = f"{len(self.readings)} readings"
        for number, word in ((told.retaken, "replaced"), (told.skipped, "skipped")):
            counts += f", {number} {word}" if number else ""
        origin = f"{visible(data.path)} ({counts}), sha256 {data.sha256}"
        before = said.get(_ORIGIN)
        return {**said, _ORIGIN: f"{origin}; {before}" if before else origin}

    def minutes(self, opened_at: str, own: float) -> float | None:
        """The time of a new reading on the clock of the first ones; None where they tell none.

        The clock runs on from their end, if that is known and was on the same day; else it stands
        from the last of them to the beginning of the session.

        Args:
            opened_at: when the session began, ISO 8601.
            own: minutes since then.
        """
        if not self.readings.timed:
            return None
        last = float(self.readings.plan.hours.max()) * 60.0
        ended, now = self.conditions.finished, datetime.fromisoformat(opened_at)
        if ended is not None:
            then = datetime.fromisoformat(ended)
            then = then.astimezone(now.tzinfo) if then.tzinfo else then.replace(tzinfo=now.tzinfo)
            if then.date() == now.date():
                last += max((now - then).total_seconds() / 60.0, 0.0)
        return round(math.ceil(last / TICK_MIN) * TICK_MIN + own, 4)

    def label(self, series: Series) -> str | None:
        """What the gauge is called that read this leg and direction last; None if nobody said."""
        names = AXES[series.leg], AXES[series.direction]
        mine = [row.gauge for row in self.rows if (row.leg, row.direction) == names]
        return mine[-1] if mine else None

    def is_turned(self, leg: int) -> bool:
        """Whether the bar of a leg was turned when it was read last."""
        bars = [row.bar for row in self.rows if row.leg == AXES[leg]]
        return bool(bars and bars[-1])

    @property
    def left_entered(self) -> Floats:
        """What the controller held at the end beyond what it held at the beginning, (3,) [mm].

        A carriage that was commanded short was so for its readings alone.
        """
        plan = GaugePlan.require(self.readings.plan)
        return np.asarray(plan.stood[plan.in_time[-1]])

    @cached_property
    def repeats(self) -> Counter[PlannedReading]:
        """How often each reading was taken."""
        return Counter(planned_readings(self.readings.plan))


def first_of(following: Following, model: Model) -> PriorReadings:
    """The readings that a session continues, read from their text.

    Raises:
        InputError: it cannot be read.
        UsageError: these are no readings.
    """
    given = read_input(following.data, model)
    if not isinstance(given.measured, Readings):
        raise UsageError(
            f"{following.data.path} holds differences; new readings cannot be joined to them.",
            "Give the file of the raw readings, if you have it.",
        )
    return PriorReadings(following, given.measured, given.conditions, given.is_session)
