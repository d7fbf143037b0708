"""The distances that the bench judges by, against independent calculations."""

import numpy as np
import pytest

from . import DIAL, LARGE, MICRON, PROTOTYPE, Session, expected_heldout, make_session, separation
from .forward import PARTS, prior_sd, signals
from .plan import Floats
from .separation import Neighbourhood


def _brute_distance(session: Session, cause: str) -> float:
    """Distance to a machine cause by plain Gauss-Newton with fresh derivatives each round."""
    columns = [0, 1, 2, *range(PARTS[cause].start, PARTS[cause].stop)]
    scale = np.concatenate((np.ones(3), prior_sd(cause)))
    zeros = np.eye(6)[session.plan.setup]
    penalty = np.concatenate((np.zeros(9), np.ones(len(columns) - 3)))

    def misfit(values: Floats) -> Floats:
        state = np.zeros(30)
        state[columns] = values[6:] * scale
        modelled = signals(session.plan, session.machine, state[None])[0] + zeros @ values[:6]
        weighted: Floats = (session.clean - modelled) / session.gauge.sigma
        return np.concatenate((weighted, -penalty * values))

    values = np.zeros(6 + len(columns))
    for _ in range(8):
        here = misfit(values)
        steps = 1e-4 * np.eye(values.size)
        slopes = np.stack([(misfit(values + s) - misfit(values - s)) / 2e-4 for s in steps], 1)
        values = values - np.linalg.lstsq(slopes, here, rcond=None)[0]
    return float(np.linalg.norm(misfit(values)))


@pytest.mark.parametrize("cause", ["axis_gap", "encoder_scale", "bar_skew", "thermal_drift"])
def test_distances_equal_a_full_nonlinear_fit(cause: str) -> None:
    for hidden in ("sign_flip", "axis_squareness"):
        session = make_session(6, LARGE, MICRON, (hidden,))
        exact = _brute_distance(session, cause)
        assert separation(session).distances[cause] == pytest.approx(exact, rel=1e-3)


def test_a_shift_is_as_far_as_a_fit_at_every_place_says() -> None:
    session = make_session(11, PROTOTYPE, DIAL, ("gauge_slip",))
    near = Neighbourhood(session)
    residual = (session.clean - near.centre) / DIAL.sigma
    costs = []
    for column in near.places["stand_shift"].T:
        matrix = np.block([[near.free, column[:, None]], [np.zeros((1, 9)), np.eye(1)]])
        target = np.append(residual, 0.0)
        fit = np.linalg.lstsq(matrix, target, rcond=None)[0]
        costs.append(np.sum((target - matrix @ fit) ** 2))
    assert len(costs) == 54
    # At its offsets the slip stands where the model was linearised: no curvature to speak of.
    distance = separation(session).distances["stand_shift"]
    assert distance == pytest.approx(np.sqrt(min(costs)), rel=1e-3)


def test_expected_heldout_is_what_leaving_out_gives() -> None:
    """Linear refits of 120 noisy records: 120 x 60 errors, ratio within 6 %, 4 sigma."""
    session = make_session(7, PROTOTYPE, MICRON)
    near = Neighbourhood(session)
    rng = np.random.default_rng(8)
    noise = rng.normal(scale=MICRON.sigma, size=(60, 120))
    cells = [f"{s}{p}" for s, p in zip(session.plan.setup, session.plan.posture, strict=True)]
    errors = np.zeros_like(noise)
    for cell in set(cells):
        out = np.array([name == cell for name in cells])
        fit = np.linalg.lstsq(near.free[~out], noise[~out], rcond=None)[0]
        errors[out] = noise[out] - near.free[out] @ fit
    measured = np.sqrt(np.mean(errors**2))
    assert len(set(cells)) == 18
    assert expected_heldout(session) == pytest.approx(measured, rel=0.06)
