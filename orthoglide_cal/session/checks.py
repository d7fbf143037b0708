"""Live checks: is this reading what the readings before it, and the model, lead to expect?

A reading is questioned when its deviation is as improbable as one beyond LIMIT standard errors,
and the question names the blunder that explains it best. Nothing is altered.
"""

import math
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from orthoglide_cal.model.gauge import off_scale, too_steady
from orthoglide_cal.model.plan import Floats, Ints
from orthoglide_cal.model.readings import AXES
from orthoglide_cal.session.events import Doubt
from orthoglide_cal.session.readings import ReadingsSoFar
from orthoglide_cal.words import MM_PER_INCH, Unit, in_unit, value_text, with_uncertainty

# The limits define how often a sound reading is questioned; they decide nothing of the result.
# Standard errors that a reading may be off: by chance once in 150,000 readings, in 2,500 sessions.
LIMIT = 4.5
RARE = math.erfc(LIMIT / math.sqrt(2.0))
# An explanation must make the reading an ordinary one: within 3 standard errors.
_ORDINARY = math.erfc(3.0 / math.sqrt(2.0))
# How much likelier all readings must be with the signs or gauges of a whole leg reversed. A
# likelihood ratio that is watched all the time exceeds c by chance with a probability of at most
# 1/c (Ville's inequality); a session watches nine of them.
RATIO = 3e4

_NUMBERS = ("no", "one", "two", "three", "four", "five")


class Question(NamedTuple):
    """A doubt in one sentence; `about` as in `events.Questioned`."""

    doubt: Doubt
    text: str
    about: int = 0


class Blunder(NamedTuple):
    """A blunder by what undoes it in k readings: factors, rows of the forecast, a last shift."""

    question: Question
    factors: Floats
    rows: Ints
    shift_mm: float = 0.0  # of the last reading


class Evidence:
    """Evidence against q values of the last reading (q,), of as many sessions [mm].

    `known` are the readings of its `past`, (k, q).
    """

    def __init__(self, readings: ReadingsSoFar, known: Floats, value: Floats) -> None:
        rows, forecast, settled = readings.compared, readings.forecast, readings.settled
        self.prediction = forecast.given(known, rows[:-1], rows[-1:])  # from the readings before
        # Chance of a reading at least this far off, (q,).
        self.tail: Floats = self.prediction.tail(value[None])[0]
        # Blunders of whole legs; all that the model says of these is said in the first cycle.
        self.whole = [
            reversal
            for reversal in (() if readings.repeats else _reversals(readings))
            if (reversal.question.doubt, reversal.question.about) not in settled
        ]
        values = np.vstack((known, value))
        base = forecast.log_density(values, rows) if self.whole else 0.0
        fits = (forecast.log_density(values * r.factors[:, None], r.rows) for r in self.whole)
        # Log likelihood ratios in favour of those, (len(whole), q).
        self.gains: Floats = np.array([fit - base for fit in fits]).reshape(-1, len(value))

    @property
    def questioned(self) -> NDArray[np.bool_]:
        """True where a question is due, shape (q,)."""
        together = (self.gains > math.log(RATIO)).any(axis=0)
        return np.asarray((self.tail < RARE) | together)


def check(readings: ReadingsSoFar, unit: Unit) -> Question | None:
    """The first question that the last reading, given in a unit, raises; None if it raises none."""
    checks = (check_range, check_reading, check_divisions, check_repeats)
    return next(filter(None, (raised(readings, unit) for raised in checks)), None)


def check_range(readings: ReadingsSoFar, unit: Unit) -> Question | None:
    """The question of a reading further from zero than the gauge's plunger travels.

    Or further from another reading of the same gauge: zero may have been set elsewhere.
    """
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
    if (Doubt.GRID, 0) in readings.settled or other or not off_scale(value, division_mm):
        return None
    between = f"between the gauge's divisions of {in_unit(division_mm, unit)}"
    return Question(Doubt.GRID, f"{in_unit(float(value), unit)} lies {between}: mistyped?")


def check_repeats(readings: ReadingsSoFar, unit: Unit) -> Question | None:
    """The question that repeats raise which hardly differ: a gauge that is held, or another unit.

    Asked once in a session; what was kept is not questioned again.
    """
    gauge = readings.setting.machine.instrument
    # A session's first repeat is the first that can say something.
    if not readings.repeats or {(Doubt.DEAD, 0), (Doubt.SCATTER, 0)} & readings.settled:
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
    value = float(readings.value[-1])
    evidence = Evidence(readings, readings.value[readings.past][:, None], np.array([value]))
    if not evidence.questioned.item():
        return None
    if evidence.tail.item() >= RARE:
        best = evidence.whole[int(np.argmax(evidence.gains))].question
        return best._replace(text=f"the readings together would fit far better: {best.text}")
    expected, std = evidence.prediction.mean.item(), evidence.prediction.std.item()
    far = _how_far(readings, unit, expected, std)
    likely = list(_explanations(readings, evidence))
    moved = f"since step {readings.steps[readings.series[-1]].number}"
    if not likely:
        if readings.repeats:
            return Question(Doubt.STAND, f"{far}: the stand seems to have moved {moved}")
        return Question(Doubt.UNEXPECTED, f"{far}: read and typed correctly?")
    # The best explanation, and others that are nearly as good.
    likely.sort(key=lambda pair: -pair[0])
    (most, best), words = likely[0], dict[Doubt, str]()
    for chance, question in likely:
        if chance >= 0.3 * most:
            words.setdefault(question.doubt, question.text)
    text = f"{far}: {' or '.join(words.values())}"
    if readings.repeats and best.doubt is not Doubt.REVOLUTION:
        text += f" or has the stand moved {moved}?"
    return best._replace(text=text)


def _reversals(readings: ReadingsSoFar) -> Iterator[Blunder]:
    """Blunders that may have lasted since the first reading of a gauge or leg."""
    rows = readings.compared
    steps = [readings.steps[i] for i in rows]
    whole, paired = np.array(readings.fresh)[rows] == 0, readings.partner[rows] >= 0

    def since(doubt: Doubt, words: str, mine: NDArray[np.bool_]) -> Question:
        first = steps[int(np.argmax(mine))].number
        return Question(doubt, f"{words} since step {first}?", first)

    for leg, direction in dict.fromkeys(step.series for step in steps):
        mine = np.array([step.series == (leg, direction) for step in steps])
        if mine.sum() > 1 and np.all(whole[mine]):
            words = f"gauge {AXES[direction].upper()} with the opposite sign"
            yield Blunder(since(Doubt.SIGN, words, mine), np.where(mine, -1.0, 1.0), rows)
    for setup in dict.fromkeys(step.setup for step in steps):
        mine = np.array([step.setup == setup for step in steps])
        if mine.sum() > 2 and np.all(whole[mine] & paired[mine]):
            question = since(Doubt.EXCHANGED, "are the two gauges exchanged", mine)
            swapped = np.where(mine, rows + len(readings.steps), rows)
            yield Blunder(question, np.ones(len(rows)), swapped)


def _explanations(readings: ReadingsSoFar, evidence: Evidence) -> Iterator[tuple[float, Question]]:
    """Blunders that make an ordinary reading of the last one, which is none without them.

    With the chance of a reading at least this far off if so.
    """
    rows, value = readings.compared, readings.value[readings.compared]
    away = value[-1] - evidence.prediction.mean.item()

    def of_last(doubt: Doubt, words: str, factor: float = 1.0, shift_mm: float = 0.0) -> Blunder:
        factors = np.append(np.ones(len(rows) - 1), factor)
        return Blunder(Question(doubt, words), factors, rows, shift_mm)

    blunders: list[Blunder] = []
    if turn := readings.setting.machine.instrument.turn_mm:
        slip = math.copysign(turn, away)
        for turns in (1, 2, 3):
            words = f"{_NUMBERS[turns]} revolution{'s' if turns > 1 else ''}?"
            blunders.append(of_last(Doubt.REVOLUTION, words, shift_mm=-turns * slip))
    blunders.append(of_last(Doubt.SIGN, "opposite sign?", -1.0))
    blunders += [of_last(Doubt.POINT, "decimal point misplaced?", k) for k in (10.0, 0.1)]
    if readings.partner[-1] >= 0:
        swapped = np.append(rows[:-1], rows[-1] + len(readings.steps))
        exchanged = of_last(Doubt.EXCHANGED, "are the two gauges exchanged?")
        blunders.append(exchanged._replace(rows=swapped))
    for blunder in (*blunders, *evidence.whole):
        undone, prediction = (value * blunder.factors)[:, None], evidence.prediction
        # What changes only the last reading leaves the prediction of it as it is.
        if blunder.rows is not rows or np.any(blunder.factors[:-1] != 1.0):
            prediction = readings.forecast.given(undone[:-1], blunder.rows[:-1], blunder.rows[-1:])
        chance = prediction.tail(undone[-1:] + blunder.shift_mm).item()
        if chance >= _ORDINARY and LIMIT * prediction.std.item() <= abs(away):
            yield chance, blunder.question


def _how_far(readings: ReadingsSoFar, unit: Unit, expected: float, std: float) -> str:
    value = float(readings.value[-1])
    if not readings.repeats:
        here = f"{with_uncertainty(expected, 2 * std)} mm"
        if unit is Unit.INCH:
            inches = expected / MM_PER_INCH, 2 * std / MM_PER_INCH
            here = f"{with_uncertainty(*inches)} in ({here})"
        return f"expected {here} here, not {value_text(value, unit)}"
    difference = abs(value - float(np.mean(readings.value[readings.repeats])))
    count = _NUMBERS[min(len(readings.repeats), 5)]
    far = value_text(difference, unit, "")
    return f"{far} from the last {'cycle' if count == 'one' else count + ' cycles'}"
