"""Sigma of one reading: what noise leaves, repeats scatter, gauges can show; data without offsets.

Of data that do not determine the offsets: which ones, and whether those named complete them.
"""

import re
from dataclasses import replace

import numpy as np
import pytest
from scipy import stats
from scipy.stats import chi2

from orthoglide_cal.causes import CAUSES
from orthoglide_cal.errors import UnusableResultError
from orthoglide_cal.estimation.gaussian import unexplained
from orthoglide_cal.estimation.solution import scatter_of_repeats
from orthoglide_cal.inference.alone import solve
from orthoglide_cal.inference.diagnose import diagnose
from orthoglide_cal.model.measured import DIFFERENCES, DataKind, Measured
from orthoglide_cal.model.model import Model, differentiate, synthetic_session
from orthoglide_cal.model.orthoglide import double_posture, single_posture
from orthoglide_cal.model.plan import Plan
from orthoglide_cal.model.readings import AXES, GaugePlan, Series
from tests.estimation.sessions import (
    OFFSETS,
    SINGLE,
    SIX,
    TWELVE,
    differences,
    only,
    problem_of,
    readings,
)
from tests.machines import LARGE, NOMINAL, NOMINAL_LARGE, PROTOTYPE, both_models, sure
from tests.printers import NOMINAL_PRINTER, PRINTER, UNEVEN, printed, touched
from tests.readings import some
from tests.sentences import sentences
from tests.truth.delta import Layout, places_of


@pytest.mark.parametrize(
    ("kind", "influenced"), [(SIX, False), (SIX, True), (TWELVE, True), (SINGLE, True)]
)
def test_what_noise_leaves_of_differences_is_chi_squared(kind: DataKind, influenced: bool) -> None:
    """σ² χ² of k − 3 degrees of freedom, of 750 sets of differences.

    A Kolmogorov–Smirnov test at 1e-5, by either of two estimators for each of four cases.
    """
    rng = np.random.default_rng(5)
    problem = problem_of(kind, NOMINAL)
    jacobian, k = problem.at_zero[1], len(problem.matrix)
    # Unequal influences of a few standard deviations of noise each.
    ratio = rng.normal(0.0, [3.0, 1.0], (k, 2)) if influenced else np.zeros((k, 2))
    noise = 0.02 * rng.standard_normal((750, len(problem.plan))) @ problem.matrix.T
    data = noise + 0.02 * rng.standard_normal((750, 2)) @ ratio.T
    # Plain least squares, and the first three differences alone.
    first_three = np.linalg.pinv(np.where(np.arange(k)[:, None] < 3, jacobian, 0.0))
    if kind is SINGLE:  # of which the first three do not tell Δρ_y
        first_three = np.linalg.pinv(jacobian * np.linspace(1.0, 5.0, k)[:, None])
        first_three = first_three * np.linspace(1.0, 5.0, k)
    for estimator in (np.linalg.pinv(jacobian), first_three):
        assert estimator @ jacobian == pytest.approx(np.eye(3), abs=1e-9)
        residual = data - data @ estimator.T @ jacobian.T
        left = unexplained(*problem.whitened(ratio, jacobian, residual.T))
        found = (left**2).sum(axis=0) / 0.02**2
        assert stats.kstest(found, stats.chi2(k - 3).cdf).pvalue > 1e-5


def test_no_spare_difference_means_no_sigma() -> None:
    three = only(differences(SIX, NOMINAL), *[each.name for each in DIFFERENCES[SIX][:3]])
    solution = solve(three, NOMINAL)
    assert solution.scatter is None
    assert solution.dof == 0
    assert solution.noise.sigma_mm == PROTOTYPE.gauge.noise_mm
    assert solution.lack_of_fit_p == 1.0
    judgement = diagnose(three, NOMINAL).lack_of_fit.judgement
    assert "no spare readings" in sentences([judgement])[0]
    assert solution.budget.k == pytest.approx(stats.norm.ppf(0.975), rel=1e-6)


def test_what_does_not_repeat_has_no_sigma_of_repeats() -> None:
    """Joint end and tool end do not repeat each other, nor does a single cycle itself."""
    ends = single_posture(PROTOTYPE, 2)
    found = scatter_of_repeats(ends, 5.0 * ends.contact + 0.3 * ends.setup)
    assert (found.sigma_mm, found.dof) == (pytest.approx(0.0, abs=1e-12), 12)
    plan = double_posture(PROTOTYPE, cycles=1, closing=False)
    assert scatter_of_repeats(plan, np.zeros(len(plan))) is None


def test_a_distance_scatters_by_as_much_more_as_it_is_less_precise() -> None:
    """Six distances twice, each pair 2 d apart, at a weight w: its σ is √2·w·d with w·d known."""
    weights, first = np.linspace(0.2, 0.7, 6), np.column_stack((np.arange(6), np.zeros((6, 2))))
    once = printed(first, first + 50.0)
    plan = replace(Plan.joined(once, once), precision=np.tile(weights, 2))
    apart = 0.03 / weights
    found = scatter_of_repeats(plan, 50.0 + np.concatenate((apart, -apart)))
    assert (found.sigma_mm, found.dof) == (pytest.approx(0.03 * 2.0**0.5), 6)


def test_lost_motion_that_a_scanning_probe_cannot_show_is_misfit_all_the_same() -> None:
    """By plain least squares: the residuals do not excuse what U takes in."""
    model = Model(PRINTER.changed(probe=PRINTER.probe.changed(scanning=True)))
    plan = touched(np.column_stack((places_of(Layout(25), UNEVEN.bed), np.zeros(25))))
    lost = CAUSES["backlash"].at(np.array([0.1, -0.2, 0.15, 0.05, -0.1, 0.1]))
    moving, rng = NOMINAL_PRINTER.extended([lost]), np.random.default_rng(3)
    session = synthetic_session(moving, plan, np.zeros(6), rng)
    solution = solve(session, model)
    h, jacobian = differentiate(model, solution.offsets_mm, plan)
    left = session.value - h
    left = left - jacobian @ np.linalg.lstsq(jacobian, left, rcond=None)[0]
    assert solution.scatter.sigma_mm == pytest.approx(np.sqrt(left @ left / (25 - 6)))
    noise = np.hypot(PRINTER.probe.repeatability_mm, PRINTER.probe.resolution_mm / 12.0**0.5)
    assert solution.lack_of_fit_p == pytest.approx(chi2.sf(left @ left / noise**2, 25 - 6))
    assert left @ left > 2.0 * (25 - 6) * noise**2


@pytest.mark.parametrize("method", ["readings", "six", "twelve-linear"])
def test_sigma_of_raw_readings_is_from_all_of_them_whatever_the_method(method: str) -> None:
    session = readings(NOMINAL_LARGE, double_posture(LARGE), 0.1 * OFFSETS)
    plan = session.plan
    solution = solve(session, sure(NOMINAL_LARGE), method)
    # What offsets and zeros cannot explain, by a fit of both.
    h, jacobian = differentiate(NOMINAL_LARGE, solution.offsets_mm, plan)
    design = np.hstack((jacobian, plan.zeros))
    left = session.value - h
    left = left - design @ np.linalg.lstsq(design, left, rcond=None)[0]
    sums = float(left @ left)
    assert solution.dof == 60 - 6 - 3
    assert solution.scatter.sigma_mm == pytest.approx(np.sqrt(sums / 51), rel=1e-9)
    assert solution.noise.sigma_mm == solution.scatter.sigma_mm
    stated = LARGE.gauge.noise_mm
    assert solution.lack_of_fit_p == pytest.approx(stats.chi2.sf(sums / stated**2, 51), rel=1e-9)


def test_the_gauges_resolution_is_the_floor() -> None:
    """A gauge of 0.01 mm that always shows the same number has not measured to a nanometre."""
    session = readings(NOMINAL, double_posture(PROTOTYPE), np.zeros(3), seed=None)
    solution = solve(session, NOMINAL)
    assert solution.scatter.sigma_mm < 1e-9
    assert solution.noise.sigma_mm == pytest.approx(0.01 / np.sqrt(12.0), rel=1e-14)


DOUBLE_WORDS = re.compile(r"leg ([xyz]), direction ([xyz]), at max and min in one gauge set-up")
SINGLE_WORDS = re.compile(
    r"leg ([xyz]), direction ([xyz]), at (iso|max|min), joint end and tool end"
)


def refused(data: Measured, model: Model) -> UnusableResultError:
    with pytest.raises(UnusableResultError) as caught:
        solve(data, model)
    assert caught.value.exit_code == 4
    assert not re.search(r"\d\.\d", str(caught.value))
    return caught.value


def named(error: UnusableResultError) -> tuple[str, ...]:
    return tuple(axis for axis in AXES if f"Δρ_{axis}" in error.what)


def of(plan: GaugePlan, leg: str, direction: str) -> np.ndarray:
    return plan.of(Series(AXES.index(leg), AXES.index(direction)))


@both_models
@pytest.mark.parametrize(
    ("names", "undetermined"),
    [
        (("dx_y", "dy_x"), ("z",)),
        (("dy_z", "dz_y"), ("x",)),
        (("dx_z", "dz_x"), ("y",)),
        (("dx_y",), ("x", "y", "z")),
        (("dx_y", "dx_z"), ("x", "y", "z")),
    ],
)
def test_six_differences(
    model: Model, names: tuple[str, ...], undetermined: tuple[str, ...]
) -> None:
    full = differences(SIX, model)
    error = refused(only(full, *names), model)
    assert named(error) == undetermined
    added = [f"d{direction}_{leg}" for leg, direction in DOUBLE_WORDS.findall(error.remedy)]
    assert added
    completed = only(full, *names, *added)
    assert solve(completed, model).offsets_mm == pytest.approx(OFFSETS, abs=1e-9)
    # No more than are needed: with one of them less it is refused again.
    for left_out in added:
        refused(only(full, *names, *(name for name in added if name != left_out)), model)


@pytest.mark.parametrize(
    ("names", "undetermined"),
    [
        (("dz_x0", "dz_y0"), ("x", "y")),
        (("dz_x0", "dz_x+", "dz_x-"), ("y",)),
        (("dz_x+", "dz_y-"), ("x", "y", "z")),
    ],
)
def test_single_posture_differences(names: tuple[str, ...], undetermined: tuple[str, ...]) -> None:
    full = differences(SINGLE, NOMINAL)
    error = refused(only(full, *names), NOMINAL)
    assert named(error) == undetermined
    sign = {"iso": "0", "max": "+", "min": "-"}
    added = [f"d{d}_{leg}{sign[posture]}" for leg, d, posture in SINGLE_WORDS.findall(error.remedy)]
    completed = solve(only(full, *dict.fromkeys((*names, *added))), NOMINAL)
    # The linear method neglects terms of the order Δρ²/L.
    assert completed.offsets_mm == pytest.approx(OFFSETS, abs=0.1)


@both_models
def test_raw_readings_and_the_readings_that_complete_them(model: Model) -> None:
    full = readings(model, double_posture(model.machine), seed=None)
    plan = full.plan
    rng = np.random.default_rng(3)
    refusals = 0
    for _ in range(60):
        kept = np.zeros(len(full), dtype=bool)
        kept[rng.choice(60, 6, replace=False)] = True
        try:
            solve(some(full, kept), model)
        except UnusableResultError as error:
            refusals += 1
            places = DOUBLE_WORDS.findall(error.remedy)
            assert 1 <= len(places) <= 3
            for leg, direction in places:
                ends = np.isin(plan.displacement, model.machine.joint_limits_mm)
                kept |= of(plan, leg, direction) & ends
            completed = solve(some(full, kept), model)
            assert completed.offsets_mm == pytest.approx(OFFSETS, abs=1e-8)
    assert refusals > 30
