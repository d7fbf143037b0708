"""What happens to a reading that arrives: its value, its time, and whether it is questioned."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from orthoglide_cal.effects import Effect
from orthoglide_cal.machine import Machine
from orthoglide_cal.session.checks import check_reading
from orthoglide_cal.session.desk import Typed
from orthoglide_cal.session.doubts import Doubt, Question
from orthoglide_cal.session.entry import check_entry
from orthoglide_cal.session.gauges.token import Token
from orthoglide_cal.session.gauges.typed import Garbled, Refused, parse_typed
from orthoglide_cal.session.history import history
from orthoglide_cal.session.state import State
from orthoglide_cal.session.steps import Step


@dataclass(frozen=True)
class Setting:
    """What a session is measured with.

    Attributes:
        machine: nominal machine.
        effects: causes accepted for it.
        steps: all steps.
        name: of the session file, for messages.
        unit: "mm" or "in", for readings without a unit.
        until_mm: end once every offset is known this well; None to take all readings.
    """

    machine: Machine
    effects: Sequence[Effect]
    steps: tuple[Step, ...]
    name: str
    unit: str = "mm"
    until_mm: float | None = None


@dataclass(frozen=True)
class Arrived:
    """A reading with what is to be asked about it.

    Attributes:
        value_mm: the reading.
        minutes: since the session began.
        question: None if nothing is wrong with it.
        confirmed: it was questioned before, and has come again.
    """

    value_mm: float
    minutes: float
    question: Question | None
    confirmed: bool


def understand(answer: Typed, unit: str) -> tuple[Token, Question | None] | Refused:
    """A typed answer as a reading, with the doubt that the typing itself raises."""
    parsed = parse_typed(answer.text)
    if isinstance(parsed, Refused):
        return parsed
    if isinstance(parsed, Garbled):
        value = parsed.token.mm(unit) or 0.0
        text = (
            f"{parsed.token.raw!r} would be {value:+.3f} mm typed on a {parsed.layout} keyboard"
            " layout: is it?"
        )
        return parsed.token, Question(Doubt.LAYOUT, text)
    if answer.hasty:
        text = "the same again at once: was the button pressed twice?"
        return parsed, Question(Doubt.DOUBLE, text)
    return parsed, None


def weigh(
    state: State,
    setting: Setting,
    step: Step,
    token: Token,
    minutes: float,
    doubt: Question | None = None,
) -> Arrived | None:
    """Check a reading against itself, the readings before it and the model.

    Args:
        state: the session so far.
        setting: its machine and steps.
        step: what the reading is of.
        token: the reading.
        minutes: now, since the session began.
        doubt: what is doubtful already.

    Returns:
        None if the token is no reading.
    """
    value = token.mm(setting.unit)
    if value is None:
        return None
    # A clock that was set back must not turn the order of the readings around.
    minutes = max([minutes, *(item.take.minutes for item in state.accepted.values())])
    gauge = setting.machine.gauge
    past = history(state, setting.steps, setting.machine, step, minutes, setting.effects)
    inches = (token.unit or setting.unit) == "in"
    question = (
        check_reading(past, value, gauge) or check_entry(state, past, value, gauge, inches) or doubt
    )
    if question is not None and doubt is not None and question is not doubt:
        question = Question(question.doubt, f"{doubt.text} {question.text}", question.about)
    near = 3.0 * past.forecast.sigma_mm
    earlier = [old.value_mm for old in state.refused(step.number)]
    if state.pending is not None and state.pending.step == step.number:
        earlier.append(state.pending.value_mm)
    confirmed = question is not None and any(abs(value - old) <= near for old in earlier)
    return Arrived(value, minutes, question, confirmed)
