"""Reports of every kind, made from simulated sessions; shared by the tests."""

from __future__ import annotations

import tempfile
from collections.abc import Callable
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path

import numpy as np

from orthoglide_cal.causes import CAUSES
from orthoglide_cal.data import default_machine, read_input
from orthoglide_cal.machine import Machine
from orthoglide_cal.measured import Readings
from orthoglide_cal.outcome import (
    Calibration,
    Case,
    Conditions,
    GaugeIdentity,
    calibrate,
    history,
    identify,
)
from orthoglide_cal.protocols import double_posture, single_posture
from orthoglide_cal.report.blocks import Document
from orthoglide_cal.report.calibration_report import calibration_report
from orthoglide_cal.report.history_report import history_report
from orthoglide_cal.report.verification_report import verification_report
from orthoglide_cal.verification import verify
from tests.report.sessions import fine_gauge, readings_of, session, write_history

SAMPLES = Path(__file__).parents[2] / "sample_data"
MACHINE = default_machine()
FINE = fine_gauge(MACHINE)
TRUE = np.array([-0.53, 0.59, -1.76])
ISSUED = datetime(2026, 3, 4, 5, 6, 7, tzinfo=UTC)

HOSTILE = (
    "<script>alert('x')</script>",
    "\"><img src=x onerror=alert(1)>&amp;'`",
    '=HYPERLINK("http://example.invalid")|`code`[link](http://example.invalid)',
    "invoice\u202egnp.exe\u2066\x1b[31mred\x07\u009b0m",
    "W" * 400,
    "שלום עולם مرحبا",
)


def _case(measured: Readings, machine: Machine, conditions: Conditions | None = None) -> Case:
    return Case(measured, machine, conditions or Conditions(), session=True)


def _made(measured: Readings, machine: Machine = MACHINE) -> Calibration:
    return calibrate(_case(measured, machine), issued=ISSUED)


def healthy() -> Calibration:
    """Everything given, nothing wrong."""
    given = Conditions(
        protocol="double-posture",
        operator="A. Martin",
        started="2026-03-03T09:00:00+01:00",
        finished="2026-03-03T09:31:00+01:00",
        temperature_c=(20.9, 21.6),
        environment=(("place", "hall 3"),),
        gauges=(GaugeIdentity("no. 41", "2026-0117", 0.01), GaugeIdentity("no. 42")),
        retaken=1,
        notes=((14, "touched the stand"),),
    )
    return calibrate(_case(session(TRUE, 3), MACHINE, given), issued=ISSUED)


def named_in_machine() -> Calibration:
    """The axes do not meet."""
    gap = CAUSES["axis_gap"].at(np.array([0.3, -0.2, 0.25]))
    return _made(session(TRUE, 4, machine=FINE, effects=(gap,)), FINE)


def named_in_measurement() -> Calibration:
    """One reading is wrong by three revolutions' tenth."""
    good = session(TRUE, 5)
    value = good.value.copy()
    value[11] += 0.30
    return _made(readings_of(MACHINE, good.plan, value))


def ambiguous() -> Calibration:
    """The paper's second experiment: six numbers cannot carry a name."""
    measured, machine = read_input(str(SAMPLES / "experiment2.csv"))
    return calibrate(Case(measured, machine, Conditions(), session=False), issued=ISSUED)


def unexplained() -> Calibration:
    """Each posture of each leg deviates in its own way, again and again."""
    good = session(TRUE, 6, machine=FINE)
    plan = good.plan
    keys = np.stack((plan.setup, plan.displacement), axis=1)
    _, cell = np.unique(keys, axis=0, return_inverse=True)
    deviation = np.random.default_rng(1).normal(0.0, 0.08, int(cell.max()) + 1)
    return _made(readings_of(FINE, plan, good.value + deviation[cell.reshape(-1)]), FINE)


def failed() -> Calibration:
    """Only leg x was measured: the offsets are not determined."""
    good = session(TRUE, 7)
    return _made(good.subset(np.flatnonzero((good.plan.leg == 0) & (good.plan.direction == 1))))


def single() -> Calibration:
    """The other protocol."""
    return _made(session(TRUE, 8, plan=single_posture(MACHINE, cycles=3)))


def few() -> Calibration:
    """No spare reading."""
    plan = double_posture(MACHINE, cycles=1, closing=False, postures=("max", "min"))
    good = session(TRUE, 9, plan=plan)
    keep = np.flatnonzero(np.isin(plan.setup, (0, 2, 4)))
    return _made(good.subset(keep))


def hostile() -> Calibration:
    """Names and notes from somebody who wants to do harm."""
    machine = replace(MACHINE, name=HOSTILE[0] + HOSTILE[1])
    good = session(TRUE, 10, machine=machine)
    note = tuple(HOSTILE[k % len(HOSTILE)] if k < 12 else "" for k in range(len(good)))
    measured = replace(good, note=note, source=replace(good.source, path=HOSTILE[2] + ".csv"))
    given = Conditions(
        protocol=HOSTILE[5],
        operator=HOSTILE[3],
        started="2026-03-03T09:00:00+01:00",
        environment=((HOSTILE[1], HOSTILE[4]),),
        gauges=tuple(GaugeIdentity(text, text) for text in HOSTILE),
        notes=tuple(enumerate(HOSTILE, start=2)),
    )
    return calibrate(_case(measured, machine, given), issued=ISSUED)


def as_left() -> Calibration:
    """Adjusted and measured again."""
    before, after = session(TRUE, 14), session(TRUE - np.round(TRUE, 3), 15)
    found = verify(before, after, MACHINE, np.round(TRUE, 3), limit_mm=0.05)
    return calibrate(_case(before, MACHINE), verification=found, issued=ISSUED)


CALIBRATIONS: dict[str, Callable[[], Calibration]] = {
    made.__name__: made
    for made in (
        healthy,
        named_in_machine,
        named_in_measurement,
        ambiguous,
        unexplained,
        failed,
        single,
        few,
        hostile,
        as_left,
    )
}


def verified() -> Document:
    """A correction with exchanged axes, a change of the machine, and a limit."""
    gap = CAUSES["axis_gap"].at(np.array([0.3, -0.2, 0.25]))
    before = session(TRUE, 12, machine=FINE)
    after = session(TRUE - TRUE[[1, 0, 2]], 13, machine=FINE, effects=(gap,))
    found = verify(before, after, FINE, TRUE, limit_mm=0.05)
    return verification_report(found, "OC-20260304-050607-0123ABCD", ISSUED, "orthocal 0")


def history_of_machine() -> Document:
    """Four sessions, an adjustment, drift of x, and files that are no sessions."""
    with tempfile.TemporaryDirectory() as folder:
        write_history(Path(folder))
        return history_report(history(Path(folder)), identify("0", ISSUED))


def documents() -> dict[str, Callable[[], Document]]:
    """Name → maker of a document, one of each kind."""
    made: dict[str, Callable[[], Document]] = {
        name: (lambda make=make: calibration_report(make())) for name, make in CALIBRATIONS.items()
    }
    made["verified"] = verified
    made["history"] = history_of_machine
    return made
