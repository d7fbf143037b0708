"""A model and its causes: order of stages, parameters from fit to file, values that stay as is."""

import math
from collections.abc import Iterator
from dataclasses import FrozenInstanceError, fields, is_dataclass, replace
from functools import cached_property
from inspect import getmembers

import numpy as np
import pytest

from orthoglide_cal.causes import CAUSES
from orthoglide_cal.errors import UsageError
from orthoglide_cal.estimation.budget import half_width
from orthoglide_cal.estimation.solution import fit_offsets
from orthoglide_cal.inference.alone import solve
from orthoglide_cal.inference.diagnose import diagnose
from orthoglide_cal.model.kinematics import Command
from orthoglide_cal.model.measured import DIFFERENCES, DataKind, Differences, Source
from orthoglide_cal.model.model import Effect, Place, simulate, synthetic_session
from orthoglide_cal.model.orthoglide import Orthoglide, double_posture
from orthoglide_cal.model.plan import Floats
from tests.machines import NOMINAL, PROTOTYPE, extended
from tests.printers import PRINTER, standard_plan

OFFSETS = np.array([0.7, -1.1, 0.4])
PLAN = double_posture(PROTOTYPE, 1)


def covariance(size: int, scale: float, seed: int = 3) -> Floats:
    """A full covariance matrix, no two entries alike."""
    root = np.random.default_rng(seed).normal(0.0, scale, (size, size))
    return root @ root.T


# --- models -----------------------------------------------------------------------------------


def test_contact_comes_before_the_record_whatever_the_order_of_the_causes() -> None:
    """A knocked stand under a gauge with the wrong sign: the step is written down with it."""
    knocked = CAUSES["stand_shift"].at(np.array([0.2]), Place((4,)))
    flipped = CAUSES["sign_flip"].at(np.zeros(0), Place((0, 1, 0)))
    clean = simulate(NOMINAL, OFFSETS, PLAN)
    step = 0.2 * ((PLAN.setup == PLAN.setup[4]) & (PLAN.order >= 4))
    sign = np.where(PLAN.of(PLAN.series[0]), -1.0, 1.0)
    assert PLAN.setup[4] == PLAN.setup[0]
    for order in ((knocked, flipped), (flipped, knocked)):
        found = simulate(NOMINAL.extended(order), OFFSETS, PLAN)
        assert found == pytest.approx(sign * (clean + step), abs=1e-12)


def test_a_changed_machine_has_the_fields_of_its_kind() -> None:
    assert PROTOTYPE.changed(leg_length_mm=300.0).nominal_rails.lengths.tolist() == [300.0] * 3
    with pytest.raises(TypeError, match="arm_length_mm"):
        PROTOTYPE.changed(arm_length_mm=300.0)
    with pytest.raises(UsageError, match="linear_delta"):
        Orthoglide.require(PRINTER)


# --- effects ----------------------------------------------------------------------------------


def test_estimates_are_in_the_units_of_the_files() -> None:
    """Internal rad → mrad; the square roots of the diagonal."""
    spread, values = covariance(3, 1e-4), np.array([1.2, -0.7, 0.4])
    effect = Effect(CAUSES["axis_squareness"], 1e-3 * values, covariance=spread)
    stds = 1e3 * np.sqrt(np.diag(spread))
    assert 1e3 * effect.std == pytest.approx(stds, rel=1e-12)
    assert [estimate.name for estimate in effect.estimates] == ["xy", "yz", "zx"]
    for estimate, value, std in zip(effect.estimates, values, stds, strict=True):
        assert estimate.unit == "mrad"
        assert (estimate.value, estimate.std) == pytest.approx((value, std), rel=1e-12)
        assert estimate.expanded == pytest.approx(half_width(math.inf) * estimate.std, rel=1e-12)


def test_a_width_is_not_negative_and_first_positions_are_not_told() -> None:
    theta = np.array([0.03, -0.004, 0.02, 0.011, -0.007, 0.017])
    effect = Effect(CAUSES["backlash"], theta, covariance=covariance(6, 0.01))
    estimates = effect.estimates
    assert [estimate.name for estimate in estimates] == ["x", "y", "z"]
    assert [estimate.value for estimate in estimates] == [0.03, 0.0, 0.02]
    assert CAUSES["axis_gap"].admissible(-0.3) == -0.3


def test_accepting_keeps_the_named_parameters_with_their_correlations() -> None:
    """Where the carriages started is forgotten; day and digest are remembered, the place too."""
    theta = np.array([0.03, -0.004, 0.02, 0.011, -0.007, 0.017])
    spread = covariance(6, 0.01)
    found = Effect(CAUSES["backlash"], theta, covariance=spread)
    kept = found.accepted("2026-03-04", "ab" * 32)
    assert kept.theta.tolist() == [0.03, 0.0, 0.02, 0.0, 0.0, 0.0]
    assert np.array_equal(kept.covariance[:3, :3], spread[:3, :3])
    assert not kept.covariance[3:].any()
    assert not kept.covariance[:, 3:].any()
    assert (kept.date, kept.data_sha256) == ("2026-03-04", "ab" * 32)
    assert kept.cause is found.cause
    assert (found.date, found.data_sha256) == (None, None)
    exact = CAUSES["stand_shift"].at(np.array([-0.2]), Place((4,))).accepted("2026-03-04", "0")
    assert exact.covariance is None
    assert exact.theta.tolist() == [-0.2]
    assert exact.place == Place((4,))


# --- values that nobody can change ------------------------------------------------------------


def arrays_in(value: object) -> Iterator[Floats]:
    """All arrays that a value holds, also those that it works out once, however deep."""
    if isinstance(value, np.ndarray):
        yield value
    elif isinstance(value, tuple):
        for part in value:
            yield from arrays_in(part)
    elif is_dataclass(value) and not isinstance(value, type):
        once = getmembers(type(value), lambda member: isinstance(member, cached_property))
        # `steps` is a plan of its own; `T` holds the same arrays.
        for name in (*(field.name for field in fields(value)), *dict(once).keys() - {"steps", "T"}):
            yield from arrays_in(getattr(value, name))


def test_values_are_frozen_to_the_last_array() -> None:
    session = synthetic_session(NOMINAL, PLAN, OFFSETS, np.random.default_rng(1))
    wanted = DIFFERENCES[DataKind.SIX]
    known = extended(axis_gap=(0.1, 0.2, -0.1))
    solution, diagnosis = solve(session, known), diagnose(session, known, sensitivity=True)
    with pytest.raises(TypeError):
        diagnosis.sensitivity["halved"] = None  # type: ignore[index]
    values = (
        PLAN,
        standard_plan(),
        session,
        Differences(DataKind.SIX, wanted, np.zeros(6), Source("six.csv", "")),
        known.accepted[0],
        Command(np.ones((2, 3)), 1.0, np.ones(2), *np.zeros((2, 2, 3))),
        known.real.geometry,
        NOMINAL.machine.command(PLAN),
        solution,
        diagnosis,
        fit_offsets(solution.problem, np.stack((solution.data,) * 2)),
    )
    for value in values:
        arrays = list(arrays_in(value))
        assert arrays
        assert not any(array.flags.writeable for array in arrays), type(value).__name__
        with pytest.raises(FrozenInstanceError):
            setattr(value, fields(value)[0].name, None)


def test_values_hold_copies_of_what_they_are_given() -> None:
    theta, spread, given = np.array([0.1, 0.2, 0.3]), covariance(3, 0.1), np.arange(6.0)
    hours = np.zeros(len(PLAN))
    plan = replace(PLAN, hours=hours)
    effect = Effect(CAUSES["axis_gap"], theta, covariance=spread)
    data = Differences(DataKind.SIX, DIFFERENCES[DataKind.SIX], given, Source("six.csv", ""))
    tolerances = {"axis_gap": 0.5}
    machine = type(PROTOTYPE)(**{**dict(PROTOTYPE), "tolerances": tolerances})
    theta[0] = spread[0, 0] = given[0] = hours[0] = tolerances["axis_gap"] = 99.0
    assert effect.theta[0] == 0.1
    assert effect.covariance[0, 0] != 99.0
    assert data.value[0] == plan.hours[0] == 0.0
    assert machine.tolerances["axis_gap"] == 0.5
    with pytest.raises(TypeError):
        machine.tolerances["axis_gap"] = 1.0  # type: ignore[index]
