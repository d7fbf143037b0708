"""What a solution says of itself: the judgement, its chance of a false alarm, Monte Carlo."""

import numpy as np
import pytest

from orthoglide_cal.causes import CAUSES
from orthoglide_cal.errors import NotConvergedError
from orthoglide_cal.estimation import solve
from orthoglide_cal.estimation.monte_carlo import monte_carlo
from orthoglide_cal.estimation.solution import SUSPICIOUS, TableRow
from orthoglide_cal.protocols import SIX, double_posture, single_posture
from tests.estimation.sessions import OFFSETS, readings
from tests.machines import PROTOTYPE


def test_healthy_sessions_are_called_what_the_gauges_noise_would_give() -> None:
    """A chance of 0.001 each: two or more alarms in 100 sessions have a chance of 0.5 %."""
    plan = double_posture(PROTOTYPE)
    solutions = [solve(readings(PROTOTYPE, plan, seed=k), PROTOTYPE) for k in range(100)]
    assert sum(solution.suspicious for solution in solutions) <= 1
    healthy = next(solution for solution in solutions if not solution.suspicious)
    assert "are what this gauge's noise would give" in healthy.judgement
    chances = [solution.lack_of_fit_p for solution in solutions]
    assert all(chance is not None for chance in chances)


def test_a_bent_machine_is_called_one_that_the_model_leaves_out() -> None:
    gap = CAUSES["axis_gap"].at(np.array([0.3, -0.4, 0.25]))
    session = readings(PROTOTYPE, double_posture(PROTOTYPE), effects=(gap,))
    solution = solve(session, PROTOTYPE)
    assert solution.suspicious
    assert solution.lack_of_fit_p is not None
    assert solution.lack_of_fit_p < SUSPICIOUS
    assert "larger than this gauge's noise would give" in solution.judgement
    # Repeats know nothing of the gap; the residuals do.
    assert solution.sigma_repeats_mm is not None
    assert solution.sigma_residuals_mm is not None
    assert solution.sigma_residuals_mm > 2.0 * solution.sigma_repeats_mm


def test_the_table_is_measured_minus_modelled() -> None:
    row = TableRow("x_y", measured_mm=0.52, modelled_mm=1.46)
    assert row.expected_mm == pytest.approx(-0.94, abs=1e-12)
    solution = solve(readings(PROTOTYPE, double_posture(PROTOTYPE)), PROTOTYPE)
    assert tuple(r.difference for r in solution.table) == SIX
    assert max(abs(r.expected_mm) for r in solution.table) < 0.03
    single = solve(readings(PROTOTYPE, single_posture(PROTOTYPE)), PROTOTYPE)
    assert single.table[0].difference == "z_x0"


def test_entering_the_offsets_removes_them() -> None:
    """True = indicated + Δρ: with the found offsets entered, the rest is the same machine with
    the remaining offsets, and its readings are near zero."""
    plan = double_posture(PROTOTYPE)
    found = solve(readings(PROTOTYPE, plan), PROTOTYPE)
    again = solve(readings(PROTOTYPE, plan, OFFSETS - found.offsets_mm, seed=2), PROTOTYPE)
    assert np.abs(again.offsets_mm).max() < 5.0 * found.std_mm.max()
    assert again.rms_before_mm < 0.1 * found.rms_before_mm


def test_monte_carlo_is_reproducible_and_reports_progress() -> None:
    seen: list[tuple[int, int]] = []

    def study(seed: int) -> list[float]:
        cells = monte_carlo(
            PROTOTYPE,
            np.random.default_rng(seed),
            methods=("six",),
            offsets_mm=(0.1, 1.0),
            replications=3,
            runs=50,
            progress=lambda done, total: seen.append((done, total)),
        )
        assert [cell.offset_mm for cell in cells] == [0.1, 1.0]
        assert all(cell.spread_mm > 0.0 for cell in cells)
        return [cell.mean_mm for cell in cells]

    assert study(5) == study(5)
    assert study(5) != study(6)
    assert seen[:6] == [(50 * k, 300) for k in range(1, 7)]


def test_monte_carlo_never_averages_what_did_not_converge() -> None:
    with pytest.raises(NotConvergedError, match="did not reach their optimum"):
        monte_carlo(PROTOTYPE, np.random.default_rng(1), sigma_mm=80.0, replications=1, runs=200)
