"""The readings of a session and those that it continues: as arrays, and as its file holds them.

With live checks: a reading that is less probable than one beyond LIMIT standard errors, by those
before it and the model, is questioned; the question names the blunder that explains it best.
"""

import math
import re
from collections import Counter
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass, replace
from datetime import datetime
from functools import cached_property, lru_cache
from statistics import NormalDist, median
from typing import NamedTuple

import numpy as np

from orthoglide_cal.causes import CAUSES
from orthoglide_cal.errors import OrthocalError, UsageError, visible
from orthoglide_cal.estimation.budget import plausible_causes, warmth
from orthoglide_cal.estimation.gaussian import Mixture
from orthoglide_cal.estimation.solution import Solution
from orthoglide_cal.files.input import Input, read_input
from orthoglide_cal.files.readings import (
    QUESTIONED,
    Conditions,
    GaugeIdentity,
    ReadingRow,
    Session,
    readings_of,
    row_at,
    session_of_readings,
)
from orthoglide_cal.files.text import FileText
from orthoglide_cal.inference.alone import solve
from orthoglide_cal.losses import MISSED_FAULT, NEEDLESS_HOLD, SESSIONS_A_QUESTION
from orthoglide_cal.model.gauge import off_scale, too_steady
from orthoglide_cal.model.machine import Machine
from orthoglide_cal.model.measured import Readings, Source
from orthoglide_cal.model.model import Model, differentiate, simulate
from orthoglide_cal.model.orthoglide import PlannedReading, double_posture, planned_readings
from orthoglide_cal.model.plan import Bools, Floats, Ints
from orthoglide_cal.model.readings import AXES, GaugePlan, Posture
from orthoglide_cal.planning.steps import NOTHING_ENTERED, SessionStep
from orthoglide_cal.session.events import Arrived, Doubt, Following, Questioned, State
from orthoglide_cal.words import MM_PER_INCH, Unit, in_unit, value_text, with_uncertainty

TICK_DECIMALS = 4  # of minutes, as they stand in the session file
_ORIGIN = "goes_on_from"
_ENOUGH = 9  # pairs of repeats whose scatter may replace the gauge's stated repeatability


def count_words(readings: int, replaced: int, skipped: int) -> str:
    """Number of readings, and of those that do not count or were not taken, if there are any."""
    others = ((replaced, "replaced"), (skipped, "skipped"))
    return ", ".join([f"{readings} readings", *(f"{n} {word}" for n, word in others if n)])


class PriorReadings:
    """The n readings that a session continues, on the machine as it was for the first of them.

    Raises UsageError: these are no readings.
    """

    def __init__(self, data: FileText, given: Input) -> None:
        self.path = data.path
        if not isinstance(given.measured, Readings):
            fault = f"{self.path} holds differences; new readings cannot be joined to them."
            raise UsageError(fault, "Give the file of the raw readings, if you have it.")
        self.data, self.model, self.conditions = data, given.model, given.conditions
        self.readings, self.plan = given.measured, given.measured.plan
        self.repeats = Counter(planned_readings(self.plan))
        # Offsets in the controller at the end, less those at the beginning, (3,) [mm]: a carriage
        # that was commanded short was so for its readings alone.
        self.left_entered: Floats = self.plan.stood[self.plan.in_time[-1]]

    @cached_property
    def rows(self) -> list[ReadingRow]:
        """The readings as rows of a session, in the order of time."""
        rows = session_of_readings(self.readings, self.model, {}).readings
        # Steps are counted from 1 in each session: those of an earlier one cannot be retaken.
        return [row.changed(note=re.sub(r" \(r [0-9]+\)", "", row.note or "")) for row in rows]

    @property
    def environment(self) -> dict[str, str]:
        """Notes around them, and where they are from."""
        conditions = self.conditions
        counts = count_words(len(self.readings), conditions.retaken, conditions.skipped)
        origin = f"{visible(self.path)} ({counts}), sha256 {self.data.sha256}"
        before = conditions.environment.get(_ORIGIN)
        return {**conditions.environment, _ORIGIN: f"{origin}; {before}" if before else origin}

    def minutes(self, opened_at: str, since: float) -> float | None:
        """The time of a new reading on the clock of the first ones; None where they have none.

        The clock runs on from their end, if that is known and was on the same day; else it stands
        from the last of them to `opened_at`, when the session began (ISO 8601), minutes `since`.
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
        tick = 10.0**-TICK_DECIMALS
        return round(math.ceil(last / tick) * tick + since, TICK_DECIMALS)


@dataclass(frozen=True, eq=False)
class Setting:
    """Machine, steps and earlier readings of a session; they never change while it lasts."""

    model: Model
    steps: tuple[SessionStep, ...]  # all of them, number k at index k − 1
    following: Following | None = None  # how it continues others

    @property
    def machine(self) -> Machine:
        return self.model.machine

    @cached_property
    def first(self) -> PriorReadings | None:
        """The readings that it continues. Raises InputError: they cannot be read."""
        data = self.following and self.following.data
        return PriorReadings(data, read_input(data, self.model)) if data else None

    @property
    def held(self) -> Model:
        """The machine with the offsets that its controller holds while this is measured."""
        if self.following is None:
            return self.model
        held = np.add(self.machine.active, self.following.entered)
        return self.model.holding(tuple(held.round(9).tolist()))

    def short_mm(self, step: SessionStep) -> Floats:
        """Distance by which each carriage is commanded short of its posture, shape (3,) [mm]."""
        active = self.following.entered if self.following else NOTHING_ENTERED
        return np.asarray(np.subtract(step.cell.entered, active, dtype=np.float64).round(9))

    def point(self, step: SessionStep) -> tuple[Floats, Floats]:
        """Point to drive to: joints and tool, shape (3,) each [mm]."""
        joints = self.machine.joints_at(step.leg, step.cell.displacement) - self.short_mm(step)
        return joints, self.machine.nominal_rails.tool_for(joints)

    @cached_property
    def plan(self) -> GaugePlan:
        """The readings of all N steps."""
        return PlannedReading.planned([step.cell for step in self.steps])


class ReadingsSoFar:
    """The n readings that count in a state of the session, from first to last."""

    def __init__(self, state: State, setting: Setting) -> None:
        self.state, self.setting = state, setting
        steps, items = setting.steps, state.accepted.values()
        self.steps = [steps[number - 1] for number in state.accepted]  # what each is of
        self.value: Floats = np.array([item.take.value_mm for item in items])  # shape (n,) [mm]
        # Since the session began, shape (n,).
        self.minutes: Floats = np.array([item.take.minutes for item in items]).round(TICK_DECIMALS)
        self.left = [step for step in steps if state.is_open(step.number)]  # to be measured
        self.settled: set[Doubt] = set()  # of readings that were kept
        self.moved: list[int | None] = []  # step at which the stand of each was moved last
        self.fresh: list[int] = []  # not 0 where a reading that was kept in doubt began a new zero
        self.setup: list[int] = []  # readings of one share a zero
        proven: list[int] = []  # indices of those to compare with: not of those kept in doubt
        begun, known = dict[object, int](), dict[object, int]()
        for index, (step, (take, rank)) in enumerate(zip(self.steps, items, strict=True)):
            moves = (at for at, then in state.moved if then <= rank)
            self.moved.append([None, *(at for at in moves if steps[at - 1].zero == step.zero)][-1])
            self.fresh.append(begun.get(step.zero, 0))
            zero = (step.zero, self.moved[-1], self.fresh[-1])
            self.setup.append(known.setdefault(zero, len(known)))
            doubt = take.doubt if isinstance(take, Questioned) else None
            self.settled |= {doubt} if doubt else set()
            # One that showed that its stand was moved is right: only the zero before is not.
            if doubt and doubt.compares and (take.step, rank) not in state.moved:
                begun[step.zero] = index + 1
            else:
                proven.append(index)
        last = len(self.steps) - 1  # it is compared with those of the past (k,)
        self.past: Ints = np.array([index for index in proven if index != last], dtype=np.int64)
        # Of these the readings by the same gauge in the same set-up; and in the same cell.
        self.series = [i for i in self.past.tolist() if self.setup[i] == self.setup[last]]
        self.repeats = [i for i in self.series if self.steps[i].cell == self.steps[last].cell]

    def row(self, number: int, take: Arrived | None = None, **further: object) -> ReadingRow:
        """A step as a row of the session file: what it reads, a reading, and what is said of it."""
        setting, opened, step = self.setting, self.state.opened, self.setting.steps[number - 1]
        first, cells = setting.first, dict[str, object](cycle=step.cycle)
        if first:
            cells["cycle"] = step.cycle + first.repeats[step.cell]
        if take is not None:
            minutes = round(take.minutes, TICK_DECIMALS)
            cells |= {
                "reading_mm": take.value_mm,
                "gauge": opened.gauge_id(step.stand),
                "timestamp": take.at,
                "minutes": first.minutes(opened.at, minutes) if first else minutes,
                "temperature_c": opened.temperature_c,
            }
        row = row_at(step.cell, str(step.posture), several=setting.plan.parts > 1)
        return row.changed(**cells | further)

    @cached_property
    def rows(self) -> list[ReadingRow]:
        """The readings as rows of the session file; a gauge that was moved has another label."""
        rows, first, following = list[ReadingRow](), self.setting.first, self.setting.following
        read_before = first.rows if first else []
        of_series = {(row.leg, row.direction): row.gauge for row in read_before}  # read it last
        accepted = zip(self.state.accepted.values(), self.steps, self.moved, strict=True)
        for seq, ((take, _), step, moved) in enumerate(accepted, len(read_before) + 1):
            label = self.state.opened.gauge_id(step.stand)
            if following and following.continues:
                label = of_series.get((AXES[step.leg], AXES[step.direction]))
            if moved is not None:
                label = f"{label or ''} (moved at step {moved})".strip()
            remarks = [text for number, text in self.state.notes if number == take.step]
            if isinstance(take, Questioned):
                remarks.insert(0, QUESTIONED.format(take.step, take.question))
            note = "; ".join(filter(None, (*remarks, take.remark))) or None
            rows.append(self.row(take.step, take, seq=seq, gauge=label, note=note))
        return rows

    @property
    def measured(self) -> Readings:
        """The readings as they will be read from the session file at the end."""
        lines = range(1, len(self.rows) + 1)
        return readings_of(self.rows, self.setting.machine, Source("", ""), lines)

    @property
    def session(self) -> Session:
        """The session file's content; the same records always give the same."""
        state, opened, first = self.state, self.state.opened, self.setting.first
        before = first.conditions if first else Conditions()
        resolution = self.setting.machine.instrument.resolution_mm
        gauges = [
            GaugeIdentity(
                id=gauge.id, certificate=gauge.certificate or None, resolution_mm=resolution
            )
            for gauge in opened.gauges
        ]
        gauges += [gauge for gauge in before.gauges if gauge.id not in {g.id for g in gauges}]
        environment = first.environment if first else {}
        environment["readings_from"] = ", ".join(state.source)
        if opened.seed is not None:
            environment["seed"] = str(opened.seed)
        if opened.temperature_c is not None:
            environment["temperature_c"] = f"{opened.temperature_c:g}"
        loose = [f"step {step}: {text}" for step, text in state.notes if step not in state.accepted]
        if loose:
            environment["notes"] = "; ".join(loose)
        return Session(
            machine=self.setting.model,
            protocol=opened.protocol.value,
            operator=opened.operator or before.operator,
            gauges=tuple(gauges),
            started=before.started or opened.at,
            finished=state.ended.at if state.ended else None,
            environment=environment,
            readings=(*(first.rows if first else ()), *self.rows),
            retaken=tuple(self.row(take.step, take, reason=why) for take, why in state.replaced),
            skipped=tuple(self.row(n, reason=why) for n, why in sorted(state.skipped.items())),
        )

    @cached_property
    def solution(self) -> Solution | None:
        """The offsets; None while the readings do not determine them."""
        # Those of a session that continues others show at its end, with the others. Readings
        # longer than a leg will be refused when the session file is read.
        longest = self.setting.machine.leg_mm
        if self.setting.first or not self.steps or np.abs(self.value).max() > longest:
            return None
        with suppress(OrthocalError):
            return solve(self.measured, self.setting.model)
        return None

    @cached_property
    def expanded_mm(self) -> Floats | None:
        """U of the offsets if nothing else is wrong, shape (3,) [mm]; None without offsets."""
        if self.solution is None:
            return None
        length, mean_c = self.setting.machine.leg_mm, self.state.opened.temperature_c
        return self.solution.budget.extended(warmth(mean_c, length)).expanded_mm

    def unneeded(self) -> list[SessionStep]:
        """Steps that can be left out after a posture, once the offsets are known.

        None while a leg, gauge and posture was not measured: a model that was not compared with all
        of them may be wrong. The closing isotropic posture of the leg in hand stays.
        """
        state, steps, left = self.state, self.setting.steps, self.left
        done = {step.cell for step in steps if step.number in {*state.accepted, *state.skipped}}
        if {step.cell for step in steps} - done:
            return []
        last = self.steps[-1]
        closing = [s for s in left if s.setup == last.setup and s.posture is Posture.ISO]
        if last.posture is Posture.ISO or not closing:
            return left
        return [step for step in left if step.visit != closing[0].visit]

    @cached_property
    def partner(self) -> int | None:
        """Set-up of the other gauge of the last reading's leg; None without one."""
        setups, last = zip(self.steps, self.setup, strict=True), self.steps[-1]
        other = (last.setup, last.leg, 1 - last.stand)
        return {(s.setup, s.leg, s.stand): setup for s, setup in setups}.get(other)

    @cached_property
    def forecast(self) -> Mixture:
        """Forecast of these n readings, and of the last as its leg's other gauge would read it."""
        rows = [*range(len(self.steps)), *[-1] * (self.partner is not None)]
        plan = PlannedReading.planned([self.steps[i].cell for i in rows])
        direction, setup = plan.direction.copy(), np.array(self.setup)[rows]
        if self.partner is not None:
            direction[-1], setup[-1] = 3 - plan.leg[-1] - direction[-1], self.partner
        order = np.arange(len(self.steps))[rows]
        hours = self.minutes[rows] / 60.0
        plan = replace(plan, direction=direction, setup=setup, order=order, hours=hours)
        return forecast(self.setting.model, plan, np.array(self.fresh)[rows], self.sigma_mm)

    def prediction(self, past: Floats, exchanged: bool = False) -> Mixture:
        """The last reading, given those of its `past` (k, q), of as many sessions [mm].

        `exchanged`: as its leg's other gauge reads it.
        """
        row = len(self.steps) - (not exchanged)
        return self.forecast.given(past, self.past, np.array([row]))

    @property
    def sigma_mm(self) -> float:
        """Standard deviation of a reading: as stated, or larger where successive repeats say so.

        The median ignores blunders; the last reading is not asked.
        """
        stated = self.setting.machine.instrument.noise_mm
        last: dict[object, float] = {}
        jumps: list[float] = []
        earlier = zip(self.steps[:-1], self.setup, self.value.tolist(), strict=False)
        for step, setup, value in earlier:
            if (step.cell, setup) in last:
                jumps.append(abs(value - last[step.cell, setup]))
            last[step.cell, setup] = value
        if len(jumps) < _ENOUGH:
            return stated
        # For a normal x, σ is 1.4826 times the median of |x|; a jump has the noise of two readings.
        return max(stated, float(1.4826 * median(jumps) / math.sqrt(2.0)))


# --- forecast of the next reading -------------------------------------------------------------

# A reading is, near the nominal machine and before any of it is measured,
#
#     y = h(0) + ∂h/∂Δρ · Δρ + zero + misfit + drift·t + settling + noise
#
# with normally distributed unknowns: joint offsets, one zero per gauge set-up, what the model
# leaves out at each posture (the same in each cycle), the drift of each gauge, and what changes
# after a leg's first posture. Their sizes come from the machine file; that of the misfit shows only
# in the readings: several are carried along, each with the likelihood that the readings give it.

# Standard deviations of what nobody knows before the first reading [mm].
OFFSET_MM, ZERO_MM, UNKNOWN_MM = 3.0, 50.0, 5.0
_SIZES = np.array([1 / 27, 1 / 9, 1 / 3, 1.0, 3.0])  # of the misfit, in plausible ones


def forecast(model: Model, plan: GaugePlan, fresh: Ints, sigma_mm: float) -> Mixture:
    """Readings of a plan (m,) before the first is taken, for each size of the misfit.

    Where `fresh` (m,) is not 0, nothing is known of a reading but its repeats with the same number.
    The standard deviation of one reading is `sigma_mm`.
    """
    machine, causes = model.machine, CAUSES.values()
    zero = np.zeros(len(machine.parameter_names))
    drift = math.hypot(*(cause.size(machine) for cause in causes if cause.is_rate))
    settling = math.hypot(*(cause.size(machine) for cause in causes if cause.settles))
    _, slopes = differentiate(Model(machine), zero, plan)
    known, first = fresh == 0, _first_visits(plan)
    slopes, cells = slopes * known[:, None], _same(plan.cells, fresh)
    common = (
        OFFSET_MM**2 * slopes @ slopes.T
        + ZERO_MM**2 * _same(plan.setup)
        + UNKNOWN_MM**2 * (cells & ~known)
        + _same(plan.leg, plan.direction)
        * (drift**2 * np.outer(plan.hours, plan.hours) + settling**2 * np.outer(first, first))
        + sigma_mm**2 * np.eye(len(plan))
    )
    size2, count = (_SIZES * plausible_misfit_mm(machine))[:, None, None] ** 2, len(_SIZES)
    return Mixture(
        np.tile(simulate(model, zero, plan)[:, None], (count, 1, 1)),
        common + size2 * (cells & known),
        np.full((count, 1), -math.log(count)),
    )


def _first_visits(plan: GaugePlan) -> Bools:
    """True while the leg's carriage has not moved away from where it began, shape (m,)."""
    first = np.zeros(len(plan), dtype=bool)
    for mine in (np.flatnonzero(plan.leg == leg) for leg in np.unique(plan.leg)):
        order, moved = plan.order[mine], plan.displacement[mine]
        away = moved != moved[np.argmin(order)]
        first[mine] = order < order[away].min(initial=np.iinfo(np.intp).max)
    return first


@lru_cache(maxsize=8)  # asked for at every reading
def plausible_misfit_mm(machine: Machine) -> float:
    """Plausible size of what the model leaves out of a posture's reading [mm].

    Of all causes, each at the posture that it changes most, compared with the isotropic one.
    """
    hidden, plan = machine.unobservable, double_posture(machine, cycles=1)
    ids = [cause.id for cause in CAUSES.values() if cause.repeats and cause.id not in hidden]
    _, plausible = plausible_causes(ids, Model(machine), np.zeros(3), plan)
    isotropic = np.unique(plan.setup, return_index=True)[1][plan.setup]
    moved = (one.columns - one.columns[isotropic] for one in plausible)
    return math.hypot(*(float(np.linalg.norm(columns, axis=1).max()) for columns in moved))


def _same(*keys: Ints) -> Bools:
    """True where two entries are equal in every key (n,), shape (n, n)."""
    return np.asarray(np.all([key[:, None] == key for key in keys], axis=0))


# --- live checks ------------------------------------------------------------------------------

# Chance of a sound reading so far off, of the 60 in a session, and standard errors; nothing of the
# result depends on them.
RARE = 1.0 / SESSIONS_A_QUESTION / 60.0
LIMIT = -NormalDist().inv_cdf(RARE / 2.0)
_NUMBERS = ("no", "one", "two", "three", "four", "five")


class Question(NamedTuple):
    """A doubt in one sentence."""

    doubt: Doubt
    text: str


def check(readings: ReadingsSoFar, unit: Unit) -> Question | None:
    """The first question that the last reading, given in a unit, raises; None without one."""
    checks = (check_range, check_reading, check_divisions, check_repeats)
    return next(filter(None, (raised(readings, unit) for raised in checks)), None)


def check_range(readings: ReadingsSoFar, unit: Unit) -> Question | None:
    """The question of a reading further from the gauge's others, or zero, than it travels."""
    value, most_mm = float(readings.value[-1]), readings.setting.machine.instrument.most_mm
    earlier = readings.value[readings.series]
    if np.abs(value - (earlier if earlier.size else 0.0)).max() <= most_mm:
        return None
    where = f"further from {in_unit(earlier[-1], unit, '+g')} than" if earlier.size else "beyond"
    travel = f"{where} the gauge's travel of {in_unit(most_mm, unit)}"
    return Question(Doubt.RANGE, f"{in_unit(value, unit, '+g')} is {travel}: mistyped?")


def check_divisions(readings: ReadingsSoFar, unit: Unit) -> Question | None:
    """The question of a number between the gauge's divisions; only until one was kept."""
    value, division_mm = readings.value[-1], readings.setting.machine.instrument.resolution_mm
    in_tenths = division_mm / MM_PER_INCH * 1e5
    # On an inch scale they need not be those of the mm scale in the machine file.
    other = unit is Unit.INCH and abs(in_tenths - round(in_tenths)) > 1e-6
    if Doubt.GRID in readings.settled or other or not off_scale(value, division_mm):
        return None
    between = f"between the gauge's divisions of {in_unit(division_mm, unit)}"
    return Question(Doubt.GRID, f"{in_unit(float(value), unit)} lies {between}: mistyped?")


def check_repeats(readings: ReadingsSoFar, unit: Unit) -> Question | None:
    """The question that repeats raise which hardly differ: a gauge that is held, or another unit.

    Asked once in a session; what was kept is not questioned again.
    """
    gauge = readings.setting.machine.instrument
    # A session's first repeat is the first that can say something.
    if not readings.repeats or {Doubt.DEAD, Doubt.SCATTER} & readings.settled:
        return None
    known = dict[object, int]()
    cell = np.array([known.setdefault(step.cell, len(known)) for step in readings.steps])
    steady = too_steady(readings.value, np.array(readings.setup), cell, gauge)
    if steady is None:
        return None
    stated = f"though the gauge repeats within {in_unit(gauge.repeatability_mm, unit, '.3g')}"
    if steady[1] == 0.0:
        text = f"repeated readings never differ, {stated}: is it stuck, or its display held?"
        return Question(Doubt.DEAD, text)
    differ = in_unit(steady[1], unit, ".1g")
    text = f"repeated readings differ by {differ} only, {stated}: is the unit {unit}?"
    return Question(Doubt.SCATTER, text)


def check_reading(readings: ReadingsSoFar, unit: Unit) -> Question | None:
    """The question that the last reading raises after those before it; None if it fits."""
    if not readings.series:
        return None  # its zero is arbitrary: the first reading of a gauge can be anything
    prediction = readings.prediction(readings.value[readings.past][:, None])
    if prediction.tail(readings.value[None, -1:]).item() >= RARE:
        return None
    far = _how_far(readings, unit, prediction.mean.item(), prediction.std.item())
    moved = f"since step {readings.steps[readings.series[-1]].number}"
    likely = sorted(_explanations(readings, prediction), key=lambda pair: -pair[0])
    if not likely:
        if readings.repeats:
            return Question(Doubt.STAND, f"{far}: the stand seems to have moved {moved}")
        return Question(Doubt.UNEXPECTED, f"{far}: read and typed correctly?")
    # The best explanation, and others that are nearly as good.
    (most, best), words = likely[0], dict[Doubt, str]()
    for chance, (doubt, text) in likely:
        if chance * NEEDLESS_HOLD >= most * MISSED_FAULT:
            words.setdefault(doubt, text)
    text = f"{far}: {' or '.join(words.values())}"
    if readings.repeats and best.doubt is not Doubt.REVOLUTION:
        text += f" or has the stand moved {moved}?"
    return best._replace(text=text)


def _explanations(readings: ReadingsSoFar, prediction: Mixture) -> Iterator[tuple[float, Question]]:
    """Blunders that explain the last reading, with the chance of one at least as far off if so."""
    value, past = float(readings.value[-1]), readings.value[readings.past][:, None]
    away, turn = value - prediction.mean.item(), readings.setting.machine.instrument.turn_mm
    right = []  # doubt, its words, and what the reading would be then
    for turns in (1, 2, 3) if turn else ():
        words = f"{_NUMBERS[turns]} revolution{'s' * (turns > 1)}?"
        right.append((Doubt.REVOLUTION, words, value - turns * math.copysign(turn, away)))
    right.append((Doubt.SIGN, "opposite sign?", -value))
    right += [(Doubt.POINT, "decimal point misplaced?", value * by) for by in (10.0, 0.1)]
    if readings.partner is not None:
        right.append((Doubt.EXCHANGED, "are the two gauges exchanged?", value))
    for doubt, words, undone in right:
        fits = readings.prediction(past, exchanged=True) if doubt is Doubt.EXCHANGED else prediction
        chance = fits.tail(np.array([[undone]])).item()
        if chance >= RARE and LIMIT * fits.std.item() <= abs(away):
            yield chance, Question(doubt, words)


def _how_far(readings: ReadingsSoFar, unit: Unit, expected: float, std: float) -> str:
    value = float(readings.value[-1])
    if not readings.repeats:
        here = f"{with_uncertainty(expected, 2 * std)} mm"
        if unit is Unit.INCH:
            here = f"{with_uncertainty(expected / MM_PER_INCH, 2 * std / MM_PER_INCH)} in ({here})"
        return f"expected {here} here, not {value_text(value, unit)}"
    difference = abs(value - float(np.mean(readings.value[readings.repeats])))
    count = _NUMBERS[min(len(readings.repeats), 5)]
    cycles = "cycle" if count == "one" else f"{count} cycles"
    return f"{value_text(difference, unit, '')} from the last {cycles}"
