"""Live checks: is this reading what the readings before it, and the model, lead to expect?

A reading is questioned when a reading as far off is as rare as one beyond LIMIT standard errors,
and the question names the blunder that explains it best. Nothing is altered.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from orthoglide_cal.axes import AXES, Floats, Ints
from orthoglide_cal.estimation.forecast import Prediction
from orthoglide_cal.machine import Gauge
from orthoglide_cal.session.doubts import Doubt, Question
from orthoglide_cal.session.history import History

# Standard errors that a reading may be off: by chance once in 150,000 readings, in 2,500 sessions.
LIMIT = 4.5
RARE = math.erfc(LIMIT / math.sqrt(2.0))
# An explanation must make the reading an ordinary one: within 3 standard errors.
_ORDINARY = math.erfc(3.0 / math.sqrt(2.0))
# How much likelier all readings must be with the signs or gauges of a whole leg reversed. A
# likelihood ratio that is watched all the time exceeds c by chance with a probability of at most
# 1/c (Ville's inequality); a session watches nine of them.
RATIO = 3e4
_TURNS = 3

_NUMBERS = ("no", "one", "two", "three", "four", "five")


@dataclass(frozen=True)
class _Explanation:
    doubt: Doubt
    words: str
    chance: float  # of a reading at least this far off, if it is so
    std: float  # of the prediction, if it is so [mm]
    about: int = 0


@dataclass(frozen=True, eq=False)
class Reversal:
    """A blunder of a whole leg, as the readings that it would have given.

    Attributes:
        doubt, words: as in the question.
        first: number of the step from which on.
        signs: of the readings, shape (k,).
        rows: of the model, shape (k,).
    """

    doubt: Doubt
    words: str
    first: int
    signs: Floats
    rows: Ints


@dataclass(frozen=True, eq=False)
class Evidence:
    """What speaks against a reading; batched over leading axes of the readings.

    Attributes:
        prediction: from the readings before.
        tail: chance of a reading at least this far off, shape (...).
        whole: reversals of whole legs that are worth a question.
        gains: how much better they explain all readings: log likelihood ratios, (..., len(whole)).
    """

    prediction: Prediction
    tail: Floats
    whole: tuple[Reversal, ...]
    gains: Floats

    @property
    def questioned(self) -> NDArray[np.bool_]:
        """Whether a question is due, shape (...)."""
        together = (self.gains > math.log(RATIO)).any(axis=-1)
        return np.asarray((self.tail < RARE) | together)


def gather(history: History, known: Floats, value: Floats | float) -> Evidence:
    """Weigh a reading.

    Args:
        history: what was measured; its readings themselves are not used.
        known: readings at `history.past`, shape (..., k) [mm].
        value: the new one, shape (...) [mm].
    """
    past, new = history.past, len(history.value)
    prediction = history.forecast.predict(known, past, new)
    rows = np.append(past, new)
    values = np.concatenate((known, np.asarray(value)[..., None]), axis=-1)
    # All that the model says of a leg as a whole is said in its first cycle.
    whole = () if history.repeats() else tuple(_unsettled(history, rows))
    gains = np.zeros((*np.shape(value), len(whole)))
    base = history.forecast.log_likelihood(values, rows) if whole else 0.0
    for index, reversal in enumerate(whole):
        fit = history.forecast.log_likelihood(values * reversal.signs, reversal.rows)
        gains[..., index] = fit - base
    return Evidence(prediction, prediction.tail(value), whole, gains)


def check_reading(history: History, value: float, gauge: Gauge) -> Question | None:
    """The question that a reading raises, compared with those before it; None if it fits.

    Args:
        history: the readings so far and the step that this one is for.
        value: the reading [mm].
        gauge: the indicator.
    """
    if not history.series():
        return None  # its zero is arbitrary: the first reading of a gauge can be anything
    evidence = gather(history, history.value[history.past], value)
    if not evidence.questioned:
        return None
    if evidence.tail >= RARE:
        best = evidence.whole[int(np.argmax(evidence.gains))]
        words = f"{best.words} since step {best.first}?"
        text = f"the readings together would fit far better: {words}"
        return Question(best.doubt, text, best.first)
    expected, std = float(evidence.prediction.mean), float(evidence.prediction.std)
    compared = _compared(history, value, expected, std)
    found = [
        explanation
        for explanation in _explanations(history, value, gauge, evidence.prediction)
        if explanation.chance >= _ORDINARY and LIMIT * explanation.std <= abs(value - expected)
    ]
    last = history.steps[history.series()[-1]].number
    if found:
        best_one = max(found, key=lambda explanation: explanation.chance)
        words = _words(found, best_one)
        if history.repeats() and best_one.doubt != Doubt.REVOLUTION:
            words += f" or has the stand moved since step {last}?"
        return Question(best_one.doubt, f"{compared}: {words}", best_one.about)
    if history.repeats():
        moved = f"the stand seems to have moved since step {last}"
        return Question(Doubt.STAND, f"{compared}: {moved}")
    return Question(Doubt.UNEXPECTED, f"{compared}: read and typed correctly?")


def reversals(history: History, rows: Ints) -> Iterator[Reversal]:
    """Blunders that may have lasted since the first reading of a gauge or leg.

    Args:
        history: the readings.
        rows: indices of the readings to compare, shape (k,).
    """
    steps = [history.steps[i] for i in rows]
    plain = np.ones(len(rows))
    whole = np.asarray(history.fresh[rows] == 0)
    for series in dict.fromkeys(step.series for step in steps):
        mine = np.array([step.series == series for step in steps])
        first = steps[int(np.argmax(mine))].number
        if mine.sum() > 1 and np.all(whole[mine]):
            signs = np.where(mine, -1.0, 1.0)
            gauge = AXES[series[1]].upper()
            words = f"gauge {gauge} with the opposite sign"
            yield Reversal(Doubt.SIGN, words, first, signs, rows)
    for setup in dict.fromkeys(step.setup for step in steps):
        leg = np.array([step.setup == setup for step in steps])
        first = steps[int(np.argmax(leg))].number
        if leg.sum() > 2 and np.all(whole[leg]) and np.all(history.partner[rows][leg] >= 0):
            swapped = np.where(leg, rows + len(history.steps), rows)
            words = "are the two gauges exchanged"
            yield Reversal(Doubt.EXCHANGED, words, first, plain, swapped)


def _unsettled(history: History, rows: Ints) -> Iterator[Reversal]:
    """Reversals that were not answered already."""
    for reversal in reversals(history, rows):
        if (reversal.doubt, reversal.first) not in history.settled:
            yield reversal


def _explanations(
    history: History, value: float, gauge: Gauge, prediction: Prediction
) -> Iterator[_Explanation]:
    """Blunders that may have made this reading what it is."""
    past, new = history.past, len(history.value)
    known = history.value[past]
    std = float(prediction.std)

    def corrected(doubt: Doubt, words: str, candidate: float) -> _Explanation:
        return _Explanation(doubt, words, float(prediction.tail(candidate)), std)

    for turns in range(1, _TURNS + 1) if gauge.revolution_mm else ():
        words = f"{_NUMBERS[turns]} revolution{'s' if turns > 1 else ''}?"
        size = math.copysign(turns * (gauge.revolution_mm or 0.0), value - float(prediction.mean))
        yield corrected(Doubt.REVOLUTION, words, value - size)
    yield corrected(Doubt.SIGN, "opposite sign?", -value)
    for factor in (10.0, 0.1):
        yield corrected(Doubt.POINT, "decimal point misplaced?", value * factor)
    if history.partner[new] >= 0:
        other = history.forecast.predict(known, past, new + len(history.steps))
        chance, spread = float(other.tail(value)), float(other.std)
        yield _Explanation(Doubt.EXCHANGED, "are the two gauges exchanged?", chance, spread)
    if history.repeats():
        return
    rows = np.append(past, new)
    for reversal in _unsettled(history, rows):
        reversed_ = np.append(known, value) * reversal.signs
        other = history.forecast.predict(reversed_[:-1], reversal.rows[:-1], reversal.rows[-1])
        chance, spread = float(other.tail(reversed_[-1])), float(other.std)
        words = f"{reversal.words} since step {reversal.first}?"
        yield _Explanation(reversal.doubt, words, chance, spread, reversal.first)


def _words(found: list[_Explanation], best: _Explanation) -> str:
    """The best explanation, and others that are nearly as good."""
    words = {best.doubt: best.words}
    for explanation in sorted(found, key=lambda item: -item.chance):
        if explanation.chance >= 0.3 * best.chance:
            words.setdefault(explanation.doubt, explanation.words)
    return " or ".join(words.values())


def _compared(history: History, value: float, expected: float, std: float) -> str:
    """How far the reading is from what, in words."""
    repeats = history.repeats()
    if not repeats:
        return f"expected {expected:+.2f} +/- {2 * std:.2f} mm here, not {value:+.3f}"
    difference = abs(value - float(np.mean(history.value[repeats])))
    count = _NUMBERS[min(len(repeats), 5)]
    return f"{difference:.3f} mm from the last {'cycle' if count == 'one' else count + ' cycles'}"
