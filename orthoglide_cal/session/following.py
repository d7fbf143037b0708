"""The readings that a session continues, and how both stand in one file."""

from __future__ import annotations

import math
import re
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from datetime import datetime
from functools import cached_property

import numpy as np

from orthoglide_cal.diagnosis import diagnose
from orthoglide_cal.errors import UsageError, visible
from orthoglide_cal.files import (
    Conditions,
    ReadingRow,
    differing,
    input_from_document,
    read_document,
    reading_rows,
)
from orthoglide_cal.files.yaml_tree import load_tree
from orthoglide_cal.model import AXES, Floats, Model, Readings, Series
from orthoglide_cal.model.protocols import PlannedReading
from orthoglide_cal.model.readings import GaugePlan
from orthoglide_cal.planning import Option, ranked
from orthoglide_cal.planning.steps import NOTHING_ENTERED, planned_readings
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
        rows = reading_rows(self.readings)
        if self.is_session:
            entries = load_tree(self.following.data).value["readings"]
            rows = [
                row.model_copy(update={"timestamp": entry.get("timestamp")})
                for row, entry in zip(rows, entries, strict=True)
            ]
        # Steps are counted anew in each session: those of an earlier one cannot be retaken.
        notes = (re.sub(r" \(r [0-9]+\)", "", row.note or "") for row in rows)
        rows = [r.model_copy(update={"note": n}) for r, n in zip(rows, notes, strict=True)]
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

    @cached_property
    def repeats(self) -> Counter[PlannedReading]:
        """How often each reading was taken."""
        return Counter(planned_readings(self.readings.plan))


@dataclass(frozen=True, eq=False)
class Recommendation:
    """What is measured next, given earlier readings, and on which machine."""

    first: PriorReadings
    model: Model
    options: tuple[Option, ...]  # best first
    choice: int | None  # which of them the operator wants, from 1
    option: Option  # that is carried out

    @property
    def change(self) -> str | None:
        """What was entered since the first readings were taken, in a sentence; None for nothing."""
        change = np.subtract(self.first.following.entered, _left_entered(self.first.readings))
        if not change.round(6).any():
            return None
        axes = zip("XYZ", change.tolist(), strict=True)
        said = "  ".join(f"{axis} {value:+.4g}" for axis, value in axes)
        return (
            f"Since {visible(self.first.path)} was measured, the offsets in the controller were"
            f" changed by {said} mm: the new readings are written with that difference."
        )

    def holding(self, offsets_mm: Sequence[float]) -> Recommendation:
        """What can be carried out with these offsets in the controller [mm].

        Raises:
            UsageError: the measurement that was chosen cannot.
        """
        x, y, z = np.subtract(offsets_mm, self.model.orthoglide.offsets_mm).round(9).tolist()
        change = np.subtract((x, y, z), _left_entered(self.first.readings))
        # To act they were homed for, and that has pushed stands that were still there.
        moved = bool(change.round(6).any())
        number = self.choice or next(
            k for k, option in enumerate(self.options, 1) if not (moved and option.continues)
        )
        option = self.options[number - 1]
        if moved and option.continues:
            raise UsageError(
                "The offsets in the controller were changed since the last reading: that"
                " measurement needs the machine and the stands as they were.",
                "Leave out --choice for one with the stands set up again.",
            )
        following = Following(
            data=self.first.following.data, what=option.what, minutes=option.minutes,
            continues=option.continues, entered=(x, y, z),
        )  # fmt: skip
        plan = GaugePlan.require(option.plan)
        plan = replace(plan, entered=(plan.entered + change).round(9))
        return replace(
            self,
            first=replace(self.first, following=following),
            option=replace(option, plan=plan),
        )

    @property
    def seed(self) -> int | None:
        """Of the simulated gauge that gave the first readings; None for real ones."""
        said = dict(self.first.conditions.environment)
        seed = said.get("seed", "")
        simulated = said.get("readings_from") == "simulated" and re.fullmatch("[0-9]{1,18}", seed)
        return int(seed) if simulated else None


def recommended(
    path: str,
    given: Model | None,
    otherwise: Callable[[], Model],
    keeper: Model | None,
    choice: int | None,
    stands: int,
) -> Recommendation:
    """What to measure next, given the readings in a file.

    Args:
        path: of a table or a session.
        given: the machine that the operator names; None for that of the session.
        otherwise: gives the machine for a table where the operator names none.
        keeper: the machine whose file keeps what is entered in the controller; None if none does.
        choice: which recommendation, from 1; None for the first that can be carried out.
        stands: gauges that are read side by side.

    Raises:
        UsageError: these are no readings that others can be joined to; another machine is named;
            there is no such choice.
        InputError: the file cannot be used.
        UnusableResultError: the readings cannot be diagnosed.
    """
    if path == "-":
        raise UsageError("--then needs a file; standard input is the keyboard.", "Name the file.")
    data = read_document(path)
    own = input_from_document(data, None, otherwise)
    names = differing(own.model, given) if given and own.is_session else []
    if names:
        raise UsageError(
            f"{path} was measured on another machine than that of --machine: they differ in"
            f" {', '.join(names)}.",
            "Leave out --machine to use the machine of the session.",
        )
    model = input_from_document(data, given, otherwise).model if given else own.model
    first = first_of(
        Following(data=data, what="", minutes=0.0, continues=False, entered=NOTHING_ENTERED), model
    )
    if not first.readings.plan.fixed:
        raise UsageError(
            f"{path} was measured with the single-posture protocol. What comes next is read with"
            " gauges that stay where they stand; readings of both kinds cannot be joined.",
            "Measure a separate session: orthocal measure",
        )
    options = tuple(each.option for each in ranked(diagnose(first.readings, model)))
    if choice is not None and choice > len(options):
        raise UsageError(
            f"There is no recommendation {choice} for {path}: there are {len(options)}.",
            "Leave out --choice for the best one.",
        )
    offsets = model.orthoglide.offsets_mm + _left_entered(first.readings)
    if keeper is not None and not differing(keeper, model):
        offsets = np.array(keeper.orthoglide.offsets_mm)
    found = Recommendation(first, model, options, choice, options[0]).holding(offsets.tolist())
    if (
        found.option.continues
        and stands == 1
        and len(set(GaugePlan.require(found.option.plan).series)) > 1
    ):
        raise UsageError(
            "That measurement needs the two gauges where they are.",
            "Read with two, or take another one: --choice 2",
        )
    return found


def _left_entered(readings: Readings) -> Floats:
    """What the controller held at the end beyond what it held at the beginning, (3,) [mm].

    A carriage that was commanded short was so for its readings alone.
    """
    plan = GaugePlan.require(readings.plan)
    return np.asarray(plan.stood[plan.in_time[-1]])


def first_of(following: Following, model: Model) -> PriorReadings:
    """The readings that a session continues, read from their text.

    Raises:
        InputError: it cannot be read.
        UsageError: these are no readings.
    """
    given = input_from_document(following.data, model)
    if not isinstance(given.measured, Readings):
        raise UsageError(
            f"{following.data.path} holds differences; new readings cannot be joined to them.",
            "Give the file of the raw readings, if you have it.",
        )
    return PriorReadings(following, given.measured, given.conditions, given.is_session)
