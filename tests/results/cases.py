"""Inputs of every kind with their answers, from simulated sessions; shared by the tests."""

from collections.abc import Callable
from dataclasses import replace
from datetime import UTC, datetime
from functools import cache

import numpy as np

from orthoglide_cal.causes import CAUSES
from orthoglide_cal.files.input import Input, read_input
from orthoglide_cal.files.readings import Conditions, GaugeIdentity
from orthoglide_cal.model.measured import Readings
from orthoglide_cal.model.model import Model
from orthoglide_cal.model.orthoglide import double_posture, single_posture
from orthoglide_cal.model.readings import Posture
from orthoglide_cal.report.case import Case
from orthoglide_cal.results.answer import Identity, identify
from orthoglide_cal.results.making import answer_to
from orthoglide_cal.results.verification import Verification, verify
from tests.machines import NOMINAL, PROTOTYPE, SAMPLES
from tests.readings import some
from tests.results.sessions import FINE, TRUE, given, session

# Of a session to which nobody can object.
COMPLETE = Conditions(
    protocol="double-posture",
    operator="A. Martin",
    started="2026-03-03T09:00:00+01:00",
    finished="2026-03-03T09:31:00+01:00",
    temperature_c=(20.9, 20.7, 21.6, 21.3),
    environment={"place": "hall 3"},
    gauges=(
        GaugeIdentity(id="no. 41", certificate="2026-0117", due="2027-01-31", resolution_mm=0.01),
        GaugeIdentity(id="no. 42", certificate="2026-0118", due="2027-01-31"),
    ),
    retaken=1,
    notes=((14, "touched the stand"),),
)
ISSUED = datetime(2026, 3, 4, 5, 6, 7, tzinfo=UTC)
GAP = np.array([0.3, -0.2, 0.25])
GAPED = FINE.extended([CAUSES["axis_gap"].at(GAP)])

HOSTILE = (
    "<script>alert('x')</script>",
    "\"><img src=x onerror=alert(1)>&amp;'`",
    '=HYPERLINK("http://example.invalid")|`code`[link](http://example.invalid)',
    "invoice\u202egnp.exe\u2066\x1b[31mred\x07\u009b0m",
    "W" * 400,
    "שלום עולם مرحبا",
)


def case_of(read: Input) -> Case:
    return Case(read, answer_to(read, details=True))


def identity_of(case: Case) -> Identity:
    """What makes a report of it unique."""
    return identify([case.given], case.answer.method, issued=ISSUED)


def _made(measured: Readings, model: Model = NOMINAL, conditions: Conditions | None = None) -> Case:
    return case_of(given(measured, model, conditions))


CASES: dict[str, Callable[[], Case]] = {}


def listed(make: Callable[[], Case]) -> Callable[[], Case]:
    """One of the cases: made once, and found under its name."""
    CASES[make.__name__] = cache(make)
    return CASES[make.__name__]


@listed
def healthy() -> Case:
    """Everything given, nothing wrong."""
    return _made(session(TRUE, 3), NOMINAL, COMPLETE)


@listed
def named_in_machine() -> Case:
    """The axes do not meet."""
    return _made(session(TRUE, 4, GAPED), FINE)


@listed
def named_in_measurement() -> Case:
    """One reading is wrong by three revolutions' tenth."""
    good = session(TRUE, 5)
    return _made(replace(good, value=good.value + 0.30 * (np.arange(len(good)) == 11)))


@listed
def ambiguous() -> Case:
    """The paper's second experiment: six numbers cannot carry a name."""
    return case_of(read_input(str(SAMPLES / "experiment2.csv")))


@listed
def unexplained() -> Case:
    """Each posture of each leg deviates in its own way, again and again."""
    good = session(TRUE, 6, FINE)
    deviation = np.random.default_rng(1).normal(0.0, 0.08, len(good))[good.plan.cells]
    return _made(replace(good, value=good.value + deviation), FINE)


@listed
def failed() -> Case:
    """Only one direction of leg x was measured: the offsets are not determined."""
    good = session(TRUE, 7)
    return _made(some(good, np.flatnonzero((good.plan.leg == 0) & (good.plan.direction == 1))))


@listed
def single() -> Case:
    """The other protocol."""
    return _made(session(TRUE, 8, plan=single_posture(PROTOTYPE, cycles=3)))


@listed
def few() -> Case:
    """No spare reading."""
    ends = (Posture.MAX, Posture.MIN)
    plan = double_posture(PROTOTYPE, cycles=1, closing=False, postures=ends)
    return _made(some(session(TRUE, 9, plan=plan), np.flatnonzero(np.isin(plan.setup, (0, 2, 4)))))


@listed
def hostile() -> Case:
    """Names and notes from somebody who wants to do harm."""
    model = replace(NOMINAL, machine=PROTOTYPE.changed(name=HOSTILE[0] + HOSTILE[1]))
    good = session(TRUE, 10, model)
    note = tuple(HOSTILE[k % len(HOSTILE)] if k < 12 else "" for k in range(len(good)))
    measured = replace(good, note=note, source=replace(good.source, path=HOSTILE[2] + ".csv"))
    conditions = Conditions(
        protocol=HOSTILE[5],
        operator=HOSTILE[3],
        started="2026-03-03T09:00:00+01:00",
        environment={HOSTILE[1]: HOSTILE[4]},
        gauges=tuple(GaugeIdentity(id=text, certificate=text) for text in HOSTILE),
        notes=tuple(enumerate(HOSTILE, start=2)),
    )
    return _made(measured, model, conditions)


@cache
def as_left() -> tuple[Case, Verification, Case]:
    """Adjusted and measured again, with the result of that."""
    entered = np.round(TRUE, 3)
    before = given(session(TRUE, 14), NOMINAL, COMPLETE)
    after = given(session(TRUE - entered, 15), NOMINAL, COMPLETE)
    left = verify(before, after, entered.tolist(), limit_mm=0.05)
    again = case_of(after)
    return case_of(before), left, again
