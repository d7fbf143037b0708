"""A name survives what it did not see, and what it calls wrong may be left out."""

import sys
from dataclasses import replace

import numpy as np
import pytest

from orthoglide_cal.inference import Diagnosis, Verdict, diagnose
from orthoglide_cal.inference.fit import HeldOut
from orthoglide_cal.model.measured import Readings
from orthoglide_cal.model.model import Model
from tests import truth
from tests.inference.sessions import given, ids, known
from tests.inference.test_printers import quartic
from tests.readings import some
from tests.truth.delta import KOSSEL, V400, Layout, Truth, make_delta_session, probe_bed

LIMIT = 0.99
"""Probability from which an answer may not be reversed by its own advice."""


def touched(truth: Truth, layout: Layout, seed: int) -> tuple[Readings, Model]:
    read = given(probe_bed(V400, truth, (), layout, np.random.default_rng(seed)))
    return read.measured, read.model


def test_thirteen_heights_of_anything_have_no_name() -> None:
    """And a shape has at most a third as many terms as there are places."""
    readings, model = touched(Truth(), Layout(13), 0)
    junk = np.random.default_rng(0).uniform(-5.0, 2.2, 13)
    found = diagnose(replace(readings, value=junk), model)
    assert found.verdict is not Verdict.NAMED
    assert all(len(cause.parameters) <= 4 for cause in found.causes if cause.id == "bed_shape")


def test_readings_left_out_refute_a_name(monkeypatch: pytest.MonkeyPatch) -> None:
    readings, model = known(truth.make_session(4, truth.PROTOTYPE, truth.MICRON, ("axis_gap",)))
    assert diagnose(readings, model).refuted is None
    held = HeldOut(rms_mm=0.75, ratio=44.0, chance=1e-6)
    module = sys.modules[diagnose.__module__]
    monkeypatch.setattr(module, "leave_out_cells", lambda *_: held)
    found = vars(module)["diagnose"](readings, model)
    assert (found.verdict, found.causes) == (Verdict.UNEXPLAINED, ())
    assert found.refuted.code == "refuted_left_out"


def test_later_readings_refute_a_name_and_never_make_one() -> None:
    """The bed is another one, or the same: then the answer is that of the first readings alone."""
    bent = Truth(bed=quartic(np.random.default_rng(2), 0.08))
    readings, model = touched(bent, Layout(61), 1)
    alone = diagnose(readings, model)
    assert (alone.verdict, ids(alone)) == (Verdict.NAMED, ["bed_shape"])

    def held(later: Truth, **changes: object) -> Diagnosis:
        return diagnose(readings, model, holdout=touched(later, Layout(61), 2)[0], **changes)  # type: ignore[arg-type]

    for same in (held(bent), held(Truth(), applied=np.full(6, 1e-3))):
        assert (same.verdict, same.explanations) == (alone.verdict, alone.explanations)
    other = held(Truth())
    assert (other.verdict, other.causes) == (Verdict.UNEXPLAINED, ())
    assert other.refuted.code == "refuted_later"
    # What is consistent alone stays so, however well a shape would predict.
    faint = Truth(bed=quartic(np.random.default_rng(1), 0.012))
    few, few_model = touched(faint, Layout(29), 1)
    verdicts = {
        diagnose(few, few_model, holdout=holdout).verdict
        for holdout in (None, touched(faint, Layout(29), 2)[0])
    }
    assert verdicts == {Verdict.CONSISTENT}


# --- several wrong readings -------------------------------------------------------------------

PRINTER = ("", "tower_lean", "bed_shape", "backlash", "probe_tilt", "encoder_scale")
GAUGES = ("", *truth.MACHINE_CAUSES, "bar_skew")


def misread(seed: int) -> tuple[str, Readings, Model, set[int]]:
    """A hidden cause, readings of which up to a tenth are wrong by 0.1 to 2 mm, and which."""
    rng = np.random.default_rng([seed, 77])
    cause = str(rng.choice(PRINTER if seed % 2 else GAUGES))
    hidden = (cause,) if cause else ()
    if seed % 2:
        layout = Layout(int(rng.choice([41, 61])))
        read = given(make_delta_session(seed, (V400, KOSSEL)[seed // 2 % 2], hidden, layout))
        readings, model = read.measured, read.model
    else:
        gauges = list(truth.GAUGES.values())
        gauge = gauges[seed // 2 % len(gauges)]
        readings, model = known(truth.make_session(seed, truth.PROTOTYPE, gauge, hidden))
    wrong = rng.choice(len(readings), int(rng.integers(1, len(readings) // 10 + 1)), replace=False)
    size = np.exp(rng.uniform(np.log(0.1), np.log(2.0), wrong.size))
    size *= rng.choice([-1.0, 1.0], wrong.size)
    value = readings.value.copy()
    value[wrong] += size
    return cause, replace(readings, value=value), model, set(wrong.tolist())


@pytest.mark.parametrize("seeds", [range(1, 2), pytest.param(range(300), marks=pytest.mark.slow)])
def test_leaving_out_what_is_wrong_reverses_no_sure_answer(seeds: range) -> None:
    """No wrong name, and of the named nine in ten with exactly the readings that are wrong."""
    named = exact = 0
    for seed in seeds:
        cause, readings, model, wrong = misread(seed)
        found = diagnose(readings, model)
        if found.verdict is not Verdict.NAMED:
            continue
        told = set(found.wrong_readings)
        # One that is wrong by a whole turn is a slip.
        slips = {effect.place[0] for effect in found.effects if effect.cause.id == "gauge_slip"}
        faults = {"misread", "gauge_slip"} if slips and slips <= wrong else {"misread"}
        told |= slips & wrong
        rest = set(ids(found)) - faults
        assert rest <= {cause}, seed
        named, exact = named + 1, exact + (told == wrong)
        sure = sum(
            one.probability
            for one in found.explanations
            if rest <= set(one.ids) and faults & set(one.ids)
        )
        if not told or max(sure, found.causes[0].probability) < LIMIT:
            continue
        kept = ~np.isin(np.arange(len(readings)), [*told])
        then = diagnose(some(readings, kept), model)
        if rest:
            assert rest <= {*ids(then), *then.ambiguous_with}, seed
        else:
            assert then.verdict in (Verdict.CONSISTENT, Verdict.AMBIGUOUS), seed
    assert named >= 0.6 * len(seeds)
    assert exact >= 0.9 * named
