"""What the gauges are promised to read once offsets are entered, against the independent truth."""

import numpy as np
import pytest

from orthoglide_cal.estimation import OffsetEstimate, promise
from orthoglide_cal.estimation.accuracy import Scatter
from orthoglide_cal.estimation.budget import Budget, Contribution
from orthoglide_cal.model.measured import DIFFERENCES, DataKind, Difference, Measured
from orthoglide_cal.model.model import Model
from orthoglide_cal.model.orthoglide import double_posture, single_posture
from orthoglide_cal.model.plan import Floats
from orthoglide_cal.model.readings import Contact, Posture
from tests import truth
from tests.estimation.sessions import (
    BENT,
    OFFSETS,
    SINGLE,
    SIX,
    differences,
    of_values,
    only,
    readings,
)
from tests.machines import NOMINAL, PROTOTYPE, sure
from tests.planning.truth import true_readings
from tests.readings import readings_of, some
from tests.truth.effects import Effect, state_with

# Neither what was found nor near it, and different on every axis.
ENTERED = np.array([0.6, -1.1, 0.9])
NOISE = Scatter(0.006, 51.0)

GAPS = (Effect("axis_gap", "", tuple(BENT.accepted[0].theta.tolist())),)


def true_difference(kind: DataKind, difference: Difference, offsets: Floats) -> float:
    """One of the paper's differences on the bent machine, by the truth [mm]."""
    plan = (single_posture if kind is SINGLE else double_posture)(PROTOTYPE, 1)
    read, (series, posture) = true_readings(plan, PROTOTYPE, offsets, GAPS), difference

    def at(posture: Posture, contact: Contact = Contact.FIXED) -> float:
        there = plan.displacement == PROTOTYPE.displacement_mm(posture)
        return float(read[plan.of(series) & there & (plan.contact == contact)][0])

    if kind is SINGLE:
        return at(posture, Contact.TOOL) - at(posture, Contact.JOINT)
    first, second = (posture, Posture.ISO) if posture else (Posture.MAX, Posture.MIN)
    return at(first) - at(second)


FORMS = ["six", "twelve", "single", "double-posture readings", "single-posture readings"]
forms = pytest.mark.parametrize("form", FORMS)


def known(
    model: Model, offsets: Floats, variance: float = 1e-5, noise: Scatter = NOISE
) -> OffsetEstimate:
    budget = Budget((Contribution.beyond("noise", variance * np.eye(3)),))
    return OffsetEstimate(model, offsets, budget, noise)


def shown_as(form: str) -> DataKind:
    """The differences of the promise."""
    return SINGLE if "single" in form else SIX


def measured(form: str, offsets: Floats, noise: float = 0.0) -> Measured:
    """What was measured on the bent machine, with noise that no offsets explain."""
    rng = np.random.default_rng(8)
    if form in list(DataKind):
        kind = DataKind(form)
        values = np.array([true_difference(kind, each, offsets) for each in DIFFERENCES[kind]])
        return of_values(kind, values + noise * rng.standard_normal(len(values)))
    plan = (double_posture if "double" in form else single_posture)(PROTOTYPE, 2)
    zeros = np.linspace(-0.9, 0.8, plan.setups)[plan.setup]
    values = true_readings(plan, PROTOTYPE, offsets, GAPS) + zeros
    return readings_of(PROTOTYPE, plan, values + noise * rng.standard_normal(len(plan)))


@forms
def test_it_is_what_the_truth_reads_once_other_offsets_are_entered(form: str) -> None:
    """What is measured then is the truth's reading plus the misfit that was measured before."""
    data = measured(form, OFFSETS, noise=0.05)
    rows = promise(data, known(BENT, OFFSETS), ENTERED)
    assert [row.name for row in rows] == [each.name for each in DIFFERENCES[shown_as(form)]]
    misfits = []
    for which, row in zip(DIFFERENCES[shown_as(form)], rows, strict=True):
        before = true_difference(shown_as(form), which, OFFSETS)
        after = true_difference(shown_as(form), which, OFFSETS - ENTERED)
        assert row.modelled_mm == pytest.approx(before, abs=1e-9)
        assert row.expected_mm == pytest.approx(after + row.measured_mm - before, abs=1e-9)
        misfits.append(row.measured_mm - before)
    assert np.abs(misfits).max() > 0.03


def test_stands_put_up_anew_are_misplaced_anew() -> None:
    """Where they stood before and where they stand then are two independent errors."""
    stated = sure(NOMINAL).machine
    model = Model(stated.changed(gauge=stated.gauge.changed(placement_mm=2.0)))
    plan = truth.standard_plan(truth.PROTOTYPE, np.random.default_rng(1), cycles=1)
    column, posture = {}, np.array(plan.posture)
    for when, offsets in (("before", OFFSETS), ("after", OFFSETS - ENTERED)):
        state = state_with(offsets, ())[None]
        apart = [
            truth.signals(plan, truth.PROTOTYPE, state, misplaced=np.full(6, shift))[0]
            for shift in (2.0, 0.0)
        ]
        column[when] = apart[0] - apart[1]
    rows = promise(
        differences(SIX, model),
        known(model, OFFSETS, 1e-16, Scatter(1e-8, np.inf)),
        ENTERED,
    )
    for which, row in zip(DIFFERENCES[SIX], rows, strict=True):
        mine = (plan.leg == which.series.leg) & (plan.direction == which.series.direction)
        high, low = (np.flatnonzero(mine & (posture == end))[0] for end in ("max", "min"))
        before, after = (column[when][high] - column[when][low] for when in ("before", "after"))
        assert abs(before * after) > 1e-8
        assert row.expanded_mm == pytest.approx(1.96 * np.hypot(before, after), rel=0.01)


def test_nothing_is_promised_where_nothing_was_measured() -> None:
    two = only(differences(SIX, NOMINAL), "dz_y", "dx_z")
    rows = promise(two, known(NOMINAL, OFFSETS), ENTERED)
    assert [row.name for row in rows] == ["dx_z", "dz_y"]
    session = readings(NOMINAL, double_posture(PROTOTYPE))
    part = some(session, session.plan.displacement != PROTOTYPE.joint_limits_mm[0])
    assert promise(part, known(NOMINAL, OFFSETS), OFFSETS) == ()
    rows = promise(session, known(NOMINAL, OFFSETS), OFFSETS)
    assert [row.name for row in rows] == ["dx_y", "dx_z", "dy_x", "dy_z", "dz_x", "dz_y"]
