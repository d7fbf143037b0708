"""The paper's differences as data: six of twelve, any order, some of them missing."""

from dataclasses import replace

import numpy as np
import pytest

from orthoglide_cal.estimation import Method, pose, solve
from orthoglide_cal.model.measured import DIFFERENCES, DataKind
from orthoglide_cal.model.model import Model
from tests.estimation.sessions import (
    BENT,
    NAMED,
    OFFSETS,
    SINGLE,
    SIX,
    TWELVE,
    differences,
    only,
    problem_of,
)
from tests.machines import NOMINAL, both_models, extended


@both_models
def test_six_differences_of_twelve_are_max_minus_min(model: Model) -> None:
    twelve = differences(TWELVE, model)
    value = dict(zip(twelve.which, twelve.value.tolist(), strict=True))
    posed = pose(twelve, model, SIX)
    assert posed.which == DIFFERENCES[SIX]
    assert posed.data == pytest.approx(
        [value[NAMED[f"{each.name}+"]] - value[NAMED[f"{each.name}-"]] for each in posed.which],
        abs=1e-15,
    )
    assert posed.data == pytest.approx(differences(SIX, model).value, abs=1e-12)
    # Their isotropic readings cancel: six independent differences (eq. 28).
    assert posed.problem.covariance() == pytest.approx(2.0 * np.eye(6), abs=1e-15)
    assert solve(twelve, model, "six").offsets_mm == pytest.approx(OFFSETS, abs=1e-9)


def test_six_of_twelve_are_predicted_at_the_times_of_the_twelve() -> None:
    """A machine that drifts reads another max − min after three postures than after two."""
    drifting = extended(thermal_drift=(0.4, -0.7, 0.5))
    twelve = differences(TWELVE, drifting)
    assert solve(twelve, drifting, "six").offsets_mm == pytest.approx(OFFSETS, abs=1e-9)


def test_six_of_twelve_need_both_ends() -> None:
    names = [each.name for each in DIFFERENCES[TWELVE]]
    twelve = only(differences(TWELVE, NOMINAL), *(n for n in names if n not in ("dx_z-", "dy_x+")))
    posed = pose(twelve, NOMINAL, SIX)
    assert [each.name for each in posed.which] == ["dx_y", "dy_z", "dz_x", "dz_y"]
    assert solve(twelve, NOMINAL, "six").offsets_mm == pytest.approx(OFFSETS, abs=1e-9)
    assert len(solve(twelve, NOMINAL).promised()) == 4


@pytest.mark.parametrize("kind", [SIX, TWELVE, SINGLE])
def test_the_order_in_the_file_does_not_matter(kind: DataKind) -> None:
    straight = differences(kind, BENT)
    noise = np.random.default_rng(4).normal(0.0, 0.05, len(straight))
    straight = replace(straight, value=straight.value + noise)
    names = [each.name for each in straight.which]
    np.random.default_rng(6).shuffle(names)
    shuffled = only(straight, *names)
    one, two = solve(straight, BENT), solve(shuffled, BENT)
    assert two.offsets_mm == pytest.approx(one.offsets_mm, abs=1e-12)
    assert two.promised() == one.promised()
    # What is predicted for the file stands in the order of the file.
    expected = dict(zip(straight.which, one.predicted_mm, strict=True))
    assert two.predicted_mm == pytest.approx([expected[e] for e in shuffled.which], abs=1e-12)


@pytest.mark.parametrize("method", ["six-linear", "six", "twelve-linear", "twelve"])
def test_rms_are_of_what_the_method_uses_and_predicted_what_the_file_holds(method: str) -> None:
    data = differences(TWELVE, NOMINAL)
    data = replace(data, value=data.value + np.random.default_rng(3).normal(0.0, 0.05, 12))
    solution = solve(data, NOMINAL, method)
    predicted = problem_of(TWELVE, NOMINAL).predict(solution.offsets_mm)
    assert solution.predicted_mm == pytest.approx(predicted, abs=1e-12)
    posed = pose(data, NOMINAL, Method(method).uses)
    assert len(posed.data) == (6 if "six" in method else 12)
    assert solution.rms_before_mm == pytest.approx(np.sqrt(np.mean(posed.data**2)), rel=1e-12)
    offsets, slope = solution.offsets_mm, posed.problem.at_zero[1]
    linear = "linear" in method
    left = posed.data - (slope @ offsets if linear else posed.problem.predict(offsets))
    assert solution.rms_after_mm == pytest.approx(np.sqrt(np.mean(left**2)), rel=1e-9)
